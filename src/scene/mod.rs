//! Scene files into a plain [`Description`]. Builds nothing; what it hands out is checked.

mod description;
mod maps;
pub mod obj;
pub mod usd;

pub use description::*;

use std::path::Path;

use crate::error::{Error, Fault, Result};
use crate::memory::{SMALL_PIECES, amount, is_there, none_left};

/// Reads a scene by its file name's ending: `.usd`, `.usda`, `.usdc`, `.usdz` or `.obj`.
///
/// # Errors
/// Bad input, with file and prim, for a file that cannot be read, composed or checked; [`Error::Memory`] if the system has
/// no room for what is in it.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Description> {
    let ending = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
        .to_ascii_lowercase();
    let needed = expected_memory(path).saturating_add(SMALL_PIECES as u64);
    if !is_there(usize::try_from(needed).unwrap_or(usize::MAX)) {
        return Err(none_left(format!(
            "reading {} takes about {}",
            path.display(),
            amount(needed as f64)
        )));
    }
    match ending.as_str() {
        "usd" | "usda" | "usdc" | "usdz" => usd::load(path, options),
        "obj" => obj::load(path, options),
        _ => Err(Error::from(
            Fault::new(format!(
                "a scene file that ends in \"{ending}\" is not known"
            ))
            .in_file(path)
            .advise("relievo reads .usd, .usda, .usdc, .usdz and .obj"),
        )),
    }
}

/// Bytes that reading a scene takes, about: of text at most, as measured on large meshes, and of binary files at least, which
/// may hold textures too. Of files that it refers to nothing is known before it is read; 0 if it cannot be.
pub fn expected_memory(path: &Path) -> u64 {
    let length = std::fs::metadata(path).map_or(0, |file| file.len());
    let is_text = ["usda", "usd", "obj"]
        .iter()
        .any(|text| (path.extension()).is_some_and(|ending| ending.eq_ignore_ascii_case(text)));
    if is_text { length / 2 * 5 } else { length }
}
