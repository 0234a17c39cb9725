//! Textures seen from afar, at a slant, in mirrors and by light that they throw: as wide as rays are there.

use std::path::{Path, PathBuf};
use std::process::Command;

use relievo::image::{Channel, ChannelFormat, Compression, Part, Picture, write_exr};
use relievo::math::Vec3;
use relievo::mesh::{ptex_face_count, ptex_faces, ptex_kind};
use relievo::scene::{Geometry, LoadOptions, load};
use relievo_ptex::{DataType, Format, Res, Writer};

use crate::common::{mean, options, read, run, write_scene};

/// A camera of 64 x 64 pixels that are a unit wide at a distance of `64 / 2`, and textured polygons that glow.
const SCENE: &str = r#"
def Camera "Camera" {
    float focalLength = 10
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.01, 1000000)
    CAMERA
}
def DomeLight "Sky" { float inputs:intensity = 0 }
def Material "Glow" {
    token outputs:surface.connect = </Glow/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0, 0, 0)
        float inputs:ior = 1
        color3f inputs:emissiveColor.connect = </Glow/Image.outputs:rgb>
        token outputs:surface
    }
    def Shader "Image" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./IMAGE@
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        token inputs:sourceColorSpace = "raw"
        float2 inputs:st.connect = </Glow/Coordinates.outputs:result>
        color3f outputs:rgb
    }
    def Shader "Coordinates" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
def Material "Mirror" {
    token outputs:surface.connect = </Mirror/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (1, 1, 1)
        float inputs:metallic = 1
        float inputs:roughness = 0
        token outputs:surface
    }
}
def Material "Plaster" {
    token outputs:surface.connect = </Plaster/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (1, 1, 1)
        float inputs:ior = 1
        token outputs:surface
    }
}
"#;

fn scene(folder: &Path, image: &str, camera: &str, shapes: &str) -> PathBuf {
    let body = SCENE.replace("IMAGE", image).replace("CAMERA", camera);
    write_scene(folder, "scene.usda", &(body + shapes))
}

/// A rectangle with these corners, around which `st` runs once in each `period` units along its sides.
fn rectangle(
    name: &str,
    scheme: &str,
    corners: [[f64; 3]; 4],
    period: f64,
    material: &str,
) -> String {
    let length = |a: [f64; 3], b: [f64; 3]| {
        let squares = a.into_iter().zip(b).map(|(a, b)| (a - b) * (a - b));
        squares.sum::<f64>().sqrt() / period
    };
    let (s, t) = (
        length(corners[0], corners[1]),
        length(corners[1], corners[2]),
    );
    let points = corners
        .map(|[x, y, z]| format!("({x}, {y}, {z})"))
        .join(", ");
    format!(
        r#"
def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </{material}>
    uniform token subdivisionScheme = "{scheme}"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [{points}]
    texCoord2f[] primvars:st = [(0, 0), ({s}, 0), ({s}, {t}), (0, {t})] (interpolation = "vertex")
}}
"#
    )
}

/// Of three equal channels.
fn write_grey(path: &Path, width: u32, grey: &[f32]) {
    let channels = ["R", "G", "B"].map(|name| Channel {
        name: name.into(),
        format: ChannelFormat::Half,
    });
    let height = grey.len() as u32 / width;
    let picture = Picture {
        width,
        height,
        display_window: (width, height, 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: channels.to_vec(),
            pixels: grey.iter().flat_map(|&v| [v; 3]).collect(),
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    };
    write_exr(path, &picture).expect("written");
}

/// A tiled texture of 256 x 256 texels whose levels show their own numbers; none without OpenImageIO's tools.
fn write_levels(folder: &Path) -> Option<()> {
    let mut maketx = Command::new("maketx");
    for level in (1..9).chain([0]) {
        let size = 256 >> level;
        let path = folder.join(format!("{level}.exr"));
        write_grey(&path, size, &vec![level as f32; (size * size) as usize]);
        if level > 0 {
            maketx.arg("--mipimage");
        }
        maketx.arg(path);
    }
    let output = maketx.arg("-o").arg(folder.join("levels.tx")).output();
    if output
        .as_ref()
        .is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound)
    {
        println!("SKIPPED: maketx is not installed");
        return None;
    }
    let output = output.expect("it runs");
    assert!(output.status.success(), "{output:?}");
    Some(())
}

/// What the pixels of a picture show that is made of these samples, as wide as `footprint`.
fn pixels(scene: &Path, spp: u32, footprint: f32) -> Vec<Vec3> {
    let picture = scene.with_extension("exr");
    let mut options = options(scene, &picture);
    options.resolution = Some([64, 64]);
    options.spp = spp;
    options.path.footprint = footprint;
    run(&options);
    read(&picture).2
}

/// The level that the middle of a picture shows.
fn level(scene: &Path, spp: u32) -> f32 {
    let pixels = pixels(scene, spp, 1.0);
    let middle = |i: &usize| (24..40).contains(&(i / 64)) && (24..40).contains(&(i % 64));
    let seen: Vec<Vec3> = (0..64 * 64).filter(middle).map(|i| pixels[i]).collect();
    mean(&seen).x
}

const STRAIGHT: &str = "";

/// A wall across the camera's view.
fn wall(scheme: &str, distance: f64, period: f64) -> String {
    let (h, z) = (2.0 * distance, -distance);
    let corners = [[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]];
    rectangle("Wall", scheme, corners, period, "Glow")
}

#[test]
fn a_checkerboard_fades_to_its_mean() {
    let folder = tempfile::tempdir().expect("a folder");
    // 16 x 16 texels a square, so that single texels are easily found.
    let squares: Vec<f32> = (0..64 * 64)
        .map(|i| ((i / 16 + i / 64 / 16) % 2) as f32)
        .collect();
    write_grey(&folder.path().join("squares.exr"), 64, &squares);
    for scheme in ["none", "bilinear"] {
        let corners = [
            [-5e3, -1.0, 1.0],
            [5e3, -1.0, 1.0],
            [5e3, -1.0, -1e4],
            [-5e3, -1.0, -1e4],
        ];
        let plane = rectangle("Plane", scheme, corners, 1.0, "Glow");
        let scene = scene(folder.path(), "squares.exr", STRAIGHT, &plane);
        let reference = pixels(&scene, 1024, 0.0);
        let wide = pixels(&scene, 1, 1.0);
        let narrow = pixels(&scene, 1, 0.0);
        // From the horizon, row 32, to where a pixel is a square and a half.
        let far = 33 * 64..38 * 64;
        let spread = |picture: &[Vec3]| {
            let off = far.clone().map(|i| (picture[i] - reference[i]).x.powi(2));
            off.sum::<f32>() / far.len() as f32
        };
        let (before, after) = (spread(&narrow), spread(&wide));
        println!("{scheme}: variance {before} by a texel, {after} by areas");
        assert!(after < 0.05 * before, "{scheme}: {after} and {before}");
        let means = [&wide, &reference].map(|picture| mean(&picture[far.clone()]).x);
        assert!((means[0] - means[1]).abs() < 0.005, "{scheme}: {means:?}");
        assert!((means[1] - 0.5).abs() < 0.01, "{scheme}: {means:?}");
        // Near the camera both see the squares.
        let near = 60 * 64..64 * 64;
        let off = near.map(|i| (wide[i] - narrow[i]).length()).sum::<f32>() / 256.0;
        assert!(off < 0.1, "{scheme}: {off}");
    }
}

#[test]
fn a_texture_file_shows_the_level_of_its_distance() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(()) = write_levels(folder.path()) else {
        return;
    };
    for scheme in ["none", "bilinear", "catmullClark"] {
        for (distance, period) in [(32.0, 8.0), (32.0, 3.0), (200.0, 3.0), (2000.0, 5000.0)] {
            let wall = wall(scheme, distance, period);
            let scene = scene(folder.path(), "levels.tx", STRAIGHT, &wall);
            // A pixel's width on the wall, in texels.
            let texels = distance / 32.0 * 256.0 / period;
            for (spp, share) in [(1, 1.0), (16, 0.25), (256, 0.125)] {
                let wanted = (texels * share).log2().clamp(0.0, 8.0) as f32;
                let seen = level(&scene, spp);
                println!("{scheme}: {seen} for {wanted} at {distance}");
                assert!(
                    (seen - wanted).abs() < 0.25,
                    "{scheme}: {seen} for {wanted}"
                );
            }
        }
    }
}

/// The camera looks at a mirror, or a wall of plaster, in which a textured wall behind the camera is seen.
#[test]
fn mirrors_keep_the_width_of_rays_and_plaster_spreads_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(()) = write_levels(folder.path()) else {
        return;
    };
    let behind = {
        let (h, z) = (4e3, 96.0);
        let corners = [[h, -h, z], [-h, -h, z], [-h, h, z], [h, h, z]];
        rectangle("Behind", "none", corners, 100.0, "Glow")
    };
    let at = |material: &str, spp: u32| {
        let h = 64.0;
        let corners = [
            [-h, -h, -32.0],
            [h, -h, -32.0],
            [h, h, -32.0],
            [-h, h, -32.0],
        ];
        let shapes = rectangle("Front", "none", corners, 1.0, material) + &behind;
        level(&scene(folder.path(), "levels.tx", STRAIGHT, &shapes), spp)
    };
    // 32 to the mirror and 128 back.
    let wanted = (160.0_f32 / 32.0 * 256.0 / 100.0).log2();
    let mirrored = at("Mirror", 1);
    assert!((mirrored - wanted).abs() < 0.25, "{mirrored} for {wanted}");
    // At a distance of 128, half of that wide: 164 texels.
    for spp in [1, 16] {
        let thrown = at("Plaster", spp);
        println!("mirrored {mirrored}, thrown {thrown} with {spp} samples");
        assert!((7.0..8.01).contains(&thrown), "{thrown}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    write_grey(&folder.path().join("dots.exr"), 4, &[0.0, 0.5, 2.0, 1.0]);
    let corners = [
        [-50.0, -1.0, 1.0],
        [50.0, -1.0, 1.0],
        [50.0, -1.0, -90.0],
        [-50.0, -1.0, -90.0],
    ];
    let plane = rectangle("Plane", "catmullClark", corners, 0.7, "Glow");
    let front = rectangle(
        "Front",
        "none",
        corners.map(|[x, y, z]| [x, y + 2.0, z]),
        1.0,
        "Mirror",
    );
    let scene = scene(folder.path(), "dots.exr", STRAIGHT, &(plane + &front));
    let picture = scene.with_extension("exr");
    let [one, many] = [1, 3].map(|threads| {
        let mut options = options(&scene, &picture);
        options.spp = 4;
        options.threads = threads;
        run(&options);
        read(&picture).2
    });
    assert!(mean(&one).x > 0.1 && one == many);
}

/// Opacity, and what else is in its image, is as sharp from afar as from near.
#[test]
fn what_is_cut_out_stays_cut_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(()) = write_levels(folder.path()) else {
        return;
    };
    let cut = SCENE.replace(
        "color3f inputs:emissiveColor.connect",
        "float inputs:opacity.connect = </Glow/Image.outputs:a>\n        color3f inputs:emissiveColor.connect",
    );
    let body = cut
        .replace("IMAGE", "levels.tx")
        .replace("CAMERA", STRAIGHT);
    let scene = write_scene(
        folder.path(),
        "cut.usda",
        &(body + &wall("none", 200.0, 3.0)),
    );
    assert_eq!(level(&scene, 1), 0.0);
}

/// A wall of 4 x 4 faces across the camera's view, which glows as a Ptex file says; faces have 2 to 128 texels a side.
fn ptex_wall(
    folder: &Path,
    distance: f64,
    filter: &str,
    texel: impl Fn(usize, [f32; 2]) -> f32,
) -> PathBuf {
    let node = |text: &str| {
        let (before, rest) = text.split_once("    def Shader \"Image\"").expect("a node");
        let (_, after) = rest
            .split_once("def Material \"Mirror\"")
            .expect("a material");
        format!(
            "{before}    def Shader \"Image\" {{\n        uniform token info:id = \"RelievoPtexTexture\"\n        \
             asset inputs:file = @./wall.ptx@\n        token inputs:filter = \"{filter}\"\n        \
             color3f outputs:rgb\n    }}\n}}\ndef Material \"Mirror\"{after}"
        )
    };
    let side = 2.0 * distance;
    let points = (0..25).map(|i| {
        let at = |i: i32| side * (f64::from(i) / 4.0 - 0.5);
        format!("({}, {}, {})", at(i % 5), at(i / 5), -distance)
    });
    let faces = (0..16).map(|i| {
        let first = i % 4 + i / 4 * 5;
        format!("{}, {}, {}, {}", first, first + 1, first + 6, first + 5)
    });
    let mesh = format!(
        r#"
def Mesh "Wall" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </Glow>
    uniform token subdivisionScheme = "bilinear"
    int[] faceVertexCounts = {:?}
    int[] faceVertexIndices = [{}]
    point3f[] points = [{}]
}}
"#,
        [4; 16],
        faces.collect::<Vec<_>>().join(", "),
        points.collect::<Vec<_>>().join(", "),
    );
    let body = node(SCENE).replace("CAMERA", STRAIGHT) + &mesh;
    let scene = write_scene(folder, "ptex.usda", &body);
    let description = load(&scene, &LoadOptions::default()).expect("a scene");
    let Geometry::Mesh(mesh) = &description.shapes[0].geometry else {
        panic!("not a mesh");
    };
    let format = Format::new(ptex_kind(mesh), DataType::F32, 3);
    let mut writer = Writer::new(format, ptex_face_count(mesh)).expect("a format");
    for (number, face) in ptex_faces(mesh).into_iter().enumerate() {
        let log = [1, 7, 3, 5][(number + number / 4) % 4];
        let n = 1 << log;
        let middle = |i: usize| (i as f32 + 0.5) / n as f32;
        let texels = (0..n * n).flat_map(|i| [texel(number, [middle(i % n), middle(i / n)]); 3]);
        let res = Res {
            ulog2: log,
            vlog2: log,
        };
        let bytes: Vec<u8> = texels.flat_map(f32::to_le_bytes).collect();
        let stored = writer.face(number as u32, &face.info(res), &bytes);
        stored.expect("texels of that size");
    }
    writer.write(folder.join("wall.ptx")).expect("a file");
    scene
}

#[test]
fn ptex_is_reduced_from_afar() {
    let folder = tempfile::tempdir().expect("a folder");
    // The finest texels alternate; a pixel is 8 x 8 of those that are finest.
    let finest = |x: f32| (x * 128.0) as usize;
    for filter in ["bilinear", "box", "gaussian", "mitchell"] {
        let scene = ptex_wall(folder.path(), 32.0, filter, |face, [u, v]| {
            if (face + face / 4) % 4 == 1 {
                ((finest(u) + finest(v)) % 2) as f32
            } else {
                0.5
            }
        });
        for (footprint, mixed) in [(1.0, true), (0.0, false)] {
            let pixels = pixels(&scene, 1, footprint);
            let off = pixels.iter().map(|p| (p.x - 0.5).abs()).fold(0.0, f32::max);
            println!("{filter}, {footprint}: {off}");
            assert_eq!(off < 0.01, mixed, "{filter}, {footprint}: {off}");
        }
    }
}

#[test]
fn ptex_has_no_seams_from_afar() {
    let folder = tempfile::tempdir().expect("a folder");
    // A ramp from left to right over all faces. Where it meets a face of two texels, it is flat and then steep.
    let ramp = |face: usize, [u, _]: [f32; 2]| ((face % 4) as f32 + u) / 4.0;
    for filter in ["bilinear", "gaussian"] {
        let scene = ptex_wall(folder.path(), 32.0, filter, ramp);
        let steepest = |footprint: f32| {
            let pixels = pixels(&scene, 1, footprint);
            let inner = (0..64 * 64).filter(|i| (8..56).contains(&(i % 64)));
            let steps = inner.map(|i| 64.0 * (pixels[i + 1].x - pixels[i].x));
            steps.map(|step| (step - 1.0).abs()).fold(0.0, f32::max)
        };
        let off = [0.0, 1.0, 2.0, 4.0].map(steepest);
        println!("{filter}: {off:?}");
        // A seam would be steeper than what is seen one texel wide; half a face would be 8.
        assert!(off.is_sorted_by(|a, b| a > b), "{filter}: {off:?}");
        assert!(off[0] < 3.0, "{filter}: {off:?}");
    }
}
