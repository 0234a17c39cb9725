//! B-spline and Bernstein basis functions with their derivatives, as weights of control points.
//!
//! Span search is algorithm A2.1 of Piegl and Tiller, *The NURBS Book* (2nd edition, 1997, section 2.5). For the
//! functions (A2.2) and derivatives (A2.3) we go by the polar form of Ramshaw (1987, *Blossoming: a connect-the-dots
//! approach to splines*): a polynomial of degree p is the symmetric p-affine map f with f(t, ..., t) as its value.
//! De Boor's triangle evaluates f at any p arguments; run backwards it gives the weight of each control point.
//! Departing from the book, one routine serves all:
//!
//! - equal arguments: the basis functions, sum for sum as in A2.2;
//! - a step of one unit in place of an argument: a derivative, divided by the degree;
//! - arguments at both ends of a span: Bezier points, and at other knots: knot insertion (section 5.2).
//!
//! Arguments within the span give weights that are at least 0, so every result lies in the hull of the points.

use crate::mesh::MAX_ORDER;

/// Weights of `order` control points in a row, 0 beyond.
pub type Weights = [f64; MAX_ORDER];

/// Number of the knot below `t`: `knots[span] <= t < knots[span + 1]`, and the last such span at the end of the
/// domain. A `t` outside of the domain has the span at that end.
pub fn span(knots: &[f64], order: usize, t: f64) -> usize {
    let count = knots.len() - order;
    let inner = &knots[order..count];
    // Knots that equal the domain's end open no span.
    let last = inner.partition_point(|&k| k < knots[count]);
    order - 1 + inner[..last].partition_point(|&k| k <= t)
}

/// Weights of the polar form on a span: `arguments`, and then steps of one unit up to the degree. The weights are
/// those of control points `span - degree ..= span`.
///
/// With k steps the result is the k-th derivative divided by degree (degree - 1) ... (degree - k + 1).
///
/// # Panics
/// If there are more arguments than the degree, or the span has no extent.
pub fn polar(knots: &[f64], order: usize, span: usize, arguments: &[f64], out: &mut Weights) {
    let degree = order - 1;
    assert!(arguments.len() <= degree && knots[span] < knots[span + 1]);
    out.fill(0.0);
    out[degree] = 1.0;
    for level in (1..=degree).rev() {
        // What level `level` takes from point j of the level below: its left parent j - 1 and its right parent j.
        for m in level..=degree {
            let j = span + m - degree;
            let (low, high) = (knots[j], knots[j + degree - level + 1]);
            let weight = out[m];
            let (left, right) = match arguments.get(level - 1) {
                Some(t) => ((high - t) / (high - low), (t - low) / (high - low)),
                None => (-1.0 / (high - low), 1.0 / (high - low)),
            };
            // `out[m - 1]` holds its own right part by now.
            out[m - 1] += weight * left;
            out[m] = weight * right;
        }
    }
}

/// The basis functions at `t` and their first and second derivatives, for the control points up to `span`.
pub fn functions(knots: &[f64], order: usize, span: usize, t: f64) -> [Weights; 3] {
    let degree = order - 1;
    let arguments = [t; MAX_ORDER];
    let mut out = [[0.0; MAX_ORDER]; 3];
    let mut factor = 1.0;
    for (steps, weights) in out.iter_mut().enumerate().take(order) {
        polar(knots, order, span, &arguments[..degree - steps], weights);
        weights.iter_mut().for_each(|w| *w *= factor);
        factor *= (degree - steps) as f64;
    }
    out
}

/// Control points of the same function on finer knots: for each, the first of `order` old control points and their
/// weights. `finer` must hold all knots of `knots`, each at least as often.
pub fn refined(knots: &[f64], order: usize, finer: &[f64]) -> Vec<(usize, Weights)> {
    (0..finer.len() - order)
        .map(|i| {
            // Any span in the new point's support that is one of the old ones will do.
            let t = finer[i..i + order]
                .iter()
                .zip(&finer[i + 1..])
                .find(|(a, b)| a < b)
                .map_or(finer[i], |(a, _)| *a);
            let span = span(knots, order, t);
            let mut weights = [0.0; MAX_ORDER];
            polar(knots, order, span, &finer[i + 1..i + order], &mut weights);
            (span + 1 - order, weights)
        })
        .collect()
}

/// The Bernstein polynomials of a degree below `N` at `t` and their first and second derivatives.
///
/// Exact at both ends: one function is 1 there and the others 0.
pub fn bernstein<const N: usize>(degree: usize, t: f64) -> [[f64; N]; 3] {
    let s = 1.0 - t;
    let mut out = [[0.0; N]; 3];
    // The polynomials of degree n by de Casteljau's triangle; two and one levels before the last are kept for the
    // derivatives, which are differences of them.
    let mut b = [0.0; N];
    b[0] = 1.0;
    for n in 0..=degree {
        if n + 2 == degree {
            out[2] = b;
        }
        if n + 1 == degree {
            out[1] = b;
        }
        if n == degree {
            break;
        }
        for k in (0..=n).rev() {
            b[k + 1] += t * b[k];
            b[k] *= s;
        }
    }
    out[0] = b;
    let difference = |b: &mut [f64; N], from: usize| {
        for k in (0..=from).rev() {
            b[k + 1] += b[k] * (from + 1) as f64;
            b[k] *= -((from + 1) as f64);
        }
    };
    if degree >= 2 {
        difference(&mut out[2], degree - 2);
        difference(&mut out[2], degree - 1);
    }
    if degree >= 1 {
        difference(&mut out[1], degree - 1);
    }
    out
}
