//! Patches whose polygons are known: a ball, a trimmed sheet, primvars.

use std::collections::BTreeMap;

use super::super::dicing::tests::camera;
use super::*;
use crate::nurbs::tests::{circle, direction, sphere};

/// The square from -1 to 1 in x and y, trimmed to discs.
fn discs(discs: &[([f64; 2], f64)]) -> NurbsPatch {
    NurbsPatch {
        u: direction(2, &[-1.0, -1.0, 0.25, 1.0, 1.0]),
        v: direction(2, &[-1.0, -1.0, 1.0, 1.0]),
        points: vec![
            [-1.0, 1.0]
                .into_iter()
                .flat_map(|y| [-1.0, 0.25, 1.0].map(|x| Vec3::new(x, y, 0.0)))
                .collect(),
        ],
        trims: discs
            .iter()
            .map(|&(centre, radius)| vec![circle(centre, radius, false)])
            .collect(),
        ..NurbsPatch::default()
    }
}

fn diced(patch: &NurbsPatch, pixels: f32) -> (Diced, Vec<String>) {
    let mut warnings = Warnings::default();
    let dicing = Dicing {
        rate: pixels,
        ..Dicing::default()
    };
    let places = [Affine3A::IDENTITY];
    let diced =
        Diced::new(patch, &places, &camera(), &dicing, "/P", &mut warnings).expect("a valid patch");
    assert_eq!(diced.mesh.validate(), Ok(()));
    assert_eq!(diced.faces.len(), diced.mesh.face_count());
    let kinds = warnings.iter().map(|w| w.kind.clone()).collect();
    (diced, kinds)
}

/// Ends of edges that polygons do not run along as often one way as the other. Edges are known by the places of
/// their ends.
fn borders(mesh: &ControlMesh) -> Vec<[Vec3; 2]> {
    let mut balance: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
    for range in mesh.faces() {
        let corners = &mesh.face_vertex_indices[range];
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            // Adding 0 makes one zero of two.
            let place = |v: u32| mesh.points[0][v as usize] + 0.0;
            let [a, b] = [a, b].map(|v| place(v).to_array().map(f32::to_bits));
            // Edges at a pole have no length.
            if a != b {
                *balance.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
    }
    let open = balance.into_iter().filter(|(_, n)| *n != 0);
    open.map(|(ends, _)| ends.map(|end| Vec3::from(end.map(f32::from_bits))))
        .collect()
}

#[test]
fn a_ball_is_closed_and_round() {
    let (ball, kinds) = diced(&sphere(), 4.0);
    assert!(kinds.is_empty());
    assert!(borders(&ball.mesh).is_empty());
    assert!(ball.mesh.face_count() > 10_000);
    let normals = ball.mesh.normals.as_ref().expect("normals");
    for (i, p) in ball.mesh.points[0].iter().enumerate() {
        assert!((p.length() - 1.0).abs() < 1e-6);
        assert!(Vec3::from_slice(normals.get(i)).distance(*p) < 1e-6);
    }
}

#[test]
fn a_trimmed_sheet_has_its_area_and_no_cracks_inside() {
    let (mut rate, mut last) = (32.0, f64::INFINITY);
    while rate >= 2.0 {
        let patch = discs(&[([0.1, 0.0], 0.8), ([0.2, 0.1], 0.4), ([0.2, 0.1], 0.01)]);
        let (sheet, kinds) = diced(&patch, rate);
        assert!(kinds.is_empty());
        let mesh = &sheet.mesh;
        let st = mesh.primvar("st").expect("st");
        let mut area = 0.0;
        for range in mesh.faces() {
            let corners = &mesh.face_vertex_indices[range];
            let at = |k: usize| mesh.points[0][corners[k] as usize].as_dvec3();
            for k in 2..corners.len() {
                let twice = (at(k - 1) - at(0)).cross(at(k) - at(0));
                assert!(twice.z > -1e-9);
                area += 0.5 * twice.z;
            }
            for &corner in corners {
                let p = mesh.points[0][corner as usize];
                let st = st.get(corner as usize);
                assert!((2.0 * st[0] - 1.0 - p.x).abs() < 1e-6);
                assert!((2.0 * st[1] - 1.0 - p.y).abs() < 1e-6);
            }
        }
        let exact = std::f64::consts::PI * (0.64 - 0.16 + 0.0001);
        // A tenth of a cell of `rate` pixels, 200 of them a unit.
        let tolerance = 0.1 * f64::from(rate) / 200.0;
        assert!((area - exact).abs() < 8.0 * tolerance, "{area} {exact}");
        last = (area - exact).abs();
        for [a, b] in borders(mesh) {
            let middle = (0.5 * (a + b)).as_dvec3();
            let near = |x: f64, y: f64, r: f64| {
                ((middle.x - x).hypot(middle.y - y) - r).abs() < 2.0 * tolerance
            };
            let on_curve = near(0.1, 0.0, 0.8) || near(0.2, 0.1, 0.4) || near(0.2, 0.1, 0.01);
            assert!(on_curve, "a crack at {middle}");
        }
        rate *= 0.5;
    }
    assert!(last < 1e-3);
}

#[test]
fn nothing_of_a_patch_may_be_left() {
    let (sheet, _) = diced(&discs(&[([5.0, 0.0], 0.8)]), 8.0);
    assert_eq!(sheet.mesh.face_count(), 0);
}

#[test]
fn primvars_follow_the_patch() {
    let mut patch = discs(&[]);
    let primvar = |name: &str, interpolation, values: &[f32]| Primvar {
        name: name.into(),
        interpolation,
        width: 1,
        values: values.to_vec(),
        indices: None,
    };
    patch.primvars = vec![
        primvar("whole", Interpolation::Constant, &[7.0]),
        primvar("piece", Interpolation::Uniform, &[1.0, 2.0]),
        primvar(
            "x",
            Interpolation::Varying,
            &[-1.0, 0.25, 1.0, -1.0, 0.25, 1.0],
        ),
        primvar(
            "y",
            Interpolation::Vertex,
            &[-1.0, -1.0, -1.0, 1.0, 1.0, 1.0],
        ),
    ];
    patch.u.form = NurbsForm::Closed;
    let (sheet, kinds) = diced(&patch, 16.0);
    assert_eq!(kinds, ["patch that does not close"]);
    let get = |name: &str, i: usize| sheet.mesh.primvar(name).expect(name).get(i)[0];
    for (i, p) in sheet.mesh.points[0].iter().enumerate() {
        assert!((get("x", i) - p.x).abs() < 1e-6 && (get("y", i) - p.y).abs() < 1e-6);
    }
    for (face, range) in sheet.mesh.faces().enumerate() {
        let corners = &sheet.mesh.face_vertex_indices[range];
        let right = corners
            .iter()
            .any(|&c| sheet.mesh.points[0][c as usize].x > 0.26);
        assert_eq!(get("piece", face), if right { 2.0 } else { 1.0 });
        assert_eq!(sheet.faces[face], u32::from(right));
    }
    assert_eq!(get("whole", 0), 7.0);
}
