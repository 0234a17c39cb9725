//! Patches: up to 4 x 4 blocks of a face under one node.
//!
//! A node says nothing that follows from a block's place: blocks lie one after the other, and of each only its box and
//! its size are kept. A patch of a single block that does not move needs no node.

use bytemuck::{Pod, Zeroable};

use super::block::{CELLS, UNIT, Vertices};
use crate::accel::boxes::Boxes;
use crate::accel::lattice::Extent;
use crate::surface::MOST_SEGMENTS;

/// Blocks along a patch's side.
pub(in crate::accel) const FAN: usize = 4;

/// Quads along a full patch's side.
pub(in crate::accel) const SPAN: usize = FAN * CELLS;

/// A part of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(in crate::accel) struct Patch {
    /// By its place among the faces that are not holes.
    pub(in crate::accel) face: u32,
    /// Of the face's patches.
    pub(in crate::accel) column: u8,
    pub(in crate::accel) row: u8,
    /// Columns and rows of quads, so that a ray need not ask the face.
    cells: [u8; 2],
    /// Its node at the first motion key; or where its block starts, in [`UNIT`]s, if it [is single](Fan::is_single).
    pub(in crate::accel) root: u32,
}

/// How many quads and blocks a patch has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::accel) struct Fan {
    /// Columns and rows of quads.
    pub(in crate::accel) cells: [usize; 2],
    /// Columns and rows of blocks.
    pub(in crate::accel) blocks: [usize; 2],
}

impl Patch {
    /// In a face of so many quads, some of which are there.
    pub(in crate::accel) fn new(face: u32, at: [usize; 2], size: [u16; 2], root: u32) -> Self {
        const { assert!(MOST_SEGMENTS as usize / SPAN < 256, "places are bytes") };
        let cells = |k: usize| (usize::from(size[k]) - SPAN * at[k]).min(SPAN) as u8;
        Self {
            face,
            column: at[0] as u8,
            row: at[1] as u8,
            cells: [cells(0), cells(1)],
            root,
        }
    }

    /// Its quads and blocks.
    #[inline(always)]
    pub(in crate::accel) fn fan(&self) -> Fan {
        let cells = self.cells.map(usize::from);
        Fan {
            cells,
            blocks: cells.map(|n| n.div_ceil(CELLS)),
        }
    }
}

impl Fan {
    /// Whether there is a single block.
    #[inline(always)]
    pub(in crate::accel) fn is_single(&self) -> bool {
        self.blocks == [1; 2]
    }

    /// The blocks, as bits.
    #[inline(always)]
    pub(in crate::accel) fn there(&self) -> u32 {
        let [columns, rows] = self.blocks;
        (0x1111 * ((1 << columns) - 1)) & ((1 << (FAN * rows)) - 1)
    }

    /// Columns and rows of quads of a block.
    #[inline(always)]
    pub(in crate::accel) fn cells_of(&self, block: usize) -> [usize; 2] {
        let [nu, nv] = self.cells;
        let (i, j) = (block % FAN, block / FAN);
        [(nu - CELLS * i).min(CELLS), (nv - CELLS * j).min(CELLS)]
    }
}

/// The blocks of a patch at a motion key, counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(in crate::accel) struct Node {
    pub(in crate::accel) boxes: Boxes,
    /// In [`UNIT`]s.
    pub(in crate::accel) sizes: [u8; 16],
    /// Where the first one starts, in [`UNIT`]s.
    pub(in crate::accel) data: u32,
}

impl Node {
    /// Over blocks of the given boxes, empty where there is none; where the first starts and how large they are, in
    /// [`UNIT`]s.
    pub(in crate::accel) fn new(blocks: &[Extent; 16], data: u32, sizes: [u8; 16]) -> Self {
        Self {
            boxes: Boxes::new(blocks),
            sizes,
            data,
        }
    }

    /// The byte at which a block starts.
    #[inline(always)]
    pub(in crate::accel) fn block(&self, c: usize) -> usize {
        // The sizes before it, summed up in four lanes of a word each.
        let all = u128::from_le_bytes(self.sizes) & ((1 << (8 * c)) - 1);
        const EVEN: u128 = u128::MAX / 0xffff * 0xff;
        let pairs = (all & EVEN) + (all >> 8 & EVEN);
        let halves = (pairs as u64).wrapping_add((pairs >> 64) as u64);
        let before = (halves.wrapping_mul(0x0001_0001_0001_0001) >> 48) as u32;
        (self.data + before) as usize * UNIT
    }
}

/// Writes the blocks of a patch of `columns` times `rows` quads, whose vertices on the lattice are in rows that start
/// `stride` apart, and makes its node. What the patch encloses.
pub(in crate::accel) fn pack(
    lattice: &[[i32; 3]],
    stride: usize,
    [columns, rows]: [usize; 2],
    data: &mut Vec<u8>,
) -> (Node, Extent) {
    let start = (data.len() / UNIT) as u32;
    let mut children = [Extent::EMPTY; 16];
    let mut sizes = [0; 16];
    let [across, down] = [columns, rows].map(|n| n.div_ceil(CELLS));
    for (cj, ci) in (0..down).flat_map(|cj| (0..across).map(move |ci| (cj, ci))) {
        let (i, j) = (CELLS * ci, CELLS * cj);
        let there = [(columns - i).min(CELLS) + 1, (rows - j).min(CELLS) + 1];
        let block = Vertices::new(there, |x, y| lattice[stride * (j + y) + i + x]);
        let before = data.len();
        block.write(data);
        let child = FAN * cj + ci;
        children[child] = block.extent();
        sizes[child] = ((data.len() - before) / UNIT) as u8;
    }
    let extent = children.iter().fold(Extent::EMPTY, |a, b| a.union(*b));
    (Node::new(&children, start, sizes), extent)
}
