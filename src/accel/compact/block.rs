//! Blocks: up to 7 x 7 micro-quads as 8 x 8 micro-vertices, predicted by a plane and corrected in a few bits.
//!
//! ```text
//!   head  3 x 8 bytes, one word an axis:
//!         base 24 | width 5 | exponent 3 | du 12 | dv 12 | shear 7 | main 1
//!   rows  for each axis, row by row: a field of `width` bits for each vertex; each row starts at a byte
//!
//!   vertex(i, j) = base + ((du i + dv j) 2^exponent >> 5) + field(i, j) + (shear field_main(i, j) >> 6)
//! ```
//!
//! The plane takes up the parametrisation, which is nearly even within a block. What is left is mostly displacement,
//! all along one direction: the axis nearest to it is the main one, and the others follow it by their `shear`. So the
//! fields of one axis hold the heights and those of the others little more than their roundings.

pub(super) use super::super::quads::{CELLS, SIDE};
use super::super::simd::{FIELD_PADDING, WIDEST};
use crate::accel::lattice::{Extent, REACH};

/// Bytes of a head.
pub(super) const HEAD: usize = 24;
/// Blocks start at multiples of this many bytes.
pub(in crate::accel) const UNIT: usize = 4;
/// Bytes after the last block, so that fields can be read by the register.
pub(in crate::accel) const PADDING: usize = 4 * FIELD_PADDING;

/// Bits after the point of `du` and `dv`, and of `shear`.
pub(super) const SLOPE_POINT: u32 = 5;
pub(super) const SHEAR_POINT: u32 = 6;

/// One axis of a block's head.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Axis {
    pub(super) base: i32,
    pub(super) width: u32,
    /// Slopes with [`SLOPE_POINT`], times a power of two already.
    pub(super) du: i32,
    pub(super) dv: i32,
    /// 0 for the main axis.
    pub(super) shear: i32,
}

/// A block's head, and where its rows are.
#[derive(Debug, Clone, Copy)]
pub(in crate::accel) struct Head {
    pub(super) axes: [Axis; 3],
    pub(super) main: usize,
    /// The first byte of each axis's rows, and how far these are apart.
    pub(super) rows: [usize; 3],
    pub(super) strides: [usize; 3],
}

impl Head {
    /// Reads the head of the block of `columns` times `rows` vertices that starts at byte `at`.
    #[inline(always)]
    pub(in crate::accel) fn read(data: &[u8], at: usize, [columns, rows]: [usize; 2]) -> Self {
        let mut head = Self {
            axes: [Axis::default(); 3],
            main: 0,
            rows: [0; 3],
            strides: [0; 3],
        };
        let words = data[at..at + HEAD].as_chunks::<8>().0;
        let mut next = at + HEAD;
        for (k, word) in words.iter().enumerate() {
            let word = i64::from_le_bytes(*word);
            let exponent = (word >> 29) as u32 & 7;
            let width = (word >> 24) as u32 & 31;
            head.axes[k] = Axis {
                base: signed(word, 0, 24),
                width,
                du: signed(word, 32, 12) << exponent,
                dv: signed(word, 44, 12) << exponent,
                shear: signed(word, 56, 7),
            };
            if word < 0 {
                head.main = k;
            }
            head.rows[k] = next;
            head.strides[k] = (columns * width as usize).div_ceil(8);
            next += rows * head.strides[k];
        }
        head
    }

    /// Column `i` of row `j`: the clear twin of what [`traverse`](super::traverse) does with all of them at once.
    #[cfg(test)]
    pub(super) fn vertex(&self, data: &[u8], i: usize, j: usize) -> [i32; 3] {
        let field = |k: usize| {
            let width = self.axes[k].width as usize;
            let first = self.rows[k] + j * self.strides[k] + i * width / 8;
            let window = u32::from_le_bytes(std::array::from_fn(|b| data[first + b]));
            ((window >> (i * width % 8)) & ((1 << width) - 1)) as i32
        };
        let height = field(self.main);
        [0, 1, 2].map(|k| {
            let axis = &self.axes[k];
            let plane = (axis.du * i as i32 + axis.dv * j as i32) >> SLOPE_POINT;
            axis.base + plane + field(k) + ((axis.shear * height) >> SHEAR_POINT)
        })
    }
}

/// The signed number in `bits` bits from bit `first` on.
#[inline(always)]
fn signed(word: i64, first: u32, bits: u32) -> i32 {
    ((word << (64 - first - bits)) >> (64 - bits)) as i32
}

/// A block that is to be written.
pub(super) struct Vertices {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Axis by axis, row by row, [`SIDE`] apart. What is beyond the last column and row repeats them: loops run over
    /// all.
    pub(super) values: [Values; 3],
}

/// Of all vertices of a block, along an axis.
pub(super) type Values = [i32; SIDE * SIDE];

/// The least and the greatest.
fn range(values: &Values) -> (i32, i32) {
    let low = values.iter().fold(i32::MAX, |low, &v| low.min(v));
    let high = values.iter().fold(i32::MIN, |high, &v| high.max(v));
    (low, high)
}

impl Vertices {
    /// Takes the vertex of each column and row that there are.
    pub(super) fn new([columns, rows]: [usize; 2], at: impl Fn(usize, usize) -> [i32; 3]) -> Self {
        let mut values = [[0; SIDE * SIDE]; 3];
        for j in 0..SIDE {
            for i in 0..SIDE {
                let vertex = at(i.min(columns - 1), j.min(rows - 1));
                for (values, x) in values.iter_mut().zip(vertex) {
                    values[SIDE * j + i] = x;
                }
            }
        }
        Self {
            columns,
            rows,
            values,
        }
    }

    pub(super) fn extent(&self) -> Extent {
        let ranges = self.values.each_ref().map(range);
        Extent {
            min: ranges.map(|(low, _)| low),
            max: ranges.map(|(_, high)| high),
        }
    }

    /// Adds the block to `data`, up to a multiple of [`UNIT`] bytes from its start.
    pub(super) fn write(&self, data: &mut Vec<u8>) {
        let start = data.len();
        let mut slopes = [0, 1, 2].map(|k| self.slopes(k));
        let mut rest = [0, 1, 2].map(|k| self.rest(k, &slopes[k]));
        let mut ranges = rest.each_ref().map(range);
        for k in 0..3 {
            // The values themselves always fit into a head's base.
            if !is_base(ranges[k].0) || width(ranges[k].1 - ranges[k].0) > WIDEST {
                slopes[k] = Slopes::rounded([0.0; 2]);
                rest[k] = self.rest(k, &slopes[k]);
                ranges[k] = range(&rest[k]);
            }
        }
        let main = (0..3)
            .max_by_key(|&k| ranges[k].1 - ranges[k].0)
            .expect("three axes");
        let base = ranges[main].0;
        for value in &mut rest[main] {
            *value -= base;
        }
        let mut axes = [Axis::default(); 3];
        for k in 0..3 {
            let (mut low, mut high) = ranges[k];
            let mut shear = 0;
            if k == main {
                (low, high) = (0, high - low);
            } else if let Some(s) = self.shear(&rest[main], &rest[k]) {
                let mut sheared = rest[k];
                for (value, height) in sheared.iter_mut().zip(&rest[main]) {
                    *value -= (s * height) >> SHEAR_POINT;
                }
                let (l, h) = range(&sheared);
                if is_base(l) && width(h - l) < width(high - low) {
                    (low, high, shear) = (l, h, s);
                    rest[k] = sheared;
                }
            }
            for value in &mut rest[k] {
                *value -= low;
            }
            let base = if k == main { base } else { low };
            axes[k] = Axis {
                base,
                width: width(high - low),
                shear,
                ..Axis::default()
            };
            assert!(axes[k].width <= WIDEST, "coordinates beyond the lattice");
            let field = |value: i32, bits: u32| (value as u64) & ((1 << bits) - 1);
            let word = field(base, 24)
                | u64::from(axes[k].width) << 24
                | u64::from(slopes[k].exponent) << 29
                | field(slopes[k].du >> slopes[k].exponent, 12) << 32
                | field(slopes[k].dv >> slopes[k].exponent, 12) << 44
                | field(shear, 7) << 56
                | u64::from(k == main) << 63;
            data.extend_from_slice(&word.to_le_bytes());
        }
        for k in 0..3 {
            for j in 0..self.rows {
                pack(&rest[k][j * SIDE..][..self.columns], axes[k].width, data);
            }
        }
        data.resize(start + (data.len() - start).next_multiple_of(UNIT), 0);
    }

    /// Columns that there are count as 1.
    fn there<T: From<u8>>(&self) -> [T; SIDE] {
        std::array::from_fn(|i| T::from(u8::from(i < self.columns)))
    }

    /// What a plane leaves of the values along an axis.
    fn rest(&self, k: usize, slopes: &Slopes) -> Values {
        let mut rest = self.values[k];
        let across: [i32; SIDE] =
            std::array::from_fn(|i| slopes.du * i.min(self.columns - 1) as i32);
        for (j, row) in rest.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
            let down = slopes.dv * j.min(self.rows - 1) as i32;
            for (value, across) in row.iter_mut().zip(across) {
                *value -= (across + down) >> SLOPE_POINT;
            }
        }
        rest
    }

    /// The plane of least squares along an axis, rounded.
    fn slopes(&self, k: usize) -> Slopes {
        let values = &self.values[k];
        let middle = [self.columns, self.rows].map(|n| 0.5 * (n - 1) as f32);
        let there: [f32; SIDE] = self.there();
        let across: [f32; SIDE] = std::array::from_fn(|i| there[i] * (i as f32 - middle[0]));
        // Differences to the first vertex are exact and small.
        let first = values[0];
        let (mut u, mut v) = ([0.0; SIDE], [0.0; SIDE]);
        let rows = &values.as_chunks::<SIDE>().0[..self.rows];
        for (j, row) in rows.iter().enumerate() {
            let down = j as f32 - middle[1];
            for (i, value) in row.iter().enumerate() {
                let value = (value - first) as f32;
                u[i] += across[i] * value;
                v[i] += there[i] * down * value;
            }
        }
        let sum = |of: [f32; SIDE]| of.iter().sum::<f32>();
        // Sums of squares of 0..n about their middle are n (n^2 - 1) / 12.
        let squares = |n: usize| (n * (n * n - 1)) as f32 / 12.0;
        let point = (1 << SLOPE_POINT) as f32;
        Slopes::rounded([
            point * sum(u) / (squares(self.columns) * self.rows as f32).max(1.0),
            point * sum(v) / (squares(self.rows) * self.columns as f32).max(1.0),
        ])
    }

    /// By how much `values` follow `heights`, by least squares; none if not at all.
    fn shear(&self, heights: &Values, values: &Values) -> Option<i32> {
        // Greater heights times the shear would not fit into 32 bits.
        if heights
            .iter()
            .any(|height| height.unsigned_abs() >= 1 << 24)
        {
            return None;
        }
        let there: [f64; SIDE] = self.there();
        let mut sums = [[0.0; SIDE]; 4];
        let both = (heights.as_chunks::<SIDE>().0.iter()).zip(values.as_chunks::<SIDE>().0);
        for (heights, values) in both.take(self.rows) {
            for i in 0..SIDE {
                let height = there[i] * f64::from(heights[i]);
                let value = there[i] * f64::from(values[i]);
                sums[0][i] += height;
                sums[1][i] += value;
                sums[2][i] += height * height;
                sums[3][i] += height * value;
            }
        }
        let count = (self.columns * self.rows) as f64;
        let [h, v, hh, hv] = sums.map(|of| of.iter().sum::<f64>());
        let slope = (count * hv - h * v) / (count * hh - h * h);
        let shear = (f64::from(1 << SHEAR_POINT) * slope).round();
        (shear != 0.0 && shear.is_finite()).then(|| shear.clamp(-64.0, 63.0) as i32)
    }
}

/// Slopes as a head can hold them.
struct Slopes {
    du: i32,
    dv: i32,
    exponent: u32,
}

impl Slopes {
    fn rounded(slopes: [f32; 2]) -> Self {
        const MOST: f32 = 2047.0;
        let largest = slopes[0].abs().max(slopes[1].abs());
        let exponent = (0..7)
            .find(|&e| largest <= MOST * (1 << e) as f32)
            .unwrap_or(7);
        let scale = (1 << exponent) as f32;
        let [du, dv] =
            slopes.map(|slope| ((slope / scale).round().clamp(-MOST, MOST) as i32) << exponent);
        Self { du, dv, exponent }
    }
}

/// Whether a head can hold it as a base.
fn is_base(value: i32) -> bool {
    (-REACH..REACH).contains(&value)
}

/// Bits that hold 0 to `largest`.
fn width(largest: i32) -> u32 {
    i32::BITS - largest.leading_zeros()
}

/// Adds fields of `width` bits, lowest bits first, and fills the last byte.
fn pack(values: &[i32], width: u32, data: &mut Vec<u8>) {
    let (mut pending, mut bits) = (0_u64, 0);
    for &value in values {
        pending |= (value as u64) << bits;
        bits += width;
        if bits >= 32 {
            data.extend_from_slice(&(pending as u32).to_le_bytes());
            pending >>= 32;
            bits -= 32;
        }
    }
    data.extend_from_slice(&pending.to_le_bytes()[..bits.div_ceil(8) as usize]);
}
