//! A NURBS surface as a function of its own parameters: position and derivatives up to the second.
//!
//! Piegl and Tiller, *The NURBS Book* (2nd edition, 1997), sections 4.3 and 4.5: the B-spline sum of homogeneous points
//! (w P, w), and the quotient rule on it (A4.4). Weights come apart from the points, as USD has them.

use super::basis::{self, Weights};
use crate::error::Fault;
use crate::math::{DVec3, DVec4};
use crate::mesh::{NurbsDirection, NurbsPatch};

/// A place on a surface and its derivatives by the two parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is, object space.
    pub position: DVec3,
    /// First derivative by u.
    pub du: DVec3,
    /// First derivative by v.
    pub dv: DVec3,
    /// Second derivative by u.
    pub duu: DVec3,
    /// Mixed second derivative.
    pub duv: DVec3,
    /// Second derivative by v.
    pub dvv: DVec3,
}

impl SurfacePoint {
    /// From the homogeneous sums: value, by u, by v, by uu, uv, vv.
    pub(super) fn from_homogeneous([a, u, v, uu, uv, vv]: [DVec4; 6]) -> Self {
        let w = a.w;
        let position = a.truncate() / w;
        let du = (u.truncate() - u.w * position) / w;
        let dv = (v.truncate() - v.w * position) / w;
        Self {
            position,
            du,
            dv,
            duu: (uu.truncate() - 2.0 * u.w * du - uu.w * position) / w,
            duv: (uv.truncate() - u.w * dv - v.w * du - uv.w * position) / w,
            dvv: (vv.truncate() - 2.0 * v.w * dv - vv.w * position) / w,
        }
    }
}

/// A NURBS surface, untrimmed.
#[derive(Debug, Clone)]
pub struct NurbsSurface {
    directions: [NurbsDirection; 2],
    /// (w P, w) at each motion key, u fastest.
    points: Vec<Vec<DVec4>>,
}

impl NurbsSurface {
    /// Of a patch, after checking it.
    ///
    /// # Errors
    /// Those of [`NurbsPatch::validate`].
    pub fn new(patch: &NurbsPatch) -> Result<Self, Fault> {
        patch.validate()?;
        let weight = |i: usize| patch.weights.as_ref().map_or(1.0, |w| w[i]);
        let homogeneous = |(i, p): (usize, &crate::math::Vec3)| {
            let w = weight(i);
            (w * p.as_dvec3()).extend(w)
        };
        Ok(Self {
            directions: [patch.u.clone(), patch.v.clone()],
            points: patch
                .points
                .iter()
                .map(|key| key.iter().enumerate().map(homogeneous).collect())
                .collect(),
        })
    }

    /// u and v: orders, knots and ranges.
    pub fn directions(&self) -> &[NurbsDirection; 2] {
        &self.directions
    }

    /// How many motion keys there are.
    pub fn key_count(&self) -> usize {
        self.points.len()
    }

    /// The control points (w P, w) at a motion key, u fastest.
    pub fn control_points(&self, key: usize) -> &[DVec4] {
        &self.points[key]
    }

    /// The point at (u, v) within the ranges, at a motion key. On a knot where the surface breaks it is the side of
    /// the larger parameter.
    pub fn evaluate(&self, key: usize, [u, v]: [f64; 2]) -> SurfacePoint {
        let [along_u, along_v] = self.functions([u, v]);
        // Position in the table of derivatives: by u, by v.
        let orders = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];
        SurfacePoint::from_homogeneous(
            orders.map(|[i, j]| self.sum(key, [along_u.weights(i), along_v.weights(j)])),
        )
    }

    /// The control points that shape the surface at (u, v) and how much each does: weights of the rational basis,
    /// all above 0 or 0, which sum to 1. Values on the points follow the surface with these.
    pub fn influences(&self, parameters: [f64; 2]) -> Vec<(usize, f64)> {
        let [u, v] = self.functions(parameters);
        let row = self.directions[0].count;
        let mut out = Vec::with_capacity(u.order * v.order);
        for j in 0..v.order {
            for i in 0..u.order {
                let point = (v.first + j) * row + u.first + i;
                out.push((
                    point,
                    u.table[0][i] * v.table[0][j] * self.points[0][point].w,
                ));
            }
        }
        let sum: f64 = out.iter().map(|(_, w)| w).sum();
        out.iter_mut().for_each(|(_, w)| *w /= sum);
        out
    }

    /// The same surface with more knots in u (`axis` 0) or v (1), within the knots' domain (The NURBS Book, section
    /// 5.3). An inserted knot may make at most `order` equal ones.
    ///
    /// # Panics
    /// If `axis` is neither 0 nor 1.
    #[must_use]
    pub fn with_knots(&self, axis: usize, inserted: &[f64]) -> Self {
        let old = &self.directions[axis];
        let mut knots = old.knots.clone();
        knots.extend_from_slice(inserted);
        knots.sort_by(f64::total_cmp);
        let rows = basis::refined(&old.knots, old.order, &knots);
        let mut directions = self.directions.clone();
        let count = rows.len();
        (directions[axis].knots, directions[axis].count) = (knots, count);
        let points = self
            .points
            .iter()
            .map(|key| apply_rows(key, self.directions[0].count, axis, old.order, &rows))
            .collect();
        Self { directions, points }
    }

    fn functions(&self, parameters: [f64; 2]) -> [Functions; 2] {
        [0, 1].map(|axis| {
            let direction = &self.directions[axis];
            let [low, high] = direction.domain();
            let t = parameters[axis].clamp(low, high);
            let span = basis::span(&direction.knots, direction.order, t);
            Functions {
                first: span + 1 - direction.order,
                order: direction.order,
                table: basis::functions(&direction.knots, direction.order, span, t),
            }
        })
    }

    fn sum(&self, key: usize, [u, v]: [(usize, &[f64]); 2]) -> DVec4 {
        let row = self.directions[0].count;
        let points = &self.points[key];
        let mut sum = DVec4::ZERO;
        for (j, wv) in v.1.iter().enumerate() {
            let start = (v.0 + j) * row + u.0;
            let along: DVec4 = points[start..]
                .iter()
                .zip(u.1)
                .map(|(p, wu)| *p * *wu)
                .sum();
            sum += along * *wv;
        }
        sum
    }
}

/// Values and derivatives of the basis functions that are not 0 at a parameter.
struct Functions {
    first: usize,
    order: usize,
    table: [Weights; 3],
}

impl Functions {
    fn weights(&self, derivative: usize) -> (usize, &[f64]) {
        (self.first, &self.table[derivative][..self.order])
    }
}

/// New points along `axis`, each a weighted sum of `order` old ones; `width` old points make a row along u.
pub(super) fn apply_rows(
    points: &[DVec4],
    width: usize,
    axis: usize,
    order: usize,
    rows: &[(usize, Weights)],
) -> Vec<DVec4> {
    let height = points.len() / width;
    let [columns, lines] = match axis {
        0 => [rows.len(), height],
        1 => [width, rows.len()],
        _ => unreachable!("a surface has two axes"),
    };
    let mut out = Vec::with_capacity(columns * lines);
    for line in 0..lines {
        for column in 0..columns {
            let (first, weights) = &rows[if axis == 0 { column } else { line }];
            let old = |k: usize| match axis {
                0 => points[line * width + first + k],
                _ => points[(first + k) * width + column],
            };
            out.push((0..order).map(|k| old(k) * weights[k]).sum());
        }
    }
    out
}
