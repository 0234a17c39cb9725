//! Files that appear whole or not at all: written under another name beside their place, then renamed.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, ErrorKind, Result};

/// Lets `write` write a file with a temporary name and then gives it its own. Whatever fails, no part of it stays.
pub(crate) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<()> {
    let failed = |doing: &str, e: std::io::Error| {
        Error::new(
            ErrorKind::Io,
            format!("{doing}: {e}"),
            "see that its folder is there, has room and may be written to",
        )
        .in_file(path)
    };
    if path.file_name().is_none() || path.is_dir() {
        return Err(
            Error::request("cannot be written: it is a folder", "name a file").in_file(path),
        );
    }
    let temporary = Temporary(temporary_name(path));
    let create = || {
        let mut out = BufWriter::new(File::create(&temporary.0)?);
        write(&mut out)?;
        out.flush()
    };
    create().map_err(|e| failed("cannot be written", e))?;
    fs::rename(&temporary.0, path).map_err(|e| failed("cannot be given its name", e))
}

/// Removes the file again; after the renaming there is none left to remove.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // It may not exist, and there is nothing better to do if it cannot be removed.
        let _ = fs::remove_file(&self.0);
    }
}

/// `a/b.ptx` → `a/.b.ptx.1234.part`, 1234 being the process.
fn temporary_name(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_stays_of_what_failed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ptx");
        fs::write(&path, "old").unwrap();
        let result = write_whole(&path, |out| {
            out.write_all(b"half of it")?;
            Err(std::io::Error::other("no more"))
        });
        assert!(result.unwrap_err().to_string().contains("no more"));
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        write_whole(&path, |out| out.write_all(b"new")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
    }
}
