//! Lookups with every filter, anywhere, in meshes whose faces name each other at random and lie about it. `cargo test` runs the same on seeds that it
//! changes itself.
#![no_main]

#[path = "../../ptex/tests/fuzzed/lookups.rs"]
mod lookups;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| lookups::run(bytes));
