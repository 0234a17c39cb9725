use super::Vec2;

/// How wide a ray is: what its neighbours leave to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Across, at the ray's origin; scene units.
    pub width: f32,
    /// What it gains with each unit of the way; for small angles, radians.
    pub spread: f32,
}

impl Cone {
    /// A ray without width.
    pub const LINE: Self = Self {
        width: 0.0,
        spread: 0.0,
    };

    /// Across, at a distance.
    #[inline]
    pub fn at(&self, distance: f32) -> f32 {
        self.width + self.spread * distance
    }

    /// As wide a cone times `factor`.
    #[must_use]
    pub fn scaled(self, factor: f32) -> Self {
        Self {
            width: factor * self.width,
            spread: factor * self.spread,
        }
    }
}

/// The part of a plane around a point that a lookup is to cover, spanned by two vectors: to the neighbours in a picture,
/// say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Area(pub [Vec2; 2]);

impl Area {
    /// Nothing but the point.
    pub const POINT: Self = Self([Vec2::ZERO; 2]);

    /// In other parameters, which have the derivatives `du` and `dv` by these.
    #[inline]
    #[must_use]
    pub fn mapped(&self, [du, dv]: [Vec2; 2]) -> Self {
        Self(self.0.map(|x| x.x * du + x.y * dv))
    }
}
