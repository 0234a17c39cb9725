//! Uniform refinement, one scheme a file.
//!
//! A scheme is two sets of masks: those of one refinement step and those that carry a point to the limit. Both are
//! written down once as `stencils::Stencils`, which then move points of every motion key and vertex primvars
//! alike.

pub mod loop_scheme;

mod edges;
mod stencils;
#[cfg(test)]
mod tests;
