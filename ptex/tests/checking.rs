//! What `check` finds, and that it finds nothing where nothing is wrong.

#![allow(clippy::unwrap_used)]

mod common;

use std::io::Read;

use common::made::{Made, Numbers};
use common::oracles;
use relievo_ptex::{
    Cache, DataType, Finding, Format, MeshType, Neighbour, Reader, Severity, Writer, check,
};

#[test]
fn oracles_are_as_they_should_be() {
    for oracle in oracles() {
        let findings = check(&oracle.reader);
        let wrong = findings.iter().filter(|f| f.severity > Severity::Odd);
        // The neighbours of the face that was never written name it, and it names none.
        let expected = if oracle.name == "missing_u8_rgb" {
            2
        } else {
            0
        };
        assert_eq!(wrong.count(), expected, "{}: {findings:?}", oracle.name);
        for finding in findings.iter().filter(|f| f.severity == Severity::Odd) {
            assert!(
                finding.message.contains("8 zero bytes"),
                "{}: {finding}",
                oracle.name
            );
        }
    }
}

#[test]
fn damage_in_a_face_is_found() {
    let Some(folder) = common::folder() else {
        return;
    };
    for (name, severity, word) in [
        ("zlib_face0", Severity::Unreadable, "corrupt"),
        ("res_mismatch", Severity::Unreadable, "2048"),
        ("tile_1x1", Severity::Unreadable, "524288 tiles"),
        ("tile_larger_than_face", Severity::Unreadable, "2^14"),
        ("blocksize_past_eof", Severity::Unreadable, "past the end"),
        ("adj_out_of_range", Severity::Wrong, "names face 9999"),
    ] {
        let path = folder.join("malformed").join(name).with_extension("ptx");
        let findings = check(&Reader::open(path, &Cache::default()).unwrap());
        assert!(
            findings
                .iter()
                .any(|f| f.face == Some(0) && f.severity == severity && f.message.contains(word)),
            "{name}: {findings:?}"
        );
    }
}

#[test]
fn nothing_is_wrong_with_our_files() {
    for seed in 1..40 {
        let mut numbers = Numbers(seed);
        let types = [DataType::U8, DataType::U16, DataType::F16, DataType::F32];
        let mesh_type = match seed % 2 {
            0 => MeshType::Quad,
            _ => MeshType::Triangle,
        };
        let mut format = Format::new(mesh_type, types[seed as usize % 4], 1 + seed as usize % 5);
        format.alpha_channel = (seed % 3 == 0).then_some(seed as usize % format.channels);
        format.reductions = seed % 7 > 0;
        let made = Made::new(format, 6, 6, &mut numbers);
        assert_eq!(of(made.writer().bytes().unwrap()), [], "seed {seed}");
    }
}

fn of(bytes: Vec<u8>) -> Vec<Finding> {
    check(&Reader::from_bytes(bytes, "made.ptx", &Cache::default()).unwrap())
}

fn made() -> Made {
    let format = Format::new(MeshType::Quad, DataType::U8, 3);
    let mut made = Made::new(format, 5, 3, &mut Numbers(77));
    for (i, face) in (0..).zip(&mut made.faces) {
        face.info.res.ulog2 = 5;
        face.info.res.vlog2 = 4;
        face.texels = match i {
            // A constant face between constant faces.
            1..=3 => vec![1, 2, 3],
            i => (0..3 << 9).map(|n| (n * 7 + i) as u8).collect(),
        };
    }
    made
}

fn finds(findings: &[Finding], face: impl Into<Option<u32>>, word: &str) {
    let face = face.into();
    let found = |f: &Finding| f.face == face && f.message.contains(word);
    assert!(findings.iter().any(found), "{word}: {findings:?}");
}

#[test]
fn neighbours_that_do_not_agree_are_found() {
    let mut made = made();
    made.faces[4].info.neighbours = [None; 4];
    finds(&of(made.writer().bytes().unwrap()), 3, "in turn names none");
    let mut made = self::made();
    let wrong = Neighbour { face: 0, edge: 2 };
    made.faces[1]
        .info
        .neighbours
        .iter_mut()
        .flatten()
        .for_each(|n| {
            if n.face == 0 {
                *n = Neighbour {
                    edge: (n.edge + 1) % 4,
                    ..wrong
                };
            }
        });
    let findings = of(made.writer().bytes().unwrap());
    finds(&findings, 1, "of face 0 beyond edge");
    finds(&findings, 0, "of face 1 beyond edge");
}

#[test]
fn flags_that_lie_are_found() {
    let bytes = made().writer().bytes().unwrap();
    assert_eq!(of(bytes.clone()), []);
    let flagged =
        |face: usize, flags: u8| with_section(&bytes, 0, |faces| faces[20 * face + 3] = flags);
    finds(&of(flagged(1, 5)), 1, "and does not");
    // Files from before there was the flag have it nowhere.
    assert_eq!(of(flagged(2, 1)), []);
    finds(&of(flagged(0, 4)), 0, "not constant itself");
    finds(&of(flagged(0, 2)), 0, "no edit");
    finds(&of(flagged(0, 64)), 0, "unknown flags 0x40");
    finds(&of(flagged(0, 1)), 0, "is constant, and has");
}

#[test]
fn data_that_do_not_agree_are_found() {
    let bytes = made().writer().bytes().unwrap();
    let constants = with_section(&bytes, 1, |texels| texels[0] ^= 64);
    finds(&of(constants), 0, "its constant texel has");
    // With alpha the reductions would be others.
    let mut alpha = bytes.clone();
    alpha[16..20].copy_from_slice(&0_i32.to_le_bytes());
    finds(&of(alpha), 0, "stored reduction to 2^4 x 2^3");
    let mut trailing = bytes;
    trailing.extend([0; 12]);
    finds(&of(trailing), None, "12 bytes behind its end");
    let mut made = made();
    made.format.data_type = DataType::F32;
    made.format.channels = 1;
    for face in &mut made.faces {
        face.info.res.vlog2 = 3;
        face.texels = [f32::NAN.to_le_bytes(), 1.0_f32.to_le_bytes()]
            .concat()
            .repeat(128);
    }
    assert_eq!(of(made.writer().bytes().unwrap()), []);
}

#[test]
fn copies_of_files_with_faults_have_none() {
    for oracle in oracles() {
        let bytes = Writer::copy_of(&oracle.reader).unwrap().bytes().unwrap();
        let wrong = of(bytes);
        assert!(
            wrong.iter().all(|f| f.message.contains("names none")),
            "{wrong:?}"
        );
    }
}

/// The file with its face info (0) or constant data (1) changed.
fn with_section(bytes: &[u8], section: usize, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let field = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let sizes = [field(32), field(36)];
    let start = 104 + sizes[..section].iter().sum::<usize>();
    let end = start + sizes[section];
    let mut expanded = Vec::new();
    flate2::read::ZlibDecoder::new(&bytes[start..end])
        .read_to_end(&mut expanded)
        .unwrap();
    change(&mut expanded);
    let mut stored = Vec::new();
    flate2::read::ZlibEncoder::new(&expanded[..], flate2::Compression::default())
        .read_to_end(&mut stored)
        .unwrap();
    let mut out = [&bytes[..start], &stored, &bytes[end..]].concat();
    let at = 32 + 4 * section;
    out[at..at + 4].copy_from_slice(&(stored.len() as u32).to_le_bytes());
    let position = out.len() as u64;
    out[96..104].copy_from_slice(&position.to_le_bytes());
    out
}
