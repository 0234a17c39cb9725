//! The heights of a face and the ranges above them: a quadtree of least and greatest heights, two levels at a step.
//!
//! A node of level 0 has 4 x 4 micro-quads for children, whose ranges follow from their heights. A node of level k has 4 x 4
//! nodes of level k - 1, and their ranges are kept: 64 bytes. Nodes follow each other level by level from the root down, and
//! row by row; where one is, is arithmetic. Where the root has 2 x 2 children at most, nothing is kept: it has the range
//! of the quad that is asked about.

use bytemuck::{Pod, Zeroable};

use crate::accel::simd::LANES;

/// Levels of the largest face, of 4096 x 4096 micro-quads.
pub(super) const LEVELS: usize = 6;

/// The ranges of a node's children, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Ranges {
    pub(super) low: [u16; LANES],
    pub(super) high: [u16; LANES],
}

/// The size of a face: its micro-quads along u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Size(pub(super) [u16; 2]);

/// The lowest level of which a single node holds all places that are no more than these bits apart.
#[inline(always)]
fn level(differ: u32) -> u32 {
    (u32::BITS - differ.leading_zeros()).div_ceil(2).max(1) - 1
}

impl Size {
    /// Micro-quads along u and v.
    #[inline(always)]
    pub(super) fn quads(self) -> [usize; 2] {
        self.0.map(usize::from)
    }

    /// The root's level.
    #[inline(always)]
    pub(super) fn root(self) -> u32 {
        level(u32::from(self.0[0].max(self.0[1])) - 1)
    }

    /// The lowest node above the micro-quads from one to another: its level and its first micro-quad.
    #[inline(always)]
    pub(super) fn above(from: [u32; 2], to: [u32; 2]) -> (u32, [u32; 2]) {
        let level = level((from[0] ^ to[0]) | (from[1] ^ to[1]));
        let shift = 2 * level + 2;
        (level, from.map(|x| x >> shift << shift))
    }

    /// How many nodes a level has along u and v.
    #[inline(always)]
    fn nodes(self, level: u32) -> [usize; 2] {
        self.0
            .map(|n| usize::from(n).div_ceil(1 << (2 * level + 2)))
    }

    /// Whether ranges are kept.
    #[inline(always)]
    pub(super) fn keeps_ranges(self) -> bool {
        self.0[0].max(self.0[1]) > 8
    }

    /// Ranges that it has.
    #[inline(always)]
    pub(super) fn ranges(self) -> usize {
        if !self.keeps_ranges() {
            return 0;
        }
        let mut ranges = 0;
        for level in 1..=self.root() {
            ranges += self.count(level);
        }
        ranges
    }

    #[inline(always)]
    fn count(self, level: u32) -> usize {
        let [u, v] = self.nodes(level);
        u * v
    }

    /// The place of a node's ranges, of level 1 at least, whose first micro-quad is in that column and row.
    #[inline(always)]
    pub(super) fn place(self, level: u32, [i, j]: [u32; 2]) -> usize {
        let mut above = 0;
        for level in level + 1..=self.root() {
            above += self.count(level);
        }
        let shift = 2 * level + 2;
        above + (j >> shift) as usize * self.nodes(level)[0] + (i >> shift) as usize
    }
}

/// All ranges of a face's heights, level by level.
pub(super) fn ranges(size: Size, heights: &[u16], out: &mut Vec<Ranges>) {
    if !size.keeps_ranges() {
        return;
    }
    const NOTHING: (u16, u16) = (u16::MAX, 0);
    let join = |a: (u16, u16), b: (u16, u16)| (a.0.min(b.0), a.1.max(b.1));
    let [nu, nv] = size.quads();
    let stride = nu + 1;
    let first = out.len();
    out.resize(
        first + size.ranges(),
        Ranges {
            low: [u16::MAX; LANES],
            high: [0; LANES],
        },
    );
    // Of squares of 4, 16, 64 micro-quads a side.
    let mut columns = nu.div_ceil(4);
    let mut squares: Vec<(u16, u16)> = Vec::new();
    for y in (0..nv).step_by(4) {
        for x in (0..nu).step_by(4) {
            let rows = y..=(y + 4).min(nv);
            let range = rows.fold(NOTHING, |range, y| {
                let row = &heights[y * stride..][x..=(x + 4).min(nu)];
                row.iter().fold(range, |range, &h| join(range, (h, h)))
            });
            squares.push(range);
        }
    }
    for level in 1..=size.root() {
        let rows = squares.len() / columns;
        let (wide, high) = (columns.div_ceil(4), rows.div_ceil(4));
        let mut above = vec![NOTHING; wide * high];
        for (at, &range) in squares.iter().enumerate() {
            let (x, y) = (at % columns, at / columns);
            let node = y / 4 * wide + x / 4;
            above[node] = join(above[node], range);
            let shift = 2 * level + 2;
            let first_of = [x / 4, y / 4].map(|n| (n << shift) as u32);
            let place = size.place(level, first_of);
            let ranges = &mut out[first + place];
            let child = 4 * (y % 4) + x % 4;
            (ranges.low[child], ranges.high[child]) = range;
        }
        (squares, columns) = (above, wide);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::tests::shapes::Random;

    #[test]
    fn ranges_enclose_the_heights_below_and_are_reached() {
        let mut random = Random(5);
        for size in [
            [1, 1],
            [8, 4],
            [9, 2],
            [16, 16],
            [13, 29],
            [32, 8],
            [4, 256],
            [64, 64],
            [1, 70],
            [128, 257],
        ]
        .map(Size)
        {
            let [nu, nv] = size.quads();
            let stride = nu + 1;
            let heights: Vec<u16> = (0..stride * (nv + 1))
                .map(|_| (65535.0 * random.next()) as u16)
                .collect();
            let mut all = Vec::new();
            ranges(size, &heights, &mut all);
            assert_eq!(all.len(), size.ranges());
            let mut seen = vec![false; all.len()];
            for level in 1..=size.root() {
                if !size.keeps_ranges() {
                    break;
                }
                let side = 1 << (2 * level);
                for j in (0..nv).step_by(side) {
                    for i in (0..nu).step_by(side) {
                        let node = [i, j].map(|x| (x / (4 * side) * 4 * side) as u32);
                        let place = size.place(level, node);
                        seen[place] = true;
                        let child = 4 * (j / side % 4) + i / side % 4;
                        let (mut low, mut high) = (u16::MAX, 0);
                        for y in j..=(j + side).min(nv) {
                            for &h in &heights[y * stride..][i..=(i + side).min(nu)] {
                                (low, high) = (low.min(h), high.max(h));
                            }
                        }
                        assert_eq!((all[place].low[child], all[place].high[child]), (low, high));
                    }
                }
            }
            assert!(seen.into_iter().all(|seen| seen), "{size:?}");
        }
    }
}
