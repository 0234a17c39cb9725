//! Spheres and open cylinders under any affine map: ellipsoids and elliptic tubes, exactly.
//!
//! Rays, points and directions are taken to the space where the light has radius 1. A sphere is seen there as a
//! cone, whatever the map, and sampling it evenly and taking the direction back has a known density: if `w` is a
//! unit direction there and `L` the linear map, a piece of solid angle around `w` becomes `|det L| / |L w|^3`
//! times as large. For a map that only scales evenly that is 1 and the density is even in the world. Both shine
//! outward only, so a point inside sees no light.

use std::f32::consts::PI;
use std::f64::consts::PI as PI64;

use glam::{DMat3, Mat3};

use super::area::{Met, Sampled};
use super::distant::in_cone;
use crate::math::{Bounds3, DAffine3, DVec3, Frame, Ray, Vec2, Vec3};

/// An affine image of a unit shape around the origin.
#[derive(Debug, Clone, Copy)]
struct Placed {
    centre: Vec3,
    world_from_unit: Mat3,
    unit_from_world: Mat3,
    /// |det| of `world_from_unit`.
    det: f32,
    /// How far in unit space a point on the light may appear off it by rounding.
    slack: f32,
}

impl Placed {
    fn new(scale: DVec3, world_from_light: &DAffine3) -> Self {
        let matrix = world_from_light.matrix3 * DMat3::from_diagonal(scale);
        let inverse = matrix.inverse();
        let centre = world_from_light.translation;
        let shrink = inverse
            .x_axis
            .length()
            .max(inverse.y_axis.length())
            .max(inverse.z_axis.length());
        let slack = 4e-6 + 4e-7 * centre.abs().max_element() * shrink;
        Self {
            centre: centre.as_vec3(),
            world_from_unit: matrix.as_mat3(),
            unit_from_world: inverse.as_mat3(),
            det: matrix.determinant().abs() as f32,
            slack: slack.min(0.01) as f32,
        }
    }

    fn unit_point(&self, p: Vec3) -> Vec3 {
        self.unit_from_world * (p - self.centre)
    }

    /// The nearest point within the ray where it meets the unit shape: how far along, and the point in unit space.
    /// The shape is the unit sphere, drawn out along each axis where `across` is 0 instead of 1, as far as `holds`.
    fn nearest(
        &self,
        ray: &Ray,
        across: Vec3,
        holds: impl Fn(Vec3) -> bool,
    ) -> Option<(f32, Vec3)> {
        let from = self.unit_point(ray.origin);
        let direction = self.unit_from_world * ray.direction;
        roots(across * from, across * direction, self.slack)?
            .into_iter()
            .map(|t| (t, from + t * direction))
            .find(|&(t, at)| t > ray.t_min && t < ray.t_max && holds(at))
    }

    /// Outward stays outward under the inverse transpose, mirrored or not.
    fn normal(&self, unit: Vec3) -> Vec3 {
        (self.unit_from_world.transpose() * unit).normalize_or(Vec3::Z)
    }
}

/// A spherical light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ellipsoid {
    placed: Placed,
    area: f32,
}

impl Ellipsoid {
    /// `radius` above 0.
    pub(super) fn new(radius: f64, world_from_light: &DAffine3) -> Self {
        let matrix = world_from_light.matrix3 * radius;
        Self {
            placed: Placed::new(DVec3::splat(radius), world_from_light),
            area: ellipsoid_area(&matrix) as f32,
        }
    }

    pub(super) fn area(&self) -> f32 {
        self.area
    }

    pub(super) fn bounds(&self) -> Bounds3 {
        let m = self.placed.world_from_unit;
        let reach =
            (m.x_axis * m.x_axis + m.y_axis * m.y_axis + m.z_axis * m.z_axis).map(f32::sqrt);
        Bounds3::around(self.placed.centre, reach)
    }

    pub(super) fn intersect(&self, ray: &Ray) -> Option<Met> {
        let (t, at) = self.placed.nearest(ray, Vec3::ONE, |_| true)?;
        let n = at.normalize_or(Vec3::Y);
        Some(Met {
            t,
            uv: Vec2::new(turn(n.z.atan2(n.x)), n.y.clamp(-1.0, 1.0).acos() / PI),
            normal: self.placed.normal(n),
        })
    }

    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<Sampled> {
        let unit = self.placed.unit_point(p);
        let (d2, versine) = seen(unit)?;
        let d = d2.sqrt();
        let frame = Frame::around(-unit / d);
        let w = in_cone(&frame, versine, u);
        let stretched = self.placed.world_from_unit * w;
        let stretch = stretched.length();
        // The nearer of the two points in this direction
        let down = u[0] * versine;
        let sine2 = down * (2.0 - down);
        let t = d * (1.0 - down) - (1.0 - d2 * sine2).max(0.0).sqrt();
        let pdf = stretch.powi(3) / (self.placed.det * 2.0 * PI * versine);
        // An infinite density would read as a light without extent.
        (pdf > 0.0 && pdf.is_finite()).then_some(Sampled {
            wi: stretched / stretch,
            distance: t.max(0.0) * stretch,
            pdf,
            uv: Vec2::ZERO,
        })
    }

    pub(super) fn pdf(&self, p: Vec3, wi: Vec3) -> f32 {
        let Some((_, versine)) = seen(self.placed.unit_point(p)) else {
            return 0.0;
        };
        let shrink = (self.placed.unit_from_world * wi).length();
        1.0 / (shrink.powi(3) * self.placed.det * 2.0 * PI * versine)
    }
}

/// Squared distance from the unit sphere's centre, and 1 - cos of the half angle of the cone that it fills; none
/// from inside.
fn seen(p: Vec3) -> Option<(f32, f32)> {
    let d2 = p.length_squared();
    (d2 > 1.0 && d2.is_finite()).then(|| {
        let sine2 = 1.0 / d2;
        (d2, sine2 / (1.0 + (1.0 - sine2).max(0.0).sqrt()))
    })
}

/// A tube along the unit space's X axis, x in -1..1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tube {
    placed: Placed,
    area: f32,
}

impl Tube {
    /// `radius` and `length` above 0.
    pub(super) fn new(radius: f64, length: f64, world_from_light: &DAffine3) -> Self {
        let scale = DVec3::new(0.5 * length, radius, radius);
        let m = world_from_light.matrix3 * DMat3::from_diagonal(scale);
        // The trapezoidal rule on a periodic function: exact to rounding for any sane ellipse.
        const N: u32 = 512;
        let around: f64 = (0..N)
            .map(|i| {
                let (sin, cos) = (2.0 * PI64 * f64::from(i) / f64::from(N)).sin_cos();
                m.x_axis.cross(cos * m.z_axis - sin * m.y_axis).length()
            })
            .sum();
        Self {
            placed: Placed::new(scale, world_from_light),
            area: (2.0 * around * 2.0 * PI64 / f64::from(N)) as f32,
        }
    }

    pub(super) fn area(&self) -> f32 {
        self.area
    }

    pub(super) fn bounds(&self) -> Bounds3 {
        let m = self.placed.world_from_unit;
        let reach = m.x_axis.abs() + (m.y_axis * m.y_axis + m.z_axis * m.z_axis).map(f32::sqrt);
        Bounds3::around(self.placed.centre, reach)
    }

    pub(super) fn intersect(&self, ray: &Ray) -> Option<Met> {
        let across = Vec3::new(0.0, 1.0, 1.0);
        let (t, at) = self.placed.nearest(ray, across, |at| at.x.abs() <= 1.0)?;
        let n = (across * at).normalize_or(Vec3::Y);
        Some(Met {
            t,
            uv: Vec2::new(0.5 + 0.5 * at.x, turn(n.z.atan2(n.y))),
            normal: self.placed.normal(n),
        })
    }

    /// Evenly along the tube and over the angles that face `p`.
    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<Sampled> {
        let unit = self.placed.unit_point(p);
        let half = half_arc(unit)?;
        let angle = unit.z.atan2(unit.y) + (2.0 * u[1] - 1.0) * half;
        let uv = Vec2::new(u[0], turn(angle));
        let (wi, distance, pdf) = self.towards(p, half, 2.0 * u[0] - 1.0, angle);
        (pdf > 0.0 && pdf.is_finite()).then_some(Sampled {
            wi,
            distance,
            pdf,
            uv,
        })
    }

    pub(super) fn pdf(&self, p: Vec3, uv: Vec2) -> f32 {
        half_arc(self.placed.unit_point(p)).map_or(0.0, |half| {
            self.towards(p, half, 2.0 * uv.x - 1.0, 2.0 * PI * uv.y).2
        })
    }

    /// Direction, distance and density of the point at `x` and `angle`; density 0 if it faces away.
    fn towards(&self, p: Vec3, half: f32, x: f32, angle: f32) -> (Vec3, f32, f32) {
        let m = &self.placed.world_from_unit;
        let (sin, cos) = angle.sin_cos();
        let to = *m * Vec3::new(x, cos, sin) - (p - self.placed.centre);
        let distance = to.length();
        let wi = to / distance;
        // Area per (x, angle) and the normal, in one
        let stretch = m.x_axis.cross(cos * m.z_axis - sin * m.y_axis).length();
        let cosine = -wi.dot(self.placed.normal(Vec3::new(0.0, cos, sin)));
        let pdf = if cosine > 0.0 {
            distance * distance / (cosine * stretch * 4.0 * half)
        } else {
            0.0
        };
        (wi, distance, pdf)
    }
}

/// Half the arc of the unit circle around X that faces `p`, radians; none from inside.
fn half_arc(p: Vec3) -> Option<f32> {
    let r = p.y.hypot(p.z);
    (r > 1.0 && r.is_finite()).then(|| ((r - 1.0) * (r + 1.0)).sqrt().atan())
}

/// Where `from + t direction` meets the unit sphere around the origin, ascending. After Haines, Günther,
/// Akenine-Möller 2019, "Precision Improvements for Ray/Sphere Intersection". A start within `slack` of the sphere
/// counts as on it: one root is 0.
fn roots(from: Vec3, direction: Vec3, slack: f32) -> Option<[f32; 2]> {
    let a = direction.length_squared();
    if a == 0.0 {
        return None;
    }
    let b = -from.dot(direction);
    let closest = from + (b / a) * direction;
    let rest = 1.0 - closest.length_squared();
    if rest < 0.0 {
        return None;
    }
    let r = from.length();
    let c = (r - 1.0) * (r + 1.0);
    if c.abs() <= slack {
        let other = 2.0 * b / a;
        return Some([other.min(0.0), other.max(0.0)]);
    }
    let root = (a * rest).sqrt();
    let q = if b >= 0.0 { b + root } else { b - root };
    let (t0, t1) = (c / q, q / a);
    Some([t0.min(t1), t0.max(t1)])
}

/// An angle in radians as a part of the full turn, 0..1.
fn turn(angle: f32) -> f32 {
    (angle / (2.0 * PI)).rem_euclid(1.0).min(1.0)
}

/// The area of the image of the unit sphere: the mean of `|det M| |M^-T n|` over it, exact for even scales and to
/// about 1e-5 for others.
fn ellipsoid_area(m: &DMat3) -> f64 {
    let normals = m.inverse().transpose();
    const N: u32 = 128;
    let mut sum = 0.0;
    for i in 0..N {
        let z = (2.0 * f64::from(i) + 1.0) / f64::from(N) - 1.0;
        let r = (1.0 - z * z).sqrt();
        for j in 0..N {
            let (sin, cos) = (2.0 * PI64 * f64::from(j) / f64::from(N)).sin_cos();
            sum += (normals * DVec3::new(r * cos, r * sin, z)).length();
        }
    }
    4.0 * PI64 * m.determinant().abs() * sum / f64::from(N * N)
}
