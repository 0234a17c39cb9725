//! The radiance along a ray: a path tracer with next-event estimation and multiple importance sampling
//! (Veach 1997, ch. 9, power heuristic). Knows no pixels.

use std::f32::consts::PI;

use crate::math::{Cone, Ray, Vec3};
use crate::shade::bsdf::View;
use crate::shade::sampler::Sampler;
use crate::stats::Rays;
use crate::world::{Detail, Interaction, Met, World};

/// How far paths go.
#[derive(Debug, Clone, Copy)]
pub struct PathOptions {
    /// The most scatterings of a path; 0 shows only what emits.
    pub max_bounces: u32,
    /// Scatterings after which Russian roulette may end a path; at least `max_bounces` for none.
    pub roulette_after: u32,
    /// How wide lookups of textures are: 1 for all that the path stands for, 0 for no more than a texel.
    pub footprint: f32,
}

impl Default for PathOptions {
    fn default() -> Self {
        Self {
            max_bounces: 8,
            roulette_after: 3,
            footprint: 1.0,
        }
    }
}

/// What one path brings back.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PathSample {
    /// Radiance along the camera ray.
    pub radiance: Vec3,
    /// 1 where the path met something, 0 where it left the scene.
    pub alpha: f32,
    /// Of the first surface: what it reflects of white light.
    pub albedo: Vec3,
    /// Of the first surface: unit shading normal in world space.
    pub normal: Vec3,
    /// Of the first surface: where it is; none if the ray left the scene.
    pub first: Option<FirstHit>,
}

/// The first surface that a path met.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FirstHit {
    /// World space.
    pub position: Vec3,
    /// Face of the control mesh.
    pub face: u32,
    /// Number of the placement, from 1; 0 is nothing.
    pub object: u32,
}

/// Surfaces that a path may pass straight through because they are transparent there, before it is ended.
const MAX_PASSED: u32 = 256;

/// The widest that a scattering makes a ray, by the length of its way. A wider one would blur light that a surface gets
/// from what is near.
const WIDEST_SPREAD: f32 = 0.5;

/// The radiance that arrives along `ray`, which is as wide as `cone`, and what the ray met first.
///
/// Textures are looked up as wide as the ray is where it meets them. A mirror leaves a ray its width; any other scattering
/// spreads it by the part of all directions that a path stands for, which chose its own with a density of `pdf`: 1 / pdf
/// (after Suykens and Willems, "Path Differentials and Applications", 2001, who ask how far a path may be from its
/// neighbours). That mirrors bend, and spread rays or gather them, is left out: textures in round mirrors are sharper than they
/// had to be.
///
/// Once a scattering has spread a ray that wide, surfaces may be diced more coarsely for the rest of the path: see
/// [`Detail`].
///
/// Dimensions of the sampler: set 0 is the caller's; each scattering takes two sets, each surface that is
/// partly transparent one from the far end.
pub fn path(
    world: &World,
    options: &PathOptions,
    (mut ray, cone): (Ray, Cone),
    sampler: &Sampler,
    rays: &mut Rays,
) -> PathSample {
    let mut out = PathSample::default();
    let mut throughput = Vec3::ONE;
    let mut scattered = 0;
    let mut passed = 0;
    let mut cone = cone.scaled(options.footprint);
    let mut detail = Detail::Full;
    // How the last scattering chose this direction; none for the camera, whose rays see lights in full.
    let mut last: Option<Scattering> = None;
    rays.camera += 1;
    loop {
        // Meet the next thing, or leave the scene.
        let met = world.meet(&ray, cone, detail);
        let interaction = match &met {
            Met::Nothing => {
                let from = last.map_or(ray.origin, |s| s.position);
                for seen in world.lights.environment_parts(from, ray.direction) {
                    let share = share(last, world, seen.light);
                    out.radiance += throughput * seen.radiance * share * weight(last, seen.pdf);
                }
                return out;
            }
            Met::Light { area, hit } => {
                let from = last.map_or(ray.origin, |s| s.position);
                let (radiance, pdf) = world.lights.emitted(*area, from, hit, ray.direction);
                let share = share(last, world, world.lights.light_of(*area));
                out.radiance += throughput * radiance * share * weight(last, pdf);
                if scattered == 0 {
                    out.alpha = 1.0;
                    if out.first.is_none() {
                        out.first = Some(FirstHit {
                            position: ray.at(hit.t),
                            face: 0,
                            object: 0,
                        });
                    }
                }
                return out;
            }
            Met::Surface(interaction) => interaction,
        };

        // Pass through where the surface is transparent.
        if interaction.opacity < 1.0 {
            let [u, ..] = sampler.set(PASS_SETS + passed);
            if u >= interaction.opacity {
                passed += 1;
                if passed > MAX_PASSED {
                    return out;
                }
                ray.t_min = interaction.beyond(&ray);
                continue;
            }
        }

        let wo = -ray.direction;
        let bsdf = interaction.bsdf();
        let view = bsdf.seen_from(wo);
        if out.first.is_none() {
            out.alpha = 1.0;
            out.albedo = view.as_ref().map_or(Vec3::ZERO, View::albedo);
            out.normal = interaction.shading_normal;
            out.first = Some(FirstHit {
                position: interaction.position,
                face: interaction.face,
                object: interaction.object + 1,
            });
        }
        out.radiance += throughput * interaction.emission;
        let Some(view) = &view else {
            return out;
        };
        if scattered >= options.max_bounces {
            return out;
        }

        // Light that comes straight from a light.
        let lights = sampler.set(1 + 2 * scattered);
        let towards = (ray.time, detail);
        out.radiance += throughput * direct(world, interaction, view, towards, lights, rays);

        // Light that comes any other way.
        let [u0, u1, u2, roulette] = sampler.set(2 + 2 * scattered);
        let Some(sample) = view.sample([u0, u1, u2]) else {
            return out;
        };
        let specular = if world.lights_are_split {
            specular_share(view, sample.wi)
        } else {
            0.0
        };
        throughput *= sample.value / sample.pdf;
        scattered += 1;
        if scattered > options.roulette_after {
            let survival = throughput.max_element().min(0.95);
            if roulette >= survival {
                return out;
            }
            throughput /= survival;
        }
        if throughput == Vec3::ZERO || !throughput.is_finite() {
            return out;
        }
        rays.scattered += 1;
        let lobe = 4.0 / (PI * sample.pdf);
        let spread = cone.spread * cone.spread + options.footprint * options.footprint * lobe;
        let spread = spread.sqrt();
        cone = Cone {
            width: cone.at(interaction.t),
            spread: spread.min(WIDEST_SPREAD.max(cone.spread)),
        };
        last = Some(Scattering {
            pdf: sample.pdf,
            position: interaction.position,
            specular,
        });
        if lobe >= WIDEST_SPREAD * WIDEST_SPREAD {
            detail = Detail::Bounced;
        }
        ray = match detail {
            Detail::Full => interaction.leave(sample.wi, ray.time),
            Detail::Bounced => world.bounce(interaction, sample.wi, ray.time),
        };
    }
}

/// Dimension sets for transparency lie beyond those of any path that people ask for.
const PASS_SETS: u32 = 4096;

#[derive(Debug, Clone, Copy)]
struct Scattering {
    pdf: f32,
    position: Vec3,
    /// Which part of the scattering was specular, 0..1; only computed where some light tells them apart.
    specular: f32,
}

/// What a light gives to a scattering that found it: UsdLux's `diffuse` and `specular` multipliers.
fn share(last: Option<Scattering>, world: &World, light: usize) -> f32 {
    let Some(last) = last.filter(|_| world.lights_are_split) else {
        return 1.0;
    };
    let [diffuse, specular] = world.lights.multipliers(light);
    diffuse + (specular - diffuse) * last.specular
}

fn specular_share(view: &View<'_>, wi: Vec3) -> f32 {
    let value = view.eval(wi);
    let [diffuse, specular] = [value.diffuse, value.specular].map(Vec3::element_sum);
    if diffuse + specular > 0.0 {
        specular / (diffuse + specular)
    } else {
        0.0
    }
}

/// Weight of light that a scattering found, where sampling the lights would have found it with density `pdf`.
fn weight(last: Option<Scattering>, pdf: f32) -> f32 {
    last.map_or(1.0, |scattering| power_heuristic(scattering.pdf, pdf))
}

fn power_heuristic(this: f32, other: f32) -> f32 {
    // In the form that survives infinite and very large densities.
    if this.is_infinite() {
        return 1.0;
    }
    let ratio = other / this;
    1.0 / (1.0 + ratio * ratio)
}

/// From clear of the surface to just short of the light's point `distance` along `wi`. It aims at that point, not
/// along `wi`: beside it, a ray to the limb of a round light would be shadowed by the light itself.
fn shadow_ray(interaction: &Interaction, wi: Vec3, distance: f32, time: f32) -> Ray {
    let ray = interaction.leave(wi, time);
    if distance.is_infinite() {
        return ray;
    }
    let to = interaction.position + distance * wi - ray.origin;
    let distance = to.length();
    Ray {
        direction: to / distance,
        t_max: distance * (1.0 - 1e-4),
        ..ray
    }
}

fn direct(
    world: &World,
    interaction: &Interaction,
    view: &View<'_>,
    (time, detail): (f32, Detail),
    [pick, u, v, _]: [f32; 4],
    rays: &mut Rays,
) -> Vec3 {
    let Some(light) = world.lights.sample(interaction.position, pick, [u, v]) else {
        return Vec3::ZERO;
    };
    let value = view.eval(light.wi);
    let reflected = if world.lights_are_split {
        let [diffuse, specular] = world.lights.multipliers(light.light);
        diffuse * value.diffuse + specular * value.specular
    } else {
        value.total()
    };
    if reflected == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let contribution = if light.pdf.is_infinite() {
        reflected * light.radiance
    } else {
        reflected * light.radiance * (power_heuristic(light.pdf, value.pdf) / light.pdf)
    };
    if contribution == Vec3::ZERO {
        return Vec3::ZERO;
    }
    rays.shadow += 1;
    let shadow = shadow_ray(interaction, light.wi, light.distance, time);
    contribution * world.transmittance(&shadow, detail)
}
