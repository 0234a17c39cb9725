//! UsdGeomCamera.

use openusd::usd::Prim;

use super::value;
use super::walk::Reader;
use crate::math::Vec2;
use crate::scene::{Camera, Projection};

impl Reader {
    /// Everything of a camera but its place, which is empty; `None`, with a warning, for one that sees nothing.
    pub(super) fn camera(&mut self, prim: &Prim) -> Option<Camera> {
        let path = prim.path().as_str().to_owned();
        let float =
            |name: &str, default: f32| self.number(prim, name).map_or(default, |v| v as f32);
        let focal_length = float("focalLength", 50.0);
        let aperture = Vec2::new(
            float("horizontalAperture", 20.955),
            float("verticalAperture", 15.2908),
        );
        let aperture_offset = Vec2::new(
            float("horizontalApertureOffset", 0.0),
            float("verticalApertureOffset", 0.0),
        );
        let f_stop = float("fStop", 0.0);
        let focus_distance = float("focusDistance", 0.0);
        let stops = float("exposure", 0.0);
        let time = float("exposure:time", 1.0);
        let iso = float("exposure:iso", 100.0);
        let exposure_stop = float("exposure:fStop", 1.0);
        let responsivity = float("exposure:responsivity", 1.0);
        let factor = time * iso / 100.0 * responsivity / (exposure_stop * exposure_stop);
        let shutter = [
            self.number(prim, "shutter:open").unwrap_or(0.0),
            self.number(prim, "shutter:close").unwrap_or(0.0),
        ];
        let projection = match self.word(prim, "projection").as_deref() {
            Some("orthographic") => Projection::Orthographic,
            _ => Projection::Perspective,
        };
        let clipping_range = self
            .value(prim, "clippingRange")
            .and_then(value::vec2)
            .unwrap_or(Vec2::new(1.0, 1e6));
        let planes = self.value(prim, "clippingPlanes").and_then(value::floats);
        if planes.is_some_and(|p| !p.values.is_empty()) {
            self.warn("clipping planes", || {
                format!("{path}: clippingPlanes are not honoured")
            });
        }
        let all = [focal_length, aperture.x, aperture.y];
        let usable = all.iter().all(|v| v.is_finite() && *v > 0.0)
            && aperture_offset.is_finite()
            && clipping_range.is_finite()
            && f_stop.is_finite()
            && focus_distance.is_finite()
            && shutter.iter().all(|v| v.is_finite());
        if !usable {
            self.warn("unusable camera", || {
                format!("{path}: focal length {focal_length} and aperture {aperture} make no camera; it is left out")
            });
            return None;
        }
        let exposure = if factor.is_finite() && factor > 0.0 {
            stops + factor.log2()
        } else {
            stops
        };
        Some(Camera {
            path,
            world_from_camera: Vec::new(),
            projection,
            focal_length,
            aperture,
            aperture_offset,
            clipping_range,
            f_stop,
            focus_distance,
            shutter,
            exposure,
        })
    }
}
