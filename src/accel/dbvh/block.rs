//! Micro-vertices of a block: bilinear corners, and heights.
//!
//! ```text
//!   left(v) = (1 - v) c00 + v c01      right(v) = (1 - v) c10 + v c11      (1 - u) left + u right
//! ```
//!
//! Weights 1 - u and u of micro-vertex i of n are (n - i) and i times one number, and exactly 1 at the ends: seen from
//! the other end they change places and nothing else, and along a quad's side the other two corners count for
//! nothing. So two quads at a side compute the same bits there, wherever it is in each of them, if their corners have
//! the same bits; and nothing is fused.

use super::Dbvh;
use super::face::{Corner, Face, NONE, Patch, Span};
use super::heights::Reader;
use super::look_up::of_pair;
use crate::accel::moment::Moment;
use crate::accel::quads::{PAIRS, SIDE, Sheared};
use crate::accel::simd::{LANES, Lanes};
use crate::math::Vec2;

/// A block's quad, and where it is in it.
pub(super) struct Block<'a> {
    pub(super) face: &'a Face,
    /// Column and row of its first micro-vertex in the quad, and in the face.
    pub(super) first: [usize; 2],
    pub(super) in_face: [usize; 2],
    /// Columns and rows of micro-quads.
    pub(super) cells: [usize; 2],
}

/// What a block's vertices are computed of: first what its rows have in common, then two rows.
pub(super) trait Sheet<L: Lanes> {
    /// A coordinate of all rows.
    type Rows: Copy;

    /// Of positions.
    fn p(&self, lanes: L, k: usize) -> Self::Rows;
    /// Of normals.
    fn n(&self, lanes: L, k: usize) -> Self::Rows;
    /// Of texture coordinates.
    fn st(&self, lanes: L, k: usize) -> Self::Rows;
    /// Two rows of vertices.
    fn pair(&self, lanes: L, rows: Self::Rows, pair: usize) -> L::Floats;
}

/// Within a single quad.
pub(super) struct Single<'a, L: Lanes> {
    weights: Weights<L>,
    quad: &'a Quad,
    st: [[f32; 4]; 2],
}

impl<'a, L: Lanes> Single<'a, L> {
    #[inline(always)]
    pub(super) fn new(
        lanes: L,
        tree: &Dbvh,
        patch: &Patch,
        block: &Block<'_>,
        quad: &'a Quad,
    ) -> Self {
        let [a, b, c, d] = block.face.corners(patch.quad).map(|c| tree.st[c]);
        Self {
            weights: Weights::new(lanes, block),
            quad,
            st: [[a.x, b.x, c.x, d.x], [a.y, b.y, c.y, d.y]],
        }
    }
}

impl<L: Lanes> Sheet<L> for Single<'_, L> {
    /// The left and the right side.
    type Rows = L::Floats;

    #[inline(always)]
    fn p(&self, lanes: L, k: usize) -> L::Floats {
        self.weights.sides(lanes, &self.quad.p[k])
    }

    #[inline(always)]
    fn n(&self, lanes: L, k: usize) -> L::Floats {
        self.weights.sides(lanes, &self.quad.n[k])
    }

    #[inline(always)]
    fn st(&self, lanes: L, k: usize) -> L::Floats {
        self.weights.sides(lanes, &self.st[k])
    }

    #[inline(always)]
    fn pair(&self, lanes: L, rows: L::Floats, pair: usize) -> L::Floats {
        self.weights.rows(lanes, rows, pair)
    }
}

/// A quad's corners in the plane across a ray, or on the lattice: (0,0), (1,0), (0,1), (1,1).
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad {
    pub(super) p: [[f32; 4]; 3],
    pub(super) n: [[f32; 4]; 3],
}

/// Bilinear weights of a block's vertices.
pub(super) struct Weights<L: Lanes> {
    /// Of the left and the right side, column by column.
    u: [L::Floats; 2],
    /// Of the lower and the upper side, row by row, twice.
    v: [L::Floats; 2],
}

const COUNT: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0,
];

// Closures would not be compiled for the instruction set: there are none where there are lanes.
impl<L: Lanes> Weights<L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, block: &Block<'_>) -> Self {
        Self {
            u: Self::along(lanes, block, 0),
            v: Self::along(lanes, block, 1),
        }
    }

    #[inline(always)]
    fn along(lanes: L, block: &Block<'_>, k: usize) -> [L::Floats; 2] {
        // Beyond the block's last vertices these again.
        let within = lanes.min(lanes.load(&COUNT), lanes.floats(block.cells[k] as f32));
        let at = lanes.add(within, lanes.floats(block.first[k] as f32));
        let (share, one) = (lanes.floats(block.face.share[k]), lanes.floats(1.0));
        let rest = lanes.sub(lanes.floats(f32::from(block.face.cells[k])), at);
        [
            lanes.min(lanes.mul(rest, share), one),
            lanes.min(lanes.mul(at, share), one),
        ]
    }

    /// All rows of the left side, then of the right one.
    #[inline(always)]
    pub(super) fn sides(&self, lanes: L, of: &[f32; 4]) -> L::Floats {
        let (low, high) = (lanes.two(of[0], of[1]), lanes.two(of[2], of[3]));
        lanes.add(lanes.mul(self.v[0], low), lanes.mul(self.v[1], high))
    }

    /// Two rows between the sides.
    #[inline(always)]
    pub(super) fn rows(&self, lanes: L, sides: L::Floats, pair: usize) -> L::Floats {
        let [left, right] = lanes.two_rows(sides, pair);
        lanes.add(lanes.mul(self.u[0], left), lanes.mul(self.u[1], right))
    }
}

/// The value between a quad's corners at one micro-vertex: the clear twin of [`Weights`].
pub(super) fn bilinear(face: &Face, at: [usize; 2], [a, b, c, d]: [f32; 4]) -> f32 {
    let [u, v] = [0, 1].map(|k| {
        let (at, n) = (at[k] as f32, f32::from(face.cells[k]));
        [n - at, at].map(|number| (number * face.share[k]).min(1.0))
    });
    u[0] * (v[0] * a + v[1] * c) + u[1] * (v[0] * b + v[1] * d)
}

impl Quad {
    /// On the lattice.
    pub(super) fn new(corners: [Corner; 4]) -> Self {
        Self {
            p: [0, 1, 2].map(|k| corners.map(|corner| corner.p[k])),
            n: [0, 1, 2].map(|k| corners.map(|corner| corner.n[k])),
        }
    }
}

impl<'a> Block<'a> {
    pub(super) fn new(tree: &'a Dbvh, patch: &Patch, span: &Span) -> Self {
        let face = &tree.faces[patch.face as usize];
        Self {
            face,
            first: span.first,
            in_face: [0, 1]
                .map(|k| usize::from(patch.quad[k]) * usize::from(face.cells[k]) + span.first[k]),
            cells: span.cells,
        }
    }

    /// Pairs of rows of vertices.
    #[inline(always)]
    pub(super) fn pairs(&self) -> usize {
        self.cells[1] / 2 + 1
    }

    /// Whether it touches the face's border.
    #[inline(always)]
    pub(super) fn is_border(&self) -> bool {
        self.face.is_border_at(self.in_face, self.cells)
    }
}

impl Dbvh {
    /// A block's vertices: P + h N, but for those that are kept, which `shear` brings to the corners' space. Only those of
    /// micro-quads that the ray may meet: which, as bits, eight a row.
    ///
    /// Vertices are on one side of an axis across the ray for all heights that the block has if they are so for the least
    /// and for the greatest; and where all four of a micro-quad are, the ray does not meet it. `bound` is the middle of the
    /// heights, half of their range, and how far vertices may be from where that puts them; none if they are unknown.
    #[inline(always)]
    pub(super) fn vertices<L: Lanes>(
        &self,
        lanes: L,
        (reader, block): (&Reader<'_>, &Block<'_>),
        (sheet, bound): (&impl Sheet<L>, Option<[f32; 3]>),
        moment: &Moment,
        shear: impl Fn([f32; 3]) -> [f32; 3],
        to: &mut Sheared,
    ) -> u64 {
        let [columns, rows] = block.cells;
        let pairs = block.pairs();
        let mut normals = [[lanes.floats(0.0); 2]; PAIRS];
        // Vertices to the right of the axes for sure, and to the left.
        let mut beyond = [0_u64; 4];
        for (k, to) in [&mut to.x, &mut to.y].into_iter().enumerate() {
            let p = sheet.p(lanes, k);
            let n = sheet.n(lanes, k);
            for pair in 0..pairs {
                let p = sheet.pair(lanes, p, pair);
                let n = sheet.pair(lanes, n, pair);
                lanes.store(p, &mut to[pair]);
                normals[pair][k] = n;
                if let Some([middle, half, slack]) = bound {
                    let at = lanes.add(p, lanes.mul(lanes.floats(middle), n));
                    let reach = lanes.mul(lanes.floats(half), lanes.abs(n));
                    let reach = lanes.add(reach, lanes.floats(slack));
                    let minus = lanes.sub(lanes.floats(0.0), reach);
                    beyond[2 * k] |= u64::from(lanes.less(reach, at)) << (LANES * pair);
                    beyond[2 * k + 1] |= u64::from(lanes.less(at, minus)) << (LANES * pair);
                }
            }
        }
        let mut quads =
            (u64::MAX >> (64 - SIDE * rows)) & (0x0101_0101_0101_0101 * ((1 << columns) - 1));
        for beyond in beyond {
            let two = beyond & beyond >> 1;
            quads &= !(two & two >> SIDE);
        }
        if quads == 0 {
            return 0;
        }
        let two = quads | quads << 1;
        let needed = two | two << SIDE;
        let heights = (self.heights).of_block(lanes, reader, (block, sheet), needed, moment);
        let (p, n) = (sheet.p(lanes, 2), sheet.n(lanes, 2));
        for (pair, [nx, ny]) in normals.into_iter().enumerate().take(pairs) {
            if of_pair(needed, pair) == 0 {
                continue;
            }
            let heights = heights[pair];
            let x = lanes.mul(heights, nx);
            let y = lanes.mul(heights, ny);
            lanes.store(lanes.add(lanes.load(&to.x[pair]), x), &mut to.x[pair]);
            lanes.store(lanes.add(lanes.load(&to.y[pair]), y), &mut to.y[pair]);
            let p = sheet.pair(lanes, p, pair);
            let n = sheet.pair(lanes, n, pair);
            lanes.store(lanes.add(p, lanes.mul(heights, n)), &mut to.z[pair]);
        }
        if block.face.has_kept && block.is_border() {
            self.replace_kept(block, moment, shear, to);
        }
        quads
    }

    /// Puts kept points into their places.
    #[inline(always)]
    fn replace_kept(
        &self,
        block: &Block<'_>,
        moment: &Moment,
        shear: impl Fn([f32; 3]) -> [f32; 3],
        to: &mut Sheared,
    ) {
        let [columns, rows] = block.cells;
        let [last_i, last_j] = block.face.micro_vertices().map(|n| n - 1);
        let [i0, j0] = block.in_face;
        let mut replace = |i: usize, j: usize| {
            let kept = block.face.kept([i0 + i, j0 + j]);
            if kept == NONE {
                return;
            }
            let [x, y, z] = shear(self.kept_point(kept, moment));
            let at = SIDE * j + i;
            to.x.as_flattened_mut()[at] = x;
            to.y.as_flattened_mut()[at] = y;
            to.z.as_flattened_mut()[at] = z;
        };
        if j0 == 0 {
            (0..=columns).for_each(|i| replace(i, 0));
        }
        if j0 + rows == last_j {
            (0..=columns).for_each(|i| replace(i, rows));
        }
        if i0 == 0 {
            (0..=rows).for_each(|j| replace(0, j));
        }
        if i0 + columns == last_i {
            (0..=rows).for_each(|j| replace(columns, j));
        }
    }

    /// A kept point at a time.
    pub(super) fn kept_point(&self, kept: u32, moment: &Moment) -> [f32; 3] {
        let at = |key: usize| self.kept[key][kept as usize];
        if moment.from == moment.to {
            return at(moment.from);
        }
        let (a, b) = (at(moment.from), at(moment.to));
        let [from, to] = moment.weights;
        [0, 1, 2].map(|k| a[k] * from + b[k] * to)
    }

    /// A quad's corners at a time, on the lattice.
    #[inline(always)]
    pub(super) fn corners_at(&self, numbers: [usize; 4], moment: &Moment) -> [Corner; 4] {
        let at = |key: usize| numbers.map(|c| self.corners[key][c]);
        let a = at(moment.from);
        if moment.from == moment.to {
            return a;
        }
        let b = at(moment.to);
        let [from, to] = moment.weights;
        let mix = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|k| a[k] * from + b[k] * to);
        std::array::from_fn(|c| Corner {
            p: mix(a[c].p, b[c].p),
            n: mix(a[c].n, b[c].n),
        })
    }

    /// A micro-vertex by column and row from the patch's first quad on, on the lattice.
    pub(super) fn vertex(&self, patch: &Patch, at: [usize; 2], moment: &Moment) -> [f32; 3] {
        let face = &self.faces[patch.face as usize];
        let in_face =
            [0, 1].map(|k| usize::from(patch.quad[k]) * usize::from(face.cells[k]) + at[k]);
        let kept = face.kept(in_face);
        if face.has_kept && kept != NONE {
            return self.kept_point(kept, moment);
        }
        self.own_vertex(patch.face as usize, patch.quad, at, moment)
    }

    /// The same, as the face computes it in any case; by column and row from some quad on.
    pub(super) fn own_vertex(
        &self,
        face: usize,
        quad: [u16; 2],
        at: [usize; 2],
        moment: &Moment,
    ) -> [f32; 3] {
        let face = &self.faces[face];
        let (quad, at) = face.in_quad(quad, at);
        let numbers = face.corners(quad);
        let quad_at = Quad::new(self.corners_at(numbers, moment));
        let st = numbers.map(|c| self.st[c]);
        let st = Vec2::new(
            bilinear(face, at, st.map(|st| st.x)),
            bilinear(face, at, st.map(|st| st.y)),
        );
        let in_face = [0, 1].map(|k| usize::from(quad[k]) * usize::from(face.cells[k]) + at[k]);
        let h = self.heights.at(face, in_face, st, moment);
        [0, 1, 2].map(|k| bilinear(face, at, quad_at.p[k]) + h * bilinear(face, at, quad_at.n[k]))
    }
}
