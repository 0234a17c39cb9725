//! Where heights come from: an image's texels, or floats that were asked for once.

use super::block::{Block, Sheet};
use super::face::Face;
use crate::accel::moment::Moment;
use crate::accel::quads::SIDE;
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

/// The least and the greatest value in each of sixteen blocks, 16 bits each: the least one in the lower bits.
pub(super) type Ranges = [i32; LANES];

/// Codes of a range run up to this.
const MOST: f32 = 65535.0;

impl Heights {
    /// What codes mean so that all values from `low` to `high` have one.
    pub(super) fn encode(&mut self, [low, high]: [f32; 2]) {
        let step = (high - low) / (MOST - 1.0);
        self.code = [low, step.max(f32::MIN_POSITIVE)];
    }

    /// The code of a range of values, rounded outward.
    pub(super) fn code(&self, [low, high]: [f32; 2]) -> i32 {
        let [least, step] = self.code;
        let low = ((low - least) / step - 1e-2).floor().clamp(0.0, MOST);
        let high = ((high - least) / step + 1e-2).ceil().clamp(0.0, MOST);
        low as i32 | (high as i32) << 16
    }

    /// The middles of the heights' ranges, and half of their lengths.
    #[inline(always)]
    pub(super) fn ranges<L: Lanes>(&self, lanes: L, ranges: &Ranges) -> [L::Floats; 2] {
        let codes = lanes.load_ints(ranges);
        let low = lanes.to_floats(lanes.and_ints(codes, lanes.ints(0xffff)));
        let high = lanes.to_floats(lanes.shift_right_unsigned::<16>(codes));
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

    /// The middle of the range of heights that a code means, and half of its length: as [`ranges`](Self::ranges).
    #[inline(always)]
    pub(super) fn range(&self, code: i32) -> [f32; 2] {
        let (low, high) = ((code & 0xffff) as f32, (code as u32 >> 16) as f32);
        let [least, step] = self.code;
        let middle = (low + high) * (0.5 * step * self.scale);
        let shift = self.scale * least + self.bias;
        [
            middle + shift,
            (high - low) * (0.5 * step * self.scale.abs()),
        ]
    }

    /// Two rows of heights of a block. `st` is what its rows have in common.
    #[inline(always)]
    pub(super) fn rows<L: Lanes, S: Sheet<L>>(
        &self,
        lanes: L,
        reader: &Reader<'_>,
        block: &Block<'_>,
        (sheet, st): (&S, &[S::Rows; 2]),
        pair: usize,
        moment: &Moment,
    ) -> L::Floats {
        let value = match reader {
            Reader::Flat(value) => lanes.floats(*value),
            Reader::Image(texels) => {
                let s = sheet.pair(lanes, st[0], pair);
                let t = sheet.pair(lanes, st[1], pair);
                look_up(lanes, texels, s, t)
            }
            Reader::Kept(keys) => {
                let mut two = [0.0; LANES];
                block.two_rows(&keys[moment.from], pair, &mut two);
                let from = lanes.load(&two);
                if moment.from == moment.to {
                    from
                } else {
                    block.two_rows(&keys[moment.to], pair, &mut two);
                    moment.between_lanes(lanes, from, lanes.load(&two))
                }
            }
        };
        let scaled = lanes.mul(value, lanes.floats(self.scale));
        lanes.add(scaled, lanes.floats(self.bias))
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

/// Sixteen look-ups at once, as [`Texels::eval`] does each.
#[inline(always)]
fn look_up<L: Lanes>(lanes: L, texels: &Texels<'_>, s: L::Floats, t: L::Floats) -> L::Floats {
    let (x, fx, x_within) = along(lanes, texels, 0, s);
    let (y, fy, y_within) = along(lanes, texels, 1, t);
    let four = if x_within & y_within == 0xffff {
        inner(lanes, texels, lanes.to_ints(x), lanes.to_ints(y))
    } else {
        None
    };
    let [low, high] = match four {
        Some(four) => four,
        None => by_one(lanes, texels, x, y),
    };
    blend(lanes, [blend(lanes, low, fx), blend(lanes, high, fx)], fy)
}

/// The four texels around places that are not at a border; none if more bytes than there are would be read.
#[inline(always)]
fn inner<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    x: L::Ints,
    y: L::Ints,
) -> Option<[[L::Floats; 2]; 2]> {
    let Texels {
        bytes,
        kind,
        size: [width, height],
        stride,
        first,
        ..
    } = *texels;
    // Rows go down, y goes up.
    let row = stride * width as usize;
    let lowest = lanes.ints((row * (height as usize - 1) + first) as i32);
    let at = lanes.add_ints(lowest, lanes.mul_ints(x, lanes.ints(stride as i32)));
    let at = lanes.add_ints(at, lanes.mul_ints(y, lanes.ints(-(row as i32))));
    let above = lanes.add_ints(at, lanes.ints(-(row as i32)));
    let (here, there) = (lanes.gather(bytes, at)?, lanes.gather(bytes, above)?);
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
            let right = lanes.gather(bytes, lanes.add_ints(at, next))?;
            let above_right = lanes.gather(bytes, lanes.add_ints(above, next))?;
            [
                [number(lanes, kind, here), number(lanes, kind, right)],
                [number(lanes, kind, there), number(lanes, kind, above_right)],
            ]
        }
    })
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
    x: L::Floats,
    y: L::Floats,
) -> [[L::Floats; 2]; 2] {
    let (mut xs, mut ys) = ([0.0; LANES], [0.0; LANES]);
    lanes.store(x, &mut xs);
    lanes.store(y, &mut ys);
    let [[a, b], [c, d]] = each(texels, &xs, &ys);
    [
        [lanes.load(&a), lanes.load(&b)],
        [lanes.load(&c), lanes.load(&d)],
    ]
}

#[inline(never)]
fn each(texels: &Texels<'_>, xs: &[f32; LANES], ys: &[f32; LANES]) -> [[[f32; LANES]; 2]; 2] {
    let mut four = [[[0.0; LANES]; 2]; 2];
    for i in 0..LANES {
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
