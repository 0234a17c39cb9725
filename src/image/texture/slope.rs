//! Textures as displacement: many look-ups at once, derivatives of the filter, and the texels behind them.

use super::{Pixels, Texture, Wrap};
use crate::math::{Vec2, Vec4};

impl Texture {
    /// What `make` makes of the first `N` components (at most 3) of [`eval`](Self::eval) at each of `sts`.
    pub fn look_up<T, const N: usize>(
        &self,
        sts: &[Vec2],
        out: &mut Vec<T>,
        make: impl Fn([f32; N]) -> T,
    ) {
        out.clear();
        let tile = &self.tiles[0];
        if self.udim || self.rec709_from_image.is_some() || N > tile.layout.colors() {
            out.extend(sts.iter().map(|&st| {
                let value = self.eval(st).to_array();
                make(std::array::from_fn(|c| value[c]))
            }));
            return;
        }
        match &tile.pixels {
            Pixels::Byte(pixels) => {
                let table: &[f32; 256] = tile.color;
                let decode = |byte: u8| table[usize::from(byte)];
                out.extend(self.blended(sts, pixels, decode).map(make));
            }
            Pixels::Half(pixels) => {
                out.extend(self.blended(sts, pixels, |half| half.to_f32()).map(make));
            }
            Pixels::Float(pixels) => out.extend(self.blended(sts, pixels, |v| v).map(make)),
        }
    }

    /// Filters the first image, with `eval`'s arithmetic.
    fn blended<'a, T: Copy, const N: usize>(
        &'a self,
        sts: &'a [Vec2],
        pixels: &'a [T],
        decode: impl Fn(T) -> f32 + 'a,
    ) -> impl Iterator<Item = [f32; N]> + 'a {
        let tile = &self.tiles[0];
        let ([width, height], channels) = (tile.size, tile.layout.channels());
        let order = tile.order;
        let row = move |y: Option<u32>| y.map(|y| order.row(height - 1 - y));
        let texel = move |x: Option<u32>, row: Option<usize>| match (x, row) {
            (Some(x), Some(row)) => {
                let texel = &pixels[(row + order.column(x)) * channels..][..N];
                std::array::from_fn(|c| decode(texel[c]))
            }
            _ => [0.0; N],
        };
        sts.iter().map(move |&st| {
            let st = finite(st);
            let (x, fx) = self.wrap[0].neighbours(st.x, width);
            let (y, fy) = self.wrap[1].neighbours(st.y, height);
            let (below, above) = (row(y[0]), row(y[1]));
            let low = mix(texel(x[0], below), texel(x[1], below), fx);
            let high = mix(texel(x[0], above), texel(x[1], above), fx);
            mix(low, high, fy)
        })
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
}

fn finite(st: Vec2) -> Vec2 {
    let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
    Vec2::new(finite(st.x), finite(st.y))
}

/// As glam's `lerp`, so that the results are the same.
fn mix<const N: usize>(a: [f32; N], b: [f32; N], t: f32) -> [f32; N] {
    std::array::from_fn(|c| a[c] * (1.0 - t) + b[c] * t)
}
