//! Whether all chunks of an OpenEXR file are there.
//!
//! A file's headers are followed by a table of where each chunk of rows or tiles is. The library fills it in as chunks are
//! written; where it had no memory to compress one it leaves a 0 there, and says nothing (OpenEXR 3.1.5).

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

/// The version's bit that says that there are several headers, and that an empty one ends them.
const SEVERAL_PARTS: u32 = 1 << 12;

/// Whether the file's table says of each chunk where it is, and none of it is missing.
pub(super) fn are_all_there(path: &Path) -> io::Result<bool> {
    match read_table(path) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        read => read,
    }
}

fn read_table(path: &Path) -> io::Result<bool> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut file = BufReader::new(file);
    let mut at = table(&mut file)?;
    // Chunks begin where it ends.
    let mut first = length;
    while at < first {
        let mut offset = [0; 8];
        file.read_exact(&mut offset)?;
        at += 8;
        match u64::from_le_bytes(offset) {
            0 => return Ok(false),
            offset => first = first.min(offset),
        }
    }
    Ok(at == first)
}

/// Goes on to where the table begins.
fn table(file: &mut BufReader<File>) -> io::Result<u64> {
    let [_magic, version] = [u32_of(file)?, u32_of(file)?];
    while skip_header(file)? && version & SEVERAL_PARTS != 0 {}
    file.stream_position()
}

/// Goes on past the attributes of a header; false if there are none.
fn skip_header(file: &mut BufReader<File>) -> io::Result<bool> {
    let mut any = false;
    while skip_text(file)? {
        skip_text(file)?;
        let size = u32_of(file)?;
        file.seek_relative(size.into())?;
        any = true;
    }
    Ok(any)
}

/// Goes on past a text and the zero that ends it; false if it is empty.
fn skip_text(file: &mut BufReader<File>) -> io::Result<bool> {
    let mut any = false;
    loop {
        let mut byte = [0];
        file.read_exact(&mut byte)?;
        if byte == [0] {
            return Ok(any);
        }
        any = true;
    }
}

fn u32_of(file: &mut BufReader<File>) -> io::Result<u32> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ChannelFormat, Picture, test_files, write_exr};

    #[test]
    fn what_is_left_out_is_seen() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let values: Vec<f32> = (0..40 * 100).map(|i| i as f32).collect();
        let part = |name: &str| test_files::part(name, "Z", ChannelFormat::Float, &values);
        for (tile, parts) in [
            (None, vec![part("")]),
            (Some(16), vec![part("")]),
            (None, vec![part("a"), part("b")]),
        ] {
            let picture = test_files::picture(40, part(""));
            let picture = Picture {
                tile,
                parts,
                ..picture
            };
            write_exr(&path, &picture).expect("written");
            assert!(are_all_there(&path).expect("a file"));
            let mut file = BufReader::new(File::open(&path).expect("a file"));
            let table = table(&mut file).expect("a table") as usize;
            let mut bytes = std::fs::read(&path).expect("a file");
            bytes[table + 8..table + 16].fill(0);
            std::fs::write(&path, &bytes).expect("written");
            assert!(!are_all_there(&path).expect("a file"));
            std::fs::write(&path, &bytes[..table - 9]).expect("written");
            assert!(!are_all_there(&path).expect("a file"));
        }
    }
}
