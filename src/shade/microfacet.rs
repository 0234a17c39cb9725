//! The microfacet distribution GGX, isotropic, with Smith's height-correlated shadowing.
//!
//! Walter et al., "Microfacet Models for Refraction through Rough Surfaces" (2007), for the distribution;
//! Heitz, "Understanding the Masking-Shadowing Function" (2014), for G2; Dupuy and Benyoub, "Sampling Visible
//! GGX Normals with Spherical Caps" (2023), for sampling. All directions are local, unit, and point away
//! from the surface; `o` is the viewer's, `i` the light's, `h` the half vector.

use std::f32::consts::PI;

use crate::math::Vec3;

/// The smallest `alpha`. Below it a lobe is narrower than single precision can place a half vector, and a
/// sample's density overflows; it blurs a mirror by a tenth of a degree.
pub const MIN_ALPHA: f32 = 1e-3;

/// A distribution of facets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ggx {
    alpha: f32,
}

impl Ggx {
    /// From a roughness in 0..1; `alpha` is its square, at least [`MIN_ALPHA`].
    pub fn from_roughness(roughness: f32) -> Self {
        Self::from_alpha(roughness * roughness)
    }

    /// From `alpha`, the slope's scale, in [`MIN_ALPHA`]..1.
    pub fn from_alpha(alpha: f32) -> Self {
        Self {
            alpha: alpha.clamp(MIN_ALPHA, 1.0),
        }
    }

    /// The slope's scale.
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// The density D of facets with normal `h`, which must be unit: a² / (π (a² z² + x² + y²)²), the form
    /// that does not cancel where `h` is close to the surface's normal.
    #[inline]
    pub fn d(&self, h: Vec3) -> f32 {
        let a2 = self.alpha * self.alpha;
        let k = a2 * h.z * h.z + h.x * h.x + h.y * h.y;
        a2 / (PI * k * k)
    }

    /// G2 / (4 cos o cos i).
    #[inline]
    pub fn visibility(&self, o: Vec3, i: Vec3) -> f32 {
        0.5 / (i.z * self.slant(o.z) + o.z * self.slant(i.z))
    }

    /// G1 / (4 cos o) x D = the density, over solid angle, of the direction that the facets seen from `o`
    /// mirror to.
    #[inline]
    pub fn pdf(&self, o: Vec3, h: Vec3) -> f32 {
        // G1 = 2 cos / (cos + slant).
        0.5 * self.d(h) / (o.z + self.slant(o.z))
    }

    /// G2 / G1(o): a facet that is seen from `o` is lit from `i` with this probability.
    #[inline]
    pub fn lit(&self, o: Vec3, i: Vec3) -> f32 {
        let (so, si) = (self.slant(o.z), self.slant(i.z));
        i.z * (o.z + so) / (i.z * so + o.z * si)
    }

    /// sqrt(a² + (1 - a²) cos²) = cos x (1 + 2 Λ).
    #[inline]
    fn slant(&self, cos: f32) -> f32 {
        let a2 = self.alpha * self.alpha;
        (a2 + (1.0 - a2) * cos * cos).sqrt()
    }

    /// A facet seen from `o`, by projected area: unit normal, `u` in 0..1.
    #[inline]
    pub fn sample_visible(&self, o: Vec3, u: [f32; 2]) -> Vec3 {
        // Stretch to the unit hemisphere.
        let o = Vec3::new(self.alpha * o.x, self.alpha * o.y, o.z).normalize();
        // Even on the cap of directions that the hemisphere, seen from there, mirrors to.
        let (sin_phi, cos_phi) = (2.0 * PI * u[0]).sin_cos();
        let z = (1.0 - u[1]) * (1.0 + o.z) - o.z;
        let sin = (1.0 - z * z).max(0.0).sqrt();
        let h = Vec3::new(sin * cos_phi, sin * sin_phi, z) + o;
        // Back again.
        Vec3::new(self.alpha * h.x, self.alpha * h.y, h.z.max(0.0))
            .try_normalize()
            .unwrap_or(Vec3::Z)
    }
}

/// (1 - cos)^5: the weight of the edge's colour in Schlick, "An Inexpensive BRDF Model" (1994).
#[inline]
pub fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_facets_cover_the_surface_once() {
        // The integral of D cos over the hemisphere is 1; substitute tan² = a² v / (1 - v).
        for roughness in [0.2_f32, 0.5, 1.0] {
            let ggx = Ggx::from_roughness(roughness);
            let a2 = f64::from(ggx.alpha()).powi(2);
            let n = 20_000;
            let sum: f64 = (0..n)
                .map(|k| {
                    let v = (f64::from(k) + 0.5) / f64::from(n);
                    let tan2 = a2 * v / (1.0 - v);
                    let cos = (1.0 / (1.0 + tan2)).sqrt();
                    let sin = (1.0 - cos * cos).sqrt();
                    // d(cos²) = cos⁴ d(tan²); dω cos = π d(cos²).
                    let jacobian = a2 / (1.0 - v).powi(2) * cos.powi(4);
                    let h = Vec3::new(sin as f32, 0.0, cos as f32);
                    f64::from(ggx.d(h)) * std::f64::consts::PI * jacobian / f64::from(n)
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-3, "{roughness}: {sum}");
        }
    }

    #[test]
    fn forms_agree() {
        let ggx = Ggx::from_roughness(0.6);
        let o = Vec3::new(0.3, 0.2, 0.7).normalize();
        let i = Vec3::new(-0.5, 0.4, 0.5).normalize();
        let h = (o + i).normalize();
        // value / pdf = G2 / G1.
        let ratio = ggx.d(h) * ggx.visibility(o, i) * i.z / ggx.pdf(o, h);
        assert!((ratio - ggx.lit(o, i)).abs() < 1e-5);
        assert!((ggx.visibility(o, i) - ggx.visibility(i, o)).abs() < 1e-6);
    }
}
