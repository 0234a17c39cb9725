//! x
pub mod albedo;
