//! Faces, their quads, and patches of these.

use super::woven;
use crate::accel::quads::CELLS;
use crate::math::Vec2;
use crate::surface::{MOST_SEGMENTS, edge_uv};

/// Stands for no kept point.
pub(super) const NONE: u32 = u32::MAX;

/// A corner of quads on the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corner {
    pub(super) p: [f32; 3],
    /// A unit of height along the normal.
    pub(super) n: [f32; 3],
}

/// A face: columns and rows of quads, each of columns and rows of micro-quads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Face {
    pub(super) face: u32,
    pub(super) quads: [u16; 2],
    /// Of each quad.
    pub(super) cells: [u16; 2],
    /// Quads of a patch along u and v: more than one where they are smaller than a block.
    pub(super) group: [u16; 2],
    /// One by these: see [`share`].
    pub(super) share: [f32; 2],
    /// Blocks of each quad, and the micro-quads of one, times 65536 and rounded up.
    pub(super) blocks: [u16; 2],
    pub(super) steps: [u32; 2],
    /// Of parts above blocks in a patch.
    pub(super) levels: u8,
    /// Whether all quads are parallelograms with one normal, but for this much on each axis of the lattice.
    pub(super) is_flat: bool,
    pub(super) bent: f32,
    /// The first of its corners, which follow one another row by row.
    pub(super) first: u32,
    /// The first of its micro-vertices' heights, where these are kept.
    pub(super) first_height: u64,
    /// From corner k on.
    pub(super) sides: [Side; 4],
    /// Kept points of its corners; [`NONE`] if they are computed.
    pub(super) vertices: [u32; 4],
    /// Whether anything of its border is kept; and no kept point is farther from the vertex that it replaces than this.
    pub(super) has_kept: bool,
    pub(super) slack: f32,
}

/// A face's border whose points are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side {
    /// The first of them within the edge, in its own direction; [`NONE`] if they are computed. An edge that is but a
    /// point has none: it is its corner.
    pub(super) first: u32,
    /// The edge's, if they are kept: no more than there are micro-quads along it.
    pub(super) segments: u16,
    pub(super) reversed: bool,
    pub(super) collapsed: bool,
}

/// A part of a quad, or several small ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Patch {
    /// By its place among the faces that are not holes.
    pub(super) face: u32,
    /// Column and row of the quad, the first one if there are several.
    pub(super) quad: [u16; 2],
    /// Column and row in the quad.
    pub(super) piece: [u16; 2],
    /// Of its blocks' heights; those themselves, as a code, if there is a single block.
    pub(super) ranges: u32,
}

/// Columns and rows of micro-quads, from which on in the quad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) first: [usize; 2],
    pub(super) cells: [usize; 2],
}

/// The number by which whole numbers up to `n` are multiplied so that they are 0..1: of those that make of `n` no less
/// than 1 the least. Products beyond 1 are to be cut off.
pub(super) fn share(n: u16) -> f32 {
    let n = f32::from(n);
    let near = 1.0 / n;
    if n * near >= 1.0 {
        near
    } else {
        near.next_up()
    }
}

/// The side of a grid of so many columns and rows of cells that a vertex is on, and where along it, from its corner on.
fn on_side([i, j]: [usize; 2], [nu, nv]: [usize; 2]) -> Option<(usize, usize)> {
    match (i, j) {
        (i, 0) => Some((0, i)),
        (i, j) if j == nv => Some((2, nu - i)),
        (0, j) => Some((3, nv - j)),
        (i, j) if i == nu => Some((1, j)),
        _ => None,
    }
}

impl Face {
    pub(super) fn micro_triangles(&self) -> u64 {
        let all = |k: usize| u64::from(self.quads[k]) * u64::from(self.cells[k]);
        2 * all(0) * all(1)
    }

    /// Micro-vertices along u and v.
    pub(super) fn micro_vertices(&self) -> [usize; 2] {
        [0, 1].map(|k| usize::from(self.quads[k]) * usize::from(self.cells[k]) + 1)
    }

    /// The numbers of a quad's corners: at (0,0), (1,0), (0,1), (1,1).
    #[inline(always)]
    pub(super) fn corners(&self, [i, j]: [u16; 2]) -> [usize; 4] {
        let stride = usize::from(self.quads[0]) + 1;
        let first = self.first as usize + usize::from(j) * stride + usize::from(i);
        [first, first + 1, first + stride, first + stride + 1]
    }

    /// How many micro-quads a quad has along a side that is to have `rate` of them, if it has so many quads.
    pub(super) fn cells(quads: u32, rate: u32) -> u16 {
        let each = (f64::from(rate) / f64::from(quads)).round();
        each.clamp(1.0, f64::from(MOST_SEGMENTS)) as u16
    }

    /// How many quads a side gets that needs at least so many: those that fill blocks best, and may be up to twice as many.
    pub(super) fn fitting(needed: u32, rate: u32) -> u32 {
        let blocks = |quads: u32| {
            let cells = usize::from(Self::cells(quads, rate));
            let quads = quads as usize;
            if cells > CELLS {
                quads * cells.div_ceil(CELLS)
            } else {
                quads.div_ceil((CELLS / cells).min(woven::MOST))
            }
        };
        // About as fine as it is to be.
        let fits = |quads: &u32| {
            let all = quads * u32::from(Self::cells(*quads, rate));
            14 * all >= 13 * rate && 5 * all <= 6 * rate
        };
        (needed..=(2 * needed).min(rate.max(needed)))
            .filter(fits)
            .min_by_key(|&quads| (blocks(quads), quads))
            .unwrap_or(needed)
    }

    /// How many quads patches have at most, of so many micro-quads each.
    pub(super) fn group(cells: [u16; 2]) -> [u16; 2] {
        let most = cells.map(|n| (CELLS / usize::from(n)).min(woven::MOST) as u16);
        if most.contains(&0) { [1; 2] } else { most }
    }

    /// Whether its patches are of several quads.
    #[inline(always)]
    pub(super) fn is_woven(&self) -> bool {
        self.group != [1; 2]
    }

    /// How many quads the patch from a quad on has.
    #[inline(always)]
    pub(super) fn count(&self, quad: [u16; 2]) -> [usize; 2] {
        [0, 1].map(|k| usize::from(self.group[k].min(self.quads[k] - quad[k])))
    }

    /// The quad of a micro-vertex that is given by column and row from some quad on, and where it is in that.
    pub(super) fn in_quad(&self, from: [u16; 2], at: [usize; 2]) -> ([u16; 2], [usize; 2]) {
        let (mut quad, mut within) = (from, at);
        for k in 0..2 {
            let n = usize::from(self.cells[k]);
            let beyond = (at[k] / n).min(usize::from(self.quads[k] - 1 - from[k]));
            quad[k] += beyond as u16;
            within[k] -= beyond * n;
        }
        (quad, within)
    }

    /// Where a block is, from the patch's first quad on.
    #[inline(always)]
    pub(super) fn span(&self, patch: &Patch, block: [usize; 2]) -> Span {
        if self.is_woven() {
            let count = self.count(patch.quad);
            return Span {
                first: [0; 2],
                cells: [0, 1].map(|k| count[k] * usize::from(self.cells[k])),
            };
        }
        let cut = |k: usize, block: usize| (block * self.steps[k] as usize) >> 16;
        let first = [0, 1].map(|k| cut(k, block[k]));
        Span {
            first,
            cells: [0, 1].map(|k| cut(k, block[k] + 1) - first[k]),
        }
    }

    /// The face's parameters of a micro-vertex of a quad, where it was snapped to.
    #[inline]
    pub(super) fn uv(&self, quad: [u16; 2], at: [usize; 2]) -> Vec2 {
        let at = [0, 1].map(|k| usize::from(quad[k]) * usize::from(self.cells[k]) + at[k]);
        let whole = self.micro_vertices().map(|n| n - 1);
        if self.has_kept
            && let Some((k, x)) = on_side(at, whole)
            && let Some((sample, all)) = self.kept_sample(k, x)
        {
            return edge_uv(k as u32, f32::from(sample) / f32::from(all));
        }
        Vec2::from([0, 1].map(|k| at[k] as f32 / whole[k] as f32))
    }

    /// Whether a block of a patch touches the face's border.
    #[inline(always)]
    pub(super) fn is_border(&self, quad: [u16; 2], span: &Span) -> bool {
        let first =
            [0, 1].map(|k| usize::from(quad[k]) * usize::from(self.cells[k]) + span.first[k]);
        self.is_border_at(first, span.cells)
    }

    /// The same by columns and rows of the face.
    #[inline(always)]
    pub(super) fn is_border_at(&self, first: [usize; 2], cells: [usize; 2]) -> bool {
        let most = self.micro_vertices();
        (0..2).any(|k| first[k] == 0 || first[k] + cells[k] + 1 == most[k])
    }

    /// The kept point that a micro-vertex on the border is, by column and row in the face; [`NONE`] if it is computed.
    #[inline]
    pub(super) fn kept(&self, [i, j]: [usize; 2]) -> u32 {
        let [nu, nv] = self.micro_vertices().map(|n| n - 1);
        match (i, j) {
            (0, 0) => self.vertices[0],
            (i, 0) if i == nu => self.vertices[1],
            (0, j) if j == nv => self.vertices[3],
            (i, j) if i == nu && j == nv => self.vertices[2],
            (i, 0) => self.kept_on(0, i),
            (i, j) if j == nv => self.kept_on(2, nu - i),
            (0, j) => self.kept_on(3, nv - j),
            (i, j) if i == nu => self.kept_on(1, j),
            _ => NONE,
        }
    }

    /// The sample of side `k`, from its corner on, that micro-vertex `x` along it is, and how many there are; none if
    /// its points are computed.
    #[inline]
    fn kept_sample(&self, k: usize, x: usize) -> Option<(u16, u16)> {
        let side = &self.sides[k];
        if side.collapsed || side.first == NONE {
            return None;
        }
        let all = u32::from(self.quads[k % 2]) * u32::from(self.cells[k % 2]);
        let sample = (2 * x as u64 + 1) * u64::from(side.segments) / (2 * u64::from(all));
        Some((sample as u16, side.segments))
    }

    /// The kept point of micro-vertex `x` along side `k`, not of its ends.
    #[inline]
    fn kept_on(&self, k: usize, x: usize) -> u32 {
        let side = &self.sides[k];
        if side.collapsed {
            return self.vertices[k];
        }
        match self.kept_sample(k, x) {
            None => NONE,
            Some((0, _)) => self.vertices[k],
            Some((sample, all)) if sample == all => self.vertices[(k + 1) % 4],
            Some((sample, all)) if side.reversed => side.first + u32::from(all - sample - 1),
            Some((sample, _)) => side.first + u32::from(sample) - 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_all_shares_are_one() {
        for n in 1..=4096 {
            let [last, all] = [n - 1, n].map(|i| f32::from(i) * share(n));
            assert!(last < 1.0 && (1.0..1.000_000_3).contains(&all), "{n}");
        }
    }

    #[test]
    fn quads_fill_blocks() {
        // 8 of 9 micro-quads would be 16 blocks.
        assert_eq!((Face::fitting(8, 75), Face::cells(11, 75)), (11, 7));
        assert_eq!((Face::fitting(1, 75), Face::cells(1, 75)), (1, 75));
        assert_eq!((Face::fitting(32, 75), Face::group([2, 2])), (35, [3, 3]));
        for rate in 1..200 {
            for needed in 1..=rate {
                let quads = Face::fitting(needed, rate);
                assert!(
                    (needed..=rate).contains(&quads),
                    "{needed} of {rate}: {quads}"
                );
            }
        }
    }
}
