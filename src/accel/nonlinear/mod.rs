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
//! **What is traced.** Faces are cut into quads, all alike in an object, and quads into a power of two of micro-quads along u
//! and v, about as many as the dicing rates say. A quad's corners are limit points P with unit normals N. At each
//! micro-vertex the height is kept with 16 bits: where the line P + h N there meets the displaced limit surface, by `meet`.
//! So heights hold displacement and what the quad's triangles lack of the limit surface. Micro-vertices are off that surface
//! by half a step of height, but at other parameters than their own. How far those are shifted is kept as five pairs of
//! numbers a quad, and hits have it; what is left is told by [`achieved`](Nonlinear::achieved).
//!
//! **Without cracks.** Heights and corners at an edge are the same numbers for all faces there; where faces are cut
//! differently, the finer one has what the coarser one's line between two heights passes, exactly. See `prism` for how rays
//! pass from quad to quad, and `micro` for how they pass from one micro-triangle to the next.
//!
//! ```text
//!   tree over quads     see `top`                                   some 9 bytes a quad
//!     quad              where in which face; its range; a corner     36 bytes
//!       shifts          of parameters                                20 bytes, unless all are none
//!       ranges          a node's 4 x 4 children                      64 bytes, for 256 micro-quads
//!   face                where its heights are                        24 bytes
//!     heights           micro-vertices                               2 bytes each
//! ```
//!
//! The paper walks the texture's own quadtree, in the space of texture coordinates. Here each quad has its heights in its own
//! parameters: that takes a byte a micro-triangle, but anything displaces, images, Ptex files and functions, seams of
//! texture coordinates are none, no texel lies across a triangle's border, and curved surfaces need few prisms. The
//! curve's parameter and the four levels taken two by two are ours as well: see `curve` and `walk`.
//!
//! Corners are given in single precision and what prisms do with them is done in double. Curves are in single precision: over
//! a quad of 256 micro-quads they are off by some 1e-4 of a micro-quad. [`Hit::error`] is measured at the hit. The checking
//! mode is in the tests: a loop over all micro-triangles in double precision.

mod build;
mod curve;
mod field;
mod meet;
mod micro;
mod prism;
mod sheets;
#[cfg(test)]
mod tests;
mod walk;

use super::lattice::Lattice;
use super::moment::Moment;
use super::simd::Isa;
use super::top::Top;
use super::{Hit, Intersector};
use crate::math::{Bounds3, DVec3, Ray, Vec2, Vec3};
use crate::stats::AchievedError;
use field::{Ranges, Size};
use meet::Shifts;
use walk::Met;

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
    /// Quad by quad of faces, at each motion key.
    ranges: Vec<Ranges>,
    /// Likewise; none where nothing is shifted.
    shifts: Vec<Shifts>,
    achieved: AchievedError,
}

/// What is kept of a quad.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    /// Its number among those that are kept.
    face: u32,
    /// Column and row among the face's quads.
    place: [u16; 2],
    /// The least height and the greatest.
    low: u16,
    high: u16,
}

/// A face.
#[derive(Debug, Clone, Copy)]
struct Face {
    face: u32,
    /// Where its corners, heights and ranges begin.
    corner: u32,
    heights: u32,
    ranges: u32,
    /// Of each of its quads.
    size: Size,
    /// Sides that are but a point, as bits.
    collapsed: u8,
}

/// A quad.
#[derive(Debug, Clone, Copy)]
struct Quad {
    face: u32,
    /// Its first corner; the next one follows it, and the other two a row of corners later.
    corner: usize,
    /// Its first height, how many there are in a row of the face, and how many in all.
    heights: usize,
    stride: usize,
    in_face: usize,
    /// Its ranges, and how many there are for a motion key.
    ranges: usize,
    count: usize,
    place: [u16; 2],
    size: Size,
    low: u16,
    high: u16,
    /// The side that is but a point, if there is one.
    collapsed: Collapsed,
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
    fn heights(&self, cuts: u32) -> [usize; 2] {
        let [nu, nv] = self.size.quads();
        let stride = cuts as usize * nu + 1;
        [stride, stride * (cuts as usize * nv + 1)]
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
    /// The weights of its corners at u and v.
    #[inline(always)]
    fn weights(&self, uv: [f32; 2]) -> [f64; 4] {
        let [nu, nv] = self.size.quads();
        weights([f64::from(uv[0]) / nu as f64, f64::from(uv[1]) / nv as f64])
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
        let face = &self.faces[leaf.face as usize];
        let [stride, in_face] = face.heights(self.cuts);
        let [i, j] = leaf.place.map(usize::from);
        let [nu, nv] = face.size.quads();
        let (cuts, count) = (self.cuts as usize, face.size.ranges());
        Quad {
            face: face.face,
            corner: face.corner as usize + j * (cuts + 1) + i,
            heights: face.heights as usize + j * nv * stride + i * nu,
            stride,
            in_face,
            ranges: face.ranges as usize + (j * cuts + i) * count * self.keys as usize,
            count,
            place: leaf.place,
            size: face.size,
            low: leaf.low,
            high: leaf.high,
            collapsed: face.collapsed(self.cuts, leaf.place),
        }
    }

    /// A quad's corners at a moment.
    #[inline(always)]
    fn corners(&self, quad: &Quad, moment: &Moment) -> [[DVec3; 2]; 4] {
        let row = self.cuts as usize + 1;
        let all = self.corners.len() / self.keys as usize;
        let first = quad.corner;
        let at = |next: usize| {
            let [p, n] = &self.corners[first + next + moment.from * all];
            let from = [p.as_dvec3(), n.as_dvec3()];
            if moment.from == moment.to {
                return from;
            }
            let [p, n] = &self.corners[first + next + moment.to * all];
            let [a, b] = [f64::from(moment.weights[0]), f64::from(moment.weights[1])];
            [
                a * from[0] + b * p.as_dvec3(),
                a * from[1] + b * n.as_dvec3(),
            ]
        };
        [at(0), at(1), at(row), at(row + 1)]
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
        let first = ((leaf.face as usize * cuts + j) * cuts + i) * self.keys as usize;
        let from = meet::shift(&self.shifts[first + moment.from], weights);
        if moment.from == moment.to {
            return from;
        }
        let to = meet::shift(&self.shifts[first + moment.to], weights);
        let [a, b] = [f64::from(moment.weights[0]), f64::from(moment.weights[1])];
        [a * from[0] + b * to[0], a * from[1] + b * to[1]]
    }

    fn hit(&self, ray: &Ray, met: &Met) -> Hit {
        let quad = &self.quad(met.quad);
        let moment = Moment::new(self.keys, ray.time);
        let [nu, nv] = quad.size.quads();
        let [u, v] = met.uv;
        let [x, y] = [u - met.cell[0] as f32, v - met.cell[1] as f32];
        let heights = self.cell(quad, met.cell, &moment);
        let plane = micro::Plane::new(&heights, x + y > 1.0);

        // The derivatives of P + h N by u and v, of which N times those of h make the micro-triangle's: their cross product
        // is what the adjugate of the prism's matrix makes of the micro-triangle's normal.
        let [a, b, c, d] = self.corners(quad, &moment);
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
        let normal = (by_u / nu as f64 + f64::from(plane.u) * n)
            .cross(by_v / nv as f64 + f64::from(plane.v) * n);
        let unit = normal.normalize_or_zero();
        // Measured: from the point that whoever reads `t` computes to the micro-triangle.
        let off = f64::from(plane.base + x * plane.u + y * plane.v) - height;
        let gap = ray.at(met.t).as_dvec3() - point;
        let distance = unit.dot(gap).abs() + (off * unit.dot(n)).abs();

        let cuts = f64::from(self.cuts);
        let [x, y] = quad
            .collapsed
            .stretched([f64::from(u) / nu as f64, f64::from(v) / nv as f64]);
        let [by_x, by_y] = self.shift(met.quad, weights, &moment);
        let within =
            |place: u16, part: f64| ((f64::from(place) + part) / cuts).clamp(0.0, 1.0) as f32;
        let facing = normal * if self.left_handed { -1.0 } else { 1.0 };
        // Single precision has no room for the areas of small triangles squared.
        let facing = if unit == DVec3::ZERO {
            unit
        } else {
            facing / facing.abs().max_element()
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
}

impl Intersector for Nonlinear {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.keys
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        self.lattice.bounds(&self.top.extent(key as usize))
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        self.trace::<false>(ray).map(|met| self.hit(ray, &met))
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        self.trace::<true>(ray).is_some()
    }

    fn memory(&self) -> usize {
        self.top.memory()
            + size_of_val(self.quads.as_slice())
            + size_of_val(self.faces.as_slice())
            + size_of_val(self.corners.as_slice())
            + size_of_val(self.heights.as_slice())
            + size_of_val(self.ranges.as_slice())
            + size_of_val(self.shifts.as_slice())
    }
}
