//! Where the parts of a file lie.

use crate::error::{Error, Result};
use crate::layout::{BARRIER, ExtHeader, HEADER, Header};
use crate::source::Source;

/// The position of each part; where one ends the next begins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sections {
    pub(crate) face_info: u64,
    pub(crate) constants: u64,
    pub(crate) level_info: u64,
    pub(crate) levels: u64,
    pub(crate) meta: u64,
    /// Where the zero bytes are, or should be, and how many of them there are.
    pub(crate) after_meta: u64,
    barrier: u64,
    pub(crate) large_meta: u64,
    pub(crate) large_meta_data: u64,
    /// Where all this ends.
    pub(crate) end: u64,
    /// Of edits, to where they end.
    pub(crate) edits: (u64, u64),
}

impl Sections {
    /// How many of the zero bytes behind the meta data are not there.
    pub(crate) fn missing_barrier(&self) -> u64 {
        BARRIER - self.barrier
    }

    pub(super) fn new(header: &Header, ext: &ExtHeader, source: &Source) -> Result<Self> {
        let mut at = HEADER as u64;
        let mut next = |size: u64, what: &str| {
            let end = at.checked_add(size).filter(|end| *end <= source.len());
            let Some(end) = end else {
                return Err(Error::malformed(format!(
                    "is cut, or its header is wrong: the {what} takes {size} bytes at {at}, and the file has {}",
                    source.len()
                )));
            };
            Ok(std::mem::replace(&mut at, end))
        };
        next(u64::from(header.ext_header_size), "extended header")?;
        let face_info = next(u64::from(header.face_info_size), "face info")?;
        let constants = next(u64::from(header.constant_data_size), "constant data")?;
        let level_info = next(u64::from(header.level_info_size), "level info")?;
        let levels = next(header.level_data_size, "level data")?;
        let meta = next(u64::from(header.meta_zip_size), "meta data")?;
        let after_meta = next(0, "end")?;
        // Files that end here, and files from before there was a barrier, do without it.
        let barrier = BARRIER.min(source.len() - after_meta);
        let has_barrier = source
            .read(after_meta, barrier)?
            .iter()
            .all(|byte| *byte == 0);
        let barrier = if has_barrier { barrier } else { 0 };
        next(barrier, "barrier")?;
        let large_meta = next(
            u64::from(ext.large_meta_zip_size),
            "list of large meta data",
        )?;
        let large_meta_data = next(ext.large_meta_data_size, "large meta data")?;
        let end = next(0, "end")?;
        let edits = match ext.edit_position {
            0 => (end, source.len()),
            start => {
                let end = start
                    .checked_add(ext.edit_size)
                    .filter(|end| *end <= source.len());
                let Some(end) = end else {
                    return Err(Error::malformed(format!(
                        "is cut, or its header is wrong: the edits take {} bytes at {start}, and the file has {}",
                        ext.edit_size,
                        source.len()
                    )));
                };
                (start, end)
            }
        };
        let edits = match edits {
            (start, edits_end) if start >= end => (start, edits_end),
            (start, edits_end) if start == edits_end => (end, end),
            (start, _) => {
                return Err(Error::malformed(format!(
                    "has edits at {start}, and before them data up to {end}"
                )));
            }
        };
        Ok(Self {
            face_info,
            constants,
            level_info,
            levels,
            meta,
            after_meta,
            barrier,
            large_meta,
            large_meta_data,
            end,
            edits,
        })
    }
}
