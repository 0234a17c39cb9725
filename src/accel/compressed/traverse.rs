//! One ray through one face's tree: the body that each instruction set gets compiled.
//!
//! A node has sixteen planes at most along an axis: where the ray meets each of them is a table of sixteen numbers, one
//! register, and the children pick theirs out of it.

use super::frame::LocalRay;
use super::node::Node;
use super::shape::{FAN, MOST_LEVELS, Shape};
use super::{Compressed, Face};
use crate::accel::moment::Moment;
use crate::accel::simd::{Body, LANES, Lanes};
use crate::math::{Bounds3, Ray, Vec3};

/// Where a ray met a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Met {
    pub(super) t: f32,
    /// The leaf.
    pub(super) column: usize,
    pub(super) row: usize,
}

impl Compressed {
    /// The nearest leaf of a face between the ray's `t_min` and `t_max`, or `ANY` one.
    #[inline]
    pub(super) fn trace<const ANY: bool>(&self, face: &Face, ray: &Ray) -> Option<Met> {
        if self.keys == 1 {
            self.isa.run(Trace::<ANY, false> {
                tree: self,
                face,
                ray,
            })
        } else {
            self.isa.run(Trace::<ANY, true> {
                tree: self,
                face,
                ray,
            })
        }
    }
}

/// The boxes of the leaves of a lowest node, in the face's frame: lower and upper planes by axis.
pub(super) struct Boxes([[[f32; LANES]; 3]; 2]);

impl Boxes {
    /// That of the leaf in column `i` of row `j` of the node.
    #[inline(always)]
    pub(super) fn leaf(&self, i: usize, j: usize) -> Bounds3 {
        let corner = |planes: &[[f32; LANES]; 3]| {
            let c = FAN * j + i;
            Vec3::new(planes[0][c], planes[1][c], planes[2][c])
        };
        Bounds3 {
            min: corner(&self.0[0]),
            max: corner(&self.0[1]),
        }
    }
}

impl Compressed {
    /// The boxes of a leaf and of its siblings.
    pub(super) fn boxes(&self, face: &Face, [column, row]: [usize; 2], moment: &Moment) -> Boxes {
        let shape = &self.shapes[face.shape as usize];
        let place = [1, column / FAN, row / FAN];
        self.isa.run(Decode {
            nodes: [moment.from, moment.to].map(|key| self.node(face, shape, place, key)),
            moment,
        })
    }
}

struct Decode<'a> {
    nodes: [&'a Node; 2],
    moment: &'a Moment,
}

impl Body for Decode<'_> {
    type Output = Boxes;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Boxes {
        let mut boxes = Boxes([[[0.0; LANES]; 3]; 2]);
        let [node, later] = self.nodes;
        let Moment { from, to, weights } = *self.moment;
        for k in 0..3 {
            for side in 0..2 {
                let mut planes = places(lanes, node, k, side);
                if from != to {
                    let before = lanes.mul(lanes.floats(weights[0]), planes);
                    let after = lanes.floats(weights[1]);
                    planes = lanes.add(before, lanes.mul(after, places(lanes, later, k, side)));
                }
                lanes.store(planes, &mut boxes.0[side][k]);
            }
        }
        boxes
    }
}

/// Where the lower or upper planes of all children are along an axis.
#[inline(always)]
fn places<L: Lanes>(lanes: L, node: &Node, k: usize, side: usize) -> L::Floats {
    let (origin, unit) = node.frame(k);
    let steps = lanes.mul(lanes.load(&NUMBERS), lanes.floats(unit));
    lanes.pick(
        &node.planes[side][k],
        lanes.add(steps, lanes.floats(origin)),
    )
}

struct Trace<'a, const ANY: bool, const MOVES: bool> {
    tree: &'a Compressed,
    face: &'a Face,
    ray: &'a Ray,
}

/// What waits to be visited: each level above the lowest leaves fifteen of its children behind.
const MOST_WAITING: usize = (MOST_LEVELS - 1) * (LANES - 1) + 1;

/// An entry of the stack: where the ray enters, above the place; so that integers compare as distances do.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
struct Waiting(u64);

impl Waiting {
    #[inline(always)]
    fn new(near: f32, level: usize, i: usize, j: usize) -> Self {
        Self(u64::from(near.to_bits()) << 32 | (level << 20 | j << 10 | i) as u64)
    }
    #[inline(always)]
    fn near(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }
    /// Level, column and row.
    #[inline(always)]
    fn place(self) -> (usize, usize, usize) {
        let place = self.0 as u32 as usize;
        (place >> 20, place & 1023, place >> 10 & 1023)
    }
}

impl<const ANY: bool, const MOVES: bool> Body for Trace<'_, ANY, MOVES> {
    type Output = Option<Met>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<Met> {
        let Self { tree, face, ray } = self;
        let shape = &tree.shapes[face.shape as usize];
        let walk = Walk::<MOVES> {
            tree,
            face,
            shape,
            moment: Moment::new(tree.keys, ray.time),
            ray: LocalRay::new(&face.frame, ray, face.reach),
        };
        let t_min = lanes.floats(ray.t_min);
        let mut t_max = ray.t_max;
        let mut nearest = None;
        let mut stack = [Waiting(0); MOST_WAITING];
        stack[0] = Waiting::new(0.0, shape.levels(), 0, 0);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let next = stack[count];
            if next.near() > t_max {
                continue;
            }
            let (level, i, j) = next.place();
            let (near, far) = walk.children(lanes, level, i, j);
            let there = walk.there(level, i, j);
            let end = lanes.floats(t_max);
            let mut at = [0.0; LANES];
            if level == 1 {
                let middle = lanes.mul(lanes.floats(0.5), lanes.add(near, far));
                let mut met = lanes.less_equal(near, far)
                    & lanes.less(t_min, middle)
                    & lanes.less(middle, end)
                    & there;
                if met == 0 {
                    continue;
                }
                lanes.store(middle, &mut at);
                while met != 0 {
                    let c = met.trailing_zeros() as usize;
                    met &= met - 1;
                    if at[c] < t_max {
                        t_max = at[c];
                        nearest = Some(Met {
                            t: t_max,
                            column: FAN * i + c % FAN,
                            row: FAN * j + c / FAN,
                        });
                    }
                }
                if ANY {
                    return nearest;
                }
                continue;
            }
            let near = lanes.max(near, t_min);
            let mut hits = lanes.less_equal(near, lanes.min(far, end)) & there;
            lanes.store(near, &mut at);
            // Nearest on top.
            let bottom = count;
            while hits != 0 {
                let c = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                let child = Waiting::new(at[c], level - 1, FAN * i + c % FAN, FAN * j + c / FAN);
                let mut at = count;
                while at > bottom && stack[at - 1] < child {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = child;
                count += 1;
            }
        }
        nearest
    }
}

struct Walk<'a, const MOVES: bool> {
    tree: &'a Compressed,
    face: &'a Face,
    shape: &'a Shape,
    moment: Moment,
    ray: LocalRay,
}

/// The numbers of planes.
const NUMBERS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

impl<const MOVES: bool> Walk<'_, MOVES> {
    /// The children that a node has, as bits.
    #[inline(always)]
    fn there(&self, level: usize, i: usize, j: usize) -> u32 {
        let [columns, rows] = self.shape.fan(level, i, j);
        (0x1111 * ((1 << columns) - 1)) & ((1 << (FAN * rows)) - 1)
    }

    /// Where the ray enters and leaves all children, those that are not there included. It meets those that it does
    /// not leave before it enters.
    #[inline(always)]
    fn children<L: Lanes>(
        &self,
        lanes: L,
        level: usize,
        i: usize,
        j: usize,
    ) -> (L::Floats, L::Floats) {
        let Self {
            tree, face, shape, ..
        } = *self;
        let place = [level, i, j];
        let node = tree.node(face, shape, place, self.moment.from);
        let later = tree.node(face, shape, place, self.moment.to);
        let (mut near, mut far) = self.axis(lanes, node, later, 0);
        for k in 1..3 {
            let (first, last) = self.axis(lanes, node, later, k);
            near = lanes.max(near, first);
            far = lanes.min(far, last);
        }
        (near, far)
    }

    /// The planes along an axis that the ray meets first and last.
    #[inline(always)]
    fn axis<L: Lanes>(
        &self,
        lanes: L,
        node: &Node,
        later: &Node,
        k: usize,
    ) -> (L::Floats, L::Floats) {
        let (first, last) = self.at_key(lanes, node, k);
        if !MOVES {
            return (first, last);
        }
        let (first_later, last_later) = self.at_key(lanes, later, k);
        // It grows with what it blends, whatever it rounds: between boxes lies a box that holds what lies between their
        // contents.
        let [from, to] = self.moment.weights;
        let (from, to) = (lanes.floats(from), lanes.floats(to));
        let blend = |a, b| lanes.add(lanes.mul(a, from), lanes.mul(b, to));
        (blend(first, first_later), blend(last, last_later))
    }

    #[inline(always)]
    fn at_key<L: Lanes>(&self, lanes: L, node: &Node, k: usize) -> (L::Floats, L::Floats) {
        let LocalRay {
            origin,
            inverse,
            slack,
        } = self.ray;
        let (origin, inverse) = (origin[k], inverse[k]);
        let slack = slack.copysign(inverse);
        let (start, unit) = node.frame(k);
        let shift = start - origin;
        let steps = lanes.mul(lanes.load(&NUMBERS), lanes.floats(unit * inverse));
        let enter = lanes.add(steps, lanes.floats((shift - slack) * inverse));
        let leave = lanes.add(steps, lanes.floats((shift + slack) * inverse));
        let backwards = usize::from(inverse < 0.0);
        (
            lanes.pick(&node.planes[backwards][k], enter),
            lanes.pick(&node.planes[1 - backwards][k], leave),
        )
    }
}
