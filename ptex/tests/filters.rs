//! Filters against every value that the shared oracle files tell. Needs `RELIEVO_SHARED`.
//!
//! Tolerances are those of the oracles' own statement: 2e-5, four times that for half and single floats.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::collections::BTreeMap;

use common::{Oracle, oracles};
use relievo_ptex::{DataType, Filter, FilterKind, Reader};
use serde_json::Value;

#[test]
fn results_are_those_of_the_oracles() {
    let mut failures = vec![];
    for Oracle { name, json, reader } in oracles() {
        let premultiply = json["filter_premultiply"].as_bool().unwrap_or(false);
        let tolerance = match reader.data_type() {
            DataType::U8 | DataType::U16 => 2e-5,
            DataType::F16 | DataType::F32 => 8e-5,
        };
        let mut worst = BTreeMap::new();
        let mut check = |label: String, filter: &Filter, sample: &Sample, first, result: &Value| {
            let wanted: Vec<f64> = numbers(result).collect();
            let got = sample.eval(&reader, filter, first, wanted.len(), premultiply);
            let error = wanted
                .iter()
                .zip(&got)
                .map(|(wanted, got)| (wanted - f64::from(*got)).abs())
                .fold(
                    0.0,
                    |a: f64, b| if b.is_nan() { f64::INFINITY } else { a.max(b) },
                );
            if error > tolerance {
                failures.push(format!("{name} {label} {sample:?}: {got:?} for {wanted:?}"));
            }
            let entry = worst.entry(label).or_insert(0.0_f64);
            *entry = entry.max(error);
        };

        let names: Vec<&str> = list(&json["filter_order"])
            .map(|n| n.as_str().unwrap())
            .collect();
        for sample in list(&json["filters"]) {
            let point = Sample::new(&[
                &sample["kind"],
                &sample["face"],
                &sample["u"],
                &sample["v"],
                &sample["w"],
            ]);
            for (name, result) in names.iter().zip(list(&sample["r"])) {
                let filter = Filter::new(name.parse().unwrap());
                check(format!("{name} {}", point.kind), &filter, &point, 0, result);
            }
        }
        for variant in list(&json["variants"]) {
            let number = |key: &str| variant[key].as_f64().unwrap() as f32;
            let is = |key: &str| variant[key].as_bool().unwrap();
            let filter = Filter {
                sharpness: number("sharpness"),
                lerp: is("lerp"),
                edge_blend: !is("noedgeblend"),
                width: number("width"),
                blur: number("blur"),
                ..Filter::new(variant["filter"].as_str().unwrap().parse().unwrap())
            };
            let first = variant["first_channel"].as_u64().unwrap() as usize;
            for sample in list(&variant["samples"]) {
                let parts: Vec<&Value> = list(sample).collect();
                let point = Sample::new(&parts[..5]);
                let label = format!("{} {}", variant["name"].as_str().unwrap(), point.kind);
                check(label, &filter, &point, first, parts[5]);
            }
        }
        let all = worst.values().copied().fold(0.0, f64::max);
        println!("{name}: worst error {all:.1e} of {tolerance:.0e} allowed");
        if std::env::var_os("PTEX_VERBOSE").is_some() {
            for (label, error) in worst {
                println!("    {label}: {error:.1e}");
            }
        }
    }
    assert!(
        failures.is_empty(),
        "{} results are wrong:\n{}",
        failures.len(),
        failures[..failures.len().min(40)].join("\n")
    );
}

/// Where a filter was evaluated.
#[derive(Debug)]
struct Sample {
    kind: String,
    face: u32,
    u: f32,
    v: f32,
    w: [f32; 4],
}

impl Sample {
    fn new(parts: &[&Value]) -> Self {
        let w: Vec<f32> = numbers(parts[4]).map(|x| x as f32).collect();
        Self {
            kind: parts[0].as_str().unwrap().to_owned(),
            face: parts[1].as_u64().unwrap() as u32,
            u: parts[2].as_f64().unwrap() as f32,
            v: parts[3].as_f64().unwrap() as f32,
            w: w.try_into().unwrap(),
        }
    }

    fn eval(
        &self,
        reader: &Reader,
        filter: &Filter,
        first: usize,
        channels: usize,
        premultiply: bool,
    ) -> Vec<f32> {
        let mut out = vec![f32::NAN; channels];
        filter
            .eval(
                reader,
                self.face,
                self.u,
                self.v,
                self.w,
                first,
                premultiply,
                &mut out,
            )
            .unwrap();
        out
    }
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn numbers(value: &Value) -> impl Iterator<Item = f64> {
    list(value).map(|x| x.as_f64().unwrap())
}

#[test]
fn kinds_have_names() {
    for (name, kind) in FilterKind::NAMES {
        assert_eq!(name.parse::<FilterKind>().unwrap(), kind);
    }
    assert!(
        "lanczos"
            .parse::<FilterKind>()
            .unwrap_err()
            .help()
            .contains("mitchell")
    );
}
