//! Textures: whole images resident in memory, looked up with bilinear filtering at full resolution.
//!
//! There are no mip maps: a path tracer takes many samples a pixel, and their average is the filter; without it
//! fine textures only need more samples. An 8-bit image keeps its bytes (a quarter of the floats' memory), which a
//! table of 256 entries decodes texel by texel, so that colours are linear before they are filtered.

mod slope;

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use glam::{Mat3, Vec2, Vec4};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::border::{self, Info, Input, Kind, Pixels, Refusal};
use super::{ColorSpace, ImageSource, Wrap, linear_from_srgb};
use crate::error::Fault;
use crate::store::Digest;

/// The largest image that is loaded, in bytes: 32768 × 32768 bytes of RGBA. A header that promises more is
/// damaged more often than meant, and must not make us ask the system for that memory.
const LIMIT: usize = 1 << 32;

/// The tile of UDIM that covers 0..1; the next in s is 1002, the next in t 1011.
const FIRST_UDIM: u32 = 1001;

/// An image, or the tiles of a UDIM set, in memory; colours come out in linear Rec.709.
#[derive(Debug)]
pub struct Texture {
    /// In the order of their numbers; at least one.
    tiles: Vec<Tile>,
    udim: bool,
    wrap: [Wrap; 2],
    /// From the image's primaries, if those are others.
    rec709_from_image: Option<Mat3>,
}

/// One image.
#[derive(Debug)]
struct Tile {
    /// Its UDIM number, or 0.
    number: u32,
    size: [u32; 2],
    layout: Layout,
    /// Interleaved, row 0 on top.
    pixels: Pixels,
    /// What a byte of colour means; alpha is always linear.
    color: &'static [f32; 256],
}

/// What the channels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    Grey,
    GreyAlpha,
    /// Two numbers that are no colour.
    Two,
    Rgb,
    Rgba,
}

impl Layout {
    fn of(info: &Info) -> Self {
        match info.channels {
            1 => Self::Grey,
            2 if info.alpha_channel == Some(1) => Self::GreyAlpha,
            2 => Self::Two,
            3 => Self::Rgb,
            // Renderings have depth and more behind their colours.
            4 if info.depth_channel == Some(3) => Self::Rgb,
            4 => Self::Rgba,
            _ if info.alpha_channel == Some(3) => Self::Rgba,
            _ => Self::Rgb,
        }
    }

    fn channels(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::GreyAlpha | Self::Two => 2,
            Self::Rgb => 3,
            Self::Rgba => 4,
        }
    }

    /// How many of the channels are colours, ahead of alpha.
    fn colors(self) -> usize {
        match self {
            Self::Grey | Self::GreyAlpha => 1,
            Self::Two => 2,
            Self::Rgb | Self::Rgba => 3,
        }
    }
}

impl Texture {
    /// Reads it all, the tiles of a UDIM set in parallel. A fault names the file.
    pub fn load(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
    ) -> Result<Self, Fault> {
        let (udim, mut tiles) = match source {
            ImageSource::File(path) => load_files(path, color_space)?,
            ImageSource::Packed { package, tiles } => load_packed(package, tiles, color_space)?,
        };
        tiles.sort_by_key(|tile| tile.number);
        Ok(Self {
            tiles,
            udim,
            wrap,
            rec709_from_image: (color_space == ColorSpace::AcesCg).then_some(REC709_FROM_ACESCG),
        })
    }

    /// As [`load`](Self::load), for lookups by texture coordinates: a Ptex file is refused, because coordinates tell
    /// none of its faces from another.
    pub fn load_by_coordinates(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
    ) -> Result<Self, Fault> {
        if source.is_ptex() {
            let message = "is a Ptex file: texture coordinates lead to none of its faces";
            let fault = match source {
                ImageSource::File(path) => Fault::new(message).in_file(path),
                ImageSource::Packed { package, .. } => {
                    Fault::new(format!("{source} {message}")).in_file(package)
                }
            };
            return Err(fault.advise(
                "look it up by a RelievoPtexTexture in place of the UsdUVTexture, or make an image of it",
            ));
        }
        Self::load(source, wrap, color_space)
    }

    /// The same value everywhere: stands in for an image that is missing.
    pub fn constant(value: Vec4) -> Self {
        let mut pixels = value.to_array().to_vec();
        pixels.iter_mut().for_each(|v| *v = tame(*v));
        Self {
            tiles: vec![Tile {
                number: 0,
                size: [1, 1],
                layout: Layout::Rgba,
                pixels: Pixels::Float(pixels),
                color: &LINEAR,
            }],
            udim: false,
            wrap: [Wrap::Clamp; 2],
            rec709_from_image: None,
        }
    }

    /// The value at `st`, bilinearly filtered; `t = 0` is the lower border of the image. A grey image is repeated in
    /// red, green and blue; an image without alpha has 1; a channel that a two-channel image lacks has 0. Outside of
    /// all UDIM tiles everything is 0. What is not a number is looked up as 0.
    pub fn eval(&self, st: Vec2) -> Vec4 {
        let st = Vec2::new(
            if st.x.is_finite() { st.x } else { 0.0 },
            if st.y.is_finite() { st.y } else { 0.0 },
        );
        if self.udim {
            match self.udim_tile(st) {
                // A tile ends at its border; its neighbour may be far away on the surface.
                Some((tile, st)) => self.filter(tile, st, [Wrap::Clamp; 2]),
                None => Vec4::ZERO,
            }
        } else {
            self.filter(&self.tiles[0], st, self.wrap)
        }
    }

    /// Width and height of the (first) image.
    pub fn size(&self) -> [u32; 2] {
        self.tiles[0].size
    }

    /// Width and height of the image at `st`; none outside of all UDIM tiles.
    pub fn size_at(&self, st: Vec2) -> Option<[u32; 2]> {
        if self.udim {
            self.udim_tile(st).map(|(tile, _)| tile.size)
        } else {
            Some(self.size())
        }
    }

    /// How many of the first channels of a lookup differ in some tile: 1 for grey, 2, or 3 for colours.
    pub fn colors(&self) -> usize {
        let colors = self.tiles.iter().map(|tile| tile.layout.colors()).max();
        match colors {
            // Where there is alpha too, two numbers are red and green.
            Some(2) if self.has_alpha() => 3,
            colors => colors.unwrap_or(1),
        }
    }

    /// Whether a tile has alpha, the last channel of a lookup.
    pub fn has_alpha(&self) -> bool {
        let mut layouts = self.tiles.iter().map(|tile| tile.layout);
        layouts.any(|layout| layout.channels() > layout.colors())
    }

    /// Bytes that a number has in the file: 1; 2 of halves; 4 of all others. The most of all tiles.
    pub fn depth(&self) -> usize {
        let depths = self.tiles.iter().map(|tile| match tile.pixels {
            Pixels::Byte(_) => 1,
            Pixels::Half(_) => 2,
            Pixels::Float(_) => 4,
        });
        depths.max().unwrap_or(1)
    }

    /// A texel of the (first) image, linear, row 0 on top; beyond the border: the nearest one.
    pub fn texel(&self, x: u32, y: u32) -> Vec4 {
        let tile = &self.tiles[0];
        let [width, height] = tile.size;
        self.to_rec709(tile.texel(x.min(width - 1), y.min(height - 1)))
    }

    /// Adds all that lookups follow from.
    pub(crate) fn add_to(&self, digest: &mut Digest) {
        let Self {
            tiles,
            udim,
            wrap,
            rec709_from_image,
        } = self;
        digest.text(&format!("image {udim} {wrap:?} {rec709_from_image:?}"));
        for tile in tiles {
            let Tile {
                number,
                size,
                layout,
                pixels,
                color,
            } = tile;
            digest.text(&format!("{number} {size:?} {layout:?}"));
            match pixels {
                Pixels::Byte(pixels) => {
                    digest.numbers(pixels);
                    digest.numbers(color.as_slice());
                }
                Pixels::Half(pixels) => digest.numbers::<u16>(pixels.reinterpret_cast()),
                Pixels::Float(pixels) => digest.numbers(pixels),
            }
        }
    }

    /// Bytes that the pixels take.
    pub fn memory(&self) -> usize {
        let bytes = |tile: &Tile| match &tile.pixels {
            Pixels::Byte(pixels) => size_of_val(pixels.as_slice()),
            Pixels::Half(pixels) => size_of_val(pixels.as_slice()),
            Pixels::Float(pixels) => size_of_val(pixels.as_slice()),
        };
        self.tiles.iter().map(bytes).sum()
    }

    /// The tile at `st`, and the place in it.
    fn udim_tile(&self, st: Vec2) -> Option<(&Tile, Vec2)> {
        let corner = st.floor();
        // The far border of a tile belongs to it, unless a tile begins there.
        let lower = |floor: f32, value: f32| (floor == value && floor > 0.0).then_some(floor - 1.0);
        let columns = [Some(corner.x), lower(corner.x, st.x)];
        let rows = [Some(corner.y), lower(corner.y, st.y)];
        for row in rows.into_iter().flatten() {
            for column in columns.into_iter().flatten() {
                if !(0.0..10.0).contains(&column) || !(0.0..100.0).contains(&row) {
                    continue;
                }
                let number = FIRST_UDIM + column as u32 + 10 * row as u32;
                if let Ok(i) = self.tiles.binary_search_by_key(&number, |tile| tile.number) {
                    return Some((&self.tiles[i], st - Vec2::new(column, row)));
                }
            }
        }
        None
    }

    fn filter(&self, tile: &Tile, st: Vec2, wrap: [Wrap; 2]) -> Vec4 {
        let [width, height] = tile.size;
        let (x, fx) = wrap[0].neighbours(st.x, width);
        // Rows go down, t goes up; wrapping works on t.
        let (y, fy) = wrap[1].neighbours(st.y, height);
        let texel = |x: Option<u32>, y: Option<u32>| match (x, y) {
            (Some(x), Some(y)) => tile.texel(x, height - 1 - y),
            _ => Vec4::ZERO,
        };
        let low = texel(x[0], y[0]).lerp(texel(x[1], y[0]), fx);
        let high = texel(x[0], y[1]).lerp(texel(x[1], y[1]), fx);
        self.to_rec709(low.lerp(high, fy))
    }

    /// Linear, so that it may follow the filter.
    fn to_rec709(&self, value: Vec4) -> Vec4 {
        match self.rec709_from_image {
            Some(matrix) => (matrix * value.truncate()).extend(value.w),
            None => value,
        }
    }
}

impl Wrap {
    /// The texels left and right of coordinate `s` in a row of `size`, and the second one's weight. `None`: black.
    #[inline]
    fn neighbours(self, s: f32, size: u32) -> ([Option<u32>; 2], f32) {
        // Bring `s` near 0..1, where floats are fine enough.
        let s = match self {
            Self::Black => s.clamp(-1.0, 2.0),
            Self::Clamp => s.clamp(0.0, 1.0),
            Self::Repeat | Self::Mirror if (0.0..1.0).contains(&s) => s,
            Self::Repeat => s - s.floor(),
            Self::Mirror => s - 2.0 * (0.5 * s).floor(),
        };
        // Texel i covers i..i + 1 and has its value in the middle.
        let x = s * size as f32 - 0.5;
        // Nearly always both are within, and cutting off is quicker than the floor.
        let cut = x as u32;
        if x >= 0.0 && cut < size - 1 {
            return ([Some(cut), Some(cut + 1)], x - cut as f32);
        }
        let left = x.floor();
        let (size, first) = (i64::from(size), left as i64);
        let place = |i: i64| {
            let i = match self {
                Self::Black => (0..size).contains(&i).then_some(i)?,
                Self::Clamp => i.clamp(0, size - 1),
                Self::Repeat => i.rem_euclid(size),
                Self::Mirror => {
                    let i = i.rem_euclid(2 * size);
                    i.min(2 * size - 1 - i)
                }
            };
            // In 0..size by now.
            u32::try_from(i).ok()
        };
        ([place(first), place(first + 1)], x - left)
    }
}

impl Tile {
    fn texel(&self, x: u32, y: u32) -> Vec4 {
        let channels = self.layout.channels();
        let first = (y as usize * self.size[0] as usize + x as usize) * channels;
        let mut v = [0.0; 4];
        match &self.pixels {
            Pixels::Byte(pixels) => {
                let colors = self.layout.colors();
                for (c, byte) in pixels[first..first + channels].iter().enumerate() {
                    let table = if c < colors { self.color } else { &LINEAR };
                    v[c] = table[usize::from(*byte)];
                }
            }
            Pixels::Half(pixels) => {
                for (v, half) in v.iter_mut().zip(&pixels[first..first + channels]) {
                    *v = half.to_f32();
                }
            }
            Pixels::Float(pixels) => {
                v[..channels].copy_from_slice(&pixels[first..first + channels]);
            }
        }
        match self.layout {
            Layout::Grey => Vec4::new(v[0], v[0], v[0], 1.0),
            Layout::GreyAlpha => Vec4::new(v[0], v[0], v[0], v[1]),
            Layout::Two => Vec4::new(v[0], v[1], 0.0, 1.0),
            Layout::Rgb => Vec4::new(v[0], v[1], v[2], 1.0),
            Layout::Rgba => Vec4::from_array(v),
        }
    }
}

/// Linear Rec.709 (white D65) from ACEScg (AP1, white near D60), adapted by Bradford's method.
const REC709_FROM_ACESCG: Mat3 = Mat3::from_cols_array(&[
    1.705_051,
    -0.130_256_4,
    -0.024_003_4, // red
    -0.621_792_1,
    1.140_804_7,
    -0.128_969, // green
    -0.083_258_9,
    -0.010_548_3,
    1.152_972_3, // blue
]);

static LINEAR: LazyTable = LazyTable(LazyLock::new(|| std::array::from_fn(|i| i as f32 / 255.0)));
static SRGB: LazyTable = LazyTable(LazyLock::new(|| {
    std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0))
}));

/// The value of each byte, computed at its first use.
struct LazyTable(LazyLock<[f32; 256]>);

impl std::ops::Deref for LazyTable {
    type Target = [f32; 256];
    fn deref(&self) -> &[f32; 256] {
        &self.0
    }
}

// ---- Loading ----

fn load_files(path: &Path, color_space: ColorSpace) -> Result<(bool, Vec<Tile>), Fault> {
    let Some(files) = udim_files(path)? else {
        return Ok((false, vec![load_file(0, path, color_space)?]));
    };
    let tiles: Result<_, _> = files
        .par_iter()
        .map(|(number, file)| load_file(*number, file, color_space))
        .collect();
    Ok((true, tiles?))
}

fn load_packed(
    package: &Path,
    tiles: &[(u32, String, Arc<[u8]>)],
    color_space: ColorSpace,
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
            load_image(*number, OsStr::new(name), Some(bytes), color_space)
                .map_err(|refusal| fault(&place, &refusal))
        })
        .collect();
    Ok((udim, tiles?))
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

fn load_file(number: u32, path: &Path, color_space: ColorSpace) -> Result<Tile, Fault> {
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
    load_image(number, path.as_os_str(), None, color_space).map_err(|refusal| fault(path, &refusal))
}

fn load_image(
    number: u32,
    name: &OsStr,
    bytes: Option<&Arc<[u8]>>,
    color_space: ColorSpace,
) -> Result<Tile, Refusal> {
    let mut input = Input::open(name, bytes.cloned())?;
    let info = input.info(0)?;
    let layout = Layout::of(&info);
    let mut pixels = input.read(0, layout.channels() as u32, info.format, LIMIT)?;
    let srgb = is_srgb(color_space, &info, layout);
    match &mut pixels {
        // The table decodes.
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
    Ok(Tile {
        number,
        size: [info.width, info.height],
        layout,
        pixels,
        color: if srgb { &SRGB } else { &LINEAR },
    })
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
fn tame(value: f32) -> f32 {
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
        Kind::CannotWrite | Kind::Absent | Kind::Misuse => (
            format!("the image cannot be read: {reason}"),
            "Convert it to OpenEXR or PNG.".into(),
        ),
    };
    Fault::new(message).in_file(path).advise(help)
}

#[cfg(test)]
#[path = "texture_tests.rs"]
mod tests;
