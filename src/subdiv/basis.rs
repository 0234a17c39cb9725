//! The polynomial patches that regular faces are: values and derivatives of their basis functions.
//!
//! ```text
//!   bicubic B-spline: 16 points           quartic box spline: 12 points
//!    12   13   14   15                              10 -- 11
//!        3-----2                                   /  \  /  \
//!     8  | 9  10|  11    v                        7 -- 8 -- 9          v
//!        |      |        |                       / \  /2\  / \        /
//!     4  | 5   6|   7    +-- u                  3 -- 4 -- 5 -- 6     +-- u
//!        0-----1                                 \ /0  \ /1  \ /
//!     0    1   2    3                             0 -- 1 -- 2
//! ```
//!
//! The face is the square 5 6 10 9, or the triangle 4 5 8, with its corners 0, 1, 2 (and 3) in this order.

use super::patch::Real;

/// The uniform cubic B-splines over their middle segment, with first and second derivatives.
#[inline(always)]
pub(super) fn cubic<T: Real>(t: f64) -> [[T; 4]; 3] {
    let [s, t] = [1.0 - t, t].map(T::of);
    let [half, one, two] = [0.5, 1.0, 2.0].map(T::of);
    let [sixth, middle, steep, three] = [1.0 / 6.0, 2.0 / 3.0, 1.5, 3.0].map(T::of);
    let (t2, s2) = (t * t, s * s);
    [
        [
            sixth * s2 * s,
            middle - half * t2 * (one + s),
            middle - half * s2 * (one + t),
            sixth * t2 * t,
        ],
        [
            T::of(-0.5) * s2,
            t * (steep * t - two),
            s * (two - steep * s),
            half * t2,
        ],
        [s, three * t - two, one - three * t, t],
    ]
}

/// The points beside the triangle's own three corners, in the order of [`box_spline`].
pub(super) const AROUND: [usize; 9] = [0, 1, 2, 3, 6, 7, 9, 10, 11];

/// The basis functions of the points [`AROUND`] the triangle, with their derivatives by u, v, uu, uv and vv. As the
/// twelve functions reproduce linear functions, those of the corners follow: the surface is the plane of its corners
/// plus what these nine add of the points' offsets from that plane.
///
/// With the barycentric coordinate w = 1 − u − v, six of them are x³ (x + 2 y) / 12 of two coordinates. Those of the
/// points opposite a corner are (s³ (2 − s) + 2 q (s² + q)) / 12 of the sum s and the product q of the coordinates of
/// the other two corners.
#[inline(always)]
pub(super) fn box_spline<T: Real>(u: f64, v: f64) -> [[T; 6]; 9] {
    // Rounded once each: next to an edge or a corner nothing cancels.
    let [from_u, from_v, s, w] = [1.0 - u, 1.0 - v, u + v, 1.0 - u - v].map(T::of);
    let [u, v] = [u, v].map(T::of);
    let [zero, half, two, three] = [0.0, 0.5, 2.0, 3.0].map(T::of);
    let [sixth, twelfth] = [1.0 / 6.0, 1.0 / 12.0].map(T::of);
    let minus = |x: T| zero - x;
    // x² / 6, x³ / 6 and x³ / 12.
    let powers = |x: T| [sixth * x * x, sixth * x * x * x, twelfth * x * x * x];
    let ([u2, u3, u3_half], [v2, v3, v3_half], [w2, _, w3_half]) =
        (powers(u), powers(v), powers(w));
    let [uw, vw] = [u * w, v * w];

    let third = T::of(1.0 / 3.0);
    // The function of s and q, its derivatives by s and q, and by s twice.
    let edge = |s: T, q: T| {
        let s2 = s * s;
        [
            twelfth * (s2 * s * (two - s) + two * q * (s2 + q)),
            sixth * s * (three * s - two * s2 + two * q),
            sixth * (s2 + two * q),
            s - s2 + third * q,
        ]
    };
    // Opposite the corner whose coordinate is 1 − s, if s has no derivative by y: then x is one of the coordinates
    // and w the other. The derivatives are by x, y, xx, xy and yy.
    let beside_w = |s: T, y: T| {
        let [value, by_s, by_q, by_ss] = edge(s, y * w);
        let across = w - y;
        [
            value,
            minus(by_s + y * by_q),
            across * by_q,
            by_ss + third * y * (two * s + y),
            minus(third * across * (s + y) + by_q),
            third * across * across - two * by_q,
        ]
    };
    let [p1, v1, u1, vv1, uv1, uu1] = beside_w(from_v, u);
    let [p9, by_s, by_q, by_ss] = edge(s, u * v);
    [
        [
            w3_half * (w + two * u),
            minus(w2 * (w + three * u)),
            minus(w2 * (two * w + three * u)),
            uw,
            half * w * (w + two * u),
            w * (w + u),
        ],
        [p1, u1, v1, uu1, uv1, vv1],
        [
            u3_half * (u + two * w),
            u2 * (u + three * w),
            minus(u3),
            uw,
            minus(three * u2),
            zero,
        ],
        [
            w3_half * (w + two * v),
            minus(w2 * (two * w + three * v)),
            minus(w2 * (w + three * v)),
            w * (w + v),
            half * w * (w + two * v),
            vw,
        ],
        [
            u3_half * (u + two * v),
            u2 * (two * u + three * v),
            u3,
            u * s,
            three * u2,
            zero,
        ],
        beside_w(from_u, v),
        [
            p9,
            by_s + v * by_q,
            by_s + u * by_q,
            by_ss + third * v * (two * s + v),
            by_ss + third * (s * s + u * v) + by_q,
            by_ss + third * u * (two * s + u),
        ],
        [
            v3_half * (v + two * w),
            minus(v3),
            v2 * (v + three * w),
            zero,
            minus(three * v2),
            vw,
        ],
        [
            v3_half * (v + two * u),
            v3,
            v2 * (two * v + three * u),
            zero,
            three * v2,
            v * s,
        ],
    ]
}

/// Weights of all points of a bicubic patch for the position.
pub(super) fn bicubic_weights(u: f64, v: f64) -> [f64; 16] {
    let ([bu, ..], [bv, ..]) = (cubic::<f64>(u), cubic::<f64>(v));
    std::array::from_fn(|i| bu[i % 4] * bv[i / 4])
}

/// Weights of all points of a quartic box spline patch for the position.
pub(super) fn box_spline_weights(u: f64, v: f64) -> [f64; 12] {
    let mut out = [0.0; 12];
    [out[4], out[5], out[8]] = [1.0 - u - v, u, v];
    for (slot, [weight, ..]) in AROUND.into_iter().zip(box_spline::<f64>(u, v)) {
        // The point's own coordinates: minus what the corners would make there.
        let [x, y] = LATTICE[slot];
        out[slot] = weight;
        out[4] -= weight * (1.0 - x - y);
        out[5] -= weight * x;
        out[8] -= weight * y;
    }
    out
}

/// Where the points of a regular box spline patch lie, in its parameters.
pub(super) const LATTICE: [[f64; 2]; 12] = [
    [0.0, -1.0],
    [1.0, -1.0],
    [2.0, -1.0],
    [-1.0, 0.0],
    [0.0, 0.0],
    [1.0, 0.0],
    [2.0, 0.0],
    [-1.0, 1.0],
    [0.0, 1.0],
    [1.0, 1.0],
    [-1.0, 2.0],
    [0.0, 2.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// A term c·uᵃ·vᵇ·wᶜ with w = 1 − u − v.
    type Term = (f64, [i32; 3]);

    /// The basis functions times 12 as homogeneous quartics in u, v and w: what Loop's rules make of one point of a regular
    /// lattice, interpolated exactly at fifteen limit points. (Stam, *Evaluation of Loop Subdivision Surfaces*, 1998,
    /// tabulates them with other corners.)
    #[rustfmt::skip]
    const BOX_SPLINE: [&[Term]; 12] = [
        &[(1.0, [0, 0, 4]), (2.0, [1, 0, 3])],
        &[(1.0, [0, 0, 4]), (2.0, [0, 1, 3]), (6.0, [1, 0, 3]), (6.0, [1, 1, 2]), (12.0, [2, 0, 2]), (6.0, [2, 1, 1]),
          (6.0, [3, 0, 1]), (2.0, [3, 1, 0]), (1.0, [4, 0, 0])],
        &[(2.0, [3, 0, 1]), (1.0, [4, 0, 0])],
        &[(1.0, [0, 0, 4]), (2.0, [0, 1, 3])],
        &[(6.0, [0, 0, 4]), (24.0, [0, 1, 3]), (24.0, [0, 2, 2]), (8.0, [0, 3, 1]), (1.0, [0, 4, 0]), (24.0, [1, 0, 3]),
          (60.0, [1, 1, 2]), (36.0, [1, 2, 1]), (6.0, [1, 3, 0]), (24.0, [2, 0, 2]), (36.0, [2, 1, 1]), (12.0, [2, 2, 0]),
          (8.0, [3, 0, 1]), (6.0, [3, 1, 0]), (1.0, [4, 0, 0])],
        &[(1.0, [0, 0, 4]), (6.0, [0, 1, 3]), (12.0, [0, 2, 2]), (6.0, [0, 3, 1]), (1.0, [0, 4, 0]), (8.0, [1, 0, 3]),
          (36.0, [1, 1, 2]), (36.0, [1, 2, 1]), (8.0, [1, 3, 0]), (24.0, [2, 0, 2]), (60.0, [2, 1, 1]), (24.0, [2, 2, 0]),
          (24.0, [3, 0, 1]), (24.0, [3, 1, 0]), (6.0, [4, 0, 0])],
        &[(2.0, [3, 1, 0]), (1.0, [4, 0, 0])],
        &[(1.0, [0, 0, 4]), (6.0, [0, 1, 3]), (12.0, [0, 2, 2]), (6.0, [0, 3, 1]), (1.0, [0, 4, 0]), (2.0, [1, 0, 3]),
          (6.0, [1, 1, 2]), (6.0, [1, 2, 1]), (2.0, [1, 3, 0])],
        &[(1.0, [0, 0, 4]), (8.0, [0, 1, 3]), (24.0, [0, 2, 2]), (24.0, [0, 3, 1]), (6.0, [0, 4, 0]), (6.0, [1, 0, 3]),
          (36.0, [1, 1, 2]), (60.0, [1, 2, 1]), (24.0, [1, 3, 0]), (12.0, [2, 0, 2]), (36.0, [2, 1, 1]), (24.0, [2, 2, 0]),
          (6.0, [3, 0, 1]), (8.0, [3, 1, 0]), (1.0, [4, 0, 0])],
        &[(2.0, [0, 3, 1]), (1.0, [0, 4, 0]), (6.0, [1, 2, 1]), (6.0, [1, 3, 0]), (6.0, [2, 1, 1]), (12.0, [2, 2, 0]),
          (2.0, [3, 0, 1]), (6.0, [3, 1, 0]), (1.0, [4, 0, 0])],
        &[(2.0, [0, 3, 1]), (1.0, [0, 4, 0])],
        &[(1.0, [0, 4, 0]), (2.0, [1, 3, 0])],
    ];

    /// The function of a point and its derivatives by u, v, uu, uv and vv, by the table.
    fn tabulated(slot: usize, u: f64, v: f64) -> [f64; 6] {
        // Coefficients of a polynomial with their powers, derived term by term; w' = −1.
        let derive = |terms: &[Term], axis: usize| -> Vec<Term> {
            terms
                .iter()
                .flat_map(|&(c, powers)| {
                    [(axis, 1.0), (2, -1.0)].map(|(i, sign)| {
                        let mut lower = powers;
                        lower[i] -= 1;
                        (c * sign * f64::from(powers[i]), lower)
                    })
                })
                .filter(|&(c, _)| c != 0.0)
                .collect()
        };
        let value = |terms: &[Term]| -> f64 {
            let at = [u, v, 1.0 - u - v];
            let term =
                |&(c, powers): &Term| c * (0..3).map(|i| at[i].powi(powers[i])).product::<f64>();
            terms.iter().map(term).sum::<f64>() / 12.0
        };
        let p = BOX_SPLINE[slot];
        let (du, dv) = (derive(p, 0), derive(p, 1));
        let second = [derive(&du, 0), derive(&du, 1), derive(&dv, 1)];
        let [uu, uv, vv] = second.map(|terms| value(&terms));
        [value(p), value(&du), value(&dv), uu, uv, vv]
    }

    const PLACES: [[f64; 2]; 7] = [
        [0.0, 0.0],
        [1.0, 0.0],
        [0.0, 1.0],
        [0.5, 0.5],
        [0.2, 0.3],
        [0.7, 0.1],
        [0.05, 0.9],
    ];

    #[test]
    fn closed_forms_are_the_functions_of_the_table() {
        for [u, v] in PLACES {
            for (slot, found) in AROUND.into_iter().zip(box_spline::<f64>(u, v)) {
                let expected = tabulated(slot, u, v);
                for i in 0..6 {
                    let off = (found[i] - expected[i]).abs();
                    assert!(off < 1e-14, "{slot} {i} at {u} {v}: {found:?} {expected:?}");
                }
            }
            for (slot, weight) in box_spline_weights(u, v).into_iter().enumerate() {
                let expected = tabulated(slot, u, v)[0];
                assert!((weight - expected).abs() < 1e-14, "{slot} at {u} {v}");
            }
        }
    }

    #[test]
    fn cubic_derivatives_are_those_of_the_values() {
        const STEP: f64 = 1e-5;
        for t in [0.1, 0.5, 0.8] {
            let [low, at, high] = [t - STEP, t, t + STEP].map(cubic::<f64>);
            for i in 0..4 {
                for order in 0..2 {
                    let slope = (high[order][i] - low[order][i]) / (2.0 * STEP);
                    assert!(
                        (slope - at[order + 1][i]).abs() < 1e-9,
                        "{i} {order} at {t}"
                    );
                }
            }
            assert!((at[0].iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }
}
