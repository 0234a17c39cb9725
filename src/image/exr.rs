//! OpenEXR files: several parts, each channel in its own precision.

use std::path::Path;

use half::f16;

use super::border::{FileFormat, Header, Kind, Output, Refusal};
use super::chunks::are_all_there;
use super::picture::{Channel, ChannelFormat, Part, Picture};
use super::temporary::{failed, write_whole};
use crate::{Error, Result};

/// How many rows are packed at once: a multiple of every compression's block (256 for dwab), and few enough that
/// the packed copy of a 4K picture with 30 channels stays near 100 MB.
const BAND: u32 = 256;

/// Writes `picture` to `path`, which appears whole or not at all.
pub fn write_exr(path: &Path, picture: &Picture) -> Result<()> {
    check(path, picture)?;
    write_whole(path, |temporary| {
        write(temporary, picture).map_err(|refusal| refused(path, &refusal))?;
        match are_all_there(temporary) {
            Ok(true) => Ok(()),
            Ok(false) => Err(no_memory(path)),
            Err(e) => Err(failed(
                path,
                &format!("it cannot be read again: {e}"),
                "See that its disk is whole and can be read.",
            )),
        }
    })
}

/// For want of memory.
fn no_memory(path: &Path) -> Error {
    Error::Memory {
        message: format!("cannot write {}: out of memory", path.display()),
        help: Some("let the program have more memory".to_owned()),
    }
}

/// What a library said when it could not write, as an error about `path`.
pub(super) fn refused(path: &Path, refusal: &Refusal) -> Error {
    if refusal.kind == Kind::NoMemory {
        return no_memory(path);
    }
    failed(
        path,
        &refusal.message,
        "Check that the disk has space left and that you may write there.",
    )
}

fn write(temporary: &Path, picture: &Picture) -> Result<(), Refusal> {
    let header = Header {
        width: picture.width,
        height: picture.height,
        display_window: picture.display_window,
        tile: picture.tile.unwrap_or(0),
        compression: Some(picture.compression.name()),
        parts: picture
            .parts
            .iter()
            .map(|part| {
                let channels = part.channels.iter();
                (
                    part.name.as_str(),
                    channels
                        .map(|c| (c.name.as_str(), Some(c.format)))
                        .collect(),
                )
            })
            .collect(),
        metadata: &picture.metadata,
    };
    // Bands end between tiles.
    let band = match picture.tile {
        Some(tile) => tile.saturating_mul((BAND / tile).max(1)),
        None => BAND,
    };
    // All that is needed is there before there is a file.
    let most = picture
        .parts
        .iter()
        .map(|part| pixel_bytes(&part.channels))
        .max();
    let rows = band.min(picture.height) as usize;
    let mut packed = Vec::with_capacity(rows * picture.width as usize * most.unwrap_or(0));
    let mut output = Output::create(temporary, FileFormat::OpenExr, &header)?;
    for part in &picture.parts {
        let row = picture.width as usize * part.channels.len();
        let mut y = 0;
        while y < picture.height {
            let rows = band.min(picture.height - y);
            packed.clear();
            pack(
                &part.channels,
                &part.pixels[y as usize * row..(y + rows) as usize * row],
                &mut packed,
            );
            output.write(rows, &packed)?;
            y += rows;
        }
    }
    output.finish()
}

/// Bytes of a packed pixel.
fn pixel_bytes(channels: &[Channel]) -> usize {
    let bytes = |channel: &Channel| match channel.format {
        ChannelFormat::Half => 2,
        ChannelFormat::Float | ChannelFormat::Uint => 4,
    };
    channels.iter().map(bytes).sum()
}

/// Appends pixels, each channel in its format.
fn pack(channels: &[Channel], pixels: &[f32], packed: &mut Vec<u8>) {
    for pixel in pixels.chunks_exact(channels.len()) {
        for (channel, value) in channels.iter().zip(pixel) {
            match channel.format {
                ChannelFormat::Half => {
                    packed.extend_from_slice(&half_from(*value).to_ne_bytes());
                }
                ChannelFormat::Float => packed.extend_from_slice(&value.to_ne_bytes()),
                ChannelFormat::Uint => packed.extend_from_slice(&value.to_bits().to_ne_bytes()),
            }
        }
    }
}

/// Finite numbers stay finite: an infinity would spread through every filter that the picture meets.
fn half_from(value: f32) -> f16 {
    if value.is_finite() {
        f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
    } else {
        f16::from_f32(value)
    }
}

/// Refuses what no file can hold.
fn check(path: &Path, picture: &Picture) -> Result<()> {
    let wrong = |reason: String| {
        Err(Error::failed(format!(
            "cannot write {}: {reason}",
            path.display()
        )))
    };
    let (full_width, full_height, ..) = picture.display_window;
    let sizes = [picture.width, picture.height, full_width, full_height];
    if sizes.iter().any(|s| *s == 0 || *s > i32::MAX as u32) {
        return wrong(format!(
            "{} × {} pixels in a window of {full_width} × {full_height}",
            picture.width, picture.height
        ));
    }
    if picture.tile.is_some_and(|tile| tile == 0 || tile > 1 << 16) {
        return wrong("tiles have at least 1 and at most 65536 pixels a side".into());
    }
    if picture.parts.is_empty() {
        return wrong("it would have no part".into());
    }
    for (i, part) in picture.parts.iter().enumerate() {
        let Part {
            name,
            channels,
            pixels,
        } = part;
        if picture.parts.len() > 1 && name.is_empty() {
            return wrong(format!("part {i} has no name"));
        }
        if picture.parts[..i].iter().any(|other| other.name == *name) {
            return wrong(format!("two parts have the name `{name}`"));
        }
        if channels.is_empty() {
            return wrong(format!("part `{name}` has no channel"));
        }
        for (c, channel) in channels.iter().enumerate() {
            let channel = &channel.name;
            if channel.is_empty() || channels[..c].iter().any(|other| other.name == *channel) {
                return wrong(format!(
                    "part `{name}` has two channels `{channel}`, or one without a name"
                ));
            }
        }
        let expected = (picture.width as usize)
            .checked_mul(picture.height as usize)
            .and_then(|n| n.checked_mul(channels.len()));
        if expected != Some(pixels.len()) {
            return wrong(format!(
                "part `{name}` has {} numbers for {} × {} pixels of {} channels",
                pixels.len(),
                picture.width,
                picture.height,
                channels.len()
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::image::test_files;
    use crate::image::{Attribute, Compression};

    /// 5 × 3 pixels at 2, 1 in a window of 10 × 8: colour in half, depth in float; and a part of ids.
    fn picture() -> Picture {
        use ChannelFormat::{Float, Half, Uint};
        let beauty = (0..15).flat_map(|i| {
            let i = i as f32;
            [i / 8.0, 1.0, -0.5, 0.25, 1000.0 + i / 1024.0]
        });
        let ids: Vec<_> = (0..15_u32).map(|i| f32::from_bits(u32::MAX - i)).collect();
        let beauty: Vec<_> = beauty.collect();
        let mut first = test_files::part("beauty", "RGBAZ", Half, &beauty);
        first.channels[4].format = Float;
        let first = test_files::picture(5, first);
        Picture {
            display_window: (10, 8, 2, 1),
            parts: [first.parts, vec![test_files::part("id", "I", Uint, &ids)]].concat(),
            metadata: vec![
                ("samplesPerPixel".into(), Attribute::Int(64)),
                ("renderTimeSeconds".into(), Attribute::Float(1.5)),
                (
                    "cryptomatte/0123abc/name".into(),
                    Attribute::Text("crypto".into()),
                ),
                (
                    "worldtocamera".into(),
                    Attribute::Matrix(std::array::from_fn(|i| i as f32)),
                ),
            ],
            compression: Compression::Zips,
            ..first
        }
    }

    #[test]
    fn everything_comes_back() {
        let folder = tempfile::tempdir().expect("a folder");
        for tile in [None, Some(2), Some(64)] {
            for compression in [Compression::None, Compression::Zips, Compression::Zip] {
                let path = folder.path().join("a.exr");
                let picture = Picture {
                    tile,
                    compression,
                    ..picture()
                };
                write_exr(&path, &picture).expect("written");
                let mut input = test_files::open(&path);
                let info = input.info(0).expect("header");
                assert_eq!((info.width, info.height), (5, 3));
                assert_eq!((info.origin, info.full_size), ([2, 1], [10, 8]));
                assert_eq!(info.full_origin, [0, 0]);
                assert_eq!((info.alpha_channel, info.depth_channel), (Some(3), Some(4)));

                let part = &picture.parts[0];
                for (i, channel) in part.channels.iter().enumerate() {
                    let (name, format) = input.channel(0, i as u32).expect("a channel");
                    assert_eq!((name, format), (channel.name.clone(), Some(channel.format)));
                }
                assert_eq!(test_files::floats(&mut input, 5), part.pixels);
                let ids = input.read_uint(1, 1).expect("read");
                assert_eq!((ids[0], ids[14]), (u32::MAX, u32::MAX - 14));

                for part in 0..2 {
                    let mut text = |name| input.attribute(part, name).expect("an attribute");
                    assert_eq!(text("samplesPerPixel"), "64");
                    assert_eq!(text("renderTimeSeconds"), "1.5");
                    assert_eq!(text("cryptomatte/0123abc/name"), "crypto");
                    assert_eq!(text("compression"), compression.name());
                    assert!(text("worldtocamera").ends_with("14, 15"));
                    let name = text("oiio:subimagename");
                    assert_eq!(name, ["beauty", "id"][part as usize]);
                    // No time of day: the same picture, the same bytes.
                    assert!(input.attribute(part, "DateTime").is_err());
                }
                assert!(input.info(2).is_err());
            }
        }
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 1);
    }

    #[test]
    fn camera_matrices_have_the_standard_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let mut picture = picture();
        picture.metadata.push((
            "worldtoNDC".into(),
            Attribute::Matrix(std::array::from_fn(|i| i as f32)),
        ));
        write_exr(&path, &picture).expect("written");
        let bytes = fs::read(path).expect("readable");
        for name in [&b"worldToCamera\0m44f\0"[..], b"worldToNDC\0m44f\0"] {
            assert!(bytes.windows(name.len()).any(|window| window == name));
        }
    }

    #[test]
    fn several_bands_make_one_picture() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        let (width, height) = (3, 2 * BAND + 5);
        for tile in [None, Some(96)] {
            for compression in Compression::ALL {
                let pixels: Vec<f32> = (0..width * height).map(|i| (i / 64) as f32).collect();
                let part = test_files::part("", "Z", ChannelFormat::Float, &pixels);
                let picture = Picture {
                    tile,
                    compression,
                    ..test_files::picture(width, part)
                };
                write_exr(&path, &picture).expect("written");
                let mut input = test_files::open(&path);
                let read = test_files::floats(&mut input, 1);
                assert_eq!(read, pixels, "{compression:?}");
            }
        }
    }

    #[test]
    fn halves_stay_finite_and_keep_what_is_not() {
        assert_eq!(half_from(1e9), f16::MAX);
        assert_eq!(half_from(-1e9), f16::MIN);
        assert_eq!(half_from(f32::INFINITY), f16::INFINITY);
        assert!(half_from(f32::NAN).is_nan());
    }

    #[test]
    fn a_missing_folder_is_told_before_anything_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = write_exr(&folder.path().join("none/a.exr"), &picture()).expect_err("fails");
        assert_eq!(error.exit_code(), 1);
        let Error::Failed { message, help } = error else {
            panic!("another error");
        };
        assert!(message.contains("none"), "{message}");
        assert!(help.expect("help").contains("folder"));
        let error = write_exr(folder.path(), &picture()).expect_err("fails");
        assert!(error.to_string().contains("folder"));
    }

    #[test]
    fn a_full_disk_is_an_error() {
        // Linux's device that is always full; the border itself, without the temporary name.
        let full = Path::new("/dev/full");
        if !full.exists() {
            return;
        }
        let refusal = write(full, &picture()).expect_err("the disk is full");
        assert!(refusal.message.contains("space"), "{}", refusal.message);
    }

    #[test]
    fn impossible_pictures_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let changes: [fn(&mut Picture); 6] = [
            |p| p.width = 6,
            |p| p.height = 0,
            |p| p.parts.clear(),
            |p| p.parts[1].name = "beauty".into(),
            |p| p.parts[0].channels[1].name = "R".into(),
            |p| p.tile = Some(0),
        ];
        for change in changes {
            let mut picture = picture();
            change(&mut picture);
            assert!(write_exr(&folder.path().join("a.exr"), &picture).is_err());
        }
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 0);
    }
}
