//! `relievo ptex`: what it tells of files, and its exit codes.

use std::path::PathBuf;

use relievo_ptex::{DataType, FaceInfo, Format, MeshType, MetaValue, Res, Writer};
use serde_json::{Value, json};

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

#[test]
fn eval_is_what_the_oracles_say() {
    let Some(folder) = shared("eval_is_what_the_oracles_say") else {
        return;
    };
    let folder = folder.join("oracles/ptex");
    let bench = Bench::new();
    for file in files(&[folder.clone(), folder.join("real")]) {
        let name = file.display().to_string();
        let values = std::fs::read(file.with_extension("json")).expect("its values");
        let values: Value = serde_json::from_slice(&values).expect("JSON");
        let (queries, wanted) = queries(&values);
        bench.write("queries.json", json!({ "queries": queries }).to_string());
        let arguments = [
            "ptex",
            "eval",
            &name,
            "--queries",
            "queries.json",
            "-o",
            "out.json",
        ];
        let (code, _, errors) = run(&bench, &arguments);
        assert_eq!(code, 0, "{errors}");
        let found = std::fs::read(bench.path("out.json")).expect("a result");
        let found: Value = serde_json::from_slice(&found).expect("JSON");
        let results = found["results"].as_array().expect("a list");
        assert_eq!(results.len(), wanted.len(), "{name}");
        // What the values are known to.
        let integers =
            ["uint8", "uint16"].contains(&values["info"]["data_type"].as_str().expect("a type"));
        let tolerance = if integers { 2e-5 } else { 8e-5 };
        for ((result, wanted), query) in results.iter().zip(wanted).zip(queries) {
            let (found, wanted) = (
                result.as_array().expect("a list"),
                wanted.as_array().expect("a list"),
            );
            assert_eq!(found.len(), wanted.len(), "{name} {query}");
            for (a, b) in found.iter().zip(wanted) {
                let error = a.as_f64().expect("a number") - b.as_f64().expect("a number");
                assert!(error.abs() <= tolerance, "{name} {query}: {result}");
            }
        }
    }
}

/// All evaluations of an oracle, with their results.
fn queries(values: &Value) -> (Vec<Value>, Vec<Value>) {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let premultiply = values["filter_premultiply"] == true;
    let mut all = vec![];
    for sample in list(&values["filters"]) {
        for (filter, result) in list(&values["filter_order"]).iter().zip(list(&sample["r"])) {
            let query = json!({
                "filter": filter, "premultiply": premultiply,
                "face": sample["face"], "u": sample["u"], "v": sample["v"], "w": sample["w"],
            });
            all.push((query, result));
        }
    }
    for variant in list(&values["variants"]) {
        for sample in list(&variant["samples"]) {
            let mut query = json!({
                "premultiply": premultiply,
                "face": sample[1], "u": sample[2], "v": sample[3], "w": sample[4],
            });
            for option in [
                "filter",
                "sharpness",
                "lerp",
                "noedgeblend",
                "width",
                "blur",
                "first_channel",
                "channels",
            ] {
                query[option] = variant[option].clone();
            }
            all.push((query, sample[5].clone()));
        }
    }
    all.into_iter().unzip()
}

#[test]
fn queries_are_answered_in_order_or_refused() {
    let bench = Bench::new();
    bench.write("a.ptx", file());
    let ask = |queries: Value| {
        bench.write("q.json", json!({ "queries": queries }).to_string());
        run(
            &bench,
            &[
                "ptex",
                "eval",
                "a.ptx",
                "--queries",
                "q.json",
                "-o",
                "out.json",
            ],
        )
    };
    let query = |filter: &str, face: u32, channels: usize| json!({ "filter": filter, "face": face, "u": 0.5, "v": 1.0, "w": [0.1, 0, 0, 0.1], "channels": channels });
    let (code, _, errors) = ask(json!([query("box", 0, 2), query("consistent", 1, 1)]));
    assert_eq!(code, 0, "{errors}");
    let out = std::fs::read(bench.path("out.json")).expect("a result");
    let out: Value = serde_json::from_slice(&out).expect("JSON");
    assert_eq!(out["results"][0].as_array().map(Vec::len), Some(2));
    assert_eq!(out["results"][1], json!([0.0]));
    for (wrong, word) in [
        (query("lanczos", 0, 1), "there is no filter `lanczos`"),
        (query("box", 7, 1), "face 7"),
        (query("box", 0, 1 << 40), "channels from 0 on"),
        (json!({ "filter": "box" }), "missing field"),
    ] {
        let (code, _, errors) = ask(json!([query("box", 0, 1), wrong]));
        expect((code, errors), 3, &["q.json", word, "help:"]);
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
