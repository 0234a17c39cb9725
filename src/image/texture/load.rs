//! Textures from files and packages: which files, what their numbers mean, and what is wrong with them.

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use half::f16;
use rayon::prelude::*;

use super::levels::{self, Level};
use super::{FIRST_UDIM, LIMIT, LINEAR, Layout, SRGB, TexelOrder, Tile};
use crate::error::Fault;
use crate::image::border::{self, Info, Input, Kind, Pixels, Refusal};
use crate::image::{ColorSpace, ImageSource, linear_from_srgb};

/// How a texture is read.
pub(super) struct How {
    pub(super) color_space: ColorSpace,
    /// With its levels, down to one texel.
    pub(super) levels: bool,
}

pub(super) fn load_files(path: &Path, how: &How) -> Result<(bool, Vec<Tile>), Fault> {
    let Some(files) = udim_files(path)? else {
        return Ok((false, vec![load_file(0, path, how)?]));
    };
    let tiles: Result<_, _> = files
        .par_iter()
        .map(|(number, file)| load_file(*number, file, how))
        .collect();
    Ok((true, tiles?))
}

pub(super) fn load_packed(
    package: &Path,
    tiles: &[(u32, String, Arc<[u8]>)],
    how: &How,
) -> Result<(bool, Vec<Tile>), Fault> {
    if tiles.is_empty() {
        return Err(Fault::new("the package does not hold the image")
            .in_file(package)
            .advise("Pack the scene again, with its textures."));
    }
    let udim = tiles.iter().any(|(number, ..)| *number != 0);
    let tiles: Result<_, _> = tiles
        .par_iter()
        .map(|(number, name, bytes)| {
            // The notation of USD for a file in a package.
            let place = PathBuf::from(format!("{}[{name}]", package.display()));
            load_image(*number, OsStr::new(name), Some(bytes), how)
                .map_err(|refusal| fault(&place, &refusal))
        })
        .collect();
    Ok((udim, tiles?))
}

/// Bytes of all tiles at full size, by their headers; 0 for what cannot be read. A file of more than `most` bytes is not
/// opened, since some readers read it whole then: its size counts.
pub(super) fn expected_bytes(source: &ImageSource, most: u64) -> u64 {
    let of = |name: &OsStr, bytes: Option<&Arc<[u8]>>| -> u64 {
        let info = Input::open(name, bytes.cloned()).and_then(|mut input| input.info(0));
        info.map_or(0, |info| {
            let channels = Layout::of(&info).channels() as u64;
            let bytes = match info.format {
                border::Format::Byte => 1,
                border::Format::Half => 2,
                border::Format::Float => 4,
            };
            u64::from(info.width) * u64::from(info.height) * channels * bytes
        })
    };
    match source {
        ImageSource::File(path) => {
            let of_file = |path: &Path| match path.metadata() {
                Ok(metadata) if !metadata.is_file() => 0,
                Ok(metadata) if metadata.len() > most => metadata.len(),
                Ok(_) => of(path.as_os_str(), None),
                Err(_) => 0,
            };
            match udim_files(path) {
                Ok(Some(files)) => files.iter().map(|(_, file)| of_file(file)).sum(),
                Ok(None) => of_file(path),
                Err(_) => 0,
            }
        }
        ImageSource::Packed { tiles, .. } => (tiles.iter())
            .map(|(_, name, bytes)| of(OsStr::new(name), Some(bytes)))
            .sum(),
    }
}

/// The number and the file of each tile, if `path` has a `<UDIM>` in its name.
fn udim_files(path: &Path) -> Result<Option<Vec<(u32, PathBuf)>>, Fault> {
    const TOKEN: &str = "<UDIM>";
    let Some((before, after)) = path
        .file_name()
        .and_then(OsStr::to_str)
        .and_then(|name| name.split_once(TOKEN))
    else {
        return Ok(None);
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let entries = fs::read_dir(folder).map_err(|e| cannot_find(path, &e))?;
    let mut files = Vec::new();
    for entry in entries {
        let entry = entry.map_err(|e| cannot_find(path, &e))?;
        let name: OsString = entry.file_name();
        let number = name
            .to_str()
            .and_then(|name| name.strip_prefix(before))
            .and_then(|name| name.strip_suffix(after))
            .filter(|digits| digits.len() == 4)
            .and_then(|digits| digits.parse::<u32>().ok())
            .filter(|number| (FIRST_UDIM..2000).contains(number));
        if let Some(number) = number {
            files.push((number, folder.join(name)));
        }
    }
    if files.is_empty() {
        return Err(Fault::new("no file of this UDIM set exists")
            .in_file(path)
            .advise(format!(
                "The first one would be `{}`.",
                folder
                    .join(format!("{before}{FIRST_UDIM}{after}"))
                    .display()
            )));
    }
    files.sort();
    Ok(Some(files))
}

fn load_file(number: u32, path: &Path, how: &How) -> Result<Tile, Fault> {
    // The system's reason is clearer than any reader's.
    match fs::File::open(path).and_then(|file| file.metadata()) {
        Err(e) => return Err(cannot_find(path, &e)),
        Ok(metadata) if metadata.is_dir() => {
            return Err(Fault::new("this is a folder, not an image")
                .in_file(path)
                .advise("Name an image file."));
        }
        Ok(_) => {}
    }
    load_image(number, path.as_os_str(), None, how).map_err(|refusal| fault(path, &refusal))
}

fn load_image(
    number: u32,
    name: &OsStr,
    bytes: Option<&Arc<[u8]>>,
    how: &How,
) -> Result<Tile, Refusal> {
    let mut input = Input::open(name, bytes.cloned())?;
    let info = input.info(0)?;
    let layout = Layout::of(&info);
    let srgb = is_srgb(how.color_space, &info, layout);
    let read = |input: &mut Input, level: u32| {
        let channels = layout.channels() as u32;
        let mut pixels = input.read([0, level], channels, info.format, LIMIT)?;
        decode_all(&mut pixels, layout, srgb);
        Ok::<_, Refusal>(pixels)
    };
    let mut tile = Tile {
        number,
        size: [info.width, info.height],
        layout,
        pixels: read(&mut input, 0)?,
        order: TexelOrder::rows(info.width),
        color: if srgb { &SRGB } else { &LINEAR },
        smaller: Vec::new(),
    };
    if how.levels {
        for level in 1.. {
            let Some(size) = input.level_size(0, level)? else {
                break;
            };
            if !levels::follows(tile.sheet(tile.smaller.len()).size, size) {
                break;
            }
            tile.smaller.push(Level {
                size,
                pixels: read(&mut input, level)?,
            });
        }
        tile.complete();
    }
    let (size, channels) = (tile.size, layout.channels());
    tile.order = match &mut tile.pixels {
        Pixels::Byte(pixels) => TexelOrder::arrange(size, channels, pixels),
        Pixels::Half(pixels) => TexelOrder::arrange(size, channels, pixels),
        Pixels::Float(pixels) => TexelOrder::arrange(size, channels, pixels),
    };
    Ok(tile)
}

/// Makes numbers of what is none, and linear ones of encoded ones. Bytes stay as they are: a table decodes them.
fn decode_all(pixels: &mut Pixels, layout: Layout, srgb: bool) {
    match pixels {
        Pixels::Byte(_) => {}
        Pixels::Half(pixels) => pixels
            .par_chunks_exact_mut(layout.channels())
            .for_each(|texel| {
                for (c, v) in texel.iter_mut().enumerate() {
                    let decoded = decode(v.to_f32(), srgb && c < layout.colors());
                    *v = f16::from_f32(decoded);
                }
            }),
        Pixels::Float(pixels) => pixels
            .par_chunks_exact_mut(layout.channels())
            .for_each(|texel| {
                for (c, v) in texel.iter_mut().enumerate() {
                    *v = decode(*v, srgb && c < layout.colors());
                }
            }),
    }
}

/// UsdUVTexture's rule for `auto`; but an image that says that it is linear is believed.
fn is_srgb(color_space: ColorSpace, info: &Info, layout: Layout) -> bool {
    match color_space {
        ColorSpace::Srgb => true,
        ColorSpace::Raw | ColorSpace::AcesCg => false,
        ColorSpace::Auto => {
            let says = info.color_space.to_lowercase();
            info.format == border::Format::Byte
                && layout.colors() == 3
                && !says.starts_with("lin")
                && says != "scene_linear"
        }
    }
}

fn decode(value: f32, srgb: bool) -> f32 {
    let value = tame(value);
    if srgb { linear_from_srgb(value) } else { value }
}

/// Makes a number of anything: one NaN or infinity would spread over all pixels that its texel lights. 65504 is what
/// a sun too bright for half floats was before it became infinite, as far as the file can tell.
pub(super) fn tame(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else if value.is_infinite() {
        f16::MAX.to_f32().copysign(value)
    } else {
        value
    }
}

// ---- Faults ----

fn cannot_find(path: &Path, error: &std::io::Error) -> Fault {
    Fault::new(format!("the image cannot be opened: {error}"))
        .in_file(path)
        .advise(
            "Check the path (a relative one starts at the file that names it) and that you may read it; \
             or let `--missing-textures` put a colour in its place.",
        )
}

fn fault(path: &Path, refusal: &Refusal) -> Fault {
    let reason = &refusal.message;
    let (message, help): (_, Cow<'_, str>) = match refusal.kind {
        Kind::CannotOpen => (
            format!("the image cannot be opened: {reason}"),
            format!(
                "OpenImageIO {} reads OpenEXR, PNG, JPEG, TIFF, Radiance HDR and more: check that the file is \
                 whole, and convert it if it has another format",
                border::version()
            )
            .into(),
        ),
        Kind::BadImage => (
            format!("the image cannot be used: {reason}"),
            "Textures are flat images; flatten or convert it.".into(),
        ),
        Kind::TooLarge => (
            format!("the image is too large: {reason}"),
            "Scale it down, or cut it into UDIM tiles.".into(),
        ),
        Kind::CannotRead => (
            format!("the image is cut off or damaged: {reason}"),
            "Copy or export it again.".into(),
        ),
        Kind::NoMemory => {
            return Fault::for_want_of_memory("the image cannot be read: out of memory")
                .in_file(path);
        }
        Kind::CannotWrite | Kind::Absent | Kind::Misuse => (
            format!("the image cannot be read: {reason}"),
            "Convert it to OpenEXR or PNG.".into(),
        ),
    };
    Fault::new(message).in_file(path).advise(help)
}
