//! An image's levels, each half as large as the one before, and lookups that cover an area.
//!
//! Williams, "Pyramidal Parametrics" (1983): the level whose texels are as large as the area stands for it, and between
//! two levels they are blended. An area that is longer than wide is covered by several such lookups in a row along it,
//! each as large as it is wide: McCormack, Perry, Farkas and Jouppi, "Feline: Fast Elliptical Lines for Anisotropic
//! Texture Mapping" (1999), but with equal weights, which make the mean of the area.
//!
//! A file's own levels count as far as each halves the one before, so that what its author has filtered, or painted, is
//! seen. Those that it lacks are made here: each texel is the mean of what it covers, of decoded values, so that the
//! picture gets no darker with distance. In an image of bytes a mean becomes the byte whose value is nearest.

use half::f16;
use rayon::prelude::*;

use super::{LINEAR, Layout, Pixels, TexelOrder, Texture, Tile};
use crate::math::{Area, Vec2, Vec4};

/// Lookups in a row for an area that is this many times longer than wide, or more.
const MOST_PROBES: f32 = 16.0;

/// The texels of one level.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) size: [u32; 2],
    /// Interleaved, row 0 on top.
    pub(super) pixels: Pixels,
}

/// A level with what its numbers mean.
#[derive(Clone, Copy)]
pub(super) struct Sheet<'a> {
    pub(super) size: [u32; 2],
    pub(super) pixels: &'a Pixels,
    pub(super) order: TexelOrder,
    pub(super) layout: Layout,
    pub(super) color: &'static [f32; 256],
}

/// Whether a level of size `to` can follow one of size `from`: both sides are halved, and rounded either way.
pub(super) fn follows(from: [u32; 2], to: [u32; 2]) -> bool {
    let halved = |(from, to): (u32, u32)| to == (from / 2).max(1) || to == from.div_ceil(2);
    from != [1, 1] && from.into_iter().zip(to).all(halved)
}

impl Tile {
    /// The full size, or a level below it.
    pub(super) fn sheet(&self, level: usize) -> Sheet<'_> {
        let (size, pixels, order) = match level.checked_sub(1).map(|i| &self.smaller[i]) {
            None => (self.size, &self.pixels, self.order),
            Some(level) => (level.size, &level.pixels, TexelOrder::rows(level.size[0])),
        };
        Sheet {
            size,
            pixels,
            order,
            layout: self.layout,
            color: self.color,
        }
    }

    /// Makes the levels that are missing, down to one texel, of an image that is still in rows.
    pub(super) fn complete(&mut self) {
        while let Some(level) = self.sheet(self.smaller.len()).halved() {
            self.smaller.push(level);
        }
    }
}

impl Sheet<'_> {
    /// The next level; none of one texel.
    fn halved(&self) -> Option<Level> {
        if self.size == [1, 1] {
            return None;
        }
        let (channels, colors) = (self.layout.channels(), self.layout.colors());
        let table = |c: usize| if c < colors { self.color } else { &LINEAR };
        let (size, pixels) = match self.pixels {
            Pixels::Byte(pixels) => {
                let decode = |byte: u8, c| table(c)[usize::from(byte)];
                let encode = |value, c| nearest(table(c), value);
                let (size, pixels) = means(pixels, self.size, channels, decode, encode);
                (size, Pixels::Byte(pixels))
            }
            Pixels::Half(pixels) => {
                let (decode, encode) = (|v: f16, _| v.to_f32(), |v, _| f16::from_f32(v));
                let (size, pixels) = means(pixels, self.size, channels, decode, encode);
                (size, Pixels::Half(pixels))
            }
            Pixels::Float(pixels) => {
                let (size, pixels) = means(pixels, self.size, channels, |v, _| v, |v, _| v);
                (size, Pixels::Float(pixels))
            }
        };
        Some(Level { size, pixels })
    }
}

/// The byte whose value in a table that grows is nearest.
fn nearest(table: &[f32; 256], value: f32) -> u8 {
    let above = table.partition_point(|v| *v < value).min(255);
    let below = above.saturating_sub(1);
    let is_below = value - table[below] < table[above] - value;
    (if is_below { below } else { above }) as u8
}

/// Of an image of half the size, each side rounded down, the means of what its texels cover.
fn means<T: Copy + Send + Sync + Default>(
    pixels: &[T],
    size: [u32; 2],
    channels: usize,
    decode: impl Fn(T, usize) -> f32 + Sync,
    encode: impl Fn(f32, usize) -> T + Sync,
) -> ([u32; 2], Vec<T>) {
    let halved = size.map(|n| (n / 2).max(1));
    let [width, height] = halved.map(|n| n as usize);
    let mut out = vec![T::default(); width * height * channels];
    let row = |y: usize| &pixels[y * size[0] as usize * channels..];
    out.par_chunks_exact_mut(width * channels)
        .enumerate()
        .for_each(|(y, out)| {
            for (x, out) in out.chunks_exact_mut(channels).enumerate() {
                for (c, out) in out.iter_mut().enumerate() {
                    let mut sum = 0.0;
                    for (y, down) in covered(y, size[1]) {
                        for (x, across) in covered(x, size[0]) {
                            sum += down * across * decode(row(y)[x * channels + c], c);
                        }
                    }
                    *out = encode(sum, c);
                }
            }
        });
    (halved, out)
}

/// The texels of a row of `size` that texel `i` of half as many covers, with their shares of it.
fn covered(i: usize, size: u32) -> impl Iterator<Item = (usize, f32)> {
    let half = (size / 2).max(1) as f32;
    let (count, weights) = match size {
        1 => (1, [1.0, 0.0, 0.0]),
        _ if size.is_multiple_of(2) => (2, [0.5, 0.5, 0.0]),
        // A texel of the half is a little more than two long, and the third is shared with the next one.
        _ => {
            let (before, after) = (i as f32 / half, (i + 1) as f32 / half);
            (
                3,
                [1.0 - before, 1.0, after].map(|w| w / (2.0 + 1.0 / half)),
            )
        }
    };
    (0..count).map(move |k| (2 * i + k, weights[k]))
}

impl Texture {
    /// What [`eval`](Self::eval) is on the mean over an area around `st`, an ellipse that the two vectors are
    /// conjugate diameters of. No less than a texel is covered. Textures that were not
    /// [loaded with levels](Self::load_levels) are looked up as by `eval`.
    pub fn filtered(&self, st: Vec2, area: &Area) -> Vec4 {
        let Some((tile, st, wrap)) = self.place(st) else {
            return Vec4::ZERO;
        };
        let size = Vec2::from(tile.size.map(|n| n as f32));
        let [a, b] = area.0.map(|x| x * size);
        let squared = a.length_squared() + b.length_squared();
        if tile.smaller.is_empty() || squared <= 1.0 || !squared.is_finite() {
            return self.filter(&tile.sheet(0), st, wrap);
        }
        let Strip {
            along,
            probes,
            level,
        } = Strip::over(a, b);
        let step = along / size / probes as f32;
        let first = st - 0.5 * (probes - 1) as f32 * step;
        let last = tile.smaller.len();
        let lower = (level as usize).min(last);
        let part = (level - lower as f32).min(1.0);
        let (near, far) = (tile.sheet(lower), tile.sheet((lower + 1).min(last)));
        let mut sum = Vec4::ZERO;
        for i in 0..probes {
            let st = first + i as f32 * step;
            let value = self.filter(&near, st, wrap);
            sum += if part > 0.0 {
                value.lerp(self.filter(&far, st, wrap), part)
            } else {
                value
            };
        }
        sum / probes as f32
    }
}

/// Lookups in a row.
#[derive(Debug, Clone, Copy)]
struct Strip {
    /// From end to end of all they cover, texels.
    along: Vec2,
    probes: u32,
    /// Whose texels are as large as each of them; 0 is the full size.
    level: f32,
}

impl Strip {
    /// Over the ellipse that `a` and `b` (texels) are conjugate diameters of.
    fn over(a: Vec2, b: Vec2) -> Self {
        // Squares of its axes are the eigenvalues of the product of (a b) with its transpose.
        let (xx, xy, yy) = (
            a.x * a.x + b.x * b.x,
            a.x * a.y + b.x * b.y,
            a.y * a.y + b.y * b.y,
        );
        let long_squared = 0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy);
        let long = long_squared.sqrt();
        let short = (a.perp_dot(b).abs() / long).max(1.0);
        // An eigenvector, in the form that does not cancel.
        let along = if xx > yy {
            Vec2::new(long_squared - yy, xy)
        } else {
            Vec2::new(xy, long_squared - xx)
        };
        let probes = (long / short).round().clamp(1.0, MOST_PROBES);
        let each = short.max(long / MOST_PROBES);
        Self {
            // What is as long as wide is one lookup, wherever it points.
            along: long * along.normalize_or_zero(),
            probes: probes as u32,
            level: each.log2().max(0.0),
        }
    }
}

#[cfg(test)]
#[path = "levels_tests.rs"]
mod tests;
