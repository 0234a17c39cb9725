//! Displacement from an image.

use std::sync::Arc;

use super::base::Texcoord;
use super::displace::{DisplacementMap, DisplacementPoint, MapGrid, Region, Slope};
use super::pyramid::Pyramid;
use crate::image::Texture;
use crate::math::{Bounds3, Vec3};

/// Which channels of an image are displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// The first one.
    Scalar,
    /// The first three.
    Vector,
}

/// An image whose values displace, bilinearly filtered. Load it with colour space raw: 8-bit texels then count from 0
/// to 1.
#[derive(Debug, Clone)]
pub struct ImageMap {
    texture: Arc<Texture>,
    channels: Channels,
    pyramid: Pyramid,
}

impl ImageMap {
    /// Of a texture that materials may share.
    pub fn new(texture: Arc<Texture>, channels: Channels) -> Self {
        let count = match channels {
            Channels::Scalar => 1,
            Channels::Vector => 3,
        };
        Self {
            pyramid: Pyramid::new(&texture, count),
            texture,
            channels,
        }
    }

    /// What a look-up means.
    fn of(&self, value: Vec3) -> Vec3 {
        match self.channels {
            Channels::Scalar => Vec3::new(value.x, 0.0, 0.0),
            Channels::Vector => value,
        }
    }
}

impl DisplacementMap for ImageMap {
    fn value(&self, at: &DisplacementPoint) -> Vec3 {
        self.of(self.texture.eval(at.st).truncate())
    }

    fn values(&self, grid: &MapGrid<'_>, out: &mut Vec<Vec3>) -> bool {
        match self.channels {
            Channels::Scalar => self
                .texture
                .look_up(grid.st, out, |[x]| Vec3::new(x, 0.0, 0.0)),
            Channels::Vector => self
                .texture
                .look_up(grid.st, out, |xyz: [f32; 3]| Vec3::from(xyz)),
        }
        true
    }

    fn slope(&self, at: &DisplacementPoint, texcoord: &Texcoord) -> Option<Slope> {
        let [by_s, by_t] = self
            .texture
            .slope(at.st)
            .map(|slope| self.of(slope.truncate()));
        Some(Slope {
            du: texcoord.du.x * by_s + texcoord.du.y * by_t,
            dv: texcoord.dv.x * by_s + texcoord.dv.y * by_t,
        })
    }

    fn bound(&self, region: &Region) -> Option<Bounds3> {
        Some(self.pyramid.range(&self.texture, &region.st?))
    }

    fn memory(&self) -> usize {
        self.pyramid.memory()
    }
}
