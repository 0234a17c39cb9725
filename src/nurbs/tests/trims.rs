//! Trims: what is kept, covers of rectangles, and triangles of what is left.

use std::f64::consts::PI;

use proptest::prelude::*;

use super::{CIRCLE, CIRCLE_KNOTS, direction, grid};
use crate::math::{DVec2, Vec3};
use crate::mesh::{NurbsPatch, TrimCurve};
use crate::nurbs::{Cover, Region, Trim};

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

/// Cut into cells and triangles; the area of them all.
fn triangulated_area(region: &Region, n: usize) -> f64 {
    let mut area = 0.0;
    let mut rest = region.cut(0, 0.0)[1].cut(0, 1.0)[0].cut(1, 0.0)[1].cut(1, 1.0)[0].clone();
    for i in 1..=n {
        let [column, right] = rest.cut(0, i as f64 / n as f64);
        let mut column = column;
        for j in 1..=n {
            let [cell, above] = column.cut(1, j as f64 / n as f64);
            let (triangles, places) = cell.triangles();
            for t in triangles {
                let [a, b, c] = t.map(|k| DVec2::from(places[k as usize]));
                let twice = (b - a).perp_dot(c - a);
                assert!(twice >= 0.0);
                area += 0.5 * twice;
            }
            column = above;
        }
        rest = right;
    }
    area
}

#[test]
fn triangles_of_a_trimmed_disc_have_its_area() {
    let trim = Trim::new(&flat(vec![
        vec![circle([0.5, 0.5], 0.4, false)],
        vec![circle([0.45, 0.52], 0.2, false)],
        vec![circle([0.45, 0.52], 0.003, false)],
        // Reaches out of the patch, over a corner.
        vec![circle([1.0, 1.0], 0.08, false)],
    ]));
    let exact = PI * (0.16 - 0.04 + 0.003 * 0.003 + 0.25 * 0.08 * 0.08);
    let mut before = f64::INFINITY;
    for tolerance in [1e-3, 1e-4, 1e-5, 1e-6] {
        let region = Region::new(trim.polygons([tolerance; 2]));
        for n in [1, 2, 7, 16] {
            let area = triangulated_area(&region, n);
            // Every chord is within the tolerance of its arc.
            let length = 2.0 * PI * (0.4 + 0.2 + 0.003 + 0.08);
            let error = (area - exact).abs();
            assert!(
                error < tolerance * length,
                "{n} {tolerance}: {area} {exact}"
            );
            before = before.min(error);
        }
    }
    assert!(before < 1e-6);
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
    let region = Region::new(trim.polygons([1e-7; 2]));
    for n in [1, 4, 9] {
        let area = triangulated_area(&region, n);
        assert!((area - (1.0 - PI / 16.0)).abs() < 1e-6, "{area}");
    }
    assert!(Region::new(trim.polygons([1e-2; 2])[..1].to_vec()).fills([0.0; 2], [1.0; 2]));
}

#[test]
fn an_open_loop_is_closed_by_a_straight_piece() {
    let mut half = circle([0.5, 0.5], 0.4, false);
    half.range = [0.0, 1.5];
    let trim = Trim::new(&flat(vec![vec![half]]));
    assert!(trim.gap() > 0.1);
    assert!(trim.is_inside([0.6, 0.8]) && !trim.is_inside([0.5, 0.3]));
}

proptest! {
    #[test]
    fn any_loops_are_cut_without_losing_area(
        points in proptest::collection::vec((-0.5..1.5_f64, -0.5..1.5_f64), 3..12),
        at in 0.0..1.0_f64,
        axis in 0usize..2,
    ) {
        let polygon: Vec<[f64; 2]> = points.iter().map(|&(u, v)| [u, v]).collect();
        let region = Region::new(vec![polygon]);
        // Parity at points away from the cut is what it was.
        let inside = |region: &Region, [u, v]: [f64; 2]| {
            let mut odd = false;
            for polygon in region.polygons() {
                for i in 0..polygon.len() {
                    let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                    if (a[1] <= v) != (b[1] <= v) {
                        let t = (v - a[1]) / (b[1] - a[1]);
                        odd ^= a[0] + t * (b[0] - a[0]) > u;
                    }
                }
            }
            odd
        };
        let parts = region.cut(axis, at);
        for p in grid(23) {
            if (p[axis] - at).abs() < 1e-9 {
                continue;
            }
            let side = usize::from(p[axis] > at);
            prop_assert_eq!(inside(&parts[side], p), inside(&region, p));
            prop_assert!(!inside(&parts[1 - side], p));
        }
    }
}
