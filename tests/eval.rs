//! `relievo eval`: what a samples file may say, and what comes of it.

use std::fs;

use serde_json::Value;

use crate::common::program::{Bench, said};

const CAGE: &str =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

/// The result for these samples, or what was said against them.
fn eval(rows: &str, more: &str) -> Result<Value, String> {
    let bench = Bench::new();
    bench.write("cage.obj", CAGE);
    bench.write(
        "samples.json",
        format!(r#"{{"fields": ["u", "v", "ptex", "face"], "samples": {rows}{more}}}"#),
    );
    let words = [
        "eval",
        "cage.obj",
        "--samples",
        "samples.json",
        "-o",
        "out.json",
    ];
    match said(&bench.command(&words).output().expect("the program runs")) {
        (0, _) => {
            let text = fs::read_to_string(bench.path("out.json")).expect("written");
            Ok(serde_json::from_str(&text).expect("JSON"))
        }
        (3, text) => Err(text),
        (code, text) => panic!("{code}: {text}"),
    }
}

#[test]
fn rules_are_a_list_or_keys() {
    for rules in [
        r#"["none", "cornersPlus1"]"#,
        r#"{"none": null, "cornersPlus1": [], "dropped": 3}"#,
    ] {
        let result = eval(
            "[[0.5, 0.5, 0, 0]]",
            &format!(r#", "faceVarying": {rules}"#),
        );
        let result = result.expect("valid samples");
        let values = result["faceVarying"].as_object().expect("an object");
        assert_eq!(values.len(), 2, "{rules}");
        for value in values.values() {
            for x in value[0].as_array().expect("texture coordinates") {
                assert!((x.as_f64().expect("a number") - 0.5).abs() < 1e-12);
            }
        }
    }
    let unknown = eval("[]", r#", "faceVarying": {"smooth": true}"#);
    assert!(unknown.expect_err("no rule").contains("\"smooth\""));
}

#[test]
fn faces_may_be_written_as_floats() {
    let result = eval("[[0.5, 0.5, 0.0, 0e0]]", "").expect("valid samples");
    assert_eq!(result["samples"][0][0], 0);
    for face in ["0.5", "-1", "4294967296", "null", "7"] {
        let fault = eval(&format!("[[0.5, 0.5, 0, {face}]]"), "").expect_err("no face");
        assert!(fault.contains("sample 0"), "{face}: {fault}");
    }
}
