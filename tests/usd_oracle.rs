//! Compares what relievo reads of USD scenes with what OpenUSD itself resolved, written down as JSON, and
//! opens every USD file of a collection. Both lie in the folder that `RELIEVO_SHARED` names.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    reason = "a test"
)]

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use relievo::error::Error;
use relievo::image::ImageSource;
use relievo::math::{DAffine3, DMat4, Vec3};
use relievo::mesh::{
    BoundaryInterpolation, ControlMesh, Crease, FaceVaryingInterpolation, Interpolation, Scheme,
    TriangleRule,
};
use relievo::scene::{
    Description, Input, LightKind, LoadOptions, MissingLayers, PreviewSurface, Purpose, load,
};
use serde_json::Value;

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

/// The value of a property at a time; a default for what has no samples.
fn property<'a>(prim: &'a Value, name: &str, time: &str) -> Option<&'a Value> {
    let property = prim.get("props")?.get(name)?;
    property.get(time).or_else(|| property.get("d"))
}

fn integers(prim: &Value, name: &str, time: &str) -> Vec<u32> {
    let values = property(prim, name, time).and_then(Value::as_array);
    values
        .into_iter()
        .flatten()
        .map(|v| u32::try_from(v.as_i64().unwrap()).unwrap())
        .collect()
}

fn word<'a>(prim: &'a Value, name: &str, default: &'a str) -> &'a str {
    property(prim, name, "d")
        .and_then(Value::as_str)
        .unwrap_or(default)
}

fn float(prim: &Value, name: &str, time: &str, default: f32) -> f32 {
    property(prim, name, time)
        .and_then(Value::as_f64)
        .map_or(default, |v| v as f32)
}

fn matrix(prim: &Value, time: &str) -> DAffine3 {
    let xf = &prim["xf"];
    let numbers = xf.get(time).unwrap_or(&xf["d"]).as_array().unwrap();
    let numbers: Vec<f64> = numbers.iter().map(|v| v.as_f64().unwrap()).collect();
    DAffine3::from_mat4(DMat4::from_cols_slice(&numbers))
}

fn near(a: DAffine3, b: DAffine3) -> bool {
    let size = 1.0
        + b.to_cols_array()
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
    a.abs_diff_eq(b, 2e-6 * size)
}

fn floats(prim: &Value, name: &str, time: &str) -> Vec<f32> {
    let mut out = Vec::new();
    numbers(property(prim, name, time).unwrap_or(&Value::Null), &mut out);
    out
}

/// The numbers of a value, however deep; whether there is nothing else in it.
fn numbers(value: &Value, out: &mut Vec<f32>) -> bool {
    match value {
        Value::Number(n) => {
            out.push(n.as_f64().unwrap() as f32);
            true
        }
        Value::Array(values) => values.iter().all(|v| numbers(v, out)),
        _ => false,
    }
}

/// One crease an edge, with the sharpness of its chain or its own.
fn creases(prim: &Value, time: &str) -> Vec<Crease> {
    let indices = integers(prim, "creaseIndices", time);
    let lengths = integers(prim, "creaseLengths", time);
    let sharpnesses = floats(prim, "creaseSharpnesses", time);
    let mut out: Vec<Crease> = Vec::new();
    let mut start = 0;
    for (chain, length) in lengths.iter().enumerate() {
        for edge in indices[start..start + *length as usize].windows(2) {
            let of_chain = sharpnesses.len() == lengths.len();
            out.push(Crease {
                vertices: [edge[0], edge[1]],
                sharpness: sharpnesses[if of_chain { chain } else { out.len() }],
            });
        }
        start += *length as usize;
    }
    out
}

/// Compares the primvars of floats, flattened and inherited ones included; how many there were.
fn compare_primvars(
    place: &str,
    mesh: &ControlMesh,
    inherited_color: Option<Vec3>,
    prim: &Value,
    time: &str,
) -> usize {
    let mut found = 0;
    for (name, theirs) in prim["pv"].as_object().unwrap() {
        let place = format!("{place}: primvar {name}");
        let own = &prim["props"][format!("primvars:{name}")];
        // What was flattened is the default value; texts and whole numbers are no primvars to a renderer.
        let type_name = own["type"].as_str().unwrap_or("float");
        let is_float = [
            "float", "double", "half", "color", "texCoord", "vector", "point", "normal",
        ]
        .iter()
        .any(|start| type_name.starts_with(start));
        if own.get("times").is_some() || !is_float || name == "normals" {
            continue;
        }
        let mut values = Vec::new();
        if !numbers(&theirs["flat"], &mut values) || values.is_empty() {
            continue;
        }
        let interpolation = match theirs["interp"].as_str().unwrap() {
            "constant" => Interpolation::Constant,
            "uniform" => Interpolation::Uniform,
            "varying" => Interpolation::Varying,
            "vertex" => Interpolation::Vertex,
            "faceVarying" => Interpolation::FaceVarying,
            other => panic!("{place}: {other}"),
        };
        let Some(mine) = mesh.primvar(name) else {
            assert_eq!(name, "displayColor", "{place} is missing at {time}");
            let color = inherited_color.map(|c| c.to_array().to_vec());
            assert_eq!(color, Some(values), "{place}");
            continue;
        };
        assert_eq!(mine.interpolation, interpolation, "{place}");
        let count = mine.indices.as_ref().map_or(mine.elements(), Vec::len);
        let flat: Vec<f32> = (0..count).flat_map(|i| mine.get(i).to_vec()).collect();
        assert_eq!(flat, values, "{place}");
        let element = theirs["es"].as_u64().unwrap() as u32;
        assert_eq!(mine.width % element, 0, "{place}");
        found += 1;
    }
    found
}

/// Compares the inputs of a preview surface that have values of their own; how many there were.
fn compare_surface(place: &str, surface: &PreviewSurface, shader: &Value, time: &str) -> usize {
    let color = |input: &Input<Vec3>| match input {
        Input::Value(v) => Some(v.to_array().to_vec()),
        _ => None,
    };
    let number = |input: &Input<f32>| match input {
        Input::Value(v) => Some(vec![*v]),
        _ => None,
    };
    let inputs = [
        ("diffuseColor", color(&surface.diffuse_color)),
        ("emissiveColor", color(&surface.emissive_color)),
        ("specularColor", color(&surface.specular_color)),
        ("metallic", number(&surface.metallic)),
        ("roughness", number(&surface.roughness)),
        ("clearcoat", number(&surface.clearcoat)),
        ("clearcoatRoughness", number(&surface.clearcoat_roughness)),
        ("opacity", number(&surface.opacity)),
        ("opacityThreshold", Some(vec![surface.opacity_threshold])),
        ("ior", number(&surface.ior)),
        ("displacement", number(&surface.displacement)),
        ("occlusion", number(&surface.occlusion)),
    ];
    let mut found = 0;
    for (name, mine) in inputs {
        let name = format!("inputs:{name}");
        let connected = shader["props"][&name].get("conn").is_some();
        if property(shader, &name, time).is_some_and(|v| !v.is_null()) && !connected {
            assert_eq!(mine, Some(floats(shader, &name, time)), "{place} {name}");
            found += 1;
        }
    }
    found
}

fn compare_mesh(place: &str, mesh: &ControlMesh, prim: &Value, time: &str) {
    assert_eq!(
        mesh.face_vertex_counts,
        integers(prim, "faceVertexCounts", time),
        "{place}"
    );
    assert_eq!(
        mesh.face_vertex_indices,
        integers(prim, "faceVertexIndices", time),
        "{place}"
    );
    assert_eq!(mesh.holes, integers(prim, "holeIndices", time), "{place}");
    let corners: Vec<u32> = mesh.corners.iter().map(|c| c.vertex).collect();
    assert_eq!(corners, integers(prim, "cornerIndices", time), "{place}");
    let sharpnesses: Vec<f32> = mesh.corners.iter().map(|c| c.sharpness).collect();
    assert_eq!(
        sharpnesses,
        floats(prim, "cornerSharpnesses", time),
        "{place}"
    );
    assert_eq!(mesh.creases, creases(prim, time), "{place}");
    let points = property(prim, "points", time)
        .and_then(Value::as_array)
        .unwrap();
    assert_eq!(mesh.points[0].len(), points.len(), "{place}");
    for (mine, theirs) in mesh.points[0].iter().zip(points) {
        let theirs: Vec<f32> = theirs
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap() as f32)
            .collect();
        assert!(mine.abs_diff_eq(Vec3::from_slice(&theirs), 1e-5), "{place}");
    }
    let scheme = match word(prim, "subdivisionScheme", "catmullClark") {
        "loop" => Scheme::Loop,
        "bilinear" => Scheme::Bilinear,
        "none" => Scheme::None,
        _ => Scheme::CatmullClark,
    };
    let boundary = match word(prim, "interpolateBoundary", "edgeAndCorner") {
        "none" => BoundaryInterpolation::None,
        "edgeOnly" => BoundaryInterpolation::EdgeOnly,
        _ => BoundaryInterpolation::EdgeAndCorner,
    };
    let face_varying = match word(prim, "faceVaryingLinearInterpolation", "cornersPlus1") {
        "none" => FaceVaryingInterpolation::None,
        "cornersOnly" => FaceVaryingInterpolation::CornersOnly,
        "cornersPlus2" => FaceVaryingInterpolation::CornersPlus2,
        "boundaries" => FaceVaryingInterpolation::Boundaries,
        "all" => FaceVaryingInterpolation::All,
        _ => FaceVaryingInterpolation::CornersPlus1,
    };
    let triangles = match word(prim, "triangleSubdivisionRule", "catmullClark") {
        "smooth" => TriangleRule::Smooth,
        _ => TriangleRule::CatmullClark,
    };
    assert_eq!(
        (
            mesh.scheme,
            mesh.boundary,
            mesh.face_varying,
            mesh.triangle_rule
        ),
        (scheme, boundary, face_varying, triangles),
        "{place}"
    );
    assert_eq!(
        mesh.left_handed,
        word(prim, "orientation", "rightHanded") == "leftHanded",
        "{place}"
    );
}

/// Compares one scene at one time; the number of meshes, cameras, lights, primvars and material inputs found.
fn compare(scene: &Path, oracle: &Value, time: &str) -> [usize; 5] {
    let frame = time.parse().unwrap();
    let description: Description = load(scene, &options(frame)).unwrap();
    let prims = oracle["prims"].as_object().unwrap();
    let placements: HashMap<&str, _> = description
        .placements
        .iter()
        .map(|p| (p.path.as_str(), p))
        .collect();
    let mut found = [0; 5];
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
                compare_mesh(&place, &shape.mesh, prim, time);
                let color = placement.display_color;
                found[3] += compare_primvars(&place, &shape.mesh, color, prim, time);
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
            "Camera" => {
                let camera = description
                    .cameras
                    .iter()
                    .find(|c| c.path == *path)
                    .unwrap();
                let mine = camera.world_from_camera[0];
                assert!(near(mine, matrix(prim, time)), "{place}: {mine:?}");
                for (mine, name, default) in [
                    (camera.focal_length, "focalLength", 50.0),
                    (camera.aperture.x, "horizontalAperture", 20.955),
                    (camera.aperture.y, "verticalAperture", 15.2908),
                    (camera.aperture_offset.x, "horizontalApertureOffset", 0.0),
                    (camera.f_stop, "fStop", 0.0),
                    (camera.focus_distance, "focusDistance", 0.0),
                    (camera.exposure, "exposure", 0.0),
                    (camera.shutter[0] as f32, "shutter:open", 0.0),
                    (camera.shutter[1] as f32, "shutter:close", 0.0),
                ] {
                    let theirs = float(prim, name, time, default);
                    assert!(
                        (mine - theirs).abs() < 1e-5,
                        "{place} {name}: {mine} {theirs}"
                    );
                }
                found[1] += 1;
            }
            kind @ ("RectLight" | "DomeLight" | "SphereLight" | "DistantLight" | "DiskLight"
            | "CylinderLight") => {
                let light = description.lights.iter().find(|l| l.path == *path);
                let Some(light) = light else {
                    assert!(hidden, "{place} is missing");
                    continue;
                };
                let mine = light.world_from_light;
                assert!(near(mine, matrix(prim, time)), "{place}: {mine:?}");
                let base = if kind == "DistantLight" { 50000.0 } else { 1.0 };
                let scale = float(prim, "inputs:intensity", time, base)
                    * float(prim, "inputs:exposure", time, 0.0).exp2();
                let color = property(prim, "inputs:color", time)
                    .and_then(Value::as_array)
                    .map_or(Vec3::ONE, |c| {
                        let c: Vec<f32> = c.iter().map(|v| v.as_f64().unwrap() as f32).collect();
                        Vec3::from_slice(&c)
                    });
                assert!(light.color.abs_diff_eq(color * scale, 1e-3), "{place}");
                let sizes: &[(f32, &str, f32)] = match light.kind {
                    LightKind::Rect { width, height } => {
                        &[(width, "width", 1.0), (height, "height", 1.0)]
                    }
                    LightKind::Disk { radius } | LightKind::Sphere { radius } => {
                        &[(radius, "radius", 0.5)]
                    }
                    LightKind::Cylinder { radius, length } => {
                        &[(radius, "radius", 0.5), (length, "length", 1.0)]
                    }
                    LightKind::Distant { angle } => &[(angle, "angle", 0.53)],
                    LightKind::Dome => &[],
                };
                let shaping = light.shaping.map_or([0.0, 90.0, 0.0], |s| {
                    [s.focus, s.cone_angle, s.cone_softness]
                });
                let others = [
                    (light.diffuse, "diffuse", 1.0),
                    (light.specular, "specular", 1.0),
                    (shaping[0], "shaping:focus", 0.0),
                    (shaping[1], "shaping:cone:angle", 90.0),
                    (shaping[2], "shaping:cone:softness", 0.0),
                ];
                for &(mine, name, default) in sizes.iter().chain(&others) {
                    let theirs = float(prim, &format!("inputs:{name}"), time, default);
                    assert_eq!(mine, theirs, "{place}: {name}");
                }
                let normalize = property(prim, "inputs:normalize", time).and_then(Value::as_bool);
                assert_eq!(light.normalize, normalize.unwrap_or(false), "{place}");
                let file = prim["props"].get("inputs:texture:file").is_some();
                assert_eq!(light.texture.is_some(), file, "{place}");
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

/// The clips of the shared scene drive the size of a cube, which relievo does not draw: the same clips are made
/// to drive a camera's focus, and must give what OpenUSD resolved for the size.
#[test]
fn value_clips_follow_their_times() {
    let Some(shared) = shared() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    for file in ["clips.usda", "manifest.usda", "c.0.usda", "c.1.usda"] {
        let text =
            std::fs::read_to_string(shared.join("assets/usd-scenes/clips").join(file)).unwrap();
        let text = text
            .replace("Cube", "Camera")
            .replace("double size", "float focusDistance");
        std::fs::write(folder.path().join(file), text).unwrap();
    }
    let file = shared.join("oracles/usd/clips_clips.usda.json");
    let oracle: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    for time in ["0", "2.5", "4", "5", "7", "10", "20"] {
        let frame = time.parse().unwrap();
        let description = load(&folder.path().join("clips.usda"), &options(frame)).unwrap();
        let theirs = float(&oracle["prims"]["/M"], "size", time, f32::NAN);
        assert_eq!(description.cameras[0].focus_distance, theirs, "at {time}");
    }
}

#[test]
fn what_openusd_resolves_we_resolve() {
    let Some(shared) = shared() else {
        return;
    };
    let scenes = shared.join("assets/usd-scenes");
    let mut total = [0; 5];
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
    println!("meshes, cameras, lights, primvars, material inputs compared: {total:?}");
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
