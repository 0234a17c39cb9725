//! Surfaces whose points are known in closed form.

use super::random::{cube, grid};
use super::{places, position, surface};
use crate::math::{DVec3, Vec3};
use crate::mesh::{BoundaryInterpolation, Scheme};

/// A uniform B-spline of degree 3 over control points, by de Boor's recursion on knots 0, 1, 2, …
fn de_boor(points: &[DVec3], t: f64) -> DVec3 {
    let span = (t.floor() as usize).clamp(3, points.len() - 1);
    let mut d: Vec<DVec3> = (0..4).map(|i| points[span - 3 + i]).collect();
    for r in 1..4 {
        for j in (r..4).rev() {
            let alpha = (t - (span - 3 + j) as f64) / (4 - r) as f64;
            d[j] = d[j - 1].lerp(d[j], alpha);
        }
    }
    d[3]
}

#[test]
fn regular_grids_are_bicubic_b_splines() {
    let mut mesh = grid(Scheme::CatmullClark, 6, 5);
    for (i, p) in mesh.points[0].iter_mut().enumerate() {
        let i = i as f32;
        *p += Vec3::new((1.7 * i).sin(), (2.9 * i).cos(), (i * i).sin()) * 0.3;
    }
    let (surface, points) = surface(&mesh);
    // Faces with a full ring: columns 1 to 4, rows 1 to 3.
    for y in 1..4_usize {
        for x in 1..5_usize {
            for [u, v] in places(&surface, 20) {
                let row = |j: usize| -> Vec<DVec3> {
                    (0..7)
                        .map(|i| mesh.points[0][7 * j + i].as_dvec3())
                        .collect()
                };
                // The segment of face x is the one with knots x + 2 to x + 3.
                let column: Vec<DVec3> = (0..6)
                    .map(|j| de_boor(&row(j), x as f64 + 2.0 + u))
                    .collect();
                let expected = de_boor(&column, y as f64 + 2.0 + v);
                let found = position(&surface, &points, (6 * y + x) as u32, [u, v]);
                assert!(
                    found.distance(expected) < 1e-13,
                    "face {x}, {y}: {found} for {expected}"
                );
            }
        }
    }
}

/// The box spline of a triangle lattice turns samples of a quadratic into the quadratic plus a constant, half the trace
/// of its second derivatives with the spline's covariance, ((2, 1), (1, 2)) / 6 in lattice coordinates.
#[test]
fn regular_lattices_are_quartic_box_splines() {
    let mut mesh = grid(Scheme::Loop, 6, 6);
    for p in &mut mesh.points[0] {
        p.z = p.x * p.x - 3.0 * p.x * p.y + 0.5 * p.y * p.y;
    }
    let (surface, points) = surface(&mesh);
    for y in 1..5 {
        for x in 1..5 {
            for half in 0..2 {
                let face = 2 * (6 * y + x) + half;
                for [u, v] in places(&surface, 20) {
                    let found = surface.evaluate(&points, face, u, v);
                    let [px, py, pz] = found.position;
                    let expected =
                        px * px - 3.0 * px * py + 0.5 * py * py + 1.0 / 3.0 - 0.5 + 0.5 / 3.0;
                    assert!((pz - expected).abs() < 1e-12, "{pz} for {expected}");
                    for d in [found.du, found.dv] {
                        let slope = (2.0 * px - 3.0 * py) * d[0] + (py - 3.0 * px) * d[1];
                        assert!((d[2] - slope).abs() < 1e-12, "{} for {slope}", d[2]);
                    }
                    let second = |a: [f64; 3], b: [f64; 3]| {
                        2.0 * a[0] * b[0] - 3.0 * (a[0] * b[1] + a[1] * b[0]) + a[1] * b[1]
                    };
                    for (d, expected) in [
                        (found.duu, second(found.du, found.du)),
                        (found.duv, second(found.du, found.dv)),
                        (found.dvv, second(found.dv, found.dv)),
                    ] {
                        assert!((d[2] - expected).abs() < 1e-11, "{} for {expected}", d[2]);
                    }
                }
            }
        }
    }
}

/// Halstead et al. 1993: a vertex' limit is (n² v + 4 Σ neighbours + Σ across) / (n (n + 5)).
#[test]
fn a_cubes_corners_are_where_the_eigenvectors_say() {
    let mesh = cube(Scheme::CatmullClark);
    let (surface, points) = surface(&mesh);
    // Three neighbours add up to the corner, three vertices across to minus it: (9 + 4 − 1) / 24.
    for face in 0..6 {
        for (i, &[u, v]) in super::corners(&surface).iter().enumerate() {
            let vertex = mesh.face_vertex_indices[4 * face as usize + i];
            let expected = 0.5 * mesh.points[0][vertex as usize].as_dvec3();
            let found = position(&surface, &points, face, [u, v]);
            assert!(found.distance(expected) < 1e-15, "{found}");
            // By symmetry the normal is the diagonal; du × dv looks outwards.
            let normal = surface.evaluate(&points, face, u, v).normal(u, v);
            let off = DVec3::from(normal.expect("a normal")).distance(expected.normalize());
            assert!(off < 1e-13, "{off}");
        }
    }
}

#[test]
fn borders_are_cubic_b_splines() {
    let mut mesh = grid(Scheme::CatmullClark, 5, 2);
    mesh.boundary = BoundaryInterpolation::EdgeOnly;
    for (i, p) in mesh.points[0].iter_mut().enumerate() {
        p.z = (1.3 * i as f32).sin();
    }
    let row: Vec<DVec3> = mesh.points[0][..6].iter().map(|p| p.as_dvec3()).collect();
    let (surface, points) = surface(&mesh);
    for x in 1..4 {
        for u in [0.0, 0.2, 0.7, 1.0] {
            let expected = de_boor(&row, f64::from(x) + 2.0 + u);
            let found = position(&surface, &points, x, [u, 0.0]);
            assert!(found.distance(expected) < 1e-14, "{found} for {expected}");
        }
    }
}
