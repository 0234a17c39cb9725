//! PNG files, for looking at: 8 bits, encoded by the sRGB curve.

use std::path::Path;

use glam::Vec4;

use super::border::{FileFormat, Header, Output, Refusal};
use super::exr::refused;
use super::picture::Attribute;
use super::srgb_from_linear;
use super::temporary::write_whole;
use crate::{Error, Result};

/// Writes linear, premultiplied colours (row 0 on top) as sRGB with straight alpha, which is what PNG wants.
/// `path` appears whole or not at all. What is not a number becomes 0; what is out of range is clipped.
pub fn write_png(path: &Path, width: u32, height: u32, rgba: &[Vec4]) -> Result<()> {
    let expected = (width as usize).checked_mul(height as usize);
    let limit = i32::MAX as u32;
    if width == 0 || height == 0 || width > limit || height > limit || expected != Some(rgba.len())
    {
        return Err(Error::failed(format!(
            "cannot write {}: {} pixels for {width} × {height}",
            path.display(),
            rgba.len()
        )));
    }
    write_whole(path, |temporary| {
        write(temporary, width, height, rgba).map_err(|refusal| refused(path, &refusal))
    })
}

/// Writes bytes as they are, row 0 on top: grey, grey and alpha, colours, or colours and alpha, as 1 to 4 `channels`
/// say. `path` appears whole or not at all.
pub fn write_png_bytes(
    path: &Path,
    width: u32,
    height: u32,
    channels: usize,
    bytes: &[u8],
) -> Result<()> {
    let names: &[&str] = match channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        4 => &["R", "G", "B", "A"],
        _ => &[],
    };
    let row = (width as usize).checked_mul(channels);
    let expected = row.and_then(|row| row.checked_mul(height as usize));
    if names.is_empty() || bytes.is_empty() || expected != Some(bytes.len()) {
        return Err(Error::failed(format!(
            "cannot write {}: {} bytes for {width} × {height} pixels of {channels} channels",
            path.display(),
            bytes.len()
        )));
    }
    write_whole(path, |temporary| {
        let rows = bytes.chunks_exact(bytes.len() / height as usize);
        write_rows(temporary, width, height, names, rows).map_err(|refusal| refused(path, &refusal))
    })
}

fn write(temporary: &Path, width: u32, height: u32, rgba: &[Vec4]) -> Result<(), Refusal> {
    let rows = rgba.chunks_exact(width as usize).map(|row| {
        let bytes = row.iter().flat_map(|pixel| bytes_from(*pixel));
        bytes.collect::<Vec<u8>>()
    });
    write_rows(temporary, width, height, &["R", "G", "B", "A"], rows)
}

fn write_rows(
    temporary: &Path,
    width: u32,
    height: u32,
    channels: &[&str],
    rows: impl Iterator<Item = impl AsRef<[u8]>>,
) -> Result<(), Refusal> {
    let mut metadata = vec![
        // The colours are divided already.
        ("oiio:UnassociatedAlpha".to_owned(), Attribute::Int(1)),
    ];
    if channels.len() >= 3 {
        let space = Attribute::Text("sRGB".to_owned());
        metadata.push(("oiio:ColorSpace".to_owned(), space));
    }
    let header = Header {
        width,
        height,
        display_window: (width, height, 0, 0),
        tile: 0,
        compression: None,
        parts: vec![("", channels.iter().map(|name| (*name, None)).collect())],
        metadata: &metadata,
    };
    let mut output = Output::create(temporary, FileFormat::Png, &header)?;
    for row in rows {
        output.write(1, row.as_ref())?;
    }
    output.finish()
}

fn bytes_from(premultiplied: Vec4) -> [u8; 4] {
    let alpha = unit(premultiplied.w);
    // Colour without coverage (a glow) cannot be said in PNG.
    let scale = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
    let [r, g, b] = premultiplied
        .truncate()
        .to_array()
        .map(|c| byte(srgb_from_linear(unit(c * scale))));
    [r, g, b, byte(alpha)]
}

/// Clipped to 0..1; 0 for NaN.
fn unit(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}

fn byte(unit: f32) -> u8 {
    (unit * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::border::Format;
    use crate::image::test_files;

    #[test]
    fn bytes_come_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        let rgba = [
            Vec4::new(0.0, 0.214_041_14, 1.0, 1.0),
            Vec4::new(0.25, 0.0, 0.5, 0.5),
            Vec4::new(f32::NAN, f32::INFINITY, -3.0, 1.0),
            Vec4::new(1.0, 1.0, 1.0, 0.0),
            Vec4::new(1.0, 1.0, 1.0, f32::NAN),
            Vec4::ONE,
        ];
        write_png(&path, 3, 2, &rgba).expect("written");
        let mut input = test_files::open(&path);
        let info = input.info(0).expect("header");
        assert_eq!((info.width, info.height, info.channels), (3, 2, 4));
        assert_eq!(info.format, Format::Byte);
        assert_eq!(
            info.color_space.to_lowercase().replace("_rec709_scene", ""),
            "srgb"
        );
        let bytes = test_files::bytes(&mut input, 4);
        assert_eq!(bytes[..4], [0, 128, 255, 255]);
        assert_eq!(bytes[4..8], [188, 0, 255, 128]);
        assert_eq!(bytes[8..12], [0, 255, 0, 255]);
        assert_eq!(bytes[12..20], [0; 8]);
        assert_eq!(bytes[20..], [255; 4]);
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("readable").count(),
            1
        );
    }

    #[test]
    fn a_wrong_count_and_a_full_disk_are_errors() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.png");
        assert!(write_png(&path, 3, 2, &[Vec4::ONE; 5]).is_err());
        assert!(write_png(&path, 0, 0, &[]).is_err());
        let full = Path::new("/dev/full");
        if full.exists() {
            assert!(write(full, 2, 1, &[Vec4::ONE; 2]).is_err());
        }
    }
}
