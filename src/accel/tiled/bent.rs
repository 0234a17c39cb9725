//! A ray within a prism, bent into the space of tiles, and the chords that stand for parts of it.
//!
//! With s from 0 to 1 on the way through the prism, the height w is linear, and u, v and the ray's own t are polynomials over
//! one denominator. All of them are kept as Bernstein coefficients of cubics, times that denominator.
//!
//! A chord runs evenly from one end to the other while t does. How far the ray is from it at the same t is a cubic over the
//! denominator that is zero at both ends, so that two coefficients bound it.

use crate::accel::prism::{Pole, Span};

/// A cubic by its Bernstein coefficients.
pub(super) type Cubic = [f64; 4];

/// A part of a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bent {
    /// u, v and w, times the denominator.
    pub(super) uvw: [Cubic; 3],
    t: Cubic,
    /// The denominator; above 0 at both ends.
    pub(super) d: Cubic,
    /// Where it begins and ends on the way through the prism.
    pub(super) s: [f64; 2],
}

/// A straight line from end to end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chord {
    pub(super) from: [f64; 3],
    /// From end to end.
    pub(super) along: [f64; 3],
    pub(super) t: [f64; 2],
    /// How far off the ray may be at the same t, axis by axis.
    pub(super) off: [f64; 3],
}

impl Chord {
    /// Whether it says anything: where a prism is as good as flat, rounding may leave nothing of it. False for what is not a
    /// number, too.
    #[inline(always)]
    pub(super) fn is_sound(&self) -> bool {
        const FAR: f64 = 1e9;
        let mut sound = true;
        for k in 0..3 {
            sound &= self.from[k].abs() + self.along[k].abs() <= FAR && self.off[k] <= 1.0;
        }
        sound
    }
}

impl Bent {
    /// All of a span, over a triangle whose corners have these u and v.
    #[inline(always)]
    pub(super) fn new(span: &Span, corners: [&Pole; 3], uvs: &[[f64; 2]; 3]) -> Self {
        let w = &span.weights;
        let [h0, h1] = span.heights;
        let sum = |w: &[f64; 3]| w[0] + w[1] + w[2];
        let scale = 1.0 / sum(&w[0]).max(sum(&w[2]));
        let mut d = [0.0; 3];
        let mut uv = [[0.0; 3]; 2];
        let mut t = [0.0; 4];
        for k in 0..3 {
            let [a, b, c] = [scale * w[0][k], scale * w[1][k], scale * w[2][k]];
            d[0] += a;
            d[1] += b;
            d[2] += c;
            for axis in 0..2 {
                uv[axis][0] += a * uvs[k][axis];
                uv[axis][1] += b * uvs[k][axis];
                uv[axis][2] += c * uvs[k][axis];
            }
            let from_to = [corners[k].t(h0), corners[k].t(h1)];
            add(&mut t, times([a, b, c], from_to));
        }
        Self {
            uvw: [raised(uv[0]), raised(uv[1]), times(d, [h0, h1])],
            t,
            d: raised(d),
            s: [0.0, 1.0],
        }
    }

    /// Both halves.
    #[inline(always)]
    pub(super) fn halves(&self) -> [Self; 2] {
        let mut first = *self;
        let mut second = *self;
        for k in 0..3 {
            (first.uvw[k], second.uvw[k]) = halved(&self.uvw[k]);
        }
        (first.t, second.t) = halved(&self.t);
        (first.d, second.d) = halved(&self.d);
        let middle = 0.5 * (self.s[0] + self.s[1]);
        first.s[1] = middle;
        second.s[0] = middle;
        [first, second]
    }

    /// The ray's own t at both ends.
    #[inline(always)]
    pub(super) fn times(&self) -> [f64; 2] {
        [self.t[0] / self.d[0], self.t[3] / self.d[3]]
    }

    /// The chord; none where it takes no time, or where the denominator's coefficients bound nothing.
    #[inline(always)]
    pub(super) fn chord(&self) -> Option<Chord> {
        let d = &self.d;
        let [t0, t1] = self.times();
        let per_t = 1.0 / (t1 - t0);
        if !(t1 > t0 && d[1] > 0.0 && d[2] > 0.0) {
            return None;
        }
        let mut chord = Chord {
            from: [0.0; 3],
            along: [0.0; 3],
            t: [t0, t1],
            off: [0.0; 3],
        };
        // How far t has come, times the denominator.
        let p = per_t * (self.t[1] - t0 * d[1]);
        let q = per_t * (self.t[2] - t0 * d[2]);
        let per_d = [1.0 / d[0], 1.0 / d[1], 1.0 / d[2], 1.0 / d[3]];
        for k in 0..3 {
            let x = &self.uvw[k];
            let from = x[0] * per_d[0];
            let along = x[3] * per_d[3] - from;
            let first = (x[1] - from * d[1] - along * p) * per_d[1];
            let second = (x[2] - from * d[2] - along * q) * per_d[2];
            chord.from[k] = from;
            chord.along[k] = along;
            chord.off[k] = first.abs().max(second.abs());
        }
        Some(chord)
    }

    /// u, v, w and t at a place from 0 to 1.
    #[inline(always)]
    pub(super) fn at(&self, x: f64) -> ([f64; 3], f64) {
        let b = basis(x);
        let d = 1.0 / dot(&self.d, &b);
        let [u, v, w] = &self.uvw;
        (
            [d * dot(u, &b), d * dot(v, &b), d * dot(w, &b)],
            d * dot(&self.t, &b),
        )
    }
}

#[inline(always)]
fn basis(x: f64) -> Cubic {
    let r = 1.0 - x;
    [r * r * r, 3.0 * r * r * x, 3.0 * r * x * x, x * x * x]
}

#[inline(always)]
fn dot(a: &Cubic, b: &Cubic) -> f64 {
    a[0] * b[0] + a[1] * b[1] + (a[2] * b[2] + a[3] * b[3])
}

#[inline(always)]
fn add(to: &mut Cubic, by: Cubic) {
    for m in 0..4 {
        to[m] += by[m];
    }
}

/// A quadratic as a cubic.
#[inline(always)]
fn raised(q: [f64; 3]) -> Cubic {
    times(q, [1.0, 1.0])
}

/// A quadratic times what goes evenly from one number to another.
#[inline(always)]
fn times([a, b, c]: [f64; 3], [from, to]: [f64; 2]) -> Cubic {
    const THIRD: f64 = 1.0 / 3.0;
    [
        a * from,
        THIRD * (a * to + 2.0 * b * from),
        THIRD * (2.0 * b * to + c * from),
        c * to,
    ]
}

/// Both halves of a cubic (de Casteljau).
#[inline(always)]
fn halved(&[a, b, c, d]: &Cubic) -> (Cubic, Cubic) {
    let (ab, bc, cd) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + d));
    let (abc, bcd) = (0.5 * (ab + bc), 0.5 * (bc + cd));
    let middle = 0.5 * (abc + bcd);
    ([a, ab, abc, middle], [middle, bcd, cd, d])
}

/// A cubic from a root of it on, where it has crossed to the other side.
#[inline(always)]
pub(super) fn beyond_root(&[a, b, c, d]: &Cubic, x: f64) -> Cubic {
    let (bc, cd) = (b + x * (c - b), c + x * (d - c));
    let bcd = bc + x * (cd - bc);
    [-f64::MIN_POSITIVE.copysign(a), bcd, cd, d]
}
