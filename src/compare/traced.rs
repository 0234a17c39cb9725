//! A surface built for one method, alone in a scene of Embree's.

use std::sync::Arc;

use super::Fineness;
use crate::error::{Error, Result};
use crate::math::{Affine3A, Ray, Vec2, Vec3};
use crate::memory::Budget;
use crate::shade::camera::Camera;
use crate::surface::{Dicing, Places, Rates, Subdivision, Surface};
use crate::trace::{Device, DeviceOptions, Scene, SceneBuilder, SceneHit, face_uv};
use crate::world::{
    AchievedError, Cache, Choice, Counts, HitPlaces, How, MaxError, Method, Object, chosen,
    of_embree,
};

/// How many times as fine references are along an edge: the first of these that is not too large.
const FINER: [u32; 3] = [4, 3, 2];

/// Micro-triangles of one surface's reference at most. They take 4 GB while they are built.
pub(super) const MOST_IN_REFERENCE: u64 = 1 << 27;

/// How many times as fine the reference of a surface of so many micro-triangles can be along an edge; none if even the
/// least would take too much memory.
pub(super) fn how_much_finer(micro_triangles: u64) -> Option<u32> {
    FINER
        .into_iter()
        .find(|&finer| micro_triangles * u64::from(finer) * u64::from(finer) <= MOST_IN_REFERENCE)
}

/// An object of the scene at the fineness asked for.
pub(super) struct Prepared {
    pub(super) object: Object,
    pub(super) rates: Rates,
    max_error: MaxError,
}

/// All objects at the fineness asked for.
pub(super) fn prepare(
    objects: Vec<Object>,
    (fineness, max_error): (Fineness, MaxError),
    camera: &dyn Fn() -> Result<Camera>,
) -> Result<Vec<Prepared>> {
    let diced = |object: &Object| {
        let surface = &object.surface;
        let faces = 0..surface.base().faces();
        faces.filter(|&face| !surface.is_even(face)).count() as u64
    };
    let faces: u64 = objects.iter().map(diced).sum();
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
            Rates::uniform(&object.surface, segments as u32).sparing_even_faces(&object.surface)
        }
    };
    Ok(objects
        .into_iter()
        .map(|object| Prepared {
            rates: rates(&object),
            object,
            max_error,
        })
        .collect())
}

/// A device of its own memory count, within the budget.
pub(super) fn device(budget: &Budget) -> Result<Device> {
    Device::new(&DeviceOptions {
        memory_budget: budget.clone(),
        ..DeviceOptions::default()
    })
}

/// By which method each object is traced.
pub(super) fn methods(choice: Choice, prepared: &[Prepared], budget: &Budget) -> Vec<Method> {
    let surfaces = || prepared.iter().map(|p| &*p.object.surface);
    match choice {
        Choice::One(method) => surfaces().map(|surface| method.on(surface)).collect(),
        Choice::Auto => chosen(surfaces().zip(prepared.iter().map(|p| &p.rates)), budget),
    }
}

impl Prepared {
    /// How many triangles are traced: micro-triangles, or those of the tiles over it.
    pub(super) fn triangles(&self) -> u64 {
        let copies = self.copies();
        copies.unwrap_or_else(|| self.rates.micro_triangles())
    }

    /// How many triangles copies of its tiles would be, if tiles of geometry are seen in the surface's place.
    pub(super) fn copies(&self) -> Option<u64> {
        let surface = &self.object.surface;
        (surface.tiles()).map(|tiles| tiles.count_over(surface.base()))
    }

    /// Whether tiles of geometry are seen in the surface's place.
    pub(super) fn is_tiled(&self) -> bool {
        self.object.surface.tiles().is_some()
    }

    /// Rates so many times as fine.
    pub(super) fn finer(&self, times: u32) -> Rates {
        Rates::by_edge(&self.object.surface, |edge| times * self.rates.edge(edge))
    }

    /// Rates so many times as coarse.
    fn coarser(&self, times: f32) -> Rates {
        self.rates.coarser(&self.object.surface, times)
    }

    /// Builds a method's scene of this mesh alone.
    pub(super) fn build(
        &self,
        method: Method,
        rates: &Rates,
        device: &Device,
        cache: &Arc<Cache>,
    ) -> Result<Traced> {
        let object = &self.object;
        let budget = device.memory_budget();
        let counts = Counts::new(&object.surface, rates);
        let what = || {
            let (path, name) = (&object.path, method.name());
            format!(
                "{path}: {} micro-triangles by {name}",
                counts.micro_triangles
            )
        };
        budget.ask(method.need(&counts).peak(), &what())?;
        let (geometry, numbering, mut bytes, error) =
            if method == Method::EmbreeSubdivision && object.surface.tiles().is_none() {
                let (geometry, base) = object.embree_subdivision(rates, device)?;
                (geometry, Numbering::Embrees(base), 0, None)
            } else {
                let how = How {
                    max_error: self.max_error,
                    cache,
                    go_on: &|_| budget.is_kept(),
                    keep: None,
                };
                let built = match method.build(&object.surface, rates, device, how) {
                    Err(Error::Interrupted) => {
                        return Err(budget.exceeded(format!("{} take more", what())));
                    }
                    Err(Error::Input(fault)) => return Err(fault.at_prim(&object.path).into()),
                    built => built?,
                };
                let error = built.error();
                let numbering = Numbering::Ours(built.places);
                (built.geometry, numbering, built.bytes, error)
            };
        bytes += geometry.memory();
        let mut builder = SceneBuilder::new(device, method.scene_options())?;
        builder.attach(geometry);
        Ok(Traced {
            scene: Arc::new(builder.commit(&|_| true)?),
            numbering,
            surface: object.surface.clone(),
            bytes,
            error,
        })
    }
}

/// A surface built for a method.
pub(super) struct Traced {
    pub(super) scene: Arc<Scene>,
    numbering: Numbering,
    surface: Arc<Surface>,
    /// Held beside Embree's.
    pub(super) bytes: usize,
    /// How far the method moved micro-vertices, if it did.
    pub(super) error: Option<AchievedError>,
}

/// How hits number faces.
enum Numbering {
    /// As our surfaces do.
    Ours(HitPlaces),
    /// As cages do: Embree's subdivision knows nothing of their parts.
    Embrees(Arc<Subdivision>),
}

/// A point of the smooth displaced surface.
pub(super) struct Smooth {
    pub(super) position: Vec3,
    /// Of unit length, or zero where there is none.
    pub(super) normal: Vec3,
}

impl Traced {
    /// The surface's face, as ours are numbered, and the parameters on it.
    pub(super) fn place(&self, hit: &SceneHit) -> (u32, Vec2) {
        match &self.numbering {
            Numbering::Ours(places) => places.face_uv(hit),
            Numbering::Embrees(base) => of_embree(base, hit.primitive, hit.uv),
        }
    }

    /// The smooth displaced surface at a place, as the method has it.
    pub(super) fn smooth(&self, (face, uv): (u32, Vec2)) -> Smooth {
        match &self.numbering {
            Numbering::Ours(_) => {
                let point = self.surface.evaluate(face, uv, 0);
                Smooth {
                    position: point.position,
                    normal: point.normal,
                }
            }
            Numbering::Embrees(base) => {
                let (face, corner, uv) = base.on_cage(face, uv);
                let uv = corner.map_or(uv, |corner| face_uv(corner, uv));
                let point = self.scene.geometry(0).displaced_point(face, uv, 0.0);
                let front = if self.surface.base().left_handed() {
                    -1.0
                } else {
                    1.0
                };
                Smooth {
                    position: point.position,
                    normal: front * point.du.cross(point.dv).normalize_or_zero(),
                }
            }
        }
    }

    /// The point of the micro-triangle at a place, if it is known which that is.
    pub(super) fn flat(&self, (face, uv): (u32, Vec2)) -> Option<Vec3> {
        let Numbering::Ours(HitPlaces::Triangles(grids) | HitPlaces::Grids(grids)) =
            &self.numbering
        else {
            return None;
        };
        let grid = grids.of_face(face)?;
        let (triangle, weights) = grid.triangle_at(uv)?;
        let [a, b, c] = grid.corners(triangle).map(|(i, j)| {
            let point = self.surface.evaluate(face, grid.vertex_uv(i, j), 0);
            point.position
        });
        Some(a + weights.x * (b - a) + weights.y * (c - a))
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

/// All meshes as paths that have bounced see them, each where it stands, in one scene, and the bytes held beside Embree's.
pub(super) fn bounced(
    prepared: &[Prepared],
    (choice, methods): (Choice, &[Method]),
    (traced, times): (&[Traced], f32),
    device: &Device,
    cache: &Arc<Cache>,
) -> Result<(Scene, usize)> {
    let mut bytes = 0;
    let mut builder = SceneBuilder::new(device, choice.scene_options())?;
    for ((prepared, method), traced) in prepared.iter().zip(methods).zip(traced) {
        let scene = if method.is_diced() && !prepared.is_tiled() {
            let traced = prepared.build(*method, &prepared.coarser(times), device, cache)?;
            bytes += traced.bytes;
            traced.scene
        } else {
            traced.scene.clone()
        };
        for place in &prepared.object.world_from_object {
            builder.instance(scene.clone(), &[*place])?;
        }
    }
    Ok((builder.commit(&|_| true)?, bytes))
}

/// Several meshes built for a method, each where it stands, in one scene.
pub(super) fn together(
    method: Choice,
    traced: &[Traced],
    places: &[&[Affine3A]],
    device: &Device,
) -> Result<Scene> {
    let mut builder = SceneBuilder::new(device, method.scene_options())?;
    for (traced, places) in traced.iter().zip(places) {
        for place in *places {
            builder.instance(traced.scene.clone(), &[*place])?;
        }
    }
    builder.commit(&|_| true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::random::Random;
    use crate::error::Warnings;
    use crate::scene::{LoadOptions, obj};
    use crate::world::{self, CacheSize};

    const CUBE: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
                        f 1 4 3 2\nf 1 2 6 5\nf 3 4 8 7\n";
    /// Quads alone.
    const FLAT_ROOF: &str = "f 2 3 7 6\nf 4 1 5 8\nf 5 6 7 8\n";
    /// Two gables of five sides, two slopes, and a ridge of two points.
    const GABLES: &str = "v -1 0 2\nv 1 0 2\nf 2 3 7 10 6\nf 4 1 5 9 8\nf 5 6 10 9\nf 9 10 7 8\n";

    #[test]
    fn a_hits_place_is_the_same_place_by_every_method() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("catmark_house.obj");
        let device = Device::new(&DeviceOptions::default()).expect("a device");
        for roof in [FLAT_ROOF, GABLES] {
            std::fs::write(&path, format!("{CUBE}{roof}")).expect("the folder takes files");
            let scene = obj::load(&path, &LoadOptions::default()).expect("a house");
            let objects = world::objects(&scene, &Budget::default(), &mut Warnings::default())
                .expect("a surface");
            let fineness = (Fineness::MicroTriangles(20_000), MaxError::Usual);
            let prepared = prepare(objects, fineness, &|| {
                unreachable!("no pixels are asked for")
            })
            .expect("rates")
            .remove(0);
            let cache = |method: Method| method.cache(CacheSize::default());
            let all = Method::ALL.map(|method| {
                let traced = prepared.build(method, &prepared.rates, &device, &cache(method));
                traced.expect("Embree takes it")
            });
            let mut random = Random::new(1);
            for _ in 0..300 {
                let ray = Ray::new(Vec3::new(0.0, 0.0, 0.7), random.direction(), 0.0);
                for (method, traced) in Method::ALL.iter().zip(&all) {
                    let hit = traced.scene.intersect(&ray).expect("it is closed");
                    let place = traced.place(&hit);
                    // Facets are this close; a wrong part of the face is a hundred times as far. Where in a slab the
                    // surface has its parameters is known to a fifth of a micro-quad only, before the surface is
                    // asked; quads are a seventieth of the diagonal long here.
                    let close = match method {
                        Method::Compressed => 3e-3,
                        _ => 1e-3,
                    };
                    for other in &all {
                        let apart = other.smooth(place).position.distance(ray.at(hit.t));
                        assert!(
                            apart < close * prepared.object.diagonal() + hit.error,
                            "{} at {place:?}: {apart}",
                            method.name()
                        );
                    }
                }
            }
        }
    }
}
