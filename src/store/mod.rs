//! Built hierarchies in a file, which is mapped back as it is: a render starts without building them again.
//!
//! ```text
//!   bytes 0..8     89 'R' 'L' 'V' 0d 0a 1a 0a: what translates line ends, or cuts at the first zero, spoils it
//!         8..12    version of the format, 2
//!        12..16    zero
//!        16..24    where the table starts
//!        24..32    its bytes; it ends the file
//!        32..64    checksum of bytes 0..32 and the table
//!        64..      sections, one after the other, each from a multiple of 64 bytes on; zeros between
//!                  table: JSON
//! ```
//!
//! Numbers are little-endian. The table names the scene, what the build was told, and the method; then each object by
//! its prim, the digest of all that its hierarchy follows from ([`Digest`]), and its sections with their checksums.
//! What the sections mean is the method's own affair: for `compact`, see its `stored`. Another method needs no other
//! format. Whoever changes what sections hold, or what is built of the same scene, raises the version: digests tell
//! releases of the program apart, but not what lies between them.
//!
//! A checksum is the SHA-256 of the SHA-256s of each mebibyte, so that all threads can work on it. It finds what was
//! damaged; what was forged has a right checksum, so methods check that all that is an index is within bounds.

mod digest;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use digest::Digest;
pub use read::{Sections, Store};
pub use write::Writer;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

// Sections are arrays in memory, and memory is as the file is.
const _: () = assert!(cfg!(target_endian = "little"), "stores are little-endian");

const MAGIC: [u8; 8] = *b"\x89RLV\r\n\x1a\n";
const VERSION: u32 = 2;
/// Bytes before the first section.
const HEAD: usize = 64;
/// Sections start at multiples of this.
const ALIGNMENT: usize = 64;
/// Bytes that are hashed at once.
const CHUNK: usize = 1 << 20;

/// What stands at the end of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Table {
    /// The scene's file: within the store's folder relative to that, else absolute.
    scene: std::path::PathBuf,
    /// What the build was told, as its caller put it.
    told: serde_json::Value,
    method: String,
    objects: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Entry {
    /// The prim.
    object: String,
    digest: String,
    sections: Vec<Section>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Section {
    name: String,
    start: u64,
    bytes: u64,
    checksum: String,
}

/// A checksum, on all threads.
fn checksum(bytes: &[u8]) -> [u8; 32] {
    let chunks: Vec<_> = bytes.par_chunks(CHUNK).map(Sha256::digest).collect();
    let mut all = Sha256::new();
    for chunk in chunks {
        all.update(chunk);
    }
    all.finalize().into()
}

/// That of the file's start and its table.
fn table_checksum(start: &[u8], table: &[u8]) -> [u8; 32] {
    let mut all = Sha256::new();
    all.update(start);
    all.update(table);
    all.finalize().into()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
