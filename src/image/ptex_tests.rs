//! Ptex files through OpenImageIO: a part for every face, a MIP level for every halving.

use std::io::Write;
use std::path::{Path, PathBuf};

use relievo_ptex::{
    BorderMode, Cache, DataType, FaceInfo, Format, MeshType, MetaValue, Reader, Res, Writer,
};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::border::raw::Raw;
use super::border::{Input, Kind};
use super::test_files;
use super::{ChannelFormat, ColorSpace, ImageSource, Texture, Wrap, write_exr};

/// The folder of the oracles. Without it a test says so, and checks nothing.
fn oracles() -> Option<PathBuf> {
    let Some(shared) = std::env::var_os("RELIEVO_SHARED") else {
        // Past the test runner, which keeps what passing tests print to itself.
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: RELIEVO_SHARED names no folder with oracles"
        );
        return None;
    };
    Some(Path::new(&shared).join("oracles/ptex"))
}

fn ptex_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "ptx"))
        .collect();
    files.sort();
    files
}

fn raw(data_type: DataType) -> Raw {
    match data_type {
        DataType::U8 => Raw::U8,
        DataType::U16 => Raw::U16,
        DataType::F16 => Raw::F16,
        DataType::F32 => Raw::F32,
    }
}

#[test]
fn texels_are_those_of_the_oracles() {
    let Some(folder) = oracles() else { return };
    let files = [ptex_files(&folder), ptex_files(&folder.join("real"))].concat();
    assert!(files.len() >= 26, "{} files", files.len());
    let mut levels = 0;
    for file in files {
        let json = std::fs::read(file.with_extension("json")).unwrap();
        let json: Value = serde_json::from_slice(&json).unwrap();
        let format = match json["info"]["data_type"].as_str().unwrap() {
            "uint8" => Raw::U8,
            "uint16" => Raw::U16,
            "float16" => Raw::F16,
            "float32" => Raw::F32,
            other => panic!("{other}"),
        };
        let mut input = Input::open(file.as_os_str(), None).unwrap();
        let faces = json["faces"].as_array().unwrap();
        for (face, wanted) in (0..).zip(faces) {
            let chain = wanted["chain"].as_array().unwrap();
            for (level, wanted) in (0..).zip(chain) {
                let place = format!("{} face {face} level {level}", file.display());
                let res = |i: usize| 1_u32 << wanted["res"][i].as_u64().unwrap();
                let size = input.level_size(face, level).unwrap();
                assert_eq!(size, Some([res(0), res(1)]), "{place}");
                let texels = input.level_bytes(face, level, format).unwrap();
                let hash: String = Sha256::digest(&texels)
                    .iter()
                    .map(|byte| format!("{byte:02x}"))
                    .collect();
                let wanted = match &wanted["premult_sha256"] {
                    Value::Null => &wanted["sha256"],
                    premultiplied => premultiplied,
                };
                assert_eq!(hash, *wanted, "{place}");
                levels += 1;
            }
            let beyond = input.level_size(face, chain.len() as u32).unwrap();
            assert_eq!(beyond, None, "{} face {face}", file.display());
        }
        let beyond = input.level_size(faces.len() as u32, 0).unwrap();
        assert_eq!(beyond, None, "{}", file.display());
    }
    assert!(levels > 1000, "{levels} levels");
}

#[test]
fn damaged_files_are_errors() {
    let Some(folder) = oracles() else { return };
    let files = ptex_files(&folder.join("malformed"));
    assert_eq!(files.len(), 22);
    let (mut unopened, mut unread) = (0, 0);
    for file in files {
        let mut input = match Input::open(file.as_os_str(), None) {
            Ok(input) => input,
            Err(refusal) => {
                // Our reader's words, not those of one that comes later.
                assert!(refusal.message.contains("; "), "{refusal:?}");
                assert_eq!(refusal.kind, Kind::CannotOpen, "{refusal:?}");
                unopened += 1;
                continue;
            }
        };
        for face in 0.. {
            if input.level_size(face, 0).unwrap().is_none() {
                assert!(face > 1, "{}: {face} faces", file.display());
                break;
            }
            for level in 0.. {
                if input.level_size(face, level).unwrap().is_none() {
                    break;
                }
                if let Err(refusal) = input.level_bytes(face, level, Raw::F32) {
                    let place = format!("face {face}: ");
                    assert!(refusal.message.contains(&place), "{refusal:?}");
                    assert_eq!(refusal.kind, Kind::CannotRead, "{refusal:?}");
                    unread += 1;
                }
            }
        }
    }
    assert!(unopened >= 15 && unread >= 6, "{unopened} {unread}");
}

/// A file of three faces: one of noise, so large that it has tiles; one of a single colour; one that is narrow.
fn made(data_type: DataType, alpha_channel: Option<usize>, reductions: bool) -> Writer {
    let format = Format {
        alpha_channel,
        reductions,
        u_border: BorderMode::Periodic,
        v_border: BorderMode::Black,
        ..Format::new(MeshType::Quad, data_type, 5)
    };
    let mut writer = Writer::new(format.clone(), 3).unwrap();
    let mut state = 1_u32;
    for (face, [ulog2, vlog2]) in [[8, 9], [4, 3], [0, 5]].into_iter().enumerate() {
        let texels = if face == 1 { 1 } else { 1 << (ulog2 + vlog2) };
        let mut bytes = Vec::new();
        for _ in 0..texels * format.channels {
            // Knuth's multiplier; the upper bits are the random ones.
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let part = (state >> 16) as u16;
            match data_type {
                DataType::U8 => bytes.push((part >> 8) as u8),
                DataType::U16 => bytes.extend(part.to_le_bytes()),
                DataType::F16 => {
                    bytes.extend(half::f16::from_f32(f32::from(part) / 8192.0 - 4.0).to_le_bytes());
                }
                DataType::F32 => bytes.extend((f32::from(part) / 8192.0 - 4.0).to_le_bytes()),
            }
        }
        let info = FaceInfo {
            res: Res { ulog2, vlog2 },
            neighbours: [None; 4],
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: false,
        };
        writer.face(face as u32, &info, &bytes).unwrap();
    }
    writer
        .set_meta("maker", MetaValue::String("ours".into()))
        .unwrap();
    writer.set_meta("one", MetaValue::I16(vec![-3])).unwrap();
    writer.set_meta("none", MetaValue::F64(Vec::new())).unwrap();
    writer
}

#[test]
fn texels_are_those_of_our_reader() {
    let folder = tempfile::tempdir().unwrap();
    for data_type in [DataType::U8, DataType::U16, DataType::F16, DataType::F32] {
        for alpha in [None, Some(0), Some(2), Some(4)] {
            for reductions in [false, true] {
                let path = folder.path().join("made.ptx");
                made(data_type, alpha, reductions).write(&path).unwrap();
                let reader = Reader::open(&path, &Cache::default()).unwrap();
                let full = reader.face(0).res;
                assert!(reader.tile_res(0, full).unwrap().is_some());
                let from_file = Input::open(path.as_os_str(), None).unwrap();
                // As from a package: the name tells the format and nothing else.
                let bytes = std::fs::read(&path).unwrap();
                let from_bytes = Input::open("elsewhere.ptx".as_ref(), Some(bytes.into())).unwrap();
                for mut input in [from_file, from_bytes] {
                    let info = input.info(0).unwrap();
                    assert_eq!(info.channels, 5);
                    assert_eq!(info.alpha_channel, alpha.map(|alpha| alpha as u32));
                    for face in 0..3 {
                        compare(&reader, &mut input, face, data_type);
                    }
                }
            }
        }
    }
}

fn compare(reader: &Reader, input: &mut Input, face: u32, data_type: DataType) {
    let Res { ulog2, vlog2 } = reader.face(face).res;
    let levels = ulog2.max(vlog2) + 1;
    for level in 0..levels {
        let res = Res {
            ulog2: (ulog2 - level).max(0),
            vlog2: (vlog2 - level).max(0),
        };
        let (width, height) = (1 << res.ulog2, 1 << res.vlog2);
        let size = input.level_size(face, level as u32).unwrap();
        assert_eq!(size, Some([width, height]));
        let found = input
            .level_bytes(face, level as u32, raw(data_type))
            .unwrap();
        let mut wanted = Vec::new();
        let texels = reader.texels(face, res, true).unwrap();
        texels
            .copy(0, 0, width as usize, height as usize, &mut wanted)
            .unwrap();
        // The whole would flood the terminal.
        assert!(found == wanted, "{data_type:?} face {face} level {level}");
    }
    assert_eq!(input.level_size(face, levels as u32).unwrap(), None);
}

#[test]
fn attributes_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.ptx");
    made(DataType::U8, None, true).write(&path).unwrap();
    let mut input = Input::open(path.as_os_str(), None).unwrap();
    for face in 0..3 {
        for (name, value) in [
            ("ptex:meshType", "quad"),
            ("wrapmode", "periodic,black"),
            ("wrapmodes", "periodic,black"),
            ("maker", "ours"),
            ("one", "-3"),
        ] {
            assert_eq!(input.attribute(face, name).unwrap(), value, "{name}");
        }
        for name in ["ptex:hasEdits", "none"] {
            assert_eq!(input.attribute(face, name).unwrap_err().kind, Kind::Absent);
        }
    }
}

/// Writing a picture makes OpenImageIO learn its own formats too.
#[test]
fn a_face_is_a_texture_also_after_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("picture.exr");
    let part = test_files::part("", "RGB", ChannelFormat::Half, &[0.5; 3]);
    write_exr(&picture, &test_files::picture(1, part)).unwrap();

    let path = folder.path().join("face.ptx");
    let mut writer = Writer::new(Format::new(MeshType::Quad, DataType::F32, 3), 1).unwrap();
    let info = FaceInfo {
        res: Res { ulog2: 1, vlog2: 0 },
        neighbours: [None; 4],
        constant: false,
        has_edits: false,
        constant_neighbourhood: false,
        subface: false,
    };
    let texels: Vec<u8> = [0.25_f32, 0.5, 1.0, 4.0, 2.0, 0.0]
        .iter()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    writer.face(0, &info, &texels).unwrap();
    writer.write(&path).unwrap();
    let source = ImageSource::File(path);
    let texture = Texture::load(&source, [Wrap::Clamp; 2], ColorSpace::Raw).unwrap();
    assert_eq!(texture.size(), [2, 1]);
    assert_eq!(texture.texel(1, 0).truncate().to_array(), [4.0, 2.0, 0.0]);
}
