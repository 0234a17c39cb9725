//! George Chaikin, *An Algorithm for High-Speed Curve Generation*, 1974: corners of a polyline are cut off, again and
//! again, at a quarter and three quarters of each segment. Riesenfeld (*On Chaikin's Algorithm*, 1975) saw that the
//! limit is the uniform quadratic B-spline with the polyline's points as its control points.
//!
//! The paper's curve starts at the middle of the first segment. Ours reaches both ends of an open polyline: the end
//! point stays, and between it and the middle of its segment the curve is straight. That is the B-spline with the
//! mirror image of the second point before the first, and the rule by which Doo-Sabin surfaces end at their borders.

use crate::error::Fault;
use crate::math::{DVec3, Vec3};
use crate::mesh::Polyline;

/// Cuts the corners `levels` times.
///
/// # Errors
/// A polyline that is not valid, or a result of more points than 32 bits can number.
pub fn refine(polyline: &Polyline, levels: u32) -> Result<Polyline, Fault> {
    polyline.validate()?;
    let mut fine = polyline.clone();
    for level in 0..levels {
        if fine.points.len() as u64 * 2 > u64::from(u32::MAX) {
            return Err(Fault::new(format!(
                "level {level} has {} points: the next one cannot be numbered with 32 bits",
                fine.points.len()
            ))
            .advise(format!("refine to level {level} at most")));
        }
        fine.points = cut(&fine);
    }
    Ok(fine)
}

fn cut(polyline: &Polyline) -> Vec<Vec3> {
    let points = &polyline.points;
    let mut cut = Vec::with_capacity(2 * points.len() + 2);
    if !polyline.closed {
        cut.extend(points.first());
    }
    for i in 0..polyline.segments() {
        let [a, b] = [i, (i + 1) % points.len()].map(|i| points[i].as_dvec3());
        cut.extend([a.lerp(b, 0.25), a.lerp(b, 0.75)].map(|p| p.as_vec3()));
    }
    if !polyline.closed {
        cut.extend(points.last());
    }
    cut
}

/// The limit and its first derivative at `t`, from 0 at the first point by one for each segment. Beyond the ends of an
/// open curve it is that of the nearest end; a closed one goes around.
///
/// # Errors
/// A polyline that is not valid.
pub fn limit(polyline: &Polyline, t: f64) -> Result<(DVec3, DVec3), Fault> {
    polyline.validate()?;
    let segments = polyline.segments() as f64;
    let t = match polyline.closed {
        true => t.rem_euclid(segments),
        false => t.clamp(0.0, segments),
    };
    // The piece that belongs to point i runs from i - 1/2 to i + 1/2.
    let i = (t + 0.5).floor();
    let x = t + 0.5 - i;
    let [a, b, c] = [-1, 0, 1].map(|side| control_point(polyline, i as i64 + side));
    let position = (a * (1.0 - x).powi(2) + b * (1.0 + 2.0 * x * (1.0 - x)) + c * x * x) / 2.0;
    let derivative = (b - a).lerp(c - b, x);
    Ok((position, derivative))
}

/// Control point `i`, from -1 to one past the last.
fn control_point(polyline: &Polyline, i: i64) -> DVec3 {
    let count = polyline.points.len() as i64;
    let point = |i: i64| polyline.points[i as usize].as_dvec3();
    if polyline.closed {
        point(i.rem_euclid(count))
    } else if i < 0 {
        2.0 * point(0) - point(1)
    } else if i >= count {
        2.0 * point(count - 1) - point(count - 2)
    } else {
        point(i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The quadratic B-spline over integer knots by de Boor's algorithm; control point i has its middle at t = i.
    fn de_boor(points: &[DVec3], t: f64) -> DVec3 {
        let knot = |j: i64| j as f64 - 1.5;
        let k = ((t + 1.5).floor() as i64).clamp(2, points.len() as i64 - 1);
        let mut d = [k - 2, k - 1, k].map(|i| points[i as usize]);
        for r in 1..=2 {
            for j in (r..=2).rev() {
                let i = j + k - 2;
                let (low, high) = (knot(i), knot(i + 3 - r));
                d[j as usize] = d[j as usize - 1].lerp(d[j as usize], (t - low) / (high - low));
            }
        }
        d[2]
    }

    fn points(least: usize) -> impl Strategy<Value = Vec<Vec3>> {
        let point = [-9.0_f32..9.0, -9.0..9.0, -9.0..9.0].prop_map(Vec3::from_array);
        prop::collection::vec(point, least..9)
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

        #[test]
        fn the_limit_is_the_quadratic_b_spline(points in points(3), closed: bool, at in 0.0..1.0) {
            let polyline = Polyline { points: points.clone(), closed };
            let n = points.len();
            // One more point on each side, and for de Boor's algorithm t moves by as much.
            let control: Vec<DVec3> = (-1..=n as i64).map(|i| control_point(&polyline, i)).collect();
            let t = at * (n as f64 - 1.0);
            let expected = de_boor(&control, t + 1.0);
            let (position, derivative) = limit(&polyline, t).expect("valid");
            prop_assert!(position.distance(expected) < 1e-9, "{position} {expected}");
            let step = 1e-6;
            let ahead = limit(&polyline, t + step).expect("valid").0;
            prop_assert!(t + step > n as f64 - 1.0 && !closed
                || ((ahead - position) / step).distance(derivative) < 1e-3);
        }

        #[test]
        fn middles_of_cut_segments_are_on_the_limit(points in points(3), closed: bool) {
            let polyline = Polyline { points, closed };
            let fine = refine(&polyline, 1).expect("valid");
            if !closed {
                prop_assert_eq!(fine.points.first(), polyline.points.first());
                prop_assert_eq!(fine.points.last(), polyline.points.last());
            }
            // Without the end point, two for each segment, at 1/4 and 3/4 of it.
            let cuts = &fine.points[usize::from(!closed)..fine.points.len() - usize::from(!closed)];
            for (i, pair) in cuts.windows(2).enumerate() {
                let middle = (pair[0].as_dvec3() + pair[1].as_dvec3()) / 2.0;
                let t = 0.5 * (i as f64 + 1.0);
                let on_limit = limit(&polyline, t).expect("valid").0;
                prop_assert!(middle.distance(on_limit) < 1e-5, "{t}: {middle} {on_limit}");
                let finer = limit(&fine, i as f64 + 0.5 + f64::from(u8::from(!closed))).expect("valid").0;
                prop_assert!(finer.distance(on_limit) < 1e-5, "{t}: {finer} {on_limit}");
            }
        }

        #[test]
        fn affine_maps_go_through(points in points(2)) {
            let shift = Vec3::new(3.0, -2.0, 8.0);
            let map = |p: &Vec3| Vec3::new(p.y - 0.5 * p.x, p.z, 2.0 * p.x) + shift;
            let polyline = Polyline { points: points.clone(), closed: false };
            let moved = Polyline { points: points.iter().map(map).collect(), closed: false };
            let first = refine(&polyline, 4).expect("valid");
            let second = refine(&moved, 4).expect("valid");
            for (p, q) in first.points.iter().zip(&second.points) {
                prop_assert!(map(p).distance(*q) < 1e-4);
            }
        }
    }

    #[test]
    fn too_few_points_are_a_fault() {
        let polyline = Polyline {
            points: vec![Vec3::ZERO; 2],
            closed: true,
        };
        let fault = refine(&polyline, 1).expect_err("two points");
        assert!(fault.to_string().contains("closed polyline of 2 points"));
    }
}
