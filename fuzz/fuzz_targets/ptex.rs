//! Any bytes as a Ptex file, or as what is in its compressed blocks. `cargo test` runs the same on seeds that it
//! changes itself.
#![no_main]

#[path = "../../ptex/tests/fuzzed/file.rs"]
mod file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| file::run(bytes));
