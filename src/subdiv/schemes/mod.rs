//! The schemes, one file each.
//!
//! Catmull-Clark, Loop and bilinear are masks for [`crate::subdiv::refine()`] and [`crate::subdiv::LimitSurface`]. The
//! classical ones are behind [`classic::refine`] and [`classic_limit::refine_to_limit`]; curves have [`chaikin`].

pub mod chaikin;
pub mod chaikin_page;
pub mod classic;
pub mod classic_limit;
pub mod doo_sabin_limit;
pub mod sqrt3;

pub(in crate::subdiv) mod bilinear;
pub(in crate::subdiv) mod catmull_clark;
pub(in crate::subdiv) mod loop_scheme;

mod butterfly;
mod doo_sabin;
mod sharp;

#[cfg(test)]
mod classic_tests;
#[cfg(test)]
mod doo_sabin_tests;
