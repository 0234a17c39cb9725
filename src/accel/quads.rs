//! Up to 7 x 7 micro-quads against a ray, all at once: the test that methods share which have micro-vertices at hand.
//!
//! Signs of edge functions are exact but for zeros: products round monotonely, so a difference of two rounded ones is
//! never of the wrong sign. A zero counts for both sides at first; what passes so is decided by
//! [`origin_in`], corner by corner. Two triangles at an edge see the same products of
//! the same vertices, in one block or in two.

use super::simd::{LANES, Lanes};
use super::triangle::{TriangleHit, origin_in};

/// Vertices along a block's side.
pub(super) const SIDE: usize = 8;
/// Quads along a full block's side.
pub(super) const CELLS: usize = SIDE - 1;

/// Pairs of rows in a block.
pub(super) const PAIRS: usize = SIDE / 2;

/// A block's vertices in the plane across the ray, two rows together.
#[derive(Default)]
pub(super) struct Sheared {
    pub(super) x: [[f32; LANES]; PAIRS],
    pub(super) y: [[f32; LANES]; PAIRS],
    pub(super) z: [[f32; LANES]; PAIRS],
}

/// Where a ray met a triangle of a block.
pub(super) struct QuadHit {
    pub(super) hit: TriangleHit,
    /// The quad, whose rows are [`SIDE`] apart, and whether it is its second triangle.
    pub(super) cell: usize,
    pub(super) second: bool,
}

impl Sheared {
    /// Three values by the numbers of their vertices.
    #[inline(always)]
    fn corners(of: &[[f32; LANES]; PAIRS], corners: [usize; 3]) -> [f32; 3] {
        let [a, b, c] = corners;
        let of = of.as_flattened();
        [of[a], of[b], of[c]]
    }

    /// The nearest triangle of so many columns and rows of quads, within an interval. `scale` makes `t` of z.
    #[inline(always)]
    pub(super) fn nearest<L: Lanes>(
        &self,
        lanes: L,
        [columns, rows]: [usize; 2],
        scale: f32,
        interval: [f32; 2],
    ) -> Option<QuadHit> {
        let cells = (u64::MAX >> (64 - 8 * rows)) & (0x0101_0101_0101_0101 * ((1 << columns) - 1));
        self.nearest_of(lanes, cells, scale, interval)
    }

    /// The same of some of the quads, given as bits: eight a row.
    #[inline(always)]
    pub(super) fn nearest_of<L: Lanes>(
        &self,
        lanes: L,
        cells: u64,
        scale: f32,
        [t_min, mut t_max]: [f32; 2],
    ) -> Option<QuadHit> {
        let passed = edges(lanes, self).map(|passed| passed & cells);

        // Both kinds of triangles in one row of bits: what ends the loop is hard to foretell.
        let mut passed = u128::from(passed[0]) | u128::from(passed[1]) << 64;
        let mut nearest: Option<QuadHit> = None;
        while passed != 0 {
            let bit = passed.trailing_zeros() as usize;
            passed &= passed - 1;
            let (second, cell) = (bit >= 64, bit % 64);
            let corners = if second {
                [cell + SIDE + 1, cell + SIDE, cell + 1]
            } else {
                [cell, cell + 1, cell + SIDE]
            };
            let t = Self::corners(&self.z, corners).map(|z| scale * z);
            let x = Self::corners(&self.x, corners);
            let y = Self::corners(&self.y, corners);
            let Some(hit) = origin_in(x, y, t) else {
                continue;
            };
            if hit.t > t_min && hit.t < t_max {
                t_max = hit.t;
                nearest = Some(QuadHit { hit, cell, second });
            }
        }
        nearest
    }
}

/// The quads whose first and second triangles the ray passes through, or touches, as bits: eight a row.
#[inline(always)]
fn edges<L: Lanes>(lanes: L, sheared: &Sheared) -> [u64; 2] {
    // Along rows, along columns, and from corner b to corner c of each quad.
    let mut along = [lanes.floats(0.0); PAIRS];
    let (mut down, mut across) = (along, along);
    let (mut x, mut y) = (lanes.load(&sheared.x[0]), lanes.load(&sheared.y[0]));
    for pair in 0..PAIRS {
        let after = (pair + 1).min(PAIRS - 1);
        let (x2, y2) = (lanes.load(&sheared.x[after]), lanes.load(&sheared.y[after]));
        let (bx, by) = (lanes.next_in_row(x), lanes.next_in_row(y));
        let (cx, cy) = (lanes.next_row(x, x2), lanes.next_row(y, y2));
        along[pair] = side(lanes, [x, y, bx, by]);
        down[pair] = side(lanes, [x, y, cx, cy]);
        across[pair] = side(lanes, [bx, by, cx, cy]);
        (x, y) = (x2, y2);
    }
    // To which side the ray passes.
    let [an, ap] = lanes.signs(along);
    let [dn, dp] = lanes.signs(down);
    let [cn, cp] = lanes.signs(across);
    // Corners a, b, c with edge functions of (c, b), (a, c), (b, a); then d, c, b.
    let first = (cp | dn | ap) & (cn | dp | an);
    let second = (cn | dp >> 1 | an >> 8) & (cp | dn >> 1 | ap >> 8);
    [!first, !second]
}

/// Two rows' edge functions.
#[inline(always)]
fn side<L: Lanes>(lanes: L, [ax, ay, bx, by]: [L::Floats; 4]) -> L::Floats {
    lanes.sub(lanes.mul(ax, by), lanes.mul(ay, bx))
}
