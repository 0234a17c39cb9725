//! Doo-Sabin against the biquadratic B-spline, and its limit against itself one level deeper.

use proptest::prelude::*;

use super::classic::{SchemeKind, refine};
use super::classic_tests::{bipyramid, mesh, soup};
use super::doo_sabin_limit::{DooSabinSurface, Sample};
use crate::math::{DVec3, Vec3};
use crate::mesh::{BoundaryInterpolation, ControlMesh, Interpolation, Primvar};

const SIZE: u32 = 5;

/// SIZE x SIZE points over the integers, as quads.
fn grid() -> ControlMesh {
    let mut points = Vec::new();
    let mut faces = Vec::new();
    for j in 0..SIZE {
        for i in 0..SIZE {
            let height = (i * i + 3 * j + i * j * j) % 7;
            points.push(Vec3::new(
                i as f32,
                j as f32 + 0.2 * (i % 2) as f32,
                height as f32,
            ));
            if i + 1 < SIZE && j + 1 < SIZE {
                let v = j * SIZE + i;
                faces.push(vec![v, v + 1, v + SIZE + 1, v + SIZE]);
            }
        }
    }
    mesh(points, &faces)
}

/// Inserts knot `t` into a quadratic B-spline (Boehm 1980).
fn insert(knots: &mut Vec<f64>, points: &mut Vec<DVec3>, t: f64) {
    let k = knots.iter().rposition(|&x| x <= t).expect("inside");
    let mut fine = points[..k - 1].to_vec();
    for i in k - 1..=k {
        let a = (t - knots[i]) / (knots[i + 2] - knots[i]);
        fine.push(points[i - 1].lerp(points[i], a));
    }
    fine.extend(&points[k..]);
    *points = fine;
    knots.insert(k + 1, t);
}

/// The points of a row after one knot in the middle of each interval; those that all old knots matter to.
fn inserted(row: &[DVec3]) -> Vec<DVec3> {
    let mut points = row.to_vec();
    let mut knots: Vec<f64> = (0..row.len() + 3).map(|i| i as f64).collect();
    for i in 2..row.len() {
        insert(&mut knots, &mut points, i as f64 + 0.5);
    }
    // At either end a point depends on intervals that were not divided.
    points[1..points.len() - 1].to_vec()
}

#[test]
fn regular_parts_are_a_b_spline_with_more_knots() {
    let cage = grid();
    let n = SIZE as usize;
    let rows: Vec<Vec<DVec3>> = (0..n)
        .map(|j| {
            let row: Vec<DVec3> = (0..n)
                .map(|i| cage.points[0][j * n + i].as_dvec3())
                .collect();
            inserted(&row)
        })
        .collect();
    let columns: Vec<Vec<DVec3>> = (0..rows[0].len())
        .map(|i| inserted(&rows.iter().map(|r| r[i]).collect::<Vec<_>>()))
        .collect();
    let fine = refine(&cage, SchemeKind::DooSabin, 1).expect("valid").mesh;
    let corners = cage.face_vertex_indices.len();
    let mut found = 0;
    for p in columns.iter().flatten() {
        let near = |q: &&Vec3| q.as_dvec3().distance(*p) < 1e-5;
        found += usize::from(fine.points[0][..corners].iter().any(|q| near(&q)));
    }
    assert_eq!(found, columns.len() * columns[0].len());
    assert!(found >= 36);
}

/// The uniform biquadratic B-spline over the grid, with mirrored points beyond it, by the basis' pieces.
fn spline(cage: &ControlMesh, x: f64, y: f64) -> DVec3 {
    let n = SIZE as i64;
    let bump = |t: f64| match t.abs() {
        a if a <= 0.5 => 0.75 - a * a,
        a if a <= 1.5 => 0.5 * (1.5 - a) * (1.5 - a),
        _ => 0.0,
    };
    // A point beyond is twice the last one minus the one before.
    let ways = |i: i64| match i {
        -1 => [(0, 2.0), (1, -1.0)],
        i if i == n => [(n - 1, 2.0), (n - 2, -1.0)],
        i => [(i, 1.0), (i, 0.0)],
    };
    let mut sum = DVec3::ZERO;
    for j in -1..=n {
        for i in -1..=n {
            for (column, a) in ways(i) {
                for (row, b) in ways(j) {
                    let p = cage.points[0][(row * n + column) as usize].as_dvec3();
                    sum += p * (a * b * bump(x - i as f64) * bump(y - j as f64));
                }
            }
        }
    }
    sum
}

const PLACES: [f64; 6] = [0.0, 0.11, 0.25, 0.5, 0.83, 1.0];

#[test]
fn regular_patches_are_biquadratic_up_to_the_border() {
    let cage = grid();
    let surface = DooSabinSurface::new(&cage).expect("valid");
    let corner_points = cage.face_vertex_indices.len();
    let fine = &surface.cage().mesh;
    assert_eq!(surface.patch_count(), fine.point_count());
    // Across the border, a point's own quadratic runs from 1/8 to 1/2 of the face.
    let across = |t: f64| 0.125 + 0.25 * t + 0.125 * t * t;
    for patch in 0..corner_points {
        let face = patch / 4;
        let (i, j) = (face % (SIZE as usize - 1), face / (SIZE as usize - 1));
        let (at, along, back) = match patch % 4 {
            0 => ([0, 0], [1.0, 0.0], [0.0, 1.0]),
            1 => ([1, 0], [0.0, 1.0], [-1.0, 0.0]),
            2 => ([1, 1], [-1.0, 0.0], [0.0, -1.0]),
            _ => ([0, 1], [0.0, -1.0], [1.0, 0.0]),
        };
        let vertex = [i + at[0], j + at[1]];
        let is_border = |k: usize| vertex[k] == 0 || vertex[k] == SIZE as usize - 1;
        for u in PLACES {
            for v in PLACES {
                let place = [0, 1].map(|k| {
                    let inward: f64 = along[k] + back[k];
                    let t = (u * along[k] + v * back[k]).abs();
                    let reach = if is_border(k) { across(t) } else { t / 2.0 };
                    vertex[k] as f64 + inward * reach
                });
                let expected = spline(&cage, place[0], place[1]);
                let found = surface.evaluate(0, patch, u, v).expect("surface").position;
                assert!(
                    found.distance(expected) < 1e-5,
                    "{patch} {u} {v}: {found} {expected}"
                );
            }
        }
    }
    // Border points: the strips of the lower border, and its corner.
    for patch in corner_points..surface.patch_count() {
        let p = fine.points[0][surface.patch_point(patch) as usize];
        if p.y > 0.21 {
            continue;
        }
        for u in PLACES {
            for v in PLACES {
                let along = match p.x {
                    0.0 => u / 8.0,
                    x if x < 0.3 => across(u),
                    x if x > SIZE as f32 - 1.1 => continue,
                    x if x > SIZE as f32 - 1.5 => SIZE as f64 - 1.0 - across(1.0 - u),
                    x => (f64::from(x) * 2.0).floor() / 2.0 + u / 2.0,
                };
                let expected = spline(&cage, along, v / 8.0);
                let found = surface.evaluate(0, patch, u, v).expect("surface").position;
                assert!(
                    found.distance(expected) < 1e-5,
                    "{p} {u} {v}: {found} {expected}"
                );
            }
        }
    }
}

/// Where the child in quadrant `j` has its (u, v) in the parent.
fn in_parent(j: usize, u: f64, v: f64) -> [f64; 2] {
    let (x, y) = [(-u, -v), (v, -u), (u, v), (-v, u)][j];
    [0.5 + 0.5 * x, 0.5 + 0.5 * y]
}

/// The limit of a mesh equals that of its refinement, patch by patch.
fn compare_levels(cage: &ControlMesh) -> Result<usize, TestCaseError> {
    let surface = DooSabinSurface::new(cage).expect("valid");
    let finer = DooSabinSurface::new(&surface.cage().mesh).expect("valid");
    let mut patches = vec![None; finer.cage().mesh.point_count()];
    for patch in 0..finer.patch_count() {
        patches[finer.patch_point(patch) as usize] = Some(patch);
    }
    let mut compared = 0;
    for (patch, fan) in surface.patches.iter().enumerate() {
        if !fan.closed {
            continue;
        }
        let t = &surface.topology;
        let first = (0..4)
            .max_by_key(|&i| t.face(fan.corners[i]))
            .expect("four");
        for j in 0..4 {
            let child = patches[fan.corners[(first + j) % 4] as usize].expect("a patch");
            for u in [0.0, 0.3, 0.75, 0.999, 1.0] {
                for v in [0.0, 0.4, 0.6, 0.998, 1.0] {
                    let [x, y] = in_parent(j, u, v);
                    let coarse = surface.evaluate(0, patch, x, y).expect("inside");
                    let fine = finer.evaluate(0, child, u, v).expect("inside");
                    prop_assert!(
                        coarse.position.distance(fine.position) < 1e-4,
                        "patch {patch} child {j} at {u} {v}: {} {}",
                        coarse.position,
                        fine.position
                    );
                    compared += 1;
                }
            }
        }
    }
    Ok(compared)
}

/// Derivatives against differences, and the surface's parts against their neighbours, for each patch.
fn check_derivatives(surface: &DooSabinSurface) -> Result<(), TestCaseError> {
    for patch in 0..surface.patch_count() {
        for (u, v) in [
            (0.3, 0.1),
            (0.71, 0.62),
            (0.02, 0.01),
            (0.9, 0.2),
            (0.26, 0.3),
        ] {
            let Some(at) = surface.evaluate(0, patch, u, v) else {
                continue;
            };
            let step = 1e-6;
            let position = |u, v| surface.evaluate(0, patch, u, v).expect("inside").position;
            let du = (position(u + step, v) - position(u - step, v)) / (2.0 * step);
            let dv = (position(u, v + step) - position(u, v - step)) / (2.0 * step);
            prop_assert!(
                du.distance(at.du) < 1e-4,
                "patch {patch} {u} {v}: du {du} {}",
                at.du
            );
            prop_assert!(
                dv.distance(at.dv) < 1e-4,
                "patch {patch} {u} {v}: dv {dv} {}",
                at.dv
            );
        }
    }
    Ok(())
}

#[test]
fn around_polygons_the_limit_is_exact_at_any_depth() {
    for n in [3, 5, 6, 17, 64] {
        let cage = bipyramid(n);
        let surface = DooSabinSurface::new(&cage).expect("valid");
        assert!(compare_levels(&cage).expect("equal") > 1000);
        check_derivatives(&surface).expect("derivatives");
        for patch in 0..surface.patch_count() {
            for (u, v) in [(0.0, 0.0), (1.0, 1.0)] {
                let at = |d: f64| -> Sample {
                    let [x, y] = [u, v].map(|t| if t == 0.0 { d } else { 1.0 - d });
                    surface.evaluate(0, patch, x, y).expect("closed")
                };
                let (centre, near) = (at(0.0), at(1e-9));
                assert!(centre.position.distance(near.position) < 1e-7);
                let (a, b) = (centre.normal.expect("smooth"), near.normal.expect("smooth"));
                assert!(a.distance(b) < 1e-5, "valence {n}: {a} {b}");
                // Along the edge of the patch the derivative comes to that of the corner.
                let along = surface
                    .evaluate(0, patch, (u - 1e-9_f64).abs(), v)
                    .expect("closed");
                assert!(
                    along.du.distance(centre.du) < 1e-5,
                    "{} {}",
                    along.du,
                    centre.du
                );
            }
        }
    }
    // A pole's patch by eye: the axis.
    let surface = DooSabinSurface::new(&bipyramid(7)).expect("valid");
    let pole = surface.evaluate(0, 2, 0.0, 0.0).expect("closed");
    assert!(pole.position.truncate().length() < 1e-6);
    assert!(pole.normal.expect("smooth").distance(DVec3::Z) < 1e-6);
}

#[test]
fn borders_left_to_shrink_have_no_surface() {
    let mut cage = mesh(
        vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
        &[vec![0, 1, 2, 3]],
    );
    cage.boundary = BoundaryInterpolation::None;
    let fine = refine(&cage, SchemeKind::DooSabin, 1).expect("valid").mesh;
    assert_eq!(fine.points[0][0], Vec3::new(0.25, 0.25, 0.0));
    assert_eq!(fine.face_count(), 1);
    let surface = DooSabinSurface::new(&cage).expect("valid");
    assert_eq!(surface.evaluate(0, 0, 0.5, 0.5), None);
    // With corners that stay, the square stays.
    cage.boundary = BoundaryInterpolation::EdgeAndCorner;
    let fine = refine(&cage, SchemeKind::DooSabin, 3).expect("valid").mesh;
    for corner in &cage.points[0] {
        assert!(fine.points[0].contains(corner));
    }
}

#[test]
fn a_hole_leaves_out_its_own_part() {
    let mut cage = grid();
    cage.holes = vec![5];
    for level in 1..4 {
        let fine = refine(&cage, SchemeKind::DooSabin, level)
            .expect("valid")
            .mesh;
        assert_eq!(fine.holes.len(), ((1 << level) - 1_usize).pow(2));
        let range: Vec<_> = fine.faces().collect();
        for &h in &fine.holes {
            for &v in &fine.face_vertex_indices[range[h as usize].clone()] {
                let p = fine.points[0][v as usize];
                assert!(p.x > 1.0 && p.x < 2.0, "{p}");
            }
        }
    }
}

#[test]
fn texture_coordinates_stay_in_their_chart() {
    // Each face has a chart of its own, or each pair of rows one.
    for rows_of_chart in [0, 2] {
        let mut cage = grid();
        let chart = |face: usize| match rows_of_chart {
            0 => face,
            rows => face / (SIZE as usize - 1) / rows,
        };
        let values = (0..cage.face_vertex_indices.len()).flat_map(|c| {
            let p = cage.points[0][cage.face_vertex_indices[c] as usize];
            [10.0 * chart(c / 4) as f32 + p.x, p.y]
        });
        cage.primvars = vec![Primvar {
            name: "st".into(),
            interpolation: Interpolation::FaceVarying,
            width: 2,
            values: values.collect(),
            indices: None,
        }];
        let fine = refine(&cage, SchemeKind::DooSabin, 3).expect("valid");
        let st = &fine.mesh.primvars[0];
        for (face, range) in fine.mesh.faces().enumerate() {
            let chart = chart(fine.parent_face[face] as usize);
            for c in range {
                let s = st.get(c)[0] - 10.0 * chart as f32;
                assert!((0.0..=SIZE as f32 - 1.0).contains(&s), "face {face}: {s}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(60) })]

    #[test]
    fn any_surface_is_finite(cage in soup(6)) {
        let surface = DooSabinSurface::new(&cage).expect("valid");
        for patch in 0..surface.patch_count() {
            for (u, v) in [(0.0, 0.0), (1.0, 1.0), (0.2, 0.9), (1e-300, 0.0), (0.5, 0.5)] {
                if let Some(at) = surface.evaluate(1, patch, u, v) {
                    prop_assert!(at.position.is_finite() && at.du.is_finite() && at.dv.is_finite());
                }
            }
        }
    }

    #[test]
    fn borders_and_polygons_have_one_limit_at_all_levels(
        heights in prop::collection::vec(-1.0_f32..1.0, 25), open in 0..16_usize, joined in 0..12_usize,
    ) {
        // The grid with a face taken out and two joined to a hexagon.
        let mut cage = grid();
        for (p, z) in cage.points[0].iter_mut().zip(heights) {
            p.z = z;
        }
        let mut faces: Vec<Vec<u32>> =
            cage.faces().map(|r| cage.face_vertex_indices[r].to_vec()).collect();
        let (low, high) = (faces[joined].clone(), faces[joined + 4].clone());
        faces[joined] = vec![low[0], low[1], low[2], high[2], high[3], low[3]];
        faces.remove(joined + 4);
        faces.remove(open.min(faces.len() - 1));
        cage = mesh(cage.points[0].clone(), &faces);
        let surface = DooSabinSurface::new(&cage).expect("valid");
        compare_levels(&cage)?;
        check_derivatives(&surface)?;
        // Strips meet the patches inside: v = 1 of a border point is the middle of its faces.
        for (patch, fan) in surface.patches.iter().enumerate().filter(|p| !p.1.closed && p.1.corners.len() == 2) {
            let end = surface.evaluate(0, patch, 0.5, 1.0).expect("strip").position;
            let t = &surface.topology;
            let inside = t.vertex(t.next(fan.corners[1]));
            let neighbour = (0..surface.patch_count())
                .find(|&q| surface.patch_point(q) == inside && surface.patches[q].closed);
            let Some(neighbour) = neighbour else { continue };
            let sides = [(0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5)];
            let meets = sides.iter().any(|&(u, v)| {
                surface.evaluate(0, neighbour, u, v).expect("inside").position.distance(end) < 1e-5
            });
            prop_assert!(meets, "strip {patch}");
        }
    }
}
