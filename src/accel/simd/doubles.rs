//! Eight lanes of double precision, for what is done once for a ray and a quad.

use super::Portable;

/// Lanes of double precision.
pub(in crate::accel) const EIGHT: usize = 8;

/// Operations on eight lanes of double precision. They are those of IEEE 754 one by one; what is fused says so.
pub(in crate::accel) trait Doubles: Copy {
    /// Eight numbers.
    type Doubles: Copy;

    /// The same in all lanes.
    fn doubles(self, value: f64) -> Self::Doubles;
    /// One by one.
    fn load_doubles(self, values: &[f64; EIGHT]) -> Self::Doubles;
    /// One by one.
    fn store_doubles(self, values: Self::Doubles, to: &mut [f64; EIGHT]);
    fn add_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    fn sub_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    fn mul_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    fn div_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    /// `a b - c`, rounded once.
    fn mul_sub_doubles(self, a: Self::Doubles, b: Self::Doubles, c: Self::Doubles)
    -> Self::Doubles;
    /// The square root of the greater of this and 0, and 0 of what is no number.
    fn root_doubles(self, a: Self::Doubles) -> Self::Doubles;
    /// Numbers that are not negative, with the signs of others.
    fn with_signs(self, a: Self::Doubles, signs: Self::Doubles) -> Self::Doubles;
    /// A bit for each lane where `a < b`.
    fn less_doubles(self, a: Self::Doubles, b: Self::Doubles) -> u32;
    /// For each lane the lane of `table` that its number, below eight, names.
    fn pick_doubles(self, numbers: &[i64; EIGHT], table: Self::Doubles) -> Self::Doubles;
}

impl Doubles for Portable {
    type Doubles = [f64; EIGHT];

    #[inline(always)]
    fn doubles(self, value: f64) -> [f64; EIGHT] {
        [value; EIGHT]
    }
    #[inline(always)]
    fn load_doubles(self, values: &[f64; EIGHT]) -> [f64; EIGHT] {
        *values
    }
    #[inline(always)]
    fn store_doubles(self, values: [f64; EIGHT], to: &mut [f64; EIGHT]) {
        *to = values;
    }
    #[inline(always)]
    fn add_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn div_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn mul_sub_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT], c: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i].mul_add(b[i], -c[i]))
    }
    #[inline(always)]
    fn root_doubles(self, a: [f64; EIGHT]) -> [f64; EIGHT] {
        a.map(|a| if a > 0.0 { a } else { 0.0 }.sqrt())
    }
    #[inline(always)]
    fn with_signs(self, a: [f64; EIGHT], signs: [f64; EIGHT]) -> [f64; EIGHT] {
        std::array::from_fn(|i| a[i].copysign(signs[i]))
    }
    #[inline(always)]
    fn less_doubles(self, a: [f64; EIGHT], b: [f64; EIGHT]) -> u32 {
        (0..EIGHT).fold(0, |bits, i| bits | u32::from(a[i] < b[i]) << i)
    }
    #[inline(always)]
    fn pick_doubles(self, numbers: &[i64; EIGHT], table: [f64; EIGHT]) -> [f64; EIGHT] {
        numbers.map(|n| table[n as usize % EIGHT])
    }
}
