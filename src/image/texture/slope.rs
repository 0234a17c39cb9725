//! Textures as heights: one channel, derivatives of the filter, and the texels behind them.

use super::{Pixels, Texture, Tile, Wrap};
use crate::math::{Vec2, Vec4};

impl Texture {
    /// The first component of [`eval`](Self::eval).
    pub fn red(&self, st: Vec2) -> f32 {
        if self.rec709_from_image.is_some() {
            return self.eval(st).x;
        }
        let Some((tile, st, wrap)) = self.place(st) else {
            return 0.0;
        };
        let [width, height] = tile.size;
        let (x, fx) = wrap[0].neighbours(st.x, width);
        let (y, fy) = wrap[1].neighbours(st.y, height);
        let texel = |x: Option<u32>, y: Option<u32>| match (x, y) {
            (Some(x), Some(y)) => tile.first_channel(x, height - 1 - y),
            _ => 0.0,
        };
        let low = mix(texel(x[0], y[0]), texel(x[1], y[0]), fx);
        let high = mix(texel(x[0], y[1]), texel(x[1], y[1]), fx);
        mix(low, high, fy)
    }

    /// The derivatives of [`eval`](Self::eval) by s and t: those of the bilinear filter, which jump where it passes
    /// the middle of a texel.
    pub fn slope(&self, st: Vec2) -> [Vec4; 2] {
        let Some((tile, st, wrap)) = self.place(st) else {
            return [Vec4::ZERO; 2];
        };
        let [width, height] = tile.size;
        let (x, fx) = wrap[0].neighbours(st.x, width);
        let (y, fy) = wrap[1].neighbours(st.y, height);
        let texel = |x: Option<u32>, y: Option<u32>| match (x, y) {
            (Some(x), Some(y)) => tile.texel(x, height - 1 - y),
            _ => Vec4::ZERO,
        };
        let [a, b] = [texel(x[0], y[0]), texel(x[1], y[0])];
        let [c, d] = [texel(x[0], y[1]), texel(x[1], y[1])];
        let by_s = width as f32 * (b - a).lerp(d - c, fy);
        let by_t = height as f32 * (c - a).lerp(d - b, fx);
        // Alpha is of no colour space, so that a linear map of the colours is one of their derivatives, too.
        [by_s, by_t].map(|v| self.to_rec709(v))
    }

    /// Number (0 outside of UDIM sets), width and height of each image.
    pub fn tiles(&self) -> impl ExactSizeIterator<Item = (u32, [u32; 2])> + '_ {
        self.tiles.iter().map(|tile| (tile.number, tile.size))
    }

    /// A texel of image `tile`, linear, row 0 below.
    ///
    /// # Panics
    /// If there is no such image or texel.
    pub fn tile_texel(&self, tile: usize, x: u32, y: u32) -> Vec4 {
        let tile = &self.tiles[tile];
        self.to_rec709(tile.texel(x, tile.size[1] - 1 - y))
    }

    /// Whether it is a set of UDIM tiles.
    pub fn is_udim(&self) -> bool {
        self.udim
    }

    /// What lies beyond its border along s and t; tiles of a UDIM set end with their border's texels.
    pub fn wrap(&self) -> [Wrap; 2] {
        if self.udim {
            [Wrap::Clamp; 2]
        } else {
            self.wrap
        }
    }

    /// The image at `st`, and where in it.
    fn place(&self, st: Vec2) -> Option<(&Tile, Vec2, [Wrap; 2])> {
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let st = Vec2::new(finite(st.x), finite(st.y));
        if self.udim {
            let (tile, st) = self.udim_tile(st)?;
            Some((tile, st, [Wrap::Clamp; 2]))
        } else {
            Some((&self.tiles[0], st, self.wrap))
        }
    }
}

impl Tile {
    fn first_channel(&self, x: u32, y: u32) -> f32 {
        let first = (y as usize * self.size[0] as usize + x as usize) * self.layout.channels();
        match &self.pixels {
            // The first channel is never alpha.
            Pixels::Byte(pixels) => self.color[usize::from(pixels[first])],
            Pixels::Half(pixels) => pixels[first].to_f32(),
            Pixels::Float(pixels) => pixels[first],
        }
    }
}

/// As glam's `lerp`, so that the results are the same.
fn mix(a: f32, b: f32, t: f32) -> f32 {
    a * (1.0 - t) + b * t
}
