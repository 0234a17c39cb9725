//! What OpenImageIO looks up in a plugin for a format called `ptex`. The names are its own.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr;

use crate::sys;

/// The format's name.
pub const NAME: &CStr = c"ptex";

/// Endings of file names, with a null at the end.
#[repr(transparent)]
#[derive(Debug)]
pub struct Extensions([*const c_char; 3]);

// SAFETY: the pointers lead to constants, which all threads may read.
unsafe impl Sync for Extensions {}

impl Extensions {
    /// The list as C wants it. It lives as long as the program.
    #[must_use]
    pub fn as_ptr(&'static self) -> *const *const c_char {
        self.0.as_ptr()
    }
}

/// Endings of the names of Ptex files.
#[unsafe(export_name = "ptex_input_extensions")]
pub static EXTENSIONS: Extensions = Extensions([c"ptex".as_ptr(), c"ptx".as_ptr(), ptr::null()]);

/// The version of OpenImageIO's interface that this was compiled for. One with another does not load it.
#[unsafe(export_name = "ptex_imageio_version")]
pub static INTERFACE_VERSION: c_int = sys::OIIO_PLUGIN_VERSION as c_int;

/// What reads the files, and its version.
#[unsafe(no_mangle)]
pub extern "C" fn ptex_imageio_library_version() -> *const c_char {
    const VERSION: &str = concat!("relievo-ptex ", env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// A new reader: an `OIIO::ImageInput`, which OpenImageIO deletes; or null if there is no memory for it.
#[unsafe(no_mangle)]
pub extern "C" fn ptex_input_imageio_create() -> *mut c_void {
    // SAFETY: the function asks for nothing, and lets no exception out.
    unsafe { sys::ptex_input_new() }
}
