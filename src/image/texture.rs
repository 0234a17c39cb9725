//! Textures: whole images resident in memory, looked up with bilinear filtering at full resolution, or over an area by
//! their levels.
//!
//! An 8-bit image keeps its bytes (a quarter of the floats' memory), which a
//! table of 256 entries decodes texel by texel, so that colours are linear before they are filtered. That, and images in
//! packages, is why lookups are our own and not those of OpenImageIO's texture system, which filters what is encoded
//! and reads files alone.

mod levels;
mod load;
mod order;
mod slope;
mod texels;

use std::sync::LazyLock;

use glam::{Mat3, Vec2, Vec4};
use half::slice::HalfFloatSliceExt;

use self::levels::{Level, Sheet};
use self::load::{How, expected_bytes, load_files, load_packed, tame};
pub use self::order::TexelOrder;
pub use self::texels::{FROM_BYTE, Fold, TexelKind, Texels};
use super::border::{Info, Pixels};
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
    order: TexelOrder,
    /// What a byte of colour means; alpha is always linear.
    color: &'static [f32; 256],
    /// Half the size, a quarter, ... down to one texel; none if lookups are not to cover areas.
    smaller: Vec<Level>,
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
    /// Reads it all, the tiles of a UDIM set in parallel, for lookups at its full size. A fault names the file.
    pub fn load(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
    ) -> Result<Self, Fault> {
        Self::load_as(source, wrap, color_space, false)
    }

    /// The same, with the file's levels of smaller size, and those that it lacks, for [lookups of
    /// areas](Self::filtered): a third more memory.
    pub fn load_levels(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
    ) -> Result<Self, Fault> {
        Self::load_as(source, wrap, color_space, true)
    }

    fn load_as(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
        levels: bool,
    ) -> Result<Self, Fault> {
        let how = How {
            color_space,
            levels,
        };
        let (udim, mut tiles) = match source {
            ImageSource::File(path) => load_files(path, &how)?,
            ImageSource::Packed { package, tiles } => load_packed(package, tiles, &how)?,
        };
        tiles.sort_by_key(|tile| tile.number);
        Ok(Self {
            tiles,
            udim,
            wrap,
            rec709_from_image: (color_space == ColorSpace::AcesCg).then_some(REC709_FROM_ACESCG),
        })
    }

    /// As [`load`](Self::load) or [`load_levels`](Self::load_levels), for lookups by texture coordinates: a Ptex file is
    /// refused, because coordinates tell none of its faces from another.
    pub fn load_by_coordinates(
        source: &ImageSource,
        wrap: [Wrap; 2],
        color_space: ColorSpace,
        levels: bool,
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
        Self::load_as(source, wrap, color_space, levels)
    }

    /// Bytes that its pixels will take, by what its files say about themselves, and as many more while it is read: some
    /// readers hold the whole file then. 0 for what cannot be read; of files of more than `most` bytes their size.
    pub fn expected_memory(source: &ImageSource, levels: bool, most: u64) -> [u64; 2] {
        let bytes = expected_bytes(source, most);
        let levels = if levels { bytes.div_ceil(3) } else { 0 };
        [bytes + levels, bytes]
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
                order: TexelOrder::rows(1),
                color: &LINEAR,
                smaller: Vec::new(),
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
        match self.place(st) {
            Some((tile, st, wrap)) => self.filter(&tile.sheet(0), st, wrap),
            None => Vec4::ZERO,
        }
    }

    /// The image at `st`, and where in it.
    fn place(&self, st: Vec2) -> Option<(&Tile, Vec2, [Wrap; 2])> {
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let st = Vec2::new(finite(st.x), finite(st.y));
        if self.udim {
            // A tile ends at its border; its neighbour may be far away on the surface.
            let (tile, st) = self.udim_tile(st)?;
            Some((tile, st, [Wrap::Clamp; 2]))
        } else {
            Some((&self.tiles[0], st, self.wrap))
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
                // It follows from the size.
                order: _,
                color,
                // Displacement, of which stores ask, is looked up at the full size.
                smaller: _,
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
        let bytes = |pixels: &Pixels| match pixels {
            Pixels::Byte(pixels) => size_of_val(pixels.as_slice()),
            Pixels::Half(pixels) => size_of_val(pixels.as_slice()),
            Pixels::Float(pixels) => size_of_val(pixels.as_slice()),
        };
        let levels = |tile: &Tile| {
            (tile.smaller.iter())
                .map(|l| bytes(&l.pixels))
                .sum::<usize>()
        };
        let all = self.tiles.iter();
        all.map(|tile| bytes(&tile.pixels) + levels(tile)).sum()
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

    fn filter(&self, sheet: &Sheet<'_>, st: Vec2, wrap: [Wrap; 2]) -> Vec4 {
        let [width, height] = sheet.size;
        let (x, fx) = wrap[0].neighbours(st.x, width);
        // Rows go down, t goes up; wrapping works on t.
        let (y, fy) = wrap[1].neighbours(st.y, height);
        let texel = |x: Option<u32>, y: Option<u32>| match (x, y) {
            (Some(x), Some(y)) => sheet.texel(x, height - 1 - y),
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
        self.sheet(0).texel(x, y)
    }
}

impl Sheet<'_> {
    #[inline]
    fn texel(&self, x: u32, y: u32) -> Vec4 {
        let channels = self.layout.channels();
        let first = (self.order.row(y) + self.order.column(x)) * channels;
        let mut v = [0.0; 4];
        match self.pixels {
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

#[cfg(test)]
#[path = "texture_tests.rs"]
mod tests;
