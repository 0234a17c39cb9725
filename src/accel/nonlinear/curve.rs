//! A ray within a prism, as a curve over the quad's parameters.
//!
//! With s from 0 to 1 on the way through the prism, the height is h0 + s (h1 - h0), and u and v, in micro-quads, are
//! quadratics over one common denominator. From end to end the curve is cut where u or v turns, which few curves do: in
//! each piece both of them grow, or fall, and a line of constant u or v is met once at most.
//!
//! The paper has h itself for parameter, from 0 to 1 over the whole shell. A ray along the surface has but a small part of it,
//! and single precision would not tell places on it; s always has all of its bits.

use arrayvec::ArrayVec;

use crate::accel::prism::Span;
use crate::math::quadratic;

/// A quadratic by powers of s, that of the constant first.
pub(super) type Quadratic = [f32; 3];

/// The curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curve {
    /// u and v, times the denominator.
    pub(super) uv: [Quadratic; 2],
    /// The denominator.
    pub(super) d: Quadratic,
    /// The height where it begins, and how much it grows.
    pub(super) height: f32,
    pub(super) grows: f32,
}

/// A piece in which u and v are monotone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub(super) from: f32,
    pub(super) to: f32,
    /// Whether u and v fall.
    pub(super) falls: [bool; 2],
}

impl Piece {
    /// Which of u and v falls, as bits.
    #[inline(always)]
    pub(super) fn which(&self) -> usize {
        usize::from(self.falls[0]) + 2 * usize::from(self.falls[1])
    }
}

/// The most pieces: u and v turn twice each.
pub(super) const MOST_PIECES: usize = 5;

impl Curve {
    /// From a span, and the u and v of the corners that its weights are of. The pieces from `begin` on, too.
    #[inline(always)]
    pub(super) fn new(
        span: &Span,
        corners: [[f64; 2]; 3],
        begin: f64,
    ) -> (Self, ArrayVec<Piece, MOST_PIECES>) {
        let w = &span.weights;
        let mut d = [0.0; 3];
        let mut uv = [[0.0; 3]; 2];
        let sum = |w: &[f64; 3]| w[0] + w[1] + w[2];
        let scale = 1.0 / sum(&w[0]).max(sum(&w[2]));
        for at in 0..3 {
            for corner in 0..3 {
                let weight = scale * w[at][corner];
                d[at] += weight;
                uv[0][at] += weight * corners[corner][0];
                uv[1][at] += weight * corners[corner][1];
            }
        }
        let mut cuts: ArrayVec<f64, 6> = ArrayVec::new();
        cuts.push(begin);
        let mut falls = [false; 2];
        for (falls, n) in falls.iter_mut().zip(&uv) {
            // The derivative times d squared.
            let turns = [
                n[1] * d[0] - n[0] * d[1],
                0.5 * (n[2] * d[0] - n[0] * d[2]),
                n[2] * d[1] - n[1] * d[2],
            ];
            *falls = turns[0] + turns[1] + turns[2] < 0.0;
            let [a, b, c] = turns;
            if (a >= 0.0 && b >= 0.0 && c >= 0.0) || (a <= 0.0 && b <= 0.0 && c <= 0.0) {
                continue;
            }
            for s in quadratic(a - 2.0 * b + c, 2.0 * (b - a), a)
                .into_iter()
                .flatten()
            {
                if s > begin && s < 1.0 {
                    cuts.push(s);
                }
            }
        }
        let mut pieces = ArrayVec::new();
        if cuts.len() == 1 {
            pieces.push(Piece {
                from: begin as f32,
                to: 1.0,
                falls,
            });
        } else {
            cuts[1..].sort_unstable_by(f64::total_cmp);
            cuts.push(1.0);
            let at = |c: &[f64; 3], s: f64| {
                let r = 1.0 - s;
                r * (r * c[0] + 2.0 * s * c[1]) + s * s * c[2]
            };
            for pair in cuts.windows(2) {
                let (from, to) = (pair[0], pair[1]);
                let falls =
                    [0, 1].map(|k| at(&uv[k], to) * at(&d, from) < at(&uv[k], from) * at(&d, to));
                pieces.push(Piece {
                    from: from as f32,
                    to: to as f32,
                    falls,
                });
            }
        }
        let powers =
            |[a, b, c]: [f64; 3]| [a as f32, (2.0 * (b - a)) as f32, (a - 2.0 * b + c) as f32];
        let [from, to] = span.heights;
        let curve = Self {
            uv: [powers(uv[0]), powers(uv[1])],
            d: powers(d),
            height: from as f32,
            grows: (to - from) as f32,
        };
        (curve, pieces)
    }

    /// The height at `s`.
    #[inline(always)]
    pub(super) fn height(&self, s: f32) -> f32 {
        self.height + s * self.grows
    }

    /// u and v at `s`.
    #[inline(always)]
    pub(super) fn uv(&self, s: f32) -> [f32; 2] {
        let d = at(&self.d, s);
        [at(&self.uv[0], s) / d, at(&self.uv[1], s) / d]
    }
}

/// A quadratic's value.
#[inline(always)]
pub(super) fn at([a, b, c]: &Quadratic, s: f32) -> f32 {
    a + s * (b + s * c)
}

/// Its Bernstein coefficients from one place to another.
#[inline(always)]
pub(super) fn between(q: &Quadratic, from: f32, to: f32) -> [f32; 3] {
    let [a, b, c] = q;
    [
        at(q, from),
        a + 0.5 * b * (from + to) + c * (from * to),
        at(q, to),
    ]
}
