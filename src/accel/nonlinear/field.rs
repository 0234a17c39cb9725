//! The heights of a quad and the ranges above them: a quadtree of least and greatest heights, two levels at a step.
//!
//! A node of level 0 has 4 x 4 micro-quads for children, whose ranges follow from their heights. A node of level k has 4 x 4
//! nodes of level k - 1, and their ranges are kept: 64 bytes. Nodes follow each other level by level from the root down, and
//! row by row; where one is, is arithmetic. Where the root has 2 x 2 children at most, nothing is kept: it has the quad's
//! own range.

use bytemuck::{Pod, Zeroable};

use crate::accel::simd::LANES;

/// The logarithm of the most micro-quads along a side.
pub(super) const MOST_LOG: u8 = 8;
/// And of the fewest.
pub(super) const LEAST_LOG: u8 = 1;
/// Levels of the largest quad.
pub(super) const LEVELS: usize = 4;

/// The ranges of a node's children, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Ranges {
    pub(super) low: [u16; LANES],
    pub(super) high: [u16; LANES],
}

/// The size of a quad: logarithms of its micro-quads along u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Size(pub(super) [u8; 2]);

impl Size {
    /// Micro-quads along u and v.
    #[inline(always)]
    pub(super) fn quads(self) -> [usize; 2] {
        self.0.map(|log| 1 << log)
    }

    /// The root's level.
    #[inline(always)]
    pub(super) fn root(self) -> u32 {
        u32::from(self.0[0].max(self.0[1])).div_ceil(2).max(1) - 1
    }

    /// The logarithms of how many nodes a level has along u and v.
    #[inline(always)]
    fn nodes(self, level: u32) -> [u32; 2] {
        self.0
            .map(|log| u32::from(log).saturating_sub(2 * level + 2))
    }

    /// Whether ranges are kept.
    #[inline(always)]
    pub(super) fn keeps_ranges(self) -> bool {
        self.0[0].max(self.0[1]) > 3
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
        1 << (u + v)
    }

    /// The place of a node's ranges, of level 1 at least, whose first micro-quad is in that column and row.
    #[inline(always)]
    pub(super) fn place(self, level: u32, [i, j]: [u32; 2]) -> usize {
        let mut above = 0;
        for level in level + 1..=self.root() {
            above += self.count(level);
        }
        let shift = 2 * level + 2;
        above + (((j >> shift) as usize) << self.nodes(level)[0]) + (i >> shift) as usize
    }
}

/// All ranges of a quad's heights, level by level. They begin with its first one, and rows are `stride` apart.
pub(super) fn ranges(size: Size, heights: &[u16], stride: usize, out: &mut Vec<Ranges>) {
    if !size.keeps_ranges() {
        return;
    }
    const NOTHING: (u16, u16) = (u16::MAX, 0);
    let join = |a: (u16, u16), b: (u16, u16)| (a.0.min(b.0), a.1.max(b.1));
    let [nu, nv] = size.quads();
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
            [2, 2],
            [3, 2],
            [4, 2],
            [4, 4],
            [5, 3],
            [2, 8],
            [6, 6],
            [7, 8],
        ]
        .map(Size)
        {
            let [nu, nv] = size.quads();
            let stride = nu + 3;
            let heights: Vec<u16> = (0..stride * (nv + 1))
                .map(|_| (65535.0 * random.next()) as u16)
                .collect();
            let mut all = Vec::new();
            ranges(size, &heights, stride, &mut all);
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
