//! OpenImageIO's own tools with the plugin: what they tell of Ptex files, and what they make of them.
//!
//! They are run where they are installed; the shared oracles are read where `RELIEVO_SHARED` names their folder.

#![allow(clippy::unwrap_used)]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relievo_ptex::{BorderMode, DataType, FaceInfo, Format, MeshType, MetaValue, Res, Writer};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A folder for what a test makes, and within it the plugin, named as OpenImageIO looks for it.
struct Tools(TempDir);

impl Tools {
    /// None where OpenImageIO's tools are not installed: the test says so, and checks nothing.
    fn new() -> Option<Self> {
        for tool in ["oiiotool", "maketx"] {
            if Command::new(tool).arg("--help").output().is_err() {
                skipped(&format!("{tool} is not installed"));
                return None;
            }
        }
        let folder = tempfile::tempdir().unwrap();
        // Cargo builds the library for the tests, beside them.
        let test = std::env::current_exe().unwrap();
        let library = test.with_file_name(format!(
            "{}ptex_oiio{}",
            std::env::consts::DLL_PREFIX,
            std::env::consts::DLL_SUFFIX
        ));
        std::fs::copy(library, folder.path().join("ptex.imageio.so")).unwrap();
        Some(Self(folder))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn try_run(&self, tool: &str, arguments: &[&str]) -> Output {
        Command::new(tool)
            .args(arguments)
            .current_dir(self.0.path())
            .env("OIIO_LIBRARY_PATH", self.0.path())
            .output()
            .unwrap()
    }

    /// What the tool prints; it has to succeed.
    fn run(&self, tool: &str, arguments: &[&str]) -> String {
        let output = self.try_run(tool, arguments);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{tool} {arguments:?}: {output:?}");
        text
    }

    /// The specs of all parts of a file, as `oiiotool` tells them.
    fn specs(&self, file: &Path) -> Vec<Spec> {
        let file = file.to_str().unwrap();
        let text = self.run("oiiotool", &["--info:format=xml:verbose=1", "-a", file]);
        let start = text.find("<ImageSpec").unwrap();
        // One document for each part; there may be one root only.
        let text = format!("<all>{}</all>", &text[start..]);
        let document = roxmltree::Document::parse(&text).unwrap();
        document
            .root_element()
            .children()
            .filter(|node| node.has_tag_name("ImageSpec"))
            .map(Spec::new)
            .collect()
    }

    /// All pixels of a flat picture.
    fn pixels(&self, file: &str) -> Vec<f32> {
        self.run("oiiotool", &["--dumpdata", file])
            .lines()
            .filter_map(|line| line.trim().strip_prefix("Pixel ")?.split_once("): "))
            .flat_map(|(_, numbers)| numbers.split_whitespace())
            .map(|number| number.parse().unwrap())
            .collect()
    }
}

/// What `oiiotool` tells of a part.
#[derive(Debug)]
struct Spec {
    format: String,
    channel_names: Vec<String>,
    alpha_channel: i64,
    /// Width and height, of the image and of its tiles, and MIP levels.
    sizes: [u64; 5],
    /// Names, types and texts.
    attributes: Vec<[String; 3]>,
}

impl Spec {
    fn new(node: roxmltree::Node<'_, '_>) -> Self {
        let text = |name: &str| {
            node.children()
                .find(|child| child.has_tag_name(name))
                .and_then(|child| child.text())
                .unwrap_or_else(|| panic!("no {name}"))
        };
        let number = |name| text(name).parse::<u64>().unwrap();
        // Of what has one level only they are not told.
        let levels = node.children().find(|n| n.has_tag_name("miplevels"));
        let levels = levels.map_or(1, |n| n.text().unwrap().parse().unwrap());
        let all = |name: &'static str| node.descendants().filter(move |n| n.has_tag_name(name));
        Self {
            format: text("format").to_owned(),
            channel_names: all("channelname")
                .map(|n| n.text().unwrap().to_owned())
                .collect(),
            alpha_channel: text("alpha_channel").parse().unwrap(),
            sizes: [
                number("width"),
                number("height"),
                number("tile_width"),
                number("tile_height"),
                levels,
            ],
            attributes: all("attrib")
                .map(|n| {
                    let attribute = |name| n.attribute(name).unwrap().to_owned();
                    let text = n.text().unwrap_or_default().to_owned();
                    [attribute("name"), attribute("type"), text]
                })
                .collect(),
        }
    }
}

fn shared() -> Option<PathBuf> {
    let Some(shared) = std::env::var_os("RELIEVO_SHARED") else {
        skipped("RELIEVO_SHARED names no folder with oracles");
        return None;
    };
    Some(Path::new(&shared).join("oracles/ptex"))
}

/// Says so past the test runner, which keeps what passing tests print to itself.
fn skipped(reason: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {reason}");
}

fn parsed(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

#[test]
fn every_face_of_the_oracles_is_listed_as_told() {
    let (Some(tools), Some(folder)) = (Tools::new(), shared()) else {
        return;
    };
    let mut files = 0;
    for folder in [folder.clone(), folder.join("real")] {
        for (name, wanted) in parsed(&folder.join("oiio_specs.json")).as_object().unwrap() {
            let file = folder.join(name);
            let json = parsed(&file.with_extension("json"));
            let specs = tools.specs(&file);
            let faces = wanted["subimages"].as_array().unwrap();
            assert_eq!(specs.len(), faces.len(), "{name}");
            for (spec, sizes) in specs.iter().zip(faces) {
                assert_eq!(json!(spec.sizes), *sizes, "{name}");
                assert_eq!(json!(spec.format), wanted["format"], "{name}");
                assert_eq!(json!(spec.channel_names), wanted["channelnames"], "{name}");
                assert_eq!(json!(spec.alpha_channel), wanted["alpha_channel"], "{name}");
            }
            let border = |axis: &str| json["info"][axis].as_str().unwrap().to_owned();
            let wrap = format!("{},{}", border("u_border"), border("v_border"));
            let mut attributes = Vec::new();
            for attribute in wanted["attributes"].as_array().unwrap() {
                let text = |name: &str| attribute[name].as_str().unwrap().to_owned();
                let [name, kind, told] = ["name", "type", "text"].map(text);
                if name == "wrapmode" {
                    // Where both axes differ, the reference takes that of u for both.
                    attributes.push([name, kind.clone(), wrap.clone()]);
                    attributes.push(["wrapmodes".to_owned(), kind.clone(), wrap.clone()]);
                    let format = ["textureformat", &kind, "Plain Texture"];
                    attributes.push(format.map(str::to_owned));
                } else {
                    attributes.push([name, kind, told]);
                }
            }
            let found = &specs[0].attributes;
            assert_eq!(found.len(), attributes.len(), "{name}");
            for (found, wanted) in found.iter().zip(&attributes) {
                assert_eq!(found[..2], wanted[..2], "{name}");
                // Long texts are cut in the list.
                let whole = found[2] == wanted[2];
                let start = wanted[2].strip_suffix("...");
                assert!(
                    whole || start.is_some_and(|start| found[2].starts_with(start)),
                    "{name} {wanted:?}"
                );
            }
            files += 1;
        }
    }
    assert!(files >= 26, "{files} files");
}

#[test]
fn damaged_files_are_errors_and_no_crash() {
    let (Some(tools), Some(folder)) = (Tools::new(), shared()) else {
        return;
    };
    let list = parsed(&folder.join("malformed/malformed.json"));
    for entry in list.as_array().unwrap() {
        let name = entry["file"].as_str().unwrap();
        let file = folder.join("malformed").join(name);
        let file = file.to_str().unwrap();
        // Lists all faces, and reads all pixels of all of them.
        let output = tools.try_run("oiiotool", &["--info", "-a", "--stats", file]);
        let harmless = name == "adj_out_of_range.ptx";
        let code = i32::from(!harmless);
        assert_eq!(output.status.code(), Some(code), "{name}: {output:?}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(error.contains("ERROR"), !harmless, "{name}: {error}");
    }
}

/// Five faces of floats, each of its own size. The value of a texel follows from its place.
fn made(tools: &Tools) -> PathBuf {
    let format = Format {
        u_border: BorderMode::Black,
        ..Format::new(MeshType::Quad, DataType::F32, 3)
    };
    let mut writer = Writer::new(format, 5).unwrap();
    for face in 0..5_u8 {
        let res = Res {
            ulog2: face as i8,
            vlog2: 4,
        };
        let info = FaceInfo {
            res,
            neighbours: [None; 4],
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: false,
        };
        let texels = (0..1_u32 << res.vlog2)
            .flat_map(|y| (0..1_u32 << res.ulog2).map(move |x| [x, y]))
            .flat_map(|[x, y]| texel(face.into(), x, y))
            .flat_map(f32::to_le_bytes);
        writer
            .face(face.into(), &info, &texels.collect::<Vec<u8>>())
            .unwrap();
    }
    let list = (0..400).collect();
    writer.set_meta("list", MetaValue::I32(list)).unwrap();
    let path = tools.path("made.ptx");
    writer.write(&path).unwrap();
    path
}

fn texel(face: u32, x: u32, y: u32) -> [f32; 3] {
    [face, x, y].map(|n| n as f32 / 16.0)
}

#[test]
fn own_files_are_listed() {
    let Some(tools) = Tools::new() else { return };
    let specs = tools.specs(&made(&tools));
    assert_eq!(specs.len(), 5);
    for (face, spec) in specs.iter().enumerate() {
        let width = 1 << face;
        assert_eq!(spec.sizes, [width, 16, width, 16, 5]);
        assert_eq!(spec.format, "float");
        assert_eq!(spec.channel_names, ["R", "G", "B"]);
        assert_eq!(spec.alpha_channel, -1);
        let attribute = |name: &str| {
            let found = spec.attributes.iter().find(|[n, ..]| n == name);
            found.map(|[_, kind, text]| [kind.as_str(), text.as_str()])
        };
        let wrap = Some(["string", "black,clamp"]);
        assert_eq!(attribute("wrapmode"), wrap);
        assert_eq!(attribute("wrapmodes"), wrap);
        assert_eq!(attribute("ptex:meshType"), Some(["string", "quad"]));
        let format = Some(["string", "Plain Texture"]);
        assert_eq!(attribute("textureformat"), format);
        // All of it five times is little enough.
        let [kind, text] = attribute("list").unwrap();
        assert_eq!(kind, "int[400]");
        assert!(text.starts_with("0, 1, 2, "), "{text}");
    }
}

#[test]
fn a_crop_of_a_face_becomes_an_exr() {
    let Some(tools) = Tools::new() else { return };
    made(&tools);
    let convert = "made.ptx --subimage 3 --crop 4x2+2+1 -d float -o crop.exr";
    tools.run("oiiotool", &convert.split(' ').collect::<Vec<_>>());
    let wanted: Vec<f32> = [1, 2]
        .into_iter()
        .flat_map(|y| (2..6).flat_map(move |x| texel(3, x, y)))
        .collect();
    assert_eq!(tools.pixels("crop.exr"), wanted);
}

#[test]
fn a_face_becomes_an_exr_with_all_its_levels() {
    let Some(tools) = Tools::new() else { return };
    made(&tools);
    tools.run(
        "oiiotool",
        &["made.ptx", "--subimage", "4", "-o", "face.exr"],
    );
    let specs = tools.specs(&tools.path("face.exr"));
    assert_eq!(specs.len(), 1);
    let [width, height, .., levels] = specs[0].sizes;
    assert_eq!([width, height, levels], [16, 16, 5]);
    // The middle of the whole.
    let last = ["face.exr", "--selectmip", "4", "-o", "last.exr"];
    tools.run("oiiotool", &last);
    let middle = [4.0, 7.5, 7.5].map(|n| n / 16.0);
    assert_eq!(tools.pixels("last.exr"), middle);
}

#[test]
fn faces_become_textures() {
    let Some(tools) = Tools::new() else { return };
    made(&tools);
    // `maketx` takes the first part of any file.
    tools.run("maketx", &["made.ptx", "-o", "first.exr"]);
    let face = ["made.ptx", "--subimage", "4", "-otex", "fourth.exr"];
    tools.run("oiiotool", &face);
    for (file, face) in [("first.exr", 0), ("fourth.exr", 4)] {
        let width = 1 << face;
        let specs = tools.specs(&tools.path(file));
        assert_eq!(specs.len(), 1, "{file}");
        let [w, h, .., levels] = specs[0].sizes;
        assert_eq!([w, h, levels], [width.into(), 16, 5], "{file}");
        let wanted: Vec<f32> = (0..16)
            .flat_map(|y| (0..width).flat_map(move |x| texel(face, x, y)))
            .collect();
        assert_eq!(tools.pixels(file), wanted, "{file}");
    }
}

/// 20,000 faces of a mesh whose file holds a megabyte of meta data.
#[test]
fn large_meta_data_are_not_repeated_for_ever() {
    let Some(tools) = Tools::new() else { return };
    let mut writer = Writer::new(Format::new(MeshType::Quad, DataType::U8, 1), 20_000).unwrap();
    let mesh = (0..1 << 18).collect();
    writer.set_meta("mesh", MetaValue::I32(mesh)).unwrap();
    let small = MetaValue::String("small".into());
    writer.set_meta("small", small).unwrap();
    let path = tools.path("many.ptx");
    writer.write(&path).unwrap();
    let specs = tools.specs(&path);
    assert_eq!(specs.len(), 20_000);
    for (face, spec) in specs.iter().enumerate() {
        let has = |name: &str| spec.attributes.iter().any(|[n, ..]| n == name);
        assert!(has("small"), "face {face}");
        assert_eq!(has("mesh"), face == 0, "face {face}");
    }
}
