//! Real limit surfaces for tests of all that stands on them: cages with borders, creases, n-gons, holes and
//! extraordinary vertices under each scheme, and NURBS patches.

use std::sync::Arc;

use super::super::{Base, LimitGrid, Patch, Subdivision};
use super::patches;
use crate::math::{Vec2, Vec3};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, Interpolation, Primvar, Scheme,
};

/// All of them, with texture coordinates, moved by `offset`.
pub(super) fn cages(offset: f32) -> Vec<(&'static str, Arc<dyn Base>)> {
    let based = |mut mesh: ControlMesh| -> Arc<dyn Base> {
        for point in mesh.points.iter_mut().flatten() {
            *point += offset;
        }
        // Each corner has its own: seams at all edges.
        let st = (0..mesh.face_vertex_indices.len()).flat_map(|i| {
            let t = i as f32;
            [(0.37 * t).fract(), (0.61 * t).fract()]
        });
        mesh.primvars.push(Primvar {
            name: "st".into(),
            interpolation: Interpolation::FaceVarying,
            width: 2,
            values: st.collect(),
            indices: None,
        });
        mesh.validate().expect("a valid cage");
        Arc::new(Subdivision::new(&mesh, Some("st")))
    };
    let patch = |mut patch: crate::mesh::NurbsPatch| -> Arc<dyn Base> {
        for point in patch.points.iter_mut().flatten() {
            *point += offset;
        }
        Arc::new(Patch::new(&patch, &[], None).expect("a valid patch"))
    };
    vec![
        ("creased block", based(block(Scheme::CatmullClark))),
        ("open sheet", based(sheet(BoundaryInterpolation::EdgeOnly))),
        (
            "sheet without its border",
            based(sheet(BoundaryInterpolation::None)),
        ),
        ("wheel", based(wheel(Scheme::CatmullClark, 7))),
        ("triangles", based(wheel(Scheme::Loop, 7))),
        ("flat-sided block", based(block(Scheme::Bilinear))),
        ("ball patch", patch(patches::sphere())),
        ("trimmed patch", patch(patches::sheet())),
    ]
}

fn mesh(scheme: Scheme, points: Vec<Vec3>, faces: &[&[u32]]) -> ControlMesh {
    ControlMesh {
        scheme,
        face_vertex_counts: faces.iter().map(|f| f.len() as u32).collect(),
        face_vertex_indices: faces.concat(),
        points: vec![points],
        ..ControlMesh::default()
    }
}

/// A cube, smooth all over.
pub(super) fn cube() -> ControlMesh {
    let at = |i: u32, bit: u32| 2.0 * (i >> bit & 1) as f32 - 1.0;
    let points = (0..8).map(|i| Vec3::new(at(i, 0), at(i, 1), at(i, 2)));
    let faces: [&[u32]; 6] = [
        &[4, 5, 7, 6],
        &[0, 2, 3, 1],
        &[0, 1, 5, 4],
        &[2, 6, 7, 3],
        &[1, 3, 7, 5],
        &[0, 4, 6, 2],
    ];
    mesh(Scheme::CatmullClark, points.collect(), &faces)
}

/// A hexagonal prism: two n-gons, creases sharp, fractional and of different sharpness at a vertex, and a corner.
fn block(scheme: Scheme) -> ControlMesh {
    let ring = |z: f32| {
        (0..6).map(move |i| {
            let angle = std::f32::consts::TAU * i as f32 / 6.0;
            Vec3::new(angle.cos(), angle.sin(), z)
        })
    };
    let sides: Vec<[u32; 4]> = (0..6)
        .map(|i| [i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i])
        .collect();
    let mut faces: Vec<&[u32]> = sides.iter().map(<[u32; 4]>::as_slice).collect();
    faces.push(&[5, 4, 3, 2, 1, 0]);
    faces.push(&[6, 7, 8, 9, 10, 11]);
    let mut block = mesh(scheme, ring(-0.6).chain(ring(0.7)).collect(), &faces);
    let crease = |a, b, sharpness| Crease {
        vertices: [a, b],
        sharpness,
    };
    block.creases = vec![
        crease(0, 1, Crease::INFINITE),
        crease(1, 2, Crease::INFINITE),
        crease(2, 8, 1.5),
        crease(8, 9, 3.2),
        crease(9, 10, 0.4),
    ];
    block.corners = vec![Corner {
        vertex: 11,
        sharpness: 2.3,
    }];
    block
}

/// Three by three quads with a hole in a corner, bent.
fn sheet(boundary: BoundaryInterpolation) -> ControlMesh {
    let points = (0..16).map(|i| {
        let (x, y) = ((i % 4) as f32 / 1.5 - 1.0, (i / 4) as f32 / 1.5 - 1.0);
        Vec3::new(x, y, 0.5 * (2.0 * x + y).sin())
    });
    let quads: Vec<[u32; 4]> = (0..9)
        .map(|i| i / 3 * 4 + i % 3)
        .map(|a| [a, a + 1, a + 5, a + 4])
        .collect();
    let faces: Vec<&[u32]> = quads.iter().map(<[u32; 4]>::as_slice).collect();
    ControlMesh {
        boundary,
        holes: vec![8],
        ..mesh(Scheme::CatmullClark, points.collect(), &faces)
    }
}

/// A cone of `n` triangles about a tip on two rings of faces.
fn wheel(scheme: Scheme, n: u32) -> ControlMesh {
    let ring = |r: f32, z: f32| {
        (0..n).map(move |i| {
            let angle = std::f32::consts::TAU * i as f32 / n as f32;
            Vec3::new(r * angle.cos(), r * angle.sin(), z)
        })
    };
    let tip = [Vec3::new(0.0, 0.1, 0.8)];
    let points = tip.into_iter().chain(ring(0.5, 0.3)).chain(ring(1.0, -0.2));
    let mut triangles = Vec::new();
    for i in 0..n {
        let (a, b) = (1 + i, 1 + (i + 1) % n);
        triangles.extend([[0, a, b], [a, n + a, n + b], [a, n + b, b]]);
    }
    let faces: Vec<&[u32]> = triangles.iter().map(<[u32; 3]>::as_slice).collect();
    let mut wheel = mesh(scheme, points.collect(), &faces);
    wheel.creases = vec![Crease {
        vertices: [0, 1],
        sharpness: 1.7,
    }];
    wheel
}

#[test]
fn grids_are_what_single_points_are() {
    let us = [0.0, 0.02, 0.13, 0.25, 0.26, 0.4, 0.5, 0.66, 0.9, 1.0];
    let vs = [0.0, 0.01, 0.14, 0.3, 0.5, 0.74, 0.75, 0.97, 0.99, 1.0];
    let mixed = [0.74, 0.3, 0.97, 0.0, 1.0, 0.26, 0.25, 0.5, 0.01, 0.6];
    let mut grid = LimitGrid::default();
    for (name, base) in cages(0.0) {
        let faces = (0..base.faces()).filter(|&face| !base.is_hole(face));
        for (face, [us, vs]) in
            faces.flat_map(|face| [[us, vs], [mixed, vs], [us, mixed]].map(|both| (face, both)))
        {
            base.evaluate_grid(face, &us, &vs, 0, &mut grid);
            let places = vs.iter().flat_map(|&v| us.map(|u| Vec2::new(u, v)));
            for (i, uv) in places.enumerate() {
                let point = base.first_order(face, uv, 0);
                let off = grid.position(i).distance(point.position);
                assert!(off < 1e-6, "{name}, face {face} at {uv}: {off}");
                let [du, dv] = grid.derivatives(i);
                let off = du.distance(point.du).max(dv.distance(point.dv));
                assert!(off < 2e-5, "{name}, face {face} at {uv}: slopes {off}");
            }
        }
    }
}
