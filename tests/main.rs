//! The tests that see the whole program: one binary, a module for each belief.
//!
//! Tests that need the shared scenes and reference values run where `RELIEVO_SHARED` names their folder.
#![allow(
    clippy::print_stdout,
    reason = "tests say what they skipped and measured"
)]
#![allow(unreachable_pub, reason = "a test binary has no outside")]

mod atlas;
mod bake;
mod budget;
mod common;
mod compare;
mod displaced;
mod embree_agrees;
mod errors;
mod eval;
mod faults;
mod footprints;
mod furnace;
mod gprims;
mod inlined;
mod layers;
mod lights;
mod manners;
mod methods;
mod pictures;
mod ptex;
mod ptex_convert;
mod ptex_scene;
mod refused;
mod report;
mod scenes;
mod smooth;
mod stored;
mod subdiv_oracle;
mod subdivide;
mod tiles;
mod usd_oracle;
