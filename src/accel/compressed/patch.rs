//! Patches: parts of a face, of up to 4 x 4 tiles each.
//!
//! Faces are cut into patches and these into tiles as evenly as whole quads allow, so that few of the sixteen places
//! of a patch and of a tile are empty: tiles have about nine quads along a side, patches four times as many.

use bytemuck::{Pod, Zeroable};

use super::tile::{FAN, some};
use crate::accel::boxes::Boxes;

/// Quads along a tile's side, about.
const TILE: usize = 9;

/// A part of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Patch {
    /// By its place among the faces that are not holes.
    pub(super) face: u32,
    /// Its column and row in the face.
    pub(super) place: [u8; 2],
    /// Columns and rows of quads.
    pub(super) quads: [u8; 2],
    /// Its fan at the first motion key, or its tile if it [is single](Self::is_single).
    pub(super) root: u32,
}

/// The tiles of a patch at a motion key, counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(16))]
pub(super) struct Fan {
    pub(super) boxes: Boxes,
    /// The first of them, which follow each other without gaps.
    pub(super) first: u32,
}

impl Patch {
    /// Whether there is a single tile, and no fan above.
    #[inline(always)]
    pub(super) fn is_single(&self) -> bool {
        self.tiles() == [1; 2]
    }

    /// Columns and rows of tiles.
    #[inline(always)]
    pub(super) fn tiles(&self) -> [usize; 2] {
        self.quads.map(|quads| tiles(quads.into()))
    }

    /// The first column and row of quads in a face of so many.
    #[inline(always)]
    pub(super) fn first(&self, size: [u16; 2]) -> [usize; 2] {
        [0, 1].map(|k| first(self.place[k].into(), size[k].into()))
    }

    /// The tiles, as bits.
    #[inline(always)]
    pub(super) fn there(&self) -> u32 {
        some(self.tiles())
    }

    /// Columns or rows of quads before the tile in a column or row.
    #[inline(always)]
    pub(super) fn before(&self, axis: usize, tile: usize) -> usize {
        // Divided by a constant rather than by what is not known: all numbers of tiles divide it.
        const ALL: usize = 12;
        let quads = usize::from(self.quads[axis]);
        tile * quads * (ALL / tiles(quads)) / ALL
    }

    /// Columns and rows of quads of a tile.
    #[inline(always)]
    pub(super) fn quads_of(&self, tile: usize) -> [usize; 2] {
        let of = |axis, n| self.before(axis, n + 1) - self.before(axis, n);
        [of(0, tile % FAN), of(1, tile / FAN)]
    }

    /// The number of a tile without gaps.
    #[inline(always)]
    pub(super) fn number(&self, tile: usize) -> usize {
        tile / FAN * self.tiles()[0] + tile % FAN
    }
}

/// Patches along a side of so many quads.
pub(super) fn patches(quads: usize) -> usize {
    tiles(quads).div_ceil(FAN)
}

/// The first quad of a patch along such a side.
#[inline(always)]
pub(super) fn first(patch: usize, quads: usize) -> usize {
    patch * quads / patches(quads)
}

/// Tiles along a side of so many quads.
#[inline(always)]
pub(super) fn tiles(quads: usize) -> usize {
    ((quads + TILE / 2) / TILE).max(1)
}

/// Tiles of all patches along such a side.
pub(super) fn tiles_of_patches(quads: usize) -> usize {
    (0..patches(quads))
        .map(|patch| tiles(first(patch + 1, quads) - first(patch, quads)))
        .sum()
}
