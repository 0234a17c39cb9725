//! Cages to be unfolded.

use std::f32::consts::{PI, TAU};

use crate::math::Vec3;
use crate::mesh::ControlMesh;

/// Of faces of any number of corners.
pub(super) fn mesh(points: Vec<Vec3>, faces: &[Vec<u32>]) -> ControlMesh {
    ControlMesh {
        points: vec![points],
        face_vertex_counts: faces.iter().map(|f| f.len() as u32).collect(),
        face_vertex_indices: faces.concat(),
        ..ControlMesh::default()
    }
}

/// A grid of quads over the unit square, bent by a function; closed along u, along v, or not.
pub(super) fn grid(
    size: [u32; 2],
    closed: [bool; 2],
    at: impl Fn(f32, f32) -> Vec3,
) -> ControlMesh {
    let [columns, rows] = [0, 1].map(|i| if closed[i] { size[i] } else { size[i] + 1 });
    let places = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let points = places.map(|(x, y)| at(x as f32 / size[0] as f32, y as f32 / size[1] as f32));
    let index = |x: u32, y: u32| y % rows * columns + x % columns;
    let faces: Vec<Vec<u32>> = (0..size[1])
        .flat_map(|y| (0..size[0]).map(move |x| (x, y)))
        .map(|(x, y)| {
            vec![
                index(x, y),
                index(x + 1, y),
                index(x + 1, y + 1),
                index(x, y + 1),
            ]
        })
        .collect();
    mesh(points.collect(), &faces)
}

/// Part of a round cylinder, or of a cone where `top` is not 1.
pub(super) fn bent(size: [u32; 2], angle: f32, top: f32) -> ControlMesh {
    grid(size, [false; 2], |u, v| {
        let radius = 1.0 + v * (top - 1.0);
        let (sin, cos) = (angle * u).sin_cos();
        Vec3::new(radius * cos, radius * sin, 1.5 * v)
    })
}

pub(super) fn torus(size: [u32; 2], thin: f32) -> ControlMesh {
    grid(size, [true; 2], |u, v| {
        let ((s, c), (sin, cos)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
        Vec3::new((1.0 + thin * cos) * c, (1.0 + thin * cos) * s, thin * sin)
    })
}

/// A ball between two heights, closed by polygons of as many sides as it has columns, or open.
pub(super) fn ball(size: [u32; 2], from: f32, to: f32, capped: bool) -> ControlMesh {
    let mut ball = grid(size, [true, false], |u, v| {
        let height = PI * (from + v * (to - from));
        let (sin, cos) = (TAU * u).sin_cos();
        Vec3::new(height.sin() * cos, height.sin() * sin, -height.cos())
    });
    if capped {
        let last = size[0] * size[1];
        ball.face_vertex_counts.extend([size[0]; 2]);
        ball.face_vertex_indices.extend((0..size[0]).rev());
        ball.face_vertex_indices.extend(last..last + size[0]);
    }
    ball
}

pub(super) fn cube() -> ControlMesh {
    let point = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    mesh((0..8).map(point).collect(), &faces.map(|f| f.to_vec()))
}
