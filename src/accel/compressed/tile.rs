//! Tiles: the slabs of up to 4 x 4 leaves.
//!
//! ```text
//!   origin   3 x 24 bits: a point of the lattice
//!   steps    3 x 3 x 8 bits, 3 exponents: how u, v and h grow along the lattice's axes
//!   heights  5 x 5 bytes: h where the borders of leaves cross
//!   depths   2 x 16 x 4 bits: how far the surface may be below and above, leaf by leaf
//!   sides    4 x 16 x 4 bits: how far the surface may reach along u and v, leaf by leaf
//!   units    2 x 8 bits, exponent and 3 of mantissa: of depths, in heights, and of sides, in quads
//!
//!   leaf (i, j): u and v between its borders, as far as its sides say;
//!                -below <= h - plane(u, v) <= above, where plane is the mean plane of its four corners
//! ```
//!
//! In a tile's own coordinates u and v count quads, and h runs along the direction in which micro-vertices are off the
//! tile's plane: along the displacement, wherever there is some. So displaced vertices stay over their quads, however steep
//! they are; and how far a leaf's surface is off its plane is a matter of its bends alone, where a box would have to be
//! as thick as its slopes are high.
//!
//! At all motion keys a tile has the same coordinates but for their origin. So coordinates, heights, planes and depths of
//! a moment between two keys are those of the keys, blended.

use bytemuck::{Pod, Zeroable};

use crate::accel::lattice::REACH;
use crate::accel::simd::{LANES, Lanes, Nibbles};
use crate::math::DVec3;

/// Leaves along a tile's side, and tiles along a patch's.
pub(super) const FAN: usize = 4;

/// The most quads along a tile's side.
pub(super) const MOST_QUADS: usize = 13;

/// Corners along a tile's side.
const CORNERS: usize = FAN + 1;

/// The largest number of a depth and of a side.
const MOST: u8 = 15;

/// The number of a side that is neither wider than its leaf's quads nor narrower.
const EVEN: u8 = 4;

/// Vertices are no farther from a tile's origin along u and v.
pub(super) const WIDEST: f64 = 64.0;

/// The slabs of up to sixteen leaves at a motion key, counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Tile {
    /// In the upper 24 bits; in the lower ones what the exponents of u, v and h are in single precision.
    origin: [i32; 3],
    /// Of u, v and h, by the lattice's axes.
    steps: [[i8; 3]; 3],
    /// Of depths and of sides.
    units: [u8; 2],
    /// Heights of the first four columns of corners, row by row, and of the last one.
    heights: [u8; FAN * CORNERS],
    last: [u8; CORNERS],
    /// Below and above.
    depths: [Nibbles; 2],
    /// Of least u and v, and of most.
    sides: [[Nibbles; 2]; 2],
}

/// What a tile is made of.
pub(super) struct Parts {
    pub(super) origin: [i32; 3],
    pub(super) axes: [Axis; 3],
    pub(super) heights: [[u8; CORNERS]; CORNERS],
    /// Below and above, in heights; rounded up.
    pub(super) depths: [[f32; 2]; LANES],
    /// How much wider leaves are than their quads, at the least u and v and at the most; rounded up.
    pub(super) sides: [[[f32; 2]; 2]; LANES],
}

/// How a coordinate grows along the lattice's axes: exactly what a tile can hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Axis {
    steps: [i8; 3],
    /// As in single precision.
    exponent: u8,
}

impl Axis {
    /// The nearest one, within single precision.
    pub(super) fn nearest(steps: DVec3) -> Self {
        const MOST: f64 = 127.0;
        let exponent = (steps.abs().max_element() / MOST).log2().ceil();
        let exponent = (exponent.max(-126.0) + 127.0) as u8;
        let unit = f64::from(power(exponent.into()));
        let steps = steps.to_array();
        Self {
            steps: steps.map(|step| (step / unit).round().clamp(-MOST, MOST) as i8),
            exponent,
        }
    }

    /// What it holds.
    pub(super) fn steps(&self) -> DVec3 {
        let unit = f64::from(power(self.exponent.into()));
        DVec3::from_array(self.steps.map(|step| f64::from(step) * unit))
    }
}

/// Two to a power, of which the exponent is given as in single precision.
#[inline(always)]
fn power(exponent: u32) -> f32 {
    f32::from_bits(exponent << 23)
}

/// What a byte of margin or unit stands for: from 2^-10 on.
#[inline(always)]
fn amount(byte: u8) -> f32 {
    f32::from_bits((936 + u32::from(byte)) << 20)
}

/// The least amount that is not below; the largest for what is not a number.
fn amount_above(least: f32) -> u8 {
    (0..u8::MAX)
        .find(|&byte| amount(byte) >= least)
        .unwrap_or(u8::MAX)
}

impl Tile {
    pub(super) fn new(parts: &Parts) -> Self {
        let largest = |amounts: &mut dyn Iterator<Item = f32>| amounts.fold(0.0_f32, f32::max);
        let deepest = largest(&mut parts.depths.iter().flatten().copied());
        let sides = || parts.sides.iter().flatten().flatten();
        let widest = largest(&mut sides().copied());
        let narrowest = largest(&mut sides().map(|side| -side));
        let wide = (widest / f32::from(MOST - EVEN)).max(narrowest / f32::from(EVEN));
        let units = [deepest / f32::from(MOST), wide].map(amount_above);
        let number = |least: f32, even: u8, unit: u8| {
            let decoded = |number| (f32::from(number) - f32::from(even)) * amount(unit);
            (0..MOST).find(|&n| decoded(n) >= least).unwrap_or(MOST)
        };
        let mut heights = [0; FAN * CORNERS];
        for (to, row) in heights
            .as_chunks_mut::<FAN>()
            .0
            .iter_mut()
            .zip(&parts.heights)
        {
            to.copy_from_slice(&row[..FAN]);
        }
        Self {
            origin: [0, 1, 2].map(|k| {
                debug_assert!(parts.origin[k].abs() < REACH);
                parts.origin[k] << 8 | i32::from(parts.axes[k].exponent)
            }),
            steps: parts.axes.map(|axis| axis.steps),
            units,
            heights,
            last: parts.heights.map(|row| row[FAN]),
            depths: [0, 1].map(|side| {
                let of_leaf = parts.depths.map(|depths| depths[side]);
                Nibbles::new(of_leaf.map(|depth| number(depth, 0, units[0])))
            }),
            sides: [0, 1].map(|side| {
                [0, 1].map(|k| {
                    let of_leaf = parts.sides.map(|sides| sides[side][k]);
                    Nibbles::new(of_leaf.map(|wider| number(wider, EVEN, units[1])))
                })
            }),
        }
    }

    #[inline(always)]
    pub(super) fn origin(&self) -> [f32; 3] {
        self.origin.map(|origin| (origin >> 8) as f32)
    }

    /// How u, v and h grow along the lattice's axes.
    #[inline(always)]
    pub(super) fn axes(&self) -> [[f32; 3]; 3] {
        [0, 1, 2].map(|k| {
            let unit = power(self.origin[k] as u32 & 0xff);
            self.steps[k].map(|step| f32::from(step) * unit)
        })
    }

    /// How deep leaves are below or above, in [depths by number](Self::depths_by_number).
    #[inline(always)]
    pub(super) fn depths(&self, side: usize) -> &Nibbles {
        &self.depths[side]
    }

    /// The heights that numbers of depths stand for.
    #[inline(always)]
    pub(super) fn depths_by_number<L: Lanes>(&self, lanes: L) -> L::Floats {
        lanes.mul(lanes.load(&NUMBERS), lanes.floats(amount(self.units[0])))
    }

    /// How deep a leaf is below or above.
    #[inline(always)]
    pub(super) fn depth(&self, side: usize, leaf: usize) -> f32 {
        NUMBERS[usize::from(self.depths[side].get(leaf))] * amount(self.units[0])
    }

    /// How wide leaves are at their least u or v, or at their most, in [sides by number](Self::sides_by_number).
    #[inline(always)]
    pub(super) fn sides(&self, side: usize, k: usize) -> &Nibbles {
        &self.sides[side][k]
    }

    /// The quads that numbers of sides stand for, along an axis: of the least sides, and of the most.
    #[inline(always)]
    pub(super) fn sides_by_number<L: Lanes>(&self, lanes: L) -> [L::Floats; 2] {
        let unit = amount(self.units[1]);
        let even = lanes.floats(EVEN.into());
        let wider = lanes.sub(lanes.load(&NUMBERS), even);
        [
            lanes.mul(wider, lanes.floats(-unit)),
            lanes.mul(wider, lanes.floats(unit)),
        ]
    }

    /// How many quads a leaf is wider at its least u or v, or at its most; less than none at the least ones.
    #[inline(always)]
    pub(super) fn side(&self, side: usize, k: usize, leaf: usize) -> f32 {
        let unit = amount(self.units[1]);
        let wider = NUMBERS[usize::from(self.sides[side][k].get(leaf))] - f32::from(EVEN);
        wider * if side == 0 { -unit } else { unit }
    }

    /// The heights of the four corners of all leaves: (0, 0), (1, 0), (0, 1) and (1, 1).
    #[inline(always)]
    pub(super) fn corners(&self) -> [[u8; LANES]; 4] {
        let rows = self.heights.as_chunks::<FAN>().0;
        // Without its first height, and with that of the last column behind.
        let shifted = |j: usize| u32::from_le_bytes(rows[j]) >> 8 | u32::from(self.last[j]) << 24;
        let four = |first: usize| {
            let two = |j: usize| u64::from(shifted(j)) | u64::from(shifted(j + 1)) << 32;
            (u128::from(two(first)) | u128::from(two(first + 2)) << 64).to_le_bytes()
        };
        let sixteen = |first: usize| std::array::from_fn(|c| self.heights[first + c]);
        [sixteen(0), four(0), sixteen(FAN), four(1)]
    }
}

/// The numbers of depths and sides.
const NUMBERS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Leaves along an axis of so many quads.
#[inline(always)]
pub(super) const fn leaves(quads: usize) -> usize {
    if quads < FAN { quads } else { FAN }
}

/// The first quad of a leaf along an axis of so many.
#[inline(always)]
pub(super) const fn cut(leaf: usize, quads: usize) -> usize {
    leaf * quads / leaves(quads)
}

/// Where leaves are along an axis, lane by lane.
pub(super) struct Cuts {
    /// The first quad and the one after the last, and halfway between.
    pub(super) first: [f32; LANES],
    pub(super) last: [f32; LANES],
    pub(super) middle: [f32; LANES],
    /// Half of the inverse of their distance.
    pub(super) slope: [f32; LANES],
}

/// For columns and for rows, by the number of quads.
pub(super) static CUTS: [[Cuts; MOST_QUADS + 1]; 2] = [all_cuts(1), all_cuts(FAN)];

const fn all_cuts(every: usize) -> [Cuts; MOST_QUADS + 1] {
    const NONE: Cuts = Cuts {
        first: [0.0; LANES],
        last: [0.0; LANES],
        middle: [0.0; LANES],
        slope: [0.0; LANES],
    };
    let mut all = [NONE; MOST_QUADS + 1];
    let mut quads = 1;
    while quads <= MOST_QUADS {
        let mut lane = 0;
        while lane < LANES {
            let leaf = lane / every % FAN;
            if leaf < leaves(quads) {
                let (first, last) = (cut(leaf, quads) as f32, cut(leaf + 1, quads) as f32);
                all[quads].first[lane] = first;
                all[quads].last[lane] = last;
                all[quads].middle[lane] = 0.5 * (first + last);
                all[quads].slope[lane] = 0.5 / (last - first);
            }
            lane += 1;
        }
        quads += 1;
    }
    all
}

/// The leaves of a tile of so many quads, as bits.
#[inline(always)]
pub(super) fn there([nu, nv]: [usize; 2]) -> u32 {
    some([leaves(nu), leaves(nv)])
}

/// So many columns and rows of a fan, as bits.
#[inline(always)]
pub(super) fn some([columns, rows]: [usize; 2]) -> u32 {
    (0x1111 * ((1 << columns) - 1)) & ((1 << (FAN * rows)) - 1)
}
