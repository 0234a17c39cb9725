//! How a surface reflects: UsdPreviewSurface, as three layers that together never reflect more than they get.
//!
//! From the top: a clear coat (GGX, white, 4 % at normal incidence, times its amount), a specular layer (GGX)
//! and a diffuse base (Lambert). Each is dimmed by what the layers above it reflect:
//!
//! - The base by (1 - E(o)) (1 - E(i)) / (1 - mean E), with E the specular layer's albedo: Kelemen and
//!   Szirmay-Kalos, "A Microfacet Based Coupled Specular-Matte BRDF Model" (2001). Base and layer together
//!   reflect E + albedo (1 - E), exactly.
//! - All below the coat by min(1 - C(o), 1 - C(i)), with C the coat's albedo. It is reciprocal and at most
//!   1 - C(o), which proves the bound for any base; it loses a little where coat light would bounce back down.
//!
//! GGX alone loses light that meets more than one facet: a white metal of roughness 1 would reflect but half
//! of it. The specular layer gets it back as a cosine-like lobe (Kulla and Conty, "Revisiting Physically Based
//! Shading at Imageworks", 2017), so that a white metal reflects all, at any roughness. The coat, of which little
//! is lost, does not.
//!
//! No surface reflects more than it gets, because the tables of [`albedo`] are upper bounds. What white surfaces
//! lose by that, found by quadrature: at roughness 1 less than 0.1 % from any angle, with a full coat of roughness
//! 1 on top less than 0.8 %; mirrors half a degree above the horizon 0.6 %, but on average less than 0.1 %.
//!
//! All is reciprocal, and one-sided: the caller hands over a frame on the viewer's side.

pub mod albedo;

use std::f32::consts::FRAC_1_PI;

use self::albedo::{Parts, Row};
use super::microfacet::{Ggx, schlick};
use crate::math::{Frame, Vec3, concentric_disk};

/// The clear coat's reflectance at normal incidence: a varnish with an index of refraction of 1.5.
const COAT_F0: f32 = 0.04;

/// What UsdPreviewSurface says at one point. Numbers out of their range are clamped by [`Bsdf::new`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceParams {
    /// 0..1; a metal's reflectance in the metallic workflow.
    pub diffuse_color: Vec3,
    /// Which of `specular_color` and `metallic` counts.
    pub specular_workflow: bool,
    /// Reflectance at normal incidence in the specular workflow, 0..1.
    pub specular_color: Vec3,
    /// 0..1, in the metallic workflow.
    pub metallic: f32,
    /// 0..1; GGX's alpha is its square.
    pub roughness: f32,
    /// The coat's amount, 0..1.
    pub clearcoat: f32,
    /// 0..1.
    pub clearcoat_roughness: f32,
    /// Index of refraction, for the metallic workflow; 1 is no interface: nothing specular but metal.
    pub ior: f32,
}

impl SurfaceParams {
    /// Nothing but a diffuse base.
    pub fn lambert(albedo: Vec3) -> Self {
        Self {
            diffuse_color: albedo,
            specular_workflow: false,
            specular_color: Vec3::ZERO,
            metallic: 0.0,
            roughness: 1.0,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            ior: 1.0,
        }
    }
}

impl Default for SurfaceParams {
    /// The specification's defaults.
    fn default() -> Self {
        Self {
            diffuse_color: Vec3::splat(0.18),
            specular_workflow: false,
            specular_color: Vec3::ZERO,
            metallic: 0.0,
            roughness: 0.5,
            clearcoat: 0.0,
            clearcoat_roughness: 0.01,
            ior: 1.5,
        }
    }
}

/// A direction that a [`Bsdf`] chose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BsdfSample {
    /// Away from the surface, unit, world.
    pub wi: Vec3,
    /// f x |cos| of all layers, not only of the one that chose.
    pub value: Vec3,
    /// Density over solid angle, of all layers; above 0.
    pub pdf: f32,
}

/// What a surface does with light from one direction to another, with the density of choosing it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BsdfValue {
    /// f x |cos| of the diffuse base.
    pub diffuse: Vec3,
    /// f x |cos| of specular layer and coat.
    pub specular: Vec3,
    /// Density of [`Bsdf::sample`] over solid angle.
    pub pdf: f32,
}

impl BsdfValue {
    /// f x |cos| of all.
    #[inline]
    pub fn total(&self) -> Vec3 {
        self.diffuse + self.specular
    }
}

/// How one point of a surface reflects. Directions are unit, in world space, and point away from it.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf {
    frame: Frame,
    geometric: Vec3,
    diffuse: Vec3,
    specular: Option<Specular>,
    coat: Option<Coat>,
}

#[derive(Debug, Clone, Copy)]
struct Specular {
    ggx: Ggx,
    row: Row,
    f0: Vec3,
    f90: f32,
    /// Of light that met more than one facet, what is left.
    again: Vec3,
    /// 1 / (1 - mean albedo on first bounce of white facets).
    again_norm: f32,
    /// 1 / (1 - mean albedo).
    base_norm: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Coat {
    ggx: Ggx,
    row: Row,
    amount: f32,
}

/// A point seen from one side, ready for any number of questions: what depends on the viewer only.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    bsdf: &'a Bsdf,
    /// Towards the viewer, in the shading frame.
    o: Vec3,
    /// Part of the light that the coat lets through: 1 - the coat's albedo.
    below: f32,
    /// The specular layer on first bounce.
    parts: Parts,
    /// What the specular layer leaves for the base.
    left: Vec3,
    /// Probability of each lobe: coat, specular, cosine. Their sum is 1.
    pick: [f32; 3],
}

impl Bsdf {
    /// A surface with `frame` for shading; its normal and `geometric` (unit) lie on the viewer's side. See
    /// [`bent_towards`] for shading normals that do not.
    pub fn new(params: &SurfaceParams, frame: Frame, geometric: Vec3) -> Self {
        let color = clean(params.diffuse_color);
        let (f0, f90, diffuse) = if params.specular_workflow {
            (clean(params.specular_color), 1.0, color)
        } else {
            let metallic = clean_one(params.metallic);
            // No index at all (0, negative, NaN) is no interface either.
            let ior = if params.ior > 0.0 {
                params.ior.min(1e6)
            } else {
                1.0
            };
            let root = (1.0 - ior) / (1.0 + ior);
            let dielectric = clean_one(root * root);
            let interface = if dielectric > 0.0 { 1.0 } else { 0.0 };
            (
                Vec3::splat(dielectric * (1.0 - metallic)) + color * metallic,
                interface + metallic * (1.0 - interface),
                color * (1.0 - metallic),
            )
        };
        let amount = clean_one(params.clearcoat);
        Self {
            frame,
            geometric,
            diffuse,
            specular: (f90 > 0.0)
                .then(|| Specular::new(clean_one(params.roughness), f0.min(Vec3::splat(f90)), f90)),
            coat: (amount > 0.0).then(|| {
                let roughness = clean_one(params.clearcoat_roughness);
                Coat {
                    ggx: Ggx::from_roughness(roughness),
                    row: Row::at(roughness),
                    amount,
                }
            }),
        }
    }

    /// f x |cos| from `wi` to `wo`.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        self.eval_all(wo, wi).total()
    }

    /// The parts of [`Self::eval`]: diffuse, and specular with the coat.
    pub fn eval_split(&self, wo: Vec3, wi: Vec3) -> [Vec3; 2] {
        let value = self.eval_all(wo, wi);
        [value.diffuse, value.specular]
    }

    /// The density of [`Self::sample`] over solid angle.
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval_all(wo, wi).pdf
    }

    /// Value, its parts and the density, for the price of one. All are zero where `wo` or `wi` is below the
    /// surface, or below the shading normal's horizon: there, light would leak through.
    pub fn eval_all(&self, wo: Vec3, wi: Vec3) -> BsdfValue {
        self.seen_from(wo)
            .map_or_else(BsdfValue::default, |view| view.eval(wi))
    }

    /// As [`View::sample`].
    pub fn sample(&self, wo: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        self.seen_from(wo)?.sample(u)
    }

    /// As [`View::albedo`]; zero where nothing is reflected.
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        self.seen_from(wo).map_or(Vec3::ZERO, |view| view.albedo())
    }

    /// The shading frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The point as seen from `wo`; `None` from below, and where nothing is reflected.
    #[inline]
    pub fn seen_from(&self, wo: Vec3) -> Option<View<'_>> {
        let o = self.frame.local_from_world(wo);
        if o.z <= 0.0 || wo.dot(self.geometric) <= 0.0 {
            return None;
        }
        if self.specular.is_none() && self.coat.is_none() {
            return (self.diffuse != Vec3::ZERO).then_some(View {
                bsdf: self,
                o,
                below: 1.0,
                parts: Parts::default(),
                left: Vec3::ONE,
                pick: [0.0, 0.0, 1.0],
            });
        }
        self.layers_seen_from(o)
    }

    fn layers_seen_from(&self, o: Vec3) -> Option<View<'_>> {
        let below = self.coat.as_ref().map_or(1.0, |coat| coat.below(o.z));
        let (parts, once, left) = match &self.specular {
            None => (Parts::default(), Vec3::ZERO, Vec3::ONE),
            Some(specular) => {
                let parts = specular.row.towards(o.z);
                let once = parts.of(specular.f0, specular.f90);
                (parts, once, specular.left(parts))
            }
        };
        // The cosine lobe serves the base and light that met several facets.
        let again = Vec3::ONE - left - once;
        let weights = [
            1.0 - below,
            below * mean(once),
            below * mean(again.max(Vec3::ZERO) + self.diffuse * left),
        ];
        let sum: f32 = weights.iter().sum();
        (sum > 0.0).then(|| View {
            bsdf: self,
            o,
            below,
            parts,
            left,
            pick: weights.map(|w| w / sum),
        })
    }
}

impl View<'_> {
    /// Chooses a direction, with `u` in 0..1; `None` where the choice falls below the surface.
    #[inline]
    pub fn sample(&self, u: [f32; 3]) -> Option<BsdfSample> {
        let [coat, specular, _] = self.pick;
        let o = self.o;
        let at = [u[1], u[2]];
        let mirrored = |ggx: &Ggx| {
            let h = ggx.sample_visible(o, at);
            2.0 * o.dot(h) * h - o
        };
        let i = match (&self.bsdf.coat, &self.bsdf.specular) {
            (Some(layer), _) if u[0] < coat => mirrored(&layer.ggx),
            (_, Some(layer)) if u[0] < coat + specular => mirrored(&layer.ggx),
            _ => {
                let p = concentric_disk(at);
                p.extend((1.0 - p.length_squared()).max(0.0).sqrt())
            }
        };
        let wi = self.bsdf.frame.world_from_local(i).normalize();
        let value = self.eval_at(i, wi);
        (value.pdf > 0.0).then(|| BsdfSample {
            wi,
            value: value.total(),
            pdf: value.pdf,
        })
    }

    /// The directional albedo: what comes back to the viewer from a white sky. In 0..1.
    pub fn albedo(&self) -> Vec3 {
        let base = Vec3::ONE - self.left * (Vec3::ONE - self.bsdf.diffuse);
        let coat = 1.0 - self.below;
        (Vec3::splat(coat) + self.below * base).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// As [`Bsdf::eval_all`], towards this viewer.
    #[inline]
    pub fn eval(&self, wi: Vec3) -> BsdfValue {
        self.eval_at(self.bsdf.frame.local_from_world(wi), wi)
    }

    /// `i` is `wi` in the shading frame.
    #[inline]
    fn eval_at(&self, i: Vec3, wi: Vec3) -> BsdfValue {
        let bsdf = self.bsdf;
        if i.z <= 0.0 || wi.dot(bsdf.geometric) <= 0.0 {
            return BsdfValue::default();
        }
        if bsdf.specular.is_none() && bsdf.coat.is_none() {
            self.cosine_lobe(i)
        } else {
            self.with_layers(i)
        }
    }

    /// The base without layers, lit from `i` in the shading frame.
    #[inline]
    fn cosine_lobe(&self, i: Vec3) -> BsdfValue {
        let cosine = i.z * FRAC_1_PI;
        BsdfValue {
            diffuse: self.bsdf.diffuse * cosine,
            specular: Vec3::ZERO,
            pdf: self.pick[2] * cosine,
        }
    }

    /// The layers over the cosine lobe, lit from `i` in the shading frame.
    fn with_layers(&self, i: Vec3) -> BsdfValue {
        let o = self.o;
        let [pick_coat, pick_specular, _] = self.pick;
        let BsdfValue {
            mut diffuse,
            mut specular,
            mut pdf,
        } = self.cosine_lobe(i);
        let cosine = i.z * FRAC_1_PI;
        let h = (o + i).normalize();
        let edge = schlick(o.dot(h));
        if let Some(layer) = &self.bsdf.specular {
            let parts = layer.row.towards(i.z);
            let fresnel = layer.f0 * (1.0 - edge) + Vec3::splat(layer.f90 * edge);
            specular = fresnel * (layer.ggx.d(h) * layer.ggx.visibility(o, i) * i.z);
            let lost = (1.0 - self.parts.white()).max(0.0) * (1.0 - parts.white()).max(0.0);
            specular += layer.again * (lost * layer.again_norm * cosine);
            diffuse *= self.left * layer.left(parts) * layer.base_norm;
            pdf += pick_specular * layer.ggx.pdf(o, h);
        }
        if let Some(layer) = &self.bsdf.coat {
            let through = self.below.min(layer.below(i.z));
            diffuse *= through;
            specular *= through;
            let fresnel = layer.amount * (COAT_F0 * (1.0 - edge) + edge);
            specular += Vec3::splat(fresnel * layer.ggx.d(h) * layer.ggx.visibility(o, i) * i.z);
            pdf += pick_coat * layer.ggx.pdf(o, h);
        }
        BsdfValue {
            diffuse,
            specular,
            pdf,
        }
    }
}

impl Specular {
    fn new(roughness: f32, f0: Vec3, f90: f32) -> Self {
        // Below this nothing is lost worth giving back, and the quotients would be noise.
        const SMALL: f32 = 1e-4;
        let row = Row::at(roughness);
        let average = row.average();
        let lost = (1.0 - average.white()).max(SMALL);
        // Schlick's mean over the hemisphere.
        let mean_f = f0 + (Vec3::splat(f90) - f0) / 21.0;
        // Out of the facets after two bounces, three, …: their sum. White: 1.
        let again = mean_f * mean_f * (1.0 - lost) / (Vec3::ONE - mean_f * lost);
        let mean_albedo = average.of(f0, f90) + again * lost;
        Self {
            ggx: Ggx::from_roughness(roughness),
            row,
            f0,
            f90,
            again,
            again_norm: 1.0 / lost,
            base_norm: (Vec3::ONE - mean_albedo).max(Vec3::splat(SMALL)).recip(),
        }
    }

    /// 1 - the layer's albedo, several bounces included, where `parts` is that of the first.
    #[inline]
    fn left(&self, parts: Parts) -> Vec3 {
        let lost = (1.0 - parts.white()).max(0.0);
        (Vec3::ONE - parts.of(self.f0, self.f90) - self.again * lost).max(Vec3::ZERO)
    }
}

impl Coat {
    /// 1 - the coat's albedo.
    #[inline]
    fn below(&self, cos: f32) -> f32 {
        let parts = self.row.towards(cos);
        (1.0 - self.amount * (COAT_F0 * parts.a + parts.b)).max(0.0)
    }
}

/// `normal`, turned towards the viewer until `wo` is at least a degree above its horizon. Interpolated and
/// mapped normals may face away from a viewer who sees the surface; without this such places are black.
pub fn bent_towards(normal: Vec3, wo: Vec3) -> Vec3 {
    const LEAST: f32 = 0.02;
    let cos = normal.dot(wo);
    if cos >= LEAST {
        return normal;
    }
    // The part of the normal across the view keeps its direction.
    (normal - cos * wo)
        .try_normalize()
        .map_or(wo, |across| {
            LEAST * wo + (1.0 - LEAST * LEAST).sqrt() * across
        })
        .normalize()
}

fn mean(v: Vec3) -> f32 {
    (v.x + v.y + v.z) / 3.0
}

fn clean_one(x: f32) -> f32 {
    // A NaN compares as less and becomes 0.
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

fn clean(v: Vec3) -> Vec3 {
    Vec3::new(clean_one(v.x), clean_one(v.y), clean_one(v.z))
}

#[cfg(test)]
mod tests;
