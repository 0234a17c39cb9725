//! The lattice of an object, and rays within it.
//!
//! All micro-vertices of an object, at all motion keys, lie on one lattice of cubes: whatever two faces or two blocks
//! share they round to the same three integers, so that no crack can open between them, wherever the bits are stored.
//! Coordinates stay below 2^23, and single precision holds them exactly.

use crate::math::{Bounds3, DVec3, Ray, Vec3, Vec4};

/// Coordinates are less than this, either way.
pub(super) const REACH: i32 = 1 << 23;

/// Added to numbers below 2^51, it leaves no room for what is behind the point: the sum's last 32 bits are the integer.
const TO_INTEGERS: f64 = 1.5 * (1_u64 << 52) as f64;

/// Vertices of an object as integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice {
    /// Where the integers are zero, in the object's space.
    pub(super) anchor: Vec3,
    /// The length of one, above 0.
    pub(super) step: f32,
}

/// The nearest integers of numbers below 2^51.
#[inline]
fn integers(at: DVec3) -> [i32; 3] {
    (at + TO_INTEGERS)
        .to_array()
        .map(|sum| sum.to_bits() as i32)
}

/// A box of lattice points, both corners included; empty where `min` exceeds `max`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Extent {
    pub(super) min: [i32; 3],
    pub(super) max: [i32; 3],
}

impl Extent {
    pub(super) const EMPTY: Self = Self {
        min: [i32::MAX; 3],
        max: [i32::MIN; 3],
    };

    pub(super) fn is_empty(&self) -> bool {
        self.min[0] > self.max[0]
    }

    #[must_use]
    pub(super) fn including(self, p: [i32; 3]) -> Self {
        self.union(Self { min: p, max: p })
    }

    /// Around points, which lie less than [`REACH`] from zero.
    pub(super) fn around(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |all, p| {
            let [low, high] = [p.floor(), p.ceil()].map(|p| p.to_array().map(|x| x as i32));
            all.including(low).including(high)
        })
    }

    #[must_use]
    pub(super) fn union(self, other: Self) -> Self {
        let pick = |a: [i32; 3], b: [i32; 3], f: fn(i32, i32) -> i32| {
            [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
        };
        Self {
            min: pick(self.min, other.min, i32::min),
            max: pick(self.max, other.max, i32::max),
        }
    }
}

impl Lattice {
    /// Around what is within `bounds`, and as much again on all sides. Steps are `step` long if that is not too fine.
    pub(super) fn around(bounds: &Bounds3, step: f32) -> Self {
        // Half of the lattice is left for what displacement adds.
        let finest = bounds.extent().max_element() / REACH as f32;
        let step = if step > finest { step } else { finest };
        const LEAST: f32 = 1e-30;
        Self {
            anchor: if bounds.is_empty() {
                Vec3::ZERO
            } else {
                bounds.centre()
            },
            step: if step >= LEAST { step } else { LEAST },
        }
    }

    /// The nearest point of the lattice; none if it is beyond [`REACH`].
    pub(super) fn nearest(&self, p: Vec3) -> Option<[i32; 3]> {
        let at = self.on_lattice(p);
        let rounded = (at + TO_INTEGERS) - TO_INTEGERS;
        (rounded.abs().max_element() < f64::from(REACH)).then(|| integers(at))
    }

    /// The nearest point of the lattice that is not beyond [`REACH`].
    pub(super) fn nearest_within(&self, p: Vec3) -> [i32; 3] {
        let most = DVec3::splat(f64::from(REACH - 1));
        integers(self.on_lattice(p).clamp(-most, most))
    }

    /// Where a point of the lattice is in the object's space.
    pub(super) fn position(&self, p: [i32; 3]) -> DVec3 {
        let [x, y, z] = p.map(f64::from);
        self.anchor.as_dvec3() + self.step() * DVec3::new(x, y, z)
    }

    /// Where a point of the object's space is on the lattice.
    #[inline]
    pub(super) fn on_lattice(&self, p: Vec3) -> DVec3 {
        (p.as_dvec3() - self.anchor.as_dvec3()) / self.step()
    }

    /// A step in the object's space.
    #[inline]
    pub(super) fn step(&self) -> f64 {
        f64::from(self.step)
    }

    /// The box in the object's space, larger by two steps and some roundings: a ray that comes from a hundred
    /// diagonals away moves that much when it is rounded into the lattice.
    pub(super) fn bounds(&self, extent: &Extent) -> Bounds3 {
        if extent.is_empty() {
            return Bounds3::EMPTY;
        }
        let slack = |p: DVec3| 2.0 * self.step() + f64::from(f32::EPSILON) * p.abs();
        let (min, max) = (self.position(extent.min), self.position(extent.max));
        Bounds3 {
            min: (min - slack(min)).as_vec3(),
            max: (max + slack(max)).as_vec3(),
        }
    }
}

/// By whether the ray runs backwards along it, and the main axis: the axes, that one last, in an order that keeps
/// handedness.
const AXES: [[[usize; 3]; 3]; 2] = [
    [[1, 2, 0], [2, 0, 1], [0, 1, 2]],
    [[2, 1, 0], [0, 2, 1], [1, 0, 2]],
];

/// A ray in lattice coordinates, made ready for boxes and for the triangle test of [`triangle`](crate::accel::triangle).
#[derive(Debug, Clone, Copy)]
pub(super) struct LatticeRay {
    /// The fourth components are there for the sake of registers.
    pub(super) origin: [f32; 4],
    /// The largest component is 1 to 2; of either sign.
    pub(super) direction: [f32; 3],
    /// Axes: `k[2]` is the largest of the direction, the others follow so that handedness is kept.
    pub(super) k: [usize; 3],
    /// Shear along the first two, and scale along the third, which leads to the ray's own `t`.
    pub(super) s: [f32; 3],
    /// One by the direction, whose smallest components are replaced by such as have an inverse.
    pub(super) inverse: [f32; 4],
    /// What rounding may move a box's plane or a triangle, in steps, with the signs of the direction.
    pub(super) slack: [f32; 4],
    /// For the planes of boxes, what is to be added to a coordinate times `inverse` where the ray comes in, and where it goes
    /// out: less than the coordinate's distance by the slack, and more.
    pub(super) enter: [f32; 4],
    pub(super) leave: [f32; 4],
    /// The interval that is asked about, rounded outward.
    pub(super) t_min: f32,
    pub(super) t_max: f32,
    /// What `t` is here for a `t` of 1 of the ray's own.
    pub(super) per_t: f32,
}

impl LatticeRay {
    /// `reach` is the largest coordinate of what the ray may meet.
    #[inline(always)]
    pub(super) fn new(lattice: &Lattice, ray: &Ray, reach: f32) -> Self {
        let origin = (ray.origin - lattice.anchor).extend(0.0) * (1.0 / lattice.step);
        // The largest component of the direction is brought to 1..2, by a power of two that `t` can bear.
        let d = ray.direction.extend(0.0);
        let exponent = ((d.abs().max_element().to_bits() >> 23) as i32 - 127).clamp(-126, 126);
        let power = |e: i32| f32::from_bits(((127 + e) as u32) << 23);
        let (shrink, grow) = (power(-exponent), power(exponent));
        let d = d * shrink;
        const LEAST: f32 = 1.0 / (1_u64 << 40) as f32;
        let least = Vec4::splat(LEAST);
        let inverse = 1.0 / Vec4::select(d.abs().cmplt(least), least.copysign(d), d);
        let inverse = inverse.with_w(1.0);
        let direction = d.to_array();
        let size = d.abs().to_array();
        let kz = usize::from(size[1] > size[0]);
        let kz = if size[2] > size[kz] { 2 } else { kz };
        let k = AXES[usize::from(direction[kz] < 0.0)][kz];
        let [kx, ky, _] = k;
        // A plane's distance takes three products and sums, of which one or the other is fused; a vertex is translated and
        // sheared: each moves by less than 8 roundings of the sizes involved.
        let slack = 16.0 * f32::EPSILON * (origin.abs().max_element() + reach);
        let t_scale = lattice.step * shrink;
        let per_t = grow / lattice.step;
        let inverse_array = inverse.to_array();
        let slack = Vec4::splat(slack).copysign(inverse);
        let [enter, leave] = within(origin, slack, inverse);
        Self {
            enter,
            leave,
            origin: origin.to_array(),
            direction: d.truncate().to_array(),
            k,
            // The third one gives the ray's own t.
            s: [direction[kx], direction[ky], t_scale].map(|x| x * inverse_array[kz]),
            slack: slack.to_array(),
            inverse: inverse_array,
            t_min: ray.t_min * per_t * (1.0 - 4.0 * f32::EPSILON),
            t_max: ray.t_max * per_t * (1.0 + 4.0 * f32::EPSILON),
            per_t,
        }
    }

    /// Meets boxes that are larger by so many steps along each axis.
    #[inline(always)]
    pub(super) fn widen(&mut self, by: [f32; 3]) {
        for (slack, by) in self.slack.iter_mut().zip(by) {
            *slack += by.copysign(*slack);
        }
        let all = [self.origin, self.slack, self.inverse].map(Vec4::from_array);
        [self.enter, self.leave] = within(all[0], all[1], all[2]);
    }

    /// Ends the interval at the ray's own `t`.
    #[inline(always)]
    pub(super) fn end(&mut self, t: f32) {
        self.t_max = t * self.per_t * (1.0 + 4.0 * f32::EPSILON);
    }
}

/// [`LatticeRay::enter`] and [`LatticeRay::leave`].
#[inline(always)]
fn within(origin: Vec4, slack: Vec4, inverse: Vec4) -> [[f32; 4]; 2] {
    [-(origin + slack), slack - origin].map(|from| (from * inverse).to_array())
}
