//! A surface: a limit surface and its displacement, evaluated at points and over grids.
//!
//! Scalar displacement moves the limit point P to D = P + h n. Its derivatives hold those of the unit normal, which
//! the surface's second derivatives give (Weingarten's equations): with N = Pu × Pv,
//!
//! ```text
//!   Nu = Puu × Pv + Pu × Puv      nu = (Nu - n (n · Nu)) / |N|      Du = Pu + hu n + h nu
//! ```
//!
//! and likewise for v; the displaced normal is Du × Dv. Bump mapping (Blinn, "Simulation of Wrinkled Surfaces", 1978)
//! leaves the point and the term h nu out.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::adjacency::Adjacency;
use super::base::{Base, LimitPoint, Texcoord, UvRect};
use super::displace::{Amount, Displacement, DisplacementPoint, Slope, Space};
use super::tiles::Tiles;
use crate::error::Warnings;
use crate::math::{DVec3, Vec2, Vec3};

/// A displaced surface. Shared by all threads.
pub struct Surface {
    base: Arc<dyn Base>,
    displacement: Displacement,
    tiles: Option<Arc<Tiles>>,
    pub(super) adjacency: Adjacency,
    /// -1 where `du × dv` points to the back.
    pub(super) front: f32,
    has_texcoords: bool,
    non_finite: AtomicU64,
    degenerate: AtomicU64,
}

/// A point of a displaced surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DisplacedPoint {
    /// The displaced point.
    pub position: Vec3,
    /// Its derivative by u.
    pub du: Vec3,
    /// Its derivative by v.
    pub dv: Vec3,
    /// The displaced surface's unit normal, to the front; the limit surface's where the displaced one has none, and
    /// zero where neither has one.
    pub normal: Vec3,
    /// The limit point under it; its second derivatives may be missing where the surface is not displaced.
    pub limit: LimitPoint,
}

/// What a surface could not displace, counted at each evaluation. Such points stay where they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Faults {
    /// Displacements that were not finite numbers, or moved the point out of their range.
    pub non_finite: u64,
    /// Points without a normal to be displaced along.
    pub degenerate: u64,
}

impl Surface {
    /// A displaced surface.
    pub fn new(base: Arc<dyn Base>, displacement: Displacement) -> Self {
        Self {
            adjacency: Adjacency::new(&*base),
            front: if base.left_handed() { -1.0 } else { 1.0 },
            has_texcoords: base.faces() > 0 && base.texcoord(0, Vec2::ZERO).is_some(),
            base,
            displacement,
            tiles: None,
            non_finite: AtomicU64::new(0),
            degenerate: AtomicU64::new(0),
        }
    }

    /// The same with tiles of geometry over it, which are seen in its place. Points and normals of the surface are what
    /// they were.
    #[must_use]
    pub fn under(self, tiles: Arc<Tiles>) -> Self {
        Self {
            tiles: Some(tiles),
            ..self
        }
    }

    /// What stands over it and is seen in its place, if anything does.
    pub fn tiles(&self) -> Option<&Arc<Tiles>> {
        self.tiles.as_ref()
    }

    /// The same limit surface, displaced in another way.
    #[must_use]
    pub fn with_displacement(&self, displacement: Displacement) -> Self {
        Self::new(Arc::clone(&self.base), displacement)
    }

    /// The limit surface.
    pub fn base(&self) -> &dyn Base {
        &*self.base
    }

    /// The same limit surface without displacement.
    #[must_use]
    pub fn undisplaced(&self) -> Self {
        Self::new(self.base.clone(), Displacement::None)
    }

    /// Whether it has no border: two faces at each edge, no holes and nothing trimmed away.
    pub fn is_closed(&self) -> bool {
        let two = |edge| self.adjacency.edge(edge).len() == 2;
        let mut sides = (0..self.base.faces()).flat_map(|face| (0..4).map(move |k| (face, k)));
        let whole = !self.base.is_trimmed();
        whole
            && sides.all(|(face, k)| {
                !self.base.is_hole(face)
                    && (self.base.is_collapsed(face, k) || two(self.base.edge(face, k).edge))
            })
    }

    /// Whether a face is a parallelogram that parameters divide evenly, at all motion keys, and nothing displaces it: the two
    /// triangles of its corners are all of it, at the same parameters. To a millionth of its size; where the limit surface
    /// does not tell, it is not. Holes are.
    pub fn is_even(&self, face: u32) -> bool {
        let is_linear = |key| {
            let patch = self.base.bezier(face, &UvRect::UNIT, key);
            patch.is_some_and(|patch| patch.is_even())
        };
        let is_displaced = !matches!(self.displacement, Displacement::None);
        self.base.is_hole(face) || !is_displaced && (0..self.base.keys()).all(is_linear)
    }

    /// Whether all its faces [are](Self::is_even).
    pub fn is_even_everywhere(&self) -> bool {
        (0..self.base.faces()).all(|face| self.is_even(face))
    }

    /// How it is displaced.
    pub fn displacement(&self) -> &Displacement {
        &self.displacement
    }

    /// The displaced point of a face at parameters `uv`, at a motion key. On edges this is the face's own side; what
    /// faces share is in [`SharedSamples`](super::SharedSamples).
    #[inline]
    pub fn evaluate(&self, face: u32, uv: Vec2, key: u32) -> DisplacedPoint {
        if matches!(self.displacement, Displacement::None) {
            let limit = self.base.first_order(face, uv, key);
            if let Some(n) = unit_cross(limit.du.as_dvec3(), limit.dv.as_dvec3()) {
                return DisplacedPoint {
                    position: limit.position,
                    du: limit.du,
                    dv: limit.dv,
                    normal: self.front * n,
                    limit,
                };
            }
        }
        self.evaluate_displaced(face, uv, key)
    }

    /// The position alone, for less.
    pub fn position(&self, face: u32, uv: Vec2, key: u32) -> Vec3 {
        let whole = || self.evaluate(face, uv, key).position;
        let Displacement::Scalar(amount) = &self.displacement else {
            return whole();
        };
        let limit = self.base.first_order(face, uv, key);
        let Some(n) = unit_cross(limit.du.as_dvec3(), limit.dv.as_dvec3()) else {
            return whole();
        };
        let normal = self.front * n;
        let at = DisplacementPoint {
            face,
            uv,
            key,
            position: limit.position,
            normal,
            st: self.texcoord(face, uv).st,
        };
        let position = limit.position + amount.of(amount.map.value(&at)).x * normal;
        if position.is_finite() {
            position
        } else {
            whole()
        }
    }

    /// The same with second derivatives of the limit point.
    fn evaluate_displaced(&self, face: u32, uv: Vec2, key: u32) -> DisplacedPoint {
        let limit = self.base.evaluate(face, uv, key);
        let n = unit_normal(&limit, uv, self.front);
        let mut point = DisplacedPoint {
            position: limit.position,
            du: limit.du,
            dv: limit.dv,
            normal: n.unwrap_or(Vec3::ZERO),
            limit,
        };
        let (amount, space) = match &self.displacement {
            Displacement::None => return point,
            Displacement::Scalar(amount) => (amount, None),
            Displacement::Vector(amount, space) => (amount, Some(*space)),
        };
        if n.is_none() && space != Some(Space::Object) {
            self.degenerate.fetch_add(1, Ordering::Relaxed);
            return point;
        }
        let n = point.normal;
        let texcoord = self.texcoord(face, uv);
        let at = DisplacementPoint {
            face,
            uv,
            key,
            position: limit.position,
            normal: n,
            st: texcoord.st,
        };
        let (d, slope) = self.amount(amount, &at, &texcoord);
        let (moved, moved_u, moved_v) = match space {
            Some(Space::Object) => (d, slope.du, slope.dv),
            None => {
                let [nu, nv] = normal_derivatives(&limit, n, self.front);
                let (h, hu, hv) = (d.x, slope.du.x, slope.dv.x);
                (h * n, hu * n + h * nu, hv * n + h * nv)
            }
            Some(Space::Tangent) => {
                let [nu, nv] = normal_derivatives(&limit, n, self.front);
                let frame = Tangents::new(
                    [limit.du, limit.dv],
                    n,
                    self.front,
                    [texcoord.du, texcoord.dv],
                );
                let ([tu, bu], [tv, bv]) = frame.derivatives(&limit, n, [nu, nv], &texcoord);
                let in_frame = |d: Vec3| d.x * frame.t + d.y * frame.b + d.z * n;
                (
                    in_frame(d),
                    in_frame(slope.du) + d.x * tu + d.y * bu + d.z * nu,
                    in_frame(slope.dv) + d.x * tv + d.y * bv + d.z * nv,
                )
            }
        };
        let position = limit.position + moved;
        if !position.is_finite() {
            self.non_finite.fetch_add(1, Ordering::Relaxed);
            return point;
        }
        point.position = position;
        let (du, dv) = (limit.du + moved_u, limit.dv + moved_v);
        if du.is_finite() && dv.is_finite() {
            (point.du, point.dv) = (du, dv);
            if let Some(normal) = unit_cross(du.as_dvec3(), dv.as_dvec3()) {
                point.normal = self.front * normal;
            }
        }
        point
    }

    /// The unit shading normal of `point`, which this surface has at `uv` of `face`, under a bump map of heights.
    pub fn bumped_normal(
        &self,
        point: &DisplacedPoint,
        bump: &Amount,
        at: (u32, Vec2, u32),
    ) -> Vec3 {
        let (face, uv, key) = at;
        let texcoord = self.texcoord(face, uv);
        let at = DisplacementPoint {
            face,
            uv,
            key,
            position: point.limit.position,
            normal: point.normal,
            st: texcoord.st,
        };
        let (_, slope) = self.amount(bump, &at, &texcoord);
        let n = point.normal.as_dvec3();
        let (du, dv) = (point.du.as_dvec3(), point.dv.as_dvec3());
        let du = du + f64::from(slope.du.x) * n;
        let dv = dv + f64::from(slope.dv.x) * n;
        unit_cross(du, dv)
            .map(|normal| self.front * normal)
            .filter(|normal| normal.dot(point.normal) > 0.0)
            .unwrap_or(point.normal)
    }

    /// What could not be displaced so far.
    pub fn faults(&self) -> Faults {
        Faults {
            non_finite: self.non_finite.load(Ordering::Relaxed),
            degenerate: self.degenerate.load(Ordering::Relaxed),
        }
    }

    /// Tells of what could not be displaced so far; `name` is the surface's prim.
    pub fn report(&self, name: &str, warnings: &mut Warnings) {
        let Faults {
            non_finite,
            degenerate,
        } = self.faults();
        if non_finite > 0 {
            warnings.add(format!("non-finite displacement of {name}"), || {
                format!(
                    "{name}: {non_finite} displacements were not finite numbers; those points stay on the limit \
                     surface. Look for divisions by zero in the displacement's source."
                )
            });
        }
        if degenerate > 0 {
            warnings.add(format!("displacement of {name} without normal"), || {
                format!(
                    "{name}: {degenerate} points have no normal to be displaced along and stay on the limit surface. \
                     Look for points of the control mesh that coincide."
                )
            });
        }
    }

    /// Bytes held, beyond the control mesh and the textures themselves.
    pub fn memory(&self) -> usize {
        let map = match &self.displacement {
            Displacement::None => 0,
            Displacement::Scalar(amount) | Displacement::Vector(amount, _) => amount.map.memory(),
        };
        self.base.memory() + self.adjacency.memory() + map
    }

    pub(super) fn has_texcoords(&self) -> bool {
        self.has_texcoords
    }

    /// Texture coordinates, or the parameters in their place.
    pub(super) fn texcoord(&self, face: u32, uv: Vec2) -> Texcoord {
        let given = self.base.texcoord(face, uv);
        given.unwrap_or_else(|| Texcoord::of_parameters(uv))
    }

    pub(super) fn count_non_finite(&self, count: u64) {
        self.non_finite.fetch_add(count, Ordering::Relaxed);
    }

    pub(super) fn count_degenerate(&self, count: u64) {
        self.degenerate.fetch_add(count, Ordering::Relaxed);
    }

    /// The amount at a point, with its derivatives.
    fn amount(
        &self,
        amount: &Amount,
        at: &DisplacementPoint,
        texcoord: &Texcoord,
    ) -> (Vec3, Slope) {
        let value = amount.of(amount.map.value(at));
        let slope = amount
            .map
            .slope(at, texcoord)
            .unwrap_or_else(|| self.differences(amount, at));
        let scaled = Slope {
            du: amount.scale * slope.du,
            dv: amount.scale * slope.dv,
        };
        (value, scaled)
    }

    /// The slope of a map that cannot tell it. The step trades the curvature of the map against single precision.
    fn differences(&self, amount: &Amount, at: &DisplacementPoint) -> Slope {
        const STEP: f32 = 1.0 / 1024.0;
        let along = |axis: Vec2| {
            let low = (at.uv - STEP * axis).max(Vec2::ZERO);
            let high = (at.uv + STEP * axis).min(Vec2::ONE);
            let value = |uv: Vec2| {
                let limit = self.base.evaluate(at.face, uv, at.key);
                amount.map.value(&DisplacementPoint {
                    uv,
                    position: limit.position,
                    normal: unit_normal(&limit, uv, self.front).unwrap_or(Vec3::ZERO),
                    st: self.texcoord(at.face, uv).st,
                    ..*at
                })
            };
            (value(high) - value(low)) / (high - low).dot(axis)
        };
        Slope {
            du: along(Vec2::X),
            dv: along(Vec2::Y),
        }
    }
}

/// The unit normal at a limit point to the front. Where the first derivatives give none (the pole of a sphere, the tip
/// of a degenerate face), the limit of the normals from inside the face: those at a small step into it, in order of
/// the step's powers.
pub(super) fn unit_normal(point: &LimitPoint, uv: Vec2, front: f32) -> Option<Vec3> {
    let [du, dv, duu, duv, dvv] =
        [point.du, point.dv, point.duu, point.duv, point.dvv].map(|d| d.as_dvec3());
    let inward = |x: f32| if x < 0.5 { 1.0 } else { -1.0 };
    let (s, t) = (inward(uv.x), inward(uv.y));
    let (du1, dv1) = (s * duu + t * duv, s * duv + t * dvv);
    unit_cross(du, dv)
        .or_else(|| {
            let n = du1.cross(dv) + du.cross(dv1);
            let scale = du1.length() * dv.length() + du.length() * dv1.length();
            unit(n, scale * scale)
        })
        .or_else(|| unit_cross(du1, dv1))
        .map(|n| front * n)
}

/// Their unit cross product, unless they are parallel or one is zero.
fn unit_cross(a: DVec3, b: DVec3) -> Option<Vec3> {
    unit(a.cross(b), a.length_squared() * b.length_squared())
}

/// `n` normalised, if it is not a mere rounding of products whose size squared is `scale_squared`. Fourth powers of
/// single-precision numbers stay in the range of double precision.
fn unit(n: DVec3, scale_squared: f64) -> Option<Vec3> {
    let squared = n.length_squared();
    (squared > SINE * SINE * scale_squared && squared.is_finite())
        .then(|| (n / squared.sqrt()).as_vec3())
}

/// Vectors at less than this angle are parallel, radians: single precision does not know their cross product.
pub(super) const SINE: f64 = 1e-6;

/// The derivatives of the unit normal `n`.
fn normal_derivatives(p: &LimitPoint, n: Vec3, front: f32) -> [Vec3; 2] {
    let length = p.du.cross(p.dv).length();
    if length == 0.0 {
        return [Vec3::ZERO; 2];
    }
    let along = |du: Vec3, dv: Vec3| {
        let raw = front * (du.cross(p.dv) + p.du.cross(dv));
        (raw - n * n.dot(raw)) / length
    };
    [along(p.duu, p.duv), along(p.duv, p.dvv)]
}

/// The x and y directions of [`Space::Tangent`] at a point with these derivatives, where the texture coordinates have
/// those. `normal` is of unit length, to the front, and `left_handed` says that `du × dv` points to the back.
pub fn tangents(slopes: [Vec3; 2], normal: Vec3, left_handed: bool, st: [Vec2; 2]) -> [Vec3; 2] {
    let front = if left_handed { -1.0 } else { 1.0 };
    let frame = Tangents::new(slopes, normal, front, st);
    [frame.t, frame.b]
}

/// The unit directions of tangent space beside the normal.
pub(super) struct Tangents {
    pub(super) t: Vec3,
    pub(super) b: Vec3,
    /// Sign of the mapping from uv to st.
    sign: f32,
    /// Of the vector that `t` was normalised from; 0 where there was none.
    length: f32,
    front: f32,
}

impl Tangents {
    /// At a point with these derivatives and unit normal, and these derivatives of the texture coordinates.
    #[inline]
    pub(super) fn new([du, dv]: [Vec3; 2], n: Vec3, front: f32, [st_u, st_v]: [Vec2; 2]) -> Self {
        // Along s, t stays as it is: P_s is parallel to Pu tv - Pv tu.
        let sign = if st_u.perp_dot(st_v) < 0.0 { -1.0 } else { 1.0 };
        let along = sign * (du * st_v.y - dv * st_u.y);
        let length = along.length();
        if length > 0.0 && length.is_finite() {
            let t = along / length;
            let b = sign * front * n.cross(t);
            return Self {
                t,
                b,
                sign,
                length,
                front,
            };
        }
        let (t, b) = if n == Vec3::ZERO {
            (Vec3::ZERO, Vec3::ZERO)
        } else {
            n.any_orthonormal_pair()
        };
        Self {
            t,
            b,
            sign,
            length: 0.0,
            front,
        }
    }

    /// Derivatives of `t` and `b` by u, and by v.
    fn derivatives(
        &self,
        p: &LimitPoint,
        n: Vec3,
        dn: [Vec3; 2],
        st: &Texcoord,
    ) -> ([Vec3; 2], [Vec3; 2]) {
        if self.length == 0.0 {
            return ([Vec3::ZERO; 2], [Vec3::ZERO; 2]);
        }
        let along = |du: Vec3, dv: Vec3, st_u: Vec2, st_v: Vec2, dn: Vec3| {
            let raw = self.sign * (du * st.dv.y + p.du * st_v.y - dv * st.du.y - p.dv * st_u.y);
            let dt = (raw - self.t * self.t.dot(raw)) / self.length;
            let db = self.sign * self.front * (dn.cross(self.t) + n.cross(dt));
            [dt, db]
        };
        (
            along(p.duu, p.duv, st.duu, st.duv, dn[0]),
            along(p.duv, p.dvv, st.duv, st.dvv, dn[1]),
        )
    }
}
