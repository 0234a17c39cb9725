//! Where heights come from: an image's texels, or floats that were asked for once.

use bytemuck::{Pod, Zeroable};

use super::block::{Block, Sheet};
use super::face::Face;
use crate::accel::moment::Moment;
use crate::accel::quads::{PAIRS, SIDE};
use crate::accel::simd::{LANES, Lanes};
use crate::math::Vec2;
use crate::surface::{FROM_BYTE, Fold, HeightImage, TexelKind, Texels};

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

/// Coordinates in texels along an axis, from the middle of the first one; the texel before, how far after it they are,
/// and the lanes where that texel and the next are within the image.
#[inline(always)]
fn along<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    axis: usize,
    s: L::Floats,
) -> (L::Floats, L::Floats, u32) {
    let s = match texels.fold(axis) {
        Fold::Ones => lanes.sub(s, lanes.floor(s)),
        Fold::Twos => {
            let twos = lanes.floor(lanes.mul(lanes.floats(0.5), s));
            lanes.sub(s, lanes.mul(lanes.floats(2.0), twos))
        }
        Fold::Within([low, high]) => lanes.min(lanes.max(s, lanes.floats(low)), lanes.floats(high)),
    };
    let size = texels.size[axis] as f32;
    let x = lanes.sub(lanes.mul(s, lanes.floats(size)), lanes.floats(0.5));
    let left = lanes.floor(x);
    let within = lanes.less_equal(lanes.floats(0.0), left)
        & lanes.less_equal(left, lanes.floats(size - 2.0));
    (left, lanes.sub(x, left), within)
}

#[inline(always)]
fn blend<L: Lanes>(lanes: L, [a, b]: [L::Floats; 2], f: L::Floats) -> L::Floats {
    lanes.add(a, lanes.mul(lanes.sub(b, a), f))
}

/// Of the vertices of a block in two of its rows, those whose bits are set.
#[inline(always)]
pub(super) fn of_pair(bits: u64, pair: usize) -> u32 {
    (bits >> (LANES * pair)) as u32 & 0xffff
}

/// Values at vertices of a block. Those that are needed are often few: they are put side by side, so that as few times as
/// can be sixteen are looked up.
#[inline(always)]
fn look_up_all<L: Lanes, S: Sheet<L>>(
    lanes: L,
    texels: &Texels<'_>,
    sheet: &S,
    needed: u64,
    values: &mut [L::Floats; PAIRS],
) {
    const ROOM: usize = LANES * (PAIRS + 1);
    let (s, t) = (sheet.st(lanes, 0), sheet.st(lanes, 1));
    let mut places = [[0.0; ROOM]; 2];
    let mut count = 0;
    for pair in 0..PAIRS {
        let some = of_pair(needed, pair);
        if some != 0 {
            let (s, t) = (sheet.pair(lanes, s, pair), sheet.pair(lanes, t, pair));
            lanes.store(lanes.compress(s, some), at_mut(&mut places[0], count));
            lanes.store(lanes.compress(t, some), at_mut(&mut places[1], count));
            count += some.count_ones() as usize;
        }
    }
    let mut found = [0.0; ROOM];
    for first in (0..count).step_by(LANES) {
        let some = 0xffff >> (LANES - (count - first).min(LANES));
        let [s, t] = [at(&places[0], first), at(&places[1], first)];
        let value = look_up(lanes, texels, [lanes.load(s), lanes.load(t)], some);
        lanes.store(value, at_mut(&mut found, first));
    }
    let mut first = 0;
    for (pair, value) in values.iter_mut().enumerate() {
        let some = of_pair(needed, pair);
        if some != 0 {
            *value = lanes.expand(lanes.load(at(&found, first)), some);
            first += some.count_ones() as usize;
        }
    }
}

/// Sixteen numbers from some place on.
#[inline(always)]
fn at(all: &[f32], first: usize) -> &[f32; LANES] {
    all[first..].first_chunk().expect("there is room for all")
}

#[inline(always)]
fn at_mut(all: &mut [f32], first: usize) -> &mut [f32; LANES] {
    all[first..]
        .first_chunk_mut()
        .expect("there is room for all")
}

/// Sixteen look-ups at once, as [`Texels::eval`] does each, in the lanes whose bits are set.
#[inline(always)]
fn look_up<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [s, t]: [L::Floats; 2],
    needed: u32,
) -> L::Floats {
    let (x, fx, x_within) = along(lanes, texels, 0, s);
    let (y, fy, y_within) = along(lanes, texels, 1, t);
    let four = if x_within & y_within & needed == needed {
        inner(lanes, texels, [lanes.to_ints(x), lanes.to_ints(y)], needed)
    } else {
        None
    };
    let [low, high] = match four {
        Some(four) => four,
        None => by_one(lanes, texels, [x, y], needed),
    };
    blend(lanes, [blend(lanes, low, fx), blend(lanes, high, fx)], fy)
}

/// The four texels around places that are not at a border; none if more bytes than there are would be read.
#[inline(always)]
fn inner<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Ints; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let Texels {
        bytes,
        kind,
        size: [width, height],
        stride,
        first,
        order,
        ..
    } = *texels;
    if !order.is_rows() {
        return in_squares(lanes, texels, [x, y], needed);
    }
    // Rows go down, y goes up.
    let row = stride * width as usize;
    let lowest = lanes.ints((row * (height as usize - 1) + first) as i32);
    let at = lanes.add_ints(lowest, lanes.mul_ints(x, lanes.ints(stride as i32)));
    let at = lanes.add_ints(at, lanes.mul_ints(y, lanes.ints(-(row as i32))));
    let above = lanes.add_ints(at, lanes.ints(-(row as i32)));
    let here = lanes.gather(bytes, at, needed)?;
    let there = lanes.gather(bytes, above, needed)?;
    // Both texels of a row in four bytes, if they are.
    Some(match (kind, stride) {
        (TexelKind::Half, 2) => [
            [lanes.of_halves(here), upper_half(lanes, here)],
            [lanes.of_halves(there), upper_half(lanes, there)],
        ],
        (TexelKind::Byte, 1) => [
            [
                byte(lanes, here),
                byte(lanes, lanes.shift_right_unsigned::<8>(here)),
            ],
            [
                byte(lanes, there),
                byte(lanes, lanes.shift_right_unsigned::<8>(there)),
            ],
        ],
        (TexelKind::Byte, 3) => [
            [
                byte(lanes, here),
                byte(lanes, lanes.shift_right_unsigned::<24>(here)),
            ],
            [
                byte(lanes, there),
                byte(lanes, lanes.shift_right_unsigned::<24>(there)),
            ],
        ],
        _ => {
            let next = lanes.ints(stride as i32);
            let right = lanes.gather(bytes, lanes.add_ints(at, next), needed)?;
            let above_right = lanes.gather(bytes, lanes.add_ints(above, next), needed)?;
            [
                [number(lanes, kind, here), number(lanes, kind, right)],
                [number(lanes, kind, there), number(lanes, kind, above_right)],
            ]
        }
    })
}

/// The same of an image whose texels lie in squares.
#[inline(always)]
fn in_squares<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Ints; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let (kind, bytes) = (texels.kind, texels.bytes);
    let (across, down) = (texels.order.across(), texels.order.down());
    let row = lanes.add_ints(
        lanes.ints(texels.size[1] as i32 - 1),
        lanes.mul_ints(y, lanes.ints(-1)),
    );
    let next = lanes.add_ints(x, lanes.ints(1));
    let above = lanes.add_ints(row, lanes.ints(-1));
    let first = lanes.ints(texels.first as i32);
    let left = lanes.add_ints(place(lanes, across, x, texels.stride), first);
    let right = lanes.add_ints(place(lanes, across, next, texels.stride), first);
    let low = place(lanes, down, row, texels.stride);
    let high = place(lanes, down, above, texels.stride);
    let at = [
        lanes.gather(bytes, lanes.add_ints(left, low), needed)?,
        lanes.gather(bytes, lanes.add_ints(right, low), needed)?,
        lanes.gather(bytes, lanes.add_ints(left, high), needed)?,
        lanes.gather(bytes, lanes.add_ints(right, high), needed)?,
    ];
    Some([
        [number(lanes, kind, at[0]), number(lanes, kind, at[1])],
        [number(lanes, kind, at[2]), number(lanes, kind, at[3])],
    ])
}

/// What is to be added for columns or rows, in bytes: see [`TexelOrder`](crate::surface::TexelOrder).
#[inline(always)]
fn place<L: Lanes>(lanes: L, by: [u32; 3], i: L::Ints, stride: usize) -> L::Ints {
    let [one, small, large] = by.map(|by| (by as usize * stride) as i32);
    let ones = lanes.mul_ints(i, lanes.ints(one));
    let fourths = lanes.mul_ints(lanes.shift_right::<2>(i), lanes.ints(small));
    let rest = lanes.mul_ints(lanes.shift_right::<5>(i), lanes.ints(large));
    lanes.add_ints(lanes.add_ints(ones, fourths), rest)
}

#[inline(always)]
fn byte<L: Lanes>(lanes: L, four: L::Ints) -> L::Floats {
    let byte = lanes.to_floats(lanes.and_ints(four, lanes.ints(255)));
    lanes.mul(byte, lanes.floats(FROM_BYTE))
}

#[inline(always)]
fn upper_half<L: Lanes>(lanes: L, two: L::Ints) -> L::Floats {
    lanes.of_halves(lanes.shift_right_unsigned::<16>(two))
}

#[inline(always)]
fn number<L: Lanes>(lanes: L, kind: TexelKind, four: L::Ints) -> L::Floats {
    match kind {
        TexelKind::Byte => byte(lanes, four),
        TexelKind::Half => lanes.of_halves(four),
        TexelKind::Float => lanes.of_bits(four),
    }
}

/// The same anywhere, one after the other.
#[inline(always)]
fn by_one<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Floats; 2],
    needed: u32,
) -> [[L::Floats; 2]; 2] {
    let (mut xs, mut ys) = ([0.0; LANES], [0.0; LANES]);
    lanes.store(x, &mut xs);
    lanes.store(y, &mut ys);
    let [[a, b], [c, d]] = each(texels, [&xs, &ys], needed);
    [
        [lanes.load(&a), lanes.load(&b)],
        [lanes.load(&c), lanes.load(&d)],
    ]
}

#[inline(never)]
fn each(texels: &Texels<'_>, [xs, ys]: [&[f32; LANES]; 2], needed: u32) -> [[[f32; LANES]; 2]; 2] {
    let mut four = [[[0.0; LANES]; 2]; 2];
    for i in (0..LANES).filter(|i| needed >> i & 1 == 1) {
        let values = texels.four(xs[i] as i64, ys[i] as i64);
        for (four, value) in four.iter_mut().flatten().zip(values.as_flattened()) {
            four[i] = *value;
        }
    }
    four
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
