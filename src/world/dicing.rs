//! How finely Embree dices an edge: by its length on the screen, the same from both of its faces.

pub use crate::surface::Dicing;

/// Segments for an edge of this many pixels: a whole number from 1.
pub(super) fn segments(dicing: &Dicing, pixels: f32) -> f32 {
    (pixels / dicing.rate)
        .ceil()
        .clamp(1.0, dicing.max_segments as f32)
}

#[cfg(test)]
pub(super) mod tests {
    use crate::math::DAffine3;
    use crate::scene::{self, Projection};
    use crate::shade::camera::{Camera, CameraOptions};

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
}
