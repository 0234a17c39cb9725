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

/// The basis functions of a quartic box spline patch, with derivatives by u, v, uu, uv and vv. As they reproduce linear
/// functions, those of the corners follow from the others: the surface is the plane of its corners plus what the nine
/// points around them add of their offsets from that plane.
///
/// Let w be the barycentric coordinate 1 − u − v. The two points in line with a corner's edges, such as 0 and 3 at
/// corner 0 where w is 1, have w³ (w + 2 u) / 12 and w³ (w + 2 v) / 12. Together that is w³ / 6: the first point's offset
/// counts by this, and by how much the second's differs from it by the second's function. The points opposite a corner
/// have (s³ (2 − s) + 2 q (s² + q)) / 12 of the sum s and the product q of the other two corners' coordinates.
pub(super) struct BoxSpline<T> {
    /// x³ / 6, x² / 2 and x of the coordinates w, u and v: for the offsets of points 0, 2 and 10.
    pub(super) cubes: [[T; 3]; 3],
    /// For the offset of point 3 less that of point 0.
    pub(super) turn_w: [T; 6],
    /// For the offset of point 6 less that of point 2; without vv, which is 0.
    pub(super) turn_u: [T; 5],
    /// For the offset of point 11 less that of point 10, by v and u instead of u and v; without uu, which is 0.
    pub(super) turn_v: [T; 5],
    /// For the offsets of points 1, 7 and 9, opposite the corners.
    pub(super) opposite: [[T; 6]; 3],
}

impl<T: Real> BoxSpline<T> {
    /// The functions at (u, v).
    #[inline(always)]
    pub(super) fn at(u: f64, v: f64) -> Self {
        // Rounded once each: next to an edge or a corner nothing cancels.
        let [from_u, from_v, s, w] = [1.0 - u, 1.0 - v, u + v, 1.0 - u - v].map(T::of);
        let [u, v] = [u, v].map(T::of);
        let [zero, half, two, three] = [0.0, 0.5, 2.0, 3.0].map(T::of);
        let [third, sixth, twelfth] = [1.0 / 3.0, 1.0 / 6.0, 1.0 / 12.0].map(T::of);
        let minus = |x: T| zero - x;
        let cubes = [w, u, v].map(|x| [sixth * x * x * x, half * x * x, x]);
        // At the corner of x, of the point towards y; by x and y.
        let turn = |[cube, square, x]: [T; 3], y: T| {
            [
                half * cube * (x + two * y),
                square * (two * third * x + y),
                cube,
                x * (x + y),
                square,
            ]
        };
        let w2 = sixth * w * w;
        let turn_w = [
            half * cubes[0][0] * (w + two * v),
            minus(w2 * (two * w + three * v)),
            minus(w2 * (w + three * v)),
            w * (w + v),
            half * w * (w + two * v),
            v * w,
        ];
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
        Self {
            cubes,
            turn_w,
            turn_u: turn(cubes[1], v),
            turn_v: turn(cubes[2], u),
            opposite: [
                [p1, u1, v1, uu1, uv1, vv1],
                beside_w(from_u, v),
                [
                    p9,
                    by_s + v * by_q,
                    by_s + u * by_q,
                    by_ss + third * v * (two * s + v),
                    by_ss + third * (s * s + u * v) + by_q,
                    by_ss + third * u * (two * s + u),
                ],
            ],
        }
    }
}

/// Weights of all points of a bicubic patch for the position.
pub(super) fn bicubic_weights(u: f64, v: f64) -> [f64; 16] {
    let ([bu, ..], [bv, ..]) = (cubic::<f64>(u), cubic::<f64>(v));
    std::array::from_fn(|i| bu[i % 4] * bv[i / 4])
}

/// Weights of all points of a quartic box spline patch for the position.
pub(super) fn box_spline_weights(u: f64, v: f64) -> [f64; 12] {
    let at = BoxSpline::<f64>::at(u, v);
    let mut out = [0.0; 12];
    let turns = [at.turn_w[0], at.turn_u[0], at.turn_v[0]];
    for (([first, second], cube), turn) in [[0, 3], [2, 6], [10, 11]]
        .into_iter()
        .zip(at.cubes)
        .zip(turns)
    {
        out[first] = cube[0] - turn;
        out[second] = turn;
    }
    for (slot, weights) in [1, 7, 9].into_iter().zip(at.opposite) {
        out[slot] = weights[0];
    }
    // The corners': what the plane has, minus what they would make at the other points.
    let mut corners = [1.0 - u - v, u, v];
    for (weight, [x, y]) in out.into_iter().zip(LATTICE) {
        corners[0] -= weight * (1.0 - x - y);
        corners[1] -= weight * x;
        corners[2] -= weight * y;
    }
    [out[4], out[5], out[8]] = corners;
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
            let at = BoxSpline::<f64>::at(u, v);
            let [w2, u2, v2] = at.cubes;
            let [p, d, s] = w2;
            let cube_w = [p, -d, -d, s, s, s];
            let cube_u = [u2[0], u2[1], 0.0, u2[2], 0.0, 0.0];
            let cube_v = [v2[0], 0.0, v2[1], 0.0, 0.0, v2[2]];
            let [p, du, dv, duu, duv] = at.turn_u;
            let turn_u = [p, du, dv, duu, duv, 0.0];
            let [p, dv, du, dvv, duv] = at.turn_v;
            let turn_v = [p, du, dv, 0.0, duv, dvv];
            let less = |a: [f64; 6], b: [f64; 6]| std::array::from_fn(|i| a[i] - b[i]);
            for (slot, found) in [
                (0, less(cube_w, at.turn_w)),
                (3, at.turn_w),
                (2, less(cube_u, turn_u)),
                (6, turn_u),
                (10, less(cube_v, turn_v)),
                (11, turn_v),
                (1, at.opposite[0]),
                (7, at.opposite[1]),
                (9, at.opposite[2]),
            ] {
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
