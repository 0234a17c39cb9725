//! A surface built for one method, alone in a scene of Embree's.

use std::sync::Arc;

use super::Fineness;
use crate::error::Result;
use crate::math::{Affine3A, Ray, Vec3};
use crate::shade::camera::Camera;
use crate::surface::{Dicing, Places, Rates, Surface};
use crate::trace::{Device, Scene, SceneBuilder, SceneHit, SceneOptions};
use crate::world::{HitPlaces, Method, Object};

/// An object of the scene at the fineness asked for.
pub(super) struct Prepared {
    pub(super) object: Object,
    pub(super) rates: Rates,
}

/// All objects at the fineness asked for.
pub(super) fn prepare(
    objects: Vec<Object>,
    fineness: Fineness,
    camera: &dyn Fn() -> Result<Camera>,
) -> Result<Vec<Prepared>> {
    let faces: u64 = objects
        .iter()
        .map(|object| Rates::uniform(&object.surface, 1).micro_triangles() / 2)
        .sum();
    let camera = match fineness {
        Fineness::DicingRate(_) => Some(camera()?),
        Fineness::MicroTriangles(_) => None,
    };
    let rates = |object: &Object| match (fineness, &camera) {
        (Fineness::DicingRate(rate), Some(camera)) => {
            let places = Places::nearest(camera, &object.bounds, &object.world_from_object);
            let dicing = Dicing {
                rate,
                ..Dicing::default()
            };
            Rates::on_screen(&object.surface, &places, &dicing)
        }
        (Fineness::DicingRate(_), None) => Rates::uniform(&object.surface, 1),
        (Fineness::MicroTriangles(count), _) => {
            let segments = (count as f64 / (2 * faces.max(1)) as f64).sqrt().round();
            Rates::uniform(&object.surface, segments as u32)
        }
    };
    Ok(objects
        .into_iter()
        .map(|object| Prepared {
            rates: rates(&object),
            object,
        })
        .collect())
}

impl Prepared {
    /// Rates so many times as fine.
    pub(super) fn finer(&self, times: u32) -> Rates {
        Rates::by_edge(&self.object.surface, |edge| times * self.rates.edge(edge))
    }

    /// Builds a method's scene of this mesh alone.
    pub(super) fn build(&self, method: Method, rates: &Rates, device: &Device) -> Result<Traced> {
        let object = &self.object;
        let (geometry, places, mut bytes) = if method == Method::EmbreeSubdivision {
            (object.embree_subdivision(rates, device)?, None, 0)
        } else {
            let built = method.build(&object.surface, rates, device)?;
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
            surface: object.surface.clone(),
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
    /// Held beside Embree's.
    pub(super) bytes: usize,
}

impl Traced {
    /// The unit normal of the smooth displaced surface at a hit.
    pub(super) fn normal(&self, hit: &SceneHit) -> Vec3 {
        let Some(places) = &self.places else {
            let geometry = self.scene.geometry(hit.geometry);
            let point = geometry.displaced_point(hit.primitive, hit.uv, 0.0);
            let sign = if self.surface.base().left_handed() {
                -1.0
            } else {
                1.0
            };
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
