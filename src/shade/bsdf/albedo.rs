//! How much a GGX lobe reflects in all: its directional albedo, tabulated.
//!
//! With Schlick's reflectance F = f0 (1 - s) + f90 s the albedo is linear in both colours, E = f0 A + f90 B
//! (Karis, "Real Shading in Unreal Engine 4", 2013, calls it the split sum), so that two tables over angle
//! and roughness serve all materials. Between the nodes they are interpolated bilinearly; the averages are
//! those of the interpolated tables, not of the true functions, so that what is taken from one layer is
//! given to the next exactly. What is left is the tables' own error: a white surface in a white sky shines
//! by at most half a percent too much, and that a third of a degree above the horizon.
//!
//! The tables depend on nothing and never change: constants that are computed at first use, in some ten
//! milliseconds, because they would be long to write down.

use std::sync::LazyLock;

use crate::math::Vec3;
use crate::shade::microfacet::{Ggx, schlick};

/// Nodes along the angle, even in the cosine's square root: the albedo turns quickly at grazing angles.
const ANGLES: usize = 32;
/// Nodes along the roughness.
const ROUGHNESSES: usize = 32;
/// Samples to a node, and the step between them: the Fibonacci numbers 15 and 13.
const SAMPLES: usize = 610;
const STEP: usize = 233;

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);

/// The albedo's two parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Parts {
    /// Multiplies the reflectance at normal incidence.
    pub a: f32,
    /// Multiplies the reflectance at grazing incidence.
    pub b: f32,
}

impl Parts {
    /// What a lobe with these reflectances reflects.
    #[inline]
    pub fn of(self, f0: Vec3, f90: f32) -> Vec3 {
        f0 * self.a + Vec3::splat(f90 * self.b)
    }

    /// What facets that absorb nothing reflect at first bounce; the rest meets further facets.
    #[inline]
    pub fn white(self) -> f32 {
        self.a + self.b
    }

    #[inline]
    fn lerp(self, other: Self, t: f32) -> Self {
        Self {
            a: self.a + t * (other.a - self.a),
            b: self.b + t * (other.b - self.b),
        }
    }
}

/// The tables at one roughness.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    tables: &'static Tables,
    index: usize,
    fraction: f32,
}

impl Row {
    /// At a roughness in 0..1.
    pub fn at(roughness: f32) -> Self {
        let at = roughness.clamp(0.0, 1.0) * (ROUGHNESSES - 1) as f32;
        let index = (at as usize).min(ROUGHNESSES - 2);
        Self {
            tables: &TABLES,
            index,
            fraction: at - index as f32,
        }
    }

    /// The albedo's parts towards the angle with this cosine.
    #[inline]
    pub fn towards(&self, cos: f32) -> Parts {
        let at = cos.clamp(0.0, 1.0).sqrt() * (ANGLES - 1) as f32;
        let i = (at as usize).min(ANGLES - 2);
        let t = at - i as f32;
        let [low, high] = [
            &self.tables.parts[self.index],
            &self.tables.parts[self.index + 1],
        ];
        low[i]
            .lerp(low[i + 1], t)
            .lerp(high[i].lerp(high[i + 1], t), self.fraction)
    }

    /// Averaged over the hemisphere, by the cosine.
    #[inline]
    pub fn average(&self) -> Parts {
        self.tables.average[self.index].lerp(self.tables.average[self.index + 1], self.fraction)
    }
}

#[derive(Debug)]
struct Tables {
    parts: [[Parts; ANGLES]; ROUGHNESSES],
    average: [Parts; ROUGHNESSES],
}

impl Tables {
    fn new() -> Self {
        let mut parts = [[Parts::default(); ANGLES]; ROUGHNESSES];
        let mut average = [Parts::default(); ROUGHNESSES];
        for (r, (row, average)) in parts.iter_mut().zip(&mut average).enumerate() {
            let ggx = Ggx::from_roughness(r as f32 / (ROUGHNESSES - 1) as f32);
            for (i, node) in row.iter_mut().enumerate() {
                // A cosine of exactly 0 has no albedo; its limit does.
                let root = (i as f32 / (ANGLES - 1) as f32).max(0.003);
                *node = integrate(ggx, root * root);
            }
            *average = averaged(row);
        }
        Self { parts, average }
    }
}

/// The albedo's parts, by the mean over visible facets on a Fibonacci lattice.
fn integrate(ggx: Ggx, cos: f32) -> Parts {
    let o = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let (mut a, mut b) = (0.0_f64, 0.0_f64);
    for k in 0..SAMPLES {
        let u = [k * STEP % SAMPLES, k].map(|n| (n as f32 + 0.5) / SAMPLES as f32);
        let h = ggx.sample_visible(o, u);
        let oh = o.dot(h);
        let i = 2.0 * oh * h - o;
        if i.z > 0.0 && oh > 0.0 {
            let lit = f64::from(ggx.lit(o, i));
            let edge = f64::from(schlick(oh));
            a += lit * (1.0 - edge);
            b += lit * edge;
        }
    }
    let n = SAMPLES as f64;
    Parts {
        a: (a / n) as f32,
        b: (b / n) as f32,
    }
}

/// The integral of 2 cos x parts d cos of the interpolated row. With x = sqrt(cos) that is 4 x³ dx over
/// pieces linear in x, integrated exactly: hat functions against x³.
fn averaged(row: &[Parts; ANGLES]) -> Parts {
    let n = (ANGLES - 1) as f64;
    let (mut a, mut b) = (0.0_f64, 0.0_f64);
    for i in 0..ANGLES - 1 {
        let (x0, x1) = (i as f64 / n, (i + 1) as f64 / n);
        // Integral of 4 x³ and of 4 x³ (x - x0) / (x1 - x0).
        let all = x1.powi(4) - x0.powi(4);
        let rising = (0.8 * (x1.powi(5) - x0.powi(5)) - x0 * all) * n;
        let falling = all - rising;
        a += falling * f64::from(row[i].a) + rising * f64::from(row[i + 1].a);
        b += falling * f64::from(row[i].b) + rising * f64::from(row[i + 1].b);
    }
    Parts {
        a: a as f32,
        b: b as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_lobe_reflects_more_than_it_gets() {
        for roughness in [0.0, 0.1, 0.33, 0.5, 0.77, 1.0] {
            let row = Row::at(roughness);
            for k in 0..=50 {
                let parts = row.towards(k as f32 / 50.0);
                assert!(parts.a >= 0.0 && parts.b >= 0.0);
                assert!(parts.white() <= 1.0 + 1e-5, "{roughness} {parts:?}");
            }
            assert!(row.average().white() <= 1.0 + 1e-5);
        }
        // A mirror loses nothing; the roughest surface loses about half (Heitz et al. 2016).
        assert!(Row::at(0.0).average().white() > 0.995);
        let rough = Row::at(1.0).towards(1.0).white();
        assert!((0.3..0.7).contains(&rough), "{rough}");
    }

    #[test]
    fn averages_are_those_of_the_interpolated_table() {
        for roughness in [0.0, 0.21, 0.6, 1.0] {
            let row = Row::at(roughness);
            let n = 20_000;
            let sum: f64 = (0..n)
                .map(|k| (f64::from(k) + 0.5) / f64::from(n))
                .map(|cos| 2.0 * cos * f64::from(row.towards(cos as f32).white()) / f64::from(n))
                .sum();
            assert!((sum - f64::from(row.average().white())).abs() < 1e-4);
        }
    }
}
