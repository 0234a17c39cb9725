//! To follow.

pub mod light;
