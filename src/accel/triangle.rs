//! A watertight test of a ray and a triangle: Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", Journal of
//! Computer Graphics Techniques 2(1), 2013.
//!
//! Translated to the ray's origin and sheared so that the ray runs along the largest axis of its direction, the test is
//! one of the origin against a triangle in the plane: by three edge functions, whose signs two triangles at an edge
//! see alike since both compute the same two products. What falls on an edge counts for both sides; where an edge
//! function is 0 in single precision, double precision decides, in which the products are exact.
//!
//! The nodes above must be as careful: a box's far distance is enlarged by what its computation may round (Ize, "Robust
//! BVH Ray Traversal", 2013).

use crate::math::{Bounds3, Ray, Vec3};

/// A ray prepared for many tests.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sheared {
    origin: Vec3,
    /// Axes: `k[2]` is the largest of the direction, the others follow so that handedness is kept.
    k: [usize; 3],
    /// Shear along the first two, scale along the third.
    s: [f32; 3],
    inverse: Vec3,
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TriangleHit {
    pub(super) t: f32,
    /// Barycentric weights of the second and the third corner.
    pub(super) u: f32,
    pub(super) v: f32,
}

impl Sheared {
    pub(super) fn new(ray: &Ray) -> Self {
        let d = ray.direction;
        let kz = d.abs().max_position();
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if d[kz] < 0.0 {
            (kx, ky) = (ky, kx);
        }
        Self {
            origin: ray.origin,
            k: [kx, ky, kz],
            s: [d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]],
            inverse: d.recip(),
        }
    }

    /// The hit with `t_min < t < t_max`, from either side. A triangle that the ray sees edge-on is not hit: its
    /// neighbours are.
    pub(super) fn triangle(
        &self,
        corners: [Vec3; 3],
        t_min: f32,
        t_max: f32,
    ) -> Option<TriangleHit> {
        let [kx, ky, kz] = self.k;
        let [sx, sy, sz] = self.s;
        let [a, b, c] = corners.map(|p| p - self.origin);
        let x = |p: Vec3| p[kx] - sx * p[kz];
        let y = |p: Vec3| p[ky] - sy * p[kz];
        let hit = origin_in(
            [x(a), x(b), x(c)],
            [y(a), y(b), y(c)],
            [a[kz], b[kz], c[kz]].map(|z| sz * z),
        )?;
        // Also false for what is not a number.
        (hit.t > t_min && hit.t < t_max).then_some(hit)
    }

    /// Where the ray enters a box, if it meets it between `t_min` and `t_max`. Never misses a box that holds a
    /// triangle which [`triangle`](Self::triangle) hits there.
    pub(super) fn enters(&self, bounds: &Bounds3, t_min: f32, t_max: f32) -> Option<f32> {
        // 1 + 2 gamma(3), of two subtractions' and products' roundings.
        const FAR: f32 = 1.0 + 4.0 * f32::EPSILON;
        let (mut near, mut far) = (t_min, t_max);
        for axis in 0..3 {
            let inverse = self.inverse[axis];
            let (first, last) = if inverse.is_sign_negative() {
                (bounds.max[axis], bounds.min[axis])
            } else {
                (bounds.min[axis], bounds.max[axis])
            };
            // A ray within the plane of a side has 0 times infinity here, which decides nothing: `f32::max` and
            // `f32::min` drop it.
            near = near.max((first - self.origin[axis]) * inverse);
            far = far.min((last - self.origin[axis]) * inverse * FAR);
        }
        (near <= far).then_some(near)
    }
}

/// The test in the plane: whether the origin is in the triangle of corners at `x` and `y`, and the mean of `t` there.
pub(super) fn origin_in(
    [ax, bx, cx]: [f32; 3],
    [ay, by, cy]: [f32; 3],
    t: [f32; 3],
) -> Option<TriangleHit> {
    // Edge functions, the paper's U, V, W.
    let mut u = cx * by - cy * bx;
    let mut v = ax * cy - ay * cx;
    let mut w = bx * ay - by * ax;
    if u == 0.0 || v == 0.0 || w == 0.0 {
        let exact = |a: f32, b: f32, c: f32, d: f32| {
            (f64::from(a) * f64::from(b) - f64::from(c) * f64::from(d)) as f32
        };
        u = exact(cx, by, cy, bx);
        v = exact(ax, cy, ay, cx);
        w = exact(bx, ay, by, ax);
    }
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let det = u + v + w;
    if det == 0.0 {
        return None;
    }
    let scaled = u * t[0] + v * t[1] + w * t[2];
    Some(TriangleHit {
        t: scaled / det,
        u: v / det,
        v: w / det,
    })
}
