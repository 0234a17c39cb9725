//! The built scene: what a ray meets, and what that point looks like.

mod build;
mod displacement;
mod estimate;
mod foresee;
mod geometry;
mod interaction;
mod method;
mod objects;
mod patch;
mod plan;
mod prepare;
#[cfg(test)]
mod ptex_tests;
mod shape;
mod stand;
mod stored;
mod textures;
mod worn;

pub use build::{BuildOptions, Built};
pub use displacement::of_embree;
pub use estimate::{Counts, Need};
pub use foresee::{Foreseen, ObjectForeseen, chosen, foresee};
pub use interaction::Interaction;
pub use method::{Choice, HitPlaces, How, Method, TracedSurface};
pub use objects::{Object, objects};

pub use crate::accel::{Cache, CacheSize, MaxError, cache_use};
pub use crate::stats::{AchievedError, CacheUse, Spread};
pub use crate::surface::Dicing;

use std::sync::Arc;

use crate::accel::Hit;
use crate::error::Result;
use crate::image::PtexTexture;
use crate::math::{Cone, Ray};
use crate::shade::light::Lights;
use crate::trace;
use shape::Shape;
use stand::Stand;
use worn::Worn;

/// A scene, ready for rays. Shared by all render threads.
pub struct World {
    scene: trace::Scene,
    /// The same, with the same numbers, as it is diced for paths that have bounced, if that is done otherwise.
    bounced: Option<trace::Scene>,
    /// By the scene's geometry number.
    entries: Vec<Entry>,
    shapes: Vec<Shape>,
    placed: Vec<Placed>,
    /// Materials on shapes: what shapes and placements mean by numbers.
    worn: Vec<Worn>,
    /// Files that are read while rays are traced.
    ptex: Vec<Arc<PtexTexture>>,
    /// All lights.
    pub lights: Lights,
    /// Whether any material lets light through.
    transparent: bool,
    /// Whether anything but the camera moves while the shutter is open.
    pub moves: bool,
    /// Whether any light treats diffuse and specular reflection differently.
    pub lights_are_split: bool,
}

/// What a geometry of the scene is.
#[derive(Debug, Clone, Copy)]
enum Entry {
    /// The area lights that are not rectangles.
    Lights,
    /// Two triangles for each rectangular light.
    Rectangles,
    /// A placement, by number.
    Placed(u32),
}

/// A shape in the world.
struct Placed {
    shape: u32,
    stand: Stand,
    /// What all of it wears, whatever its shape does.
    worn: Option<u32>,
    display_color: Option<[f32; 3]>,
}

/// For which rays surfaces are diced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Detail {
    /// Those that come from the camera, also by mirrors, and those from there to lights.
    #[default]
    Full,
    /// Those of a path that a surface has scattered widely, as diffuse ones do: what they meet is seen blurred.
    Bounced,
}

/// What a ray met.
pub enum Met {
    /// Nothing.
    Nothing,
    /// An area light: its number among them and where.
    Light {
        /// Its number.
        area: u32,
        /// Where on it.
        hit: Hit,
    },
    /// A surface.
    Surface(Interaction),
}

impl World {
    /// The nearest thing along the ray. Textures of a surface are looked up as wide as `cone` is there; it needs a ray of
    /// unit direction, unless it is a line.
    pub fn meet(&self, ray: &Ray, cone: Cone, detail: Detail) -> Met {
        let Some(hit) = self.scene(detail).intersect(ray) else {
            return Met::Nothing;
        };
        match self.entries[hit.instance.unwrap_or(hit.geometry) as usize] {
            Entry::Lights => Met::Light {
                area: hit.face,
                hit: Hit {
                    t: hit.t,
                    face: hit.face,
                    uv: hit.uv,
                    normal: hit.normal,
                    error: 0.0,
                },
            },
            Entry::Rectangles => {
                let hit = self.lights.on_triangle(hit.primitive, hit.t, hit.uv);
                Met::Light {
                    area: hit.face,
                    hit,
                }
            }
            Entry::Placed(number) => {
                Met::Surface(self.interaction(number, ray, cone, (&hit, detail)))
            }
        }
    }

    /// What part of the light passes along the ray: 0 or 1, or between where surfaces are partly transparent.
    pub fn transmittance(&self, ray: &Ray, detail: Detail) -> f32 {
        if !self.transparent {
            return if self.scene(detail).occluded(ray) {
                0.0
            } else {
                1.0
            };
        }
        let mut ray = *ray;
        let mut transmittance = 1.0;
        // Each turn moves on to the next surface; more than this many are as good as opaque.
        for _ in 0..256 {
            match self.meet(&ray, Cone::LINE, detail) {
                Met::Nothing => return transmittance,
                Met::Light { .. } => return 0.0,
                Met::Surface(interaction) => {
                    transmittance *= 1.0 - interaction.opacity;
                    if transmittance <= 0.0 {
                        return 0.0;
                    }
                    ray.t_min = interaction.beyond(&ray);
                }
            }
        }
        0.0
    }

    /// What was wrong with a texture that is read while rays are traced: the picture is not to be trusted then.
    ///
    /// # Errors
    /// If anything was.
    pub fn check_textures(&self) -> Result<()> {
        match self.ptex.iter().find_map(|texture| texture.fault()) {
            Some(fault) => Err(fault.clone().into()),
            None => Ok(()),
        }
    }

    /// The message of the first panic in a callback, if there was one: the picture is not to be trusted then.
    pub fn take_panic(&self) -> Option<String> {
        let bounced = self.bounced.as_ref();
        (self.scene.take_panic()).or_else(|| bounced.and_then(trace::Scene::take_panic))
    }

    /// What such rays meet.
    #[inline]
    fn scene(&self, detail: Detail) -> &trace::Scene {
        match (&self.bounced, detail) {
            (Some(bounced), Detail::Bounced) => bounced,
            _ => &self.scene,
        }
    }
}
