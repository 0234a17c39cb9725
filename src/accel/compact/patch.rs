//! Patches: up to 4 x 4 blocks of a face under one node.
//!
//! A node says nothing that follows from a block's place: blocks lie one after the other, and of each only its box and
//! its size are kept. A patch of a single block that does not move needs no node.

use bytemuck::{Pod, Zeroable};

use super::block::{CELLS, UNIT};
use crate::accel::boxes::Boxes;
use crate::accel::lattice::Extent;

/// Blocks along a patch's side.
pub(super) const FAN: usize = 4;

/// Quads along a full patch's side.
pub(super) const SPAN: usize = FAN * CELLS;

/// A part of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Patch {
    /// By its place among the faces that are not holes.
    pub(super) face: u32,
    pub(super) column: u16,
    pub(super) row: u16,
    /// Its node at the first motion key; or where its block starts, in [`UNIT`]s, if it [is single](Fan::is_single).
    pub(super) root: u32,
}

/// How many quads and blocks a patch has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fan {
    /// Columns and rows of quads.
    pub(super) cells: [usize; 2],
    /// Columns and rows of blocks.
    pub(super) blocks: [usize; 2],
}

impl Patch {
    /// In a face of so many quads.
    #[inline(always)]
    pub(super) fn fan(&self, [nu, nv]: [u16; 2]) -> Fan {
        let cells = [
            (usize::from(nu) - SPAN * usize::from(self.column)).min(SPAN),
            (usize::from(nv) - SPAN * usize::from(self.row)).min(SPAN),
        ];
        Fan {
            cells,
            blocks: cells.map(|n| n.div_ceil(CELLS)),
        }
    }
}

impl Fan {
    /// Whether there is a single block.
    #[inline(always)]
    pub(super) fn is_single(&self) -> bool {
        self.blocks == [1; 2]
    }

    /// The blocks, as bits.
    #[inline(always)]
    pub(super) fn there(&self) -> u32 {
        let [columns, rows] = self.blocks;
        (0x1111 * ((1 << columns) - 1)) & ((1 << (FAN * rows)) - 1)
    }

    /// Columns and rows of quads of a block.
    #[inline(always)]
    pub(super) fn cells_of(&self, block: usize) -> [usize; 2] {
        let [nu, nv] = self.cells;
        let (i, j) = (block % FAN, block / FAN);
        [(nu - CELLS * i).min(CELLS), (nv - CELLS * j).min(CELLS)]
    }
}

/// The blocks of a patch at a motion key, counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Node {
    pub(super) boxes: Boxes,
    /// In [`UNIT`]s.
    pub(super) sizes: [u8; 16],
    /// Where the first one starts, in [`UNIT`]s.
    pub(super) data: u32,
}

impl Node {
    /// Over blocks of the given boxes, empty where there is none; where the first starts and how large they are, in
    /// [`UNIT`]s.
    pub(super) fn new(blocks: &[Extent; 16], data: u32, sizes: [u8; 16]) -> Self {
        Self {
            boxes: Boxes::new(blocks),
            sizes,
            data,
        }
    }

    /// The byte at which a block starts.
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
