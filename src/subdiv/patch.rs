//! Evaluating polynomial patches: sums of their points by the functions of [`super::basis`].
//!
//! Points have a lane to spare, so that sums are of whole registers.

use std::ops::{Add, AddAssign, Mul, Sub};

use super::basis::{self, BoxSpline};
use crate::math::{DVec3, DVec4, Vec4};

/// A floating-point type to store and evaluate in: single for rendering, double for reference.
///
/// Single precision costs, over all cages of the reference values and in units of a mesh's size (or of its distance
/// from the origin, if that is larger): 2e-7 of positions and 2e-5 of derivatives at worst, the latter within 2⁻⁵ of an
/// extraordinary vertex. On faces a few hundredths of the mesh wide that is 1e-3 of a derivative's length or of a unit
/// normal.
pub trait Real:
    Copy
    + Send
    + Sync
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + AddAssign
    + 'static
{
    /// A point with a lane to spare, in which anything may be.
    type Lanes: Copy
        + Default
        + Add<Output = Self::Lanes>
        + Sub<Output = Self::Lanes>
        + Mul<Self, Output = Self::Lanes>;
    /// The nearest value.
    fn of(value: f64) -> Self;
    /// The same value in double precision.
    fn get(self) -> f64;
    /// Four numbers as lanes.
    fn lanes(four: [Self; 4]) -> Self::Lanes;
    /// The first three of them.
    fn three(lanes: Self::Lanes) -> [Self; 3];
}

impl Real for f32 {
    type Lanes = Vec4;
    #[inline]
    fn of(value: f64) -> Self {
        value as Self
    }
    #[inline]
    fn get(self) -> f64 {
        f64::from(self)
    }
    #[inline]
    fn lanes(four: [Self; 4]) -> Vec4 {
        Vec4::from_array(four)
    }
    #[inline]
    fn three(lanes: Vec4) -> [Self; 3] {
        lanes.truncate().to_array()
    }
}

impl Real for f64 {
    type Lanes = DVec4;
    #[inline]
    fn of(value: f64) -> Self {
        value
    }
    #[inline]
    fn get(self) -> f64 {
        self
    }
    #[inline]
    fn lanes(four: [Self; 4]) -> DVec4 {
        DVec4::from_array(four)
    }
    #[inline]
    fn three(lanes: DVec4) -> [Self; 3] {
        lanes.truncate().to_array()
    }
}

/// A point of a surface with its derivatives by the face's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitPoint<T> {
    /// Where.
    pub position: [T; 3],
    /// First derivative by u.
    pub du: [T; 3],
    /// First derivative by v.
    pub dv: [T; 3],
    /// Second derivative by u twice.
    pub duu: [T; 3],
    /// Second derivative by u and v.
    pub duv: [T; 3],
    /// Second derivative by v twice.
    pub dvv: [T; 3],
}

impl<T: Real> LimitPoint<T> {
    /// The unit normal at parameters (u, v), along du × dv. Where these are parallel or vanish, as at some poles and
    /// folds, it is the one that comes from inside the face, if second derivatives tell.
    pub fn normal(&self, u: f64, v: f64) -> Option<[f64; 3]> {
        let [du, dv, duu, duv, dvv] =
            [self.du, self.dv, self.duu, self.duv, self.dvv].map(|d| DVec3::from(d.map(Real::get)));
        // Below this sine the angle between two tangents is rounding.
        const LEAST_SINE: f64 = 1e-9;
        let proper = |a: DVec3, b: DVec3| {
            let across = a.cross(b);
            let scale = a.length() * b.length();
            (across.length() > LEAST_SINE * scale).then(|| across.normalize().to_array())
        };
        proper(du, dv).or_else(|| {
            // To first order towards a point well inside.
            let (a, b) = (1.0 / 3.0 - u, 1.0 / 3.0 - v);
            let across = (a * duu + b * duv).cross(dv) + du.cross(a * duv + b * dvv);
            let scale =
                du.length().max(dv.length()) * duu.length().max(duv.length()).max(dvv.length());
            (across.length() > LEAST_SINE * scale).then(|| across.normalize().to_array())
        })
    }
}

/// A point of a surface with its first derivatives by the face's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FirstOrder<T> {
    /// Where.
    pub position: [T; 3],
    /// By u.
    pub du: [T; 3],
    /// By v.
    pub dv: [T; 3],
}

impl<T> From<LimitPoint<T>> for FirstOrder<T> {
    fn from(point: LimitPoint<T>) -> Self {
        Self {
            position: point.position,
            du: point.du,
            dv: point.dv,
        }
    }
}

/// What a patch is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PatchKind {
    Bicubic,
    BoxSpline,
    Bilinear,
    Linear,
}

impl PatchKind {
    /// How many points it has.
    #[inline]
    pub(super) fn points(self) -> usize {
        match self {
            Self::Bicubic => 16,
            Self::BoxSpline => 12,
            Self::Bilinear => 4,
            Self::Linear => 3,
        }
    }

    /// Whether its face is a triangle.
    #[inline]
    pub(super) fn is_triangular(self) -> bool {
        matches!(self, Self::BoxSpline | Self::Linear)
    }

    /// The weights of the points for the position; what is beyond them is 0.
    pub(super) fn weights(self, u: f64, v: f64) -> [f64; 16] {
        let mut weights = [0.0; 16];
        match self {
            Self::Bicubic => weights = basis::bicubic_weights(u, v),
            Self::BoxSpline => weights[..12].copy_from_slice(&basis::box_spline_weights(u, v)),
            Self::Bilinear => {
                let (a, b) = (1.0 - u, 1.0 - v);
                weights[..4].copy_from_slice(&[a * b, u * b, u * v, a * v]);
            }
            Self::Linear => weights[..3].copy_from_slice(&[1.0 - u - v, u, v]),
        }
        weights
    }
}

/// Evaluates a patch whose points `point` gives, all derivatives with it. These are multiplied by `scale`.
#[inline(always)]
pub(super) fn second_order<T: Real>(
    kind: PatchKind,
    point: impl Fn(usize) -> T::Lanes,
    [u, v]: [f64; 2],
    scale: [f64; 2],
) -> LimitPoint<T> {
    let [position, du, dv, duu, duv, dvv] = evaluate::<T, true>(kind, point, u, v);
    let [su, sv] = scale;
    let by = |factor: f64, d: T::Lanes| T::three(d).map(|x| T::of(factor) * x);
    LimitPoint {
        position: T::three(position),
        du: by(su, du),
        dv: by(sv, dv),
        duu: by(su * su, duu),
        duv: by(su * sv, duv),
        dvv: by(sv * sv, dvv),
    }
}

/// As [`second_order`] with first derivatives only.
#[inline(always)]
pub(super) fn first_order<T: Real>(
    kind: PatchKind,
    point: impl Fn(usize) -> T::Lanes,
    [u, v]: [f64; 2],
    scale: [f64; 2],
) -> FirstOrder<T> {
    let [position, du, dv, ..] = evaluate::<T, false>(kind, point, u, v);
    let by = |factor: f64, d: T::Lanes| T::three(d).map(|x| T::of(factor) * x);
    FirstOrder {
        position: T::three(position),
        du: by(scale[0], du),
        dv: by(scale[1], dv),
    }
}

/// Position and derivatives by u, v, uu, uv and vv; the last three are 0 without `SECOND`.
#[inline(always)]
fn evaluate<T: Real, const SECOND: bool>(
    kind: PatchKind,
    point: impl Fn(usize) -> T::Lanes,
    u: f64,
    v: f64,
) -> [T::Lanes; 6] {
    let zero = T::Lanes::default();
    match kind {
        PatchKind::Bicubic => bicubic::<T, SECOND>(gather::<T, _>(point), u, v),
        PatchKind::BoxSpline => box_spline::<T, SECOND>(gather::<T, _>(point), u, v),
        PatchKind::Bilinear => {
            let [a, b, c, d] = [0, 1, 2, 3].map(point);
            let [u, v] = [u, v].map(T::of);
            let (low, left) = (b - a, d - a);
            let duv = c - d - low;
            let du = low + duv * v;
            let dv = left + duv * u;
            [a + left * v + du * u, du, dv, zero, duv, zero]
        }
        PatchKind::Linear => {
            let [a, b, c] = [0, 1, 2].map(point);
            let (du, dv) = (b - a, c - a);
            let position = a + du * T::of(u) + dv * T::of(v);
            [position, du, dv, zero, zero, zero]
        }
    }
}

/// All points of a patch: a loop, as calls for each of them would cost more than the loads.
#[inline(always)]
fn gather<T: Real, const N: usize>(point: impl Fn(usize) -> T::Lanes) -> [T::Lanes; N] {
    let mut points = [T::Lanes::default(); N];
    for (i, p) in points.iter_mut().enumerate() {
        *p = point(i);
    }
    points
}

/// Rows first, then their sums: fewer products than by sixteen weights.
#[inline(always)]
fn bicubic<T: Real, const SECOND: bool>(points: [T::Lanes; 16], u: f64, v: f64) -> [T::Lanes; 6] {
    let [bu, du, duu] = basis::cubic::<T>(u);
    let [bv, dv, dvv] = basis::cubic::<T>(v);
    let zero = T::Lanes::default();
    let sum = |w: [T; 4], [a, b, c, d]: [T::Lanes; 4]| a * w[0] + b * w[1] + (c * w[2] + d * w[3]);
    let mut rows = [[zero; 4]; 3];
    for j in 0..4 {
        let row = [0, 1, 2, 3].map(|i| points[4 * j + i]);
        rows[0][j] = sum(bu, row);
        rows[1][j] = sum(du, row);
        if SECOND {
            rows[2][j] = sum(duu, row);
        }
    }
    let [p, pu, puu] = rows;
    let second = if SECOND {
        [sum(bv, puu), sum(dv, pu), sum(dvv, p)]
    } else {
        [zero; 3]
    };
    [
        sum(bv, p),
        sum(bv, pu),
        sum(dv, p),
        second[0],
        second[1],
        second[2],
    ]
}

/// The plane of the corners, and the other points' offsets from it: see [`BoxSpline`].
#[inline(always)]
fn box_spline<T: Real, const SECOND: bool>(p: [T::Lanes; 12], u: f64, v: f64) -> [T::Lanes; 6] {
    let at = BoxSpline::<T>::at(u, v);
    let [a, b, c] = [p[4], p[5], p[8]];
    let (ab, ac, cb) = (b - a, c - a, b - c);
    let orders = if SECOND { 6 } else { 3 };
    let zero = T::Lanes::default();
    let mut out = [a + ab * T::of(u) + ac * T::of(v), ab, ac, zero, zero, zero];
    // What is 0 is left out.
    let mut add = |offset: T::Lanes, weights: &[T], places: &[usize]| {
        for (&weight, &order) in weights.iter().zip(places) {
            if order < orders {
                out[order] = out[order] + offset * weight;
            }
        }
    };
    add(p[1] - b + ac, &at.opposite[0], &[0, 1, 2, 3, 4, 5]);
    add(p[7] - c + ab, &at.opposite[1], &[0, 1, 2, 3, 4, 5]);
    add(p[9] - b - ac, &at.opposite[2], &[0, 1, 2, 3, 4, 5]);
    add(p[3] - p[0] + cb, &at.turn_w, &[0, 1, 2, 3, 4, 5]);
    add(p[6] - p[2] - ac, &at.turn_u, &[0, 1, 2, 3, 4]);
    add(p[11] - p[10] - ab, &at.turn_v, &[0, 2, 1, 5, 4]);
    add(p[2] - b - cb, &at.cubes[1], &[0, 1, 3]);
    add(p[10] - c + cb, &at.cubes[2], &[0, 2, 5]);
    let offset = p[0] - a + ac;
    let [value, slope, bend] = at.cubes[0].map(|x| offset * x);
    let [position, du, dv, duu, duv, dvv] = out;
    [
        position + value,
        du - slope,
        dv - slope,
        duu + bend,
        duv + bend,
        dvv + bend,
    ]
}
