//! Ptex files that must be right.

use relievo_ptex::{Cache, Reader, Severity, check};

use super::program::Bench;

/// Opens a file, with which nothing is wrong.
#[track_caller]
pub fn open(bench: &Bench, name: &str) -> Reader {
    let reader = Reader::open(bench.path(name), &Cache::default()).expect("a Ptex file");
    let findings = check(&reader);
    let bad: Vec<_> = (findings.iter())
        .filter(|f| f.severity != Severity::Odd)
        .collect();
    assert!(bad.is_empty(), "{bad:?}");
    reader
}
