//! Incremental edits: what was appended to a file after it was written.

use std::collections::HashMap;

use crate::error::{Error, Result};
use crate::layout::{Block, Bytes, FACE, HAS_EDITS, Header, StoredFace};
use crate::source::Source;

/// The edits of a file; of those to the same face the last.
#[derive(Default)]
pub(crate) struct Edits {
    /// All that there are.
    pub(crate) count: usize,
    /// Where the last one ends.
    pub(crate) end: u64,
    pub(crate) faces: HashMap<u32, FaceEdit>,
    pub(crate) meta: Vec<MetaEdit>,
}

/// A face anew.
pub(crate) struct FaceEdit {
    pub(crate) info: StoredFace,
    pub(crate) constant: Vec<u8>,
    pub(crate) block: Block,
}

/// Where more meta data lie.
pub(crate) struct MetaEdit {
    pub(crate) at: u64,
    pub(crate) stored: u32,
    pub(crate) size: u32,
}

/// A face edit: index, face info and block word.
const FACE_HEAD: usize = 4 + FACE + 4;
const META_HEAD: usize = 8;

impl Edits {
    pub(crate) fn read(
        source: &Source,
        header: &Header,
        (mut at, end): (u64, u64),
    ) -> Result<Self> {
        let mut edits = Self::default();
        let pixel = header.pixel_bytes();
        while at < end {
            let wrong = |what: String| Error::malformed(format!("the edit at {at} {what}"));
            if end - at < 5 {
                return Err(wrong(format!("ends after {} bytes", end - at)));
            }
            let head = source.read(at, 5)?;
            let mut r = Bytes(&head);
            let (kind, size) = (r.u8()?, u64::from(r.u32()?));
            if size == 0 {
                break;
            }
            let start = at + 5;
            if size > end - start {
                return Err(wrong(format!(
                    "takes {size} bytes, and the edits end after {}",
                    end - start
                )));
            }
            let too_short = || wrong(format!("takes {size} bytes, which is too few"));
            match kind {
                0 => {
                    let fixed = (FACE_HEAD + pixel) as u64;
                    if size < fixed {
                        return Err(too_short());
                    }
                    let bytes = source.read(start, fixed)?;
                    let mut r = Bytes(&bytes);
                    let face = r.u32()?;
                    if face >= header.faces {
                        return Err(wrong(format!(
                            "is of face {face}, and the file has {}",
                            header.faces
                        )));
                    }
                    let mut info = StoredFace::parse(r.take(FACE)?)?;
                    info.flags |= HAS_EDITS;
                    let block = Block::new(r.u32()?, start + fixed);
                    let constant = r.take(pixel)?.to_vec();
                    if u64::from(block.size) > size - fixed {
                        return Err(wrong(format!(
                            "has {} bytes of texels, and room for {}",
                            block.size,
                            size - fixed
                        ))
                        .at_face(face));
                    }
                    let edit = FaceEdit {
                        info,
                        constant,
                        block,
                    };
                    edits.faces.insert(face, edit);
                }
                1 => {
                    if size < META_HEAD as u64 {
                        return Err(too_short());
                    }
                    let bytes = source.read(start, META_HEAD as u64)?;
                    let mut r = Bytes(&bytes);
                    let edit = MetaEdit {
                        stored: r.u32()?,
                        size: r.u32()?,
                        at: start + META_HEAD as u64,
                    };
                    if u64::from(edit.stored) > size - META_HEAD as u64 {
                        return Err(wrong(format!(
                            "has {} bytes of meta data, and room for {}",
                            edit.stored,
                            size - META_HEAD as u64
                        )));
                    }
                    edits.meta.push(edit);
                }
                kind => {
                    return Err(wrong(format!("is of kind {kind}; 0 and 1 are known")));
                }
            }
            edits.count += 1;
            at = start + size;
        }
        edits.end = at;
        Ok(edits)
    }
}
