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

/// Weights of a patch's points for the position and for each derivative, in the patch's own parameters.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    pub(super) p: [f64; 16],
    pub(super) u: [f64; 16],
    pub(super) v: [f64; 16],
    pub(super) uu: [f64; 16],
    pub(super) uv: [f64; 16],
    pub(super) vv: [f64; 16],
}

impl Weights {
    const ZERO: Self = Self {
        p: [0.0; 16],
        u: [0.0; 16],
        v: [0.0; 16],
        uu: [0.0; 16],
        uv: [0.0; 16],
        vv: [0.0; 16],
    };
}

/// The uniform cubic B-splines over their middle segment, with first and second derivatives.
pub(super) fn cubic(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    [
        [
            s2 * s / 6.0,
            (4.0 - 3.0 * t2 * (1.0 + s)) / 6.0,
            (4.0 - 3.0 * s2 * (1.0 + t)) / 6.0,
            t2 * t / 6.0,
        ],
        [
            -0.5 * s2,
            t * (1.5 * t - 2.0),
            s * (2.0 - 1.5 * s),
            0.5 * t2,
        ],
        [s, 3.0 * t - 2.0, 1.0 - 3.0 * t, t],
    ]
}

/// Weights of a bicubic B-spline patch.
pub(super) fn bicubic(u: f64, v: f64) -> Weights {
    let [bu, du, duu] = cubic(u);
    let [bv, dv, dvv] = cubic(v);
    let mut w = Weights::ZERO;
    for j in 0..4 {
        for i in 0..4 {
            let k = 4 * j + i;
            w.p[k] = bu[i] * bv[j];
            w.u[k] = du[i] * bv[j];
            w.v[k] = bu[i] * dv[j];
            w.uu[k] = duu[i] * bv[j];
            w.uv[k] = du[i] * dv[j];
            w.vv[k] = bu[i] * dvv[j];
        }
    }
    w
}

/// Weights of a bilinear patch over the points 0, 1, 2, 3 around the square.
pub(super) fn bilinear(u: f64, v: f64) -> Weights {
    let mut w = Weights::ZERO;
    let (a, b) = (1.0 - u, 1.0 - v);
    w.p[..4].copy_from_slice(&[a * b, u * b, u * v, a * v]);
    w.u[..4].copy_from_slice(&[-b, b, v, -v]);
    w.v[..4].copy_from_slice(&[-a, -u, u, a]);
    w.uv[..4].copy_from_slice(&[1.0, -1.0, 1.0, -1.0]);
    w
}

/// Weights of a linear triangle.
pub(super) fn linear(u: f64, v: f64) -> Weights {
    let mut w = Weights::ZERO;
    w.p[..3].copy_from_slice(&[1.0 - u - v, u, v]);
    w.u[..3].copy_from_slice(&[-1.0, 1.0, 0.0]);
    w.v[..3].copy_from_slice(&[-1.0, 0.0, 1.0]);
    w
}

/// A term c·uᵃ·vᵇ·wᶜ with w = 1 − u − v.
type Term = (f64, [i32; 3]);

/// Weights of a quartic box spline patch, whose polynomials stand in [`BOX_SPLINE`] times 12.
pub(super) fn box_spline(u: f64, v: f64) -> Weights {
    let w = 1.0 - u - v;
    let powers = |x: f64| [1.0, x, x * x, x * x * x, x * x * x * x];
    let (pu, pv, pw) = (powers(u), powers(v), powers(w));
    // Powers and their first and second derivatives.
    let d = |p: &[f64; 5], n: i32, order: i32| -> f64 {
        let factor: i32 = (0..order).map(|k| n - k).product();
        if factor == 0 {
            0.0
        } else {
            f64::from(factor) * p[(n - order) as usize]
        }
    };
    let mut out = Weights::ZERO;
    for (i, terms) in BOX_SPLINE.iter().enumerate() {
        for &(c, [a, b, g]) in *terms {
            let c = c / 12.0;
            // By the chain rule: d/du holds v and takes w' = −1, likewise d/dv.
            let t = |i: i32, j: i32, k: i32| c * d(&pu, a, i) * d(&pv, b, j) * d(&pw, g, k);
            out.p[i] += t(0, 0, 0);
            out.u[i] += t(1, 0, 0) - t(0, 0, 1);
            out.v[i] += t(0, 1, 0) - t(0, 0, 1);
            out.uu[i] += t(2, 0, 0) - 2.0 * t(1, 0, 1) + t(0, 0, 2);
            out.uv[i] += t(1, 1, 0) - t(1, 0, 1) - t(0, 1, 1) + t(0, 0, 2);
            out.vv[i] += t(0, 2, 0) - 2.0 * t(0, 1, 1) + t(0, 0, 2);
        }
    }
    out
}

/// The basis functions as homogeneous quartics in u, v and w: what Loop's rules make of one point of a regular
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
