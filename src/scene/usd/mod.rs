//! USD files, read by the `openusd` crate and copied into a plain [`Description`].
//!
//! Nothing of the crate leaves this module. A file is opened on a thread of its own with a large stack,
//! because deep nesting costs stack; one traversal carries what is inherited down the tree.

mod attribute;
mod camera;
mod collect;
mod instancer;
mod light;
mod material;
mod mesh;
mod motion;
mod nurbs;
mod primvar;
mod settings;
mod texture;
mod value;
mod walk;

#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::{Path, PathBuf};

use openusd::usd::Stage;

use crate::error::{Error, Fault, Result};
use crate::math::Vec3;
use crate::scene::{Description, LoadOptions};

/// Stack of the reading thread: virtual, touched only as deep as the file goes.
const STACK: usize = 512 << 20;
/// Braces of a text file may nest this deep.
const MAX_NESTING: usize = 1000;

/// Reads a USD file: `.usd`, `.usda`, `.usdc` or `.usdz`.
///
/// # Errors
/// Bad input, with file and prim, for a file that is missing, damaged or does not compose, and for a mesh
/// that is none.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Description> {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    check_file(&path)?;
    let (file, options) = (path.clone(), options.clone());
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

/// Whether the file is there, and does not nest deeper than the crate's recursion stands.
fn check_file(path: &Path) -> Result<(), Fault> {
    let fault = |e: std::io::Error| Fault::new(e.to_string()).in_file(path);
    let mut file = std::fs::File::open(path).map_err(fault)?;
    let mut start = [0; 5];
    let mut length = 0;
    while length < start.len() {
        match file.read(&mut start[length..]).map_err(fault)? {
            0 => break,
            n => length += n,
        }
    }
    if length == 0 {
        return Err(Fault::new("the file is empty").in_file(path));
    }
    if !start.starts_with(b"#usda") {
        return Ok(());
    }
    let mut depth = 0_usize;
    let mut buffer = vec![0; 1 << 16];
    loop {
        let n = file.read(&mut buffer).map_err(fault)?;
        if n == 0 {
            return Ok(());
        }
        for byte in &buffer[..n] {
            match byte {
                b'{' => depth += 1,
                b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth > MAX_NESTING {
                return Err(
                    Fault::new(format!("braces nest more than {MAX_NESTING} deep"))
                        .in_file(path)
                        .advise("flatten the hierarchy"),
                );
            }
        }
    }
}

/// Everything, on the reading thread.
fn read(path: &Path, options: &LoadOptions) -> Result<Description> {
    let name = path
        .to_str()
        .ok_or_else(|| Fault::new("the file's name is not UTF-8").in_file(path))?;
    let stage = Stage::builder()
        .schema_registry(openusd_schemas::schema_registry())
        .open(name)
        .map_err(|e| {
            Fault::new(e.to_string())
                .in_file(path)
                .advise("open the file with usdcat or usdchecker to see what is wrong with it")
        })?;
    let mut reader = walk::Reader::new(stage, path, options);
    let mut out = reader.read()?;
    out.files = files(&reader.stage, path);
    for error in reader.stage.composition_errors() {
        let message = error.to_string();
        let kind = message
            .split([' ', '@'])
            .take(2)
            .collect::<Vec<_>>()
            .join(" ");
        reader
            .warnings
            .add(format!("composition: {kind}"), || message);
    }
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
