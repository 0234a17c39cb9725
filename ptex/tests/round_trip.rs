//! Files that we wrote hold what was given, for any types, sizes, channels, and edits.

#![allow(clippy::unwrap_used)]

mod common;

use common::made::{Face, Made, Numbers, texels};
use proptest::prelude::*;
use relievo_ptex::{
    BorderMode, Cache, DataType, EdgeFilter, Editor, ErrorKind, Format, MeshType, MetaValue,
    Reader, Res, Writer,
};

fn formats() -> impl Strategy<Value = Format> {
    (
        prop_oneof![Just(MeshType::Quad), Just(MeshType::Triangle)],
        prop_oneof![
            Just(DataType::U8),
            Just(DataType::U16),
            Just(DataType::F16),
            Just(DataType::F32)
        ],
        1..=6_usize,
        any::<bool>(),
        any::<bool>(),
        0..3_u8,
        any::<prop::sample::Index>(),
    )
        .prop_map(
            |(mesh_type, data_type, channels, reductions, tangent, border, alpha)| {
                let mut format = Format::new(mesh_type, data_type, channels);
                format.reductions = reductions;
                let modes = [BorderMode::Clamp, BorderMode::Black, BorderMode::Periodic];
                format.u_border = modes[usize::from(border)];
                format.v_border = modes[usize::from((border + 1) % 3)];
                if tangent {
                    format.edge_filter = EdgeFilter::TangentVector;
                }
                // One more than there are channels: none.
                let alpha = alpha.index(channels + 1);
                format.alpha_channel = (alpha < channels).then_some(alpha);
                format
            },
        )
}

/// All texels of a face in the size that it has.
fn full(made: &Format, face: &Face) -> Vec<u8> {
    if face.texels.len() == made.pixel_bytes() {
        let count = 1 << (face.info.res.ulog2 + face.info.res.vlog2);
        return face.texels.repeat(count);
    }
    face.texels.clone()
}

fn read(reader: &Reader, face: u32, res: Res) -> Vec<u8> {
    let texels = reader.texels(face, res, false).unwrap();
    let mut out = Vec::new();
    let (width, height) = (1 << res.ulog2, 1 << res.vlog2);
    texels.copy(0, 0, width, height, &mut out).unwrap();
    // Summing sees the same texels as copying.
    let channels = reader.channels();
    let (x, y) = (width / 2, height / 3);
    let (wide, high) = ((width - x).min(3), (height - y).min(3));
    let mut sums = vec![0.0; channels];
    texels
        .add_weighted(
            x,
            y,
            &[1.0, 0.5, 0.25][..wide],
            &[1.0, -0.5, 2.0][..high],
            2.0,
            0,
            &mut sums,
        )
        .unwrap();
    let mut wanted = vec![0.0; channels];
    for j in 0..high {
        for i in 0..wide {
            let weight = 2.0 * [1.0, 0.5, 0.25][i] * [1.0, -0.5, 2.0][j];
            texels.add(x + i, y + j, weight, 0, &mut wanted).unwrap();
        }
    }
    let one = reader.data_type().one();
    for (sum, wanted) in sums.iter().zip(&wanted) {
        assert!((sum - wanted).abs() < 1e-4 * one, "{sums:?} {wanted:?}");
    }
    out
}

fn assert_same(reader: &Reader, made: &Made) {
    assert_eq!(Format::of(reader).data_type, made.format.data_type);
    assert_eq!(reader.face_count() as usize, made.faces.len());
    for (i, face) in (0..).zip(&made.faces) {
        let info = reader.face(i);
        assert_eq!(info.res, face.info.res, "face {i}");
        assert_eq!(info.neighbours, face.info.neighbours, "face {i}");
        let wanted = full(&made.format, face);
        let pixel = made.format.pixel_bytes();
        assert_eq!(
            info.constant,
            wanted.chunks(pixel).all(|t| *t == wanted[..pixel]),
            "face {i}"
        );
        assert_eq!(read(reader, i, info.res), wanted, "face {i}");
    }
    let meta = reader.meta().unwrap();
    assert_eq!(meta.len(), made.meta.len());
    for (key, value) in &made.meta {
        assert_eq!(meta.get(key), Some(value));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn what_is_written_is_read(format in formats(), count in 0..7_u32, seed in 1..u64::MAX) {
        let made = Made::new(format, count, 6, &mut Numbers(seed));
        let bytes = made.writer().bytes().unwrap();
        let reader = Reader::from_bytes(bytes, "made.ptx", &Cache::default()).unwrap();
        assert_same(&reader, &made);
        prop_assert_eq!(Format::of(&reader).alpha_channel, made.format.alpha_channel);
        prop_assert_eq!(reader.edge_filter(), made.format.edge_filter);
        prop_assert_eq!(reader.border_modes(), (made.format.u_border, made.format.v_border));
        let wanted = made.faces.iter().zip(0..).filter(|(_, i)| !reader.face(*i).constant);
        let smallest = wanted.map(|(f, _)| f.info.res.ulog2.min(f.info.res.vlog2)).max().unwrap_or(0);
        let levels = if made.format.reductions { 1 + (smallest - 2).max(0) as u16 } else { 1 };
        prop_assert_eq!(reader.header().levels, levels);
    }

    #[test]
    fn edits_replace_what_was(format in formats(), count in 1..6_u32, seed in 1..u64::MAX) {
        let mut numbers = Numbers(seed);
        let mut made = Made::new(format, count, 5, &mut numbers);
        let mut bytes = made.writer().bytes().unwrap();
        for round in 0..3 {
            let reader = Reader::from_bytes(bytes, "made.ptx", &Cache::default()).unwrap();
            let mut editor = Editor::new(&reader);
            for _ in 0..numbers.below(3) {
                let i = numbers.below(u64::from(count)) as usize;
                let face = &mut made.faces[i];
                if numbers.below(2) == 0 {
                    let ulog2 = numbers.below(6) as i8;
                    face.info.res = Res { ulog2, vlog2: ulog2 };
                }
                face.texels = texels(&made.format, face.info.res, &mut numbers);
                editor.face(i as u32, &face.info, &face.texels).unwrap();
            }
            if numbers.below(2) == 0 {
                let value = MetaValue::I32(vec![round; 400]);
                let key = format!("key {}", numbers.below(6));
                editor.set_meta(&key, value.clone()).unwrap();
                match made.meta.iter_mut().find(|(k, _)| *k == key) {
                    Some((_, old)) => *old = value,
                    None => made.meta.push((key, value)),
                }
            }
            bytes = editor.bytes().unwrap();
        }
        let reader = Reader::from_bytes(bytes, "made.ptx", &Cache::default()).unwrap();
        assert_same(&reader, &made);
        // Applied, they are as if they had never been made.
        let applied = Writer::copy_of(&reader).unwrap().bytes().unwrap();
        let applied = Reader::from_bytes(applied, "applied.ptx", &Cache::default()).unwrap();
        assert_same(&applied, &made);
        prop_assert!(!applied.has_edits());
    }

    #[test]
    fn damage_is_an_error_or_unseen(format in formats(), seed in 1..u64::MAX, hits in 1..4_usize) {
        let mut numbers = Numbers(seed);
        let made = Made::new(format, 4, 4, &mut numbers);
        let mut bytes = made.writer().bytes().unwrap();
        for _ in 0..hits {
            let at = numbers.below(bytes.len() as u64) as usize;
            bytes[at] ^= 1 << numbers.below(8);
        }
        if numbers.below(4) == 0 {
            let at = numbers.below(bytes.len() as u64) as usize;
            bytes.truncate(at);
        }
        let allowed = |kind| matches!(kind, ErrorKind::Malformed | ErrorKind::Memory);
        match Reader::from_bytes(bytes, "damaged.ptx", &Cache::new(1 << 22)) {
            Err(e) => prop_assert!(allowed(e.kind()), "{e}"),
            Ok(reader) => {
                for face in 0..reader.face_count() {
                    let mut res = reader.face(face).res;
                    if res.ulog2 + res.vlog2 > 12 {
                        continue;
                    }
                    while res.ulog2.max(res.vlog2) >= 0 {
                        let size = Res { ulog2: res.ulog2.max(0), vlog2: res.vlog2.max(0) };
                        match reader.texels(face, size, true) {
                            Err(e) => prop_assert!(allowed(e.kind()), "{e}"),
                            Ok(texels) => {
                                let copied =
                                    texels.copy(0, 0, 1 << size.ulog2, 1 << size.vlog2, &mut Vec::new());
                                prop_assert!(copied.map_or_else(|e| allowed(e.kind()), |()| true));
                            }
                        }
                        res.ulog2 -= 1;
                        res.vlog2 -= 1;
                    }
                }
                if let Err(e) = reader.meta() {
                    prop_assert!(allowed(e.kind()), "{e}");
                }
            }
        }
    }
}

/// Tiles of every type, and reductions of tiled faces: they are those of the same texels untiled.
#[test]
fn tiled_faces_are_like_others() {
    let cases = [
        (MeshType::Quad, DataType::U8, 3, [9, 8]),
        (MeshType::Quad, DataType::U16, 2, [10, 8]),
        (MeshType::Quad, DataType::F32, 1, [6, 11]),
        (MeshType::Quad, DataType::F16, 4, [8, 9]),
        (MeshType::Triangle, DataType::F32, 3, [8, 8]),
        (MeshType::Triangle, DataType::U16, 1, [9, 9]),
    ];
    for (seed, (mesh_type, data_type, channels, [ulog2, vlog2])) in (1..).zip(cases) {
        for reductions in [true, false] {
            let mut numbers = Numbers(seed);
            let mut format = Format::new(mesh_type, data_type, channels);
            format.reductions = reductions;
            let mut made = Made::new(format, 3, 1, &mut numbers);
            for face in &mut made.faces {
                face.info.res = Res { ulog2, vlog2 };
                face.texels = texels(&made.format, face.info.res, &mut numbers);
            }
            let bytes = made.writer().bytes().unwrap();
            for budget in [1 << 30, 100_000] {
                let cache = Cache::new(budget);
                let reader = Reader::from_bytes(bytes.clone(), "tiled.ptx", &cache).unwrap();
                for face in (0..3).filter(|face| !reader.face(*face).constant) {
                    let tiles = reader.tile_res(face, Res { ulog2, vlog2 }).unwrap();
                    assert!(tiles.is_some());
                }
                assert_same(&reader, &made);
                assert_reduced(&reader, &made);
            }
        }
    }
}

/// Reductions that are not stored, one texel at a time.
fn assert_reduced(reader: &Reader, made: &Made) {
    let stored = reader.header().levels > 1;
    for (i, face) in (0..).zip(&made.faces) {
        let res = face.info.res;
        let (width, height) = (1_usize << res.ulog2, 1_usize << res.vlog2);
        let texels = full(&made.format, face);
        let pixel = made.format.pixel_bytes();
        let value = |x: usize, y: usize, c: usize| {
            let bytes = &texels[(y * width + x) * pixel..][..pixel];
            let bytes = &bytes[c * made.format.data_type.bytes()..];
            match made.format.data_type {
                DataType::U8 => f32::from(bytes[0]),
                DataType::U16 => f32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
                DataType::F16 => half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32(),
                DataType::F32 => f32::from_le_bytes(bytes[..4].try_into().unwrap()),
            }
        };
        let cut = |value: f32| match made.format.data_type {
            DataType::U8 | DataType::U16 => value.floor(),
            // Halves round, but not by more than this of 4.
            _ => value,
        };
        let near = |res: Res, wanted: &dyn Fn(usize, usize, usize) -> f32| {
            let texels = reader.texels(i, res, false).unwrap();
            for y in (0..1 << res.vlog2).step_by(3) {
                for x in (0..1 << res.ulog2).step_by(7) {
                    let mut found = vec![0.0; made.format.channels];
                    texels.add(x, y, 1.0, 0, &mut found).unwrap();
                    for (c, found) in found.iter().enumerate() {
                        let wanted = wanted(x, y, c);
                        assert!(
                            (found - wanted).abs() < 3e-3,
                            "{res:?} {x} {y} {found} {wanted}"
                        );
                    }
                }
            }
        };
        let Res { ulog2, vlog2 } = res;
        let both = Res {
            ulog2: ulog2 - 1,
            vlog2: vlog2 - 1,
        };
        if made.format.mesh_type == MeshType::Triangle {
            near(both, &|x, y, c| {
                cut(0.25
                    * (value(2 * x, 2 * y, c)
                        + value(2 * x + 1, 2 * y, c)
                        + value(2 * x, 2 * y + 1, c)
                        + value(width - 1 - 2 * y, height - 1 - 2 * x, c)))
            });
            continue;
        }
        let along_u =
            |x: usize, y: usize, c: usize| cut(0.5 * (value(2 * x, y, c) + value(2 * x + 1, y, c)));
        let along_v =
            |x: usize, y: usize, c: usize| cut(0.5 * (value(x, 2 * y, c) + value(x, 2 * y + 1, c)));
        near(
            Res {
                ulog2: ulog2 - 1,
                vlog2,
            },
            &along_u,
        );
        near(
            Res {
                ulog2,
                vlog2: vlog2 - 1,
            },
            &along_v,
        );
        near(both, &|x, y, c| {
            if stored && !reader.face(i).constant {
                cut(0.25
                    * (value(2 * x, 2 * y, c)
                        + value(2 * x + 1, 2 * y, c)
                        + value(2 * x, 2 * y + 1, c)
                        + value(2 * x + 1, 2 * y + 1, c)))
            } else if both.ulog2 % 2 == 1 {
                // Along u last, from what was halved along v.
                cut(0.5 * (along_v(2 * x, y, c) + along_v(2 * x + 1, y, c)))
            } else {
                cut(0.5 * (along_u(x, 2 * y, c) + along_u(x, 2 * y + 1, c)))
            }
        });
    }
}

#[test]
fn what_cannot_be_written_is_refused() {
    let format = Format::new(MeshType::Triangle, DataType::U8, 3);
    let refused = |result: relievo_ptex::Result<()>, word: &str| {
        let e = result.unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Request);
        assert!(e.to_string().contains(word), "{e}");
    };
    let with = |channels, alpha_channel| Format {
        channels,
        alpha_channel,
        ..Format::new(MeshType::Quad, DataType::U8, 3)
    };
    let new = |format| Writer::new(format, 1).map(|_| ());
    refused(new(with(0, None)), "0 channels");
    refused(new(with(3, Some(3))), "channel 3");
    let mut made = Made::new(format, 2, 2, &mut Numbers(5));
    let mut writer = made.writer();
    let face = &mut made.faces[0];
    refused(writer.face(0, &face.info, &[1, 2]), "2 bytes");
    refused(writer.face(7, &face.info, &[1, 2, 3]), "face 7");
    face.info.res = Res { ulog2: 1, vlog2: 2 };
    refused(writer.face(0, &face.info, &[1, 2, 3]), "triangle");
    face.info.res = Res {
        ulog2: 30,
        vlog2: 30,
    };
    refused(writer.face(0, &face.info, &[1, 2, 3]), "2^30");
    face.info.res = Res { ulog2: 0, vlog2: 0 };
    face.info.neighbours[3] = face.info.neighbours[1];
    refused(writer.face(0, &face.info, &[1, 2, 3]), "edge 3");
    refused(
        writer.set_meta(&"k".repeat(255), MetaValue::I8(vec![])),
        "name",
    );
    refused(writer.set_meta("", MetaValue::I8(vec![])), "name");
    assert!(
        writer
            .set_meta(&"k".repeat(254), MetaValue::I8(vec![]))
            .is_ok()
    );
}

#[test]
fn a_file_can_be_edited_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptx");
    let format = Format::new(MeshType::Quad, DataType::U8, 1);
    let mut made = Made::new(format, 3, 4, &mut Numbers(9));
    made.writer().write(&path).unwrap();
    let reader = Reader::open(&path, &Cache::default()).unwrap();
    let before = read(&reader, 0, reader.face(0).res);
    let mut editor = Editor::new(&reader);
    made.faces[0].info.res = Res { ulog2: 1, vlog2: 1 };
    made.faces[0].texels = vec![1, 2, 3, 4];
    editor
        .face(0, &made.faces[0].info, &made.faces[0].texels)
        .unwrap();
    editor.write(&path).unwrap();
    assert_same(&Reader::open(&path, &Cache::default()).unwrap(), &made);
    assert_eq!(read(&reader, 0, reader.face(0).res), before);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Extended headers of other sizes than today's: fields that are not there are zero, what follows is skipped.
#[test]
fn extended_headers_have_any_size() {
    let mut format = Format::new(MeshType::Quad, DataType::U8, 2);
    format.u_border = BorderMode::Periodic;
    let mut made = Made::new(format, 3, 4, &mut Numbers(21));
    let bytes = made.writer().bytes().unwrap();
    for size in [0_usize, 5, 24, 40, 64] {
        let mut other = bytes[..64].to_vec();
        other[28..32].copy_from_slice(&(size as u32).to_le_bytes());
        let mut ext = bytes[64..104].to_vec();
        let position = (bytes.len() + size - 40) as u64;
        ext[32..].copy_from_slice(&position.to_le_bytes());
        ext.resize(size, 0xff);
        other.extend(ext);
        other.extend(&bytes[104..]);
        let open = |bytes| Reader::from_bytes(bytes, "other.ptx", &Cache::default()).unwrap();
        let reader = open(other);
        assert_same(&reader, &made);
        let periodic = reader.border_modes().0 == BorderMode::Periodic;
        assert_eq!(periodic, size > 0);
        // Edits find their place in all of them.
        let before = made.faces[1].clone();
        made.faces[1].info.res = Res { ulog2: 2, vlog2: 1 };
        made.faces[1].texels = (0..16).collect();
        let mut editor = Editor::new(&reader);
        editor
            .face(1, &made.faces[1].info, &made.faces[1].texels)
            .unwrap();
        let edited = open(editor.bytes().unwrap());
        assert!(edited.has_edits() && edited.face(1).has_edits);
        assert_same(&edited, &made);
        let again = open(Editor::new(&edited).bytes().unwrap());
        assert_same(&again, &made);
        made.faces[1] = before;
    }
}

/// A face among constant ones of its texel is no longer so when one of them is edited.
#[test]
fn an_edit_ends_constant_neighbourhoods() {
    let format = Format::new(MeshType::Quad, DataType::U8, 1);
    let mut made = Made::new(format, 5, 2, &mut Numbers(4));
    for face in &mut made.faces {
        face.texels = vec![50];
    }
    let open = |bytes| Reader::from_bytes(bytes, "a.ptx", &Cache::default()).unwrap();
    let flags = |reader: &Reader| -> Vec<bool> {
        (0..5)
            .map(|face| reader.face(face).constant_neighbourhood)
            .collect()
    };
    let reader = open(made.writer().bytes().unwrap());
    assert_eq!(flags(&reader), [true; 5]);
    let mut editor = Editor::new(&reader);
    made.faces[1].texels = vec![51];
    editor.face(1, &made.faces[1].info, &[51]).unwrap();
    let edited = open(editor.bytes().unwrap());
    assert_same(&edited, &made);
    assert_eq!(flags(&edited), [false, false, false, true, true]);
    assert_eq!(relievo_ptex::check(&edited), []);
}

/// Threads read all faces in different orders while the cache has room for hardly any.
#[test]
fn threads_share_a_small_cache() {
    let format = Format::new(MeshType::Quad, DataType::U16, 3);
    let mut made = Made::new(format, 12, 6, &mut Numbers(8));
    made.faces[3].info.res = Res { ulog2: 9, vlog2: 8 };
    made.faces[3].texels = texels(&made.format, made.faces[3].info.res, &mut Numbers(11));
    let cache = Cache::new(200_000);
    let bytes = made.writer().bytes().unwrap();
    let reader = Reader::from_bytes(bytes, "shared.ptx", &cache).unwrap();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (reader, made, cache) = (&reader, &made, &cache);
            scope.spawn(move || {
                for i in 0..120_u32 {
                    let face = (i * (thread * 2 + 1) + thread) % 12;
                    let given = &made.faces[face as usize];
                    let found = read(reader, face, given.info.res);
                    assert!(found == full(&made.format, given), "face {face}");
                    assert!(cache.held() <= cache.budget());
                }
            });
        }
    });
}
