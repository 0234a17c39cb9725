//! The project's own scenes are read without a warning.

use std::fs;
use std::path::Path;

use crate::common::program::{Bench, expect, said};

#[test]
fn all_scenes_are_read_without_a_warning() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut seen = 0;
    for entry in fs::read_dir(folder).expect("the scenes").flatten() {
        let name = entry.file_name();
        let scene = entry.path().join(&name).with_extension("usda");
        if !scene.exists() {
            continue;
        }
        let text = fs::read_to_string(&scene).expect("readable");
        if text.contains("@./made/") && !entry.path().join("made").exists() {
            println!("SKIPPED {}: make scenes writes its files", scene.display());
            continue;
        }
        let scene = scene.to_string_lossy();
        let output = Bench::new().command(&["info", &scene]).output();
        let (code, text) = said(&output.expect("the program runs"));
        expect((code, text.clone()), 0, &[]);
        assert!(text.is_empty(), "{text}");
        seen += 1;
    }
    assert!(seen >= 5, "{seen} scenes");
}
