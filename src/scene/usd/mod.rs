//! USD files.

use std::path::Path;

use crate::error::{Fault, Result};
use crate::scene::{Description, LoadOptions};

/// Reads a USD file.
///
/// # Errors
/// Bad input.
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Description> {
    Err(Fault::new("not read yet").in_file(path).into())
}
