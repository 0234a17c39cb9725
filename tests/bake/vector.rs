//! Vectors, where a normal is not enough.

use std::fmt::Write;
use std::sync::Arc;

use relievo::image::{ColorSpace, ImageSource, Texture, Wrap};
use relievo::math::{Area, DVec3};
use relievo::mesh::ControlMesh;
use relievo::scene::{LoadOptions, obj};
use relievo::subdiv::refine;
use relievo::surface::{
    Amount, Carrier, Channels, Displacement, DisplacementMap, Function, ImageMap, Space,
    Subdivision, Surface,
};

use super::models::{Model, cube_sphere};
use super::{bake, consistent, displaced, largest, number, report};
use crate::common::program::{Bench, expect};

/// A mushroom on a sphere's top: its cap is wider than its stalk, and hangs over it.
fn mushroom(p: DVec3) -> DVec3 {
    let r = p.x.hypot(p.y);
    let on_top = if p.z > 0.0 { 1.0 } else { 0.0 };
    let wide = 1.0 + on_top * 4.0 * (-r * r / 0.02).exp();
    let high = on_top * 0.8 * (-r * r / 0.06).exp();
    DVec3::new(wide * p.x, wide * p.y, p.z + high)
}

fn cage(bench: &Bench, name: &str) -> ControlMesh {
    let scene = obj::load(&bench.path(name), &LoadOptions::default()).expect("a cage");
    ControlMesh::clone(scene.shapes[0].geometry.mesh().expect("a mesh"))
}

/// The mushroom on a cage's limit surface, with the cage's texture coordinates.
fn sculpted(cage: &ControlMesh, levels: u32) -> String {
    let mut fine = refine(cage, levels);
    fine.move_to_limit(cage);
    let mesh = fine.mesh;
    let mut text = String::new();
    for p in &mesh.points[0] {
        let p = mushroom(p.as_dvec3());
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("a string takes all");
    }
    let st = mesh.primvar("st").expect("texture coordinates");
    for place in st.values.chunks_exact(2) {
        writeln!(text, "vt {} {}", place[0], place[1]).expect("a string takes all");
    }
    let element = |corner: usize| st.indices.as_ref().map_or(corner as u32, |i| i[corner]);
    for face in mesh.faces() {
        let corners = face.map(|corner| {
            let point = mesh.face_vertex_indices[corner] + 1;
            format!(" {point}/{}", element(corner) + 1)
        });
        writeln!(text, "f{}", corners.collect::<String>()).expect("a string takes all");
    }
    text
}

/// A cage displaced by vectors of a file.
fn by_vectors(bench: &Bench, name: &str, file: &str, space: Space) -> Surface {
    let base = Arc::new(Subdivision::new(&cage(bench, name), Some("st")));
    let image = ImageSource::File(bench.path(file));
    let map: Arc<dyn DisplacementMap> = if file.ends_with(".exr") {
        let texture = Texture::load(&image, [Wrap::Clamp; 2], ColorSpace::Raw).expect("an image");
        Arc::new(ImageMap::new(Arc::new(texture), Channels::Vector))
    } else {
        let texture = consistent(&image);
        let carrier = base.clone();
        Arc::new(Function::vector(move |at| {
            let (face, uv) = carrier.ptex(at.face, at.uv).expect("a Ptex face");
            texture.eval(face, uv, &Area::POINT).truncate()
        }))
    };
    let amount = Amount {
        map,
        scale: 1.0,
        bias: 0.0,
    };
    Surface::new(base, Displacement::Vector(amount, space))
}

/// How far a surface's points are from the mushroom's points of the same parameters, at most.
fn off(surface: &Surface) -> f64 {
    let mut worst = 0.0_f64;
    for face in 0..surface.base().faces() {
        for i in 0..20 * 20 {
            let uv = [i % 20, i / 20].map(|i| (i as f32 + 0.5) / 20.0).into();
            let point = surface.evaluate(face, uv, 0);
            let wanted = mushroom(point.limit.position.as_dvec3());
            worst = worst.max(point.position.as_dvec3().distance(wanted));
        }
    }
    worst
}

#[test]
fn an_overhang_comes_back() {
    let bench = Bench::new();
    let quads = cube_sphere(3);
    for (name, model) in [
        ("quads.obj", quads.clone()),
        ("catmark_lefthanded.obj", quads.turned()),
        ("loop_triangles.obj", super::models::octahedron_sphere(2)),
    ] {
        bench.write(name, model.obj_with_islands(0.05));
        bench.write("dense.obj", sculpted(&cage(&bench, name), 5));
        for (file, space, word) in [
            ("out.ptx", Space::Object, "object"),
            ("out.ptx", Space::Tangent, "tangent"),
            ("out.exr", Space::Object, "object"),
        ] {
            // These islands turn the tangents from triangle to triangle, and Ptex mixes texels over edges.
            if word == "tangent" && name.starts_with("loop_") {
                continue;
            }
            let arguments = ["dense.obj", name, "-o", file, "--vector", word];
            let texels = if file == "out.exr" { "512" } else { "32" };
            let told = report(&bench, &[&arguments[..], &["--texels", texels]].concat());
            assert_eq!(told["missed"], 0, "{told}");
            let half_a_step = 0.5 * number(&told, "step");
            let worst = off(&by_vectors(&bench, name, file, space));
            println!(
                "{name} {file} {word}: {worst:.2e} off, half a step {half_a_step:.2e}, told {:.2e}",
                largest(&told)
            );
            assert!(
                worst < half_a_step && largest(&told) < half_a_step,
                "{name} {file} {word}"
            );
            assert!(half_a_step < 0.1 * number(&told, "greatest"), "{told}");
        }
    }
    // Heights cannot show what is under the cap.
    report(
        &bench,
        &[
            "dense.obj",
            "loop_triangles.obj",
            "-o",
            "out.ptx",
            "--reach",
            "2",
        ],
    );
    let heights = off(&displaced(&bench, "loop_triangles.obj", "out.ptx"));
    assert!(heights > 0.1, "{heights}");
}

#[test]
fn vectors_need_both_layouts() {
    let bench = Bench::new();
    let model: Model = cube_sphere(2);
    bench.write("bare.obj", model.obj());
    bench.write("laid.obj", model.obj_with_islands(0.1));
    let away = model.obj_with_islands(0.1).replace("vt 0.", "vt 7.");
    bench.write("away.obj", away);
    let of = |dense: &str, cage: &str| {
        bake(
            &bench,
            &[dense, cage, "-o", "out.ptx", "--vector", "object"],
        )
    };
    expect(
        of("bare.obj", "laid.obj"),
        3,
        &["bare.obj", "texture coordinates"],
    );
    expect(
        of("laid.obj", "bare.obj"),
        3,
        &["bare.obj", "texture coordinates"],
    );
    expect(of("away.obj", "laid.obj"), 3, &["away.obj", "lie on it"]);
    expect(of("laid.obj", "laid.obj"), 0, &[]);
}
