//! `relievo ptex`: what it tells of files, and its exit codes.

use std::path::PathBuf;

use relievo_ptex::{DataType, FaceInfo, Format, MeshType, MetaValue, Res, Writer};
use serde_json::Value;

use crate::common::program::{Bench, expect, said};
use crate::common::shared;

/// One quad of 16 x 8 texels, with alpha and a little meta data.
fn file() -> Vec<u8> {
    let mut format = Format::new(MeshType::Quad, DataType::U16, 2);
    format.alpha_channel = Some(1);
    let mut writer = Writer::new(format, 2).expect("a file");
    let info = FaceInfo {
        res: Res { ulog2: 4, vlog2: 3 },
        neighbours: [None; 4],
        constant: false,
        has_edits: false,
        constant_neighbourhood: false,
        subface: false,
    };
    // Nothing that compresses well.
    let noise = (0..256_u32).map(|n| (n.wrapping_mul(0x9e37_79b9) >> 16) as u16);
    let texels: Vec<u8> = noise.flat_map(u16::to_le_bytes).collect();
    writer.face(0, &info, &texels).expect("a face");
    writer
        .set_meta("by", MetaValue::String("hand".into()))
        .expect("meta data");
    writer.bytes().expect("a file")
}

fn run(bench: &Bench, arguments: &[&str]) -> (i32, String, String) {
    let output = bench.command(arguments).output().expect("the program runs");
    let (code, errors) = said(&output);
    (code, String::from_utf8_lossy(&output.stdout).into(), errors)
}

#[test]
fn a_good_file_is_told_of_and_checked() {
    let bench = Bench::new();
    bench.write("a.ptx", file());
    let (code, text, _) = run(&bench, &["ptex", "info", "a.ptx"]);
    assert_eq!(code, 0);
    for word in [
        "2 of a quad mesh, 1 constant",
        "uint16, 2 channels, alpha in channel 1",
        "16 x 8        1 faces",
        "by: string[5] \"hand\"",
    ] {
        assert!(text.contains(word), "{word} is not in: {text}");
    }
    let (code, text, _) = run(&bench, &["ptex", "check", "a.ptx"]);
    assert_eq!((code, text.as_str()), (0, "a.ptx: nothing is wrong\n"));
    let report = bench.report(&["ptex", "info", "a.ptx", "--json"]);
    let face = &report["faces"][0];
    assert_eq!(face["chain"].as_array().map(Vec::len), Some(5));
    assert_ne!(
        face["chain"][0]["sha256"],
        face["chain"][0]["premult_sha256"]
    );
    assert_eq!(report["faces"][1]["chain"][0]["constant"], true);
}

#[test]
fn a_damaged_file_is_bad_input() {
    let bench = Bench::new();
    let mut bytes = file();
    bytes.truncate(bytes.len() - 30);
    bench.write("cut.ptx", &bytes);
    for command in ["info", "check"] {
        let (code, _, errors) = run(&bench, &["ptex", command, "cut.ptx"]);
        expect((code, errors), 3, &["cut.ptx", "is cut", "help:"]);
    }
    // Somewhere in the texels of face 0: the rest can still be told.
    let mut bytes = file();
    let level_data = 104
        + [32, 36, 40]
            .map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
            .iter()
            .sum::<u32>() as usize;
    bytes[level_data + 30] ^= 0xff;
    bench.write("damaged.ptx", &bytes);
    let (code, text, errors) = run(&bench, &["ptex", "info", "damaged.ptx", "--json"]);
    expect((code, errors), 3, &["damaged.ptx: face 0: "]);
    let report: Value = serde_json::from_str(&text).expect("one object");
    assert!(report["faces"][0]["chain"][0]["error"].is_string());
    assert!(report["faces"][1]["chain"][0]["sha256"].is_string());
    let (code, text, errors) = run(&bench, &["ptex", "check", "damaged.ptx"]);
    expect(
        (code, errors),
        3,
        &["damaged.ptx: 1 data of it cannot be read"],
    );
    assert!(text.contains("damaged.ptx: unreadable: face 0: "), "{text}");
    let (code, _, errors) = run(&bench, &["ptex", "info", "none.ptx"]);
    expect((code, errors), 3, &["none.ptx", "No such file"]);
}

#[test]
fn info_is_what_the_oracles_say() {
    let Some(folder) = shared("info_is_what_the_oracles_say") else {
        return;
    };
    let folder = folder.join("oracles/ptex");
    let bench = Bench::new();
    let mut count = 0;
    for file in files(&[folder.clone(), folder.join("real")]) {
        let name = file.display().to_string();
        let found = bench.report(&["ptex", "info", &name, "--json"]);
        let wanted = std::fs::read(file.with_extension("json")).expect("its values");
        let mut wanted: Value = serde_json::from_slice(&wanted).expect("JSON");
        for face in wanted["faces"].as_array_mut().expect("faces") {
            // Reductions of one side only: not told.
            face.as_object_mut().expect("a face").remove("aniso");
        }
        for field in [
            "info",
            "header",
            "ext_header",
            "levels",
            "reduction_order",
            "metadata",
            "faces",
        ] {
            assert_eq!(found[field], wanted[field], "{name} {field}");
        }
        count += 1;
    }
    assert!(count >= 26, "{count} files");
}

#[test]
fn files_with_faults_are_bad_input() {
    let Some(folder) = shared("files_with_faults_are_bad_input") else {
        return;
    };
    let bench = Bench::new();
    for file in files(&[folder.join("oracles/ptex/malformed")]) {
        let name = file.display().to_string();
        for arguments in [
            &["ptex", "info", &name, "--json"][..],
            &["ptex", "check", &name],
        ] {
            let (code, _, errors) = run(&bench, arguments);
            // A neighbour that there is not is one only where it is looked for.
            if name.ends_with("adj_out_of_range.ptx") && arguments[1] == "info" {
                assert_eq!(code, 0, "{errors}");
            } else {
                expect((code, errors), 3, &[&name, "help:"]);
            }
        }
    }
}

fn files(folders: &[PathBuf]) -> Vec<PathBuf> {
    let entries = folders
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).expect("the folder"));
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "ptx"))
        .collect();
    files.sort();
    files
}
