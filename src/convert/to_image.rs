//! Faces of a Ptex file as pictures: one face, or all of them beside each other.
//!
//! Row 0 of a face's texels, which lies along its edge 0, is on top. Alpha is not multiplied in.

use std::cmp::Reverse;
use std::path::Path;

use relievo_ptex::{DataType, Res};

use super::numbers::{Recoding, colors, is_encoded, store};
use super::{MOST_AT_ONCE, Resized, admit};
use crate::Result;
use crate::error::Fault;
use crate::image::{
    Channel, ChannelFormat, Compression, Part, Picture, write_exr, write_png_bytes,
};

/// Texels in a rectangle.
#[derive(Debug)]
pub struct Raster {
    width: u32,
    height: u32,
    channels: usize,
    alpha: Option<usize>,
    data_type: DataType,
    /// Row 0 on top.
    numbers: Vec<f32>,
}

/// One face.
///
/// # Errors
/// If the file is damaged, or the picture would take too much memory.
///
/// # Panics
/// If there is no such face.
pub fn picture_of_face(faces: &Resized<'_>, face: u32) -> Result<Raster, Fault> {
    let Res { ulog2, vlog2 } = faces.res(face);
    let mut raster =
        Raster::new(faces, 1 << ulog2, 1 << vlog2).map_err(|fault| fault.at_face(face as usize))?;
    raster.put(&faces.texels(face)?, [0, 0], [1 << ulog2, 1 << vlog2]);
    Ok(raster)
}

/// All faces: from the left to the right and then from the top to the bottom the highest first, among those the widest,
/// among those the first ones of the file. Zeros between them.
///
/// # Errors
/// If the file has no faces or is damaged, or the picture would take too much memory.
pub fn atlas(faces: &Resized<'_>) -> Result<Raster, Fault> {
    let sizes: Vec<Res> = (0..faces.reader().face_count())
        .map(|face| faces.res(face))
        .collect();
    if sizes.is_empty() {
        let fault = Fault::new("it has no faces, and a picture of none has no pixels");
        return Err(fault.advise("give a file with faces"));
    }
    let (places, [width, height]) = places(&sizes);
    let mut raster = Raster::new(faces, width, height)?;
    for ((face, size), place) in (0..).zip(&sizes).zip(places) {
        let size = [size.ulog2, size.vlog2].map(|log2| 1 << log2);
        raster.put(&faces.texels(face)?, place.map(|x| x as usize), size);
    }
    Ok(raster)
}

/// Where rectangles stand in rows as high as their first one, and the width and height of all.
fn places(sizes: &[Res]) -> (Vec<[u64; 2]>, [u64; 2]) {
    let area = sizes.iter().fold(0_u64, |area, size| {
        area.saturating_add(1 << (size.ulog2 + size.vlog2) as u32)
    });
    let widest = sizes.iter().map(|size| 1 << size.ulog2).max().unwrap_or(1);
    let width = (area as f64).sqrt().ceil().max(1.0) as u64;
    let width = width.next_power_of_two().max(widest);
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    // Stable: equal ones stay in the file's order.
    order.sort_by_key(|&face| Reverse((sizes[face].vlog2, sizes[face].ulog2)));
    let mut places = vec![[0; 2]; sizes.len()];
    let (mut x, mut y, mut below) = (0, 0, 0_u64);
    for face in order {
        let [across, up] = [sizes[face].ulog2, sizes[face].vlog2].map(|log2| 1 << log2);
        if x + across > width {
            (x, y) = (0, below);
        }
        if x == 0 {
            below = y + up;
        }
        places[face] = [x, y];
        x += across;
    }
    (places, [width, below])
}

impl Raster {
    /// Of zeros.
    fn new(faces: &Resized<'_>, width: u64, height: u64) -> Result<Self, Fault> {
        let reader = faces.reader();
        let channels = reader.channels();
        let count = width.saturating_mul(height).saturating_mul(channels as u64);
        admit(
            count.saturating_mul(4),
            MOST_AT_ONCE,
            &format!("a picture of {width} x {height} texels"),
            "ask for one --face, or for fewer texels by --scale or --max-res",
        )?;
        Ok(Self {
            // What fits into memory fits into 32 bits.
            width: width as u32,
            height: height as u32,
            channels,
            alpha: reader.alpha_channel(),
            data_type: reader.data_type(),
            numbers: vec![0.0; count as usize],
        })
    }

    /// Fills a rectangle with texels, or with one that stands for all.
    fn put(&mut self, texels: &[f32], [x, y]: [usize; 2], [across, up]: [usize; 2]) {
        let row = self.width as usize * self.channels;
        for line in 0..up {
            let start = (y + line) * row + x * self.channels;
            let out = &mut self.numbers[start..start + across * self.channels];
            if texels.len() == self.channels {
                for texel in out.chunks_exact_mut(self.channels) {
                    texel.copy_from_slice(texels);
                }
            } else {
                let from = line * out.len();
                out.copy_from_slice(&texels[from..from + out.len()]);
            }
        }
    }

    /// Writes linear numbers, halves if the file has halves. `raw`: numbers as the file has them.
    ///
    /// # Errors
    /// If the picture cannot be written there.
    pub fn write_exr(&self, path: &Path, raw: bool) -> Result<()> {
        let format = match self.data_type {
            DataType::F16 => ChannelFormat::Half,
            _ => ChannelFormat::Float,
        };
        let channels = self.names().into_iter();
        let part = Part {
            name: String::new(),
            channels: channels.map(|name| Channel { name, format }).collect(),
            pixels: self.meaning(false, raw),
        };
        let picture = Picture {
            width: self.width,
            height: self.height,
            display_window: (self.width, self.height, 0, 0),
            parts: vec![part],
            metadata: Vec::new(),
            tile: None,
            compression: Compression::Zip,
        };
        write_exr(path, &picture)
    }

    /// Writes bytes, colours by the sRGB curve. `raw`: numbers as the file has them.
    ///
    /// # Errors
    /// If PNG has no such channels, or the picture cannot be written there.
    pub fn write_png(&self, path: &Path, raw: bool) -> Result<()> {
        let kept: Vec<usize> = colors(self.channels, self.alpha)
            .chain(self.alpha)
            .collect();
        let count = kept.len() - usize::from(self.alpha.is_some());
        if kept.len() < self.channels || !matches!(count, 1 | 3) {
            let alpha = match self.alpha {
                Some(alpha) => format!("with alpha in channel {alpha}"),
                None => "without alpha".to_owned(),
            };
            return Err(Fault::new(format!(
                "its {} channels {alpha} cannot be had in PNG, which has grey or three colours, with or without alpha",
                self.channels
            ))
            .advise("give the output a name that ends in .exr")
            .into());
        }
        let numbers = self.meaning(true, raw);
        let mut picked = Vec::with_capacity(numbers.len());
        for texel in numbers.chunks_exact(self.channels) {
            picked.extend(kept.iter().map(|&c| texel[c]));
        }
        let mut bytes = Vec::with_capacity(picked.len());
        store(DataType::U8, &picked, &mut bytes);
        write_png_bytes(path, self.width, self.height, kept.len(), &bytes)
    }

    /// The numbers as bytes or as floats mean them.
    fn meaning(&self, bytes: bool, raw: bool) -> Vec<f32> {
        let encoded = |data_type| !raw && is_encoded(data_type, self.channels, self.alpha);
        let to = if bytes { DataType::U8 } else { DataType::F32 };
        let mut numbers = self.numbers.clone();
        Recoding::new(
            self.channels,
            self.alpha,
            encoded(self.data_type),
            encoded(to),
        )
        .apply(&mut numbers);
        numbers
    }

    /// What OpenEXR calls the channels: `Y`, or `R`, `G`, `B`; `A`; others by their number in the file.
    fn names(&self) -> Vec<String> {
        let colors: Vec<usize> = colors(self.channels, self.alpha).collect();
        let letters = match colors.len() {
            1 => &["Y"][..],
            _ => &["R", "G", "B"],
        };
        let name = |c: usize| {
            let color = colors.iter().position(|&color| color == c);
            match color {
                Some(color) => letters[color].to_owned(),
                None if Some(c) == self.alpha => "A".to_owned(),
                None => format!("channel{c:05}"),
            }
        };
        (0..self.channels).map(name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_faces_of_an_atlas_meet() {
        let sizes: Vec<Res> = (0..60_u32)
            .map(|n| {
                let random = n.wrapping_mul(0x9e37_79b9);
                Res {
                    ulog2: (random >> 8 & 3) as i8,
                    vlog2: (random >> 16 & 3) as i8,
                }
            })
            .collect();
        let (places, [width, height]) = places(&sizes);
        let mut taken = vec![false; (width * height) as usize];
        for (size, [x, y]) in sizes.iter().zip(places) {
            for (row, column) in (0..1 << size.vlog2)
                .flat_map(|row| (0..1 << size.ulog2).map(move |column| (row, column)))
            {
                assert!(x + column < width && y + row < height);
                let texel = &mut taken[((y + row) * width + x + column) as usize];
                assert!(!*texel);
                *texel = true;
            }
        }
        let filled = taken.iter().filter(|t| **t).count();
        assert!(2 * filled > taken.len(), "{filled} of {}", taken.len());
    }
}
