//! Where a ray is within the prisms over a base quad: between its corners' lines, over one of its two triangles.
//!
//! The space is sheared along the ray, which then is a point, zero (Woop, Benthin, Wald, "Watertight Ray/Triangle
//! Intersection", 2013). A corner's line is `a + h n` there, two coordinates and `t`. At height h the ray is in a triangle of
//! corners i, j, k if
//!
//! ```text
//!   U_k(h) = (a_i + h n_i) × (a_j + h n_j)
//! ```
//!
//! and its two sisters have one sign: they are quadratics of h, their shares of the sum d(h) are the weights of the corners,
//! and their sum, d, is the denominator that all coordinates of the ray share. In the neighbour across the side U is the same
//! numbers, negated to the bit, so its roots are the same: where a ray leaves a prism, there it enters the next.
//!
//! Single precision for what is given, double for the rest: this is done once for a ray and a quad. A triangle that the ray
//! runs along has no d; the ray is turned by a few billionths of a right angle, so that none runs along the axes and planes
//! that scenes are made of.

mod cross;
mod fold;
mod lifted;

use arrayvec::ArrayVec;

use super::moment::Moment;
use crate::math::{DVec3, Ray, Vec3};
pub(in crate::accel) use cross::cross;
pub(in crate::accel) use fold::may_fold;
use fold::unfold;
pub(in crate::accel) use lifted::{Corners, Lifted};

/// A ray that is a point.
#[derive(Debug, Clone, Copy)]
pub(in crate::accel) struct Sheared {
    origin: DVec3,
    /// The third axis is the one along which the ray runs most.
    axes: [usize; 3],
    /// How far it goes along the other two meanwhile.
    shear: [f64; 2],
    /// `t` for a step along the third axis.
    per_step: f64,
}

/// A corner's line, as far as it goes along the ray.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::accel) struct Pole {
    /// `t` at height 0, and for a step of height.
    foot: f64,
    rise: f64,
}

/// A part of a ray within a triangle's prism, from one end to the other: `t` is less there, and grows unless the prism folds.
#[derive(Debug, Clone, Copy)]
pub(in crate::accel) struct Span {
    /// Heights of the ends.
    pub(in crate::accel) heights: [f64; 2],
    /// d and the weights of the three corners times d, as Bernstein coefficients from one end to the other; d is positive at
    /// both.
    pub(in crate::accel) weights: [[f64; 3]; 3],
    /// `t` at the ends.
    pub(in crate::accel) t: [f64; 2],
    /// The side that an end is on, if it is on one: the corner opposite.
    pub(in crate::accel) sides: [Option<usize>; 2],
}

/// By how much a ray is turned, and whereto.
const TURN: f64 = 1.0 / (1_u64 << 30) as f64;
const ASIDE: DVec3 = DVec3::new(0.374_911_8, 0.618_433_7, 0.690_583_1);

impl Sheared {
    #[inline(always)]
    pub(in crate::accel) fn new(ray: &Ray) -> Self {
        let d = ray.direction.as_dvec3();
        let d = d + TURN * d.abs().max_element() * ASIDE;
        let z = d.abs().max_position();
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let per_step = 1.0 / d[z];
        Self {
            origin: ray.origin.as_dvec3(),
            axes,
            shear: [d[axes[0]] * per_step, d[axes[1]] * per_step],
            per_step,
        }
    }
}

impl Pole {
    /// `t` of the point at a height.
    #[inline(always)]
    pub(in crate::accel) fn t(&self, height: f64) -> f64 {
        self.foot + height * self.rise
    }
}

/// The corners of a quad's triangles: at the least u and v, the greater u, the greater v, both.
pub(in crate::accel) const HALVES: [[usize; 3]; 2] = [[0, 1, 2], [3, 2, 1]];

/// What the corners of one of a quad's triangles have.
#[inline(always)]
pub(in crate::accel) fn of_half<T>(corners: &[T; 4], half: usize) -> [&T; 3] {
    let [a, b, c] = HALVES[half];
    [&corners[a], &corners[b], &corners[c]]
}

/// The lines of a quad's corners at a moment: points, and what a step of height adds. `all` are those of the surface, key by key.
#[inline(always)]
pub(in crate::accel) fn corners_at(
    all: &[[Vec3; 2]],
    [a, b, c, d]: [usize; 4],
    keys: u32,
    moment: &Moment,
) -> [[DVec3; 2]; 4] {
    let of_key = all.len() / keys as usize;
    [
        corner_at(all, a, of_key, moment),
        corner_at(all, b, of_key, moment),
        corner_at(all, c, of_key, moment),
        corner_at(all, d, of_key, moment),
    ]
}

#[inline(always)]
fn corner_at(all: &[[Vec3; 2]], number: usize, of_key: usize, moment: &Moment) -> [DVec3; 2] {
    let [p, n] = &all[number + moment.from * of_key];
    let from = [p.as_dvec3(), n.as_dvec3()];
    if moment.from == moment.to {
        return from;
    }
    let [p, n] = &all[number + moment.to * of_key];
    let [a, b] = [f64::from(moment.weights[0]), f64::from(moment.weights[1])];
    [
        a * from[0] + b * p.as_dvec3(),
        a * from[1] + b * n.as_dvec3(),
    ]
}

/// The most parts of a ray in one prism: three quadratics cut it six times.
const MOST_SPANS: usize = 7;

/// The most parts of a ray over a quad: `t` turns four times in each of them at most.
const MOST_PARTS: usize = 2 * MOST_SPANS * 5;

/// The parts of a ray in the prisms over a quad that are within the interval that is asked about.
pub(in crate::accel) struct Parts {
    /// With the number of the triangle.
    pub(in crate::accel) all: ArrayVec<(Span, usize), MOST_PARTS>,
    /// Where each begins; infinity once it was given.
    near: ArrayVec<f64, MOST_PARTS>,
    t: [f64; 2],
}

impl Parts {
    #[inline(always)]
    pub(in crate::accel) fn new(t: [f32; 2]) -> Self {
        Self {
            all: ArrayVec::new(),
            near: ArrayVec::new(),
            t: t.map(f64::from),
        }
    }

    #[inline(always)]
    pub(in crate::accel) fn add(&mut self, span: Span, triangle: usize) {
        if span.t[1] >= self.t[0] && span.t[0] <= self.t[1] {
            self.near.push(span.t[0]);
            self.all.push((span, triangle));
        }
    }

    /// The nearest of those that were not given yet, if it begins by `t_max`.
    #[inline(always)]
    pub(in crate::accel) fn next(&mut self, t_max: f32) -> Option<&(Span, usize)> {
        let mut nearest = (f64::INFINITY, 0);
        for (k, &near) in self.near.iter().enumerate() {
            if near < nearest.0 {
                nearest = (near, k);
            }
        }
        let (near, k) = nearest;
        if near == f64::INFINITY || near > f64::from(t_max) {
            return None;
        }
        self.near[k] = f64::INFINITY;
        Some(&self.all[k])
    }
}

impl Span {
    /// From the nearer end to the farther one.
    #[inline(always)]
    fn onward(mut self) -> Self {
        if self.t[1] < self.t[0] {
            self.sides.swap(0, 1);
            self.heights.swap(0, 1);
            self.t.swap(0, 1);
            self.weights.swap(0, 2);
        }
        self
    }

    /// The part of it between two places, 0..1 each.
    pub(in crate::accel) fn part(&self, [from, to]: [f64; 2], corners: [&Pole; 3]) -> Option<Self> {
        let [w0, w1, w2] = &self.weights;
        let weights = [[from, from], [from, to], [to, to]].map(|[x, y]| {
            [0, 1, 2].map(|k| {
                let first = w0[k] + x * (w1[k] - w0[k]);
                let second = w1[k] + x * (w2[k] - w1[k]);
                first + y * (second - first)
            })
        });
        let height = |x: f64| self.heights[0] + x * (self.heights[1] - self.heights[0]);
        let mut part = Self {
            heights: [height(from), height(to)],
            weights,
            t: self.t,
            sides: [None; 2],
        };
        for (e, place) in [from, to].into_iter().enumerate() {
            if place == e as f64 {
                // The same to the bit, as in the next prism.
                part.heights[e] = self.heights[e];
                part.weights[2 * e] = self.weights[2 * e];
                part.sides[e] = self.sides[e];
                continue;
            }
            let weights = &part.weights[2 * e];
            let sum = weights[0] + weights[1] + weights[2];
            if sum.is_nan() || sum <= 0.0 {
                return None;
            }
            let along = (0..3).map(|k| weights[k] * corners[k].t(part.heights[e]));
            part.t[e] = along.sum::<f64>() / sum;
        }
        Some(part.onward())
    }
}
