//! Numbers that are the same each time: a counter, mixed (Steele, Lea, Flood, "Fast Splittable Pseudorandom Number
//! Generators", 2014).

use crate::math::Vec3;

/// A stream of numbers of its own for each seed.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0xD134_2543_DE82_EF95))
    }

    /// In 0..1.
    pub(super) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    }

    /// Evenly over the unit sphere.
    pub(super) fn direction(&mut self) -> Vec3 {
        let z = 2.0 * self.next() - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * self.next()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    }
}
