//! Everything that is wrong with a file that can be opened.
//!
//! Reading is lenient where it can be: a neighbour that there is not is none, what lies between the parts of a file is
//! not looked at. Here all of it is looked at, and what is stored twice, such as reductions, is compared.

mod adjacency;
mod data;

use std::fmt;

use crate::error::Error;
use crate::layout::{EXT_HEADER, StoredFace};
use crate::reader::Reader;

/// How bad a [`Finding`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Unusual, and harmless to readers: bytes that nothing uses, a face that could be stored as constant.
    Odd,
    /// Some readers, or some filters, will give wrong values.
    Wrong,
    /// Data that cannot be read.
    Unreadable,
}

/// One thing that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// The face that it is about.
    pub face: Option<u32>,
    /// What is wrong, with the values.
    pub message: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Odd => "odd",
            Severity::Wrong => "wrong",
            Severity::Unreadable => "unreadable",
        };
        match self.face {
            Some(face) => write!(f, "{severity}: face {face}: {}", self.message),
            None => write!(f, "{severity}: {}", self.message),
        }
    }
}

/// Reads all of a file, and tells what is wrong with it: with its layout, its faces, their adjacency, their texels,
/// its meta data, in this order.
#[must_use]
pub fn check(reader: &Reader) -> Vec<Finding> {
    let mut findings = Findings(Vec::new());
    layout(reader, &mut findings);
    match reader.stored_faces() {
        Ok(faces) => {
            flags(reader, &faces, &mut findings);
            adjacency::check(reader, &faces, &mut findings);
            data::check(reader, &mut findings);
        }
        Err(e) => findings.unreadable(&e),
    }
    meta(reader, &mut findings);
    findings.0
}

struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, severity: Severity, face: Option<u32>, message: impl Into<String>) {
        let message = message.into();
        self.0.push(Finding {
            severity,
            face,
            message,
        });
    }

    fn odd(&mut self, message: impl Into<String>) {
        self.add(Severity::Odd, None, message);
    }

    fn unreadable(&mut self, e: &Error) {
        self.add(Severity::Unreadable, e.face(), e.message());
    }
}

/// What lies where in the file, and what lies between.
fn layout(reader: &Reader, findings: &mut Findings) {
    let header = reader.header();
    let sections = reader.sections();
    if header.minor_version > 4 {
        findings.odd(format!(
            "has minor version {} of the format; 4 is the latest known",
            header.minor_version
        ));
    }
    let ext = header.ext_header_size as usize;
    if ext > EXT_HEADER {
        findings.odd(format!(
            "has an extended header of {ext} bytes, of which {EXT_HEADER} are known"
        ));
    }
    let levels: u64 = reader.levels().map(|level| level.size).sum();
    if levels < header.level_data_size {
        findings.odd(format!(
            "has {} bytes between its levels and its meta data",
            header.level_data_size - levels
        ));
    }
    if u64::from(header.level_info_size) > 16 * u64::from(header.levels) {
        findings.odd(format!(
            "has {} bytes of level info for {} levels of 16 bytes",
            header.level_info_size, header.levels
        ));
    }
    let missing = sections.missing_barrier();
    // Before there were large meta data and edits in a known place there were no zero bytes.
    if missing > 0 && ext >= EXT_HEADER {
        let severity = if reader.has_edits() {
            Severity::Wrong
        } else {
            Severity::Odd
        };
        findings.add(
            severity,
            None,
            "lacks the 8 zero bytes behind its meta data: other readers misread edits of it",
        );
    }
    let end = sections.end;
    let (start, edits_end) = (sections.edits.0, reader.edits_end());
    if start > end {
        findings.odd(format!(
            "has {} bytes between its meta data and its edits",
            start - end
        ));
    }
    if edits_end < sections.edits.1 {
        findings.odd(format!(
            "has {} bytes of edits that are none",
            sections.edits.1 - edits_end
        ));
    }
    let len = reader.source().len();
    if len > sections.edits.1 {
        findings.odd(format!(
            "has {} bytes behind its end at {}",
            len - sections.edits.1,
            sections.edits.1
        ));
    }
}

/// Flags that are none, and flags that do not fit together.
fn flags(reader: &Reader, faces: &[StoredFace], findings: &mut Findings) {
    for (face, stored) in (0..).zip(faces) {
        let info = reader.face(face);
        let unknown = stored.flags & !0xf;
        if unknown != 0 {
            findings.add(
                Severity::Odd,
                Some(face),
                format!("has unknown flags {unknown:#x}"),
            );
        }
        if info.has_edits && !reader.is_edited(face) {
            findings.add(
                Severity::Wrong,
                Some(face),
                "is flagged as edited, and no edit of it is there",
            );
        }
        if info.constant_neighbourhood && !info.constant {
            findings.add(
                Severity::Wrong,
                Some(face),
                "is flagged as lying among constant faces, and is not constant itself",
            );
        }
    }
}

fn meta(reader: &Reader, findings: &mut Findings) {
    let meta = match reader.meta() {
        Ok(meta) => meta,
        Err(e) => return findings.unreadable(&e),
    };
    for (key, value) in meta.iter() {
        if key.is_empty() {
            findings.odd("has meta data without a name");
        }
        let replaced = char::REPLACEMENT_CHARACTER;
        if key.contains(replaced) {
            findings.odd(format!("meta data {key:?}: its name is no UTF-8"));
        }
        if let crate::MetaValue::String(text) = value
            && text.contains(replaced)
        {
            findings.odd(format!("meta data {key:?}: its text is no UTF-8"));
        }
    }
}
