//! Light from infinity: one direction, or a cone of them with uniform radiance.
//!
//! UsdLux divides by the projected solid angle of the cone if `normalize` is on: for a half angle `h` up to a
//! right angle that is `pi sin^2 h`, beyond it `pi (2 - sin^2 h)`, and 1 if the angle is 0. So with `normalize` on
//! the colour is the irradiance on a surface that faces the light; with `normalize` off it is the radiance of the
//! cone, except that for an angle of 0, where no radiance is finite, it still is the irradiance.

use std::f32::consts::{FRAC_PI_2, PI};

use crate::math::{DAffine3, Frame, Vec3};

/// A distant light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distant {
    /// Towards the light.
    frame: Frame,
    /// Radiance; irradiance if `cone` is `None`.
    pub(super) radiance: Vec3,
    cone: Option<Cone>,
    /// On a surface that faces it.
    pub(super) irradiance: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Cone {
    /// Half angle, radians.
    half: f32,
    sin2: f32,
    /// 1 - cos(half), without cancellation.
    versine: f32,
}

impl Distant {
    /// `angle` is the full opening in degrees.
    pub(super) fn new(
        angle: f32,
        color: Vec3,
        normalize: bool,
        world_from_light: &DAffine3,
    ) -> Self {
        let half = (0.5 * angle.max(0.0)).min(180.0).to_radians();
        let axis = world_from_light.matrix3.z_axis.normalize().as_vec3();
        let sin2 = half.sin().powi(2);
        let projected = match half {
            0.0 => 1.0,
            _ if half <= FRAC_PI_2 => PI * sin2,
            _ => PI * (2.0 - sin2),
        };
        let irradiance = if normalize { color } else { color * projected };
        // A cone below a microradian is one direction: its density would leave the range of the numbers.
        let cone = (half > 1e-6).then(|| Cone {
            half,
            sin2,
            versine: 2.0 * (0.5 * half).sin().powi(2),
        });
        let radiance = match cone {
            None => irradiance,
            Some(_) if normalize => color / projected,
            Some(_) => color,
        };
        Self {
            frame: Frame::around(axis.normalize()),
            radiance,
            cone,
            irradiance,
        }
    }

    /// A direction towards the light and its density; infinite if there is but one.
    pub(super) fn sample(&self, u: [f32; 2]) -> (Vec3, f32) {
        let Some(cone) = self.cone else {
            return (self.frame.normal, f32::INFINITY);
        };
        let wi = in_cone(&self.frame, cone.versine, u);
        (wi, 1.0 / (2.0 * PI * cone.versine))
    }

    /// The density of `wi`, a unit vector; 0 outside the cone and for a single direction.
    pub(super) fn pdf(&self, wi: Vec3) -> f32 {
        let Some(cone) = self.cone else { return 0.0 };
        let cosine = self.frame.normal.dot(wi);
        // The cosine of the sun's half angle differs from 1 by some hundred ulps: compare sines instead.
        let inside = if cone.half <= FRAC_PI_2 {
            cosine > 0.0 && self.frame.normal.cross(wi).length_squared() <= cone.sin2
        } else {
            cosine >= 1.0 - cone.versine
        };
        if inside {
            1.0 / (2.0 * PI * cone.versine)
        } else {
            0.0
        }
    }
}

/// A direction evenly distributed in the cone around the frame's normal whose half angle has this versine
/// (1 - cos).
pub(super) fn in_cone(frame: &Frame, versine: f32, u: [f32; 2]) -> Vec3 {
    let down = u[0] * versine;
    let sine = (down * (2.0 - down)).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    frame.world_from_local(Vec3::new(sine * cos, sine * sin, 1.0 - down))
}
