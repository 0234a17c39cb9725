//! Between motion keys.

use crate::math::Vec3;

/// A time between two motion keys.
pub(super) struct Moment {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) weights: [f32; 2],
}

impl Moment {
    #[inline]
    pub(super) fn new(keys: u32, time: f32) -> Self {
        let last = keys as usize - 1;
        let at = time.clamp(0.0, 1.0) * last as f32;
        let from = (at as usize).min(last.saturating_sub(1));
        let fraction = at - from as f32;
        Self {
            from,
            to: (from + 1).min(last),
            weights: [1.0 - fraction, fraction],
        }
    }

    /// Each rounding of this grows with `a` and with `b`: between boxes lies a box that holds what lies between their
    /// contents.
    pub(super) fn between(&self, a: Vec3, b: Vec3) -> Vec3 {
        if self.from == self.to {
            a
        } else {
            self.weights[0] * a + self.weights[1] * b
        }
    }
}
