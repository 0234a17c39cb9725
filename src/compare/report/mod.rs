//! What was measured, as a page to look at: one file of HTML with its plots in it, and the figures as JSON beside it.
//!
//! The page is well-formed XML, too. It has no scripts, takes the reader's choice of light or dark, and prints in light.

mod labels;
mod page;
mod plots;

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::bench::Bench;
use crate::error::{Error, Result};
use crate::image::{check_destination, write_whole};

/// A scene and what was measured on it.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// The scene, as its reader knows it.
    pub scene: String,
    /// The figures.
    #[serde(flatten)]
    pub bench: Bench,
}

/// Whether a report can be written to `path`, as far as that shows without writing: call it before measuring.
///
/// # Errors
/// A usage error if the page and its copy would have one name, a failure if there is no such folder.
pub fn check_report(path: &Path) -> Result<()> {
    if copy_of(path) == path {
        return Err(Error::usage(
            format!("{} is where the figures go", path.display()),
            "give the page another ending, as .html",
        ));
    }
    check_destination(path)?;
    check_destination(&copy_of(path))
}

/// Writes the page to `path` and the figures beside it, with the ending `.json`.
///
/// # Errors
/// As [`check_report`] has them, or if there is no room.
pub fn write_report(path: &Path, all: &[Measured]) -> Result<()> {
    check_report(path)?;
    write_text(&copy_of(path), &report_json(all))?;
    write_text(path, &page::page(all)?)
}

/// One scene as one object, several as an array; with a newline.
pub fn report_json(all: &[Measured]) -> String {
    let text = match all {
        [one] => serde_json::to_string(one),
        all => serde_json::to_string(all),
    };
    text.expect("strings and numbers only") + "\n"
}

fn copy_of(path: &Path) -> PathBuf {
    path.with_extension("json")
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    write_whole(path, |temporary| {
        std::fs::write(temporary, text)
            .map_err(|e| Error::failed(format!("cannot write {}: {e}", path.display())))
    })
}
