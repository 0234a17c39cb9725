//! Numbers as arguments, and what to say of others.

use relievo_ptex::MAX_LOG2;

/// Any number above 0.
pub(super) fn above_zero(word: &str) -> Result<f64, String> {
    let number = word.parse().ok();
    number
        .filter(|n: &f64| n.is_finite() && *n > 0.0)
        .ok_or_else(|| "a number above 0".to_owned())
}

/// The logarithm of a power of two that a Ptex face may have texels along a side.
pub(super) fn log2(word: &str) -> Option<i8> {
    let number: Option<u32> = word.parse().ok();
    let number = number.filter(|n| n.is_power_of_two() && *n <= 1 << MAX_LOG2);
    number.map(|n| n.ilog2() as i8)
}
