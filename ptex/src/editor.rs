//! Incremental edits: faces and meta data that replace others, appended to a file.
//!
//! What a file held before stays in it. Reductions of an edited face are computed when they are needed, and so are
//! slower than stored ones: [`Writer::copy_of`](crate::Writer::copy_of) makes a file whole again.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::layout::{EXT_HEADER, HEADER, StoredFace};
use crate::meta::{self, Meta, MetaValue};
use crate::reader::Reader;
use crate::temporary::write_whole;
use crate::types::{FaceInfo, Res};
use crate::writer::neighbourhood::constant_neighbourhoods;
use crate::writer::{EncodedFace, Format, check_key, check_neighbours, compressed};

/// Edits to a file, collected until [`Editor::write`] appends them.
#[derive(Debug)]
pub struct Editor {
    reader: Reader,
    format: Format,
    faces: BTreeMap<u32, (FaceInfo, EncodedFace)>,
    meta: Meta,
}

/// Unedited faces that have to be written again.
type Stale = Vec<(u32, EncodedFace)>;

/// Bytes that are copied at a time.
const CHUNK: u64 = 1 << 20;
/// Where the extended header has the size of the edits; their position is the next field.
const EDIT_SIZE_AT: usize = HEADER + 24;

impl Editor {
    /// No edits yet.
    #[must_use]
    pub fn new(reader: &Reader) -> Self {
        Self {
            reader: reader.clone(),
            format: Format::of(reader),
            faces: BTreeMap::new(),
            meta: Meta::default(),
        }
    }

    /// Replaces a face: its size, its neighbours and its texels, which are as [`Format::encode`] wants them.
    ///
    /// # Errors
    /// If there is no such face or neighbour, and as [`Format::encode`].
    pub fn face(&mut self, face: u32, info: &FaceInfo, texels: &[u8]) -> Result<()> {
        let edit = || {
            let count = self.reader.face_count();
            if face >= count {
                return Err(Error::request(
                    format!("face {face} is edited, and there are {count}"),
                    "edit faces of the file",
                ));
            }
            check_neighbours(info, self.format.mesh_type, count as usize)?;
            self.format.encode_edit(info.res, texels)
        };
        let encoded = edit().map_err(|e| e.at_face(face).in_file(self.reader.path()))?;
        self.faces.insert(face, (*info, encoded));
        Ok(())
    }

    /// Adds meta data, or replaces what has that name.
    ///
    /// # Errors
    /// If the name cannot be stored: it has to have 1 to 254 bytes, none of them 0.
    pub fn set_meta(&mut self, key: &str, value: MetaValue) -> Result<()> {
        check_key(key)?;
        self.meta.set(key, value);
        Ok(())
    }

    /// Writes the file with the edits, under another name first. The path may be that of the file itself: who has it
    /// open goes on to see it as it was.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let edits = self.edits()?;
        write_whole(path, |out| self.append(&edits, out))
    }

    /// The bytes of the file with the edits.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        self.append(&self.edits()?, &mut out)
            .map_err(|e| Error::io("cannot be read", &e).in_file(self.reader.path()))?;
        Ok(out)
    }

    fn append(&self, edits: &[u8], out: &mut impl Write) -> io::Result<()> {
        let sections = self.reader.sections();
        let missing = sections.missing_barrier();
        let (start, end) = (sections.edits.0, self.reader.edits_end());
        let mut head = self.read(0, sections.face_info)?;
        // Older files have no room to tell of edits: there they go on to the end of the file.
        if self.reader.header().ext_header_size as usize >= EXT_HEADER {
            let size = end - start + edits.len() as u64;
            let position = start + missing;
            for (i, field) in [size, position].into_iter().enumerate() {
                let at = EDIT_SIZE_AT + 8 * i;
                head[at..at + 8].copy_from_slice(&field.to_le_bytes());
            }
        }
        out.write_all(&head)?;
        self.copy(sections.face_info, sections.after_meta, out)?;
        out.write_all(&vec![0; missing as usize])?;
        self.copy(sections.after_meta, end, out)?;
        out.write_all(edits)
    }

    fn copy(&self, mut at: u64, end: u64, out: &mut impl Write) -> io::Result<()> {
        while at < end {
            let size = CHUNK.min(end - at);
            out.write_all(&self.read(at, size)?)?;
            at += size;
        }
        Ok(())
    }

    fn read(&self, at: u64, size: u64) -> io::Result<Vec<u8>> {
        let read = self.reader.source().read(at, size);
        read.map_err(|e| io::Error::other(e.in_file(self.reader.path())))
    }

    fn edits(&self) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        let (flags, stale) = self.neighbourhoods()?;
        for (face, (info, encoded)) in &self.faces {
            let info = FaceInfo {
                constant: encoded.constant(),
                constant_neighbourhood: flags[*face as usize],
                ..*info
            };
            write_face(*face, &info, encoded, &mut out);
        }
        for (face, encoded) in stale {
            let info = FaceInfo {
                constant_neighbourhood: false,
                ..*self.reader.face(face)
            };
            write_face(face, &info, &encoded, &mut out);
        }
        if !self.meta.is_empty() {
            let mut entries = Vec::new();
            for (key, value) in self.meta.iter() {
                let bytes = value.bytes();
                meta::write_head(key, value, bytes.len(), &mut entries);
                entries.extend(bytes);
            }
            let (zip, size) = compressed(&entries);
            out.push(1);
            for field in [8 + zip.len(), zip.len(), size] {
                out.extend((field as u32).to_le_bytes());
            }
            out.extend(zip);
        }
        Ok(out)
    }

    /// Which faces have constant neighbourhoods after the edits, and the unedited ones that no longer have: they
    /// would hide an edit from filters.
    fn neighbourhoods(&self) -> Result<(Vec<bool>, Stale)> {
        let count = self.reader.face_count();
        let mut infos = Vec::with_capacity(count as usize);
        let mut texels = Vec::with_capacity(count as usize);
        for face in 0..count {
            let mut texel = Vec::new();
            infos.push(match self.faces.get(&face) {
                Some((info, encoded)) => {
                    texel.clone_from(&encoded.texel);
                    FaceInfo {
                        constant: encoded.constant(),
                        ..*info
                    }
                }
                None => {
                    let info = *self.reader.face(face);
                    if info.constant {
                        let one = Res { ulog2: 0, vlog2: 0 };
                        let texels = self.reader.texels(face, one, false)?;
                        texels.copy(0, 0, 1, 1, &mut texel)?;
                    }
                    info
                }
            });
            texels.push(texel);
        }
        let flags = constant_neighbourhoods(
            &infos,
            self.format.mesh_type,
            self.reader.border_modes(),
            |a, b| texels[a] == texels[b],
        );
        let mut stale = Vec::new();
        for face in 0..count {
            let i = face as usize;
            if infos[i].constant_neighbourhood && !flags[i] && !self.faces.contains_key(&face) {
                let encoded = self.format.encode_edit(infos[i].res, &texels[i])?;
                stale.push((face, encoded));
            }
        }
        Ok((flags, stale))
    }
}

fn write_face(face: u32, info: &FaceInfo, encoded: &EncodedFace, out: &mut Vec<u8>) {
    // That it has edits is known from there being one.
    let stored = StoredFace::from(&FaceInfo {
        has_edits: false,
        ..*info
    });
    let (word, bytes): (u32, &[u8]) = match encoded.levels.first() {
        Some(block) => (block.word, &block.bytes),
        None => (0, &[]),
    };
    let mut record = face.to_le_bytes().to_vec();
    record.extend(stored.bytes());
    record.extend(word.to_le_bytes());
    record.extend(&encoded.texel);
    record.extend(bytes);
    out.push(0);
    out.extend((record.len() as u32).to_le_bytes());
    out.extend(record);
}
