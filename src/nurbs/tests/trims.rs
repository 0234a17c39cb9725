//! Trims: what is kept, and covers of rectangles.

use std::f64::consts::PI;

use super::{CIRCLE, CIRCLE_KNOTS, direction, grid};
use crate::math::{DVec2, Vec3};
use crate::mesh::{NurbsPatch, TrimCurve};
use crate::nurbs::{Cover, Trim};

/// A circle in the parameter plane, its arcs turned by `turn`; homogeneous points.
pub(crate) fn circle(centre: [f64; 2], radius: f64, clockwise: bool) -> TrimCurve {
    let mut points: Vec<[f64; 3]> = CIRCLE
        .iter()
        .map(|([x, y], w)| {
            let at = |c: f64, x: f32| w * (c + radius * f64::from(x));
            [at(centre[0], *x), at(centre[1], *y), *w]
        })
        .collect();
    if clockwise {
        points.reverse();
    }
    TrimCurve {
        order: 3,
        knots: CIRCLE_KNOTS.to_vec(),
        range: [0.0, 4.0],
        points,
    }
}

/// A flat patch over the unit square, with trims.
fn flat(trims: Vec<Vec<TrimCurve>>) -> NurbsPatch {
    NurbsPatch {
        u: direction(2, &[0.0, 0.0, 1.0, 1.0]),
        v: direction(2, &[0.0, 0.0, 1.0, 1.0]),
        points: vec![vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)]],
        trims,
        ..NurbsPatch::default()
    }
}

#[test]
fn odd_winding_decides() {
    let outer = circle([0.5, 0.5], 0.4, false);
    // Orientation does not matter, nor does the order of the loops.
    for clockwise in [false, true] {
        let patch = flat(vec![
            vec![circle([0.5, 0.5], 0.2, clockwise)],
            vec![outer.clone()],
            vec![circle([0.5, 0.5], 0.1, true)],
        ]);
        assert_eq!(patch.validate(), Ok(()));
        let trim = Trim::new(&patch);
        assert!(trim.gap() < 1e-15);
        for [u, v] in grid(200) {
            let r = (u - 0.5).hypot(v - 0.5);
            let expected = r < 0.1 || (0.2..0.4).contains(&r);
            let near = [0.1, 0.2, 0.4].iter().any(|c| (r - c).abs() < 1e-12);
            assert!(near || trim.is_inside([u, v]) == expected, "{u} {v}");
        }
    }
    assert!(Trim::new(&flat(Vec::new())).is_inside([0.3, 2.0]));
}

#[test]
fn covers_are_certain() {
    let trim = Trim::new(&flat(vec![vec![circle([0.5, 0.5], 0.4, false)]]));
    let mut counts = [0; 3];
    for [u, v] in grid(40) {
        let (low, high) = ([u, v], [u + 0.025, v + 0.025]);
        let distances =
            [[u, v], [high[0], v], [u, high[1]], high].map(|[u, v]| (u - 0.5).hypot(v - 0.5));
        let nearest = [0, 1]
            .map(|a| (0.5_f64.clamp(low[a], high[a]) - 0.5).abs())
            .into_iter()
            .fold(0.0, f64::hypot);
        let farthest = distances.into_iter().fold(0.0, f64::max);
        match trim.cover(low, high) {
            Cover::Inside => {
                counts[0] += 1;
                assert!(farthest <= 0.4, "{u} {v}");
            }
            Cover::Outside => {
                counts[1] += 1;
                assert!(nearest >= 0.4, "{u} {v}");
            }
            Cover::Crossed => {
                counts[2] += 1;
                assert!(nearest <= 0.4 + 1e-9 && farthest >= 0.4 - 1e-9, "{u} {v}");
            }
        }
    }
    assert!(counts.iter().all(|n| *n > 50), "{counts:?}");
}

#[test]
fn what_is_kept_of_a_trimmed_disc_has_its_area() {
    let trim = Trim::new(&flat(vec![
        vec![circle([0.5, 0.5], 0.4, false)],
        vec![circle([0.45, 0.52], 0.2, false)],
        // Reaches out of the patch, over a corner.
        vec![circle([1.0, 1.0], 0.08, false)],
    ]));
    let exact = PI * (0.16 - 0.04 + 0.25 * 0.08 * 0.08);
    let n = 400;
    let kept = (0..n * n)
        .filter(|i| {
            let at = |k: usize| (k as f64 + 0.5) / n as f64;
            trim.is_inside([at(i % n), at(i / n)])
        })
        .count();
    let area = kept as f64 / (n * n) as f64;
    assert!((area - exact).abs() < 1e-3, "{area} {exact}");
}

#[test]
fn a_loop_along_the_border_keeps_all_but_its_hole() {
    let square = TrimCurve {
        order: 2,
        knots: vec![0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 4.0],
        range: [0.0, 4.0],
        points: vec![
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, 1.0, 1.0],
            [0.0, 0.0, 1.0],
        ],
    };
    let trim = Trim::new(&flat(vec![
        vec![square],
        vec![circle([0.5, 0.5], 0.25, true)],
    ]));
    assert!(trim.is_inside([0.1, 0.1]) && !trim.is_inside([0.5, 0.4]));
    for uv in grid(23) {
        let from_middle = DVec2::from(uv).distance(DVec2::splat(0.5));
        let within = uv.iter().all(|t| (1e-9..=1.0 - 1e-9).contains(t));
        if within && (from_middle - 0.25).abs() > 1e-9 {
            assert_eq!(trim.is_inside(uv), from_middle > 0.25, "{uv:?}");
        }
    }
}

#[test]
fn an_open_loop_is_closed_by_a_straight_piece() {
    let mut half = circle([0.5, 0.5], 0.4, false);
    half.range = [0.0, 1.5];
    let trim = Trim::new(&flat(vec![vec![half]]));
    assert!(trim.gap() > 0.1);
    assert!(trim.is_inside([0.6, 0.8]) && !trim.is_inside([0.5, 0.3]));
}
