//! Every value that the shared oracle files tell: what the reference implementation says of files that it wrote, and
//! of files that others made. Needs `RELIEVO_SHARED`.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Oracle, hash, oracles};
use relievo_ptex::{BorderMode, Cache, DataType, EdgeFilter, MeshType, MetaValue, Reader, Res};
use serde_json::{Value, json};

#[test]
fn info_is_that_of_the_oracles() {
    for Oracle { name, json, reader } in oracles() {
        let info = json!({
            "mesh_type": match reader.mesh_type() { MeshType::Quad => "quad", MeshType::Triangle => "triangle" },
            "data_type": match reader.data_type() {
                DataType::U8 => "uint8", DataType::U16 => "uint16", DataType::F16 => "float16", DataType::F32 => "float32",
            },
            "channels": reader.channels(),
            "alpha_channel": reader.header().alpha_channel,
            "faces": reader.face_count(),
            "u_border": border(reader.border_modes().0),
            "v_border": border(reader.border_modes().1),
            "edge_filter": match reader.edge_filter() { EdgeFilter::None => "none", EdgeFilter::TangentVector => "tanvec" },
            "has_edits": reader.has_edits(),
            "has_mipmaps": reader.header().levels > 1,
        });
        assert_eq!(info, json["info"], "{name}");
        let levels: Vec<Value> = reader
            .levels()
            .map(|l| json!({ "nfaces": l.faces, "levelheadersize": l.header_size, "leveldatasize": l.size }))
            .collect();
        assert_eq!(json!(levels), json["levels"], "{name}");
        assert_eq!(
            json!(reader.reduction_order()),
            json["reduction_order"],
            "{name}"
        );
    }
}

fn border(mode: BorderMode) -> &'static str {
    match mode {
        BorderMode::Clamp => "clamp",
        BorderMode::Black => "black",
        BorderMode::Periodic => "periodic",
    }
}

#[test]
fn meta_data_are_those_of_the_oracles() {
    for Oracle { name, json, reader } in oracles() {
        let meta = reader.meta().unwrap();
        let wanted = json["metadata"].as_array().unwrap();
        assert_eq!(meta.len(), wanted.len(), "{name}");
        for ((key, value), wanted) in meta.iter().zip(wanted) {
            assert_eq!(key, wanted["key"], "{name}");
            assert_eq!(value.type_name(), wanted["type"], "{name} {key}");
            assert_eq!(value.count(), wanted["count"], "{name} {key}");
            let wanted = &wanted["value"];
            let numbers = || {
                wanted
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|n| n.as_f64().unwrap())
            };
            match value {
                MetaValue::String(s) => assert_eq!(s, wanted, "{name} {key}"),
                MetaValue::I8(v) => assert_eq!(json!(v), *wanted, "{name} {key}"),
                MetaValue::I16(v) => assert_eq!(json!(v), *wanted, "{name} {key}"),
                MetaValue::I32(v) => assert_eq!(json!(v), *wanted, "{name} {key}"),
                MetaValue::F32(v) => {
                    assert!(
                        v.iter().copied().eq(numbers().map(|n| n as f32)),
                        "{name} {key}"
                    );
                }
                MetaValue::F64(v) => assert!(v.iter().copied().eq(numbers()), "{name} {key}"),
            }
        }
    }
}

#[test]
fn faces_are_those_of_the_oracles() {
    for Oracle { name, json, reader } in oracles() {
        let faces = json["faces"].as_array().unwrap();
        assert_eq!(reader.face_count() as usize, faces.len());
        let stored = reader.stored_faces().unwrap();
        for (face, wanted) in (0..).zip(faces) {
            let info = reader.face(face);
            let place = format!("{name} face {face}");
            assert_eq!(
                json!([info.res.ulog2, info.res.vlog2]),
                wanted["res"],
                "{place}"
            );
            let stored = &stored[face as usize];
            assert_eq!(json!(stored.faces), wanted["adjfaces"], "{place}");
            assert_eq!(
                json!([0, 1, 2, 3].map(|e| stored.edge(e))),
                wanted["adjedges"],
                "{place}"
            );
            assert_eq!(stored.flags, wanted["flags"], "{place}");
            assert_eq!(info.constant, wanted["constant"], "{place}");
            assert_eq!(info.constant_neighbourhood, wanted["nbconstant"], "{place}");
            assert_eq!(info.has_edits, wanted["hasedits"], "{place}");
            assert_eq!(info.subface, wanted["subface"], "{place}");
            let tiles = |res| match reader.tile_res(face, res).unwrap() {
                Some(tile) => json!([tile.ulog2, tile.vlog2]),
                None => Value::Null,
            };
            assert_eq!(tiles(info.res), wanted["tile_res"], "{place}");
            for reduction in wanted["chain"].as_array().unwrap() {
                assert_eq!(
                    tiles(res(&reduction["res"])),
                    reduction["tile_res"],
                    "{place} {reduction}"
                );
            }
            let one = reader
                .texels(face, Res { ulog2: 0, vlog2: 0 }, false)
                .unwrap();
            let mut texel = Vec::new();
            one.copy(0, 0, 1, 1, &mut texel).unwrap();
            assert_eq!(
                json!(common::raw(&texel, reader.data_type())),
                wanted["const_value"],
                "{place}"
            );
        }
    }
}

fn res(json: &Value) -> Res {
    let part = |i: usize| json[i].as_i64().unwrap() as i8;
    Res {
        ulog2: part(0),
        vlog2: part(1),
    }
}

#[test]
fn texels_are_those_of_the_oracles() {
    let mut count = 0;
    for Oracle { name, json, reader } in oracles() {
        for (face, wanted) in (0..).zip(json["faces"].as_array().unwrap()) {
            for kind in ["chain", "aniso"] {
                for reduction in wanted[kind].as_array().into_iter().flatten() {
                    let place = format!("{name} face {face} {kind} {}", reduction["res"]);
                    let size = res(&reduction["res"]);
                    let texels = reader.texels(face, size, false).unwrap();
                    assert_eq!(hash(&texels), reduction["sha256"], "{place}");
                    if reduction["constant"] == true {
                        assert!(texels.constant(), "{place}");
                    }
                    if let Some(wanted) = reduction.get("premult_sha256") {
                        let texels = reader.texels(face, size, true).unwrap();
                        assert_eq!(hash(&texels), *wanted, "{place} premultiplied");
                    }
                    count += 1;
                }
            }
        }
        for texel in json["texels"].as_array().unwrap() {
            let face = texel[0].as_u64().unwrap() as u32;
            let [x, y] = [2, 3].map(|i| texel[i].as_u64().unwrap() as usize);
            let texels = reader.texels(face, res(&texel[1]), false).unwrap();
            let mut bytes = Vec::new();
            texels.copy(x, y, 1, 1, &mut bytes).unwrap();
            let raw = common::raw(&bytes, reader.data_type());
            assert_eq!(json!(raw), texel[4], "{name} {texel}");
            let mut floats = vec![0.0; reader.channels()];
            texels.add(x, y, 1.0, 0, &mut floats).unwrap();
            for (value, wanted) in floats.iter().zip(texel[5].as_array().unwrap()) {
                let wanted = wanted.as_f64().unwrap() as f32;
                let value = value / reader.data_type().one();
                assert!(
                    (value - wanted).abs() <= wanted.abs() * 1e-6,
                    "{name} {texel}"
                );
            }
        }
    }
    println!("{count} reductions");
}

#[test]
fn a_small_cache_gives_the_same() {
    for Oracle { name, json, reader } in oracles() {
        let cache = Cache::new(20_000);
        let reader = Reader::open(reader.path(), &cache).unwrap();
        for (face, wanted) in (0..).zip(json["faces"].as_array().unwrap()) {
            for reduction in wanted["chain"].as_array().unwrap().iter().rev() {
                let texels = reader.texels(face, res(&reduction["res"]), false).unwrap();
                assert_eq!(hash(&texels), reduction["sha256"], "{name} face {face}");
                assert!(cache.held() <= cache.budget());
            }
        }
    }
}
