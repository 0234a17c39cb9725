//! A face's own axes, and rays within them.
//!
//! Boxes along a face's mean normal are thin slabs where boxes along the object's axes would be as thick as the face is
//! tilted. A ray is moved into the frame once per face. The map keeps lengths but for roundings, and `t` keeps its meaning.

use crate::math::{Bounds3, DVec3, Ray, Vec3};
use crate::surface::{SharedSamples, Surface};

/// A frame: z along a face's mean normal, x along its u.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    /// Unit vectors in the object's space.
    pub(super) axes: [Vec3; 3],
    /// Where its coordinates are zero.
    pub(super) centre: Vec3,
}

impl Frame {
    /// Of a face, by its border at all motion keys.
    pub(super) fn of_face(surface: &Surface, shared: &[SharedSamples], face: u32) -> Self {
        let (mut along_u, mut area) = (DVec3::ZERO, DVec3::ZERO);
        let mut bounds = Bounds3::EMPTY;
        for shared in shared {
            let first = shared.vertex(surface.base().vertex(face, 0)).as_dvec3();
            for k in 0..4 {
                let border = shared.walk(surface, face, k);
                let segments = (border.len() - 1) as f64;
                // The mean of the derivative by u is the mean of the far side less that of the near one.
                let weight = [0.0, 0.5, 0.0, -0.5][k as usize] / segments;
                let mut before = None;
                for p in border {
                    bounds = bounds.including(p);
                    let p = p.as_dvec3() - first;
                    if let Some(before) = before.replace(p) {
                        along_u += weight * (before + p);
                        // Whatever surface the border bounds, this is the integral of its normal.
                        area += before.cross(p);
                    }
                }
            }
        }
        let z = (area.try_normalize())
            .or_else(|| Some(along_u.try_normalize()?.any_orthonormal_vector()))
            .unwrap_or(DVec3::Z);
        let x = (along_u - along_u.dot(z) * z).normalize_or(z.any_orthonormal_vector());
        Self {
            axes: [x, z.cross(x), z].map(|axis| axis.as_vec3()),
            centre: if bounds.is_empty() {
                Vec3::ZERO
            } else {
                bounds.centre()
            },
        }
    }

    /// A vector of the object's space in the frame.
    #[inline(always)]
    pub(super) fn vector(&self, v: Vec3) -> Vec3 {
        let [x, y, z] = self.axes;
        Vec3::new(x.dot(v), y.dot(v), z.dot(v))
    }

    /// A point of the object's space in the frame.
    #[inline(always)]
    pub(super) fn point(&self, p: Vec3) -> Vec3 {
        self.vector(p - self.centre)
    }

    /// A vector of the frame in the object's space.
    pub(super) fn object_vector(&self, v: Vec3) -> Vec3 {
        let [x, y, z] = self.axes;
        v.x * x + v.y * y + v.z * z
    }

    /// The box along the object's axes around one of the frame. It is some roundings larger.
    pub(super) fn object_bounds(&self, bounds: &Bounds3) -> Bounds3 {
        if bounds.is_empty() {
            return Bounds3::EMPTY;
        }
        let [x, y, z] = self.axes;
        let half = 0.5 * bounds.extent();
        let centre = self.centre + self.object_vector(bounds.centre());
        let reach = half.x * x.abs() + half.y * y.abs() + half.z * z.abs();
        let size = bounds.min.abs().max(bounds.max.abs()).max_element();
        let slack = f32::EPSILON * (4.0 * centre.abs() + 16.0 * size);
        Bounds3::around(centre, reach + slack)
    }
}

/// A ray in a face's frame, made ready for boxes.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalRay {
    pub(super) origin: [f32; 3],
    /// One by the direction, whose smallest components are replaced by such as have an inverse.
    pub(super) inverse: [f32; 3],
    /// What rounding may move a plane.
    pub(super) slack: f32,
}

impl LocalRay {
    /// `reach` is the largest coordinate of what the ray may meet.
    #[inline(always)]
    pub(super) fn new(frame: &Frame, ray: &Ray, reach: f32) -> Self {
        let origin = frame.point(ray.origin).to_array();
        let d = frame.vector(ray.direction).to_array();
        let largest = |[x, y, z]: [f32; 3]| x.abs().max(y.abs()).max(z.abs());
        let least = largest(d) * (1.0 / (1_u64 << 40) as f32);
        let mut inverse = [0.0; 3];
        for (inverse, d) in inverse.iter_mut().zip(d) {
            *inverse = 1.0 / d.abs().max(least).copysign(d);
        }
        // In half units in the last place of the sizes involved: origin and vertices are moved into the frame by four
        // operations each, the direction by three; a plane's distance takes five more, and two keys are blended in three.
        let slack = 20.0 * f32::EPSILON * (largest(origin) + reach);
        Self {
            origin,
            inverse,
            // Embree's threads take numbers below the normal ones for zero.
            slack: slack + 64.0 * f32::MIN_POSITIVE,
        }
    }
}
