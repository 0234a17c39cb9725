//! Where a file's bytes come from: read at a place, without a position that threads would share.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use crate::error::{Error, Result};

/// An open file, or bytes in memory.
pub(crate) struct Source {
    held: Held,
    len: u64,
}

enum Held {
    File(File),
    Memory(Vec<u8>),
}

impl Source {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io("cannot be opened", &e))?;
        let about = file
            .metadata()
            .map_err(|e| Error::io("cannot be read", &e))?;
        if !about.is_file() {
            return Err(Error::request("is no file", "name a Ptex file"));
        }
        Ok(Self {
            held: Held::File(file),
            len: about.len(),
        })
    }

    pub(crate) fn memory(bytes: Vec<u8>) -> Self {
        Self {
            len: bytes.len() as u64,
            held: Held::Memory(bytes),
        }
    }

    /// Bytes in all.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// `size` bytes from `at` on. Nothing is allocated for what lies past the end.
    pub(crate) fn read(&self, at: u64, size: u64) -> Result<Vec<u8>> {
        let end = at.checked_add(size).filter(|end| *end <= self.len);
        let Some(end) = end else {
            return Err(Error::malformed(format!(
                "{size} bytes at {at} reach past the end of the file, which has {}",
                self.len
            )));
        };
        match &self.held {
            Held::File(file) => {
                let mut bytes = vec![0; size as usize];
                file.read_exact_at(&mut bytes, at)
                    .map_err(|e| Error::io(&format!("{size} bytes at {at} cannot be read"), &e))?;
                Ok(bytes)
            }
            Held::Memory(bytes) => Ok(bytes[at as usize..end as usize].to_vec()),
        }
    }
}
