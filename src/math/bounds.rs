use super::{Affine3A, Vec3};

/// An axis-parallel box; empty where `min` exceeds `max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds3 {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds3 {
    /// Holds nothing.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// The smallest box around `points`.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.including(p))
    }

    /// The box that reaches `reach`, at least 0, from `centre` along each axis both ways.
    pub fn around(centre: Vec3, reach: Vec3) -> Self {
        Self {
            min: centre - reach,
            max: centre + reach,
        }
    }

    /// The smallest box around this one and `p`.
    #[must_use]
    pub fn including(self, p: Vec3) -> Self {
        Self {
            min: self.min.min(p),
            max: self.max.max(p),
        }
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all())
    }

    /// Its middle; meaningless for an empty box.
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Its edge lengths; zero for an empty box.
    pub fn extent(&self) -> Vec3 {
        if self.is_empty() {
            Vec3::ZERO
        } else {
            self.max - self.min
        }
    }

    /// The box around the image of this one's eight corners.
    #[must_use]
    pub fn transformed(&self, to_from_here: &Affine3A) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        Self::of((0..8).map(|i| {
            let pick = |bit: u32, axis: usize| {
                if i & bit == 0 {
                    self.min[axis]
                } else {
                    self.max[axis]
                }
            };
            to_from_here.transform_point3(Vec3::new(pick(1, 0), pick(2, 1), pick(4, 2)))
        }))
    }
}
