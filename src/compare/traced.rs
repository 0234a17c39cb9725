//! A surface built for one method, alone in a scene of Embree's.

use std::sync::Arc;

use super::Fineness;
use crate::accel::{Compact, CompactOptions, Intersector, Tessellated};
use crate::error::Result;
use crate::math::{Affine3A, Bounds3, Ray, Vec3};
use crate::mesh::Topology;
use crate::shade::camera::Camera;
use crate::surface::{Diced, Dicing, Places, Rates, Subdivision, Surface};
use crate::trace::{
    self, Device, Geometry, Scene, SceneBuilder, SceneHit, SceneOptions, diced_grid_uv,
    diced_triangle_uv,
};
use crate::world::Object;

/// A way of tracing a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Embree's own subdivision geometry.
    EmbreeSubdivision,
    /// Our micro-triangles as Embree's triangles.
    EmbreeTriangles,
    /// Our micro-triangles as Embree's grids.
    EmbreeGrid,
    /// Our micro-triangles in a plain tree of our own.
    Tessellated,
    /// Our micro-triangles quantised, in trees without pointers.
    Compact,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::EmbreeSubdivision,
        Self::EmbreeTriangles,
        Self::EmbreeGrid,
        Self::Tessellated,
        Self::Compact,
    ];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::EmbreeSubdivision => "embree-subdivision",
            Self::EmbreeTriangles => "embree-triangles",
            Self::EmbreeGrid => "embree-grid",
            Self::Tessellated => "tessellated",
            Self::Compact => "compact",
        }
    }
}

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
        let mut bytes = 0;
        let mut diced = None;
        let geometry = if method == Method::EmbreeSubdivision {
            let corners = self.base.corner_rates(&self.topology, rates);
            let corners = corners.into_iter().map(|rate| rate as f32).collect();
            let options = self
                .object
                .subdivision_options(trace::Rates::PerCorner(corners));
            Geometry::subdivision(device, self.object.mesh.clone(), options)?
        } else if method == Method::Compact {
            let options = CompactOptions::default();
            let tree = Compact::build(&self.surface, rates, &options, &|_| true)?;
            bytes += tree.memory();
            Geometry::user(device, Arc::new(tree))?
        } else {
            let made = diced.insert(Arc::new(Diced::new(&self.surface, rates)));
            match method {
                Method::EmbreeGrid => Geometry::diced_grids(device, made)?,
                Method::Tessellated => {
                    let tree = Arc::new(Tessellated::build(made.clone()));
                    bytes += tree.memory();
                    Geometry::user(device, tree)?
                }
                _ => Geometry::diced_triangles(device, made)?,
            }
        };
        bytes += geometry.memory();
        if let (Some(diced), Method::EmbreeTriangles | Method::EmbreeGrid) = (&diced, method) {
            bytes += size_of_val(diced.grids());
        }
        let options = SceneOptions {
            robust: true,
            compact: false,
        };
        let mut builder = SceneBuilder::new(device, options)?;
        builder.attach(geometry);
        Ok(Traced {
            method,
            scene: Arc::new(builder.commit(&|_| true)?),
            diced,
            surface: self.surface.clone(),
            left_handed: self.object.mesh.left_handed,
            bytes,
        })
    }
}

/// A surface built for a method.
pub(super) struct Traced {
    pub(super) method: Method,
    pub(super) scene: Arc<Scene>,
    diced: Option<Arc<Diced>>,
    surface: Arc<Surface>,
    left_handed: bool,
    /// Held beside Embree's.
    pub(super) bytes: usize,
}

impl Traced {
    /// The unit normal of the smooth displaced surface at a hit.
    pub(super) fn normal(&self, hit: &SceneHit) -> Vec3 {
        let (face, uv) = match (&self.diced, self.method) {
            (Some(diced), Method::EmbreeTriangles) => diced_triangle_uv(diced, hit),
            (Some(diced), Method::EmbreeGrid) => diced_grid_uv(diced, hit),
            (_, Method::Tessellated | Method::Compact) => (hit.face, hit.uv),
            _ => {
                let geometry = self.scene.geometry(hit.geometry);
                let point = geometry.displaced_point(hit.primitive, hit.uv, 0.0);
                let sign = if self.left_handed { -1.0 } else { 1.0 };
                return sign * point.du.cross(point.dv).normalize_or_zero();
            }
        };
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
