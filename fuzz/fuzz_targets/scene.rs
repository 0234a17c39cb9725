//! Any bytes as a control mesh: what passes the checks is triangulated and refined.
#![no_main]

use relievo::math::Vec3;
use relievo::mesh::{ControlMesh, Corner, Crease, Scheme, triangulate};
use relievo::subdiv::schemes::loop_scheme;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut bytes = bytes.iter().copied();
    let mut byte = || bytes.next().unwrap_or_default();
    let triangles = byte() % 2 == 0;
    let mut mesh = ControlMesh {
        left_handed: byte() % 2 == 0,
        ..ControlMesh::default()
    };
    let points = (0..byte() % 32).map(|_| Vec3::new(byte().into(), byte().into(), byte().into()));
    mesh.points = vec![points.collect()];
    for _ in 0..byte() % 32 {
        let corners = if triangles { 3 } else { byte() % 9 };
        mesh.face_vertex_counts.push(corners.into());
        mesh.face_vertex_indices.extend((0..corners).map(|_| u32::from(byte() % 33)));
    }
    for _ in 0..byte() % 8 {
        mesh.creases.push(Crease {
            vertices: [byte().into(), byte().into()],
            sharpness: f32::from(byte()) / 20.0,
        });
        mesh.corners.push(Corner {
            vertex: byte().into(),
            sharpness: f32::from(byte()) / 20.0,
        });
    }
    if triangles {
        mesh.scheme = Scheme::Loop;
    }
    if mesh.validate().is_err() {
        return;
    }
    let _ = triangulate(&mesh);
    if triangles {
        let refined = loop_scheme::refine_levels(&mesh, 2);
        refined.mesh.validate().expect("a refined mesh is valid");
        let _ = loop_scheme::limit(&refined.mesh);
    }
});
