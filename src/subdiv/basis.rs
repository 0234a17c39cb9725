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

const SIXTH: f64 = 1.0 / 6.0;

/// The uniform cubic B-splines over their middle segment, with first and second derivatives.
#[inline]
pub(super) fn cubic(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    [
        [
            SIXTH * s2 * s,
            4.0 * SIXTH - 0.5 * t2 * (1.0 + s),
            4.0 * SIXTH - 0.5 * s2 * (1.0 + t),
            SIXTH * t2 * t,
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
type Term = (f64, [usize; 3]);

/// Weights of a quartic box spline patch.
pub(super) fn box_spline(u: f64, v: f64) -> Weights {
    let mut out = Weights::ZERO;
    let [p, du, dv] = box_spline_first(u, v);
    let quadratic = monomials::<2, 6>(u, v);
    for (out, weights) in [
        (&mut out.p, p),
        (&mut out.u, du),
        (&mut out.v, dv),
        (&mut out.uu, combine(&SPLINE_UU, &quadratic)),
        (&mut out.uv, combine(&SPLINE_UV, &quadratic)),
        (&mut out.vv, combine(&SPLINE_VV, &quadratic)),
    ] {
        out[..12].copy_from_slice(&weights);
    }
    out
}

/// Weights of a quartic box spline patch for the position and the first derivatives.
#[inline]
pub(super) fn box_spline_first(u: f64, v: f64) -> [[f64; 12]; 3] {
    let cubic = monomials::<3, 10>(u, v);
    [
        combine(&SPLINE, &monomials::<4, 15>(u, v)),
        combine(&SPLINE_U, &cubic),
        combine(&SPLINE_V, &cubic),
    ]
}

/// For each monomial of one degree the coefficients of the twelve functions.
type Polynomials<const N: usize> = [[f64; 12]; N];

const SPLINE: Polynomials<15> = tabulate();
const SPLINE_U: Polynomials<10> = derive::<4, 15, 10>(&SPLINE, 0);
const SPLINE_V: Polynomials<10> = derive::<4, 15, 10>(&SPLINE, 1);
const SPLINE_UU: Polynomials<6> = derive::<3, 10, 6>(&SPLINE_U, 0);
const SPLINE_UV: Polynomials<6> = derive::<3, 10, 6>(&SPLINE_U, 1);
const SPLINE_VV: Polynomials<6> = derive::<3, 10, 6>(&SPLINE_V, 1);

/// The place of uᵃ·vᵇ·wᶜ among the monomials of this degree.
const fn monomial(degree: usize, a: usize, b: usize) -> usize {
    a * (2 * degree + 3 - a) / 2 + b
}

/// All monomials of a degree, as [`monomial`] numbers them.
fn monomials<const DEGREE: usize, const N: usize>(u: f64, v: f64) -> [f64; N] {
    let w = 1.0 - u - v;
    let mut powers = [[1.0; 3]; 5];
    for i in 1..=DEGREE {
        powers[i] = [
            powers[i - 1][0] * u,
            powers[i - 1][1] * v,
            powers[i - 1][2] * w,
        ];
    }
    let mut out = [0.0; N];
    let mut k = 0;
    for a in 0..=DEGREE {
        for b in 0..=DEGREE - a {
            out[k] = powers[a][0] * powers[b][1] * powers[DEGREE - a - b][2];
            k += 1;
        }
    }
    out
}

fn combine<const N: usize>(table: &Polynomials<N>, monomials: &[f64; N]) -> [f64; 12] {
    let mut out = [0.0; 12];
    for (row, &x) in table.iter().zip(monomials) {
        for (out, &c) in out.iter_mut().zip(row) {
            *out += c * x;
        }
    }
    out
}

const fn tabulate() -> Polynomials<15> {
    let mut out = [[0.0; 12]; 15];
    let mut i = 0;
    while i < 12 {
        let mut k = 0;
        while k < BOX_SPLINE[i].len() {
            let (c, [a, b, _]) = BOX_SPLINE[i][k];
            out[monomial(4, a, b)][i] = c / 12.0;
            k += 1;
        }
        i += 1;
    }
    out
}

/// The derivatives by u (`axis` 0) or v (1) of polynomials of this degree. By the chain rule w' = −1.
const fn derive<const DEGREE: usize, const N: usize, const M: usize>(
    table: &Polynomials<N>,
    axis: usize,
) -> Polynomials<M> {
    let mut out = [[0.0; 12]; M];
    let mut a = 0;
    while a <= DEGREE {
        let mut b = 0;
        while b <= DEGREE - a {
            let powers = [a, b];
            let c = DEGREE - a - b;
            let mut i = 0;
            while i < 12 {
                let term = table[monomial(DEGREE, a, b)][i];
                if powers[axis] > 0 {
                    let lower = monomial(DEGREE - 1, a - (1 - axis), b - axis);
                    out[lower][i] += powers[axis] as f64 * term;
                }
                if c > 0 {
                    out[monomial(DEGREE - 1, a, b)][i] -= c as f64 * term;
                }
                i += 1;
            }
            b += 1;
        }
        a += 1;
    }
    out
}

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
