//! A bicubic Bezier patch: evaluated at a point and over a grid, cut down to a rectangle, boxed.
//!
//! Derivatives come from the nets of differences, not from derivatives of the weights: far from the origin the
//! differences of neighbouring control points are still exact.

use super::base::{LimitGrid, LimitPoint, UvRect};
use crate::math::{Bounds3, DVec3, Vec2, Vec3};

/// Control points row by row, u running faster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bicubic(pub [Vec3; 16]);

/// The evaluation of a point adds 16 products whose weights sum to 1, each of two to four roundings: fewer than this
/// many units of 2^-24 of the largest coordinate.
const ROUNDINGS: f32 = 32.0;

/// Beyond the rounding of coordinates as large as the patch, and below what any picture shows.
const EVEN: f32 = 1e-6;

impl Bicubic {
    /// The point at `uv` with all derivatives.
    pub fn evaluate(&self, uv: Vec2) -> LimitPoint {
        let p = &self.0;
        let (u, v) = (uv.x, uv.y);
        let (bu, bv) = (cubic(u), cubic(v));
        let (qu, qv) = (quadratic(u), quadratic(v));
        let (lu, lv) = ([1.0 - u, u], [1.0 - v, v]);
        let mut point = LimitPoint::default();
        for r in 0..4 {
            let row = &p[4 * r..4 * r + 4];
            let d = [row[1] - row[0], row[2] - row[1], row[3] - row[2]];
            point.position += bv[r] * blend(&bu, row);
            point.du += 3.0 * bv[r] * blend(&qu, &d);
            point.duu += 6.0 * bv[r] * blend(&lu, &[d[1] - d[0], d[2] - d[1]]);
        }
        let up = |r: usize, c: usize| p[4 * r + 4 + c] - p[4 * r + c];
        for (r, q) in qv.into_iter().enumerate() {
            let row: [Vec3; 4] = std::array::from_fn(|c| up(r, c));
            let d = [row[1] - row[0], row[2] - row[1], row[3] - row[2]];
            point.dv += 3.0 * q * blend(&bu, &row);
            point.duv += 9.0 * q * blend(&qu, &d);
        }
        for (r, l) in lv.into_iter().enumerate() {
            let row: [Vec3; 4] = std::array::from_fn(|c| up(r + 1, c) - up(r, c));
            point.dvv += 6.0 * l * blend(&bu, &row);
        }
        point
    }

    /// Points, and first derivatives with `SLOPES`, at all pairs of `us` and `vs`, u running faster: a curve for each v,
    /// then loops along u over one coordinate at a time.
    pub fn grid<const SLOPES: bool>(&self, us: &[f32], vs: &[f32], out: &mut LimitGrid) {
        let n = us.len();
        out.resize(n * vs.len());
        if n == 0 {
            return;
        }
        // The weights at each u: four cubic ones, three quadratic ones times 3.
        out.weights.resize(7 * n, 0.0);
        for (i, &u) in us.iter().enumerate() {
            let (b, q) = (cubic(u), quadratic(u));
            for (k, w) in b.into_iter().chain(q.map(|q| 3.0 * q)).enumerate() {
                out.weights[k * n + i] = w;
            }
        }
        let p = &self.0;
        for (row, &v) in vs.iter().enumerate() {
            let (bv, qv) = (cubic(v), quadratic(v));
            let at =
                |c: usize| bv[0] * p[c] + bv[1] * p[4 + c] + bv[2] * p[8 + c] + bv[3] * p[12 + c];
            let along_u = |c: usize| {
                let d = |r: usize| p[4 * r + c + 1] - p[4 * r + c];
                bv[0] * d(0) + bv[1] * d(1) + bv[2] * d(2) + bv[3] * d(3)
            };
            let along_v = |c: usize| {
                let d = |r: usize| p[4 * r + 4 + c] - p[4 * r + c];
                3.0 * (qv[0] * d(0) + qv[1] * d(1) + qv[2] * d(2))
            };
            let points: [Vec3; 4] = std::array::from_fn(at);
            let dus: [Vec3; 3] = std::array::from_fn(along_u);
            let dvs: [Vec3; 4] = std::array::from_fn(along_v);
            let here = row * n..(row + 1) * n;
            let (b, q) = out.weights.split_at(4 * n);
            for axis in 0..3 {
                let four = |c: &[Vec3; 4]| c.map(|c| c[axis]);
                combine(b, four(&points), &mut out.position[axis][here.clone()]);
                if SLOPES {
                    combine(q, dus.map(|c| c[axis]), &mut out.du[axis][here.clone()]);
                    combine(b, four(&dvs), &mut out.dv[axis][here.clone()]);
                }
            }
        }
    }

    /// The part over `rect` as a patch of its own.
    #[must_use]
    pub fn restricted(&self, rect: &UvRect) -> Self {
        // Blossoms: control point i of the part from a to b is the polar form at i times b and 3 - i times a.
        let polar = |c: [DVec3; 4], a: f32, b: f32| {
            let (a, b) = (f64::from(a), f64::from(b));
            [[a, a, a], [a, a, b], [a, b, b], [b, b, b]].map(|ts| {
                let mut c = c;
                for (level, t) in ts.into_iter().enumerate() {
                    for i in 0..3 - level {
                        c[i] += t * (c[i + 1] - c[i]);
                    }
                }
                c[0]
            })
        };
        let rows: [[DVec3; 4]; 4] = std::array::from_fn(|r| {
            let row = std::array::from_fn(|c| self.0[4 * r + c].as_dvec3());
            polar(row, rect.min.x, rect.max.x)
        });
        let columns: [[DVec3; 4]; 4] = std::array::from_fn(|c| {
            let column = std::array::from_fn(|r| rows[r][c]);
            polar(column, rect.min.y, rect.max.y)
        });
        Self(std::array::from_fn(|i| columns[i % 4][i / 4].as_vec3()))
    }

    /// Whether it is linear in u and v, to a millionth of its size.
    pub fn is_even(&self) -> bool {
        let p = &self.0;
        let (origin, du, dv) = (p[0], p[3] - p[0], p[12] - p[0]);
        let allowed = EVEN * Bounds3::of(*p).extent().length();
        p.iter().enumerate().all(|(i, point)| {
            let linear = origin + (i % 4) as f32 / 3.0 * du + (i / 4) as f32 / 3.0 * dv;
            point.distance(linear) <= allowed
        })
    }

    /// A box around all that [`evaluate`](Self::evaluate) and [`grid`](Self::grid) give over `rect`.
    pub fn hull(&self, rect: &UvRect) -> Bounds3 {
        let largest = self
            .0
            .iter()
            .fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
        let slack = Vec3::splat(ROUNDINGS * 0.5 * f32::EPSILON * largest + f32::MIN_POSITIVE);
        let points = Bounds3::of(self.restricted(rect).0);
        Bounds3 {
            min: points.min - slack,
            max: points.max + slack,
        }
    }
}

fn cubic(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
}

fn quadratic(t: f32) -> [f32; 3] {
    let s = 1.0 - t;
    [s * s, 2.0 * s * t, t * t]
}

fn blend(weights: &[f32], points: &[Vec3]) -> Vec3 {
    weights
        .iter()
        .zip(points)
        .fold(Vec3::ZERO, |sum, (&w, &p)| sum + w * p)
}

/// `out[i]` is the sum over k of `weights[k * n + i] * c[k]`.
fn combine<const K: usize>(weights: &[f32], c: [f32; K], out: &mut [f32]) {
    let n = out.len();
    let rows: [&[f32]; K] = std::array::from_fn(|k| &weights[k * n..][..n]);
    for (i, out) in out.iter_mut().enumerate() {
        let mut sum = rows[0][i] * c[0];
        for k in 1..K {
            sum += rows[k][i] * c[k];
        }
        *out = sum;
    }
}
