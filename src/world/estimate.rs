//! What a scene will take, before it is built.

use super::build::single;
use super::dicing::{self, Dicing};
use super::geometry::loop_levels;
use crate::math::Affine3A;
use crate::mesh::Scheme;
use crate::scene::Description;
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
            let mesh = &shape.mesh;
            match mesh.scheme {
                Scheme::CatmullClark | Scheme::Bilinear => {
                    dicing::micro_triangles(mesh, places, camera, dicing)
                }
                Scheme::Loop => {
                    let levels = loop_levels(mesh, places, camera, dicing);
                    (mesh.face_count() as u64) << (2 * levels)
                }
                Scheme::None => {
                    let corners = mesh.face_vertex_counts.iter();
                    corners.map(|&n| u64::from(n.saturating_sub(2))).sum()
                }
            }
        })
        .sum()
}
