//! Compares what relievo reads of USD scenes with what OpenUSD itself resolved, written down as JSON, and
//! opens every USD file of a collection. Both lie in the folder that `RELIEVO_SHARED` names.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    reason = "a test"
)]

mod geometry;
mod looks;
mod values;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use relievo::error::Error;
use relievo::image::ImageSource;
use relievo::math::Vec3;
use relievo::scene::{Description, Geometry, LoadOptions, MissingLayers, Purpose, load};
use serde_json::Value;

use geometry::{compare_mesh, compare_patch, compare_primvars};
use looks::{compare_camera, compare_light, compare_surface};
use values::{float, integers, matrix, near};

fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("RELIEVO_SHARED").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: RELIEVO_SHARED names no folder of scenes");
    }
    folder
}

fn options(frame: f64) -> LoadOptions {
    LoadOptions {
        frame: Some(frame),
        motion_blur: false,
        purposes: Some(vec![Purpose::Render, Purpose::Proxy, Purpose::Guide]),
        missing_layers: MissingLayers::Skip,
        ..LoadOptions::default()
    }
}

/// Compares one scene at one time; the number of meshes, cameras, lights, primvars, material inputs and patches found.
fn compare(scene: &Path, oracle: &Value, time: &str) -> [usize; 6] {
    let frame = time.parse().unwrap();
    let description: Description = load(scene, &options(frame)).unwrap();
    let prims = oracle["prims"].as_object().unwrap();
    let placements: HashMap<&str, _> = description
        .placements
        .iter()
        .map(|p| (p.path.as_str(), p))
        .collect();
    let mut found = [0; 6];
    for (path, prim) in prims {
        let place = format!("{} {path} at {time}", scene.display());
        let hidden = prim["vis"].get(time).and_then(Value::as_str) == Some("invisible");
        let instanced = prims.iter().any(|(above, p)| {
            p["type"] == "PointInstancer" && path.starts_with(&format!("{above}/"))
        });
        if instanced {
            continue;
        }
        match prim["type"].as_str().unwrap() {
            "Mesh" => {
                let empty = integers(prim, "faceVertexCounts", time).is_empty();
                let Some(placement) = placements.get(path.as_str()) else {
                    assert!(hidden || empty, "{place} is missing");
                    continue;
                };
                assert!(!hidden && !empty, "{place} should not be there");
                let mine = placement.world_from_object[0];
                assert!(near(mine, matrix(prim, time)), "{place}: {mine:?}");
                let shape = &description.shapes[placement.shape];
                let mesh = shape.geometry.mesh().unwrap();
                compare_mesh(&place, mesh, prim, time);
                let color = placement.display_color;
                found[3] += compare_primvars(&place, mesh, color, prim, time);
                let theirs = prim["mat_full"].as_str().unwrap_or_default();
                let material = placement.material.or(shape.materials.whole);
                let mine = material.map(|m| description.materials[m].path.as_str());
                let surface = prims.get(theirs).and_then(|m| m["surf"].as_str());
                match mine {
                    // An instance's material is named in its prototype.
                    Some(mine) if mine.starts_with("/__") => assert!(!theirs.is_empty(), "{place}"),
                    Some(mine) => assert_eq!(mine, theirs, "{place}"),
                    None => assert!(surface.is_none_or(str::is_empty), "{place}: {theirs}"),
                }
                found[0] += 1;
            }
            "NurbsPatch" => {
                let placement = placements[path.as_str()];
                let mine = placement.world_from_object[0];
                assert!(near(mine, matrix(prim, time)), "{place}: {mine:?}");
                let Geometry::Nurbs(patch) = &description.shapes[placement.shape].geometry else {
                    panic!("{place} is not a patch");
                };
                compare_patch(&place, patch, prim);
                found[5] += 1;
            }
            "Camera" => {
                let camera = description.cameras.iter().find(|c| c.path == *path);
                compare_camera(&place, camera.unwrap(), prim, time);
                found[1] += 1;
            }
            "RectLight" | "DomeLight" | "SphereLight" | "DistantLight" | "DiskLight"
            | "CylinderLight" => {
                let light = description.lights.iter().find(|l| l.path == *path);
                let Some(light) = light else {
                    assert!(hidden, "{place} is missing");
                    continue;
                };
                compare_light(&place, light, prim, time);
                found[2] += 1;
            }
            "Material" => {
                let material = description.materials.iter().find(|m| m.path == *path);
                let terminal = prim["surf"].as_str().unwrap_or_default();
                let shader = prims.get(terminal.trim_end_matches(".outputs:surface"));
                if let (Some(material), Some(shader)) = (material, shader) {
                    found[4] += compare_surface(&place, &material.surface, shader, time);
                }
            }
            _ => {}
        }
    }
    found
}

/// The clips of the shared scene drive the size of a cube, which is left out where that is 0.
#[test]
fn value_clips_follow_their_times() {
    let Some(shared) = shared() else {
        return;
    };
    let file = shared.join("oracles/usd/clips_clips.usda.json");
    let oracle: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    let scene = shared.join("assets/usd-scenes/clips/clips.usda");
    for time in ["0", "2.5", "4", "5", "7", "10", "20"] {
        let description = load(&scene, &options(time.parse().unwrap())).unwrap();
        let cube = description.shapes.first();
        let size = cube.map_or(Vec3::ZERO, |cube| cube.geometry.bounds().extent());
        let theirs = float(&oracle["prims"]["/M"], "size", time, f32::NAN);
        assert_eq!(size.to_array(), [theirs; 3], "at {time}");
    }
}

#[test]
fn what_openusd_resolves_we_resolve() {
    let Some(shared) = shared() else {
        return;
    };
    let scenes = shared.join("assets/usd-scenes");
    let mut total = [0; 6];
    for (scene, oracle) in [
        ("features.usda", "features.usda"),
        ("features.usdc", "features.usdc"),
        ("features.usdz", "features.usdz"),
        ("comp/shot.usda", "comp_shot.usda"),
        ("comp/shot.usdz", "comp_shot.usdz"),
        ("comp/refz.usda", "comp_refz.usda"),
        ("comp/reloc.usda", "comp_reloc.usda"),
    ] {
        let file = shared.join(format!("oracles/usd/{oracle}.json"));
        let oracle: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        for time in ["0", "2.5", "4", "5", "7", "10", "20"] {
            let found = compare(&scenes.join(scene), &oracle, time);
            for (sum, n) in total.iter_mut().zip(found) {
                *sum += n;
            }
        }
    }
    println!("meshes, cameras, lights, primvars, material inputs, patches compared: {total:?}");
    assert!(total.iter().all(|n| *n > 0), "{total:?}");
}

#[test]
fn packages_bring_their_textures_and_splines_are_told() {
    let Some(shared) = shared() else {
        return;
    };
    let scenes = shared.join("assets/usd-scenes");
    let packed = load(&scenes.join("features.usdz"), &options(0.0)).unwrap();
    assert!(!packed.textures.is_empty());
    for texture in &packed.textures {
        let ImageSource::Packed { package, tiles } = &texture.image else {
            panic!("{:?} is not in the package", texture.image);
        };
        assert!(package.ends_with("features.usdz"));
        assert!(!tiles.is_empty() && tiles.iter().all(|(_, _, bytes)| !bytes.is_empty()));
    }
    let loose = load(&scenes.join("features.usda"), &options(0.0)).unwrap();
    assert_eq!(loose.textures.len(), packed.textures.len());
    for texture in &loose.textures {
        let ImageSource::File(file) = &texture.image else {
            panic!("{:?} is not a file", texture.image);
        };
        let tile = file.to_string_lossy().replace("<UDIM>", "1001");
        assert!(Path::new(&tile).exists(), "{tile}");
    }
    let spline = load(&scenes.join("spline.usda"), &options(2.5)).unwrap();
    assert!(spline.warnings.iter().any(|w| w.kind == "spline"));
}

fn usd_files(folder: &Path, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        if path.is_dir() {
            usd_files(&path, out);
        } else if matches!(ending, "usd" | "usda" | "usdc" | "usdz") {
            out.push(path);
        }
    }
}

#[test]
fn every_file_is_read_or_refused() {
    let Some(shared) = shared() else {
        return;
    };
    let mut files = Vec::new();
    usd_files(&shared.join("assets"), &mut files);
    files.sort();
    let (mut read, mut refused) = (0, 0);
    for file in &files {
        match load(file, &LoadOptions::default()) {
            Ok(_) => read += 1,
            Err(Error::Input(fault)) => {
                assert!(!fault.message.contains("gave up"), "{fault}");
                println!("refused: {fault}");
                refused += 1;
            }
            Err(other) => panic!("{}: {other}", file.display()),
        }
    }
    println!("read {read}, refused {refused}");
    assert!(read > 0);
}
