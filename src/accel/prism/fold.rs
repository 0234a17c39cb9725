//! Prisms that fold over: where corners' lines lean apart or cross, a point of space may be at more than one height.
//!
//! A ray is a curve in the prism's space, and as long as the prism has one orientation, that is as its Jacobian
//!
//! ```text
//!   J(h) = det(E1(h), E2(h), N)     E1, E2: sides of the triangle at height h, N: what a step of height adds
//! ```
//!
//! has one sign, `t` grows along it from end to end. Where J is zero the prism folds, and there `t` turns: of two hits on the
//! curve that which comes first need not be the nearer one. So it is cut there. The paper does not do this: it says of shells
//! that intersect themselves that they are traced, not that their hits are in order.
//!
//! J is a quadratic of h and linear over the triangle: nine coefficients tell of a prism that it does not fold, which is kept
//! as a bit of the quad. In others the places where `t` turns are roots of a quartic.

use arrayvec::ArrayVec;

use super::{Pole, Span};
use crate::math::{DVec3, quadratic};

/// Whether a prism over three corners may fold between two heights.
pub(in crate::accel) fn may_fold(corners: [[DVec3; 2]; 3], [low, high]: [f64; 2]) -> bool {
    let side = |k: usize, height: f64| {
        let [from, to] = [&corners[0], &corners[k]];
        (to[0] - from[0]) + height * (to[1] - from[1])
    };
    let ([a0, b0], [a1, b1]) = ([side(1, low), side(2, low)], [side(1, high), side(2, high)]);
    let areas = [
        a0.cross(b0),
        0.5 * (a0.cross(b1) + a1.cross(b0)),
        a1.cross(b1),
    ];
    let all = || {
        let of = |area: DVec3| corners.map(|[_, n]| area.dot(n));
        areas.into_iter().flat_map(of)
    };
    let most = all().fold(0.0_f64, |most, j| most.max(j.abs()));
    let least = 1e-9 * most;
    !(all().all(|j| j > least) || all().all(|j| j < -least))
}

/// A quartic by its coefficients, that of the constant first.
type Quartic = [f64; 5];

/// The derivative of `t` along a span whose prism folds, from 0 to 1, times the denominator squared; none if it has one sign.
fn derivative(span: &Span, corners: [&Pole; 3]) -> Option<Quartic> {
    let [w0, w1, w2] = &span.weights;
    let sum = |w: &[f64; 3]| w[0] + w[1] + w[2];
    let d = [sum(w0), sum(w1), sum(w2)];
    // t from the beginning on, times d, in Bernstein coefficients, the first of which is 0.
    let mut n = [0.0; 4];
    for k in 0..3 {
        let [from, to] = span.heights.map(|h| corners[k].t(h) - span.t[0]);
        n[1] += (w0[k] * to + 2.0 * w1[k] * from) / 3.0;
        n[2] += (2.0 * w1[k] * to + w2[k] * from) / 3.0;
        n[3] += w2[k] * to;
    }
    let by_n = [n[1], n[2] - n[1], n[3] - n[2]].map(|x| 3.0 * x);
    let by_d = [d[1] - d[0], d[2] - d[1]].map(|x| 2.0 * x);
    let [e, g] = [by_n, d];
    let [p, q] = by_d;
    let c = [
        e[0] * g[0],
        0.5 * (e[0] * g[1] + e[1] * g[0]) - 0.75 * n[1] * p,
        (e[0] * g[2] + 4.0 * e[1] * g[1] + e[2] * g[0]) / 6.0 - 0.5 * (n[2] * p + n[1] * q),
        0.5 * (e[1] * g[2] + e[2] * g[1]) - 0.25 * (n[3] * p + 3.0 * n[2] * q),
        e[2] * g[2] - n[3] * q,
    ];
    if c.iter().all(|&x| x >= 0.0) {
        return None;
    }
    let [c0, c1, c2, c3, c4] = c;
    Some([
        c0,
        4.0 * (c1 - c0),
        6.0 * (c2 - 2.0 * c1 + c0),
        4.0 * (c3 - 3.0 * (c2 - c1) - c0),
        c4 - 4.0 * (c3 + c1) + 6.0 * c2 + c0,
    ])
}

/// Steps of a bisection: where `t` turns it hardly changes.
const STEPS: usize = 40;

/// The roots of a polynomial between 0 and 1, given those of its derivative there.
fn roots<const N: usize>(polynomial: [f64; N], turns: &[f64]) -> ArrayVec<f64, 4> {
    let value = |x: f64| polynomial.iter().rfold(0.0, |sum, c| c + x * sum);
    let mut found = ArrayVec::new();
    let mut low = 0.0;
    for &high in turns.iter().chain([&1.0]) {
        let is_below = value(low) < 0.0;
        if is_below != (value(high) < 0.0) {
            let (mut a, mut b) = (low, high);
            for _ in 0..STEPS {
                let middle = 0.5 * (a + b);
                if (value(middle) < 0.0) == is_below {
                    a = middle;
                } else {
                    b = middle;
                }
            }
            found.push(b);
        }
        low = high;
    }
    found
}

/// The parts of a span of a prism that folds in which `t` grows, or falls: each from its nearer end to the farther one.
pub(in crate::accel) fn unfold(span: &Span, corners: [&Pole; 3], mut parts: impl FnMut(Span)) {
    let Some(quartic) = derivative(span, corners) else {
        return parts(*span);
    };
    let [_, b, c, d, e] = quartic;
    let cubic = [b, 2.0 * c, 3.0 * d, 4.0 * e];
    let mut turns: ArrayVec<f64, 2> = quadratic(3.0 * cubic[3], 2.0 * cubic[2], cubic[1])
        .into_iter()
        .flatten()
        .filter(|&x| x > 0.0 && x < 1.0)
        .collect();
    turns.sort_unstable_by(f64::total_cmp);
    let turns = roots(cubic, &turns);
    let mut from = 0.0;
    for to in roots(quartic, &turns).into_iter().chain([1.0]) {
        if to > from {
            if let Some(part) = span.part([from, to], corners) {
                parts(part);
            }
            from = to;
        }
    }
}
