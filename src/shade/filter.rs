//! Pixel filters, applied by sampling: Ernst, Stamminger and Greiner, "Filter Importance Sampling" (2006).
//! A pixel's samples are spread as its filter weighs them, and all count 1: no weights to gather, no
//! neighbours to write to, and the noise of neighbouring pixels stays independent.

use std::f64::consts::PI;

use crate::math::Vec2;

/// Steps of the tabulated inverse of half a filter's distribution. They are even in the fourth root of what
/// lies further out, because the faint tail covers a third of the radius: a sample's place is right to a
/// hundredth of a pixel.
const STEPS: usize = 256;

/// Which filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FilterKind {
    /// The pixel's own square, evenly.
    Box,
    /// A tent that reaches the neighbours' centres: radius 1 pixel.
    Triangle,
    /// The four-term window of Blackman and Harris, radius 1.5 pixels: close to a Gaussian, but ends.
    #[default]
    BlackmanHarris,
}

/// A filter that can be sampled. It is the product of the same curve along x and along y.
#[derive(Debug, Clone)]
pub struct Filter {
    kind: FilterKind,
    /// For [`FilterKind::BlackmanHarris`]: distance from the centre beyond which lies the part
    /// (i / STEPS)^4 of a half.
    inverse: Vec<f32>,
}

impl Filter {
    /// Prepares a filter.
    pub fn new(kind: FilterKind) -> Self {
        let inverse = match kind {
            FilterKind::Box | FilterKind::Triangle => Vec::new(),
            FilterKind::BlackmanHarris => (0..=STEPS)
                .map(|i| blackman_harris_inverse(1.0 - (i as f64 / STEPS as f64).powi(4)) as f32)
                .collect(),
        };
        Self { kind, inverse }
    }

    /// Which filter it is.
    pub fn kind(&self) -> FilterKind {
        self.kind
    }

    /// How far samples lie from the pixel's centre at most, along either axis; pixels.
    pub fn radius(&self) -> f32 {
        match self.kind {
            FilterKind::Box => 0.5,
            FilterKind::Triangle => 1.0,
            FilterKind::BlackmanHarris => BLACKMAN_HARRIS_RADIUS as f32,
        }
    }

    /// The offset from the pixel's centre, pixels, that belongs to `u` in 0..1. Its weight is 1.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        Vec2::new(self.along_axis(u[0]), self.along_axis(u[1]))
    }

    fn along_axis(&self, u: f32) -> f32 {
        if self.kind == FilterKind::Box {
            return u - 0.5;
        }
        // Both halves are alike: -1..1, whose magnitude is the part of a half that lies further in.
        let signed = 2.0 * u - 1.0;
        let part = signed.abs().min(1.0);
        let distance = match self.kind {
            FilterKind::Triangle => 1.0 - (1.0 - part).sqrt(),
            _ => {
                let at = (1.0 - part).sqrt().sqrt() * STEPS as f32;
                let i = (at as usize).min(STEPS - 1);
                let (a, b) = (self.inverse[i], self.inverse[i + 1]);
                a + (at - i as f32) * (b - a)
            }
        };
        distance.copysign(signed)
    }
}

impl Default for Filter {
    fn default() -> Self {
        Self::new(FilterKind::default())
    }
}

const BLACKMAN_HARRIS_RADIUS: f64 = 1.5;
/// The window's weight of cos(k pi x / radius). Harris, "On the Use of Windows for Harmonic Analysis" (1978);
/// all signs are positive because x counts from the window's middle.
const BLACKMAN_HARRIS: [f64; 4] = [0.358_75, 0.488_29, 0.141_28, 0.011_68];

/// How much of a half lies within `x` of the centre.
fn blackman_harris_part(x: f64) -> f64 {
    let [a0, a1, a2, a3] = BLACKMAN_HARRIS;
    let t = PI * x / BLACKMAN_HARRIS_RADIUS;
    (a0 * t + a1 * t.sin() + a2 / 2.0 * (2.0 * t).sin() + a3 / 3.0 * (3.0 * t).sin()) / (a0 * PI)
}

fn blackman_harris_inverse(part: f64) -> f64 {
    let (mut low, mut high) = (0.0, BLACKMAN_HARRIS_RADIUS);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if blackman_harris_part(middle) < part {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter's density at `x`, integral 1.
    fn density(kind: FilterKind, x: f64) -> f64 {
        match kind {
            FilterKind::Box => f64::from(u8::from(x.abs() < 0.5)),
            FilterKind::Triangle => (1.0 - x.abs()).max(0.0),
            FilterKind::BlackmanHarris => {
                let t = PI * x / BLACKMAN_HARRIS_RADIUS;
                let window: f64 = (0..4)
                    .map(|k| BLACKMAN_HARRIS[k] * (k as f64 * t).cos())
                    .sum();
                window / (2.0 * BLACKMAN_HARRIS_RADIUS * BLACKMAN_HARRIS[0])
            }
        }
    }

    #[test]
    fn samples_follow_the_filter() {
        for kind in [
            FilterKind::Box,
            FilterKind::Triangle,
            FilterKind::BlackmanHarris,
        ] {
            let filter = Filter::new(kind);
            const N: usize = 100_000;
            let radius = f64::from(filter.radius());
            let mut histogram = [0_usize; 30];
            for i in 0..N {
                let x = filter.sample([(i as f32 + 0.5) / N as f32, 0.5]);
                assert!(x.x.abs() <= filter.radius() && x.y.abs() < 1e-6);
                let bin = (f64::from(x.x) + radius) / (2.0 * radius) * 30.0;
                histogram[(bin as usize).min(29)] += 1;
            }
            let width = 2.0 * radius / 30.0;
            let mut total = 0.0;
            for (bin, &count) in histogram.iter().enumerate() {
                let expected: f64 = (0..64)
                    .map(|i| {
                        let x = -radius + width * (bin as f64 + (f64::from(i) + 0.5) / 64.0);
                        density(kind, x) * width / 64.0
                    })
                    .sum();
                total += expected;
                let found = count as f64 / N as f64;
                assert!(
                    (found - expected).abs() < 1e-3,
                    "{kind:?} {bin}: {found} {expected}"
                );
            }
            assert!((total - 1.0).abs() < 1e-3, "{kind:?} {total}");
        }
    }

    #[test]
    fn the_table_is_fine_enough() {
        let filter = Filter::default();
        for k in 0..20_000 {
            let u = 0.5 + 0.5 * (k as f32 / 20_000.0);
            let exact = blackman_harris_inverse(f64::from(2.0 * u - 1.0));
            let found = f64::from(filter.sample([u, u]).x);
            assert!((found - exact).abs() < 0.01, "{u}: {found} {exact}");
        }
    }

    #[test]
    fn ends_stay_inside() {
        let filter = Filter::default();
        let corner = filter.sample([0.0, 1.0]);
        assert!((corner - Vec2::new(-1.5, 1.5)).length() < 1e-6);
        assert!(corner.abs().max_element() <= filter.radius());
    }
}
