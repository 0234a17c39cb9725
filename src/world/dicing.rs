//! How finely Embree dices an edge: by its length on the screen, the same from both of its faces.

use crate::math::{Affine3A, Bounds3};
use crate::mesh::ControlMesh;
use crate::shade::camera::Camera;
use crate::surface::Places;

pub use crate::surface::Dicing;

/// Micro-triangles that a subdivision surface of `mesh` is diced into: what its memory grows with.
pub(super) fn micro_triangles(
    mesh: &ControlMesh,
    places: &[Affine3A],
    camera: &Camera,
    dicing: &Dicing,
) -> u64 {
    let rates = rates(mesh, places, camera, dicing);
    let faces = mesh.faces().map(|range| match &rates[range] {
        &[a, b, c, d] => 2 * a.max(c) as u64 * b.max(d) as u64,
        // Any other face is cut into quads, each between the halves of two of its edges.
        edges => {
            let before = edges.iter().cycle().skip(edges.len() - 1);
            let halves = edges.iter().zip(before);
            halves
                .map(|(a, b)| 2 * (0.5 * a).ceil() as u64 * (0.5 * b).ceil() as u64)
                .sum()
        }
    });
    faces.sum()
}

/// Segments for an edge of this many pixels: a whole number from 1.
pub(super) fn segments(dicing: &Dicing, pixels: f32) -> f32 {
    (pixels / dicing.rate)
        .ceil()
        .clamp(1.0, dicing.max_segments as f32)
}

/// Segments for each half-edge of `mesh` (for the edge from a corner to the face's next one), enough for each of
/// the places in which the mesh stands.
pub(super) fn rates(
    mesh: &ControlMesh,
    places: &[Affine3A],
    camera: &Camera,
    dicing: &Dicing,
) -> Vec<f32> {
    let points = &mesh.points[0];
    let bounds = Bounds3::of(points.iter().copied());
    let places = Places::nearest(camera, &bounds, places);
    let mut rates = vec![1.0; mesh.face_vertex_indices.len()];
    for range in mesh.faces() {
        let corners = &mesh.face_vertex_indices[range.clone()];
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            // The same arithmetic from either side of the edge: ends in the order of their numbers.
            let (a, b) = (points[a.min(b) as usize], points[a.max(b) as usize]);
            rates[range.start + i] = segments(dicing, places.pixels(a, b));
        }
    }
    rates
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::math::{DAffine3, Vec3};
    use crate::scene::{self, Projection};
    use crate::shade::camera::CameraOptions;

    /// 400 x 400 pixels that see 2 x 2 units around the origin from 5 units above.
    pub(in crate::world) fn camera() -> Camera {
        let camera = scene::Camera {
            path: "/cam".into(),
            world_from_camera: vec![DAffine3::from_translation(glam::dvec3(0.0, 0.0, 5.0))],
            projection: Projection::Perspective,
            focal_length: 50.0,
            aperture: glam::vec2(20.0, 20.0),
            aperture_offset: glam::Vec2::ZERO,
            clipping_range: glam::vec2(0.1, 1e6),
            f_stop: 0.0,
            focus_distance: 0.0,
            shutter: [0.0; 2],
            exposure: 0.0,
        };
        let options = CameraOptions {
            resolution: [400, 400],
            conform: scene::AspectRatioConform::ExpandAperture,
            pixel_aspect: 1.0,
            depth_of_field: false,
        };
        Camera::new(&camera, options).expect("a camera")
    }

    #[test]
    fn both_sides_of_an_edge_agree() {
        let mesh = ControlMesh {
            face_vertex_counts: vec![4, 4],
            face_vertex_indices: vec![0, 1, 2, 3, 2, 1, 4, 5],
            points: vec![vec![
                Vec3::ZERO,
                Vec3::X,
                Vec3::new(1.0, 1.0, 0.3),
                Vec3::Y,
                Vec3::new(2.0, 0.0, 1.0),
                Vec3::new(2.0, 1.0, 1.0),
            ]],
            ..ControlMesh::default()
        };
        let camera = camera();
        let rates = rates(&mesh, &[Affine3A::IDENTITY], &camera, &Dicing::default());
        assert_eq!(rates[1].to_bits(), rates[4].to_bits());
        let count = micro_triangles(&mesh, &[Affine3A::IDENTITY], &camera, &Dicing::default());
        let quad = |r: &[f32]| 2.0 * r[0].max(r[2]) * r[1].max(r[3]);
        assert_eq!(count as f32, quad(&rates[..4]) + quad(&rates[4..]));
        // 400 pixels across 2 units at distance 5.
        assert!((rates[0] - 200.0_f32.min(128.0)).abs() <= 1.0, "{rates:?}");
    }
}
