//! The tree over a face's blocks: complete, sixteen children a node, boxes of a byte per plane.
//!
//! Level 0 are the blocks, in rows and columns as the grid has them; a node of level `l` has the 4 x 4 of level `l - 1`
//! below it, fewer at the grid's far sides. So a node's children follow from its own place: nothing points. Boxes are
//! bytes in a frame of the node's own, whose origin is on the lattice and whose unit is a power of two of lattice
//! steps: decoding takes no rounding, and what encloses as integers encloses.

use super::block::UNIT;
use super::lattice::Extent;

/// A node's children.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Planes of the children, axis by axis, in the node's frame; children are counted row by row.
    pub(super) lower: [[u8; 16]; 3],
    pub(super) upper: [[u8; 16]; 3],
    /// The sizes of children that are blocks, in [`UNIT`]s.
    sizes: [u8; 16],
    /// For each axis, the frame's origin in the upper 24 bits, and the exponent of its unit.
    frame: [i32; 3],
    /// Where the first child that is a block starts, in [`UNIT`]s.
    pub(super) data: u32,
}

impl Node {
    /// Over children of the given boxes, empty where there is none. For blocks, also where the first starts and how
    /// large they are, in [`UNIT`]s.
    pub(super) fn new(children: &[Extent; 16], data: u32, sizes: [u8; 16]) -> Self {
        let all = children.iter().fold(Extent::EMPTY, |a, b| a.union(*b));
        let mut node = Self {
            lower: [[u8::MAX; 16]; 3],
            upper: [[0; 16]; 3],
            sizes,
            frame: [0; 3],
            data,
        };
        if all.is_empty() {
            return node;
        }
        for k in 0..3 {
            let unit = |e: u32| i64::from(u8::MAX) << e;
            let reach = i64::from(all.max[k]) - i64::from(all.min[k]);
            let exponent = (0..32)
                .find(|&e| unit(e) >= reach)
                .expect("coordinates have 24 bits");
            node.frame[k] = all.min[k] << 8 | exponent as i32;
            for (c, child) in children.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
                let up = (1 << exponent) - 1;
                node.lower[k][c] = ((child.min[k] - all.min[k]) >> exponent) as u8;
                node.upper[k][c] = ((child.max[k] - all.min[k] + up) >> exponent) as u8;
            }
        }
        node
    }

    /// The frame along an axis: its origin, and its unit in steps.
    #[inline(always)]
    pub(super) fn frame(&self, k: usize) -> (f32, f32) {
        let frame = self.frame[k];
        let unit = f32::from_bits((127 + (frame as u32 & 0xff)) << 23);
        ((frame >> 8) as f32, unit)
    }

    /// A child's box.
    pub(super) fn child(&self, c: usize) -> Extent {
        let plane = |bytes: &[[u8; 16]; 3]| {
            [0, 1, 2].map(|k| {
                let exponent = self.frame[k] & 0xff;
                (self.frame[k] >> 8) + (i32::from(bytes[k][c]) << exponent)
            })
        };
        Extent {
            min: plane(&self.lower),
            max: plane(&self.upper),
        }
    }

    /// The byte at which the block that is child `c` starts.
    #[inline(always)]
    pub(super) fn block(&self, c: usize) -> usize {
        // The sizes before it, summed up in four lanes of a word each.
        let all = u128::from_le_bytes(self.sizes) & ((1 << (8 * c)) - 1);
        const EVEN: u128 = u128::MAX / 0xffff * 0xff;
        let pairs = (all & EVEN) + (all >> 8 & EVEN);
        let halves = (pairs as u64).wrapping_add((pairs >> 64) as u64);
        let before = (halves.wrapping_mul(0x0001_0001_0001_0001) >> 48) as u32;
        (self.data + before) as usize * UNIT
    }
}
