//! UsdLuxShapingAPI: how an area light's radiance falls off away from its axis.
//!
//! The axis is the image of the light's local -Z in the world, and angles are measured in the world. As UsdLux
//! has it, the cone is 1 inside `(1 - softness) x angle`, 0 outside `angle` and a smoothstep of the angle between,
//! and the focus leads from the tint to white by `cos^focus`. IES profiles are not read.

use crate::math::Vec3;
use crate::scene;

/// A shaping in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shaping {
    axis: Vec3,
    focus: f32,
    tint: Vec3,
    /// Radians, where the light is still full and where it ends; `None`: no cone.
    cone: Option<[f32; 2]>,
}

impl Shaping {
    /// `axis` is the light's -Z in the world, of length 1.
    pub(super) fn new(shaping: &scene::Shaping, axis: Vec3) -> Self {
        let end = shaping.cone_angle.max(0.0).to_radians();
        let full = (1.0 - shaping.cone_softness.clamp(0.0, 1.0)) * end;
        Self {
            axis,
            focus: shaping.focus.max(0.0),
            tint: shaping.focus_tint.max(Vec3::ZERO),
            cone: (shaping.cone_angle < 90.0).then_some([full, end]),
        }
    }

    /// What the radiance in direction `out`, a unit vector away from the light, is multiplied with.
    pub(super) fn factor(&self, out: Vec3) -> Vec3 {
        let cosine = self.axis.dot(out).clamp(-1.0, 1.0);
        let mut factor = Vec3::ONE;
        if self.focus > 0.0 {
            let f = cosine.max(0.0).powf(self.focus);
            factor = self.tint + f * (Vec3::ONE - self.tint);
        }
        if let Some([full, end]) = self.cone {
            // The cosine alone is blunt at small angles.
            let angle = self.axis.cross(out).length().atan2(cosine);
            if angle > end {
                return Vec3::ZERO;
            }
            if angle > full {
                let x = (angle - full) / (end - full);
                factor *= 1.0 - x * x * (3.0 - 2.0 * x);
            }
        }
        factor
    }

    /// Roughly the part of a hemisphere's light that is left, for choosing among lights.
    pub(super) fn left(&self) -> f32 {
        let cone = self.cone.map_or(1.0, |[full, end]| {
            1.0 - (0.5 * (full + end)).min(1.5).cos().powi(2)
        });
        cone.max(1e-3)
    }
}
