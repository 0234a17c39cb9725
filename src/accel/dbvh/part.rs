//! Parts of a patch: a tree that follows from numbers alone.
//!
//! ```text
//!   quad      blocks of up to 7 x 7 micro-quads, as even as whole numbers are
//!   patch     4^l x 4^l of its blocks, or what is left at its ends; l is the face's number of levels
//!   part      of level l the patch itself; of level l - 1 up to 4 x 4 in each; and so on down to blocks, of level 0
//! ```
//!
//! Nothing is stored of a part but its children's heights.

use super::face::{Face, Patch};
use crate::accel::quads::CELLS;

/// Children along a part's side.
pub(super) const FAN: usize = 4;

/// Its logarithm.
const FAN_BITS: usize = 2;

/// The most levels of parts above blocks.
pub(super) const MOST_LEVELS: usize = 5;

/// A part of a patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Part {
    /// 0 of blocks.
    pub(super) level: usize,
    /// Column and row among the quad's parts of this level.
    pub(super) at: [usize; 2],
}

impl Part {
    /// Bits of columns and rows, of which there are no more than blocks in 4096 micro-quads.
    const BITS: usize = 10;

    /// A number for it, below 2^23.
    #[inline(always)]
    pub(super) fn number(&self) -> usize {
        (self.level << (2 * Self::BITS)) | (self.at[1] << Self::BITS) | self.at[0]
    }

    /// The part of a number.
    #[inline(always)]
    pub(super) fn of_number(number: usize) -> Self {
        let mask = (1 << Self::BITS) - 1;
        Self {
            level: number >> (2 * Self::BITS),
            at: [number & mask, number >> Self::BITS & mask],
        }
    }

    /// The one in column and row `c % 4`, `c / 4`. Not of a block.
    #[inline(always)]
    pub(super) fn child(&self, c: usize) -> Self {
        Self {
            level: self.level - 1,
            at: [FAN * self.at[0] + c % FAN, FAN * self.at[1] + c / FAN],
        }
    }
}

/// Blocks of a side of so many micro-quads, and the micro-quads of one, times 65536 and rounded up.
pub(super) fn cut(cells: u16) -> (u16, u32) {
    let blocks = usize::from(cells).div_ceil(CELLS);
    let step = (usize::from(cells) << 16).div_ceil(blocks);
    (blocks as u16, step as u32)
}

impl Face {
    /// Levels of parts above blocks, for so many blocks: patches are about as long as a quad is wide.
    pub(super) fn levels(blocks: [u16; 2]) -> u8 {
        if blocks == [1; 2] {
            return 0;
        }
        let narrow = usize::from(blocks[0].min(blocks[1]));
        let level = narrow.ilog2() as usize / FAN_BITS;
        level.clamp(1, MOST_LEVELS) as u8
    }

    /// How many parts of a level a quad has.
    #[inline(always)]
    pub(super) fn parts(&self, level: usize) -> [usize; 2] {
        let bits = FAN_BITS * level;
        (self.blocks).map(|n| (usize::from(n) + (1 << bits) - 1) >> bits)
    }

    /// How many patches a quad is cut into, along u and v.
    pub(super) fn pieces(&self) -> [usize; 2] {
        self.parts(self.levels.into())
    }

    /// All of a patch, as a part.
    #[inline(always)]
    pub(super) fn root(&self, patch: &Patch) -> Part {
        Part {
            level: self.levels.into(),
            at: patch.piece.map(usize::from),
        }
    }

    /// How many children a part has along u and v.
    #[inline(always)]
    pub(super) fn fan(&self, part: &Part) -> [usize; 2] {
        let all = self.parts(part.level - 1);
        [0, 1].map(|k| (all[k] - FAN * part.at[k]).min(FAN))
    }

    /// The children, as bits.
    #[inline(always)]
    pub(super) fn there(&self, part: &Part) -> u32 {
        let [columns, rows] = self.fan(part);
        (0x1111 * ((1 << columns) - 1)) & ((1 << (FAN * rows)) - 1)
    }

    /// What columns or rows of a part's children are multiplied by for 65536 times the micro-quads before them.
    #[inline(always)]
    pub(super) fn step(&self, part: &Part, k: usize) -> u32 {
        self.steps[k] << (FAN_BITS * (part.level - 1))
    }

    /// Parts of a level in a patch, along u and v, and the first one in the quad.
    #[inline(always)]
    fn of_patch(&self, patch: &Patch, level: usize) -> [[usize; 2]; 2] {
        let bits = FAN_BITS * (usize::from(self.levels) - level);
        let all = self.parts(level);
        let first = patch.piece.map(|piece| usize::from(piece) << bits);
        [[0, 1].map(|k| (all[k] - first[k]).min(1 << bits)), first]
    }

    /// The places in which a patch keeps what it knows of parts of a level: those of higher levels come first.
    #[inline(always)]
    pub(super) fn places(&self, patch: &Patch, level: usize) -> std::ops::Range<usize> {
        let (mut first, mut count) = (0, 0);
        for level in (level..=self.levels.into()).rev() {
            let [[columns, rows], _] = self.of_patch(patch, level);
            first += count;
            count = columns * rows;
        }
        first..first + count
    }

    /// How many parts above blocks a patch has.
    pub(super) fn inner_parts(&self, patch: &Patch) -> usize {
        if self.levels == 0 {
            0
        } else {
            self.places(patch, 1).end
        }
    }

    /// The place of a part above blocks: children of one follow one another, and so do parts in one row.
    #[inline(always)]
    pub(super) fn place(&self, patch: &Patch, part: &Part) -> usize {
        let [[columns, rows], first] = self.of_patch(patch, part.level);
        let at = [0, 1].map(|k| part.at[k] - first[k]);
        let [i, j] = at.map(|at| at / FAN * FAN);
        let [wide, high] = [(columns - i).min(FAN), (rows - j).min(FAN)];
        let before = j * columns + i * high;
        self.places(patch, part.level).start + before + (at[1] - j) * wide + at[0] - i
    }

    /// The part of a level in a place, counted from the level's first one.
    pub(super) fn part_in(&self, patch: &Patch, level: usize, place: usize) -> Part {
        let [[columns, rows], first] = self.of_patch(patch, level);
        let j = place / (FAN * columns) * FAN;
        let high = (rows - j).min(FAN);
        let place = place - j * columns;
        let i = place / (FAN * high) * FAN;
        let wide = (columns - i).min(FAN);
        let place = place - i * high;
        Part {
            level,
            at: [first[0] + i + place % wide, first[1] + j + place / wide],
        }
    }

    /// A part's children that touch the face's border, as bits.
    #[inline(always)]
    pub(super) fn on_border(&self, patch: &Patch, part: &Part) -> u32 {
        let (fan, all) = (self.fan(part), self.parts(part.level - 1));
        let at_first = |k: usize| patch.quad[k] == 0 && part.at[k] == 0;
        let at_last =
            |k: usize| patch.quad[k] + 1 == self.quads[k] && FAN * part.at[k] + fan[k] == all[k];
        let mut bits = 0;
        if at_first(0) {
            bits |= 0x1111;
        }
        if at_last(0) {
            bits |= 0x1111 << (fan[0] - 1);
        }
        if at_first(1) {
            bits |= 0xf;
        }
        if at_last(1) {
            bits |= 0xf << (FAN * (fan[1] - 1));
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::super::face::{NONE, Side, share};
    use super::*;
    use crate::surface::MOST_SEGMENTS;

    /// A face of one quad.
    fn face(cells: [u16; 2]) -> Face {
        let [(columns, across), (rows, up)] = cells.map(cut);
        let blocks = [columns, rows];
        let side = Side {
            first: NONE,
            segments: 0,
            reversed: false,
            collapsed: false,
        };
        Face {
            face: 0,
            quads: [1; 2],
            cells,
            group: [1; 2],
            share: cells.map(share),
            blocks,
            steps: [across, up],
            levels: Face::levels(blocks),
            is_flat: false,
            bent: 0.0,
            first: 0,
            first_height: 0,
            sides: [side; 4],
            vertices: [NONE; 4],
            has_kept: false,
            slack: 0.0,
        }
    }

    /// What is in each of two places, of all micro-quads.
    fn blocks_below(face: &Face, part: Part, met: &mut Vec<[usize; 2]>) {
        if part.level == 0 {
            met.push(part.at);
            return;
        }
        let there = face.there(&part);
        for c in (0..16).filter(|c| there >> c & 1 == 1) {
            assert_eq!(Part::of_number(part.child(c).number()), part.child(c));
            blocks_below(face, part.child(c), met);
        }
    }

    #[test]
    fn cuts_are_even() {
        for n in 1..=MOST_SEGMENTS as u16 {
            let face = face([n, 1]);
            let blocks = usize::from(face.blocks[0]);
            let patch = patch([0; 2]);
            let mut end = 0;
            for block in 0..blocks {
                let span = face.span(&patch, [block, 0]);
                assert_eq!(span.first[0], end);
                let even = usize::from(n) / blocks;
                assert!((even..=even + 1).contains(&span.cells[0]) && span.cells[0] <= CELLS);
                end += span.cells[0];
            }
            assert_eq!(end, usize::from(n));
        }
    }

    fn patch(piece: [u16; 2]) -> Patch {
        Patch {
            face: 0,
            quad: [0; 2],
            piece,
            ranges: 0,
        }
    }

    #[test]
    fn every_part_is_there_once_and_has_a_place() {
        for cells in [
            [1, 8],
            [8, 8],
            [29, 57],
            [113, 400],
            [200, 9],
            [1000, 450],
            [4096, 3],
        ] {
            let face = face(cells);
            let mut all = Vec::new();
            let [columns, rows] = face.pieces().map(|n| n as u16);
            for piece in (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j])) {
                let patch = patch(piece);
                blocks_below(&face, face.root(&patch), &mut all);
                let mut next = 0;
                for level in (1..=usize::from(face.levels)).rev() {
                    let places = face.places(&patch, level);
                    assert_eq!(places.start, next, "{cells:?}");
                    next = places.end;
                    for place in 0..places.len() {
                        let part = face.part_in(&patch, level, place);
                        assert_eq!(face.place(&patch, &part), places.start + place);
                    }
                }
                assert_eq!(next, face.inner_parts(&patch));
            }
            all.sort_unstable_by_key(|[i, j]| [*j, *i]);
            let [columns, rows] = face.blocks.map(usize::from);
            let expected = (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
            assert!(all.into_iter().eq(expected), "{cells:?}");
        }
    }
}
