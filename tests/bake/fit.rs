//! Cages that are moved to the dense mesh first.

use relievo::math::DVec3;
use relievo::mesh::{ControlMesh, FaceVaryingInterpolation};
use relievo::scene::{LoadOptions, obj};
use relievo::subdiv::refine;

use super::models::{Model, cube_sphere, lifted, octahedron_sphere, off};
use super::{bake, displaced, largest, number, points, report};
use crate::common::program::{Bench, expect};

fn mesh(bench: &Bench, name: &str) -> ControlMesh {
    let scene = obj::load(&bench.path(name), &LoadOptions::default()).expect("a cage");
    let mesh = scene.shapes[0].geometry.mesh().expect("a mesh");
    ControlMesh::clone(mesh)
}

/// A cage's limit surface, finely meshed.
fn limit(cage: &ControlMesh, levels: u32) -> Model {
    let mut fine = refine(cage, levels);
    fine.move_to_limit(cage);
    let mesh = fine.mesh;
    let face = |corners: std::ops::Range<usize>| {
        let corners = &mesh.face_vertex_indices[corners];
        corners.iter().map(|&v| v as usize).collect()
    };
    Model {
        points: mesh.points[0].iter().map(|p| p.as_dvec3()).collect(),
        faces: mesh.faces().map(face).collect(),
    }
}

/// Away from the middle or towards it, by other parts of a twelfth at each point.
fn unsettled(p: DVec3) -> DVec3 {
    let wave = (13.0 * p.x + 2.0).sin() * (11.0 * p.y + 1.0).sin() * (17.0 * p.z).cos();
    (1.0 + wave / 12.0) * p
}

#[test]
fn a_cage_is_found_again_by_its_limit_surface() {
    let bench = Bench::new();
    let creases = "t crease 2/1/0 0 1 10\nt crease 2/1/0 1 2 10\nt corner 1/1/0 3 2\n";
    for (name, model, tags) in [
        ("quads.obj", cube_sphere(3), ""),
        ("catmark_creases.obj", cube_sphere(3), creases),
        ("loop_triangles.obj", octahedron_sphere(2), ""),
        ("catmark_triangles.obj", octahedron_sphere(1), ""),
    ] {
        let right = model.moved(|p| p * (1.0 + 0.1 * (3.0 * p.x).sin()));
        bench.write(name, right.obj() + tags);
        bench.write("dense.obj", limit(&mesh(&bench, name), 5).obj());
        let start = format!("{}_start.obj", name.trim_end_matches(".obj"));
        bench.write(&start, right.moved(unsettled).obj() + tags);
        let fitted = format!("{}_fitted.obj", name.trim_end_matches(".obj"));
        let told = report(
            &bench,
            &[
                "dense.obj",
                &start,
                "-o",
                "out.ptx",
                "--fit",
                &fitted,
                "--texels",
                "8",
            ],
        );
        let fit = &told["fit"];
        let (before, after) = (number(fit, "rms_before"), number(fit, "rms_after"));
        let [largest_before, largest_after] =
            ["largest_before", "largest_after"].map(|name| number(fit, name));
        let (start, found) = (mesh(&bench, &start), mesh(&bench, &fitted));
        let rms = |a: &ControlMesh| {
            let off = a.points[0].iter().zip(&right.points);
            let squares: f64 = off.map(|(a, b)| a.as_dvec3().distance_squared(*b)).sum();
            (squares / right.points.len() as f64).sqrt()
        };
        println!(
            "{name}: rms {before:.2e} to {after:.2e}, at most {largest_before:.2e} to {largest_after:.2e}; \
             points {:.2e} to {:.2e}",
            rms(&start),
            rms(&found)
        );
        assert!(
            after < 0.02 * before && largest_after < 0.05 * largest_before,
            "{name}: {told}"
        );
        // Points may slide along the surface, where it stays the same.
        assert!(rms(&found) < 0.4 * rms(&start), "{name}");
        // Tags and faces are kept; there is nothing face-varying.
        let same = |mesh: &ControlMesh| ControlMesh {
            points: Vec::new(),
            face_varying: FaceVaryingInterpolation::default(),
            ..mesh.clone()
        };
        assert_eq!(same(&start), same(&found), "{name}");
    }
}

#[test]
fn what_is_baked_is_for_the_fitted_cage() {
    let bench = Bench::new();
    bench.write("cage.obj", cube_sphere(3).obj());
    bench.write("dense.obj", cube_sphere(60).moved(lifted).obj());
    let plain = report(&bench, &["dense.obj", "cage.obj", "-o", "plain.ptx"]);
    let arguments = [
        "dense.obj",
        "cage.obj",
        "-o",
        "out.ptx",
        "--fit",
        "fitted.obj",
    ];
    let told = report(&bench, &arguments);
    assert!(plain["fit"].is_null());
    let span = |told: &serde_json::Value| number(told, "greatest").max(-number(told, "least"));
    assert!(span(&told) < 0.6 * span(&plain), "{told} {plain}");
    let half_a_step = 0.5 * number(&told, "step");
    assert!(largest(&told) < half_a_step, "{told}");
    let surface = displaced(&bench, "fitted.obj", "out.ptx");
    let worst = points(&surface, 24).map(off).fold(0.0, f64::max);
    assert!(worst < half_a_step + 4e-4, "{worst} {told}");

    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("written");
    let first = [bytes("fitted.obj"), bytes("out.ptx")];
    report(&bench, &[&arguments[..], &["-t", "1"]].concat());
    assert_eq!(first, [bytes("fitted.obj"), bytes("out.ptx")]);

    let with = |fit: &str| bake(&bench, &[&arguments[..5], &[fit]].concat());
    expect(with("fitted.ply"), 2, &["fitted.ply", ".obj"]);
    expect(with("none/fitted.obj"), 1, &["none/fitted.obj", "folder"]);
    expect(with("loop_fitted.obj"), 3, &["loop_fitted.obj"]);
}
