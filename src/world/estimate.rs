//! What a scene will take, before it is built.

use super::build::single;
use super::dicing::{self, Dicing};
use super::geometry::{refined_because, refinement_levels};
use super::patch::Diced;
use crate::math::Affine3A;
use crate::mesh::Scheme;
use crate::scene::{Description, Geometry};
use crate::shade::camera::Camera;

/// Triangles that the scene is diced into as seen by `camera`. Instances share theirs.
pub fn micro_triangles(description: &Description, camera: &Camera, dicing: &Dicing) -> u64 {
    let mut places: Vec<Vec<Affine3A>> = vec![Vec::new(); description.shapes.len()];
    for placement in &description.placements {
        places[placement.shape].extend(placement.world_from_object.iter().map(single));
    }
    let shapes = description.shapes.iter().zip(&places);
    shapes
        .map(|(shape, places)| {
            let mesh = match &shape.geometry {
                Geometry::Mesh(mesh) => mesh,
                Geometry::Nurbs(patch) => {
                    return Diced::micro_triangles(patch, places, camera, dicing);
                }
            };
            let triangles: u64 = {
                let corners = mesh.face_vertex_counts.iter();
                corners.map(|&n| u64::from(n.saturating_sub(2))).sum()
            };
            if mesh.scheme == Scheme::None {
                triangles
            } else if refined_because(mesh, false).is_some() {
                let levels = refinement_levels(mesh, places, camera, dicing);
                triangles << (2 * levels)
            } else {
                dicing::micro_triangles(mesh, places, camera, dicing)
            }
        })
        .sum()
}
