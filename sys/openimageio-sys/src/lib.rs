//! A small C border over OpenImageIO: open an image and read its pixels, write a multi-part OpenEXR file or a PNG.
//!
//! The border, `c/oiio_border.h` with its comments, is C; behind it `c/oiio_border.cpp` is C++17 and catches
//! every exception. A call that fails returns a code and copies the reason into the caller's buffer. The
//! declarations here are generated from that header alone, never from OpenImageIO's.
#![allow(non_camel_case_types, non_upper_case_globals, clippy::all)]
include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
