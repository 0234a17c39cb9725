//! One ray through the trees: the body that each instruction set gets compiled.
//!
//! A tile takes one move of the ray into its coordinates and one test of sixteen slabs: between two planes across u, two
//! across v, and two along the leaf's plane. All are widened by more than what is rounded on the way, so that a ray which
//! passes through the surface anywhere passes through a slab. The ray meets a leaf halfway between the planes along it, or
//! where it enters or leaves the leaf if that is after or before.

use super::Compressed;
use super::patch::Patch;
use super::tile::{CUTS, Cuts, MOST_QUADS, Tile, there};
use crate::accel::boxes::Boxes;
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::simd::{LANES, Lanes, Nibbles};
use crate::accel::traversal::{Found, Visitor, Way};
use crate::accel::waiting::{Stack, Waiting};
use crate::math::Ray;

/// Where a ray met a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::accel) struct Met {
    pub(super) t: f32,
    pub(super) patch: u32,
    /// The tile in the patch, and the leaf in the tile.
    pub(super) tile: usize,
    pub(super) leaf: usize,
}

pub(in crate::accel) struct Walk<'a, const MOVES: bool> {
    tree: &'a Compressed,
    /// The patch at hand.
    number: u32,
    patch: &'a Patch,
    moment: &'a Moment,
    /// What is asked about, of the ray as it was given.
    t_min: f32,
    t_max: f32,
    /// On the lattice; it ends at the nearest hit so far, too.
    ray: LatticeRay,
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
        lanes: L,
        patch: u32,
        near: f32,
        stack: &mut Stack,
    ) -> Found<Met> {
        self.number = patch;
        self.patch = &self.tree.patches[patch as usize];
        // Before all other patches.
        if self.patch.is_single() {
            return Found::Next(Some(Waiting::part(near, 0)));
        }
        let mut near = [0.0; LANES];
        let hits = self.tiles(lanes, &mut near);
        Found::Next(stack.add(hits, |c| Waiting::part(near[c], c)))
    }

    #[inline(always)]
    fn part<L: Lanes>(&mut self, lanes: L, part: usize, _stack: &mut Stack) -> Found<Met> {
        let met = self.tile(lanes, part);
        if let Some(met) = &met {
            self.t_max = met.t;
            self.ray.end(met.t);
        }
        met.into()
    }
}

/// What u, v and h are in a tile, about.
const REACHES: [f32; 3] = [16.0, 16.0, 512.0];

/// Smaller steps of u, v or h along a ray are taken for this: over the longest way through a lattice it does not matter.
const LEAST: f32 = 1.0 / (1_u64 << 44) as f32;

impl<'a, const MOVES: bool> Walk<'a, MOVES> {
    /// A ray at the root; none if there is nothing in the tree.
    #[inline(always)]
    pub(super) fn new(tree: &'a Compressed, moment: &'a Moment, ray: &Ray) -> Option<Self> {
        Some(Self {
            tree,
            number: 0,
            // Replaced before it is looked at: the root leads to a patch.
            patch: tree.patches.first()?,
            moment,
            t_min: ray.t_min,
            t_max: ray.t_max,
            ray: LatticeRay::new(&tree.lattice, ray, tree.reach),
        })
    }

    /// The tiles of the patch that the ray meets, as bits, and where it enters each.
    #[inline(always)]
    fn tiles<L: Lanes>(&self, lanes: L, entries: &mut [f32; LANES]) -> u32 {
        let root = self.patch.root as usize;
        let at = |key: usize| &self.tree.fans[root + key].boxes;
        let boxes = [at(self.moment.from), at(self.moment.to)];
        self.met(lanes, boxes, entries) & self.patch.there()
    }

    #[inline(always)]
    fn met<L: Lanes>(&self, lanes: L, [from, to]: [&Boxes; 2], entries: &mut [f32; LANES]) -> u32 {
        if MOVES {
            from.met_on_the_way(to, self.moment, lanes, &self.ray, entries)
        } else {
            from.met(lanes, &self.ray, entries)
        }
    }

    /// The nearest leaf of a tile.
    #[inline(always)]
    fn tile<L: Lanes>(&self, lanes: L, number: usize) -> Option<Met> {
        let at = |key| self.tree.tile(self.patch, number, key);
        let tile = at(self.moment.from);
        let [nu, nv] = self.patch.quads_of(number).map(|n| n.min(MOST_QUADS));
        let cuts = [&CUTS[0][nu], &CUTS[1][nv]];
        let mut slabs = Slabs::new(lanes, tile, cuts);
        let mut origin = tile.origin();
        if MOVES {
            let later = at(self.moment.to);
            slabs = slabs.on_the_way(lanes, &Slabs::new(lanes, later, cuts), self.moment);
            let [a, b] = self.moment.weights;
            let to = later.origin();
            origin = [0, 1, 2].map(|k| a * origin[k] + b * to[k]);
        }

        // The ray in the tile's coordinates, and how far it may be off there. What is rounded by the tests grows with
        // where it starts and with what it may meet.
        let off = [0, 1, 2].map(|k| self.ray.origin[k] - origin[k]);
        let dot = |a: &[f32; 3], b: &[f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let axes = tile.axes();
        let mut starts = [0.0; 3];
        let mut slacks = [0.0; 3];
        let mut steps = [0.0; 3];
        for k in 0..3 {
            let axis = &axes[k];
            starts[k] = dot(axis, &off);
            steps[k] = dot(axis, &self.ray.direction);
            let sum = axis[0].abs() + axis[1].abs() + axis[2].abs();
            slacks[k] =
                sum * self.ray.slack[3] + 8.0 * f32::EPSILON * (starts[k].abs() + REACHES[k]);
        }

        // Across u and v.
        let mut near = lanes.floats(0.0);
        let mut far = lanes.floats(f32::INFINITY);
        for k in 0..2 {
            let step = if steps[k].abs() < LEAST {
                LEAST.copysign(steps[k])
            } else {
                steps[k]
            };
            let inverse = 1.0 / step;
            let wider = slacks[k].copysign(step);
            let [from, to] = [slabs.sides[0][k], slabs.sides[1][k]];
            let [first, last] = if step < 0.0 { [to, from] } else { [from, to] };
            let meets = |side, shift: f32| {
                let way = lanes.sub(side, lanes.floats(shift));
                lanes.mul(way, lanes.floats(inverse))
            };
            near = lanes.max(near, meets(first, starts[k] + wider));
            far = lanes.min(far, meets(last, starts[k] - wider));
        }

        // Along the planes: heights above them, where the ray starts, and how they grow along it.
        let [a, b, c, d] = slabs.corners;
        let (ab, cd) = (lanes.add(a, b), lanes.add(c, d));
        let (ac, bd) = (lanes.add(a, c), lanes.add(b, d));
        let mean = lanes.mul(lanes.add(ab, cd), lanes.floats(0.25));
        let slopes = [
            lanes.mul(lanes.sub(bd, ac), lanes.load(&cuts[0].slope)),
            lanes.mul(lanes.sub(cd, ab), lanes.load(&cuts[1].slope)),
        ];
        let mut above = lanes.sub(lanes.floats(starts[2]), mean);
        let mut grows = lanes.floats(steps[2]);
        let mut slack = lanes.floats(slacks[2]);
        let zero = lanes.floats(0.0);
        for k in 0..2 {
            let way = lanes.sub(lanes.floats(starts[k]), lanes.load(&cuts[k].middle));
            above = lanes.sub_mul(above, slopes[k], way);
            grows = lanes.sub_mul(grows, slopes[k], lanes.floats(steps[k]));
            let steep = lanes.max(slopes[k], lanes.sub(zero, slopes[k]));
            slack = lanes.mul_add(steep, lanes.floats(slacks[k]), slack);
        }
        let [below, over] = slabs.depths;
        let inverse = lanes.div(lanes.floats(1.0), grows);
        let meets = |height| lanes.mul(lanes.sub(height, above), inverse);
        let lower = meets(lanes.sub(lanes.sub(zero, below), slack));
        let upper = meets(lanes.add(over, slack));
        let middle = meets(lanes.mul(lanes.sub(over, below), lanes.floats(0.5)));
        // What is not a number, or infinite, decides nothing.
        near = lanes.max(lanes.min(lower, upper), near);
        far = lanes.min(lanes.max(lower, upper), far);
        let met = lanes.min(lanes.max(middle, near), far);

        let t = lanes.mul(met, lanes.floats(self.per_lattice_t()));
        let mut hits = lanes.less_equal(near, far)
            & lanes.less(lanes.floats(self.t_min), t)
            & lanes.less(t, lanes.floats(self.t_max))
            & there([nu, nv]);
        if hits == 0 {
            return None;
        }
        let mut ts = [0.0; LANES];
        lanes.store(t, &mut ts);
        let mut leaf = hits.trailing_zeros() as usize;
        hits &= hits - 1;
        while hits != 0 {
            let other = hits.trailing_zeros() as usize;
            hits &= hits - 1;
            if ts[other] < ts[leaf] {
                leaf = other;
            }
        }
        Some(Met {
            t: ts[leaf],
            patch: self.number,
            tile: number,
            leaf,
        })
    }

    /// What the ray's own `t` is for a `t` of 1 on the lattice.
    #[inline(always)]
    fn per_lattice_t(&self) -> f32 {
        1.0 / self.ray.per_t
    }
}

/// A tile's leaves.
struct Slabs<L: Lanes> {
    corners: [L::Floats; 4],
    /// Below and above.
    depths: [L::Floats; 2],
    /// The least u and v, and the most.
    sides: [[L::Floats; 2]; 2],
}

impl<L: Lanes> Slabs<L> {
    #[inline(always)]
    fn new(lanes: L, tile: &Tile, [u, v]: [&Cuts; 2]) -> Self {
        let [a, b, c, d] = tile.corners();
        let depths = tile.depths_by_number(lanes);
        let [least, most] = tile.sides_by_number(lanes);
        let side = |quads: &[f32; LANES], numbers: &Nibbles, wider: L::Floats| {
            lanes.add(lanes.load(quads), lanes.pick(numbers, wider))
        };
        Self {
            corners: [
                lanes.bytes(&a),
                lanes.bytes(&b),
                lanes.bytes(&c),
                lanes.bytes(&d),
            ],
            depths: [
                lanes.pick(tile.depths(0), depths),
                lanes.pick(tile.depths(1), depths),
            ],
            sides: [
                [
                    side(&u.first, tile.sides(0, 0), least),
                    side(&v.first, tile.sides(0, 1), least),
                ],
                [
                    side(&u.last, tile.sides(1, 0), most),
                    side(&v.last, tile.sides(1, 1), most),
                ],
            ],
        }
    }

    #[inline(always)]
    fn on_the_way(&self, lanes: L, to: &Self, moment: &Moment) -> Self {
        let two = |a: [L::Floats; 2], b: [L::Floats; 2]| {
            [
                moment.between_lanes(lanes, a[0], b[0]),
                moment.between_lanes(lanes, a[1], b[1]),
            ]
        };
        let [a, b, c, d] = self.corners;
        let [a2, b2, c2, d2] = to.corners;
        let ([a, b], [c, d]) = (two([a, b], [a2, b2]), two([c, d], [c2, d2]));
        Self {
            corners: [a, b, c, d],
            depths: two(self.depths, to.depths),
            sides: [
                two(self.sides[0], to.sides[0]),
                two(self.sides[1], to.sides[1]),
            ],
        }
    }
}
