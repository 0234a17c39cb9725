//! Writing a store, object by object.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::{
    ALIGNMENT, Entry, HEAD, MAGIC, Section, Table, VERSION, checksum, hex, table_checksum,
};
use crate::error::{Error, Result};

/// A store that is being written. Until it is [finished](Self::finish) the file is none.
pub struct Writer {
    file: File,
    /// For messages.
    path: PathBuf,
    /// Bytes written.
    at: u64,
    table: Table,
}

impl Writer {
    /// Begins a file. `path` is where it will stand at the end, `method` the name of the method whose hierarchies
    /// follow; `told` is given back by [`Store::told`](super::Store::told).
    ///
    /// # Errors
    /// If the file cannot be written, or there is no such scene.
    pub fn new(
        file: File,
        path: &Path,
        scene: &Path,
        method: &str,
        told: serde_json::Value,
    ) -> Result<Self> {
        let failed = |path: &Path, e| Error::failed(format!("{}: {e}", path.display()));
        let scene = scene.canonicalize().map_err(|e| failed(scene, e))?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let folder = folder.canonicalize().map_err(|e| failed(path, e))?;
        let scene = match scene.strip_prefix(folder) {
            Ok(within) => within.to_owned(),
            Err(_) => scene,
        };
        let mut writer = Self {
            file,
            path: path.to_owned(),
            at: 0,
            table: Table {
                scene,
                told,
                method: method.to_owned(),
                objects: Vec::new(),
            },
        };
        // The head is written last.
        writer.write(&[0; HEAD])?;
        Ok(writer)
    }

    /// Adds an object's sections, by their names.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn add(&mut self, object: &str, digest: &str, sections: &[(&str, &[u8])]) -> Result<()> {
        let mut entry = Entry {
            object: object.to_owned(),
            digest: digest.to_owned(),
            sections: Vec::with_capacity(sections.len()),
        };
        for (name, bytes) in sections {
            entry.sections.push(Section {
                name: (*name).to_owned(),
                start: self.at,
                bytes: bytes.len() as u64,
                checksum: hex(&checksum(bytes)),
            });
            self.write(bytes)?;
            let after = self.at.next_multiple_of(ALIGNMENT as u64) - self.at;
            self.write(&[0; ALIGNMENT][..after as usize])?;
        }
        self.table.objects.push(entry);
        Ok(())
    }

    /// Writes table and head. How many objects there are, and bytes.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn finish(mut self) -> Result<(usize, u64)> {
        let table = serde_json::to_vec(&self.table)
            .map_err(|e| Error::failed(format!("{}: {e}", self.path.display())))?;
        let start = self.at;
        self.write(&table)?;
        let mut head = [0; HEAD];
        head[..8].copy_from_slice(&MAGIC);
        head[8..12].copy_from_slice(&VERSION.to_le_bytes());
        head[16..24].copy_from_slice(&start.to_le_bytes());
        head[24..32].copy_from_slice(&(table.len() as u64).to_le_bytes());
        let sum = table_checksum(&head[..32], &table);
        head[32..].copy_from_slice(&sum);
        let bytes = self.at;
        let written = self.file.seek(SeekFrom::Start(0));
        let written = written.and_then(|_| self.file.write_all(&head));
        let written = written.and_then(|()| self.file.sync_all());
        written.map_err(|e| Error::failed(format!("{}: {e}", self.path.display())))?;
        Ok((self.table.objects.len(), bytes))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all(bytes)
            .map_err(|e| Error::failed(format!("{}: {e}", self.path.display())))?;
        self.at += bytes.len() as u64;
        Ok(())
    }
}
