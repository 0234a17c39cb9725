//! Files that appear whole or not at all: written under another name beside their place, then renamed.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Whether a picture can be written to `path` at all, as far as that shows without writing: call it before hours
/// of rendering, not after.
pub fn check_destination(path: &Path) -> Result<()> {
    if path.file_name().is_none() || path.is_dir() {
        return Err(failed(
            path,
            "the name of a file is needed here, this is a folder",
            "Add a file name, for example `picture.exr`.",
        ));
    }
    let folder = folder_of(path);
    match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => Ok(()),
        Ok(_) => Err(failed(
            path,
            &format!("`{}` is a file, not a folder", folder.display()),
            "Choose another folder for the output.",
        )),
        Err(e) => Err(failed(
            path,
            &format!(
                "the folder `{}` cannot be written to: {e}",
                folder.display()
            ),
            "Create the folder first, or choose another one for the output.",
        )),
    }
}

/// Lets `write` write a file with a temporary name and then gives it its own. Whatever fails, no part of it stays.
///
/// # Errors
/// What `write` fails with; failures if the place cannot be written to.
pub fn write_whole(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    check_destination(path)?;
    let temporary = Temporary(temporary_name(path));
    write(&temporary.0)?;
    fs::rename(&temporary.0, path).map_err(|e| {
        failed(
            path,
            &format!("the finished file cannot be given its name: {e}"),
            "Check that the file may be replaced.",
        )
    })
}

/// Removes the file again; after the renaming there is none left to remove.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // It may not exist, and there is nothing better to do if it cannot be removed.
        let _ = fs::remove_file(&self.0);
    }
}

/// `a/b.exr` → `a/.b.1234.part.exr`, 1234 being the process.
fn temporary_name(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_stem().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// An [`Error::Failed`] about the output `path`.
pub(super) fn failed(path: &Path, reason: &str, help: &str) -> Error {
    Error::Failed {
        message: format!("cannot write {}: {reason}", path.display()),
        help: Some(help.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_temporary_file_hides_beside_its_place() {
        let name = temporary_name(Path::new("out/frame.0001.exr"));
        let pid = std::process::id();
        assert_eq!(
            name,
            PathBuf::from(format!("out/.frame.0001.{pid}.part.exr"))
        );
    }

    #[test]
    fn nothing_stays_of_what_failed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        fs::write(&path, "old").expect("written");
        let result = write_whole(&path, |temporary| {
            fs::write(temporary, "half of it").expect("written");
            Err(Error::failed("no more"))
        });
        assert_eq!(result.expect_err("fails").to_string(), "no more");
        assert_eq!(fs::read_to_string(&path).expect("still there"), "old");
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 1);
    }
}
