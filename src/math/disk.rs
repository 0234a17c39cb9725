//! From the unit square to the unit disk.

use super::Vec2;

/// Even on the unit disk, and near in the square is near on the disk. Shirley and Chiu, "A Low Distortion Map
/// Between Disk and Square" (1997).
///
/// By symmetry no angle is larger than an eighth of a turn, where a few terms of the series of sine and cosine are as
/// good as the library's.
#[inline]
pub fn concentric_disk(u: [f32; 2]) -> Vec2 {
    use std::f32::consts::FRAC_PI_4;
    let [a, b] = u.map(|u| 2.0 * u - 1.0);
    let is_beside = a.abs() > b.abs();
    let (radius, other) = if is_beside { (a, b) } else { (b, a) };
    if radius == 0.0 {
        return Vec2::ZERO;
    }
    let [sin, cos] = sin_cos_of_eighth(FRAC_PI_4 * (other / radius));
    let (x, y) = if is_beside { (cos, sin) } else { (sin, cos) };
    radius * Vec2::new(x, y)
}

/// For angles within π/4: the terms left out are below 4e-8.
#[inline]
fn sin_cos_of_eighth(x: f32) -> [f32; 2] {
    let x2 = x * x;
    // Each term is the one before, times the square over two numbers more of the factorial.
    let next = |below: f32, rest: f32| 1.0 - (1.0 / below) * x2 * rest;
    let sin = x * next(6.0, next(20.0, next(42.0, next(72.0, 1.0))));
    let cos = next(2.0, next(12.0, next(30.0, next(56.0, 1.0))));
    [sin, cos]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_are_sine_and_cosine() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0 * std::f32::consts::FRAC_PI_4;
            let [sin, cos] = sin_cos_of_eighth(x).map(f64::from);
            let (exact_sin, exact_cos) = f64::from(x).sin_cos();
            assert!((sin - exact_sin).abs() < 1.2e-7, "sin {x}: {sin}");
            assert!((cos - exact_cos).abs() < 1.2e-7, "cos {x}: {cos}");
        }
    }

    #[test]
    fn borders_go_to_the_circle_and_areas_stay() {
        for i in 0..=64 {
            let t = i as f32 / 64.0;
            for u in [[t, 0.0], [1.0, t], [1.0 - t, 1.0], [0.0, 1.0 - t]] {
                assert!((concentric_disk(u).length() - 1.0).abs() < 1e-6, "{u:?}");
            }
        }
        // The Jacobian is the ratio of the areas everywhere, π to 1, away from the diagonals where it jumps.
        for u in [[0.3_f32, 0.6_f32], [0.9, 0.4], [0.2, 0.45], [0.55, 0.1]] {
            const STEP: f32 = 1.0 / 256.0;
            let at = |x: f32, y: f32| concentric_disk([u[0] + x * STEP, u[1] + y * STEP]);
            let jacobian = (at(1.0, 0.0) - at(-1.0, 0.0)).perp_dot(at(0.0, 1.0) - at(0.0, -1.0))
                / (4.0 * STEP * STEP);
            assert!(
                (jacobian - std::f32::consts::PI).abs() < 2e-3,
                "{u:?}: {jacobian}"
            );
        }
    }
}
