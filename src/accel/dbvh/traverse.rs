//! One ray through the trees: the body that each instruction set gets compiled.

use super::Dbvh;
use super::block::{Block, Quad, Single};
use super::face::{Face, Patch, Span};
use super::heights::{Reader, ends};
use super::part::{FAN, Part};
use super::shadows::{Parts, Straight};
use super::woven::{Net, Woven};
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::quads::Sheared;
use crate::accel::simd::{LANES, Lanes};
use crate::accel::traversal::{Found, Visitor, Way};
use crate::accel::triangle::TriangleHit;
use crate::accel::waiting::{Stack, Waiting};
use crate::math::Ray;

/// Where a ray met a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::accel) struct Met {
    pub(super) hit: TriangleHit,
    pub(super) patch: u32,
    /// Column and row of the block's first micro-vertex in the quad.
    pub(super) first: [usize; 2],
    /// The micro-quad in the block, whose rows are [`SIDE`](crate::accel::quads::SIDE) apart, and whether it is its second
    /// triangle.
    pub(super) cell: usize,
    pub(super) second: bool,
}

pub(in crate::accel) struct Walk<'a, const MOVES: bool> {
    tree: &'a Dbvh,
    reader: Reader<'a>,
    /// The patch at hand.
    number: u32,
    patch: &'a Patch,
    face: &'a Face,
    /// Its quad in the plane across the ray, and how far along that about it is.
    quad: Quad,
    z: f32,
    /// The ray as the quad sees it, if that is flat.
    straight: Option<Straight>,
    /// What computing may move a vertex, or a bound around it.
    rounding: f32,
    /// Of the heights of blocks that are next.
    place: usize,
    moment: &'a Moment,
    /// The ray as it was given, and on the lattice; both end at the nearest hit so far.
    world: Ray,
    ray: LatticeRay,
}

/// A vector of the lattice in the ray's axes, sheared so that the ray runs along the third.
#[inline(always)]
fn shear(ray: &LatticeRay, v: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = ray.k.map(|k| v[k]);
    [x - ray.s[0] * z, y - ray.s[1] * z, z]
}

/// A point of it.
#[inline(always)]
fn shear_point(ray: &LatticeRay, p: [f32; 3]) -> [f32; 3] {
    shear(ray, [0, 1, 2].map(|k| p[k] - ray.origin[k]))
}

impl<const MOVES: bool> Visitor<MOVES> for Walk<'_, MOVES> {
    type Met = Met;

    #[inline(always)]
    fn way(&self) -> Way<'_> {
        Way {
            top: &self.tree.top,
            moment: self.moment,
            ray: &self.ray,
        }
    }

    #[inline(always)]
    fn patch<L: Lanes>(
        &mut self,
        _lanes: L,
        patch: u32,
        near: f32,
        _stack: &mut Stack,
    ) -> Found<Met> {
        self.enter(patch);
        // Before all other patches.
        let root = self.face.root(self.patch);
        Found::Next(Some(Waiting::part(near, root.number())))
    }

    #[inline(always)]
    fn part<L: Lanes>(&mut self, lanes: L, part: usize, stack: &mut Stack) -> Found<Met> {
        let part = Part::of_number(part);
        if part.level > 0 {
            let mut near = [0.0; LANES];
            let hits = self.parts(lanes, &part, &mut near);
            let next = stack.add(hits, |c| Waiting::part(near[c], part.child(c).number()));
            return Found::Next(next);
        }
        let met = self.block(lanes, &part);
        if let Some(met) = &met {
            self.world.t_max = met.hit.t;
            self.ray.end(met.hit.t);
        }
        met.into()
    }
}

impl<'a, const MOVES: bool> Walk<'a, MOVES> {
    /// A ray at the root; none if there is nothing in the tree.
    #[inline(always)]
    pub(super) fn new(tree: &'a Dbvh, moment: &'a Moment, ray: &Ray) -> Option<Self> {
        Some(Self {
            tree,
            reader: tree.heights.reader(),
            number: 0,
            // Replaced before it is looked at: the root leads to a patch.
            patch: tree.patches.first()?,
            face: tree.faces.first()?,
            quad: Quad {
                p: [[0.0; 4]; 3],
                n: [[0.0; 4]; 3],
            },
            z: 0.0,
            straight: None,
            rounding: 0.0,
            place: 0,
            moment,
            world: *ray,
            ray: LatticeRay::new(&tree.lattice, ray, tree.reach),
        })
    }

    #[inline(always)]
    fn enter(&mut self, number: u32) {
        let tree = self.tree;
        self.number = number;
        self.patch = &tree.patches[number as usize];
        self.face = &tree.faces[self.patch.face as usize];
        if self.face.is_woven() {
            return;
        }
        let corners = tree.corners_at(self.face.corners(self.patch.quad), self.moment);
        for (c, corner) in corners.iter().enumerate() {
            let p = shear_point(&self.ray, corner.p);
            let n = shear(&self.ray, corner.n);
            for k in 0..3 {
                self.quad.p[k][c] = p[k];
                self.quad.n[k][c] = n[k];
            }
        }
        // A quad that the ray comes near is not far from it on the first two axes.
        let quad = &self.quad;
        self.z = 0.5 * (quad.p[2][0] + quad.p[2][3]);
        let mut largest = 0.0;
        for c in 0..4 {
            for size in [
                quad.p[0][c].abs(),
                quad.p[1][c].abs(),
                (quad.p[2][c] - self.z).abs(),
            ] {
                largest = if size > largest { size } else { largest };
            }
        }
        // Some forty roundings. Normals are sheared, too.
        const ROUNDING: f32 = 64.0 * f32::EPSILON;
        self.rounding = ROUNDING * (largest + 2.0 * tree.highest);
        self.straight = if self.face.is_flat {
            self.rounding += 2.0 * self.face.bent;
            Straight::new(quad, self.z, self.ray.inverse[self.ray.k[2]])
        } else {
            None
        };
    }

    /// The children of a part of the patch that the ray meets, as bits, and where it enters each.
    #[inline(always)]
    fn parts<L: Lanes>(&mut self, lanes: L, part: &Part, entries: &mut [f32; LANES]) -> u32 {
        let (tree, face) = (self.tree, self.face);
        self.place = self.patch.ranges as usize + face.place(self.patch, part);
        let heights = tree.heights.ranges(lanes, &tree.ranges[self.place]);
        let mut slack = lanes.floats(self.rounding);
        if face.has_kept {
            let border = face.on_border(self.patch, part);
            slack = lanes.select(border, lanes.floats(self.kept_slack()), slack);
        }
        // `t` from where the quad is, where it is finer; and what rounding moves that.
        let inverse = self.ray.inverse[self.ray.k[2]];
        let (start, more) = (self.z * inverse, self.far_rounding());
        let mut near = lanes.floats(self.ray.t_min - start - more);
        let mut far = lanes.floats(self.ray.t_max - start + more);
        if let Some(straight) = &self.straight {
            straight.meet(lanes, (face, part), heights, slack, [&mut near, &mut far]);
        } else {
            let parts = Parts::new(lanes, (face, part), &self.quad, heights);
            parts.meet(lanes, slack, [self.z, inverse], [&mut near, &mut far]);
        }
        let entry = lanes.add(near, lanes.floats(start - more));
        lanes.store(lanes.max(entry, lanes.floats(self.ray.t_min)), entries);
        lanes.less_equal(near, far) & face.there(part)
    }

    /// A block's heights, and how far its vertices may be from where these put them.
    #[inline(always)]
    fn bound(&self, block: &Part, span: &Span) -> [f32; 3] {
        let codes = if self.face.levels == 0 {
            ends(self.patch.ranges)
        } else {
            let [i, j] = block.at.map(|at| at % FAN);
            self.tree.ranges[self.place].get(FAN * j + i)
        };
        let [middle, half] = self.tree.heights.range(codes);
        let slack = if self.face.has_kept && self.face.is_border(self.patch.quad, span) {
            self.kept_slack()
        } else if self.face.is_woven() {
            self.far_rounding()
        } else {
            self.rounding
        };
        [middle, half, slack]
    }

    /// Some forty roundings of what shearing may have doubled, wherever it is.
    #[inline(always)]
    fn far_rounding(&self) -> f32 {
        4.0 * self.ray.slack[3]
    }

    /// How far vertices may be from a bound where some of them are kept.
    #[inline(always)]
    fn kept_slack(&self) -> f32 {
        self.far_rounding() + 2.0 * self.face.slack
    }

    /// The nearest triangle of a block.
    #[inline(always)]
    fn block<L: Lanes>(&self, lanes: L, block: &Part) -> Option<Met> {
        let span = self.face.span(self.patch, block.at);
        let bound = Some(self.bound(block, &span));
        let block = Block::new(self.tree, self.patch, &span);
        let mut sheared = Sheared::default();
        let shear = |p| shear_point(&self.ray, p);
        let of = (&self.reader, &block);
        let (tree, moment) = (self.tree, self.moment);
        let quads = if self.face.is_woven() {
            let net = Net::new(tree, self.face, self.patch, moment);
            let mut sheet = Woven::new(lanes, self.face, self.patch, &net);
            sheet.shear(lanes, &self.ray);
            tree.vertices(lanes, of, (&sheet, bound), moment, shear, &mut sheared)
        } else {
            let sheet = Single::new(lanes, tree, self.patch, &block, &self.quad);
            tree.vertices(lanes, of, (&sheet, bound), moment, shear, &mut sheared)
        };
        if quads == 0 {
            return None;
        }
        let interval = [self.world.t_min, self.world.t_max];
        let met = sheared.nearest_of(lanes, quads, self.ray.s[2], interval)?;
        Some(Met {
            hit: met.hit,
            patch: self.number,
            first: span.first,
            cell: met.cell,
            second: met.second,
        })
    }
}
