//! OBJ files with OpenSubdiv's tags.

use std::path::Path;

use super::{Description, LoadOptions};
use crate::error::{Fault, Result};

/// Reads an OBJ file.
///
/// # Errors
/// Bad input.
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Description> {
    Err(Fault::new("not read yet").in_file(path).into())
}
