//! A surface built for one method, alone in a scene of Embree's.

use std::sync::Arc;

use super::Fineness;
use crate::error::Result;
use crate::math::{Affine3A, Bounds3, Ray, Vec3};
use crate::mesh::Topology;
use crate::shade::camera::Camera;
use crate::surface::{Dicing, Places, Rates, Subdivision, Surface};
use crate::trace::{self, Device, Geometry, Scene, SceneBuilder, SceneHit, SceneOptions};
use crate::world::{HitPlaces, Method, Object};

/// A mesh of the scene with its surface.
pub(super) struct Prepared {
    pub(super) object: Object,
    pub(super) topology: Topology,
    base: Arc<Subdivision>,
    pub(super) surface: Arc<Surface>,
    pub(super) rates: Rates,
}

/// All meshes at the fineness asked for.
pub(super) fn prepare(
    objects: Vec<Object>,
    fineness: Fineness,
    camera: &dyn Fn() -> Result<Camera>,
) -> Result<Vec<Prepared>> {
    let surfaces: Vec<_> = objects.iter().map(Object::surface).collect();
    let faces: u64 = surfaces
        .iter()
        .map(|(_, surface)| Rates::uniform(surface, 1).micro_triangles() / 2)
        .sum();
    let camera = match fineness {
        Fineness::DicingRate(_) => Some(camera()?),
        Fineness::MicroTriangles(_) => None,
    };
    let rates = |object: &Object, surface: &Surface| match (fineness, &camera) {
        (Fineness::DicingRate(rate), Some(camera)) => {
            let bounds = Bounds3::of(object.mesh.used_points());
            let places = Places::nearest(camera, &bounds, &object.world_from_object);
            let dicing = Dicing {
                rate,
                ..Dicing::default()
            };
            Rates::on_screen(surface, &places, &dicing)
        }
        (Fineness::DicingRate(_), None) => Rates::uniform(surface, 1),
        (Fineness::MicroTriangles(count), _) => {
            let segments = (count as f64 / (2 * faces.max(1)) as f64).sqrt().round();
            Rates::uniform(surface, segments as u32)
        }
    };
    Ok(objects
        .into_iter()
        .zip(surfaces)
        .map(|(object, (base, surface))| Prepared {
            topology: object.mesh.topology(),
            rates: rates(&object, &surface),
            object,
            base,
            surface,
        })
        .collect())
}

impl Prepared {
    /// Rates so many times as fine.
    pub(super) fn finer(&self, times: u32) -> Rates {
        Rates::by_edge(&self.surface, |edge| times * self.rates.edge(edge))
    }

    /// Builds a method's scene of this mesh alone.
    pub(super) fn build(&self, method: Method, rates: &Rates, device: &Device) -> Result<Traced> {
        let (geometry, places, mut bytes) = if method == Method::EmbreeSubdivision {
            let corners = self.base.corner_rates(&self.topology, rates);
            let corners = corners.into_iter().map(|rate| rate as f32).collect();
            let options = self
                .object
                .subdivision_options(trace::Rates::PerCorner(corners));
            let mesh = self.object.mesh.clone();
            (Geometry::subdivision(device, mesh, options)?, None, 0)
        } else {
            let built = method.build(&self.surface, rates, device)?;
            (built.geometry, Some(built.places), built.bytes)
        };
        bytes += geometry.memory();
        let options = SceneOptions {
            robust: true,
            compact: false,
        };
        let mut builder = SceneBuilder::new(device, options)?;
        builder.attach(geometry);
        Ok(Traced {
            scene: Arc::new(builder.commit(&|_| true)?),
            places,
            surface: self.surface.clone(),
            left_handed: self.object.mesh.left_handed,
            bytes,
        })
    }
}

/// A surface built for a method.
pub(super) struct Traced {
    pub(super) scene: Arc<Scene>,
    /// None for Embree's subdivision.
    places: Option<HitPlaces>,
    surface: Arc<Surface>,
    left_handed: bool,
    /// Held beside Embree's.
    pub(super) bytes: usize,
}

impl Traced {
    /// The unit normal of the smooth displaced surface at a hit.
    pub(super) fn normal(&self, hit: &SceneHit) -> Vec3 {
        let Some(places) = &self.places else {
            let geometry = self.scene.geometry(hit.geometry);
            let point = geometry.displaced_point(hit.primitive, hit.uv, 0.0);
            let sign = if self.left_handed { -1.0 } else { 1.0 };
            return sign * point.du.cross(point.dv).normalize_or_zero();
        };
        let (face, uv) = places.face_uv(hit);
        self.surface.evaluate(face, uv, 0).normal
    }

    /// The distance to the nearest point along a line, either way, and the hit there.
    pub(super) fn probe(&self, p: Vec3, along: Vec3) -> Option<(f32, SceneHit)> {
        let probes = [along, -along].map(|d| self.scene.intersect(&Ray::new(p, d, 0.0)));
        let nearest = probes
            .into_iter()
            .flatten()
            .min_by(|a, b| a.t.total_cmp(&b.t));
        nearest.map(|hit| (hit.t * along.length(), hit))
    }
}

/// Several meshes, each where it stands, in one scene.
pub(super) fn together(
    traced: &[Traced],
    places: &[&[Affine3A]],
    device: &Device,
) -> Result<Scene> {
    let options = SceneOptions {
        robust: true,
        compact: false,
    };
    let mut builder = SceneBuilder::new(device, options)?;
    for (traced, places) in traced.iter().zip(places) {
        for place in *places {
            builder.instance(traced.scene.clone(), &[*place])?;
        }
    }
    builder.commit(&|_| true)
}
