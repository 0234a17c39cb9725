//! Against Embree itself: what is known in closed form, and what must not bring the process down.

mod diced;
mod subdivided;
mod traced;

use super::*;
use crate::math::Ray;
use crate::mesh::ControlMesh;
use crate::{error::Result, math::Vec3};
use std::sync::Arc;

fn device() -> Device {
    Device::new(&DeviceOptions::default()).expect("Embree starts")
}

fn commit(device: &Device, geometry: Geometry) -> Result<Scene> {
    let mut builder = SceneBuilder::new(
        device,
        SceneOptions {
            robust: true,
            compact: false,
        },
    )?;
    builder.attach(geometry);
    builder.commit(&|_| true)
}

/// The ray from above straight down at `x`, `y`.
fn down(x: f32, y: f32) -> Ray {
    Ray::new(Vec3::new(x, y, 10.0), -Vec3::Z, 0.0)
}

fn options(rate: f32) -> SubdivisionOptions {
    SubdivisionOptions {
        rates: Rates::Uniform(rate),
        displacement: None,
        primvars: Vec::new(),
    }
}

/// A cube from -1 to 1, fronts outside. Point i has x, y, z by its bits.
fn cube() -> ControlMesh {
    ControlMesh {
        face_vertex_counts: vec![4; 6],
        face_vertex_indices: vec![
            4, 5, 7, 6, 0, 2, 3, 1, 0, 1, 5, 4, 2, 6, 7, 3, 1, 3, 7, 5, 0, 4, 6, 2,
        ],
        points: vec![
            (0..8)
                .map(|i| {
                    Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0
                })
                .collect(),
        ],
        ..ControlMesh::default()
    }
}

/// A sheet of n by n unit quads in the xy plane, fronts up.
fn sheet(n: u32) -> ControlMesh {
    let at = |x, y| y * (n + 1) + x;
    ControlMesh {
        face_vertex_counts: vec![4; (n * n) as usize],
        face_vertex_indices: (0..n * n)
            .map(|f| (f % n, f / n))
            .flat_map(|(x, y)| [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)])
            .collect(),
        points: vec![
            (0..(n + 1) * (n + 1))
                .map(|i| Vec3::new((i % (n + 1)) as f32, (i / (n + 1)) as f32, 0.0))
                .collect(),
        ],
        ..ControlMesh::default()
    }
}

/// A fan of n triangles around point 0, fronts up.
fn fan(n: u32) -> ControlMesh {
    let rim = (0..n).map(|i| {
        let (s, c) = (i as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
        Vec3::new(c, s, 0.0)
    });
    ControlMesh {
        face_vertex_counts: vec![3; n as usize],
        face_vertex_indices: (0..n).flat_map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect(),
        points: vec![std::iter::once(Vec3::Z).chain(rim).collect()],
        ..ControlMesh::default()
    }
}

fn arc(mesh: ControlMesh) -> Arc<ControlMesh> {
    Arc::new(mesh)
}
