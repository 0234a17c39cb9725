//! Images in and out, through OpenImageIO. Knows no mesh and no scene.
//!
//! [`Texture`] reads, [`write_exr`] and [`write_png`] write; `border` alone talks to the library.
//! [`PtexTexture`] reads Ptex files, which are looked up by face.

mod border;
mod chunks;
mod exr;
mod picture;
mod png;
mod ptex;
#[cfg(test)]
mod ptex_tests;
mod source;
mod temporary;
#[cfg(test)]
mod test_files;
mod texture;

pub use border::version;
pub use exr::write_exr;
pub use picture::{Attribute, Channel, ChannelFormat, Compression, Part, Picture};
pub use png::{write_png, write_png_bytes};
pub use ptex::{PtexFilter, PtexHeights, PtexOptions, PtexTexture};
pub use source::{ColorSpace, ImageSource, Wrap};
pub use temporary::{check_destination, write_whole};
pub use texture::{FROM_BYTE, Fold, TexelKind, TexelOrder, Texels, Texture};

/// The sRGB curve (IEC 61966-2-1): encoded to linear light.
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// Its inverse: linear light to encoded.
pub(crate) fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}
