//! What a scene will take, before it is built.

use std::sync::Arc;

use super::build::single;
use crate::math::{Affine3A, Bounds3};
use crate::mesh::Scheme;
use crate::scene::{Description, Geometry};
use crate::shade::camera::Camera;
use crate::surface::{Base, Dicing, Displacement, Patch, Places, Rates, Subdivision, Surface};

/// Triangles that the scene is diced into as seen by `camera`, displacement left out: it makes them more. Instances
/// share theirs.
pub fn micro_triangles(description: &Description, camera: &Camera, dicing: &Dicing) -> u64 {
    let mut places: Vec<Vec<Affine3A>> = vec![Vec::new(); description.shapes.len()];
    for placement in &description.placements {
        places[placement.shape].extend(placement.world_from_object.iter().map(single));
    }
    let shapes = description.shapes.iter().zip(&places);
    shapes
        .map(|(shape, places)| {
            let (base, bounds): (Arc<dyn Base>, _) = match &shape.geometry {
                Geometry::Nurbs(patch) => match Patch::new(patch, &[], None) {
                    Ok(base) => (Arc::new(base), patch.bounds()),
                    // What is wrong with it is told when it is built.
                    Err(_) => return 0,
                },
                Geometry::Mesh(mesh) if mesh.scheme == Scheme::None => {
                    let corners = mesh.face_vertex_counts.iter();
                    return corners.map(|&n| u64::from(n.saturating_sub(2))).sum();
                }
                Geometry::Mesh(mesh) => {
                    let base = Subdivision::new(mesh, None);
                    (Arc::new(base), Bounds3::of(mesh.used_points()))
                }
            };
            let surface = Surface::new(base, Displacement::None);
            let places = Places::nearest(camera, &bounds, places);
            Rates::on_screen(&surface, &places, dicing).micro_triangles()
        })
        .sum()
}
