//! Mapping a store back.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::AnyBitPattern;
use mapped::{Items, MappedFile};

use super::{
    ALIGNMENT, Entry, HEAD, MAGIC, Section, Table, VERSION, checksum, hex, table_checksum,
};
use crate::error::Fault;

/// An opened store.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    file: Arc<MappedFile>,
    table: Table,
    /// Options that whoever reads it is told otherwise than the build was.
    told_otherwise: Vec<String>,
}

/// The sections of an object, whose checksums are right.
pub struct Sections<'a> {
    store: &'a Store,
    entry: &'a Entry,
}

impl Store {
    /// Opens a file and checks its table; objects are checked when they are [asked for](Self::object).
    ///
    /// # Errors
    /// A fault that names the file, if it cannot be read, is no store, is of another version, was cut off or damaged.
    pub fn open(path: &Path) -> Result<Self, Fault> {
        Self::read(path).map_err(|fault| fault.in_file(path))
    }

    fn read(path: &Path) -> Result<Self, Fault> {
        // What is no regular file cannot be mapped, or might never end.
        let metadata = path.metadata().map_err(|e| Fault::new(e.to_string()))?;
        if !metadata.is_file() {
            return Err(Fault::new("it is no file").advise(AGAIN));
        }
        let foreign = || {
            Fault::new("it is no store of built hierarchies")
                .advise("name a file that `relievo build` wrote")
        };
        if metadata.len() < HEAD as u64 {
            return Err(foreign());
        }
        let file = MappedFile::open(path).map_err(|e| Fault::new(e.to_string()))?;
        let bytes = file.bytes();
        let Some((head, _)) = bytes.split_first_chunk::<HEAD>() else {
            return Err(foreign());
        };
        if head[..8] != MAGIC {
            return Err(foreign());
        }
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|b| head[at + b]));
        let version = number(8) as u32;
        if version != VERSION {
            let message = format!("its format has version {version}, this program's {VERSION}");
            return Err(Fault::new(message).advise(AGAIN));
        }
        let (start, length) = (number(16), number(24));
        if start.checked_add(length) != Some(bytes.len() as u64) || start < HEAD as u64 {
            let message = format!(
                "it has {} bytes, and its table does not end there",
                bytes.len()
            );
            return Err(Fault::new(message).advise(AGAIN));
        }
        let table = &bytes[start as usize..];
        if head[32..] != table_checksum(&head[..32], table) {
            return Err(Fault::new("its table is damaged").advise(AGAIN));
        }
        let table: Table = serde_json::from_slice(table)
            .map_err(|e| Fault::new(format!("its table makes no sense: {e}")).advise(AGAIN))?;
        Ok(Self {
            path: path.to_owned(),
            file: Arc::new(file),
            table,
            told_otherwise: Vec::new(),
        })
    }

    /// Takes the names of options that whoever reads it is told otherwise than the build was, for errors to name.
    pub fn told_otherwise(&mut self, options: Vec<String>) {
        self.told_otherwise = options;
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of the file, all of which may come to lie in memory.
    pub fn size(&self) -> u64 {
        self.file.bytes().len() as u64
    }

    /// The scene that it was built from.
    pub fn scene(&self) -> PathBuf {
        match self.path.parent() {
            Some(folder) => folder.join(&self.table.scene),
            None => self.table.scene.clone(),
        }
    }

    /// What the build was told.
    pub fn told(&self) -> &serde_json::Value {
        &self.table.told
    }

    /// The name of the method whose hierarchies these are.
    pub fn method(&self) -> &str {
        &self.table.method
    }

    /// The sections of an object, all of them read once for their checksums.
    ///
    /// # Errors
    /// If there is no such object, if it was built of something else, or is damaged.
    pub fn object(&self, object: &str, digest: &str) -> Result<Sections<'_>, Fault> {
        let fault = |message: String| {
            Fault::new(message)
                .at_prim(object)
                .in_file(&self.path)
                .advise(AGAIN)
        };
        let mut named = self
            .table
            .objects
            .iter()
            .filter(|e| e.object == object)
            .peekable();
        if named.peek().is_none() {
            return Err(fault("the object is not in the store".to_owned()));
        }
        let Some(entry) = named.find(|entry| entry.digest == digest) else {
            let others = self.told_otherwise.join(" and ");
            if !others.is_empty() {
                let message =
                    format!("the store is stale: the build was not told the same {others}");
                let advice = format!("leave out {others}, or run `relievo build` again with it");
                return Err(fault(message).advise(advice));
            }
            return Err(fault(
                "the store is stale: the object's mesh, displacement, place, camera, or the options are others now"
                    .to_owned(),
            ));
        };
        for section in &entry.sections {
            let sound = self
                .bytes(section)
                .is_some_and(|bytes| hex(&checksum(bytes)) == section.checksum);
            if !sound {
                return Err(fault(format!("the section `{}` is damaged", section.name)));
            }
        }
        Ok(Sections { store: self, entry })
    }

    /// A section's bytes, if it lies where sections may, and is followed by zeros alone.
    fn bytes(&self, section: &Section) -> Option<&[u8]> {
        let (start, end) = section.range()?;
        let bytes = self.file.bytes();
        let after = bytes.get(end..end.checked_next_multiple_of(ALIGNMENT)?)?;
        let placed = start >= HEAD && start % ALIGNMENT == 0 && after.iter().all(|&b| b == 0);
        bytes.get(start..end).filter(|_| placed)
    }
}

impl Section {
    fn range(&self) -> Option<(usize, usize)> {
        let end = self.start.checked_add(self.bytes)?;
        Some((self.start.try_into().ok()?, end.try_into().ok()?))
    }
}

impl Sections<'_> {
    /// The items of a section, which stay in the file.
    ///
    /// # Errors
    /// If there is no such section, or it does not hold whole items.
    pub fn items<T: AnyBitPattern>(&self, name: &str) -> Result<Items<T>, Fault> {
        let section = self
            .entry
            .sections
            .iter()
            .find(|section| section.name == name);
        section
            .and_then(Section::range)
            .and_then(|(start, end)| Items::in_file(&self.store.file, start..end))
            .ok_or_else(|| self.fault(&format!("there is no section `{name}` that makes sense")))
    }

    /// What does not fit, with its place.
    pub fn fault(&self, message: &str) -> Fault {
        Fault::new(message)
            .at_prim(&self.entry.object)
            .in_file(&self.store.path)
            .advise(AGAIN)
    }
}

/// What helps in most cases.
const AGAIN: &str = "run `relievo build` again, with the same options as the render";
