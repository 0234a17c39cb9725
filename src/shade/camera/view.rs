//! What dicing asks of a camera.

use super::Camera;
use crate::math::{Vec2, Vec3};
use crate::scene::Projection;
use crate::surface::View;

impl View for Camera {
    fn position(&self) -> Vec3 {
        Camera::position(self)
    }

    fn pixels_per_unit(&self, p: Vec3) -> f32 {
        Camera::pixels_per_unit(self, p)
    }

    /// In perspective by angles: how far from the cone around the picture, in twice the cone's opening. For a camera
    /// that moves, where it is nearest when the shutter opens, when it closes, and at the frame itself.
    fn outside(&self, centre: Vec3, radius: f32) -> f32 {
        [0.0, self.frame_time, 1.0]
            .into_iter()
            .map(|time| self.outside_at(centre, radius, time))
            .fold(f32::INFINITY, f32::min)
    }
}

impl Camera {
    /// All that dicing follows from, as text: cameras of one text dice alike.
    pub fn view_key(&self) -> String {
        let Self {
            projection,
            resolution,
            pixel_aspect,
            motion,
            window,
            per_pixel,
            near,
            far: _,
            lens: _,
            frame_time,
            exposure: _,
        } = self;
        format!(
            "{projection:?} {resolution:?} {pixel_aspect} {motion:?} {window:?} {per_pixel:?} {near} {frame_time}"
        )
    }

    fn outside_at(&self, centre: Vec3, radius: f32, time: f32) -> f32 {
        let from_world = self.camera_from_world(time);
        let p = from_world.transform_point3(centre.as_dvec3()).as_vec3();
        // The longest of the axes' scales, so that nothing seems smaller than it is.
        let m = from_world.matrix3;
        let scale = m
            .x_axis
            .length()
            .max(m.y_axis.length())
            .max(m.z_axis.length());
        let radius = radius * scale as f32;
        let [low, high] = self.window;
        let middle = 0.5 * (low + high);
        match self.projection {
            Projection::Orthographic => {
                let beyond = ((p.truncate() - middle).abs() - 0.5 * (high - low)).max(Vec2::ZERO);
                (beyond.length() - radius).max(0.0) / (high.x - low.x)
            }
            Projection::Perspective => {
                let distance = p.length();
                if distance <= radius {
                    return 0.0;
                }
                let axis = middle.extend(-1.0);
                let half = [
                    low,
                    high,
                    Vec2::new(low.x, high.y),
                    Vec2::new(high.x, low.y),
                ]
                .into_iter()
                .map(|corner| axis.angle_between(corner.extend(-1.0)))
                .fold(0.0, f32::max);
                let beyond = axis.angle_between(p) - half - (radius / distance).asin();
                beyond.max(0.0) / (2.0 * half)
            }
        }
    }
}
