//! Files of our own: what the shared oracles tell of a file is also what our writer makes of its texels. The first
//! test needs `RELIEVO_SHARED`.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Oracle, hash, oracles};
use relievo_ptex::{BorderMode, Cache, Format, MeshType, Reader, Res, StoredFace, Writer};

#[test]
fn rewritten_oracles_are_laid_out_like_them() {
    for Oracle { name, json, reader } in oracles() {
        let bytes = Writer::copy_of(&reader).unwrap().bytes().unwrap();
        let ours = Reader::from_bytes(bytes, &name, &Cache::default()).unwrap();
        let (theirs, header) = (reader.header(), ours.header());
        assert_eq!(header.mesh_type, theirs.mesh_type, "{name}");
        assert_eq!(header.alpha_channel, theirs.alpha_channel, "{name}");
        assert_eq!(
            ours.ext_header().edge_filter,
            reader.edge_filter(),
            "{name}"
        );
        assert_eq!(ours.border_modes(), reader.border_modes(), "{name}");
        // Files of today's format are the same in all that compression does not change. In a file with edits the
        // levels are those of before.
        let today = theirs.minor_version == 4;
        if !reader.has_edits() {
            assert_eq!(header.levels, theirs.levels, "{name}");
            for (ours, theirs) in ours.levels().zip(reader.levels()) {
                assert_eq!(ours.faces, theirs.faces, "{name}");
            }
            assert_eq!(ours.reduction_order(), reader.reduction_order(), "{name}");
        }
        assert_eq!(ours.meta().unwrap().len(), reader.meta().unwrap().len());
        for (key, value) in reader.meta().unwrap().iter() {
            assert_eq!(ours.meta().unwrap().get(key), Some(value), "{name} {key}");
        }
        let faces = ours
            .stored_faces()
            .unwrap()
            .into_iter()
            .zip(reader.stored_faces().unwrap());
        for (face, (our, their)) in (0..).zip(faces) {
            let place = format!("{name} face {face}");
            let flags = if today { !2 } else { !6 };
            let comparable = |stored: StoredFace| StoredFace {
                flags: stored.flags & flags,
                ..stored
            };
            assert_eq!(comparable(our), comparable(their), "{place}");
            let wanted = &json["faces"][face as usize];
            let one = Res { ulog2: 0, vlog2: 0 };
            // What an edit averages are all texels, and not those of the smallest reduction.
            let edited = reader.face(face).has_edits;
            assert!(
                edited
                    || hash(&ours.texels(face, one, false).unwrap())
                        == hash(&reader.texels(face, one, false).unwrap()),
                "{place}"
            );
            for reduction in wanted["chain"].as_array().unwrap() {
                let part = |i: usize| reduction["res"][i].as_i64().unwrap() as i8;
                let res = Res {
                    ulog2: part(0),
                    vlog2: part(1),
                };
                // The reductions of an edited face are computed; in the copy they are stored.
                if edited && res != our.res {
                    continue;
                }
                let texels = ours.texels(face, res, false).unwrap();
                assert_eq!(hash(&texels), reduction["sha256"], "{place} {res:?}");
                assert_eq!(
                    ours.tile_res(face, res).unwrap(),
                    reader.tile_res(face, res).unwrap(),
                    "{place} {res:?}"
                );
                if let Some(wanted) = reduction.get("premult_sha256") {
                    let texels = ours.texels(face, res, true).unwrap();
                    assert_eq!(hash(&texels), *wanted, "{place} premultiplied");
                }
            }
        }
    }
}

/// Where all faces are constant, all are among their like, but for those at a border that is not clamped. Where one
/// is another, those that touch it are not; and touching is mutual, also between faces, sub-faces and triangles.
#[test]
fn constant_neighbourhoods_are_mutual() {
    for Oracle { name, reader, .. } in oracles() {
        let count = reader.face_count();
        if !(2..=60).contains(&count) || name == "missing_u8_rgb" {
            continue;
        }
        let flags = |other: Option<u32>, border: BorderMode| -> Vec<bool> {
            let mut format = Format::new(reader.mesh_type(), reader.data_type(), 1);
            format.u_border = border;
            let mut writer = Writer::new(format, count).unwrap();
            for face in 0..count {
                let mut texel = [0; 4];
                texel[0] = u8::from(Some(face) == other);
                let texel = &texel[..reader.data_type().bytes()];
                writer.face(face, reader.face(face), texel).unwrap();
            }
            let bytes = writer.bytes().unwrap();
            let made = Reader::from_bytes(bytes, &name, &Cache::default()).unwrap();
            (0..count)
                .map(|face| made.face(face).constant_neighbourhood)
                .collect()
        };
        assert!(flags(None, BorderMode::Clamp).iter().all(|f| *f), "{name}");
        let edges = match reader.mesh_type() {
            MeshType::Triangle => 3,
            MeshType::Quad => 4,
        };
        let black = flags(None, BorderMode::Black);
        for (face, flag) in (0..).zip(black) {
            let neighbours = &reader.face(face).neighbours[..edges];
            assert!(
                !flag || neighbours.iter().all(Option::is_some),
                "{name} {face}"
            );
        }
        let touched: Vec<Vec<bool>> = (0..count)
            .map(|face| flags(Some(face), BorderMode::Clamp))
            .collect();
        for (face, flags) in touched.iter().enumerate() {
            assert!(!flags[face], "{name} {face}");
            for neighbour in reader.face(face as u32).neighbours.iter().flatten() {
                assert!(!flags[neighbour.face as usize], "{name} {face}");
            }
            for (other, flag) in flags.iter().enumerate() {
                assert_eq!(*flag, touched[other][face], "{name} {face} {other}");
            }
        }
    }
}
