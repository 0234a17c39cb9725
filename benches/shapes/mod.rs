//! Closed cages for benchmarks.

use relievo::math::Vec3;
use relievo::mesh::{ControlMesh, Scheme};

/// A wavy torus of `side` by `side` quads, or pairs of triangles: all vertices are regular.
pub(crate) fn torus(scheme: Scheme, side: u32) -> ControlMesh {
    let tau = std::f32::consts::TAU;
    let point = |i: u32| {
        let [a, b] = [i % side, i / side].map(|k| tau * k as f32 / side as f32);
        let r = 3.0 + b.cos() + 0.1 * (5.0 * a + 3.0 * b).sin();
        Vec3::new(r * a.cos(), r * a.sin(), b.sin())
    };
    let mut faces: Vec<u32> = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let at = |dx: u32, dy: u32| (y + dy) % side * side + (x + dx) % side;
            let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
            match scheme {
                Scheme::Loop => faces.extend([a, b, c, a, c, d]),
                _ => faces.extend([a, b, c, d]),
            }
        }
    }
    let sides = if scheme == Scheme::Loop { 3 } else { 4 };
    ControlMesh {
        scheme,
        face_vertex_counts: vec![sides; faces.len() / sides as usize],
        face_vertex_indices: faces,
        points: vec![(0..side * side).map(point).collect()],
        ..ControlMesh::default()
    }
}

/// Every so many quads each way one has another within it: eight vertices, four of valence 3 and four of 5.
pub(crate) fn twisted(mut mesh: ControlMesh, side: u32, every: u32) -> ControlMesh {
    let mut faces: Vec<u32> = Vec::new();
    for (i, quad) in (0_u32..).zip(mesh.face_vertex_indices.chunks_exact(4)) {
        if !is_chosen(i, side, every) {
            faces.extend(quad);
            continue;
        }
        let points = &mut mesh.points[0];
        let first = points.len() as u32;
        let centre = quad.iter().map(|&v| points[v as usize]).sum::<Vec3>() / 4.0;
        points.extend([0, 1, 2, 3].map(|k| points[quad[k] as usize].lerp(centre, 0.5)));
        for k in 0..4 {
            let next = (k + 1) % 4;
            faces.extend([quad[k], quad[next], first + next as u32, first + k as u32]);
        }
        faces.extend([first, first + 1, first + 2, first + 3]);
    }
    mesh.face_vertex_counts = vec![4; faces.len() / 4];
    mesh.face_vertex_indices = faces;
    mesh
}

/// Every so many places each way.
pub(crate) fn is_chosen(place: u32, side: u32, every: u32) -> bool {
    (place % side).is_multiple_of(every) && (place / side).is_multiple_of(every)
}
