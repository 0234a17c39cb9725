//! Filters: every value that the shared oracle files tell, which needs `RELIEVO_SHARED`, and what is true of any file.
//!
//! Tolerances are those of the oracles' own statement: 2e-5, four times that for half and single floats.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::collections::BTreeMap;

use common::mesh::{Mesh, noise, polygons, read, rotated};
use common::{Oracle, oracles};
use proptest::prelude::*;
use relievo_ptex::{
    BorderMode, DataType, EdgeFilter, FaceInfo, Filter, FilterKind, Format, MeshType, Neighbour,
    Reader, Res,
};
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

fn any_filter() -> impl Strategy<Value = Filter> {
    let kind = prop::sample::select(FilterKind::NAMES.map(|(_, kind)| kind).to_vec());
    (
        kind,
        0.0..1.0_f32,
        any::<bool>(),
        any::<bool>(),
        0.5..2.0_f32,
        0.0..0.3_f32,
    )
        .prop_map(|(kind, sharpness, lerp, edge_blend, width, blur)| Filter {
            kind,
            sharpness,
            lerp,
            edge_blend,
            width,
            blur,
        })
}

/// Where and how wide: widths over all sizes, and places at edges and corners.
fn any_lookup() -> impl Strategy<Value = ([f32; 2], [f32; 4])> {
    let place = prop_oneof![
        0.0..1.0_f32,
        Just(0.0),
        Just(1.0),
        Just(0.5),
        0.0..0.02_f32,
        -1.5..2.5_f32
    ];
    let width = prop_oneof![
        0.0..0.1_f32,
        0.0..4.0_f32,
        Just(0.0),
        Just(0.25),
        Just(-1.0)
    ];
    (prop::array::uniform2(place), prop::array::uniform4(width))
}

fn size(seed: u32, face: u32) -> Res {
    let log2 = |channel| (noise(seed, face, [0.1, 0.2], channel) * 6.0) as i8;
    Res {
        ulog2: log2(0),
        vlog2: log2(1),
    }
}

fn one(reader: &Reader, filter: &Filter, face: u32, [u, v]: [f32; 2], w: [f32; 4]) -> f32 {
    let mut out = [f32::NAN];
    filter
        .eval(reader, face, u, v, w, 0, false, &mut out)
        .unwrap();
    out[0]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever the faces around: weights sum to one.
    #[test]
    fn constant_textures_stay_constant(which: u32, seed: u32, filter in any_filter(), (at, w) in any_lookup()) {
        let mesh = Mesh::new(&rotated(polygons(which), seed), |face| size(seed, face));
        // A second channel keeps faces from being stored as constant.
        let reader = mesh.reader(2, |face, at, channel| if channel == 0 { 0.7 } else { noise(seed, face, at, 1) });
        for face in 0..reader.face_count() {
            let value = one(&reader, &filter, face, at, w);
            prop_assert!((value - 0.7).abs() < 2e-5, "face {}: {}", face, value);
        }
    }

    /// Files lie. Kernels without negative parts stay between what is there, the others stay numbers.
    #[test]
    fn any_adjacency_gives_a_result(
        seed: u32, triangles: bool, modes in 0..3_u32, filter in any_filter(), (at, w) in any_lookup(),
    ) {
        const FACES: u32 = 6;
        let random = |face, k| noise(seed, face, [0.3, 0.4], k);
        let mut faces: Vec<FaceInfo> = (0..FACES)
            .map(|face| FaceInfo {
                res: size(seed, face),
                neighbours: std::array::from_fn(|edge| {
                    (random(face, edge) < 0.9 && !(triangles && edge == 3)).then(|| Neighbour {
                        face: (random(face, 10 + edge) * FACES as f32) as u32,
                        edge: (random(face, 20 + edge) * if triangles { 3.0 } else { 4.0 }) as u8,
                    })
                }),
                constant: false,
                has_edits: false,
                constant_neighbourhood: false,
                subface: random(face, 5) < 0.6 && !triangles,
            })
            .collect();
        let mut format = Format::new(MeshType::Quad, DataType::F32, 3);
        format.u_border = [BorderMode::Clamp, BorderMode::Periodic, BorderMode::Black][modes as usize];
        format.edge_filter = if seed & 1 == 1 { EdgeFilter::TangentVector } else { EdgeFilter::None };
        if triangles {
            format.mesh_type = MeshType::Triangle;
            faces.iter_mut().for_each(|face| face.res.vlog2 = face.res.ulog2);
        }
        let reader = read(format, &faces, |face, at, channel| 1.0 + noise(seed, face, at, channel));
        for face in 0..FACES {
            let mut out = [f32::NAN; 3];
            filter.eval(&reader, face, at[0], at[1], w, 0, false, &mut out).unwrap();
            let sharp = matches!(filter.kind, FilterKind::Bicubic | FilterKind::CatmullRom | FilterKind::Mitchell);
            if triangles || !sharp {
                let low = if modes == 2 { -1e-4 } else { 0.999 };
                prop_assert!(out[2] > low && out[2] < 2.001, "face {}: {:?}", face, out);
            }
            prop_assert!(out.iter().all(|x| x.is_finite()), "face {}: {:?}", face, out);
        }
    }
}

/// Two faces of a plane, each begun at any of its corners: what lies along their edge is the same from both, and a slope
/// goes on through it.
#[test]
fn slopes_go_on_in_turned_neighbours() {
    for turns in 0..16 {
        let mut polygons = vec![vec![0, 1, 4, 3], vec![1, 2, 5, 4]];
        polygons[0].rotate_left(turns % 4);
        polygons[1].rotate_left(turns / 4);
        let mesh = Mesh::new(&polygons, |_| Res { ulog2: 3, vlog2: 3 });
        let position = |face: u32, [u, v]: [f32; 2]| {
            let corner = |k: usize| {
                let vertex = polygons[face as usize][k];
                [(vertex % 3) as f32, (vertex / 3) as f32]
            };
            let (a, b, d) = (corner(0), corner(1), corner(3));
            [0, 1].map(|i| a[i] + (b[i] - a[i]) * u + (d[i] - a[i]) * v)
        };
        let reader = mesh.reader(1, |face, at, _| position(face, at)[0]);
        for (name, kind) in FilterKind::NAMES {
            if kind == FilterKind::Point {
                continue;
            }
            let filter = Filter::new(kind);
            for face in 0..2 {
                for at in [[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0], [0.5, 0.5]] {
                    let [x, _] = position(face, at);
                    // Borders flatten what is close to them.
                    if !(0.4..=1.6).contains(&x) {
                        continue;
                    }
                    let value = one(&reader, &filter, face, at, [0.125, 0.0, 0.0, 0.125]);
                    assert!(
                        (value - x).abs() < 2e-4,
                        "{name} {turns} {face} {at:?}: {value} for {x}"
                    );
                }
            }
        }
    }
}

/// Tangent vectors keep their direction on the surface across edges, whichever way faces are turned.
#[test]
fn vectors_turn_with_the_frame() {
    let mut format = Format::new(MeshType::Quad, DataType::F32, 3);
    format.edge_filter = EdgeFilter::TangentVector;
    for turns in 0..4 {
        let mut polygons = vec![vec![0, 1, 4, 3], vec![1, 2, 5, 4]];
        polygons[1].rotate_left(turns);
        let mesh = Mesh::new(&polygons, |_| Res { ulog2: 2, vlog2: 2 });
        // The vector (1, 0) of face 0, in the frame of face 1; and noise, or faces would be constant.
        let here = [[1.0, 0.0], [0.0, -1.0], [-1.0, 0.0], [0.0, 1.0]][turns];
        let reader = read(format.clone(), &mesh.faces, |face, at, channel| {
            match (face, channel) {
                (_, 2) => noise(1, face, at, 2),
                (0, _) => [1.0, 0.0][channel],
                _ => here[channel],
            }
        });
        let mut out = [0.0; 2];
        Filter::new(FilterKind::BSpline)
            .eval(
                &reader,
                0,
                0.95,
                0.5,
                [0.3, 0.0, 0.0, 0.3],
                0,
                false,
                &mut out,
            )
            .unwrap();
        assert!(
            (out[0] - 1.0).abs() < 1e-5 && out[1].abs() < 1e-5,
            "{turns}: {out:?}"
        );
    }
}

#[test]
fn what_cannot_be_is_an_error() {
    let mesh = Mesh::new(&polygons(0), |_| Res { ulog2: 1, vlog2: 1 });
    let reader = mesh.reader(2, |face, at, channel| noise(1, face, at, channel));
    let filter = Filter::new(FilterKind::Box);
    let mut out = [0.0; 3];
    for (face, u, w, first, count) in [
        (6, 0.5, 0.1, 0, 1),
        (0, f32::NAN, 0.1, 0, 1),
        (0, 0.5, f32::INFINITY, 0, 1),
        (0, 0.5, 0.1, 0, 3),
        (0, 0.5, 0.1, 2, 1),
        (0, 0.5, 0.1, usize::MAX, 2),
        (0, 0.5, 0.1, 0, 0),
    ] {
        let result = filter.eval(
            &reader,
            face,
            u,
            0.5,
            [w; 4],
            first,
            false,
            &mut out[..count],
        );
        assert!(result.is_err(), "{face} {u} {w} {first} {count}");
    }
}
