use super::{Affine3A, Vec3};

/// A ray and the open interval of it that is asked about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where `t` is 0.
    pub origin: Vec3,
    /// Any finite length but 0; `t` counts in it.
    pub direction: Vec3,
    /// Hits must lie beyond this, at least 0.
    pub t_min: f32,
    /// Hits must lie before this; infinity for all.
    pub t_max: f32,
    /// 0 where the shutter opens, 1 where it closes.
    pub time: f32,
}

impl Ray {
    /// The whole ray from `origin` on.
    pub fn new(origin: Vec3, direction: Vec3, time: f32) -> Self {
        Self {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
            time,
        }
    }

    /// The point at `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }

    /// The same ray in another space; `t` keeps its meaning because the direction is not normalised.
    #[must_use]
    pub fn transformed(&self, to_from_here: &Affine3A) -> Self {
        Self {
            origin: to_from_here.transform_point3(self.origin),
            direction: to_from_here.transform_vector3(self.direction),
            ..*self
        }
    }
}
