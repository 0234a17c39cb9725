//! Evaluating polynomial patches: sums of their points by the weights of [`super::basis`].

use std::ops::{Add, AddAssign, Mul};

use super::basis;
use crate::math::DVec3;

/// A floating-point type to store and evaluate in: single for rendering, double for reference.
///
/// Single precision costs, over all cages of the reference values and in units of a mesh's size (or of its distance
/// from the origin, if that is larger): 2e-7 of positions and 2e-5 of derivatives at worst, the latter within 2⁻⁵ of an
/// extraordinary vertex. On faces a few hundredths of the mesh wide that is 1e-3 of a derivative's length or of a unit
/// normal.
pub trait Real:
    Copy + Send + Sync + Default + Add<Output = Self> + Mul<Output = Self> + AddAssign + 'static
{
    /// The nearest value.
    fn of(value: f64) -> Self;
    /// The same value in double precision.
    fn get(self) -> f64;
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn get(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn get(self) -> f64 {
        self
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

impl<T: Real> FirstOrder<T> {
    fn of_lanes([position, du, dv]: [Lanes<T>; 3]) -> Self {
        let three = |[x, y, z, _]: Lanes<T>| [x, y, z];
        Self {
            position: three(position),
            du: three(du),
            dv: three(dv),
        }
    }
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
    pub(super) fn points(self) -> usize {
        match self {
            Self::Bicubic => 16,
            Self::BoxSpline => 12,
            Self::Bilinear => 4,
            Self::Linear => 3,
        }
    }

    /// Whether its face is a triangle.
    pub(super) fn is_triangular(self) -> bool {
        matches!(self, Self::BoxSpline | Self::Linear)
    }

    /// The weights of the points for position and derivatives.
    pub(super) fn weights(self, u: f64, v: f64) -> basis::Weights {
        match self {
            Self::Bicubic => basis::bicubic(u, v),
            Self::BoxSpline => basis::box_spline(u, v),
            Self::Bilinear => basis::bilinear(u, v),
            Self::Linear => basis::linear(u, v),
        }
    }
}

/// Evaluates a patch whose point `i` is `point(i)`.
pub(super) fn evaluate<T: Real>(
    kind: PatchKind,
    point: impl Fn(usize) -> [T; 3],
    u: f64,
    v: f64,
) -> LimitPoint<T> {
    match kind {
        PatchKind::Bicubic => bicubic(point, u, v),
        _ => {
            let w = kind.weights(u, v);
            let mut out = LimitPoint::default();
            for i in 0..kind.points() {
                let p = point(i);
                for (sum, weight) in [
                    (&mut out.position, w.p[i]),
                    (&mut out.du, w.u[i]),
                    (&mut out.dv, w.v[i]),
                    (&mut out.duu, w.uu[i]),
                    (&mut out.duv, w.uv[i]),
                    (&mut out.dvv, w.vv[i]),
                ] {
                    add(sum, T::of(weight), p);
                }
            }
            out
        }
    }
}

/// Rows first, then their sums: fewer products than by sixteen weights.
fn bicubic<T: Real>(point: impl Fn(usize) -> [T; 3], u: f64, v: f64) -> LimitPoint<T> {
    let [bu, du, duu] = basis::cubic(u).map(|w| w.map(T::of));
    let [bv, dv, dvv] = basis::cubic(v).map(|w| w.map(T::of));
    let mut out = LimitPoint::default();
    for j in 0..4 {
        let mut p = [T::default(); 3];
        let mut pu = [T::default(); 3];
        let mut puu = [T::default(); 3];
        for i in 0..4 {
            let q = point(4 * j + i);
            add(&mut p, bu[i], q);
            add(&mut pu, du[i], q);
            add(&mut puu, duu[i], q);
        }
        add(&mut out.position, bv[j], p);
        add(&mut out.du, bv[j], pu);
        add(&mut out.duu, bv[j], puu);
        add(&mut out.dv, dv[j], p);
        add(&mut out.duv, dv[j], pu);
        add(&mut out.dvv, dvv[j], p);
    }
    out
}

/// A point with a lane to spare: four fill a register.
pub(super) type Lanes<T> = [T; 4];

/// Evaluates a patch over the first of these points, with first derivatives only.
pub(super) fn first_order<T: Real>(
    kind: PatchKind,
    points: &[Lanes<T>; 16],
    u: f64,
    v: f64,
) -> FirstOrder<T> {
    match kind {
        PatchKind::Bicubic => bicubic_first(points, u, v),
        PatchKind::BoxSpline => weighted(points, &basis::box_spline_first(u, v)),
        PatchKind::Bilinear | PatchKind::Linear => {
            let w = kind.weights(u, v);
            weighted(points, &[w.p, w.u, w.v])
        }
    }
}

fn bicubic_first<T: Real>(points: &[Lanes<T>; 16], u: f64, v: f64) -> FirstOrder<T> {
    let [bu, du, _] = basis::cubic(u).map(|w| w.map(T::of));
    let [bv, dv, _] = basis::cubic(v).map(|w| w.map(T::of));
    let mut sums = [[T::default(); 4]; 3];
    for j in 0..4 {
        let row: &[Lanes<T>] = &points[4 * j..4 * j + 4];
        let mut p = [T::default(); 4];
        let mut pu = [T::default(); 4];
        for i in 0..4 {
            add_lanes(&mut p, bu[i], row[i]);
            add_lanes(&mut pu, du[i], row[i]);
        }
        add_lanes(&mut sums[0], bv[j], p);
        add_lanes(&mut sums[1], bv[j], pu);
        add_lanes(&mut sums[2], dv[j], p);
    }
    FirstOrder::of_lanes(sums)
}

fn weighted<T: Real, const N: usize>(
    points: &[Lanes<T>; 16],
    [p, du, dv]: &[[f64; N]; 3],
) -> FirstOrder<T> {
    let mut sums = [[T::default(); 4]; 3];
    for i in 0..N {
        add_lanes(&mut sums[0], T::of(p[i]), points[i]);
        add_lanes(&mut sums[1], T::of(du[i]), points[i]);
        add_lanes(&mut sums[2], T::of(dv[i]), points[i]);
    }
    FirstOrder::of_lanes(sums)
}

fn add_lanes<T: Real>(sum: &mut Lanes<T>, weight: T, p: Lanes<T>) {
    for (s, x) in sum.iter_mut().zip(p) {
        *s += weight * x;
    }
}

fn add<T: Real>(sum: &mut [T; 3], weight: T, p: [T; 3]) {
    for (s, x) in sum.iter_mut().zip(p) {
        *s += weight * x;
    }
}
