//! Damaged files: each does what the shared list asks of a reader. Needs `RELIEVO_SHARED`.

#![allow(clippy::unwrap_used)]

mod common;

use relievo_ptex::{Cache, Error, ErrorKind, Reader};

/// What became of a file.
struct Outcome {
    open: Result<(), Error>,
    faces: Vec<Result<(), Error>>,
    meta: Option<Error>,
}

fn try_everything(path: &std::path::Path) -> Outcome {
    let cache = Cache::new(16 << 20);
    let reader = match Reader::open(path, &cache) {
        Ok(reader) => reader,
        Err(e) => {
            return Outcome {
                open: Err(e),
                faces: Vec::new(),
                meta: None,
            };
        }
    };
    let faces = (0..reader.face_count()).map(|face| {
        let mut res = reader.face(face).res;
        loop {
            let texels = reader.texels(face, res, true)?;
            texels.copy(0, 0, 1 << res.ulog2, 1 << res.vlog2, &mut Vec::new())?;
            if (res.ulog2, res.vlog2) == (0, 0) {
                return Ok(());
            }
            res.ulog2 = (res.ulog2 - 1).max(0);
            res.vlog2 = (res.vlog2 - 1).max(0);
        }
    });
    Outcome {
        open: Ok(()),
        faces: faces.collect(),
        meta: reader.meta().err(),
    }
}

#[test]
fn damaged_files_do_what_is_required() {
    let Some(folder) = common::folder() else {
        return;
    };
    let folder = folder.join("malformed");
    let list = std::fs::read(folder.join("malformed.json")).unwrap();
    let list: serde_json::Value = serde_json::from_slice(&list).unwrap();
    let list = list.as_array().unwrap();
    assert_eq!(list.len(), 22);
    for entry in list {
        let name = entry["file"].as_str().unwrap();
        let required = entry["required"].as_str().unwrap();
        let before = peak();
        let outcome = try_everything(&folder.join(name));
        let grown = peak() - before;
        assert!(grown < 100_000, "{name}: {grown} kB more");
        let errors = outcome.open.as_ref().err().into_iter();
        let errors = errors
            .chain(outcome.faces.iter().filter_map(|f| f.as_ref().err()))
            .chain(&outcome.meta);
        for error in errors {
            println!("{error}");
            assert_eq!(error.kind(), ErrorKind::Malformed, "{name}: {error}");
            assert!(error.to_string().contains(name), "{error}");
            assert!(!error.help().is_empty());
        }
        for (face, outcome) in (0..).zip(&outcome.faces) {
            if let Err(e) = outcome {
                assert_eq!(e.face(), Some(face), "{name}: {e}");
            }
        }
        let opened = outcome.open.is_ok();
        let failed = outcome.faces.iter().filter(|f| f.is_err()).count();
        match name {
            // Damage to what all faces need, or that is found before any is read.
            "empty.ptx"
            | "trunc_header.ptx"
            | "trunc_faceinfo.ptx"
            | "trunc_level.ptx"
            | "bad_magic.ptx"
            | "version2.ptx"
            | "bad_meshtype.ptx"
            | "bad_datatype.ptx"
            | "zero_channels.ptx"
            | "alpha_out_of_range.ptx"
            | "huge_nfaces.ptx"
            | "nlevels_more.ptx"
            | "huge_leveldata.ptx"
            | "zlib_faceinfo.ptx"
            | "absurd_res.ptx" => {
                assert!(required.starts_with("open"), "{required}");
                assert!(required.contains("open error"), "{required}");
                assert!(!opened, "{name} opens");
            }
            "bomb_meta.ptx" => {
                assert!(!opened || outcome.meta.is_some(), "{name}");
                assert_eq!(failed, 0, "{name}");
            }
            "adj_out_of_range.ptx" => assert!(opened && failed == 0, "{name}"),
            "blocksize_past_eof.ptx" => assert!(opened && failed > 0, "{name}"),
            "zlib_face0.ptx" | "tile_larger_than_face.ptx" | "tile_1x1.ptx" => {
                assert!(required.contains("read error"), "{required}");
                assert!(opened && failed == 1, "{name}: {failed}");
                assert!(outcome.faces[0].is_err(), "{name}");
            }
            // The wrong size also changes the order in which reductions are stored: those of others fail too.
            "res_mismatch.ptx" => assert!(opened && outcome.faces[0].is_err(), "{name}"),
            _ => panic!("{name} is new: {required}"),
        }
    }
}

/// The process's largest size so far, in kB, whether touched or not.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmPeak:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}
