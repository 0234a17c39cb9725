//! Between motion keys.

use super::simd::Lanes;
use crate::math::Vec3;

/// A time between two motion keys.
pub(super) struct Moment {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) weights: [f32; 2],
}

impl Moment {
    /// Where nothing moves.
    pub(super) const STILL: Self = Self {
        from: 0,
        to: 0,
        weights: [1.0, 0.0],
    };

    #[inline]
    pub(super) fn new(keys: u32, time: f32) -> Self {
        if keys == 1 {
            return Self::STILL;
        }
        let last = keys as usize - 1;
        let at = time.clamp(0.0, 1.0) * last as f32;
        let from = (at as usize).min(last - 1);
        let fraction = at - from as f32;
        Self {
            from,
            to: from + 1,
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

    /// [`Self::between`] lane by lane.
    #[inline(always)]
    pub(super) fn between_lanes<L: Lanes>(
        &self,
        lanes: L,
        a: L::Floats,
        b: L::Floats,
    ) -> L::Floats {
        let [from, to] = self.weights;
        lanes.add(
            lanes.mul(a, lanes.floats(from)),
            lanes.mul(b, lanes.floats(to)),
        )
    }
}
