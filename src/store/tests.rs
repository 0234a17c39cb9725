//! What is written comes back; whatever else is in a file is an error and nothing worse.

use std::fs::File;
use std::path::{Path, PathBuf};

use proptest::prelude::*;

use super::*;
use crate::error::Fault;

/// A store of two objects, and its bytes.
fn write(folder: &Path) -> (PathBuf, Vec<u8>) {
    let (scene, path) = (folder.join("a.usda"), folder.join("a.rlv"));
    std::fs::write(&scene, "#usda 1.0\n").expect("written");
    let file = File::create(&path).expect("a file");
    let told = serde_json::json!({"frame": 0.1});
    let mut writer = Writer::new(file, &path, &scene, "compact", told).expect("it begins");
    let numbers: Vec<u8> = (0..200).collect();
    writer
        .add("/A", "1", &[("words", &numbers), ("none", &[])])
        .expect("written");
    writer
        .add("/A", "2", &[("words", &[5; 4])])
        .expect("written");
    let (objects, bytes) = writer.finish().expect("it ends");
    let all = std::fs::read(&path).expect("readable");
    assert_eq!((objects, bytes), (2, all.len() as u64));
    (path, all)
}

/// Everything in the store of [`write`].
fn read(path: &Path) -> Result<(Vec<u32>, Vec<u32>), Fault> {
    let store = Store::open(path)?;
    let first = store.object("/A", "1")?;
    assert!(first.items::<u8>("none")?.is_empty());
    let second = store.object("/A", "2")?.items::<u32>("words")?;
    Ok((first.items::<u32>("words")?.to_vec(), second.to_vec()))
}

#[test]
fn what_is_written_comes_back() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, all) = write(folder.path());
    let (first, second) = read(&path).expect("it is sound");
    assert_eq!(
        (first.len(), first[0], second),
        (50, 0x0302_0100, vec![0x0505_0505])
    );
    let store = Store::open(&path).expect("it is sound");
    assert_eq!(
        (store.method(), &store.told()["frame"]),
        ("compact", &0.1.into())
    );
    assert_eq!(store.scene(), folder.path().join("a.usda"));
    let words = |fault: Option<Fault>| fault.expect("a fault").to_string();
    assert!(words(store.object("/A", "3").err()).contains("/A: the store is stale"));
    assert!(words(store.object("/B", "1").err()).contains("/B: the object is not"));
    let sections = store.object("/A", "1").expect("it is there");
    assert!(words(sections.items::<u32>("other").err()).contains("`other`"));
    assert!(words(sections.items::<[u8; 7]>("words").err()).contains("`words`"));
    assert_eq!(write(folder.path()).1, all);
}

#[test]
fn other_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, all) = write(folder.path());
    let refused = |bytes: &[u8], word: &str| {
        let other = folder.path().join("b.rlv");
        std::fs::write(&other, bytes).expect("written");
        let fault = read(&other).expect_err(word).to_string();
        assert!(fault.contains(word) && fault.contains("b.rlv"), "{fault}");
    };
    refused(b"", "no store");
    refused(&[0; 1000], "no store");
    refused(&all[..all.len() - 1], "does not end there");
    refused(&[&all[..], &[0]].concat(), "does not end there");
    let mut other = all.clone();
    other[8] = 3;
    refused(&other, "version 3");
    // A head that promises more than there is, or starts the table within itself.
    for (start, length) in [(u64::MAX, 1), (all.len() as u64, 0), (0, all.len() as u64)] {
        let mut other = all.clone();
        other[16..24].copy_from_slice(&start.to_le_bytes());
        other[24..32].copy_from_slice(&length.to_le_bytes());
        refused(&other, "table");
    }
    assert!(read(folder.path()).is_err());
    assert!(read(&path.with_extension("none")).is_err());
    assert!(read(Path::new("/dev/zero")).is_err());
}

#[test]
fn sections_that_lie_elsewhere_are_refused_under_a_right_checksum() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, all) = write(folder.path());
    let number = |at: usize| u64::from_le_bytes(all[at..at + 8].try_into().expect("8")) as usize;
    let table: Table = serde_json::from_slice(&all[number(16)..]).expect("a table");
    for (start, bytes) in [
        (0, 64),
        (65, 8),
        (64, u64::MAX),
        (u64::MAX, 2),
        (1 << 40, 4),
    ] {
        let mut forged = table.clone();
        let section = &mut forged.objects[0].sections[0];
        (section.start, section.bytes) = (start, bytes);
        let text = serde_json::to_vec(&forged).expect("text");
        let mut file = all[..number(16)].to_vec();
        file[24..32].copy_from_slice(&(text.len() as u64).to_le_bytes());
        let sum = table_checksum(&file[..32], &text);
        file[32..HEAD].copy_from_slice(&sum);
        file.extend_from_slice(&text);
        std::fs::write(&path, file).expect("written");
        let fault = read(&path).expect_err("it lies elsewhere").to_string();
        assert!(fault.contains("`words` is damaged"), "{fault}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_changed_byte_is_noticed(at in any::<prop::sample::Index>(), flip in 1_u8..) {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, mut all) = write(folder.path());
        let at = at.index(all.len());
        all[at] ^= flip;
        std::fs::write(&path, all).expect("written");
        prop_assert!(read(&path).is_err(), "byte {at}");
    }
}

#[test]
fn digests_tell_parts_apart() {
    let of = |parts: &[&str]| {
        let mut digest = Digest::new();
        parts.iter().for_each(|part| digest.text(part));
        digest.finish()
    };
    assert_eq!(of(&["ab", "c"]), of(&["ab", "c"]));
    assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
    assert_ne!(of(&["ab"]), of(&["ab", ""]));
}
