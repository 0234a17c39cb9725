//! What an OpenEXR file holds, as plain data.

/// A picture of one or more parts that share their size and metadata.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The data window's width: what is stored.
    pub width: u32,
    /// The data window's height.
    pub height: u32,
    /// The display window, which starts at 0, 0: its width and height, then x and y of the data window in it.
    pub display_window: (u32, u32, i32, i32),
    /// The parts; names must differ if there are several.
    pub parts: Vec<Part>,
    /// What every part says about itself. OpenImageIO's names for the standard attributes: `worldtocamera`
    /// becomes `worldToCamera`, `worldtoNDC` becomes `worldToNDC`.
    pub metadata: Vec<(String, Attribute)>,
    /// The edge of the square tiles; `None`: scanlines.
    pub tile: Option<u32>,
    /// How the pixels are packed.
    pub compression: Compression,
}

/// One part (layer, "subimage") of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its name; may be empty if it is the only one.
    pub name: String,
    /// What a pixel consists of.
    pub channels: Vec<Channel>,
    /// Pixel by pixel, all channels of a pixel together, row 0 on top. A [`ChannelFormat::Uint`] is stored by
    /// `f32::from_bits`.
    pub pixels: Vec<f32>,
}

/// One number of every pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its name in the file: `R`, `Z`, `albedo.R`.
    pub name: String,
    /// Its precision in the file.
    pub format: ChannelFormat,
}

/// How a channel is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelFormat {
    /// 16-bit float, three digits; finite numbers beyond its range become ±65504.
    Half,
    /// 32-bit float.
    Float,
    /// 32-bit whole number: an id.
    Uint,
}

/// The value of a metadata attribute.
#[derive(Debug, Clone, PartialEq)]
pub enum Attribute {
    /// A whole number.
    Int(i32),
    /// A number.
    Float(f32),
    /// Text; ends at its first zero byte, if it has one.
    Text(String),
    /// 4 × 4, row by row, for row vectors.
    Matrix([f32; 16]),
}

/// OpenEXR's compressions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Largest and quickest.
    None,
    /// Runs of equal bytes.
    Rle,
    /// Deflate, each scanline on its own.
    Zips,
    /// Deflate, 16 scanlines at once. Lossless; what compositors expect.
    #[default]
    Zip,
    /// Wavelets. Lossless; best on grain.
    Piz,
    /// Lossy: 32-bit floats lose 8 bits.
    Pxr24,
    /// Lossy, of fixed size.
    B44,
    /// B44 that packs flat areas better.
    B44a,
    /// Lossy, like JPEG, 32 scanlines at once.
    Dwaa,
    /// Lossy, like JPEG, 256 scanlines at once.
    Dwab,
}

impl Compression {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::None,
        Self::Rle,
        Self::Zips,
        Self::Zip,
        Self::Piz,
        Self::Pxr24,
        Self::B44,
        Self::B44a,
        Self::Dwaa,
        Self::Dwab,
    ];

    /// Its name, as OpenImageIO and users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Rle => "rle",
            Self::Zips => "zips",
            Self::Zip => "zip",
            Self::Piz => "piz",
            Self::Pxr24 => "pxr24",
            Self::B44 => "b44",
            Self::B44a => "b44a",
            Self::Dwaa => "dwaa",
            Self::Dwab => "dwab",
        }
    }

    /// The one with that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}
