//! Texels at hand: to be summed by filters, or copied.

use std::sync::Arc;

use arc_swap::Guard;

use super::load::{Entry, Held, Stored, Tiled};
use super::{Constants, Shared};
use crate::error::Result;
use crate::sample::{Pixels, Sample, with_samples, with_type};
use crate::types::Res;

/// The texels of a face in one size. Cheap to clone; they stay even if the cache lets them go meanwhile, except for
/// tiles, which are loaded as they are touched.
pub struct Texels<'r> {
    file: &'r Arc<Shared>,
    res: Res,
    held: Kind<'r>,
}

enum Kind<'r> {
    /// Of the file's constant texels, the one of that face.
    Constant(&'r Constants, u32),
    Held(Held),
}

impl<'r> Texels<'r> {
    #[inline]
    pub(super) fn held(file: &'r Arc<Shared>, res: Res, held: Held) -> Self {
        Self {
            file,
            res,
            held: Kind::Held(held),
        }
    }

    pub(super) fn of_constants(
        file: &'r Arc<Shared>,
        res: Res,
        constants: &'r Constants,
        face: u32,
    ) -> Self {
        Self {
            file,
            res,
            held: Kind::Constant(constants, face),
        }
    }

    /// Their number: logarithms of columns and rows.
    #[must_use]
    pub fn res(&self) -> Res {
        self.res
    }

    /// Whether they are held as one texel that stands for all.
    #[must_use]
    #[inline]
    pub fn constant(&self) -> bool {
        matches!(self.view(), View::Constant(..))
    }

    /// The size of the tiles in which they are held.
    #[must_use]
    pub fn tile_res(&self) -> Option<Res> {
        match self.view() {
            View::Tiled(_, tiled) => Some(tiled.tile_res),
            _ => None,
        }
    }

    /// Adds `weight` times the texel in column `x` and row `y` to `out`: its channels from `first` on, in stored units
    /// (0 to 255, 0 to 65535, or as they are for floats).
    ///
    /// # Errors
    /// If its tile had to be read and could not be.
    ///
    /// # Panics
    /// If there is no such texel, or no such channels.
    pub fn add(
        &self,
        x: usize,
        y: usize,
        weight: f32,
        first: usize,
        out: &mut [f32],
    ) -> Result<()> {
        match self.view() {
            View::Constant(pixels, at) => add_texel(pixels, at + first, weight, out),
            View::Whole(pixels) => {
                let at = ((y << self.res.ulog2) + x) * self.channels();
                add_texel(pixels, at + first, weight, out);
            }
            View::Tiled(..) => return self.add_weighted(x, y, &[1.0], &[1.0], weight, first, out),
        }
        Ok(())
    }

    /// Adds a rectangle of texels, from column `x0` and row `y0` on, with separable weights: `scale` times the sum of
    /// `uw[i]` times `vw[j]` times texel (`x0 + i`, `y0 + j`). Channels and units are those of [`Texels::add`].
    ///
    /// # Errors
    /// If a tile had to be read and could not be.
    ///
    /// # Panics
    /// If there are no such texels, or no such channels.
    #[allow(clippy::too_many_arguments)]
    #[inline]
    pub fn add_weighted(
        &self,
        x0: usize,
        y0: usize,
        uw: &[f32],
        vw: &[f32],
        scale: f32,
        first: usize,
        out: &mut [f32],
    ) -> Result<()> {
        let channels = self.channels();
        match self.view() {
            View::Constant(pixels, at) => {
                let weight = uw.iter().sum::<f32>() * vw.iter().sum::<f32>() * scale;
                add_texel(pixels, at + first, weight, out);
            }
            View::Whole(pixels) => {
                let plane = Plane {
                    width: 1 << self.res.ulog2,
                    channels,
                };
                plane.add(pixels, [x0, y0], uw, vw, scale, first, out);
            }
            View::Tiled(entry, tiled) => {
                let (us, vs) = (tiled.tile_res.ulog2, tiled.tile_res.vlog2);
                for (ty, [y, from_v, to_v]) in pieces(y0, vw.len(), vs) {
                    for (tx, [x, from_u, to_u]) in pieces(x0, uw.len(), us) {
                        let tile = self.file.tile(entry, ty * tiled.across() + tx)?;
                        let (uw, vw) = (&uw[from_u..to_u], &vw[from_v..to_v]);
                        match texels_of(&tile) {
                            (true, pixels) => {
                                let weight =
                                    uw.iter().sum::<f32>() * vw.iter().sum::<f32>() * scale;
                                add_texel(pixels, first, weight, out);
                            }
                            (false, pixels) => {
                                let plane = Plane {
                                    width: 1 << us,
                                    channels,
                                };
                                plane.add(pixels, [x, y], uw, vw, scale, first, out);
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Appends a rectangle of texels to `out` as they are in the file's type: row after row from `y0` on, the channels
    /// of a texel side by side, little endian.
    ///
    /// # Errors
    /// If a tile had to be read and could not be, or the texels take more memory than the cache's budget and than the
    /// file's size can justify.
    ///
    /// # Panics
    /// If there are no such texels.
    pub fn copy(
        &self,
        x0: usize,
        y0: usize,
        width: usize,
        height: usize,
        out: &mut Vec<u8>,
    ) -> Result<()> {
        self.admit(width, height)?;
        self.runs(x0, y0, width, height, |pixels, from, to| {
            pixels.write(from, to, out);
        })
    }

    pub(crate) fn whole(&self) -> Result<Pixels> {
        self.rect(0, 0, 1 << self.res.ulog2, 1 << self.res.vlog2)
    }

    pub(super) fn rect(&self, x: usize, y: usize, width: usize, height: usize) -> Result<Pixels> {
        self.admit(width, height)?;
        with_type!(self.file.header.data_type, S => {
            let mut out: Vec<S> = Vec::with_capacity(width * height * self.channels());
            self.runs(x, y, width, height, |pixels, from, to| {
                out.extend(&S::of(pixels)[from..to]);
            })?;
            Ok(S::wrap(out))
        })
    }

    /// The texel that stands for all.
    pub(super) fn constant_texel(&self) -> Option<Pixels> {
        match self.view() {
            View::Constant(pixels, at) => Some(self.one(pixels, at)),
            _ => None,
        }
    }

    /// The texel that stands for all of a rectangle that lies within one constant tile.
    pub(super) fn constant_rect(
        &self,
        x: usize,
        y: usize,
        width: usize,
        height: usize,
    ) -> Result<Option<Pixels>> {
        let View::Tiled(entry, tiled) = self.view() else {
            return Ok(self.constant_texel());
        };
        let (us, vs) = (tiled.tile_res.ulog2, tiled.tile_res.vlog2);
        let (tx, ty) = (x >> us, y >> vs);
        if tx != (x + width - 1) >> us || ty != (y + height - 1) >> vs {
            return Ok(None);
        }
        let tile = self.file.tile(entry, ty * tiled.across() + tx)?;
        Ok(match texels_of(&tile) {
            (true, pixels) => Some(self.one(pixels, 0)),
            (false, _) => None,
        })
    }

    fn one(&self, pixels: &Pixels, at: usize) -> Pixels {
        let channels = self.channels();
        with_samples!(pixels, s => Sample::wrap(s[at..at + channels].to_vec()))
    }

    /// Hands out the samples of a rectangle in order: which of which array.
    fn runs(
        &self,
        x0: usize,
        y0: usize,
        width: usize,
        height: usize,
        mut each: impl FnMut(&Pixels, usize, usize),
    ) -> Result<()> {
        let channels = self.channels();
        let across = 1 << self.res.ulog2;
        for y in y0..y0 + height {
            match self.view() {
                View::Constant(pixels, at) => {
                    (0..width).for_each(|_| each(pixels, at, at + channels));
                }
                View::Whole(pixels) => {
                    let at = (y * across + x0) * channels;
                    each(pixels, at, at + width * channels);
                }
                View::Tiled(entry, tiled) => {
                    let (us, vs) = (tiled.tile_res.ulog2, tiled.tile_res.vlog2);
                    let (ty, y) = (y >> vs, y & ((1 << vs) - 1));
                    for (tx, [x, from, to]) in pieces(x0, width, us) {
                        let tile = self.file.tile(entry, ty * tiled.across() + tx)?;
                        match texels_of(&tile) {
                            (true, pixels) => (from..to).for_each(|_| each(pixels, 0, channels)),
                            (false, pixels) => {
                                let at = ((y << us) + x) * channels;
                                each(pixels, at, at + (to - from) * channels);
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Constant texels and tiles can stand for any number: what they are expanded to is looked at first.
    fn admit(&self, width: usize, height: usize) -> Result<()> {
        let texels = width as u64 * height as u64;
        let bytes = texels.saturating_mul(self.file.header.pixel_bytes() as u64);
        let place = |e: crate::Error| e.in_file(&self.file.path);
        self.file.admit(bytes).map_err(place)
    }

    #[inline]
    fn channels(&self) -> usize {
        usize::from(self.file.header.channels)
    }

    #[inline]
    fn view(&self) -> View<'_> {
        match &self.held {
            Kind::Constant(constants, face) => {
                View::Constant(&constants.pixels, *face as usize * constants.channels)
            }
            Kind::Held(held) => {
                let entry = held.as_ref().expect("held texels are there");
                match &entry.texels {
                    Stored::Constant(pixels) => View::Constant(pixels, 0),
                    Stored::Whole(pixels) => View::Whole(pixels),
                    Stored::Tiled(tiled) => View::Tiled(entry, tiled),
                }
            }
        }
    }
}

impl Clone for Texels<'_> {
    fn clone(&self) -> Self {
        let held = match &self.held {
            Kind::Constant(constants, face) => Kind::Constant(constants, *face),
            Kind::Held(held) => Kind::Held(Guard::from_inner(Option::clone(held))),
        };
        Self { held, ..*self }
    }
}

/// What there is to read from.
enum View<'a> {
    /// One texel, from that sample on.
    Constant(&'a Pixels, usize),
    Whole(&'a Pixels),
    Tiled(&'a Arc<Entry>, &'a Tiled),
}

/// A loaded tile: whether it is constant, and its samples.
fn texels_of(tile: &Held) -> (bool, &Pixels) {
    match tile.as_ref().map(|entry| &entry.texels) {
        Some(Stored::Constant(pixels)) => (true, pixels),
        Some(Stored::Whole(pixels)) => (false, pixels),
        _ => unreachable!("a tile is loaded, and holds no tiles"),
    }
}

/// Cuts `count` positions from `start` on at multiples of 2^`log2`: which piece of the grid, and within it the start,
/// and which of the positions.
fn pieces(
    start: usize,
    count: usize,
    log2: i8,
) -> impl Iterator<Item = (usize, [usize; 3])> + Clone {
    let size = 1_usize << log2;
    let end = start + count;
    (start >> log2..=(end.max(1) - 1) >> log2).map(move |piece| {
        let from = start.max(piece * size);
        let to = end.min((piece + 1) * size);
        (piece, [from - piece * size, from - start, to - start])
    })
}

/// Samples that are summed at once, and most such blocks in a row: 16 texels of four channels.
const BLOCK: usize = 4;
const BLOCKS: usize = 16;

/// How samples lie in an array.
#[derive(Clone, Copy)]
struct Plane {
    width: usize,
    channels: usize,
}

impl Plane {
    #[allow(clippy::too_many_arguments)]
    #[inline]
    fn add(
        self,
        pixels: &Pixels,
        at: [usize; 2],
        uw: &[f32],
        vw: &[f32],
        scale: f32,
        first: usize,
        out: &mut [f32],
    ) {
        debug_assert!(
            at[0] + uw.len() <= self.width,
            "{at:?} + {} of {}",
            uw.len(),
            self.width
        );
        debug_assert!(first + out.len() <= self.channels);
        let start = (at[1] * self.width + at[0]) * self.channels + first;
        with_samples!(pixels, s => {
            let s = &s[start..];
            if uw.len() * self.channels <= BLOCKS * BLOCK {
                self.add_few(s, uw, vw, scale, out);
            } else {
                self.add_many(s, uw, vw, scale, out);
            }
        });
    }

    /// Sums along columns first, a block of samples that lie side by side at a time, which the compiler makes vectors of.
    /// A last block may reach into samples that do not count.
    #[inline]
    fn add_few<S: Sample>(self, s: &[S], uw: &[f32], vw: &[f32], scale: f32, out: &mut [f32]) {
        let stride = self.width * self.channels;
        let count = uw.len().saturating_sub(1) * self.channels + out.len();
        let mut sums = [[0.0_f32; BLOCK]; BLOCKS];
        for (block, sums) in sums[..count.div_ceil(BLOCK)].iter_mut().enumerate() {
            let rows = vw
                .iter()
                .enumerate()
                .map(|(j, v)| (&s[j * stride + block * BLOCK..], v));
            for (row, v) in rows {
                if let Some(samples) = row.first_chunk::<BLOCK>() {
                    let samples = samples.map(S::float);
                    for (sum, sample) in sums.iter_mut().zip(samples) {
                        *sum += v * sample;
                    }
                } else {
                    // The end of the texels.
                    for (sum, sample) in sums.iter_mut().zip(row) {
                        *sum += v * sample.float();
                    }
                }
            }
        }
        for (u, texel) in uw.iter().zip(sums.as_flattened().chunks(self.channels)) {
            for (out, sum) in out.iter_mut().zip(texel) {
                *out += scale * u * sum;
            }
        }
    }

    fn add_many<S: Sample>(self, s: &[S], uw: &[f32], vw: &[f32], scale: f32, out: &mut [f32]) {
        for (c, out) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (j, v) in vw.iter().enumerate() {
                let row = &s[j * self.width * self.channels + c..];
                let row_sum: f32 = uw
                    .iter()
                    .enumerate()
                    .map(|(i, u)| u * row[i * self.channels].float())
                    .sum();
                sum += v * row_sum;
            }
            *out += scale * sum;
        }
    }
}

#[inline]
fn add_texel(pixels: &Pixels, at: usize, weight: f32, out: &mut [f32]) {
    let count = out.len();
    with_samples!(pixels, s => for (out, sample) in out.iter_mut().zip(&s[at..at + count]) {
        *out += weight * sample.float();
    });
}
