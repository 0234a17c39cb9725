//! What lights ask of a texture, and the texture map over it.

use std::fmt;
use std::sync::Arc;

use super::usable;
use crate::math::{Vec2, Vec3, Vec4};
use crate::scene::{Channels, TextureMap, Transform2d};

/// A picture that a light shines through.
pub trait Radiance: Send + Sync {
    /// Linear Rec.709, filtered; `t = 0` is the bottom row.
    fn eval(&self, st: Vec2) -> Vec4;
    /// Width and height in texels.
    fn size(&self) -> [u32; 2];
    /// One texel, linear; `y = 0` is the top row.
    fn texel(&self, x: u32, y: u32) -> Vec4;
}

/// A picture with its map's transform, channels, scale and bias.
#[derive(Clone)]
pub(super) struct Picture {
    texture: Arc<dyn Radiance>,
    map: TextureMap,
}

impl fmt::Debug for Picture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Picture").field(&self.map).finish()
    }
}

impl Picture {
    /// The picture that `map` names, or the colour that stands for it where it is missing.
    pub(super) fn new(
        map: &TextureMap,
        textures: &[Option<Arc<dyn Radiance>>],
    ) -> Result<Self, Vec3> {
        match textures.get(map.texture).and_then(Option::as_ref) {
            Some(texture) => Ok(Self {
                texture: Arc::clone(texture),
                map: map.clone(),
            }),
            None => Err(colour(map.channels, map.fallback)),
        }
    }

    /// At least 0 and finite.
    pub(super) fn eval(&self, st: Vec2) -> Vec3 {
        let transform = &self.map.transform;
        let (sin, cos) = transform.rotation.to_radians().sin_cos();
        let p = transform.scale * st;
        let st = Vec2::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y) + transform.translation;
        self.mapped(self.texture.eval(st))
    }

    /// The colour of texel `x`, `y` (0 on top), as if the map did not move the picture.
    pub(super) fn texel(&self, x: u32, y: u32) -> Vec3 {
        self.mapped(self.texture.texel(x, y))
    }

    /// Width and height in texels, at least 1.
    pub(super) fn size(&self) -> [u32; 2] {
        self.texture.size().map(|n| n.max(1))
    }

    /// Whether the map leaves the picture in place.
    pub(super) fn in_place(&self) -> bool {
        self.map.transform == Transform2d::default()
    }

    /// The mean of a coarse grid of lookups.
    pub(super) fn mean(&self) -> Vec3 {
        const N: u32 = 16;
        let mut sum = Vec3::ZERO;
        for i in 0..N * N {
            let st = Vec2::new((i % N) as f32 + 0.5, (i / N) as f32 + 0.5) / N as f32;
            sum += self.eval(st);
        }
        sum / (N * N) as f32
    }

    fn mapped(&self, texel: Vec4) -> Vec3 {
        colour(self.map.channels, texel * self.map.scale + self.map.bias)
    }
}

/// The channels as a colour that can be radiated: at least 0 and finite.
fn colour(channels: Channels, v: Vec4) -> Vec3 {
    let c = match channels {
        Channels::Rgb => v.truncate(),
        Channels::R => Vec3::splat(v.x),
        Channels::G => Vec3::splat(v.y),
        Channels::B => Vec3::splat(v.z),
        Channels::A => Vec3::splat(v.w),
    };
    usable(c)
}
