//! `relievo ptex convert`: images to Ptex files through a cage, Ptex files to images, other sizes and types.

mod refused;

use std::path::Path;

use relievo::image::{
    Channel, ChannelFormat, ColorSpace, Compression, ImageSource, Part, Picture, Texture, Wrap,
    write_exr, write_png_bytes,
};
use relievo_ptex::{DataType, FaceInfo, Format, MeshType, MetaValue, Reader, Res, Writer};

use crate::common::program::{Bench, expect, said};
use crate::common::sound::open;

fn run(bench: &Bench, arguments: &[&str]) -> (i32, String) {
    let mut all = vec!["ptex", "convert"];
    all.extend(arguments);
    said(&bench.command(&all).output().expect("the program runs"))
}

/// Converts, or fails the test.
#[track_caller]
fn convert(bench: &Bench, arguments: &[&str]) {
    let (code, text) = run(bench, arguments);
    assert_eq!((code, text.as_str()), (0, ""));
}

/// A face's texels, in stored units.
fn texels(reader: &Reader, face: u32, res: Res) -> Vec<f32> {
    let texels = reader.texels(face, res, false).expect("texels");
    let mut out = Vec::new();
    for (y, x) in (0..1 << res.vlog2).flat_map(|y| (0..1 << res.ulog2).map(move |x| (y, x))) {
        let mut texel = vec![0.0; reader.channels()];
        texels.add(x, y, 1.0, 0, &mut texel).expect("a texel");
        out.extend(texel);
    }
    out
}

fn all_texels(reader: &Reader, face: u32) -> Vec<f32> {
    texels(reader, face, reader.face(face).res)
}

fn pixels(path: &Path) -> ([u32; 2], Vec<[f32; 4]>) {
    let image = ImageSource::File(path.to_owned());
    let texture = Texture::load(&image, [Wrap::Clamp; 2], ColorSpace::Raw).expect("a picture");
    let [width, height] = texture.size();
    let pixels = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| texture.texel(x, y).to_array())
        .collect();
    ([width, height], pixels)
}

/// Red is s, green is t, at the middles of the pixels.
fn ramp(bench: &Bench, name: &str, [width, height]: [u32; 2]) {
    let middle = |i: u32, n: u32| (i as f32 + 0.5) / n as f32;
    let pixels = (0..height)
        .rev()
        .flat_map(|y| (0..width).flat_map(move |x| [middle(x, width), middle(y, height), 0.25]));
    let channels = ["R", "G", "B"].map(|name| Channel {
        name: name.into(),
        format: ChannelFormat::Float,
    });
    let picture = Picture {
        width,
        height,
        display_window: (width, height, 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: channels.into(),
            pixels: pixels.collect(),
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    };
    write_exr(&bench.path(name), &picture).expect("written");
}

/// A quad, a pentagon and a triangle that meet, with their places as texture coordinates.
const PLACES: [[f32; 2]; 7] = [
    [0.1, 0.1],
    [0.4, 0.1],
    [0.4, 0.5],
    [0.1, 0.5],
    [0.8, 0.2],
    [0.9, 0.6],
    [0.5, 0.8],
];
const FACES: [&[usize]; 3] = [&[0, 1, 2, 3], &[1, 4, 5, 6, 2], &[3, 2, 6]];

fn cage() -> String {
    let mut text = String::new();
    for [x, y] in PLACES {
        text += &format!("v {x} {y} 0\nvt {x} {y}\n");
    }
    for face in FACES {
        let corners = face.iter().map(|i| format!(" {0}/{0}", i + 1));
        text += &format!("f{}\n", corners.collect::<String>());
    }
    text
}

/// One square over the whole image.
const SQUARE: &str = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                      f 1/1 2/2 3/3 4/4\n";

/// The corners of all Ptex faces where faces stay flat.
fn squares() -> Vec<[[f32; 2]; 4]> {
    let mean = |points: &[usize]| {
        [0, 1].map(|c| points.iter().map(|&p| PLACES[p][c]).sum::<f32>() / points.len() as f32)
    };
    let mut squares = Vec::new();
    for face in FACES {
        if let [a, b, c, d] = *face {
            squares.push([a, b, c, d].map(|p| PLACES[p]));
            continue;
        }
        let n = face.len();
        for i in 0..n {
            let (before, here, next) = (face[(i + n - 1) % n], face[i], face[(i + 1) % n]);
            squares.push([
                PLACES[here],
                mean(&[here, next]),
                mean(face),
                mean(&[before, here]),
            ]);
        }
    }
    squares
}

#[test]
fn a_ramp_becomes_the_ramp_on_every_face() {
    let bench = Bench::new();
    ramp(&bench, "ramp.exr", [64, 32]);
    bench.write("bilinear_cage.obj", cage());
    for (size, kind) in [
        (&["--res", "3"][..], "fixed"),
        (&["--texels-per-unit", "37"], "by length"),
        (&[], "the image's"),
    ] {
        let mut arguments = vec!["ramp.exr", "--mesh", "bilinear_cage.obj", "-o", "ramp.ptx"];
        arguments.extend(size);
        convert(&bench, &arguments);
        let reader = open(&bench, "ramp.ptx");
        assert_eq!(reader.data_type(), DataType::F32);
        assert_eq!((reader.channels(), reader.face_count()), (3, 9));
        for (face, corners) in (0..).zip(squares()) {
            let info = reader.face(face);
            let Res { ulog2, vlog2 } = info.res;
            assert_eq!(info.subface, face > 0);
            let values = all_texels(&reader, face);
            for (i, texel) in values.chunks_exact(3).enumerate() {
                let (x, y) = (i % (1 << ulog2), i >> ulog2);
                let u = (x as f32 + 0.5) / f32::from(1_u16 << ulog2);
                let v = (y as f32 + 0.5) / f32::from(1_u16 << vlog2);
                let [a, b, c, d] = corners;
                for k in 0..2 {
                    let low = a[k] + u * (b[k] - a[k]);
                    let high = d[k] + u * (c[k] - d[k]);
                    let wanted = low + v * (high - low);
                    assert!(
                        (texel[k] - wanted).abs() < 1e-5,
                        "{kind}: face {face} ({x}, {y}): {texel:?} is not {wanted} in {k}"
                    );
                }
                assert!((texel[2] - 0.25).abs() < 1e-6);
            }
        }
        // 0.3 by 0.4 of the surface, of 64 by 32 texels.
        let Res { ulog2, vlog2 } = reader.face(0).res;
        let wanted = match kind {
            "fixed" => (3, 3),
            "by length" => (4, 4),
            _ => (5, 4),
        };
        assert_eq!((ulog2, vlog2), wanted, "{kind}");
        // The quad meets the first half of the pentagon's and of the triangle's edges, and they the quad.
        let beyond = |face: u32, edge: usize| reader.face(face).neighbours[edge];
        for face in 0..9 {
            for edge in 0..4 {
                let Some(to) = beyond(face, edge) else {
                    continue;
                };
                let back = beyond(to.face, to.edge.into()).expect("mutual");
                let sides = [back.face, face].map(cage_face);
                assert_eq!(sides[0], sides[1], "face {face} edge {edge}");
            }
        }
    }
}

/// Which face of the cage a Ptex face is of.
fn cage_face(ptex: u32) -> usize {
    match ptex {
        0 => 0,
        1..=5 => 1,
        _ => 2,
    }
}

#[test]
fn a_smooth_cage_carries_its_texture_coordinates_smoothly() {
    let bench = Bench::new();
    ramp(&bench, "ramp.exr", [64, 64]);
    // A grid whose middle vertex is off: by Catmull-Clark's masks it comes half way back.
    let point = |i: usize| {
        let off = if i == 4 { 0.18 } else { 0.0 };
        [
            (i % 3) as f32 / 2.0 * 0.8 + 0.1 + off,
            (i / 3) as f32 / 2.0 * 0.8 + 0.1,
        ]
    };
    let points: Vec<_> = (0..9).map(point).map(|[x, y]| (x, y)).collect();
    let flat: Vec<_> = points.iter().map(|(x, y)| (*x, *y, 0.0)).collect();
    bench.write(
        "grid.usda",
        format!(
            "#usda 1.0\ndef Mesh \"Grid\" {{\n\
             uniform token subdivisionScheme = \"catmullClark\"\n\
             int[] faceVertexCounts = [4, 4, 4, 4]\n\
             int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8, 7]\n\
             point3f[] points = {flat:?}\n\
             texCoord2f[] primvars:map = {points:?} (interpolation = \"vertex\")\n}}\n"
        ),
    );
    let arguments = ["ramp.exr", "--mesh", "grid.usda", "-o", "grid.ptx"];
    convert(
        &bench,
        &[&arguments[..], &["--primvar", "map", "--res", "6"]].concat(),
    );
    let reader = open(&bench, "grid.ptx");
    let values = all_texels(&reader, 0);
    // The limit of the middle vertex: 4/9 of its own.
    let last = &values[values.len() - 3..];
    assert!(
        (last[0] - (0.5 + 0.18 * 4.0 / 9.0)).abs() < 0.01,
        "{last:?}"
    );
    assert!((last[1] - 0.5).abs() < 0.01, "{last:?}");
    expect(
        run(&bench, &arguments),
        3,
        &["grid.usda: /Grid: ", "no primvar \"st\"", "--primvar map"],
    );
}

#[test]
fn bytes_of_colours_stay_as_they_are() {
    let bench = Bench::new();
    let bytes: Vec<u8> = (0..8 * 4 * 3_u32)
        .map(|n| (n.wrapping_mul(0x9e37_79b9) >> 24) as u8)
        .collect();
    write_png_bytes(&bench.path("noise.png"), 8, 4, 3, &bytes).expect("written");
    bench.write("bilinear_square.obj", SQUARE);
    let upside_down: Vec<u8> = bytes.chunks(24).rev().flatten().copied().collect();
    convert(
        &bench,
        &[
            "noise.png",
            "--mesh",
            "bilinear_square.obj",
            "-o",
            "noise.ptx",
        ],
    );
    let reader = open(&bench, "noise.ptx");
    assert_eq!(reader.data_type(), DataType::U8);
    assert_eq!(reader.face(0).res, Res { ulog2: 3, vlog2: 2 });
    let values: Vec<u8> = all_texels(&reader, 0).iter().map(|&v| v as u8).collect();
    assert_eq!(values, upside_down);

    // Floats are linear, and bytes again after all.
    convert(&bench, &["noise.ptx", "-o", "linear.ptx", "--type", "f32"]);
    let linear = all_texels(&open(&bench, "linear.ptx"), 0);
    let encoded = f32::from(upside_down[5]) / 255.0;
    let wanted = ((encoded + 0.055) / 1.055).powf(2.4);
    assert!(encoded > 0.05 && (linear[5] - wanted).abs() < 1e-5);
    convert(&bench, &["linear.ptx", "-o", "back.png"]);
    let (size, picture) = pixels(&bench.path("back.png"));
    assert_eq!(size, [8, 4]);
    let back: Vec<u8> = picture
        .iter()
        .flat_map(|p| [0, 1, 2].map(|c| (p[c] * 255.0 + 0.5) as u8))
        .collect();
    assert_eq!(back, upside_down);
    convert(
        &bench,
        &["noise.ptx", "-o", "raw.ptx", "--type", "f32", "--raw"],
    );
    let raw = all_texels(&open(&bench, "raw.ptx"), 0);
    assert!((raw[5] - encoded).abs() < 1e-6);
}

fn info(ulog2: i8, vlog2: i8) -> FaceInfo {
    FaceInfo {
        res: Res { ulog2, vlog2 },
        neighbours: [None; 4],
        constant: false,
        has_edits: false,
        constant_neighbourhood: false,
        subface: false,
    }
}

/// Noise in two faces of different sizes and a constant third one.
fn noise(bench: &Bench, name: &str, data_type: DataType, channels: usize) {
    let mut writer =
        Writer::new(Format::new(MeshType::Quad, data_type, channels), 3).expect("a file");
    for (face, info) in [(0, info(2, 2)), (1, info(4, 3))] {
        let count = channels << (info.res.ulog2 + info.res.vlog2);
        let random = (0..count as u32).map(|n| (n + 7).wrapping_mul(0x9e37_79b9));
        let bytes: Vec<u8> = match data_type {
            DataType::F32 => random
                .flat_map(|n| (n as f32 / 1e9).to_le_bytes())
                .collect(),
            _ => random
                .flat_map(|n| ((n >> 16) as u16).to_le_bytes())
                .collect(),
        };
        writer.face(face, &info, &bytes).expect("a face");
    }
    let one: Vec<u8> = (0..channels * data_type.bytes()).map(|n| n as u8).collect();
    writer.face(2, &info(3, 3), &one).expect("a face");
    let by = MetaValue::String("hand".into());
    writer.set_meta("by", by).expect("meta data");
    writer.write(bench.path(name)).expect("written");
}

#[test]
fn pictures_show_the_texels() {
    let bench = Bench::new();
    noise(&bench, "noise.ptx", DataType::F32, 3);
    let reader = open(&bench, "noise.ptx");
    let rgb =
        |pixels: &[[f32; 4]]| -> Vec<f32> { pixels.iter().flat_map(|p| p[..3].to_vec()).collect() };
    convert(&bench, &["noise.ptx", "-o", "face.exr", "--face", "1"]);
    let (size, picture) = pixels(&bench.path("face.exr"));
    assert_eq!(size, [16, 8]);
    assert_eq!(rgb(&picture), all_texels(&reader, 1));
    convert(
        &bench,
        &[
            "noise.ptx",
            "-o",
            "half.exr",
            "--face",
            "1",
            "--max-res",
            "3",
        ],
    );
    let (size, picture) = pixels(&bench.path("half.exr"));
    assert_eq!(size, [8, 8]);
    assert_eq!(
        rgb(&picture),
        texels(&reader, 1, Res { ulog2: 3, vlog2: 3 })
    );

    convert(&bench, &["noise.ptx", "-o", "all.exr"]);
    let ([width, height], picture) = pixels(&bench.path("all.exr"));
    // 208 texels: rows of 16; the smallest stands beside the constant one.
    assert_eq!([width, height], [16, 16]);
    for (face, [x, y]) in [(1, [0, 0]), (2, [0, 8]), (0, [8, 8])] {
        let Res { ulog2, vlog2 } = reader.face(face).res;
        let rows = (y..y + (1 << vlog2)).map(|row| row * 16 + x);
        let shown: Vec<[f32; 4]> = rows
            .flat_map(|start| picture[start..start + (1 << ulog2)].to_vec())
            .collect();
        assert_eq!(rgb(&shown), all_texels(&reader, face), "face {face}");
    }
}

#[test]
fn sizes_change_by_the_formats_rules() {
    let bench = Bench::new();
    noise(&bench, "noise.ptx", DataType::U16, 2);
    let reader = open(&bench, "noise.ptx");
    for (arguments, sizes) in [
        (["--scale", "1/2"], [(1, 1), (3, 2), (2, 2)]),
        (["--scale", "1/16"], [(0, 0), (0, 0), (0, 0)]),
        (["--max-res", "3"], [(2, 2), (3, 3), (3, 3)]),
    ] {
        convert(
            &bench,
            &[&["noise.ptx", "-o", "small.ptx"][..], &arguments].concat(),
        );
        let small = open(&bench, "small.ptx");
        let by = MetaValue::String("hand".into());
        assert_eq!(small.meta().expect("meta data").get("by"), Some(&by));
        for (face, (ulog2, vlog2)) in (0..).zip(sizes) {
            let res = Res { ulog2, vlog2 };
            assert_eq!(small.face(face).res, res);
            let wanted = texels(&reader, face, res);
            assert_eq!(all_texels(&small, face), wanted, "{arguments:?}");
        }
        assert!(small.face(2).constant);
    }
    // Another type, and nothing else.
    convert(&bench, &["noise.ptx", "-o", "floats.ptx", "--type", "f32"]);
    let floats = open(&bench, "floats.ptx");
    let scaled: Vec<f32> = all_texels(&reader, 1).iter().map(|v| v / 65535.0).collect();
    assert_eq!(all_texels(&floats, 1), scaled);
    convert(&bench, &["floats.ptx", "-o", "back.ptx", "--type", "u16"]);
    let bytes = |name| std::fs::read(bench.path(name)).expect("a file");
    assert_eq!(bytes("back.ptx"), bytes("noise.ptx"));
}

#[test]
fn larger_faces_go_on_as_bilinear_lookups_do() {
    let bench = Bench::new();
    // Two squares side by side with one ramp over both, each of a size of its own in v.
    bench.write(
        "bilinear_two.obj",
        "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0\n\
         vt 0.1 0.1\nvt 0.5 0.1\nvt 0.9 0.1\nvt 0.1 0.9\nvt 0.5 0.9\nvt 0.9 0.9\n\
         f 1/1 2/2 5/5 4/4\nf 2/2 3/3 6/6 5/5\n",
    );
    ramp(&bench, "ramp.exr", [64, 64]);
    let arguments = ["ramp.exr", "--mesh", "bilinear_two.obj", "-o", "two.ptx"];
    convert(&bench, &[&arguments[..], &["--res", "2"]].concat());
    convert(&bench, &["two.ptx", "-o", "four.ptx", "--scale", "4"]);
    let reader = open(&bench, "four.ptx");
    let (first, second) = (all_texels(&reader, 0), all_texels(&reader, 1));
    // Beyond the outer border's texels there is no ramp; over the inner edge it goes on.
    for row in 0..16 {
        let values: Vec<f32> = [&first, &second]
            .into_iter()
            .flat_map(|face| (0..16).map(move |x| face[(row * 16 + x) * 3]))
            .collect();
        for (i, value) in values.iter().enumerate().take(30).skip(2) {
            let wanted = 0.1 + 0.8 * (i as f32 + 0.5) / 32.0;
            assert!((value - wanted).abs() < 1e-5, "{row} {i}: {value} {wanted}");
        }
    }
}

#[test]
fn colours_with_alpha_keep_their_colour() {
    let bench = Bench::new();
    let mut format = Format::new(MeshType::Quad, DataType::F32, 2);
    format.alpha_channel = Some(1);
    let mut writer = Writer::new(format, 1).expect("a file");
    let values = (0..64).flat_map(|n| [0.75_f32, [0.0, 0.25, 0.5, 1.0][n % 4]]);
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    writer.face(0, &info(3, 3), &bytes).expect("a face");
    writer.write(bench.path("alpha.ptx")).expect("written");
    for scale in ["1/2", "1/8"] {
        convert(&bench, &["alpha.ptx", "-o", "small.ptx", "--scale", scale]);
        let small = open(&bench, "small.ptx");
        for texel in all_texels(&small, 0).chunks_exact(2) {
            assert!((texel[0] - 0.75).abs() < 1e-6, "{scale}: {texel:?}");
        }
    }
    convert(&bench, &["alpha.ptx", "-o", "alpha.png"]);
    let (_, picture) = pixels(&bench.path("alpha.png"));
    assert_eq!(picture[1][3], 64.0 / 255.0);
}

#[test]
fn triangles_of_loop_have_their_texels() {
    let bench = Bench::new();
    ramp(&bench, "ramp.exr", [64, 64]);
    bench.write(
        "loop_pair.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.1 0.1\nvt 0.9 0.1\nvt 0.9 0.9\nvt 0.1 0.9\n\
         f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nt facevaryinginterpolateboundary 1/0/0 5\n",
    );
    convert(
        &bench,
        &[
            "ramp.exr",
            "--mesh",
            "loop_pair.obj",
            "-o",
            "pair.ptx",
            "--res",
            "3",
        ],
    );
    let reader = open(&bench, "pair.ptx");
    assert_eq!(reader.mesh_type(), MeshType::Triangle);
    // The mean of a triangle's texels is the ramp at its middle, if they fill it.
    let values = all_texels(&reader, 0);
    let mean = |c: usize| values.iter().skip(c).step_by(3).sum::<f32>() / 64.0;
    let wanted = [0.1 + 0.8 * 2.0 / 3.0, 0.1 + 0.8 / 3.0];
    let found = [mean(0), mean(1)];
    assert!(
        (found[0] - wanted[0]).abs() < 1e-3 && (found[1] - wanted[1]).abs() < 1e-3,
        "{found:?} {wanted:?}"
    );
}
