//! Cameras, lights and preview surfaces against what OpenUSD resolved.
#![allow(clippy::unwrap_used, missing_docs, reason = "a test")]

use relievo::math::Vec3;
use relievo::scene::{Camera, Input, Light, LightKind, PreviewSurface};
use serde_json::Value;

use super::values::{float, floats, matrix, near, property};

/// Compares the inputs of a preview surface that have values of their own; how many there were.
pub fn compare_surface(place: &str, surface: &PreviewSurface, shader: &Value, time: &str) -> usize {
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

pub fn compare_camera(place: &str, camera: &Camera, prim: &Value, time: &str) {
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
}

pub fn compare_light(place: &str, light: &Light, prim: &Value, time: &str) {
    let mine = light.world_from_light;
    assert!(near(mine, matrix(prim, time)), "{place}: {mine:?}");
    let base = if prim["type"] == "DistantLight" {
        50000.0
    } else {
        1.0
    };
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
        LightKind::Rect { width, height } => &[(width, "width", 1.0), (height, "height", 1.0)],
        LightKind::Disk { radius } | LightKind::Sphere { radius } => &[(radius, "radius", 0.5)],
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
}
