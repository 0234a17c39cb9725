//! Surfaces that are known: quadrics, seams, poles, breaks, smoothness, knot insertion.

use std::collections::HashMap;
use std::f64::consts::FRAC_1_SQRT_2;

use super::{CIRCLE, CIRCLE_KNOTS, direction, faces, grid, surface};
use crate::math::{DVec2, DVec3, Vec3};
use crate::mesh::{NurbsDirection, NurbsForm, NurbsPatch};
use crate::nurbs::{BezierFaces, EdgeUse, SurfacePoint};

/// A profile in the (r, z) half plane turned around z.
fn turned(profile: &[([f32; 2], f64)], knots: &[f64]) -> NurbsPatch {
    let mut patch = NurbsPatch {
        u: NurbsDirection {
            form: NurbsForm::Closed,
            ..direction(3, &CIRCLE_KNOTS)
        },
        v: direction(3, knots),
        ..NurbsPatch::default()
    };
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for ([r, z], w) in profile {
        for ([x, y], wc) in CIRCLE {
            points.push(Vec3::new(r * x, r * y, *z));
            weights.push(w * wc);
        }
    }
    patch.points = vec![points];
    patch.weights = Some(weights);
    patch
}

/// From the south pole to the north pole.
pub(crate) fn sphere() -> NurbsPatch {
    let profile = [
        ([0.0, -1.0], 1.0),
        ([1.0, -1.0], FRAC_1_SQRT_2),
        ([1.0, 0.0], 1.0),
        ([1.0, 1.0], FRAC_1_SQRT_2),
        ([0.0, 1.0], 1.0),
    ];
    turned(&profile, &[0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0])
}

/// Radii 2 and 0.5.
fn torus() -> NurbsPatch {
    let profile = CIRCLE.map(|([x, y], w)| ([2.0 + 0.5 * x, 0.5 * y], w));
    turned(&profile, &CIRCLE_KNOTS)
}

#[test]
fn quadrics_are_exact() {
    let (ball, ring) = (faces(&sphere()), faces(&torus()));
    assert_eq!((ball.face_count(), ring.face_count()), (8, 16));
    for uv in grid(9) {
        for face in 0..8 {
            let p = ball.evaluate(face, uv);
            assert!((p.position.length() - 1.0).abs() < 1e-14, "{p:?}");
            assert!(p.du.dot(p.position).abs() < 1e-14 * 10.0);
            // Second derivatives: |p|^2 = 1 differentiated twice.
            let mixed = p.duv.dot(p.position) + p.du.dot(p.dv);
            assert!(mixed.abs() < 1e-13, "{mixed}");
            assert!((p.duu.dot(p.position) + p.du.dot(p.du)).abs() < 1e-13);
            assert!((p.dvv.dot(p.position) + p.dv.dot(p.dv)).abs() < 1e-13);
            // Also at the poles.
            let n = ball.normal(face, uv);
            assert!(
                n.distance(p.position) < 1e-12,
                "{face} {uv:?}: {n} {}",
                p.position
            );
        }
        for face in 0..16 {
            let p = ring.evaluate(face, uv).position;
            let r = DVec2::new(p.truncate().length() - 2.0, p.z).length();
            assert!((r - 0.5).abs() < 1e-14, "{p}: {r}");
        }
    }
}

#[test]
fn seams_and_poles_have_one_identity() {
    let ring = faces(&torus());
    assert!(ring.is_closed(0) && ring.is_closed(1));
    // A closed surface of genus 1: V - E + F = 0, each edge in two faces, once each way.
    assert_eq!(
        [ring.vertex_count(), ring.edge_count(), ring.face_count()],
        [16, 32, 16]
    );
    let ball = faces(&sphere());
    assert!(ball.is_closed(0) && !ball.is_closed(1));
    // Four meridians of two arcs, the equator's four, and the four shrunk edges at each pole.
    assert_eq!([ball.vertex_count(), ball.edge_count()], [6, 8 + 4 + 8]);
    for faces in [&ring, &ball] {
        let mut uses: HashMap<u32, Vec<(usize, usize, bool)>> = HashMap::new();
        for face in 0..faces.face_count() {
            for k in 0..4 {
                let edge = faces.edge(face, k);
                assert!((edge.edge as usize) < faces.edge_count());
                let all = uses.entry(edge.edge).or_default();
                all.push((face, k, edge.reversed));
            }
        }
        for (edge, all) in uses {
            let ends = |&(face, k, reversed): &(usize, usize, bool)| {
                let [a, b] = [faces.vertex(face, k), faces.vertex(face, (k + 1) % 4)];
                if reversed { [b, a] } else { [a, b] }
            };
            let [a, b] = ends(&all[0]);
            if all.len() == 1 {
                assert_eq!(a, b, "edge {edge} is a border and not a pole");
                continue;
            }
            assert_eq!(all.len(), 2, "edge {edge}");
            assert_eq!(ends(&all[1]), [a, b]);
            assert_ne!(all[0].2, all[1].2);
            // Both faces have the same points on it, to the bit.
            for step in 0..=8 {
                let t = f64::from(step) / 8.0;
                let at = |&(face, k, _): &(usize, usize, bool)| {
                    let uv = [[t, 0.0], [1.0, t], [t, 1.0], [0.0, t]][k];
                    faces.evaluate(face, uv).position
                };
                assert_eq!(at(&all[0]), at(&all[1]));
            }
        }
    }
}

/// A cubic by quadratic patch with simple, double and triple knots, ranges that end within spans, and weights.
fn uneven() -> NurbsPatch {
    let mut u = direction(
        4,
        &[
            -1.0, 0.0, 0.0, 0.0, 0.7, 1.0, 1.0, 2.0, 2.0, 2.0, 3.5, 4.0, 4.0, 4.5, 5.0,
        ],
    );
    u.range = Some([0.2, 3.75]);
    let v = direction(3, &[0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0]);
    let wave = |i: usize, a: f64| (i as f64 * a).sin() as f32;
    let points = (0..u.count * v.count).map(|i| {
        let (x, y) = ((i % u.count) as f32, (i / u.count) as f32);
        Vec3::new(
            x + 0.3 * wave(i, 7.1),
            y + 0.3 * wave(i, 3.3),
            wave(i, 11.7),
        )
    });
    let weights = (0..u.count * v.count).map(|i| 1.0 + 0.5 * (i as f64 * 1.9).sin());
    NurbsPatch {
        points: vec![points.collect()],
        weights: Some(weights.collect()),
        u,
        v,
        ..NurbsPatch::default()
    }
}

fn apart(a: &SurfacePoint, b: &SurfacePoint) -> f64 {
    let list = |p: &SurfacePoint| [p.position, p.du, p.dv, p.duu, p.duv, p.dvv];
    list(a)
        .iter()
        .zip(list(b))
        .map(|(a, b)| a.distance(b) / (1.0 + b.length()))
        .fold(0.0, f64::max)
}

/// A face's point with derivatives by the surface's parameters.
fn in_surface_parameters(faces: &BezierFaces, face: usize, uv: [f64; 2]) -> SurfacePoint {
    let [du, dv] = faces.parameters(face).map(|[a, b]| b - a);
    let p = faces.evaluate(face, uv);
    SurfacePoint {
        position: p.position,
        du: p.du / du,
        dv: p.dv / dv,
        duu: p.duu / (du * du),
        duv: p.duv / (du * dv),
        dvv: p.dvv / (dv * dv),
    }
}

#[test]
fn pieces_are_the_surface() {
    for patch in [uneven(), sphere(), torus()] {
        let (surface, faces) = (surface(&patch), faces(&patch));
        assert_eq!(faces.face_count(), patch.face_count());
        for face in 0..faces.face_count() {
            let [u, v] = faces.parameters(face);
            for [s, t] in grid(5) {
                // Not the ends themselves, where the surface may take the next piece's derivatives.
                let [s, t] = [0.01 + 0.98 * s, 0.01 + 0.98 * t];
                let at = [u[0] + s * (u[1] - u[0]), v[0] + t * (v[1] - v[0])];
                let (found, uv) = faces.locate(at);
                assert_eq!(found, face);
                let piece = in_surface_parameters(&faces, face, uv);
                let whole = surface.evaluate(0, at);
                assert!(apart(&piece, &whole) < 1e-11, "{piece:?} {whole:?}");
            }
        }
    }
}

#[test]
fn derivatives_are_limits_of_differences() {
    let surface = surface(&uneven());
    let h = 1e-5;
    for at in [[0.5, 0.5], [0.9, 1.3], [1.5, 2.5], [3.0, 0.2], [3.7, 2.9]] {
        let p = surface.evaluate(0, at);
        let by = |a: f64, b: f64| surface.evaluate(0, [at[0] + a, at[1] + b]);
        let slope = |plus: DVec3, minus: DVec3| (plus - minus) / (2.0 * h);
        let (right, left, up, down) = (by(h, 0.0), by(-h, 0.0), by(0.0, h), by(0.0, -h));
        for (mine, theirs) in [
            (p.du, slope(right.position, left.position)),
            (p.dv, slope(up.position, down.position)),
            (p.duu, slope(right.du, left.du)),
            (p.duv, slope(up.du, down.du)),
            (p.dvv, slope(up.dv, down.dv)),
        ] {
            let error = mine.distance(theirs) / (1.0 + theirs.length());
            assert!(error < 1e-7, "{at:?}: {mine} {theirs}");
        }
    }
}

#[test]
fn pieces_join_as_smoothly_as_their_knots_say() {
    let faces = faces(&uneven());
    let [columns, _] = faces.pieces();
    let expected = [(0.7, 2), (1.0, 1), (2.0, 0), (3.5, 2)];
    for (i, (knot, smooth)) in (1..columns).zip(expected) {
        assert_eq!(faces.edge(i - 1, 1).edge, faces.edge(i, 3).edge);
        assert_eq!(faces.parameters(i)[0][0], knot);
        for k in 0..=4 {
            let t = f64::from(k) / 4.0;
            let a = in_surface_parameters(&faces, i - 1, [1.0, t]);
            let b = in_surface_parameters(&faces, i, [0.0, t]);
            assert_eq!(a.position, b.position);
            let jump = |x: DVec3, y: DVec3| x.distance(y) / (1.0 + x.length());
            assert_eq!(jump(a.du, b.du) < 1e-11, smooth >= 1, "at knot {knot}");
            assert_eq!(jump(a.duu, b.duu) < 1e-10, smooth >= 2, "at knot {knot}");
        }
    }
}

#[test]
fn a_knot_of_full_multiplicity_breaks_the_surface_unless_its_points_agree() {
    let v = direction(2, &[0.0, 0.0, 1.0, 1.0]);
    let u = direction(3, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let row = |y: f32, jump: f32| -> Vec<Vec3> {
        let xs = [0.0, 1.0, 2.0, 2.0 + jump, 3.0, 4.0];
        xs.map(|x| Vec3::new(x, y, 0.0)).to_vec()
    };
    let patch = |jump: f32| NurbsPatch {
        u: u.clone(),
        v: v.clone(),
        points: vec![[row(0.0, jump), row(1.0, jump)].concat()],
        ..NurbsPatch::default()
    };
    let (whole, broken) = (faces(&patch(0.0)), faces(&patch(0.5)));
    assert_eq!([whole.edge_count(), whole.vertex_count()], [7, 6]);
    assert_eq!([broken.edge_count(), broken.vertex_count()], [8, 8]);
    assert_ne!(broken.edge(0, 1).edge, broken.edge(1, 3).edge);
    assert_eq!(whole.edge(0, 1).edge, whole.edge(1, 3).edge);
    assert_eq!(broken.evaluate(0, [1.0, 0.0]).position.x, 2.0);
    assert_eq!(broken.evaluate(1, [0.0, 0.0]).position.x, 2.5);
}

#[test]
fn a_periodic_surface_closes_smoothly() {
    // A tube: eight points around, the first three again at the end, uniform knots.
    let around: Vec<usize> = (0..11).map(|i| i % 8).collect();
    let knots: Vec<f64> = (-3..=11).map(f64::from).collect();
    let point = |y: f32| {
        around.iter().map(move |&i| {
            let angle = i as f32 * std::f32::consts::FRAC_PI_4;
            Vec3::new(angle.cos(), y, angle.sin())
        })
    };
    let patch = NurbsPatch {
        u: NurbsDirection {
            form: NurbsForm::Periodic,
            range: Some([0.0, 8.0]),
            ..direction(4, &knots)
        },
        v: direction(2, &[0.0, 0.0, 1.0, 1.0]),
        points: vec![point(0.0).chain(point(1.0)).collect()],
        ..NurbsPatch::default()
    };
    let faces = faces(&patch);
    assert!(faces.is_closed(0));
    assert_eq!([faces.face_count(), faces.vertex_count()], [8, 16]);
    assert_eq!(
        faces.edge(7, 1),
        EdgeUse {
            edge: faces.edge(0, 3).edge,
            reversed: false
        }
    );
    let (end, start) = (faces.evaluate(7, [1.0, 0.3]), faces.evaluate(0, [0.0, 0.3]));
    assert_eq!(end.position, start.position);
    // Points in single precision repeat exactly, so the derivatives do but for rounding.
    assert!(apart(&end, &start) < 1e-14);
}

#[test]
fn inserted_knots_leave_the_surface() {
    let old = surface(&uneven());
    let new = old
        .with_knots(0, &[0.3, 0.7, 1.5, 1.5, 1.5, 3.9])
        .with_knots(1, &[0.5, 1.0]);
    assert_eq!(new.directions()[0].count, old.directions()[0].count + 6);
    for [s, t] in grid(12) {
        let at = [0.2 + 3.55 * s, 3.0 * t];
        let (a, b) = (new.evaluate(0, at), old.evaluate(0, at));
        assert!(a.position.distance(b.position) < 1e-13, "{at:?}");
    }
    // No knots, no change.
    let same = old.with_knots(0, &[]);
    let pairs = same.control_points(0).iter().zip(old.control_points(0));
    pairs.for_each(|(a, b)| assert!(a.distance(*b) < 1e-14 * a.length()));
}

/// Triangles with a shared tip: the tangent plane there is found from the derivatives.
#[test]
fn a_collapsed_edge_has_the_limit_of_its_normals() {
    let mut patch = NurbsPatch {
        u: direction(3, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        v: direction(3, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        points: vec![vec![
            Vec3::ZERO,
            Vec3::ZERO,
            Vec3::ZERO,
            Vec3::new(-1.0, 1.0, 0.0),
            Vec3::new(0.0, 1.2, 0.0),
            Vec3::new(1.0, 1.0, 0.0),
            Vec3::new(-2.0, 2.0, -1.0),
            Vec3::new(0.0, 2.4, -1.0),
            Vec3::new(2.0, 2.0, -1.0),
        ]],
        ..NurbsPatch::default()
    };
    for flipped in [false, true] {
        let faces = faces(&patch);
        assert_eq!(faces.vertex_count(), 3);
        let v = f64::from(u8::from(flipped));
        for u in [0.0, 0.3, 1.0] {
            let limit = faces.normal(0, [u, v]);
            let near = faces.normal(0, [u, (v - 1e-7).abs()]);
            assert!(limit.distance(near) < 1e-5, "{limit} {near}");
            assert!(limit.z.abs() > 0.999, "{limit}");
        }
        // The tip at v = 1.
        patch.points[0].rotate_left(3);
        patch.points[0].swap(0, 3);
        patch.points[0].swap(1, 4);
        patch.points[0].swap(2, 5);
    }
}
