//! Rectangles and disks under any affine map: parallelograms and ellipses, exactly.
//!
//! Both are `centre + a x + b y`; the rectangle has `|a|, |b| <= 1`, the disk `a^2 + b^2 <= 1`. A rectangle that the
//! map leaves rectangular is sampled by solid angle (Ureña, Fajardo, King 2013, "An Area-Preserving
//! Parametrization for Spherical Rectangles", in double precision); a small or grazing one, and everything else,
//! by area, which is as good from afar.

use std::f64::consts::PI;

use glam::DVec2;

use super::area::{Met, Sampled};
use crate::math::{Bounds3, DAffine3, DVec3, Ray, Vec2, Vec3, concentric_disk};

/// A flat light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Planar {
    round: bool,
    centre: Vec3,
    /// Half the edges, or the images of the radii along X and Y.
    x: Vec3,
    y: Vec3,
    /// Their lengths.
    half: [f32; 2],
    /// `a = to_a . (p - centre)`, likewise `b`, for points of the plane.
    to_a: Vec3,
    to_b: Vec3,
    /// Unit, to the side that shines.
    front: Vec3,
    area: f32,
    /// The edges are orthogonal.
    rectangular: bool,
}

impl Planar {
    /// `half`: half the width and height, or the radius twice; above 0. The front is the image of local -Z.
    pub(super) fn new(round: bool, half: [f64; 2], world_from_light: &DAffine3) -> Self {
        let m = world_from_light.matrix3;
        let (x, y) = (half[0] * m.x_axis, half[1] * m.y_axis);
        let cross = x.cross(y);
        let normal = cross.normalize();
        // A mirroring map turns the normal of the edges, but not the side on which -Z lies.
        let front = if normal.dot(m.z_axis) > 0.0 {
            -normal
        } else {
            normal
        };
        let (to_a, to_b) = (y.cross(normal), normal.cross(x));
        Self {
            round,
            centre: world_from_light.translation.as_vec3(),
            x: x.as_vec3(),
            y: y.as_vec3(),
            half: [x, y].map(|edge| edge.as_vec3().length()),
            to_a: (to_a / to_a.dot(x)).as_vec3(),
            to_b: (to_b / to_b.dot(y)).as_vec3(),
            front: front.as_vec3(),
            area: (cross.length() * if round { PI } else { 4.0 }) as f32,
            rectangular: !round && x.dot(y).abs() < 1e-6 * cross.length(),
        }
    }

    pub(super) fn area(&self) -> f32 {
        self.area
    }

    pub(super) fn is_round(&self) -> bool {
        self.round
    }

    /// Unit, to the side that shines.
    pub(super) fn front(&self) -> Vec3 {
        self.front
    }

    /// Of a rectangle: where its parameters are (0, 0), (1, 0), (1, 1), (0, 1).
    pub(super) fn corners(&self) -> [Vec3; 4] {
        let at = |a: f32, b: f32| self.centre + a * self.x + b * self.y;
        [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]
    }

    pub(super) fn bounds(&self) -> Bounds3 {
        let reach = if self.round {
            (self.x * self.x + self.y * self.y).map(f32::sqrt)
        } else {
            self.x.abs() + self.y.abs()
        };
        Bounds3::around(self.centre, reach)
    }

    /// Meets a disk: rectangles are met as triangles.
    #[inline]
    pub(super) fn intersect(&self, ray: &Ray) -> Option<Met> {
        let from = ray.origin - self.centre;
        let (height, speed) = (self.front.dot(from), self.front.dot(ray.direction));
        // Within rounding of the plane: the ray starts on the light, and does not meet it again.
        let size = ray.origin.abs().max_element() + self.centre.abs().max_element();
        if height.abs() <= 4e-7 * size || speed == 0.0 {
            return None;
        }
        let t = -height / speed;
        if !(t > ray.t_min && t < ray.t_max) {
            return None;
        }
        let at = from + t * ray.direction;
        let (a, b) = (self.to_a.dot(at), self.to_b.dot(at));
        (a * a + b * b <= 1.0).then(|| Met {
            t,
            uv: Vec2::new(0.5 + 0.5 * a, 0.5 + 0.5 * b).clamp(Vec2::ZERO, Vec2::ONE),
            normal: self.front,
        })
    }

    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<Sampled> {
        let from = p - self.centre;
        let height = self.front.dot(from);
        if height <= 0.0 {
            return None;
        }
        let spherical = self.spherical(from);
        let (a, b) = match &spherical {
            Some(s) => s.sample(u),
            None if self.round => concentric_disk(u).into(),
            None => (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0),
        };
        let to = a * self.x + b * self.y - from;
        let distance = to.length();
        let wi = to / distance;
        let pdf = match &spherical {
            Some(s) => (1.0 / s.solid_angle) as f32,
            None => self.area_pdf(height, wi),
        };
        (pdf > 0.0 && pdf.is_finite() && distance > 0.0).then(|| Sampled {
            wi,
            distance,
            pdf,
            uv: Vec2::new(0.5 + 0.5 * a, 0.5 + 0.5 * b),
        })
    }

    pub(super) fn pdf(&self, p: Vec3, wi: Vec3) -> f32 {
        let from = p - self.centre;
        let height = self.front.dot(from);
        if height <= 0.0 || self.front.dot(wi) >= 0.0 {
            return 0.0;
        }
        match self.spherical(from) {
            Some(s) => (1.0 / s.solid_angle) as f32,
            None => self.area_pdf(height, wi),
        }
    }

    /// distance^2 / (area cos), with distance = height / cos.
    fn area_pdf(&self, height: f32, wi: Vec3) -> f32 {
        let cosine = -self.front.dot(wi);
        if cosine > 0.0 {
            (height / cosine).powi(2) / (cosine * self.area)
        } else {
            0.0
        }
    }

    /// The spherical rectangle seen from `centre + from`, if it is one and worth it.
    fn spherical(&self, from: Vec3) -> Option<SphericalRectangle> {
        if !self.rectangular {
            return None;
        }
        let [lx, ly] = self.half;
        let height = self.front.dot(from);
        // Seen from very flat the angles of the formula coincide; from afar area sampling is as good.
        if height < 1e-4 * lx.max(ly) || self.area < 1e-3 * height * height {
            return None;
        }
        let half = DVec2::new(f64::from(lx), f64::from(ly));
        let at = DVec3::new(
            f64::from(self.x.dot(from) / lx),
            f64::from(self.y.dot(from) / ly),
            f64::from(height),
        );
        SphericalRectangle::new(half, at)
    }
}

/// The paper's symbols: the rectangle x0..x1, y0..y1 in the plane z0 < 0 seen from the origin.
struct SphericalRectangle {
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
    z0: f64,
    b0: f64,
    b1: f64,
    k: f64,
    solid_angle: f64,
}

impl SphericalRectangle {
    /// A rectangle of these half edges around the origin, seen from `p` (z is the height above it).
    fn new(half: DVec2, p: DVec3) -> Option<Self> {
        let (x0, x1) = (-half.x - p.x, half.x - p.x);
        let (y0, y1) = (-half.y - p.y, half.y - p.y);
        let z0 = -p.z;
        // Components of the planes' normals n0 .. n3 along z; n0 . n1 and so on are their products.
        // The squares of what were single numbers stay in the range of double ones: no need of `hypot`'s care.
        let sine = |a: f64| a / (a * a + z0 * z0).sqrt();
        let [n0, n1, n2, n3] = [-y0, x1, y1, -x0].map(sine);
        let angle = |a: f64, b: f64| (-a * b).clamp(-1.0, 1.0).acos();
        let k = 2.0 * PI - angle(n2, n3) - angle(n3, n0);
        let solid_angle = angle(n0, n1) + angle(n1, n2) - k;
        (solid_angle > 1e-4).then_some(Self {
            x0,
            x1,
            y0,
            y1,
            z0,
            b0: n0,
            b1: n2,
            k,
            solid_angle,
        })
    }

    /// A point of the rectangle, -1..1 each way.
    fn sample(&self, u: [f32; 2]) -> (f32, f32) {
        let (u, v) = (f64::from(u[0]), f64::from(u[1]));
        let au = u * self.solid_angle + self.k;
        let fu = (au.cos() * self.b0 - self.b1) / au.sin();
        let cu = ((fu * fu + self.b0 * self.b0).sqrt().recip().copysign(fu)).clamp(-1.0, 1.0);
        let xu = (-(cu * self.z0) / (1.0 - cu * cu).max(1e-24).sqrt()).clamp(self.x0, self.x1);
        let d2 = xu * xu + self.z0 * self.z0;
        let h0 = self.y0 / (d2 + self.y0 * self.y0).sqrt();
        let h1 = self.y1 / (d2 + self.y1 * self.y1).sqrt();
        let hv = h0 + v * (h1 - h0);
        let hv2 = hv * hv;
        let yv = if hv2 < 1.0 - 1e-12 {
            (hv * d2.sqrt() / (1.0 - hv2).sqrt()).clamp(self.y0, self.y1)
        } else {
            self.y1
        };
        let (a, b) = (
            2.0 * (xu - self.x0) / (self.x1 - self.x0) - 1.0,
            2.0 * (yv - self.y0) / (self.y1 - self.y0) - 1.0,
        );
        (a as f32, b as f32)
    }
}
