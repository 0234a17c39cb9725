//! What to read, and how its numbers are meant.

use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use std::sync::Arc;

/// Where an image is.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageSource {
    /// A file; `<UDIM>` in its name stands for the tile's number.
    File(PathBuf),
    /// Inside a package (.usdz), by the name in it; `<UDIM>` is resolved to one entry a tile.
    Packed {
        /// The package.
        package: PathBuf,
        /// (UDIM tile or 0, name in the package, the file's bytes).
        tiles: Vec<(u32, String, Arc<[u8]>)>,
    },
}

impl ImageSource {
    /// Whether it begins as Ptex files do, whatever its name is. False if it cannot be read.
    pub fn is_ptex(&self) -> bool {
        let mut start = [0; 4];
        let read = match self {
            Self::File(path) => File::open(path).and_then(|mut file| file.read_exact(&mut start)),
            Self::Packed { tiles, .. } => {
                let mut bytes = tiles.first().map_or(&[][..], |(_, _, bytes)| bytes);
                bytes.read_exact(&mut start)
            }
        };
        read.is_ok() && start == *b"Ptex"
    }
}

impl std::fmt::Display for ImageSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Packed { package, tiles } => {
                let name = tiles.first().map_or("", |(_, name, _)| name);
                write!(f, "{}[{name}]", package.display())
            }
        }
    }
}

/// What lies beyond the border of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Black, and transparent.
    Black,
    /// The border's texels.
    Clamp,
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
}

/// How the numbers of a texture are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorSpace {
    /// As they are.
    Raw,
    /// Encoded by the sRGB curve (alpha never is).
    Srgb,
    /// sRGB for 8-bit images of three or four channels, else raw (UsdUVTexture's rule).
    #[default]
    Auto,
    /// Linear with ACEScg (AP1) primaries.
    AcesCg,
}
