//! A curve and the two micro-triangles of a micro-quad.
//!
//! They are flat over u and v: each has its height H = H0 + Hu u + Hv v. Times the denominator, what the curve is above one is
//! a cubic of s, and a hit is its first root on the part of the curve that is over the triangle. Its values at the ends
//! are compared with what rounding may have done to them: what ends within that is hit there, so that of two triangles that
//! share an edge at least one is hit, however the curve passes over it.

use super::curve::{Curve, between};
use crate::math::{first_cubic_root, quadratic};

/// Two micro-triangles: heights at the least u and v, the greater u, the greater v, and both.
pub(super) type Heights = [f32; 4];

/// Where the curve first meets them from one place on it to another, both over the micro-quad in column `i` and row `j`.
/// `sizes` are the micro-quads of the whole quad.
#[inline(always)]
pub(super) fn first(
    curve: &Curve,
    [i, j]: [f32; 2],
    sizes: f32,
    heights: &Heights,
    from: f32,
    to: f32,
) -> Option<f32> {
    let d = between(&curve.d, from, to);
    let own = |axis: usize, first: f32| {
        let n = between(&curve.uv[axis], from, to);
        [
            n[0] - first * d[0],
            n[1] - first * d[1],
            n[2] - first * d[2],
        ]
    };
    let (u, v) = (own(0, i), own(1, j));
    let part = Part {
        u,
        v,
        d,
        h: [curve.height(from), curve.height(to)],
        sizes,
    };
    // Beyond the diagonal where this is positive.
    let [a, b, c] = [u[0] + v[0] - d[0], u[1] + v[1] - d[1], u[2] + v[2] - d[2]];
    if a <= 0.0 && b <= 0.0 && c <= 0.0 {
        return part.first(heights, false).map(|x| from + x * (to - from));
    }
    if a >= 0.0 && b >= 0.0 && c >= 0.0 {
        return part.first(heights, true).map(|x| from + x * (to - from));
    }
    let mut cuts =
        quadratic(a - 2.0 * b + c, 2.0 * (b - a), a).map(|x| x.filter(|&x| x > 0.0 && x < 1.0));
    if let [Some(x), Some(y)] = cuts
        && y < x
    {
        cuts.swap(0, 1);
    }
    let mut low = 0.0;
    for cut in cuts.into_iter().flatten().chain([1.0]) {
        let middle = 0.5 * (low + cut);
        let rest = 1.0 - middle;
        let second = rest * (rest * a + 2.0 * middle * b) + middle * middle * c > 0.0;
        if let Some(x) = part.of(low, cut).first(heights, second) {
            let x = low + x * (cut - low);
            return Some(from + x * (to - from));
        }
        low = cut;
    }
    None
}

/// A part of the curve in Bernstein coefficients, u and v counted from the micro-quad's corner.
struct Part {
    u: [f32; 3],
    v: [f32; 3],
    d: [f32; 3],
    h: [f32; 2],
    sizes: f32,
}

impl Part {
    /// A part of it.
    #[inline(always)]
    fn of(&self, from: f32, to: f32) -> Self {
        let cut = |c: &[f32; 3]| {
            let mixed = |x: f32, y: f32| {
                let first = c[0] + x * (c[1] - c[0]);
                let second = c[1] + x * (c[2] - c[1]);
                first + y * (second - first)
            };
            [mixed(from, from), mixed(from, to), mixed(to, to)]
        };
        let h = |x: f32| self.h[0] + x * (self.h[1] - self.h[0]);
        Self {
            u: cut(&self.u),
            v: cut(&self.v),
            d: cut(&self.d),
            h: [h(from), h(to)],
            sizes: self.sizes,
        }
    }

    /// The first meeting with one of the triangles' planes.
    #[inline(always)]
    fn first(&self, heights: &Heights, second: bool) -> Option<f32> {
        let plane = Plane::new(heights, second);
        let height = |k: usize| plane.base * self.d[k] + plane.u * self.u[k] + plane.v * self.v[k];
        let [p, q, r] = [height(0), height(1), height(2)];
        let ([h0, h1], d) = (self.h, self.d);
        let third = 1.0 / 3.0;
        let mut above = [
            h0 * d[0] - p,
            third * (h1 * d[0] + 2.0 * h0 * d[1] - (p + 2.0 * q)),
            third * (2.0 * h1 * d[1] + h0 * d[2] - (2.0 * q + r)),
            h1 * d[2] - r,
        ];
        let most = h0.abs().max(h1.abs())
            + plane.base.abs()
            + (plane.u.abs() + plane.v.abs()) * self.sizes;
        let error = ERROR * most * d[0].max(d[2]);
        if above[0].abs() <= error {
            return Some(0.0);
        }
        if above[3].abs() <= error {
            above[3] = 0.0;
        }
        let first = first_cubic_root(above);
        // What is left of a cubic whose end was moved may have none.
        first.or((above[3] == 0.0).then_some(1.0))
    }
}

/// What rounding may do to a height above a triangle, relative to the terms that it is made of.
const ERROR: f32 = 6.0 * f32::EPSILON;

/// The height of a micro-triangle at u and v, counted from the micro-quad's corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub(super) base: f32,
    pub(super) u: f32,
    pub(super) v: f32,
}

impl Plane {
    /// The one at the corner, or the `second` one, beyond the diagonal.
    #[inline(always)]
    pub(super) fn new(&[a, b, c, d]: &Heights, second: bool) -> Self {
        if second {
            Self {
                base: b + c - d,
                u: d - c,
                v: d - b,
            }
        } else {
            Self {
                base: a,
                u: b - a,
                v: c - a,
            }
        }
    }
}
