//! UsdLux's lights: what they radiate, and how to choose directions towards them.
//!
//! An area light's radiance is its colour (`color` x `intensity` x 2^`exposure`), divided by its area in the world
//! if `normalize` is on, times its picture, times its shaping. Rectangles and disks shine towards their local -Z
//! only, spheres and cylinders outward only; all of them are black on the other side and block rays on both. A
//! rectangle's picture reads right for someone who stands in its light, with +Y up: `s = 0` is at +X and `t = 0`,
//! the bottom row, at -Y. Pictures on other area lights, and `normalize` and shaping on domes, have no effect.
//!
//! Domes and distant lights are the *environment*: rays that meet nothing see them. What depends on a distant
//! light's angle stands in `distant.rs`, how a picture lies on a dome in `dome.rs`. This layer does not know what
//! surfaces do with light.

mod area;
mod distant;
mod distribution;
mod dome;
mod picture;
mod planar;
mod round;
mod shaping;
#[cfg(test)]
mod tests;

use std::f32::consts::PI;
use std::sync::Arc;

use area::AreaLight;
use distant::Distant;
use distribution::Steps;
use dome::Dome;
use picture::Picture;

use crate::accel::Hit;
use crate::error::Warnings;
use crate::math::{Bounds3, DAffine3, Vec2, Vec3};
use crate::scene::{self, LightKind};

pub use area::LightShapes;
pub use picture::Radiance;

/// All lights of a scene, ready to be sampled. Shared by all render threads.
#[derive(Debug, Clone)]
pub struct Lights {
    shapes: Option<Arc<LightShapes>>,
    distant: Vec<Far<Distant>>,
    domes: Vec<Far<Dome>>,
    /// What the choice falls on: area lights first, then distant lights, then domes.
    choice: Option<Steps>,
    /// Diffuse and specular, for every light of the description.
    multipliers: Vec<[f32; 2]>,
}

/// A light of the environment.
#[derive(Debug, Clone)]
struct Far<T> {
    light: usize,
    pick: f32,
    source: T,
}

/// A direction towards a light.
///
/// The estimate of what arrives at a surface is `f |cos| radiance / pdf`, if the way is free. From a distant light
/// of angle 0 comes light from one direction only: then `pdf` is infinite, `radiance` is the irradiance on a facing
/// surface already divided by the probability that this light was chosen, the estimate is `f |cos| radiance`, and
/// no other way of sampling can find it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightSample {
    /// Unit, from the point towards the light.
    pub wi: Vec3,
    /// How far the light is; infinite for the environment. A ray along `wi` that ends at `distance x (1 - 1e-4)`
    /// stops short of the light.
    pub distance: f32,
    /// Of this light alone, without the multipliers.
    pub radiance: Vec3,
    /// Per solid angle, times the probability that this light was chosen; infinite for a single direction.
    pub pdf: f32,
    /// Index into the description's lights.
    pub light: usize,
}

/// What one light of the environment contributes in a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Index into the description's lights.
    pub light: usize,
    /// Without the multipliers.
    pub radiance: Vec3,
    /// Of [`Lights::sample`] choosing this light and this direction.
    pub pdf: f32,
}

impl Lights {
    /// The lights of a description. `textures` runs parallel to its textures; one that is missing leaves the
    /// map's fallback. `scene_bounds` tell how much of the environment's light the scene catches, which matters
    /// for choosing among lights only.
    pub fn new(
        lights: &[scene::Light],
        textures: &[Option<Arc<dyn Radiance>>],
        scene_bounds: Bounds3,
    ) -> (Self, Warnings) {
        let mut warnings = Warnings::default();
        let (mut areas, mut distant, mut domes) = (Vec::new(), Vec::new(), Vec::new());
        for (i, light) in lights.iter().enumerate() {
            if !light.world_from_light.is_finite()
                || light.world_from_light.matrix3.determinant() == 0.0
            {
                warnings.add("light with a singular transform", || {
                    format!(
                        "{}: the transform cannot be inverted; the light is left out",
                        light.path
                    )
                });
                continue;
            }
            let mut light = light.clone();
            light.color = usable(light.color);
            let shows = matches!(light.kind, LightKind::Rect { .. } | LightKind::Dome);
            if light.texture.is_some() && !shows {
                warnings.add("texture on a light that takes none", || {
                    format!(
                        "{}: only rectangles and domes take textures; it is ignored",
                        light.path
                    )
                });
                light.texture = None;
            }
            let picture = match light
                .texture
                .as_ref()
                .map(|map| Picture::new(map, textures))
            {
                Some(Ok(picture)) => Some(picture),
                Some(Err(fallback)) => {
                    light.color *= fallback;
                    None
                }
                None => None,
            };
            let world = &light.world_from_light;
            match light.kind {
                LightKind::Distant { angle } => distant.push(Far {
                    light: i,
                    pick: 0.0,
                    source: Distant::new(angle, light.color, light.normalize, world),
                }),
                LightKind::Dome => domes.push(Far {
                    light: i,
                    pick: 0.0,
                    source: Dome::new(light.color, picture, world),
                }),
                _ => match AreaLight::new(i, &light, picture) {
                    Some(area) => areas.push(area),
                    None => warnings.add("light without area", || {
                        format!(
                            "{}: its size is 0 or not a number; the light is left out",
                            light.path
                        )
                    }),
                },
            }
        }
        let multipliers = lights.iter().map(|l| [l.diffuse, l.specular]).collect();
        (
            Self::assemble(areas, distant, domes, multipliers, scene_bounds),
            warnings,
        )
    }

    /// One dome of even radiance, light 0: for a scene that has no lights.
    pub fn default_dome(radiance: Vec3) -> Self {
        let dome = Far {
            light: 0,
            pick: 0.0,
            source: Dome::new(usable(radiance), None, &DAffine3::IDENTITY),
        };
        Self::assemble(
            Vec::new(),
            Vec::new(),
            vec![dome],
            vec![[1.0; 2]],
            Bounds3::EMPTY,
        )
    }

    /// Whether there is no light at all, not even a black one.
    pub fn is_empty(&self) -> bool {
        self.count() == 0
    }

    /// How many lights there are, without those that were left out.
    pub fn count(&self) -> usize {
        self.areas().len() + self.distant.len() + self.domes.len()
    }

    /// Bytes held, beyond the textures.
    pub fn memory(&self) -> usize {
        use crate::accel::Intersector;
        self.shapes.as_ref().map_or(0, |s| s.memory())
            + self.distant.capacity() * size_of::<Far<Distant>>()
            + self.domes.capacity() * size_of::<Far<Dome>>()
            + self.domes.iter().map(|d| d.source.memory()).sum::<usize>()
            + self.choice.as_ref().map_or(0, Steps::memory)
            + self.multipliers.capacity() * size_of::<[f32; 2]>()
    }

    /// The area lights, for rays to meet; none if there are none.
    pub fn shapes(&self) -> Option<&Arc<LightShapes>> {
        self.shapes.as_ref()
    }

    /// The hit on a rectangular light where a ray met one of [`LightShapes::triangles`].
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn on_triangle(&self, triangle: u32, t: f32, uv: Vec2) -> Hit {
        let shapes = self.shapes.as_ref();
        shapes
            .expect("there are area lights where a ray met one")
            .on_triangle(triangle, t, uv)
    }

    /// Which light of the description the area light is.
    pub fn light_of(&self, area: u32) -> usize {
        self.areas()[area as usize].light
    }

    /// What the light (of the description) multiplies diffuse and specular reflection with.
    pub fn multipliers(&self, light: usize) -> [f32; 2] {
        self.multipliers[light]
    }

    /// A direction from `p` towards one of the lights, which `u_pick` chooses; none if that light does not shine
    /// on `p`. All numbers are in 0..1.
    pub fn sample(&self, p: Vec3, u_pick: f32, u: [f32; 2]) -> Option<LightSample> {
        let (i, _) = self.choice.as_ref()?.pick(u_pick);
        let areas = self.areas();
        if let Some(area) = areas.get(i) {
            let (s, radiance) = area.sample(p, u)?;
            return Some(LightSample {
                wi: s.wi,
                distance: s.distance,
                radiance,
                pdf: s.pdf * area.pick,
                light: area.light,
            });
        }
        let i = i - areas.len();
        let (wi, pdf, radiance, pick, light) = if let Some(far) = self.distant.get(i) {
            let (wi, pdf) = far.source.sample(u);
            let radiance = if pdf.is_finite() {
                far.source.radiance
            } else {
                far.source.radiance / far.pick
            };
            (wi, pdf, radiance, far.pick, far.light)
        } else {
            let far = self.domes.get(i - self.distant.len())?;
            let (wi, pdf) = far.source.sample(u);
            (wi, pdf, far.source.radiance(wi), far.pick, far.light)
        };
        (pdf > 0.0).then_some(LightSample {
            wi,
            distance: f32::INFINITY,
            radiance,
            pdf: pdf * pick,
            light,
        })
    }

    /// The radiance that `hit` on area light `area` sends back to `p_from` along the unit vector `wi`, which leads
    /// from `p_from` to the hit, and the density with which [`sample`](Self::sample) would have found it. Both are
    /// 0 on a side that does not shine.
    pub fn emitted(&self, area: u32, p_from: Vec3, hit: &Hit, wi: Vec3) -> (Vec3, f32) {
        if hit.normal.dot(wi) >= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let area = &self.areas()[area as usize];
        let pdf = area.pdf(p_from, hit.uv, wi) * area.pick;
        (area.radiance(hit.uv, wi), pdf)
    }

    /// The radiance from the unit vector `wi` of all domes and distant lights together, and the sum of their
    /// densities. For the camera, and for weighing where there is one such light; with several, weigh each part
    /// of [`environment_parts`](Self::environment_parts) by its own density, as [`sample`](Self::sample) chooses
    /// one.
    pub fn environment(&self, p_from: Vec3, wi: Vec3) -> (Vec3, f32) {
        self.environment_parts(p_from, wi)
            .fold((Vec3::ZERO, 0.0), |(radiance, pdf), part| {
                (radiance + part.radiance, pdf + part.pdf)
            })
    }

    /// What each dome, and each distant light whose cone holds it, shines from the unit vector `wi`.
    pub fn environment_parts(&self, _p_from: Vec3, wi: Vec3) -> impl Iterator<Item = Seen> + '_ {
        let distant = self.distant.iter().filter_map(move |far| {
            let pdf = far.source.pdf(wi);
            (pdf > 0.0).then_some(Seen {
                light: far.light,
                radiance: far.source.radiance,
                pdf: pdf * far.pick,
            })
        });
        let domes = self.domes.iter().map(move |far| Seen {
            light: far.light,
            radiance: far.source.radiance(wi),
            pdf: far.source.pdf(wi) * far.pick,
        });
        distant.chain(domes)
    }

    fn areas(&self) -> &[AreaLight] {
        self.shapes.as_ref().map_or(&[], |s| &s.lights)
    }

    /// Decides how often each light is chosen: half the choices evenly among the lights that shine, half by power.
    fn assemble(
        mut areas: Vec<AreaLight>,
        mut distant: Vec<Far<Distant>>,
        mut domes: Vec<Far<Dome>>,
        multipliers: Vec<[f32; 2]>,
        scene_bounds: Bounds3,
    ) -> Self {
        let radius = Some(0.5 * scene_bounds.extent().length())
            .filter(|r| *r > 0.0 && r.is_finite())
            .unwrap_or(1.0);
        // What a ball around the scene catches
        let disk = PI * radius * radius;
        let powers: Vec<f32> = (areas.iter().map(AreaLight::power))
            .chain(
                distant
                    .iter()
                    .map(|d| luminance(d.source.irradiance) * disk),
            )
            .chain(
                domes
                    .iter()
                    .map(|d| luminance(d.source.mean) * 4.0 * PI * disk),
            )
            .map(|power| if power.is_finite() { power } else { f32::MAX })
            .collect();
        let total: f64 = powers.iter().map(|&p| f64::from(p)).sum();
        let shining = powers.iter().filter(|&&p| p > 0.0).count() as f64;
        let choice = (shining > 0.0).then(|| {
            let weights: Vec<f32> = (powers.iter().map(|&p| f64::from(p)))
                .map(|p| if p > 0.0 { 0.5 / shining + 0.5 * p / total } else { 0.0 } as f32)
                .collect();
            Steps::new(&weights)
        });
        if let Some(choice) = &choice {
            let picks = (areas.iter_mut().map(|a| &mut a.pick))
                .chain(distant.iter_mut().map(|d| &mut d.pick))
                .chain(domes.iter_mut().map(|d| &mut d.pick));
            for (i, pick) in picks.enumerate() {
                *pick = choice.probability(i);
            }
        }
        Self {
            shapes: (!areas.is_empty()).then(|| Arc::new(LightShapes::new(areas))),
            distant,
            domes,
            choice,
            multipliers,
        }
    }
}

/// Rec.709.
fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// A colour that can be radiated: at least 0 and finite.
fn usable(color: Vec3) -> Vec3 {
    Vec3::from_array(
        color
            .to_array()
            .map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 }),
    )
}
