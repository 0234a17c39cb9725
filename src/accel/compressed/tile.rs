//! Tiles: the slabs of up to 4 x 4 leaves in one cache line.
//!
//! ```text
//!   origin   3 x 24 bits: a point of the lattice
//!   steps    3 x 3 x 8 bits, 3 exponents: how u, v and h grow along the lattice's axes
//!   margin   8 bits, exponent and 3 of mantissa: how far micro-vertices are off their lines, in quads
//!   unit     8 bits, likewise: of depths, in heights
//!   heights  5 x 5 bytes: h where the borders of leaves cross
//!   depths   2 x 16 x 4 bits: how far the surface may be below and above, leaf by leaf
//!
//!   leaf (i, j): u and v between its borders, margin included;
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
use crate::accel::simd::{LANES, Nibbles};
use crate::math::DVec3;

/// Leaves along a tile's side, and tiles along a patch's.
pub(super) const FAN: usize = 4;

/// The most quads along a tile's side.
pub(super) const MOST_QUADS: usize = 11;

/// Corners along a tile's side.
const CORNERS: usize = FAN + 1;

/// The largest number of a depth.
pub(super) const DEEPEST: u8 = 15;

/// The slabs of up to sixteen leaves at a motion key, counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Tile {
    /// In the upper 24 bits; in the lower ones what the exponents of u, v and h are in single precision.
    origin: [i32; 3],
    /// Of u, v and h, by the lattice's axes.
    steps: [[i8; 3]; 3],
    margin: u8,
    unit: u8,
    /// Heights of the first four columns of corners, row by row, and of the last one.
    heights: [u8; FAN * CORNERS],
    last: [u8; CORNERS],
    /// Below and above.
    depths: [Nibbles; 2],
}

/// What a tile is made of.
pub(super) struct Parts {
    pub(super) origin: [i32; 3],
    pub(super) axes: [Axis; 3],
    /// Rounded up.
    pub(super) margin: f32,
    pub(super) heights: [[u8; CORNERS]; CORNERS],
    /// Below and above, in heights; rounded up.
    pub(super) depths: [[f32; 2]; LANES],
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
        let deepest = parts
            .depths
            .iter()
            .flatten()
            .fold(0.0_f32, |a, b| a.max(*b));
        let unit = amount_above(deepest / f32::from(DEEPEST));
        let depth = |depth: f32| {
            let mut number = ((depth / amount(unit)).ceil() as u8).min(DEEPEST);
            while number < DEEPEST && f32::from(number) * amount(unit) < depth {
                number += 1;
            }
            number
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
            margin: amount_above(parts.margin),
            unit,
            heights,
            last: parts.heights.map(|row| row[FAN]),
            depths: [0, 1]
                .map(|side| Nibbles::new(parts.depths.map(|of_leaf| depth(of_leaf[side])))),
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

    #[inline(always)]
    pub(super) fn margin(&self) -> f32 {
        amount(self.margin)
    }

    #[inline(always)]
    pub(super) fn unit(&self) -> f32 {
        amount(self.unit)
    }

    /// How deep leaves are below or above, in units.
    #[inline(always)]
    pub(super) fn depths(&self, side: usize) -> &Nibbles {
        &self.depths[side]
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
