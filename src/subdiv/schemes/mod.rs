//! Uniform refinement, one scheme a file.
//!
//! A scheme is two sets of masks: those of one refinement step and those that carry a point to the limit. Both are
//! written down once as `stencils::Stencils`, which then move points of every motion key and vertex primvars
//! alike.

pub mod chaikin;
pub mod chaikin_page;
pub mod classic;
pub mod doo_sabin_limit;
pub mod loop_scheme;
pub mod sqrt3;

mod butterfly;
#[cfg(test)]
mod classic_tests;
mod doo_sabin;
#[cfg(test)]
mod doo_sabin_tests;
mod edges;
mod sharp;
mod stencils;
#[cfg(test)]
mod tests;
