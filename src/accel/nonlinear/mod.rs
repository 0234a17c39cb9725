//! Rays bent into the space of a height field: displaced surfaces without micro-triangles.
//!
//! After Ogaki, "Nonlinear Ray Tracing for Displacement and Shell Mapping", SIGGRAPH Asia 2023 conference papers. Over a base
//! triangle lies a prism: corners P and normals N, both linear in between, and all points P + h N. There a ray is a curve: u
//! and v are quadratics of h over one denominator. A quadtree of least and greatest heights is walked by that curve, whose
//! places on lines of constant u and v are roots of quadratics, and the micro-triangles, flat over u and v, are hit where
//! cubics are zero.
//!
//! ```text
//!   world: a ray, straight                      quad: u, v and heights        the ray, bent       4 x 4 children of a node,
//!          .  N                  N                                          .                     six lines, one order
//!           \  .   c ____________ d                h ^   max ┌─────┐ .  '                         ┌──┬──┬──┬──┐
//!            \    / \__  2nd   /                     │    .  │  .  ┴─────┐                        │  │  │  │.-│
//!          N  \  /  1st\__   /                       │   . ' └──┬────────┘ min                    ├──┼──┼─.┘──┤
//!           \  \/_________\_/                        └──────────────────────> u                   │  │.'│  │  │
//!             a         b                                                                         ├.-┼──┼──┼──┤
//! ```
//!
//! **What is traced.** Faces are cut into quads, all alike in an object, and as few as will do. A quad's corners are limit
//! points P with unit normals N. Over the whole face lie the micro-quads that the dicing rates ask for, those that other methods
//! trace; they need not end where quads do. At each micro-vertex the height is kept with 16 bits: where the line P + h N
//! there meets the displaced limit surface, by `meet`. So heights hold displacement and what the quad's triangles lack of the
//! limit surface. Micro-vertices are off that surface by half a step of height, but at other parameters than their own. How
//! far those are shifted is kept as five pairs of numbers a quad, and hits have it; what is left is told by
//! [`achieved`](Nonlinear::achieved).
//!
//! **Without cracks.** Corners at an edge are the same numbers for all faces there, and so are the edge's own heights, at its
//! own rate. Where a face has more micro-quads along it, a wall stands between the two: see `edges`. See `prism` for how rays
//! pass from quad to quad, `fold` for quads whose lines cross, and `micro` for how they pass from one micro-triangle to the
//! next. Where a face has a side that is but a point, its micro-quads are rounded up to a multiple of the quads.
//!
//! ```text
//!   tree over quads     see `top`                                   some 9 bytes a quad
//!     quad              where in which face; its range; a corner     36 bytes
//!       shifts          of parameters                                20 bytes, unless all are none
//!   face                where its heights are, its edges             56 bytes
//!     heights           micro-vertices                               2 bytes each
//!     ranges            a node's 4 x 4 children                      64 bytes, for 256 micro-quads
//!   edge                heights at its samples                       2 bytes each
//! ```
//!
//! Quads have some 500 micro-triangles on average at least, as far as there are many: more of them would take more than they
//! gain. Where displacement leans far from the lines and turns back, a line may meet it more than once, or not within 16
//! micro-edges of where it should: the micro-vertex is then where the line meets the tangent plane of the displaced point that
//! belongs to its parameters.
//!
//! The paper walks the texture's own quadtree, in the space of texture coordinates. Here each face has its heights in its own
//! parameters: that takes a byte a micro-triangle, but anything displaces, images, Ptex files and functions, seams of
//! texture coordinates are none, and curved surfaces need few prisms. The
//! curve's parameter and the four levels taken two by two are ours as well: see `curve` and `walk`.
//!
//! Corners are given in single precision and what prisms do with them is done in double. Curves are in single precision: over
//! a quad of 256 micro-quads they are off by some 1e-4 of a micro-quad. [`Hit::error`] is measured at the hit; it is the
//! distance to the bent micro-triangle. The checking mode is in the tests: a loop over all micro-triangles in double precision.

mod arrange;
mod build;
mod curve;
mod edges;
mod field;
mod lined;
mod meet;
mod micro;
mod sheets;
#[cfg(test)]
mod tests;
mod walk;

use super::Hit;
use super::lattice::Lattice;
use super::moment::Moment;
use super::prism::corners_at;
use super::simd::Isa;
use super::top::Top;
use super::traversal::{Tree, Trunk};
use crate::math::{DVec3, Ray, Vec2, Vec3};
use crate::stats::AchievedError;
use crate::surface::EdgeUse;
use edges::Edges;
use field::{Ranges, Size};
use meet::Shifts;
use walk::{Met, Walk};

/// A surface of prisms and heights.
pub struct Nonlinear {
    isa: Isa,
    lattice: Lattice,
    /// The largest coordinate on the lattice.
    reach: f32,
    keys: u32,
    left_handed: bool,
    /// Quads along each edge of a face.
    cuts: u32,
    /// The tree over the quads, which are in its order.
    top: Top,
    quads: Vec<Leaf>,
    faces: Vec<Face>,
    /// Corners of quads, face by face, with what a step of height adds; at each motion key.
    corners: Vec<[Vec3; 2]>,
    /// Face by face, at each motion key, row by row.
    heights: Vec<u16>,
    /// Face by face, at each motion key.
    ranges: Vec<Ranges>,
    /// The heights along edges.
    edges: Edges,
    /// Quad by quad of faces, at each motion key; none where nothing is shifted.
    shifts: Vec<Shifts>,
    achieved: AchievedError,
}

/// What is kept of a quad.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    /// The face's number among those that are kept; the highest bit tells of prisms that may fold.
    face: u32,
    /// Column and row among the face's quads.
    place: [u16; 2],
    /// The least height and the greatest.
    low: u16,
    high: u16,
}

impl Leaf {
    const FOLDS: u32 = 1 << 31;

    /// The face's number among those that are kept.
    #[inline(always)]
    fn of(&self) -> u32 {
        self.face & !Self::FOLDS
    }

    /// Whether its prisms may fold.
    #[inline(always)]
    fn may_fold(&self) -> bool {
        self.face & Self::FOLDS != 0
    }
}

/// A face.
#[derive(Debug, Clone, Copy)]
struct Face {
    face: u32,
    /// Where its corners, heights and ranges begin.
    corner: u32,
    heights: u32,
    ranges: u32,
    size: Size,
    /// Sides that are but a point, as bits.
    collapsed: u8,
    /// Its edges.
    edges: [EdgeUse; 4],
}

/// A quad.
#[derive(Debug, Clone, Copy)]
struct Quad {
    face: u32,
    /// The face's number among those that are kept.
    of: u32,
    /// Its first corner; the next one follows it, and the other two a row of corners later.
    corner: usize,
    /// The face's first height, how many there are in a row of the face, and how many in all.
    heights: usize,
    stride: usize,
    in_face: usize,
    /// The face's ranges, and how many there are for a motion key.
    ranges: usize,
    count: usize,
    place: [u16; 2],
    /// The face's.
    size: Size,
    /// The micro-quads from the first to the last that it has a part of.
    first: [u32; 2],
    last: [u32; 2],
    /// Where it begins and ends, in micro-quads from the first one's corner on.
    begin: [f64; 2],
    end: [f64; 2],
    low: u16,
    high: u16,
    /// The side that is but a point, if there is one.
    collapsed: Collapsed,
}

/// A part of a face along u or v: the first and last of its `n` micro-quads that piece `k` of `cuts` has a part of, and where
/// the piece begins and ends, counted from the first one's corner.
#[inline(always)]
fn piece(n: u16, cuts: u32, k: u16) -> ([u32; 2], [f64; 2]) {
    let from = u32::from(k) * u32::from(n);
    let to = from + u32::from(n);
    let first = from / cuts;
    let at = |x: u32| f64::from(x - first * cuts) / f64::from(cuts);
    ([first, to.div_ceil(cuts) - 1], [at(from), at(to)])
}

/// A side of a quad that is a point: only one of the triangles has an area. Its third side lies where the quad's side beside
/// the point is, and so must its heights: over the triangle, u or v are stretched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Collapsed {
    None,
    /// The first triangle's c is d as well.
    Top,
    /// Its b is.
    Right,
    /// The second triangle's b is a as well.
    Bottom,
    /// Its c is.
    Left,
}

impl Collapsed {
    /// The parameters over the quad, 0..1, of a place over the triangle with an area.
    fn stretched(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let ratio = |a: f64, b: f64| if b > 0.0 { (a / b).min(1.0) } else { 0.0 };
        match self {
            Self::None => [x, y],
            Self::Top => [ratio(x, 1.0 - y), y],
            Self::Right => [x, ratio(y, 1.0 - x)],
            Self::Bottom => [1.0 - ratio(1.0 - x, y), y],
            Self::Left => [x, 1.0 - ratio(1.0 - y, x)],
        }
    }

    /// Gives the third side of the triangle with an area the heights of the quad's side that lies there, which the next
    /// quad has as well. `n` micro-quads along each side, rows `stride` apart.
    fn fold(self, n: usize, stride: usize, heights: &mut [u16]) {
        let at = |i: usize, j: usize| j * stride + i;
        for i in 0..=n {
            let j = n - i;
            let from = match self {
                Self::None => return,
                Self::Top => at(n, j),
                Self::Right => at(i, n),
                Self::Bottom => at(0, j),
                Self::Left => at(i, 0),
            };
            heights[at(i, j)] = heights[from];
        }
    }
}

impl Face {
    /// How many heights there are in a row, and at all.
    #[inline(always)]
    fn heights(&self) -> [usize; 2] {
        let [nu, nv] = self.size.quads();
        [nu + 1, (nu + 1) * (nv + 1)]
    }

    /// The side of a quad that is a point.
    #[inline(always)]
    fn collapsed(&self, cuts: u32, [i, j]: [u16; 2]) -> Collapsed {
        if self.collapsed == 0 {
            return Collapsed::None;
        }
        let last = cuts as u16 - 1;
        let is = |there: bool, k: u32| there && self.collapsed >> k & 1 == 1;
        match () {
            () if is(j == last, 2) => Collapsed::Top,
            () if is(i == last, 1) => Collapsed::Right,
            () if is(j == 0, 0) => Collapsed::Bottom,
            () if is(i == 0, 3) => Collapsed::Left,
            () => Collapsed::None,
        }
    }
}

impl Quad {
    /// Which part of it u and v are, 0..1.
    #[inline(always)]
    fn part(&self, uv: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| (uv[k] - self.begin[k]) / (self.end[k] - self.begin[k]))
    }

    /// The weights of its corners at u and v.
    #[inline(always)]
    fn weights(&self, uv: [f32; 2]) -> [f64; 4] {
        weights(self.part(uv.map(f64::from)))
    }
}

/// The weights of a quad's corners at x and y of it.
#[inline(always)]
fn weights([x, y]: [f64; 2]) -> [f64; 4] {
    if x + y <= 1.0 {
        [1.0 - x - y, x, y, 0.0]
    } else {
        [0.0, 1.0 - y, 1.0 - x, x + y - 1.0]
    }
}

impl Nonlinear {
    /// How far micro-vertices are from the displaced limit points of the parameters that hits there have.
    pub fn achieved(&self) -> AchievedError {
        self.achieved
    }

    /// A quad, by its number in the order of the tree.
    #[inline(always)]
    fn quad(&self, number: u32) -> Quad {
        let leaf = &self.quads[number as usize];
        let face = &self.faces[leaf.of() as usize];
        let [stride, in_face] = face.heights();
        let (us, u) = piece(face.size.0[0], self.cuts, leaf.place[0]);
        let (vs, v) = piece(face.size.0[1], self.cuts, leaf.place[1]);
        Quad {
            face: face.face,
            of: leaf.of(),
            corner: self.corner(leaf),
            heights: face.heights as usize,
            stride,
            in_face,
            ranges: face.ranges as usize,
            count: face.size.ranges(),
            place: leaf.place,
            size: face.size,
            first: [us[0], vs[0]],
            last: [us[1], vs[1]],
            begin: [u[0], v[0]],
            end: [u[1], v[1]],
            low: leaf.low,
            high: leaf.high,
            collapsed: face.collapsed(self.cuts, leaf.place),
        }
    }

    /// A quad's first corner.
    #[inline(always)]
    fn corner(&self, leaf: &Leaf) -> usize {
        let [i, j] = leaf.place.map(usize::from);
        let row = self.cuts as usize + 1;
        self.faces[leaf.of() as usize].corner as usize + j * row + i
    }

    /// A quad's corners at a moment, of which the first is given.
    #[inline(always)]
    fn corners(&self, first: usize, moment: &Moment) -> [[DVec3; 2]; 4] {
        let row = self.cuts as usize + 1;
        let numbers = [first, first + 1, first + row, first + row + 1];
        corners_at(&self.corners, numbers, self.keys, moment)
    }

    /// The heights of a micro-quad's corners at a moment.
    #[inline(always)]
    fn cell(&self, quad: &Quad, [i, j]: [u32; 2], moment: &Moment) -> micro::Heights {
        let place = j as usize * quad.stride + i as usize;
        let at = |key: usize| {
            let first = quad.heights + key * quad.in_face + place;
            let row = |at: usize| [f32::from(self.heights[at]), f32::from(self.heights[at + 1])];
            let ([a, b], [c, d]) = (row(first), row(first + quad.stride));
            [a, b, c, d]
        };
        let from = at(moment.from);
        if moment.from == moment.to {
            return from;
        }
        let to = at(moment.to);
        [0, 1, 2, 3].map(|k| moment.weights[0] * from[k] + moment.weights[1] * to[k])
    }

    /// How far parameters are shifted, in quads.
    #[inline(always)]
    fn shift(&self, number: u32, weights: [f64; 4], moment: &Moment) -> [f64; 2] {
        if self.shifts.is_empty() {
            return [0.0; 2];
        }
        let leaf = &self.quads[number as usize];
        let (cuts, [i, j]) = (self.cuts as usize, leaf.place.map(usize::from));
        let first = ((leaf.of() as usize * cuts + j) * cuts + i) * self.keys as usize;
        let from = meet::shift(&self.shifts[first + moment.from], weights);
        if moment.from == moment.to {
            return from;
        }
        let to = meet::shift(&self.shifts[first + moment.to], weights);
        let [a, b] = [f64::from(moment.weights[0]), f64::from(moment.weights[1])];
        [a * from[0] + b * to[0], a * from[1] + b * to[1]]
    }
}

impl Tree for Nonlinear {
    type Met = Met;
    type Walk<'a, const ANY: bool, const MOVES: bool> = Walk<'a, MOVES>;

    #[inline(always)]
    fn trunk(&self) -> Trunk<'_> {
        Trunk {
            isa: self.isa,
            keys: self.keys,
            lattice: &self.lattice,
            top: &self.top,
        }
    }

    #[inline(always)]
    fn walk<'a, const ANY: bool, const MOVES: bool>(
        &'a self,
        moment: &'a Moment,
        ray: &Ray,
    ) -> Option<Self::Walk<'a, ANY, MOVES>> {
        Some(Walk::new(self, moment, ray))
    }

    fn hit_on(&self, ray: &Ray, met: &Met) -> Hit {
        let quad = &self.quad(met.quad);
        let moment = Moment::new(self.keys, ray.time);
        let [x, y] = [0, 1].map(|k| met.uv[k] - (met.cell[k] - quad.first[k]) as f32);
        let heights = self.cell(quad, met.cell, &moment);
        let plane = micro::Plane::new(&heights, x + y > 1.0);

        // The derivatives of P + h N by u and v, of which N times those of h make the micro-triangle's: their cross product
        // is what the adjugate of the prism's matrix makes of the micro-triangle's normal.
        let [a, b, c, d] = self.corners(quad.corner, &moment);
        let height = f64::from(met.height);
        let at = |corner: &[DVec3; 2]| corner[0] + height * corner[1];
        let weights = quad.weights(met.uv);
        let lower = weights[3] == 0.0;
        let (by_u, by_v) = if lower {
            (at(&b) - at(&a), at(&c) - at(&a))
        } else {
            (at(&d) - at(&c), at(&d) - at(&b))
        };
        let all = [a, b, c, d];
        let n: DVec3 = (0..4).map(|k| weights[k] * all[k][1]).sum();
        let point: DVec3 = (0..4).map(|k| weights[k] * at(&all[k])).sum();
        let [nu, nv] = [0, 1].map(|k| quad.end[k] - quad.begin[k]);
        let (normal, off) = match met.wall {
            None => {
                let normal =
                    (by_u / nu + f64::from(plane.u) * n).cross(by_v / nv + f64::from(plane.v) * n);
                let off = f64::from(plane.base + x * plane.u + y * plane.v) - height;
                (if self.left_handed { -normal } else { normal }, off)
            }
            Some((k, is_above)) => {
                let [a, b, c, d] = all.map(|corner| at(&corner));
                let along = [b - a, d - b, d - c, c - a][k];
                let across = along.cross(n);
                // From the higher one to the lower one.
                let outward = across.dot(0.25 * (a + b + c + d) - point) < 0.0;
                (if outward == is_above { across } else { -across }, 0.0)
            }
        };
        let unit = normal.normalize_or_zero();
        // Measured: from the point that whoever reads `t` computes to the micro-triangle.
        let gap = ray.at(met.t).as_dvec3() - point;
        let distance = unit.dot(gap).abs() + (off * unit.dot(n)).abs();

        let cuts = f64::from(self.cuts);
        let [x, y] = quad.collapsed.stretched(quad.part(met.uv.map(f64::from)));
        let [by_x, by_y] = self.shift(met.quad, weights, &moment);
        let within =
            |place: u16, part: f64| ((f64::from(place) + part) / cuts).clamp(0.0, 1.0) as f32;
        // Single precision has no room for the areas of small triangles squared.
        let facing = if unit == DVec3::ZERO {
            unit
        } else {
            normal / normal.abs().max_element()
        };
        Hit {
            t: met.t,
            face: quad.face,
            uv: Vec2::new(
                within(quad.place[0], x + by_x),
                within(quad.place[1], y + by_y),
            ),
            normal: facing.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }

    fn bytes(&self) -> usize {
        self.top.memory()
            + size_of_val(self.quads.as_slice())
            + size_of_val(self.faces.as_slice())
            + size_of_val(self.corners.as_slice())
            + size_of_val(self.heights.as_slice())
            + size_of_val(self.ranges.as_slice())
            + self.edges.memory()
            + size_of_val(self.shifts.as_slice())
    }
}
