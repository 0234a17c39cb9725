//! Any bytes as a Ptex file, or as what is in its compressed blocks: those would hardly ever be whole by chance. All
//! that can be read is read, checked, copied and edited.

use std::io::Read;

use flate2::Compression;
use flate2::read::ZlibEncoder;
use relievo_ptex::{Cache, Editor, Reader, Res, Writer, check};

/// Reads a file, or what becomes one.
pub fn run(bytes: &[u8]) {
    let file = match bytes.first() {
        Some(b'P') => bytes.to_vec(),
        _ => assembled(bytes),
    };
    let Ok(reader) = Reader::from_bytes(file, "fuzz.ptx", &Cache::new(1 << 20)) else {
        return;
    };
    let _ = reader.meta();
    let mut texels = 0_u64;
    for face in 0..reader.face_count().min(16) {
        texels += read(&reader, face);
    }
    // The rest takes a time in proportion to the size: small files have all that there is to find.
    if reader.face_count() > 16 || texels > 1 << 16 {
        return;
    }
    let _ = check(&reader);
    copy(&reader);
}

/// Every size of a face, in both ways. Gives the texels of its full size.
fn read(reader: &Reader, face: u32) -> u64 {
    let full = reader.face(face).res;
    for ulog2 in 0..=full.ulog2 {
        for vlog2 in 0..=full.vlog2 {
            let res = Res { ulog2, vlog2 };
            for premultiply in [false, true] {
                let Ok(texels) = reader.texels(face, res, premultiply) else {
                    continue;
                };
                let (x, y) = ((1_usize << ulog2) - 1, (1_usize << vlog2) - 1);
                let mut sums = [0.0];
                let _ = texels.add(x, y, 1.0, reader.channels() - 1, &mut sums);
                let (width, height) = (2.min(x + 1), 2.min(y + 1));
                let weights = [0.5; 2];
                let _ = texels.add_weighted(
                    0,
                    0,
                    &weights[..width],
                    &weights[..height],
                    1.0,
                    0,
                    &mut sums,
                );
                let _ = texels.copy(0, 0, width, height, &mut Vec::new());
            }
        }
    }
    1 << (full.ulog2 + full.vlog2) as u32
}

/// A copy has the same texels, and so has an edited one.
fn copy(reader: &Reader) {
    let Ok(bytes) = Writer::copy_of(reader).and_then(|writer| writer.bytes()) else {
        return;
    };
    let copy =
        Reader::from_bytes(bytes, "copy.ptx", &Cache::default()).expect("a copy can be read");
    let mut editor = Editor::new(&copy);
    for face in 0..copy.face_count() {
        let texels = whole(reader, face);
        assert_eq!(whole(&copy, face), texels, "face {face}");
        editor
            .face(face, copy.face(face), &texels)
            .expect("a face can be edited");
    }
    let edited = editor.bytes().expect("edits can be written");
    let edited =
        Reader::from_bytes(edited, "edited.ptx", &Cache::default()).expect("edits can be read");
    for face in 0..copy.face_count() {
        assert_eq!(whole(&edited, face), whole(reader, face), "face {face}");
    }
}

fn whole(reader: &Reader, face: u32) -> Vec<u8> {
    let res = reader.face(face).res;
    let mut out = Vec::new();
    reader
        .texels(face, res, false)
        .and_then(|texels| texels.copy(0, 0, 1 << res.ulog2, 1 << res.vlog2, &mut out))
        .expect("what was copied can be read");
    out
}

/// A file of the header, and of pieces that are compressed here. Sizes in the header are put right.
fn assembled(bytes: &[u8]) -> Vec<u8> {
    let mut rest = bytes;
    let mut take = |size: usize| {
        let (piece, after) = rest.split_at(size.min(rest.len()));
        rest = after;
        piece.to_vec()
    };
    let head = take(8);
    let byte = |i: usize| usize::from(head.get(i).copied().unwrap_or(0));
    let (faces, levels) = (1 + byte(4) % 4, 1 + byte(5) % 3);
    let (channels, width) = (1 + byte(2) % 4, [1, 2, 2, 4][byte(1) % 4]);
    let face_info = zip(&fill(take(20 * faces), 20 * faces));
    let constants = zip(&fill(
        take(faces * channels * width),
        faces * channels * width,
    ));
    let (mut level_info, mut level_data) = (Vec::new(), Vec::new());
    for _ in 0..levels {
        let (mut words, mut blocks) = (Vec::new(), Vec::new());
        for _ in 0..faces {
            let how = fill(take(3), 3);
            let piece = take(usize::from(how[1]) << (how[2] % 8));
            let (encoding, block) = match how[0] % 8 {
                0 => (0, piece),
                1 | 2 => (1, zip(&piece)),
                3 | 4 => (2, zip(&piece)),
                5 => (3, piece),
                _ => (3, tiles(&piece, usize::from(how[0] / 8))),
            };
            words.extend((encoding << 30 | block.len() as u32).to_le_bytes());
            blocks.extend(block);
        }
        let words = zip(&words);
        level_info.extend(((words.len() + blocks.len()) as u64).to_le_bytes());
        level_info.extend((words.len() as u32).to_le_bytes());
        level_info.extend((faces as u32).to_le_bytes());
        level_data.extend([words, blocks].concat());
    }
    let meta = take(byte(6));
    let meta_zip = zip(&meta);
    let mut file = b"Ptex".to_vec();
    let alpha = byte(3) as i32 % (channels as i32 + 1) - 1;
    for field in [1, byte(0) as u32 % 2, byte(1) as u32 % 4, alpha as u32] {
        file.extend(field.to_le_bytes());
    }
    file.extend((channels as u16).to_le_bytes());
    file.extend((levels as u16).to_le_bytes());
    for field in [
        faces,
        0,
        face_info.len(),
        constants.len(),
        level_info.len(),
        4,
    ] {
        file.extend((field as u32).to_le_bytes());
    }
    file.extend((level_data.len() as u64).to_le_bytes());
    for field in [meta_zip.len(), meta.len()] {
        file.extend((field as u32).to_le_bytes());
    }
    for part in [
        &face_info,
        &constants,
        &level_info,
        &level_data,
        &meta_zip,
        &vec![0; 8],
    ] {
        file.extend(part);
    }
    // What is left are edits.
    file.extend(take(usize::MAX));
    file
}

/// A grid of tiles of one size: a list, and their data.
fn tiles(piece: &[u8], size: usize) -> Vec<u8> {
    let (count, rest) = piece.split_at(piece.len().min(1));
    let count = 1 + usize::from(count.first().copied().unwrap_or(0)) % 16;
    let (mut words, mut blocks) = (Vec::new(), Vec::new());
    for piece in rest.chunks(rest.len().div_ceil(count).max(1)) {
        let (encoding, block) = match piece.len() < 5 {
            true => (0, piece.to_vec()),
            false => (1, zip(piece)),
        };
        words.extend((encoding << 30_u32 | block.len() as u32).to_le_bytes());
        blocks.extend(block);
    }
    let words = zip(&words);
    let mut out = vec![size as u8 % 4, size as u8 / 4 % 4];
    out.extend((words.len() as u32).to_le_bytes());
    [out, words, blocks].concat()
}

fn fill(mut bytes: Vec<u8>, size: usize) -> Vec<u8> {
    bytes.resize(size, 0);
    bytes
}

fn zip(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    ZlibEncoder::new(bytes, Compression::fast())
        .read_to_end(&mut out)
        .expect("reading memory does not fail");
    out
}
