//! What holds for any mesh: invariance, continuity, derivatives, and that refinement changes nothing.

use proptest::prelude::*;

use super::random::{Dice, dice, random};
use super::{SMOOTH_SCHEMES, corners, faces, places, position, size, surface};
use crate::math::{DVec3, Vec3};
use crate::mesh::{ControlMesh, Crease, CreaseMethod, FaceVaryingInterpolation, Scheme};
use crate::subdiv::{LimitPoint, LimitSurface, refine};

fn scheme(dice: u8) -> Scheme {
    [Scheme::CatmullClark, Scheme::Loop, Scheme::Bilinear][usize::from(dice) % 3]
}

/// Random faces' parameters: a few within, the corners, and places very close to them.
fn all_places(surface: &LimitSurface) -> Vec<(u32, [f64; 2])> {
    let mut uvs = places(surface, 6);
    uvs.extend(corners(surface));
    for (i, &[u, v]) in corners(surface).iter().enumerate() {
        let inwards = 0.5_f64.powi(3 + 9 * i as i32);
        uvs.push([u + (0.31 - u) * inwards, v + (0.42 - v) * inwards]);
    }
    let uvs = &uvs;
    faces(surface)
        .flat_map(|f| uvs.iter().map(move |&uv| (f, uv)))
        .collect()
}

/// A constant stays one, and a map of the points is a map of the surface.
fn is_affine(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let ones = surface.field(vec![1.0; mesh.point_count()], 1);
    // Written for any width: a value beside the points.
    let mapped = surface.field(
        mesh.points[0]
            .iter()
            .flat_map(|p| {
                let p = p.as_dvec3();
                [p.x, p.y, p.z, 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 7.0]
            })
            .collect(),
        4,
    );
    for (face, [u, v]) in all_places(&surface) {
        let mut one = [0.0];
        surface.interpolate(&ones, face, u, v, &mut one);
        prop_assert!(
            (one[0] - 1.0_f64).abs() < 1e-12,
            "weights sum to {}",
            one[0]
        );
        let mut four = [0.0; 4];
        surface.interpolate(&mapped, face, u, v, &mut four);
        let p = position(&surface, &points, face, [u, v]);
        let off = DVec3::new(four[0], four[1], four[2]).distance(p);
        prop_assert!(off < 1e-12, "evaluate and interpolate differ by {off:.2e}");
        let [row] = &surface.weights(face, &[[u, v]])[..] else {
            unreachable!("a row for a place");
        };
        prop_assert!(row.windows(2).all(|pair| pair[0].0 < pair[1].0));
        let terms = row
            .iter()
            .map(|&(vertex, w)| w * mesh.points[0][vertex as usize].as_dvec3());
        let off = terms.sum::<DVec3>().distance(p);
        prop_assert!(off < 1e-11, "the weights' sum is off by {off:.2e}");
        let expected = 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 7.0;
        prop_assert!((four[3] - expected).abs() < 1e-11);
    }
    Ok(())
}

/// Both faces at an edge have the same points there.
fn is_continuous(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let topology = mesh.topology();
    let size = size(mesh);
    // A point of the edge from a corner to the next.
    let at = |corner: u32, t: f64| -> (u32, [f64; 2]) {
        let face = topology.face(corner);
        let range = topology.corners(face);
        let (i, n) = (corner - range.start, range.len() as u32);
        let first = surface.ptex_faces(face).start;
        if surface.is_triangular() {
            (first, [[t, 0.0], [1.0 - t, t], [0.0, 1.0 - t]][i as usize])
        } else if n == 4 {
            (
                first,
                [[t, 0.0], [1.0, t], [1.0 - t, 1.0], [0.0, 1.0 - t]][i as usize],
            )
        } else if t <= 0.5 {
            (first + i, [2.0 * t, 0.0])
        } else {
            (first + (i + 1) % n, [0.0, 2.0 - 2.0 * t])
        }
    };
    for edge in 0..topology.edge_count() as u32 {
        let &[a, b] = topology.edge_corners(edge) else {
            continue;
        };
        // Exact from both ends: near some corners the surface turns fast enough to show the rounding of parameters.
        let small = 0.5_f64.powi(30);
        for t in [0.0, small, 0.125, 0.25, 0.5, 0.609_375, 1.0 - small, 1.0] {
            let sides = [at(a, t), at(b, 1.0 - t)];
            if sides.iter().any(|s| surface.is_hole(s.0)) {
                continue;
            }
            let [p, q] = sides.map(|(face, uv)| position(&surface, &points, face, uv));
            prop_assert!(
                p.distance(q) < 1e-12 * size,
                "edge {edge} {:?} at {t}, Ptex faces {sides:?}: {:.2e} apart",
                topology.edge_vertices(edge),
                p.distance(q) / size
            );
        }
    }
    Ok(())
}

/// First derivatives are those of the positions, second ones those of the first.
fn derivatives_are_differences(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let size = size(mesh);
    const H: f64 = 1e-6;
    let at = |f: u32, u: f64, v: f64| surface.evaluate(&points, f, u, v);
    let difference = |a: [f64; 3], b: [f64; 3], h: f64| (DVec3::from(b) - DVec3::from(a)) / h;
    for face in faces(&surface) {
        for [u, v] in places(&surface, 8) {
            // Away from the edges of patches, where second derivatives may jump.
            let here = at(face, u, v);
            let [left, right] = [u - H, u + H].map(|u| at(face, u, v));
            let [down, up] = [v - H, v + H].map(|v| at(face, u, v));
            for (what, found, expected, bound) in [
                (
                    "du",
                    here.du,
                    difference(left.position, right.position, 2.0 * H),
                    1e-6,
                ),
                (
                    "dv",
                    here.dv,
                    difference(down.position, up.position, 2.0 * H),
                    1e-6,
                ),
                (
                    "duu",
                    here.duu,
                    difference(left.du, right.du, 2.0 * H),
                    1e-3,
                ),
                (
                    "duv",
                    here.duv,
                    difference(left.dv, right.dv, 2.0 * H),
                    1e-3,
                ),
                ("duv", here.duv, difference(down.du, up.du, 2.0 * H), 1e-3),
                ("dvv", here.dvv, difference(down.dv, up.dv, 2.0 * H), 1e-3),
            ] {
                let off = DVec3::from(found).distance(expected) / size;
                prop_assert!(
                    off < bound,
                    "{what} of face {face} at ({u}, {v}): off by {off:.2e}"
                );
            }
        }
    }
    Ok(())
}

/// Corners are the limit of what is near them, and so are their normals.
fn corners_are_limits(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let size = size(mesh);
    let topology = mesh.topology();
    let vertices: Vec<Vec<u32>> = (0..mesh.face_count() as u32)
        .flat_map(|f| {
            let whole = topology.face_vertices(f);
            match surface.ptex_faces(f).len() {
                1 => vec![whole.to_vec()],
                _ => whole.iter().map(|&v| vec![v]).collect(),
            }
        })
        .collect();
    // Normals at smooth vertices and darts. Between two neighbours a surface folds; beside creases and corners with many
    // faces other tangents shrink more slowly than those that the masks take, and what is near approaches another
    // normal or none: Biermann et al. 2000 change the rules for that.
    let infinite = |v: u32| {
        let creases = mesh.creases.iter().filter(|c| c.vertices.contains(&v));
        creases.filter(|c| c.sharpness >= Crease::INFINITE).count()
    };
    let is_corner = |v: u32| mesh.corners.iter().any(|c| c.vertex == v);
    let has_no_plane = |face: u32, corner: usize| {
        vertices[face as usize].get(corner).is_some_and(|&v| {
            let edges = topology.vertex_edges(v);
            !(3..=6).contains(&edges.len())
                || edges.iter().any(|&e| topology.is_border(e))
                || infinite(v) > 1
                || is_corner(v)
        })
    };
    for face in faces(&surface) {
        for (corner, &[u, v]) in corners(&surface).iter().enumerate() {
            let here = surface.evaluate(&points, face, u, v);
            let near = |n: i32| {
                let t = 0.5_f64.powi(n);
                [u + (0.34 - u) * t, v + (0.32 - v) * t]
            };
            let closest = position(&surface, &points, face, near(40));
            let off = DVec3::from(here.position).distance(closest) / size;
            prop_assert!(off < 1e-6, "face {face} at ({u}, {v}): off by {off:.2e}");
            // Nearer, some borders' inward tangents, which shrink by 3/8 a level, are lost in rounding.
            let normal = |p: &LimitPoint<f64>, [u, v]: [f64; 2]| {
                let (du, dv) = (DVec3::from(p.du), DVec3::from(p.dv));
                let sine = du.cross(dv).length() / (du.length() * dv.length());
                p.normal(u, v).filter(|_| sine > 0.05).map(DVec3::from)
            };
            let normal_near = |n| {
                let place @ [a, b] = near(n);
                normal(&surface.evaluate(&points, face, a, b), place)
            };
            if !has_no_plane(face, corner)
                && let Some(limit) = normal(&here, [u, v])
                && let (Some(far), Some(close)) = (normal_near(6), normal_near(20))
            {
                // At high valences normals turn for many levels.
                let (before, off) = (limit.distance(far), limit.distance(close));
                prop_assert!(
                    off < 5e-2 || off < 0.9 * before,
                    "normal of face {face} at ({u}, {v}): off by {before:.2e}, then {off:.2e}"
                );
            }
        }
    }
    Ok(())
}

/// OpenSubdiv's masks come nearer to the limit with each level.
fn isolation_converges(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let size = size(mesh);
    for face in faces(&surface) {
        for &[u, v] in corners(&surface) {
            let here = position(&surface, &points, face, [u, v]);
            let off = |level: u32| -> Option<f64> {
                let found = surface.isolate(&points, face, u, v, level)?;
                let p = DVec3::new(found.position[0], found.position[1], found.position[2]);
                Some(p.distance(here) / size)
            };
            if let (Some(a), Some(b)) = (off(8), off(30)) {
                prop_assert!(a < 1e-2, "face {face} at ({u}, {v}): {a:.2e} at level 8");
                prop_assert!(b < 1e-7, "face {face} at ({u}, {v}): {b:.2e} at level 30");
            }
        }
    }
    Ok(())
}

/// The limit of a refined mesh is that of the mesh, its face-varying values included.
fn refinement_keeps_the_limit(mesh: &ControlMesh, levels: u32) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let refined = refine(mesh, levels);
    prop_assert!(refined.mesh.validate().is_ok());
    let fine = LimitSurface::new(&refined.mesh);
    let fine_points = fine.points::<f64>(&refined.mesh, 0);
    let st = |mesh: &ControlMesh| {
        let (surface, elements) =
            LimitSurface::face_varying(mesh, &mesh.primvars[0], mesh.face_varying);
        let values = elements
            .iter()
            .flat_map(|&e| mesh.primvars[0].element(e as usize));
        let field = surface.field(values.map(|&x| f64::from(x)).collect(), 2);
        (surface, field)
    };
    let ((coarse_st, coarse_field), (fine_st, fine_field)) = (st(mesh), st(&refined.mesh));
    // Two things about seams are settled on the mesh that is given: under Chaikin's rule a cut mesh averages the
    // sharpness of its own edges only, and semi-sharp creases that end at a seam sharpen its other side.
    let dependent = matches!(
        mesh.face_varying,
        FaceVaryingInterpolation::CornersPlus1 | FaceVaryingInterpolation::CornersPlus2
    );
    let semi_sharp = mesh.creases.iter().any(|c| c.sharpness < Crease::INFINITE);
    let same_seams = !semi_sharp || !(dependent || mesh.crease_method == CreaseMethod::Chaikin);
    let size = size(mesh);
    for face in 0..refined.mesh.face_count() as u32 {
        // Squares or triangles, one Ptex face each.
        let ptex = fine.ptex_faces(face);
        prop_assert_eq!(ptex.len(), 1);
        let place = [0, 1, 2].map(|i| refined.place(face, i));
        let last = refined
            .place(face, place.len() - 1 + usize::from(!fine.is_triangular()))
            .1;
        prop_assert_eq!(fine.is_hole(ptex.start), surface.is_hole(place[0].0));
        if fine.is_hole(ptex.start) {
            continue;
        }
        for [u, v] in [[0.0, 0.0], [0.3, 0.4], [0.5, 0.125]] {
            let [a, b, _] = place.map(|p| p.1);
            let uv = a + u * (b - a) + v * (last - a);
            let (face, at) = (place[0].0, [uv.x, uv.y]);
            let expected = position(&surface, &points, face, at);
            let found = position(&fine, &fine_points, ptex.start, [u, v]);
            let off = found.distance(expected) / size;
            // Refined points are in single precision.
            prop_assert!(off < 1e-6, "Ptex face {face} at {at:?}: off by {off:.2e}");
            if !same_seams {
                continue;
            }
            let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
            coarse_st.interpolate(&coarse_field, face, at[0], at[1], &mut a);
            fine_st.interpolate(&fine_field, ptex.start, u, v, &mut b);
            let off = (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) / size;
            prop_assert!(
                off < 1e-6,
                "{:?} of Ptex face {face} at {at:?}: off by {off:.2e}",
                mesh.face_varying
            );
        }
    }
    Ok(())
}

const RULES: [FaceVaryingInterpolation; 6] = [
    FaceVaryingInterpolation::None,
    FaceVaryingInterpolation::CornersOnly,
    FaceVaryingInterpolation::CornersPlus1,
    FaceVaryingInterpolation::CornersPlus2,
    FaceVaryingInterpolation::Boundaries,
    FaceVaryingInterpolation::All,
];

fn smooth(dice: &Dice, which: bool) -> ControlMesh {
    random(SMOOTH_SCHEMES[usize::from(which)], dice)
}

proptest! {
    #![proptest_config(super::cases(48))]

    #[test]
    fn weights_are_affine(dice in dice(), which in any::<u8>()) {
        is_affine(&random(scheme(which), &dice))?;
    }

    #[test]
    fn faces_meet(dice in dice(), which in any::<u8>()) {
        is_continuous(&random(scheme(which), &dice))?;
    }

    #[test]
    fn derivatives_are_those_of_positions(dice in dice(), which in any::<bool>()) {
        derivatives_are_differences(&smooth(&dice, which))?;
    }

    #[test]
    fn corners_are_limits_of_what_is_near(dice in dice(), which in any::<bool>()) {
        corners_are_limits(&smooth(&dice, which))?;
    }

    #[test]
    fn masks_at_a_level_converge(dice in dice(), which in any::<bool>()) {
        isolation_converges(&smooth(&dice, which))?;
    }

    #[test]
    fn refinement_does_not_move_the_limit(
        dice in dice(), which in any::<bool>(), levels in 1_u32..3, rule in 0_usize..6,
    ) {
        let mut mesh = smooth(&dice, which);
        mesh.face_varying = RULES[rule];
        refinement_keeps_the_limit(&mesh, levels)?;
    }

    #[test]
    fn parameters_outside_are_moved_to_the_border(
        dice in dice(), which in any::<u8>(), u in -1e9..1e9, v in -1e9..1e9,
    ) {
        let mesh = random(scheme(which), &dice);
        let (surface, points) = surface(&mesh);
        let strange = [u, v, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MIN_POSITIVE, -0.0];
        for face in faces(&surface) {
            for u in strange {
                for v in strange {
                    let point = surface.evaluate(&points, face, u, v);
                    for x in [point.position, point.du, point.dv].concat() {
                        prop_assert!(x.is_finite(), "({u}, {v}): {point:?}");
                    }
                    prop_assert!(Vec3::from(point.position.map(|x| x as f32)).length() < 100.0);
                }
            }
        }
    }
}
