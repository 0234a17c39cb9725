//! Where heights come from: an image's texels, or floats that were asked for once.

use bytemuck::{Pod, Zeroable};

use super::block::{Block, Sheet};
use super::face::Face;
use super::look_up::look_up_all;
use crate::accel::moment::Moment;
use crate::accel::quads::{PAIRS, SIDE};
use crate::accel::simd::{LANES, Lanes};
use crate::math::Vec2;
use crate::surface::{HeightImage, Texels};

/// Values of a map, of which `scale` times the value plus `bias` is a height on the lattice.
pub(super) struct Heights {
    pub(super) source: Source,
    pub(super) scale: f32,
    pub(super) bias: f32,
    /// What a code of [`Ranges`] means: the least value, and the step to the next one.
    pub(super) code: [f32; 2],
}

pub(super) enum Source {
    /// The same everywhere.
    Flat(f32),
    Image(HeightImage),
    /// Of all micro-vertices by motion key, face by face, row by row.
    Kept(Vec<Vec<f32>>),
}

/// The same at hand for a ray.
pub(super) enum Reader<'a> {
    Flat(f32),
    Image(Texels<'a>),
    Kept(&'a [Vec<f32>]),
}

/// A range of values: the code of the least in the lower 16 bits, and that of the greatest in the upper ones.
pub(super) type Range = u32;

/// Codes run up to this.
const MOST: f32 = 65535.0;

/// The range of values in each of sixteen blocks, in bytes: codes from one of their own on, whose unit is a power of two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ranges {
    low: [u8; LANES],
    high: [u8; LANES],
    /// The code where the bytes are zero.
    first: u16,
    exponent: u16,
}

impl Ranges {
    /// Around the ranges of those blocks that are there, given as bits.
    pub(super) fn new(ranges: &[Range; LANES], there: u32) -> Self {
        let there = || (0..LANES).filter(move |c| there >> c & 1 == 1);
        let least = there().map(|c| ranges[c] & 0xffff).min().unwrap_or(0);
        let most = there().map(|c| ranges[c] >> 16).max().unwrap_or(least);
        let reach = most.saturating_sub(least);
        // The finest unit of which 255 reach across, rounded up.
        let units = |exponent: u32| (reach + (1 << exponent) - 1) >> exponent;
        let exponent = (0..16).find(|&e| units(e) <= u8::MAX.into());
        let exponent = exponent.expect("codes have 16 bits");
        let up = (1 << exponent) - 1;
        let mut new = Self {
            low: [0; LANES],
            high: [0; LANES],
            first: least as u16,
            exponent: exponent as u16,
        };
        for c in there() {
            new.low[c] = (((ranges[c] & 0xffff) - least) >> exponent) as u8;
            new.high[c] = (((ranges[c] >> 16).saturating_sub(least) + up) >> exponent) as u8;
        }
        new
    }

    /// Around all that are there.
    pub(super) fn all(&self, there: u32) -> Range {
        let all = (0..LANES)
            .filter(|c| there >> c & 1 == 1)
            .map(|c| self.get(c));
        let all = all.fold([MOST as u32, 0], |[low, high], [a, b]| {
            [low.min(a), high.max(b)]
        });
        all[0] | all[1].min(MOST as u32) << 16
    }

    /// That of a block, or a little more.
    #[inline(always)]
    pub(super) fn get(&self, block: usize) -> [u32; 2] {
        let code = |byte: u8| u32::from(self.first) + (u32::from(byte) << self.exponent);
        [code(self.low[block]), code(self.high[block])]
    }
}

/// The two codes of a range.
#[inline(always)]
pub(super) fn ends(range: Range) -> [u32; 2] {
    [range & 0xffff, range >> 16]
}

impl Heights {
    /// What codes mean so that all values from `low` to `high` have one.
    pub(super) fn encode(&mut self, [low, high]: [f32; 2]) {
        let step = (high - low) / (MOST - 1.0);
        self.code = [low, step.max(f32::MIN_POSITIVE)];
    }

    /// The code of a range of values, rounded outward.
    pub(super) fn code(&self, [low, high]: [f32; 2]) -> Range {
        let [least, step] = self.code;
        let low = ((low - least) / step - 1e-2).floor().clamp(0.0, MOST);
        let high = ((high - least) / step + 1e-2).ceil().clamp(0.0, MOST);
        low as u32 | (high as u32) << 16
    }

    /// The middles of the heights' ranges, and half of their lengths.
    #[inline(always)]
    pub(super) fn ranges<L: Lanes>(&self, lanes: L, ranges: &Ranges) -> [L::Floats; 2] {
        let unit = lanes.floats((1_u32 << ranges.exponent) as f32);
        let first = lanes.floats(f32::from(ranges.first));
        let low = lanes.add(lanes.mul(lanes.bytes(&ranges.low), unit), first);
        let high = lanes.add(lanes.mul(lanes.bytes(&ranges.high), unit), first);
        let [least, step] = self.code;
        let (middle, half) = (0.5 * step * self.scale, 0.5 * step * self.scale.abs());
        let shift = self.scale * least + self.bias;
        [
            lanes.add(
                lanes.mul(lanes.add(low, high), lanes.floats(middle)),
                lanes.floats(shift),
            ),
            lanes.mul(lanes.sub(high, low), lanes.floats(half)),
        ]
    }

    /// Makes ready to read.
    #[inline(always)]
    pub(super) fn reader(&self) -> Reader<'_> {
        match &self.source {
            Source::Flat(value) => Reader::Flat(*value),
            Source::Image(image) => Reader::Image(image.texels()),
            Source::Kept(keys) => Reader::Kept(keys),
        }
    }

    /// The middle of the range of heights that two codes mean, and half of its length: as [`ranges`](Self::ranges).
    #[inline(always)]
    pub(super) fn range(&self, codes: [u32; 2]) -> [f32; 2] {
        let [low, high] = codes.map(|code| code as f32);
        let [least, step] = self.code;
        let middle = (low + high) * (0.5 * step * self.scale);
        let shift = self.scale * least + self.bias;
        [
            middle + shift,
            (high - low) * (0.5 * step * self.scale.abs()),
        ]
    }

    /// Heights of a block, two rows together, at those vertices whose bits are set.
    #[inline(always)]
    pub(super) fn of_block<L: Lanes, S: Sheet<L>>(
        &self,
        lanes: L,
        reader: &Reader<'_>,
        (block, sheet): (&Block<'_>, &S),
        needed: u64,
        moment: &Moment,
    ) -> [L::Floats; PAIRS] {
        let mut values = [lanes.floats(0.0); PAIRS];
        match reader {
            Reader::Flat(value) => values = [lanes.floats(*value); PAIRS],
            Reader::Image(texels) => look_up_all(lanes, texels, sheet, needed, &mut values),
            Reader::Kept(keys) => {
                for (pair, value) in values.iter_mut().enumerate().take(block.pairs()) {
                    let mut two = [0.0; LANES];
                    block.two_rows(&keys[moment.from], pair, &mut two);
                    *value = lanes.load(&two);
                    if moment.from != moment.to {
                        block.two_rows(&keys[moment.to], pair, &mut two);
                        *value = moment.between_lanes(lanes, *value, lanes.load(&two));
                    }
                }
            }
        }
        let (scale, bias) = (lanes.floats(self.scale), lanes.floats(self.bias));
        for value in &mut values {
            *value = lanes.add(lanes.mul(*value, scale), bias);
        }
        values
    }

    /// The height at one micro-vertex, by column and row in the face: the clear twin of what a block takes at once.
    pub(super) fn at(&self, face: &Face, [i, j]: [usize; 2], st: Vec2, moment: &Moment) -> f32 {
        self.of(match &self.source {
            Source::Flat(value) => *value,
            Source::Image(image) => image.texels().eval(st),
            Source::Kept(keys) => {
                let at = |key: usize| {
                    keys[key][face.first_height as usize + j * face.micro_vertices()[0] + i]
                };
                if moment.from == moment.to {
                    at(moment.from)
                } else {
                    let [from, to] = moment.weights;
                    at(moment.from) * from + at(moment.to) * to
                }
            }
        })
    }

    fn of(&self, value: f32) -> f32 {
        value * self.scale + self.bias
    }

    pub(super) fn memory(&self) -> usize {
        match &self.source {
            Source::Kept(keys) => keys.iter().map(|key| size_of_val(key.as_slice())).sum(),
            _ => 0,
        }
    }
}

impl Block<'_> {
    /// Two rows of what faces keep for each micro-vertex; beyond the block's last ones these again.
    #[inline(always)]
    fn two_rows(&self, of: &[f32], pair: usize, to: &mut [f32; LANES]) {
        let [columns, rows] = self.cells;
        let width = self.face.micro_vertices()[0];
        for (half, to) in to.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
            let row = self.in_face[1] + (2 * pair + half).min(rows);
            let first = self.face.first_height as usize + row * width + self.in_face[0];
            let values = &of[first..=first + columns];
            for (i, to) in to.iter_mut().enumerate() {
                *to = values[i.min(columns)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ranges_enclose_those_that_they_are_made_of(
            codes in prop::array::uniform16((0_u32..=65535, 0_u32..=65535)),
            width in 0_u32..=16,
            there in 1_u32..=0xffff,
        ) {
            let most = (1_u32 << width) - 1;
            let codes = codes.map(|(a, b)| [a.min(b) & most, a.max(b) & most]);
            let codes = codes.map(|[a, b]| [a.min(b), a.max(b)]);
            let ranges = Ranges::new(&codes.map(|[low, high]| low | high << 16), there);
            for c in (0..LANES).filter(|c| there >> c & 1 == 1) {
                let [low, high] = ranges.get(c);
                // No wider than the unit on either side.
                let unit = 1 << ranges.exponent;
                prop_assert!(low <= codes[c][0] && codes[c][0] < low + unit);
                prop_assert!(high >= codes[c][1] && high < codes[c][1] + unit);
                prop_assert!(unit <= 1 + most / 127);
            }
        }
    }
}
