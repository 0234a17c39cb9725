//! Ptex files from images, images from Ptex files, and Ptex files in other sizes and types.
//!
//! Numbers keep their meaning on the way, and a kind of file says what that is: bytes with three colours and more are
//! encoded by the sRGB curve, everything else is linear ([`ColorSpace::Auto`](crate::image::ColorSpace)). Whoever knows
//! better asks for raw numbers.

mod from_image;
mod numbers;
mod resize;
mod sizes;
mod to_image;

pub use from_image::{FromImage, Sizes, ptex_from_image};
pub use resize::{Resized, Resolution};
pub use to_image::{Raster, atlas, picture_of_face};

pub(crate) use numbers::store;
pub(crate) use sizes::{lengths, log2};

use crate::error::Fault;

/// The most bytes of texels, as stored, that a file is made of. Sizes beyond are a mistake more often than meant.
pub(crate) const MOST_OF_FILE: u64 = 1 << 34;
/// The most bytes that the texels of one face, or of a picture, take as floats.
pub(crate) const MOST_AT_ONCE: u64 = 1 << 32;

/// Refuses what takes more bytes than `most`.
pub(crate) fn admit(bytes: u64, most: u64, what: &str, help: &str) -> Result<(), Fault> {
    if bytes > most {
        let message = format!("{what} would take {bytes} bytes, and at most {most} are made");
        return Err(Fault::new(message).advise(help));
    }
    Ok(())
}

/// Where texel (`x`, `y`) of a triangle with `n` texels a side lies: the point (`a`, `b`) of the texel, itself a triangle
/// with corners (0, 0), (1, 0) and (0, 1). Texels beyond the diagonal are upside down, between three others.
pub(crate) fn in_triangle(x: usize, y: usize, n: usize, [a, b]: [f64; 2]) -> [f64; 2] {
    let size = n as f64;
    let (x, y) = (x as f64, y as f64);
    if x + y < size {
        [(x + a) / size, (y + b) / size]
    } else {
        [(size - y - a) / size, (size - x - b) / size]
    }
}

/// The middle of a texel of a triangle.
pub(crate) const CENTROID: [f64; 2] = [1.0 / 3.0; 2];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_texels_of_a_triangle_fill_it() {
        let n = 8;
        let mut cells = std::collections::BTreeSet::new();
        for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
            let [u, v] = in_triangle(x, y, n, CENTROID);
            assert!(u > 0.0 && v > 0.0 && u + v < 1.0, "{u} {v}");
            cells.insert([u, v].map(|c| (c * 3.0 * n as f64).round() as u32));
        }
        assert_eq!(cells.len(), n * n);
    }
}
