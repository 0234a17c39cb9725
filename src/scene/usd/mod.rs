//! USD files, read by the `openusd` crate and copied into a plain [`Description`].
//!
//! Nothing of the crate leaves this module. A file is opened on a thread of its own with a large stack,
//! because deep nesting costs stack; one traversal carries what is inherited down the tree.

mod attribute;
mod camera;
mod collect;
mod composition;
mod gprim;
mod instancer;
mod light;
mod material;
mod mesh;
mod motion;
mod nurbs;
mod primvar;
mod resolver;
mod settings;
mod texture;
mod tiles;
mod value;
mod walk;

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use openusd::usd::Stage;

use crate::error::{Error, Fault, Result};
use crate::math::Vec3;
use crate::memory::{SMALL_PIECES, is_there, none_left};
use crate::scene::{Description, LoadOptions};

/// Stack of the reading thread: virtual, touched only as deep as the file goes.
const STACK: usize = 512 << 20;

/// Reads a USD file: `.usd`, `.usda`, `.usdc` or `.usdz`.
///
/// # Errors
/// Bad input, with file and prim, for a file that is missing, damaged or does not compose, and for a mesh
/// that is none.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Description> {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    check_file(&path)?;
    let (file, options) = (path.clone(), options.clone());
    if !is_there(STACK + SMALL_PIECES) {
        return Err(none_left("the USD reader takes a thread of its own"));
    }
    let reader = std::thread::Builder::new()
        .name("usd".into())
        .stack_size(STACK)
        .spawn(move || read(&file, &options))
        .map_err(|e| Error::failed(format!("no thread to read USD on: {e}")))?;
    match reader.join() {
        Ok(result) => result,
        Err(panic) => {
            let what = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("unknown reason");
            Err(Fault::new(format!("the USD reader gave up: {what}"))
                .in_file(path)
                .advise("open and save the file with usdcat; if that works, report this file")
                .into())
        }
    }
}

/// Whether the file is there and holds anything: the crate's own words for that are less plain.
fn check_file(path: &Path) -> Result<(), Fault> {
    let length = std::fs::File::open(path)
        .and_then(|file| file.metadata())
        .map_err(|e| {
            Fault::new(format!("cannot be read: {e}"))
                .in_file(path)
                .advise("check the path and its permissions")
        })?
        .len();
    if length == 0 {
        return Err(Fault::new("the file is empty")
            .in_file(path)
            .advise("export it again"));
    }
    Ok(())
}

/// Everything, on the reading thread.
fn read(path: &Path, options: &LoadOptions) -> Result<Description> {
    let name = path
        .to_str()
        .ok_or_else(|| Fault::new("the file's name is not UTF-8").in_file(path))?;
    let stage = Stage::builder()
        .schema_registry(openusd_schemas::schema_registry())
        .resolver(resolver::Guarded::new())
        .open(name)
        .map_err(|e| {
            Fault::new(e.to_string().trim_end().to_owned())
                .in_file(path)
                .advise("if usdcat opens the file, convert it: usdcat FILE -o NEW.usdc; older spellings such as .5 for 0.5 are not read")
        })?;
    let mut reader = walk::Reader::new(stage, path, options);
    let mut out = reader.read()?;
    out.files = files(&reader.stage, path);
    reader.check_composition()?;
    out.warnings = std::mem::take(&mut reader.warnings);
    Ok(out)
}

/// Every layer's file, the root first, a package once.
fn files(stage: &Stage, root: &Path) -> Vec<PathBuf> {
    let mut files = vec![root.to_owned()];
    for identifier in stage.layer_identifiers() {
        let file = match openusd::ar::split_package_relative_path_outer(&identifier) {
            Some((package, _)) => package,
            None => identifier,
        };
        let file = PathBuf::from(file);
        let known = |f: &PathBuf| *f == file || f.canonicalize().ok() == file.canonicalize().ok();
        if !files.iter().any(known) {
            files.push(file);
        }
    }
    files
}

/// The stage's own metadata.
fn stage_metadata(stage: &Stage) -> (Vec3, f64) {
    let word = |key: &str| {
        stage
            .stage_metadata(key)
            .ok()
            .flatten()
            .and_then(value::word)
    };
    let up = match word("upAxis").as_deref() {
        Some("Z") => Vec3::Z,
        _ => Vec3::Y,
    };
    let meters = stage
        .stage_metadata("metersPerUnit")
        .ok()
        .flatten()
        .and_then(|v| value::number(&v))
        .filter(|m| m.is_finite() && *m > 0.0)
        .unwrap_or(0.01);
    (up, meters)
}
