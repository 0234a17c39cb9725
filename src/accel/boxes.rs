//! Sixteen boxes in a byte per plane.
//!
//! The bytes are in a frame of their own, whose origin is on the object's lattice and whose unit is a power of two of
//! lattice steps: decoding takes no rounding, and what encloses as integers encloses.

use bytemuck::{Pod, Zeroable};

use super::lattice::{Extent, LatticeRay};
use super::moment::Moment;
use super::simd::{LANES, Lanes};

/// 255 units of two to this power reach across the lattice.
const MOST_EXPONENT: i32 = 17;

/// Up to sixteen boxes of lattice points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Boxes {
    /// Planes axis by axis, in the frame.
    lower: [[u8; LANES]; 3],
    upper: [[u8; LANES]; 3],
    /// For each axis, the frame's origin in the upper 24 bits, and the exponent of its unit.
    frame: [i32; 3],
}

impl Boxes {
    /// Around the given boxes, some of which may be empty: rays may meet these too.
    pub(super) fn new(boxes: &[Extent; LANES]) -> Self {
        let all = boxes.iter().fold(Extent::EMPTY, |a, b| a.union(*b));
        let mut new = Self {
            lower: [[u8::MAX; LANES]; 3],
            upper: [[0; LANES]; 3],
            frame: [0; 3],
        };
        if all.is_empty() {
            return new;
        }
        for k in 0..3 {
            let unit = |e: u32| i64::from(u8::MAX) << e;
            let reach = i64::from(all.max[k]) - i64::from(all.min[k]);
            let exponent = (0..32)
                .find(|&e| unit(e) >= reach)
                .expect("coordinates have 24 bits");
            new.frame[k] = all.min[k] << 8 | exponent as i32;
            for (c, one) in boxes.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
                let up = (1 << exponent) - 1;
                new.lower[k][c] = ((one.min[k] - all.min[k]) >> exponent) as u8;
                new.upper[k][c] = ((one.max[k] - all.min[k] + up) >> exponent) as u8;
            }
        }
        new
    }

    /// Whether the units are ones that [`new`](Self::new) may choose: others overflow the arithmetic.
    pub(super) fn is_sound(&self) -> bool {
        self.frame.iter().all(|frame| frame & 0xff <= MOST_EXPONENT)
    }

    /// One of the boxes.
    pub(super) fn get(&self, c: usize) -> Extent {
        let plane = |bytes: &[[u8; LANES]; 3]| {
            [0, 1, 2].map(|k| {
                let exponent = self.frame[k] & 0xff;
                (self.frame[k] >> 8) + (i32::from(bytes[k][c]) << exponent)
            })
        };
        Extent {
            min: plane(&self.lower),
            max: plane(&self.upper),
        }
    }

    /// The boxes that a ray meets, as bits, and where it enters each.
    #[inline(always)]
    pub(super) fn met<L: Lanes>(
        &self,
        lanes: L,
        ray: &LatticeRay,
        entries: &mut [f32; LANES],
    ) -> u32 {
        meet(lanes, ray, entries, self.frame, Still(self))
    }

    /// The same for boxes on their way to others.
    #[inline(always)]
    pub(super) fn met_on_the_way<L: Lanes>(
        &self,
        to: &Self,
        moment: &Moment,
        lanes: L,
        ray: &LatticeRay,
        entries: &mut [f32; LANES],
    ) -> u32 {
        let from = self;
        meet(lanes, ray, entries, [0; 3], Moving { from, to, moment })
    }

    /// The planes that a ray meets first and last along an axis, of all boxes.
    #[inline(always)]
    fn planes<L: Lanes>(&self, lanes: L, k: usize, backwards: bool) -> [L::Floats; 2] {
        let (lower, upper) = (lanes.bytes(&self.lower[k]), lanes.bytes(&self.upper[k]));
        if backwards {
            [upper, lower]
        } else {
            [lower, upper]
        }
    }

    /// The same on the lattice.
    #[inline(always)]
    fn framed<L: Lanes>(&self, lanes: L, k: usize, backwards: bool) -> [L::Floats; 2] {
        let (origin, unit) = self.frame(k);
        let (origin, unit) = (lanes.floats(origin), lanes.floats(unit));
        let [first, last] = self.planes(lanes, k, backwards);
        [
            lanes.mul_add(first, unit, origin),
            lanes.mul_add(last, unit, origin),
        ]
    }

    /// The frame along an axis: its origin, and its unit in steps.
    #[inline(always)]
    fn frame(&self, k: usize) -> (f32, f32) {
        let frame = self.frame[k];
        let unit = f32::from_bits((127 + (frame as u32 & 0xff)) << 23);
        ((frame >> 8) as f32, unit)
    }
}

/// Boxes as a slab test asks for them. No closures: where these are not inlined, they are not compiled for the
/// instruction set.
trait Slabs<L: Lanes> {
    /// The planes that a ray meets first and last along an axis, along which it may run backwards.
    fn planes(&self, lanes: L, k: usize, backwards: bool) -> [L::Floats; 2];
}

struct Still<'a>(&'a Boxes);

impl<L: Lanes> Slabs<L> for Still<'_> {
    #[inline(always)]
    fn planes(&self, lanes: L, k: usize, backwards: bool) -> [L::Floats; 2] {
        self.0.planes(lanes, k, backwards)
    }
}

struct Moving<'a> {
    from: &'a Boxes,
    to: &'a Boxes,
    moment: &'a Moment,
}

impl<L: Lanes> Slabs<L> for Moving<'_> {
    #[inline(always)]
    fn planes(&self, lanes: L, k: usize, backwards: bool) -> [L::Floats; 2] {
        let [a, b] = self.from.framed(lanes, k, backwards);
        let [c, d] = self.to.framed(lanes, k, backwards);
        [
            self.moment.between_lanes(lanes, a, c),
            self.moment.between_lanes(lanes, b, d),
        ]
    }
}

/// The slab test. The planes are in `frames`: the origin in the upper 24 bits, and the exponent of the unit.
#[inline(always)]
fn meet<L: Lanes>(
    lanes: L,
    ray: &LatticeRay,
    entries: &mut [f32; LANES],
    frames: [i32; 3],
    slabs: impl Slabs<L>,
) -> u32 {
    // Planes as t = plane * scale + shift; for three axes and a spare one at once.
    let frames = [frames[0], frames[1], frames[2], 0];
    let four = |f: &dyn Fn(usize) -> f32| [f(0), f(1), f(2), f(3)];
    let scale = four(&|k| {
        // The unit is a power of two: it is added to the exponent.
        f32::from_bits(ray.inverse[k].to_bits() + ((frames[k] as u32 & 0xff) << 23))
    });
    let origin = four(&|k| (frames[k] >> 8) as f32);
    let enter = four(&|k| origin[k].mul_add(ray.inverse[k], ray.enter[k]));
    let leave = four(&|k| origin[k].mul_add(ray.inverse[k], ray.leave[k]));
    let mut near = lanes.floats(ray.t_min);
    let mut far = lanes.floats(ray.t_max);
    for k in 0..3 {
        let [first, last] = slabs.planes(lanes, k, ray.inverse[k] < 0.0);
        let scale = lanes.floats(scale[k]);
        near = lanes.max(near, lanes.mul_add(first, scale, lanes.floats(enter[k])));
        far = lanes.min(far, lanes.mul_add(last, scale, lanes.floats(leave[k])));
    }
    lanes.store(near, entries);
    lanes.less_equal(near, far)
}
