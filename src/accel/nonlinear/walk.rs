//! One ray through the tree over quads, and through their heights: the body that each instruction set gets compiled.
//!
//! A node of a face's tree is a square of 4 x 4. It is walked from the lowest node that has all of a quad. Its lines of
//! constant u and v, three each within it, cut the curve: six quadratics, solved at once, serve all sixteen children. A
//! piece of the curve grows, or falls, in u and in v: it is in a child from the later of the places where it passes that
//! child's first lines to the earlier of those where it passes the last. A child whose range of heights the curve is not
//! within meanwhile is left out; the others are visited in the order of the curve, which is that of the ray: the first hit
//! is the nearest.

use arrayvec::ArrayVec;

use super::curve::{Curve, MOST_PIECES, Piece};
use super::field::{LEVELS, Size};
use super::lined::{Lined, Node};
use super::{Nonlinear, Quad, micro};
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::prism::{Parts, Pole, Sheared, Span, cross, of_half};
use crate::accel::simd::{LANES, Lanes};
use crate::accel::traversal::{Found, Visitor, Way};
use crate::accel::waiting::Stack;
use crate::math::Ray;

/// Where a ray met the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::accel) struct Met {
    pub(super) t: f32,
    pub(super) quad: u32,
    /// In micro-quads of the quad.
    pub(super) uv: [f32; 2],
    /// The micro-quad's column and row.
    pub(super) cell: [u32; 2],
    pub(super) height: f32,
    /// On a wall: which edge of the face it is on, and whether the face is above the edge there.
    pub(super) wall: Option<(usize, bool)>,
}

pub(in crate::accel) struct Walk<'a, const MOVES: bool> {
    of: &'a Nonlinear,
    moment: &'a Moment,
    sheared: Sheared,
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
            top: &self.of.top,
            moment: self.moment,
            ray: &self.ray,
        }
    }

    #[inline(always)]
    fn patch<L: Lanes>(
        &mut self,
        lanes: L,
        patch: u32,
        _near: f32,
        _stack: &mut Stack,
    ) -> Found<Met> {
        let met = self.quad(lanes, patch);
        if let Some(met) = &met {
            self.t_max = met.t;
            self.ray.end(met.t);
        }
        met.into()
    }
}

/// Each level leaves six of its children behind.
const MOST_WAITING: usize = 6 * LEVELS + 1;

impl<'a, const MOVES: bool> Walk<'a, MOVES> {
    /// A ray at the root.
    #[inline(always)]
    pub(super) fn new(of: &'a Nonlinear, moment: &'a Moment, ray: &Ray) -> Self {
        Self {
            of,
            moment,
            sheared: Sheared::new(ray),
            t_min: ray.t_min,
            t_max: ray.t_max,
            ray: LatticeRay::new(&of.lattice, ray, of.reach),
        }
    }

    /// The nearest hit on a quad.
    #[inline(always)]
    fn quad<L: Lanes>(&self, lanes: L, number: u32) -> Option<Met> {
        let leaf = &self.of.quads[number as usize];
        let corners = self.of.corners(self.of.corner(leaf), self.moment);
        let heights = [f64::from(leaf.low) - 1.0, f64::from(leaf.high) + 1.0];
        let mut parts = Parts::new([self.t_min, self.t_max]);
        let poles = cross(
            lanes,
            &mut parts,
            &self.sheared,
            &corners,
            heights,
            leaf.may_fold(),
        );
        if parts.all.is_empty() {
            return None;
        }
        let quad = &self.of.quad(number);
        let ([u0, v0], [u1, v1]) = (quad.begin, quad.end);
        let uvs = [
            [[u0, v0], [u1, v0], [u0, v1]],
            [[u1, v1], [u0, v1], [u1, v0]],
        ];
        let mut t_max = self.t_max;
        let mut nearest: Option<Met> = None;
        while let Some((span, triangle)) = parts.next(t_max) {
            let (corners, uvs) = (of_half(&poles, *triangle), &uvs[*triangle]);
            let wall = |end: usize| self.wall((number, quad), (span, end), *triangle, uvs, t_max);
            let mut met = wall(0);
            // No closure: it would not be compiled for the instruction set.
            if met.is_none() {
                let begin = begin(span, corners, f64::from(self.t_min));
                let (curve, pieces) = Curve::new(span, *uvs, begin);
                met = self.curve(lanes, (number, quad), &poles, &curve, &pieces, t_max);
            }
            if let Some(met) = met.or_else(|| wall(1)) {
                t_max = met.t;
                nearest = Some(met);
            }
        }
        nearest
    }

    /// A hit where a ray passes the face's border between the heights of the face there and those of the edge.
    #[inline(always)]
    fn wall(
        &self,
        (number, quad): (u32, &Quad),
        (span, end): (&Span, usize),
        triangle: usize,
        uvs: &[[f64; 2]; 3],
        t_max: f32,
    ) -> Option<Met> {
        let border = self.of.border(quad, triangle, span.sides[end]?)?;
        let t = span.t[end] as f32;
        if !(t > self.t_min && t < t_max) {
            return None;
        }
        let weights = &span.weights[2 * end];
        let sum = weights[0] + weights[1] + weights[2];
        let uv = [0, 1].map(|axis| {
            let all = (0..3).map(|k| weights[k] * uvs[k][axis]).sum::<f64>();
            all / sum
        });
        let height = span.heights[end];
        let is_above = (self.of).is_wall(quad, border, uv, height, self.moment)?;
        Some(Met {
            t,
            quad: number,
            uv: uv.map(|x| x as f32),
            cell: [0, 1].map(|k| (quad.first[k] + uv[k] as u32).min(quad.last[k])),
            height: height as f32,
            wall: Some((border, is_above)),
        })
    }

    /// The first hit on a curve before `t_max`.
    #[inline(always)]
    fn curve<L: Lanes>(
        &self,
        lanes: L,
        (number, quad): (u32, &Quad),
        poles: &[Pole; 4],
        curve: &Curve,
        pieces: &ArrayVec<Piece, MOST_PIECES>,
        t_max: f32,
    ) -> Option<Met> {
        let sizes = quad.end[0].max(quad.end[1]) as f32;
        let (level, first) = Size::above(quad.first, quad.last);
        for piece in pieces {
            let lined = Lined::new(lanes, curve, *piece, quad);
            let mut waiting: ArrayVec<Node, MOST_WAITING> = ArrayVec::new();
            waiting.push(Node {
                level,
                first,
                from: piece.from,
                to: piece.to,
            });
            while let Some(node) = waiting.pop() {
                let parts = lined.children(lanes, &node);
                let ranges = self.ranges(lanes, quad, &node);
                let mut hits = lined.within(lanes, parts, ranges);
                if hits == 0 {
                    continue;
                }
                let mut from = [0.0; LANES];
                let mut to = [0.0; LANES];
                lanes.store(parts[0], &mut from);
                lanes.store(parts[1], &mut to);
                if node.level > 0 {
                    // The first one on top.
                    while hits != 0 {
                        let lane = (31 - hits.leading_zeros()) as usize;
                        hits &= !(1 << lane);
                        let child = lined.child(lane);
                        waiting.push(Node {
                            level: node.level - 1,
                            first: [
                                node.first[0] + (child[0] << (2 * node.level)),
                                node.first[1] + (child[1] << (2 * node.level)),
                            ],
                            from: from[lane],
                            to: to[lane],
                        });
                    }
                    continue;
                }
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize;
                    hits &= hits - 1;
                    let child = lined.child(lane);
                    let cell = [node.first[0] + child[0], node.first[1] + child[1]];
                    let heights = self.of.cell(quad, cell, self.moment);
                    let at = [lined.past_first(cell, 0), lined.past_first(cell, 1)];
                    let Some(s) = micro::first(curve, at, sizes, &heights, from[lane], to[lane])
                    else {
                        continue;
                    };
                    let uv = curve.uv(s);
                    let height = curve.height(s);
                    let t = along(poles, uv, quad, height);
                    if t >= t_max {
                        return None;
                    }
                    if t > self.t_min {
                        return Some(Met {
                            t,
                            quad: number,
                            uv,
                            cell,
                            height,
                            wall: None,
                        });
                    }
                }
            }
        }
        None
    }

    /// The least and greatest heights of a node's children.
    #[inline(always)]
    fn ranges<L: Lanes>(&self, lanes: L, quad: &Quad, node: &Node) -> [L::Floats; 2] {
        if node.level > 0 && !quad.size.keeps_ranges() {
            return [
                lanes.floats(f32::from(quad.low)),
                lanes.floats(f32::from(quad.high)),
            ];
        }
        let from = self.ranges_at(lanes, quad, node, self.moment.from);
        if !MOVES {
            return from;
        }
        let to = self.ranges_at(lanes, quad, node, self.moment.to);
        [
            self.moment.between_lanes(lanes, from[0], to[0]),
            self.moment.between_lanes(lanes, from[1], to[1]),
        ]
    }

    /// The same at a motion key.
    #[inline(always)]
    fn ranges_at<L: Lanes>(
        &self,
        lanes: L,
        quad: &Quad,
        node: &Node,
        key: usize,
    ) -> [L::Floats; 2] {
        if node.level > 0 {
            let place = quad.ranges + key * quad.count + quad.size.place(node.level, node.first);
            let ranges = &self.of.ranges[place];
            return [
                lanes.to_floats(lanes.shorts(&ranges.low)),
                lanes.to_floats(lanes.shorts(&ranges.high)),
            ];
        }
        let stride = quad.stride;
        let first = quad.heights + key * quad.in_face;
        let first = first + node.first[1] as usize * stride + node.first[0] as usize;
        let a = self.square(lanes, first, stride);
        let b = self.square(lanes, first + 1, stride);
        let c = self.square(lanes, first + stride, stride);
        let d = self.square(lanes, first + stride + 1, stride);
        [
            lanes.min(lanes.min(a, b), lanes.min(c, d)),
            lanes.max(lanes.max(a, b), lanes.max(c, d)),
        ]
    }

    /// Four heights of each of four rows.
    #[inline(always)]
    fn square<L: Lanes>(&self, lanes: L, first: usize, stride: usize) -> L::Floats {
        let rows = [
            first,
            first + stride,
            first + 2 * stride,
            first + 3 * stride,
        ];
        lanes.to_floats(lanes.fours(&self.of.heights, rows))
    }
}

/// Where on a span a ray begins that begins at `t_min`; not later, and 0 if that is before the span.
#[inline(always)]
fn begin(span: &Span, corners: [&Pole; 3], t_min: f64) -> f64 {
    if span.t[0] >= t_min {
        return 0.0;
    }
    // t times the denominator is a cubic that is as monotone as t is.
    let before = |s: f64| {
        let r = 1.0 - s;
        let [from, to] = span.heights;
        let height = from + s * (to - from);
        let w = &span.weights;
        let mut sum = 0.0;
        for k in 0..3 {
            let weight = r * (r * w[0][k] + 2.0 * s * w[1][k]) + s * s * w[2][k];
            sum += weight * (corners[k].t(height) - t_min);
        }
        sum
    };
    let (mut low, mut high) = (0.0, 1.0);
    let (mut below, mut above) = (before(0.0), before(1.0));
    for _ in 0..4 {
        if !(below < 0.0 && above > 0.0) {
            break;
        }
        let s = low + (high - low) * (below / (below - above)).clamp(0.02, 0.98);
        let value = before(s);
        if value < 0.0 {
            (low, below) = (s, value);
        } else {
            (high, above) = (s, value);
        }
    }
    low
}

/// `t` where the curve is over u and v at a height.
#[inline(always)]
fn along(poles: &[Pole; 4], uv: [f32; 2], quad: &Quad, height: f32) -> f32 {
    let weights = quad.weights(uv);
    let height = f64::from(height);
    let mut t = 0.0;
    for k in 0..4 {
        t += weights[k] * poles[k].t(height);
    }
    t as f32
}
