//! A node: the boxes of sixteen children in one cache line.
//!
//! ```text
//!   planes  2 x 3 x 8 bytes: lower and upper, by axis, four bits a child
//!   origin  3 x 4 bytes, single precision
//!   units   3 x 10 bits: exponent and two bits of mantissa of a number in single precision
//!
//!   plane = origin + number x unit
//! ```
//!
//! Origin and unit are the node's own: nothing has to be carried down from its parent. The unit is a fifteenth of the node
//! but for its roundness, at most a quarter more.

use crate::accel::simd::{LANES, Nibbles};
use crate::math::{Bounds3, Vec3};

/// The largest number of a plane.
const MOST: u8 = 15;

/// Bits of a unit, and how far below they lie in a number of single precision.
const UNIT_BITS: u32 = 10;
const UNIT_SHIFT: u32 = 21;

/// The boxes of a node's children, in the face's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Lower planes by axis, and upper ones; children are counted row by row.
    pub(super) planes: [[Nibbles; 3]; 2],
    origin: [f32; 3],
    units: u32,
}

impl Node {
    /// Over children of the given boxes, empty where there is none.
    pub(super) fn new(children: &[Bounds3; LANES]) -> Self {
        let all = children.iter().fold(Bounds3::EMPTY, |a, b| a.union(*b));
        let mut node = Self {
            planes: [[Nibbles::default(); 3]; 2],
            origin: [0.0; 3],
            units: 0,
        };
        if all.is_empty() {
            return node;
        }
        for k in 0..3 {
            let (min, max) = (all.min[k], all.max[k]);
            let exact = (f64::from(max) - f64::from(min)) / f64::from(MOST);
            let mut unit = (exact as f32).to_bits() >> UNIT_SHIFT;
            while min + f32::from(MOST) * unit_of(unit) < max {
                unit += 1;
            }
            node.origin[k] = min;
            node.units |= unit << (UNIT_BITS * k as u32);
            let (mut lower, mut upper) = ([0; LANES], [0; LANES]);
            for (c, child) in children.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
                // 0 / 0 becomes 0.
                let number =
                    |plane: f32| (f64::from(plane) - f64::from(min)) / f64::from(unit_of(unit));
                let mut low = (number(child.min[k]).floor() as u8).min(MOST);
                while low > 0 && node.plane(k, low) > child.min[k] {
                    low -= 1;
                }
                let mut high = (number(child.max[k]).ceil() as u8).min(MOST);
                while node.plane(k, high) < child.max[k] {
                    high += 1;
                }
                (lower[c], upper[c]) = (low, high);
            }
            node.planes[0][k] = Nibbles::new(lower);
            node.planes[1][k] = Nibbles::new(upper);
        }
        node
    }

    /// Along an axis: where planes of number 0 are, and how far apart they are.
    #[inline(always)]
    pub(super) fn frame(&self, k: usize) -> (f32, f32) {
        let mask = (1 << UNIT_BITS) - 1;
        let unit = unit_of(self.units >> (UNIT_BITS * k as u32) & mask);
        (self.origin[k], unit)
    }

    /// A child's box; some box where there is no child.
    pub(super) fn child(&self, c: usize) -> Bounds3 {
        let corner =
            |planes: &[Nibbles; 3]| Vec3::from([0, 1, 2].map(|k| self.plane(k, planes[k].get(c))));
        Bounds3 {
            min: corner(&self.planes[0]),
            max: corner(&self.planes[1]),
        }
    }

    fn plane(&self, k: usize, number: u8) -> f32 {
        let (origin, unit) = self.frame(k);
        origin + f32::from(number) * unit
    }
}

#[inline(always)]
fn unit_of(bits: u32) -> f32 {
    f32::from_bits(bits << UNIT_SHIFT)
}
