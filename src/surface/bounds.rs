//! Certified bounds of the displaced surface over a rectangle of a face. There is no bound parameter anywhere.
//!
//! A displaced point is a limit point plus a displacement, so a box around each of the two gives one around the sum.
//! The limit points have the base's hull. A scalar displacement is an interval of heights, from the map's own bound,
//! times a box of unit normals. Those lie in a cone: with the rectangle as a Bezier patch, the normal Pu × Pv is a
//! patch of degree five in either direction, its control vectors span a convex cone that holds all its values, and a
//! circular cone around these holds them, too (Sederberg and Meyers, "Loop Detection in Surface Patch Intersections",
//! 1988, bound each derivative by a cone of its own instead). Where a rectangle touches the border of its face, what
//! the faces share there ([`SharedSamples`](super::SharedSamples)) is bounded as well.
//!
//! All is rounded outward: the cone is widened by what single precision may turn a normal.

use super::base::UvRect;
use super::displace::{Amount, Displacement, Region, Space};
use super::evaluate::{SINE, Surface};
use super::shared::Scratch;
use crate::math::{Bounds3, DVec3, Vec2, Vec3};

/// How often a rectangle is quartered in search of patches whose normals lie in a narrow cone.
const DEPTH: u32 = 2;

/// Cones wider than this are worth quartering the rectangle: the cosine of half their angle.
const NARROW: f64 = 0.8;

/// How deep the strips along an edge are whose normals bound those on it; a part of the face.
const STRIP: f32 = 1.0 / 32.0;

impl Surface {
    /// A box around all displaced points of a rectangle of a face at a motion key, rounded outward, with the points
    /// that it shares with its neighbours; empty for a hole. `None` if the displacement's source is certain of no bound; the surface has
    /// to be diced then.
    ///
    /// Micro-vertices are snapped along the edges of their faces: bound those of a part of a grid by themselves.
    pub fn bounds(&self, face: u32, rect: &UvRect, key: u32) -> Option<Bounds3> {
        if self.base().is_hole(face) {
            return Some(Bounds3::EMPTY);
        }
        let mut bounds = self.inner_bounds(face, rect, key, DEPTH)?;
        let mut scratch = Scratch::default();
        let touches = [
            rect.min.y <= 0.0,
            rect.max.x >= 1.0,
            rect.max.y >= 1.0,
            rect.min.x <= 0.0,
        ];
        for k in (0..4).filter(|&k| touches[k as usize]) {
            bounds = bounds.union(self.edge_bounds(face, k, rect, key)?);
            if touches[(k as usize + 3) % 4] {
                let vertex = self.base().vertex(face, k);
                bounds = bounds.including(self.vertex_point(vertex, key, &mut scratch));
            }
        }
        Some(bounds)
    }

    /// Of the face's own points.
    fn inner_bounds(&self, face: u32, rect: &UvRect, key: u32, depth: u32) -> Option<Bounds3> {
        let (moved, narrow) = self.displacement_bounds(face, rect, rect, key)?;
        if narrow || depth == 0 {
            return Some(sum(self.base().hull(face, rect, key), moved));
        }
        rect.quarters()
            .iter()
            .try_fold(Bounds3::EMPTY, |all, quarter| {
                Some(all.union(self.inner_bounds(face, quarter, key, depth - 1)?))
            })
    }

    /// Of the shared points of edge `k` as far as it lies in `rect`.
    fn edge_bounds(&self, face: u32, k: u32, rect: &UvRect, key: u32) -> Option<Bounds3> {
        // The part of the edge in its own direction; going over to 1 - t and back may round.
        let along = if k.is_multiple_of(2) {
            [rect.min.x, rect.max.x]
        } else {
            [rect.min.y, rect.max.y]
        };
        let flipped = |[a, b]: [f32; 2], flip: bool| if flip { [1.0 - b, 1.0 - a] } else { [a, b] };
        let [from, to] = flipped(along, k >= 2);
        let used = self.base().edge(face, k);
        let [from, to] = flipped(
            [(from - f32::EPSILON).max(0.0), (to + f32::EPSILON).min(1.0)],
            used.reversed,
        );

        let mut limit = Bounds3::EMPTY;
        let (mut low, mut high, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        for side in self.adjacency.edge(used.edge) {
            let walked = flipped([from, to], side.reversed);
            let line = strip(side.k, walked, 0.0);
            if limit.is_empty() {
                limit = self.base().hull(side.face, &line, key);
            }
            let thick = strip(side.k, walked, STRIP);
            let (moved, _) = self.displacement_bounds(side.face, &line, &thick, key)?;
            (low, high, count) = (low + moved.min, high + moved.max, count + 1.0);
        }
        let mean = widened(
            Bounds3 {
                min: low / count,
                max: high / count,
            },
            count,
        );
        Some(sum(limit, mean))
    }

    /// A box around the displacements in `rect`, and whether quartering it would do little good. The normals are those
    /// of `around`, a part of the face that holds `rect`.
    fn displacement_bounds(
        &self,
        face: u32,
        rect: &UvRect,
        around: &UvRect,
        key: u32,
    ) -> Option<(Bounds3, bool)> {
        let amounts = |amount: &Amount| {
            let st = if self.has_texcoords() {
                self.base().texcoord_hull(face, rect)
            } else {
                Some(*rect)
            };
            let region = Region {
                face,
                rect: *rect,
                st,
            };
            debug_assert!(rect.min.cmple(rect.max).all(), "{rect:?}");
            amount.bound(&region).filter(|bounds| !bounds.is_empty())
        };
        match self.displacement() {
            Displacement::None => Some((Bounds3::of([Vec3::ZERO]), true)),
            Displacement::Scalar(amount) => {
                let heights = amounts(amount)?;
                Some(self.along_normal(face, around, key, [heights.min.x, heights.max.x]))
            }
            Displacement::Vector(amount, Space::Object) => Some((amounts(amount)?, true)),
            Displacement::Vector(amount, Space::Tangent) => {
                let box_ = amounts(amount)?;
                let (along, narrow) =
                    self.along_normal(face, around, key, [box_.min.z, box_.max.z]);
                // The other two directions are anywhere across.
                let most = box_.min.abs().max(box_.max.abs());
                let radius = Vec3::splat(most.truncate().length() * (1.0 + 8.0 * f32::EPSILON));
                let across = Bounds3 {
                    min: -radius,
                    max: radius,
                };
                Some((sum(along, across), narrow))
            }
        }
    }

    /// A box around heights times normals.
    fn along_normal(
        &self,
        face: u32,
        around: &UvRect,
        key: u32,
        [low, high]: [f32; 2],
    ) -> (Bounds3, bool) {
        if low == 0.0 && high == 0.0 {
            return (Bounds3::of([Vec3::ZERO]), true);
        }
        let cone = self.normal_cone(face, around, key);
        let normals = cone.as_ref().map_or(
            Bounds3 {
                min: Vec3::splat(-1.0 - f32::EPSILON),
                max: Vec3::splat(1.0 + f32::EPSILON),
            },
            Cone::unit_vectors,
        );
        let products = [
            low * normals.min,
            low * normals.max,
            high * normals.min,
            high * normals.max,
        ];
        let narrow = cone.is_some_and(|cone| cone.cos > NARROW);
        (widened(Bounds3::of(products), 1.0), narrow)
    }

    /// A cone around the unit normals to the front that evaluations in a part of a face may give.
    fn normal_cone(&self, face: u32, rect: &UvRect, key: u32) -> Option<Cone> {
        let patch = self.base().bezier(face, rect, key)?.0;
        let largest = patch
            .iter()
            .fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
        let p = patch.map(|p| p.as_dvec3());
        // Derivatives, but for a factor: degree 2 and 3 in u and v, and 3 and 2.
        let du: [[DVec3; 3]; 4] =
            std::array::from_fn(|r| std::array::from_fn(|c| p[4 * r + c + 1] - p[4 * r + c]));
        let dv: [[DVec3; 4]; 3] =
            std::array::from_fn(|r| std::array::from_fn(|c| p[4 * r + 4 + c] - p[4 * r + c]));
        let normals = product(&du, &dv).map(|n| f64::from(self.front) * n);

        // How far rounding may move a normal: an error of each derivative, and that of their cross product.
        let epsilon = f64::from(f32::EPSILON);
        let error = 32.0 * epsilon * f64::from(largest);
        let longest = |vectors: &[DVec3]| vectors.iter().fold(0.0, |m: f64, v| m.max(v.length()));
        let (a, b) = (longest(du.as_flattened()), longest(dv.as_flattened()));
        let moved = error * (a + b + error) + 8.0 * epsilon * a * b;
        let cone = Cone::around(&normals)?;
        let shortest = normals
            .iter()
            .fold(f64::INFINITY, |m, n| m.min(cone.axis.dot(*n)));
        // Where the derivatives are all but parallel, normals are found in another way.
        if shortest <= 4.0 * SINE * a * b || shortest <= moved {
            return None;
        }
        cone.widened(moved / shortest)
    }
}

/// Points `depth` deep along edge `k` of a face, as far as it is walked from corner `k`.
fn strip(k: u32, [from, to]: [f32; 2], depth: f32) -> UvRect {
    let (a, b) = if k < 2 {
        (from, to)
    } else {
        (1.0 - to, 1.0 - from)
    };
    let (low, high) = if k == 0 || k == 3 {
        (0.0, depth)
    } else {
        (1.0 - depth, 1.0)
    };
    let (min, max) = (Vec2::new(a, low), Vec2::new(b, high));
    if k.is_multiple_of(2) {
        UvRect { min, max }
    } else {
        UvRect {
            min: Vec2::new(min.y, min.x),
            max: Vec2::new(max.y, max.x),
        }
    }
}

/// The Bernstein coefficients of the cross product of two patches of degrees (2, 3) and (3, 2).
fn product(du: &[[DVec3; 3]; 4], dv: &[[DVec3; 4]; 3]) -> [DVec3; 36] {
    const TWO: [f64; 3] = [1.0, 2.0, 1.0];
    const THREE: [f64; 4] = [1.0, 3.0, 3.0, 1.0];
    const FIVE: [f64; 6] = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0];
    let mut normals = [DVec3::ZERO; 36];
    for (r, row_a) in du.iter().enumerate() {
        for (s, row_b) in dv.iter().enumerate() {
            for (i, &a) in row_a.iter().enumerate() {
                for (j, &b) in row_b.iter().enumerate() {
                    let weight = THREE[r] * TWO[s] / FIVE[r + s] * TWO[i] * THREE[j] / FIVE[i + j];
                    normals[6 * (r + s) + i + j] += weight * a.cross(b);
                }
            }
        }
    }
    normals
}

/// All directions within an angle of less than a right one from an axis.
struct Cone {
    /// Unit.
    axis: DVec3,
    /// The angle's cosine.
    cos: f64,
}

impl Cone {
    /// Around vectors none of which is zero, if there is one.
    fn around(vectors: &[DVec3]) -> Option<Self> {
        let axis = vectors
            .iter()
            .map(|v| v.normalize_or_zero())
            .sum::<DVec3>()
            .try_normalize()?;
        let cos = vectors
            .iter()
            .fold(1.0, |cos: f64, v| cos.min(axis.dot(v.normalize_or_zero())));
        (cos > 0.0).then_some(Self { axis, cos })
    }

    /// By an angle of the given sine.
    fn widened(self, sine: f64) -> Option<Self> {
        let cos = (1.0 - sine * sine).max(0.0).sqrt();
        let own_sine = (1.0 - self.cos * self.cos).max(0.0).sqrt();
        let cos = self.cos * cos - own_sine * sine - 1e-12;
        (cos > 0.0).then_some(Self { cos, ..self })
    }

    /// A box around its unit vectors, as single precision has them.
    fn unit_vectors(&self) -> Bounds3 {
        let sin = (1.0 - self.cos * self.cos).max(0.0).sqrt();
        let slack = 4.0 * f64::from(f32::EPSILON);
        let mut bounds = Bounds3::EMPTY;
        for axis in 0..3 {
            let a = self.axis[axis];
            let across = (1.0 - a * a).max(0.0).sqrt();
            // Where the cone holds the coordinate axis itself, it reaches 1.
            let high = if a >= self.cos {
                1.0
            } else {
                a * self.cos + across * sin
            };
            let low = if -a >= self.cos {
                -1.0
            } else {
                a * self.cos - across * sin
            };
            bounds.min[axis] = (low - slack) as f32;
            bounds.max[axis] = (high + slack) as f32;
        }
        bounds
    }
}

/// Around all sums of a point of either box, rounding of the sum included.
fn sum(a: Bounds3, b: Bounds3) -> Bounds3 {
    widened(
        Bounds3 {
            min: a.min + b.min,
            max: a.max + b.max,
        },
        1.0,
    )
}

/// By a few roundings of its numbers.
fn widened(b: Bounds3, roundings: f32) -> Bounds3 {
    let largest = b.min.abs().max(b.max.abs());
    let slack = (1.0 + roundings) * f32::EPSILON * largest + f32::MIN_POSITIVE;
    Bounds3 {
        min: b.min - slack,
        max: b.max + slack,
    }
}
