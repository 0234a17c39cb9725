//! What the tests share: the oracle files, where they are.

// Each test uses some of it.
#![allow(dead_code, clippy::unwrap_used)]

pub(crate) mod made;
pub(crate) mod mesh;

use std::io::Write;
use std::path::{Path, PathBuf};

use relievo_ptex::{Cache, DataType, Reader, Texels};
use serde_json::Value;
use sha2::{Digest, Sha256};

/// A file of the oracles, and what is known of it.
pub(crate) struct Oracle {
    pub(crate) name: String,
    pub(crate) json: Value,
    pub(crate) reader: Reader,
}

/// The folder of the oracles. Without it a test says so, and checks nothing.
pub(crate) fn folder() -> Option<PathBuf> {
    let Some(shared) = std::env::var_os("RELIEVO_SHARED") else {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: RELIEVO_SHARED names no folder with oracles"
        );
        return None;
    };
    let folder = Path::new(&shared).join("oracles/ptex");
    assert!(folder.is_dir(), "{} is not there", folder.display());
    Some(folder)
}

/// All files that can be read.
pub(crate) fn oracles() -> Vec<Oracle> {
    let Some(folder) = folder() else {
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = [folder.clone(), folder.join("real")]
        .iter()
        .flat_map(|f| std::fs::read_dir(f).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "ptx"))
        .collect();
    paths.sort();
    assert!(paths.len() >= 26, "{} files", paths.len());
    let cache = Cache::default();
    paths
        .into_iter()
        .map(|path| Oracle {
            name: path.file_stem().unwrap().to_string_lossy().into_owned(),
            json: serde_json::from_slice(&std::fs::read(path.with_extension("json")).unwrap())
                .unwrap(),
            reader: Reader::open(&path, &cache).unwrap(),
        })
        .collect()
}

/// The hash of all texels in the file's type.
pub(crate) fn hash(texels: &Texels<'_>) -> String {
    let mut bytes = Vec::new();
    let (width, height) = (1 << texels.res().ulog2, 1 << texels.res().vlog2);
    texels.copy(0, 0, width, height, &mut bytes).unwrap();
    Sha256::digest(&bytes)
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect()
}

/// Samples as bit patterns.
pub(crate) fn raw(bytes: &[u8], data_type: DataType) -> Vec<u32> {
    bytes
        .chunks_exact(data_type.bytes())
        .map(|b| b.iter().rev().fold(0, |n, b| n << 8 | u32::from(*b)))
        .collect()
}
