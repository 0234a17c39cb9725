//! Blocks over several quads, where quads are smaller than a block: up to 3 x 3 of them, whose 4 x 4 corners are in one
//! register.
//!
//! ```text
//!   12-13-14-15     Rows first: of each row of vertices the four columns of corners, four rows a register; then two rows
//!   |  |  |  |      of eight vertices, each between its two columns. Every vertex takes the same steps as in a
//!   8--9--10-11     quad of its own (see `block`), and has the same bits.
//!   |  |  |  |
//!   4--5--6--7
//!   |  |  |  |
//!   0--1--2--3
//! ```

use super::Dbvh;
use super::block::Sheet;
use super::face::{Face, Patch};
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::quads::CELLS;
use crate::accel::simd::{LANES, Lanes, Nibbles};

/// Corners along a side.
const CORNERS: usize = 4;

/// The most quads along a side.
pub(super) const MOST: usize = CORNERS - 1;

/// Vertices along an axis: between which corners each of them is, and where.
#[derive(Clone, Copy)]
struct Along {
    /// For eight columns, twice: micro-quads to the corner after, and from the one before.
    columns: [[f32; LANES]; 2],
    /// For the even and the odd pairs of rows in a register of four: the columns of corners before and after.
    across: [[Nibbles; 2]; 2],
    /// For four rows, and for the next four, by the columns of corners: as `columns`.
    rows: [[[f32; LANES]; 2]; 2],
    /// The rows of corners before and after.
    down: [[Nibbles; 2]; 2],
}

/// By micro-quads of a quad and by quads, less one each.
static ALONG: [[Along; MOST]; CELLS] = {
    let mut all = [[Along::new(1, 1); MOST]; CELLS];
    let mut cells = 1;
    while cells <= CELLS {
        let mut quads = 1;
        while quads <= MOST {
            all[cells - 1][quads - 1] = Along::new(cells, quads);
            quads += 1;
        }
        cells += 1;
    }
    all
};

impl Along {
    const fn new(cells: usize, quads: usize) -> Self {
        // The quad of a vertex; beyond the last one that again.
        let mut quad = [0; 2 * CORNERS];
        let mut within = [0; 2 * CORNERS];
        let mut i = 0;
        while i < 2 * CORNERS {
            let at = if i < cells * quads { i } else { cells * quads };
            quad[i] = if at / cells < quads {
                at / cells
            } else {
                quads - 1
            };
            within[i] = at - quad[i] * cells;
            i += 1;
        }
        let mut columns = [[0.0; LANES]; 2];
        let mut across = [[[0; LANES]; 2]; 2];
        let mut rows = [[[0.0; LANES]; 2]; 2];
        let mut down = [[[0; LANES]; 2]; 2];
        let mut lane = 0;
        while lane < LANES {
            let (row, i) = (lane / 8, lane % 8);
            columns[0][lane] = (cells - within[i]) as f32;
            columns[1][lane] = within[i] as f32;
            let mut half = 0;
            while half < 2 {
                let before = CORNERS * (2 * half + row) + quad[i];
                across[half][0][lane] = before as u8;
                across[half][1][lane] = before as u8 + 1;
                let j = CORNERS * half + lane / CORNERS;
                rows[half][0][lane] = (cells - within[j]) as f32;
                rows[half][1][lane] = within[j] as f32;
                let below = CORNERS * quad[j] + lane % CORNERS;
                down[half][0][lane] = below as u8;
                down[half][1][lane] = (below + CORNERS) as u8;
                half += 1;
            }
            lane += 1;
        }
        Self {
            columns,
            across: [
                [Nibbles::new(across[0][0]), Nibbles::new(across[0][1])],
                [Nibbles::new(across[1][0]), Nibbles::new(across[1][1])],
            ],
            rows,
            down: [
                [Nibbles::new(down[0][0]), Nibbles::new(down[0][1])],
                [Nibbles::new(down[1][0]), Nibbles::new(down[1][1])],
            ],
        }
    }
}

/// Corners of quads on the lattice; beyond the last ones whatever there is.
pub(super) struct Net {
    p: [[f32; LANES]; 3],
    n: [[f32; LANES]; 3],
    st: [[f32; LANES]; 2],
}

impl Net {
    /// Of a patch, at a time.
    #[inline(always)]
    pub(super) fn new(tree: &Dbvh, face: &Face, patch: &Patch, moment: &Moment) -> Self {
        let mut net = Self {
            p: [[0.0; LANES]; 3],
            n: [[0.0; LANES]; 3],
            st: [[0.0; LANES]; 2],
        };
        let stride = usize::from(face.quads[0]) + 1;
        let [columns, rows] = face.count(patch.quad).map(|n| n + 1);
        let first = face.corners(patch.quad)[0];
        let moves = moment.from != moment.to;
        for j in 0..rows {
            let row = first + j * stride;
            let at = row..row + columns;
            let corners = &tree.corners[moment.from][at.clone()];
            let st = &tree.st[at.clone()];
            for i in 0..columns {
                let lane = CORNERS * j + i;
                for k in 0..3 {
                    net.p[k][lane] = corners[i].p[k];
                    net.n[k][lane] = corners[i].n[k];
                }
                net.st[0][lane] = st[i].x;
                net.st[1][lane] = st[i].y;
            }
            if moves {
                let [from, to] = moment.weights;
                let later = &tree.corners[moment.to][at];
                for (i, later) in later.iter().enumerate() {
                    let lane = CORNERS * j + i;
                    for k in 0..3 {
                        net.p[k][lane] = net.p[k][lane] * from + later.p[k] * to;
                        net.n[k][lane] = net.n[k][lane] * from + later.n[k] * to;
                    }
                }
            }
        }
        net
    }
}

/// A block over several quads.
pub(super) struct Woven<L: Lanes> {
    p: [L::Floats; 3],
    n: [L::Floats; 3],
    st: [L::Floats; 2],
    along: [&'static Along; 2],
    /// Of the columns of corners before and after each vertex.
    u: [L::Floats; 2],
    /// Of the rows, for four rows of vertices and the next four.
    v: [[L::Floats; 2]; 2],
}

impl<L: Lanes> Woven<L> {
    /// On the lattice.
    #[inline(always)]
    pub(super) fn new(lanes: L, face: &Face, patch: &Patch, net: &Net) -> Self {
        let [columns, rows] = face.count(patch.quad);
        let along = [
            &ALONG[usize::from(face.cells[0]) - 1][columns - 1],
            &ALONG[usize::from(face.cells[1]) - 1][rows - 1],
        ];
        let u = &along[0].columns;
        let v = &along[1].rows;
        let share = face.share;
        Self {
            p: [
                lanes.load(&net.p[0]),
                lanes.load(&net.p[1]),
                lanes.load(&net.p[2]),
            ],
            n: [
                lanes.load(&net.n[0]),
                lanes.load(&net.n[1]),
                lanes.load(&net.n[2]),
            ],
            st: [lanes.load(&net.st[0]), lanes.load(&net.st[1])],
            along,
            u: [
                weight(lanes, &u[0], share[0]),
                weight(lanes, &u[1], share[0]),
            ],
            v: [
                [
                    weight(lanes, &v[0][0], share[1]),
                    weight(lanes, &v[0][1], share[1]),
                ],
                [
                    weight(lanes, &v[1][0], share[1]),
                    weight(lanes, &v[1][1], share[1]),
                ],
            ],
        }
    }

    /// Brings it into the plane across a ray, as single corners are brought there.
    #[inline(always)]
    pub(super) fn shear(&mut self, lanes: L, ray: &LatticeRay) {
        let [x, y, z] = ray.k;
        let [sx, sy] = [lanes.floats(ray.s[0]), lanes.floats(ray.s[1])];
        let px = lanes.sub(self.p[x], lanes.floats(ray.origin[x]));
        let py = lanes.sub(self.p[y], lanes.floats(ray.origin[y]));
        let pz = lanes.sub(self.p[z], lanes.floats(ray.origin[z]));
        let [nx, ny, nz] = [self.n[x], self.n[y], self.n[z]];
        self.p = [
            lanes.sub(px, lanes.mul(sx, pz)),
            lanes.sub(py, lanes.mul(sy, pz)),
            pz,
        ];
        self.n = [
            lanes.sub(nx, lanes.mul(sx, nz)),
            lanes.sub(ny, lanes.mul(sy, nz)),
            nz,
        ];
    }

    #[inline(always)]
    fn rows_of(&self, lanes: L, of: L::Floats) -> [L::Floats; 2] {
        [self.half(lanes, of, 0), self.half(lanes, of, 1)]
    }

    #[inline(always)]
    fn half(&self, lanes: L, of: L::Floats, half: usize) -> L::Floats {
        let [below, above] = &self.along[1].down[half];
        let (low, high) = (lanes.pick(below, of), lanes.pick(above, of));
        let [v0, v1] = self.v[half];
        lanes.add(lanes.mul(v0, low), lanes.mul(v1, high))
    }
}

/// What a corner counts that is so many micro-quads from the other one.
#[inline(always)]
fn weight<L: Lanes>(lanes: L, at: &[f32; LANES], share: f32) -> L::Floats {
    let weight = lanes.mul(lanes.load(at), lanes.floats(share));
    lanes.min(weight, lanes.floats(1.0))
}

impl<L: Lanes> Sheet<L> for Woven<L> {
    /// Columns of corners by four rows of vertices, and by the next four.
    type Rows = [L::Floats; 2];

    #[inline(always)]
    fn p(&self, lanes: L, k: usize) -> Self::Rows {
        self.rows_of(lanes, self.p[k])
    }

    #[inline(always)]
    fn n(&self, lanes: L, k: usize) -> Self::Rows {
        self.rows_of(lanes, self.n[k])
    }

    #[inline(always)]
    fn st(&self, lanes: L, k: usize) -> Self::Rows {
        self.rows_of(lanes, self.st[k])
    }

    #[inline(always)]
    fn pair(&self, lanes: L, rows: Self::Rows, pair: usize) -> L::Floats {
        let [before, after] = &self.along[0].across[pair % 2];
        let rows = rows[pair / 2];
        let (left, right) = (lanes.pick(before, rows), lanes.pick(after, rows));
        lanes.add(lanes.mul(self.u[0], left), lanes.mul(self.u[1], right))
    }
}
