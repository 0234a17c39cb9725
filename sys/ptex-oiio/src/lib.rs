//! Ptex for OpenImageIO, through OpenImageIO's own extension point: any of its calls, and tools like `oiiotool` and
//! `maketx`, then read `.ptx`.
//!
//! A format is a C++ class for OpenImageIO: `c/ptex_input.cpp`. It calls the reader of `relievo-ptex` through the C
//! border `c/ptex_border.h`, which is implemented here. A program that links this crate hands [`EXTENSIONS`] and
//! [`ptex_input_imageio_create`] to `OIIO::declare_imageio_format`. As a library of its own, renamed to
//! `ptex.imageio.so`, the crate is a plugin: the symbols in [`plugin`] are what OpenImageIO looks up in one.

mod border;
pub mod plugin;

pub use plugin::{EXTENSIONS, NAME, ptex_imageio_library_version, ptex_input_imageio_create};

/// What bindgen reads from the headers.
#[allow(
    missing_docs,
    non_camel_case_types,
    non_upper_case_globals,
    unreachable_pub,
    dead_code,
    unused_qualifications,
    clippy::all,
    clippy::undocumented_unsafe_blocks
)]
mod sys {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}
