//! Any bytes as the text of an OBJ file.
#![no_main]

use std::path::Path;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = relievo::scene::obj::parse(bytes, Path::new("loop_fuzz.obj"));
});
