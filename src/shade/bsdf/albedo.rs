//! How much a GGX lobe reflects in all: its directional albedo, tabulated.
//!
//! With Schlick's reflectance F = f0 (1 - s) + f90 s the albedo is linear in both colours, E = f0 A + f90 B
//! (Karis, "Real Shading in Unreal Engine 4", 2013, calls it the split sum), so that two tables over angle
//! and roughness serve all materials. Between the nodes they are interpolated bilinearly; the averages are
//! those of the interpolated tables, not of the true functions, so that what is taken from one layer is
//! given to the next exactly.
//!
//! A layer gives to the next what its table says is left. The tables are therefore upper bounds, of A + B and of
//! B and so of every E with f0 at most f90: nodes are raised by as much as the true function bulges out of the
//! cells around, by their second differences, and by the integration's own error. The sum of all
//! layers then is at most 1. The bound costs some hundredths of a percent of light, and at most half a percent
//! where a smooth surface is seen at a grazing angle.
//!
//! The tables depend on nothing and never change: constants that are computed at first use, in some hundred
//! milliseconds, because they would be long to write down.

use std::sync::LazyLock;

use crate::math::Vec3;
use crate::shade::microfacet::{Ggx, MIN_ALPHA, schlick};

/// Nodes along the angle, even in the cosine's fourth root: the albedo turns quickly where cosine and alpha are
/// alike, and alpha may be small.
const ANGLES: usize = 48;
/// Nodes along the roughness, even in alpha's sixth root: for the same reason almost in its logarithm, with a
/// little more care for rough surfaces.
const ROUGHNESSES: usize = 40;
/// Samples to a node, and the step between them: the Fibonacci numbers 17 and 15.
const SAMPLES: usize = 1597;
const STEP: usize = 610;
/// What the samples may be wrong by, and the bulge as second differences give it.
const MARGIN: f32 = 4e-4;

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
        let alpha = Ggx::from_roughness(roughness).alpha();
        let least = MIN_ALPHA.powf(1.0 / 6.0);
        let at = (alpha.powf(1.0 / 6.0) - least) / (1.0 - least) * (ROUGHNESSES - 1) as f32;
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
        let at = cos.clamp(0.0, 1.0).sqrt().sqrt() * (ANGLES - 1) as f32;
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

/// B and A + B, which are to be bounded, on all nodes.
type Nodes = [[[f32; 2]; ANGLES]; ROUGHNESSES];

impl Tables {
    fn new() -> Self {
        // Find the true values.
        let mut nodes: Nodes = [[[0.0; 2]; ANGLES]; ROUGHNESSES];
        let least = MIN_ALPHA.powf(1.0 / 6.0);
        for (r, row) in nodes.iter_mut().enumerate() {
            let root = least + (1.0 - least) * r as f32 / (ROUGHNESSES - 1) as f32;
            let ggx = Ggx::from_alpha(root.powi(6));
            for (i, node) in row.iter_mut().enumerate() {
                // A cosine of exactly 0 has no albedo; its limit does.
                let root = (i as f32 / (ANGLES - 1) as f32).max(0.06);
                *node = integrate(ggx, root.powi(4));
            }
        }

        // Raise them above what bulges out of the cells around.
        let mut parts = [[Parts::default(); ANGLES]; ROUGHNESSES];
        for (r, row) in parts.iter_mut().enumerate() {
            for (i, node) in row.iter_mut().enumerate() {
                let [b, white] = [0, 1].map(|k| {
                    let over_roughness = bulge(r, ROUGHNESSES, |r| nodes[r][i][k]);
                    let over_angle = bulge(i, ANGLES, |i| nodes[r][i][k]);
                    nodes[r][i][k] + over_roughness + over_angle + MARGIN
                });
                let white = white.max(b).min(1.0);
                let b = b.min(white);
                *node = Parts { a: white - b, b };
            }
        }
        let average = parts.each_ref().map(averaged);
        Self { parts, average }
    }
}

/// By how much a function may lie above its chords on both sides of node `at`: h² f'' / 8, at least 0, with the
/// second difference for h² f'', the largest of the node's and its neighbours'.
fn bulge(at: usize, count: usize, f: impl Fn(usize) -> f32) -> f32 {
    (at.max(2) - 1..=(at + 1).min(count - 2))
        .map(|i| (2.0 * f(i) - f(i - 1) - f(i + 1)) / 8.0)
        .fold(0.0, f32::max)
}

/// B and A + B, by the mean over visible facets on a Fibonacci lattice. One half of them mirrors the other.
fn integrate(ggx: Ggx, cos: f32) -> [f32; 2] {
    let o = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let (mut b, mut white) = (0.0_f64, 0.0_f64);
    for k in 0..SAMPLES {
        let [u, v] = [k * STEP % SAMPLES, k].map(|n| (n as f32 + 0.5) / SAMPLES as f32);
        let h = ggx.sample_visible(o, [0.5 * u, v]);
        let oh = o.dot(h);
        let i = 2.0 * oh * h - o;
        if i.z > 0.0 && oh > 0.0 {
            let lit = f64::from(ggx.lit(o, i));
            b += lit * f64::from(schlick(oh));
            white += lit;
        }
    }
    [b, white].map(|sum| (sum / SAMPLES as f64) as f32)
}

/// The integral of 2 cos x parts d cos of the interpolated row. With x⁴ = cos that is 8 x⁷ dx over pieces linear
/// in x, integrated exactly: hat functions against x⁷.
fn averaged(row: &[Parts; ANGLES]) -> Parts {
    let n = (ANGLES - 1) as f64;
    let (mut a, mut b) = (0.0_f64, 0.0_f64);
    for i in 0..ANGLES - 1 {
        let (x0, x1) = (i as f64 / n, (i + 1) as f64 / n);
        // Integral of 8 x⁷ and of 8 x⁷ (x - x0) / (x1 - x0).
        let all = x1.powi(8) - x0.powi(8);
        let rising = (8.0 / 9.0 * (x1.powi(9) - x0.powi(9)) - x0 * all) * n;
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
