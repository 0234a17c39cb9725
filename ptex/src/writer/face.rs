//! A face as it is stored: constant, or one block for each level, in tiles where it is large.

use super::Format;
use crate::error::{Error, Result};
use crate::layout::{Encoding, MAX_BLOCK, block_word};
use crate::reduce::{multiplied, premultiply_of, quartered, triangle_of};
use crate::sample::{Sample, to_planes, with_type};
use crate::types::{FaceInfo, MeshType, Res};
use crate::zip::{deflate, deflate_fast};

/// A face ready to be stored. Made by [`Format::encode`], which many threads may do at once.
#[derive(Clone, Debug)]
pub struct EncodedFace {
    pub(crate) res: Res,
    /// The constant texel, or the average.
    pub(crate) texel: Vec<u8>,
    /// The full size and the stored reductions; none of a constant face.
    pub(crate) levels: Vec<EncodedBlock>,
}

#[derive(Clone, Debug)]
pub(crate) struct EncodedBlock {
    pub(crate) word: u32,
    pub(crate) bytes: Vec<u8>,
}

/// How much work goes into making data small.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Effort {
    Full,
    /// For edits, which are to be saved quickly.
    Quick,
}

/// A face has no stored reduction with fewer texels than 2^this on a side.
const SMALLEST: i8 = 2;
/// Faces of fewer than twice this many bytes are one block.
const TILE_BYTES: u64 = 1 << 16;

impl EncodedFace {
    pub(super) fn new(format: &Format, res: Res, texels: &[u8], effort: Effort) -> Result<Self> {
        let pixel = format.pixel_bytes();
        if let Some(texel) = one_for_all(texels, pixel) {
            return Ok(Self {
                res,
                texel: texel.to_vec(),
                levels: Vec::new(),
            });
        }
        with_type!(format.data_type, S => {
            let samples: Vec<S> = texels.chunks_exact(S::BYTES).map(S::read).collect();
            encode(format, res, samples, effort)
        })
    }

    /// Whether all texels are equal.
    #[must_use]
    pub fn constant(&self) -> bool {
        self.levels.is_empty()
    }
}

/// How many levels hold a face, in a file with reductions.
pub(crate) fn stored_levels(info: &FaceInfo) -> usize {
    let smaller = info.res.ulog2.min(info.res.vlog2);
    match info.constant {
        true => 1,
        false => 1 + (smaller - SMALLEST).max(0) as usize,
    }
}

/// The texel that all of them are equal to, bit for bit.
fn one_for_all(texels: &[u8], pixel: usize) -> Option<&[u8]> {
    let (first, rest) = texels.split_at(pixel);
    rest.chunks_exact(pixel)
        .all(|t| t == first)
        .then_some(first)
}

fn encode<S: Sample>(
    format: &Format,
    res: Res,
    mut samples: Vec<S>,
    effort: Effort,
) -> Result<EncodedFace> {
    let channels = format.channels;
    let mut levels = vec![block(&samples, res, channels, effort)?];
    if let Some(alpha) = format.alpha_channel {
        premultiply_of(&mut samples, channels, alpha);
    }
    let mut reduced = res;
    while format.reductions && effort == Effort::Full && reduced.ulog2.min(reduced.vlog2) > SMALLEST
    {
        let width = 1 << reduced.ulog2;
        samples = match format.mesh_type {
            MeshType::Quad => quartered(&samples, width, channels),
            MeshType::Triangle => triangle_of(&samples, width, channels),
        };
        reduced.ulog2 -= 1;
        reduced.vlog2 -= 1;
        levels.push(block(&samples, reduced, channels, effort)?);
    }
    let one = format.data_type.one();
    let average = average_texel(&samples, channels, format.alpha_channel, one);
    let mut texel = Vec::with_capacity(format.pixel_bytes());
    average.iter().for_each(|sample| sample.write(&mut texel));
    Ok(EncodedFace { res, texel, levels })
}

/// The average of premultiplied texels, not premultiplied.
pub(crate) fn average_texel<S: Sample>(
    samples: &[S],
    channels: usize,
    alpha: Option<usize>,
    one: f32,
) -> Vec<S> {
    let mut average = average(samples, channels);
    if let Some(alpha) = alpha {
        unmultiply(&mut average, alpha, one);
    }
    average
}

/// In single precision and in this order, so that it is the same for everyone.
fn average<S: Sample>(samples: &[S], channels: usize) -> Vec<S> {
    let mut sums = vec![0.0_f32; channels];
    for texel in samples.chunks_exact(channels) {
        for (sum, sample) in sums.iter_mut().zip(texel) {
            *sum += sample.float();
        }
    }
    let scale = 1.0 / (samples.len() / channels) as f32;
    sums.into_iter()
        .map(|sum| S::from_float(sum * scale))
        .collect()
}

/// Divides by alpha again what it multiplies.
fn unmultiply<S: Sample>(texel: &mut [S], alpha: usize, one: f32) {
    let a = texel[alpha].float();
    if a == 0.0 {
        return;
    }
    let scale = one / a;
    let channels = texel.len();
    for sample in &mut texel[multiplied(channels, alpha)] {
        *sample = S::from_float(sample.float() * scale);
    }
}

/// The data of one size.
fn block<S: Sample>(
    samples: &[S],
    res: Res,
    channels: usize,
    effort: Effort,
) -> Result<EncodedBlock> {
    let tile_res = tile_res(res, (channels * S::BYTES) as u64);
    if tile_res == res {
        return packed(samples, channels, effort);
    }
    let (width, height) = (1_usize << tile_res.ulog2, 1 << tile_res.vlog2);
    let row = (1 << res.ulog2) * channels;
    let (mut words, mut data) = (Vec::new(), Vec::new());
    let mut tile = Vec::with_capacity(width * height * channels);
    for rows in samples.chunks_exact(height * row) {
        for x in (0..row).step_by(width * channels) {
            tile.clear();
            for row in rows.chunks_exact(row) {
                tile.extend_from_slice(&row[x..x + width * channels]);
            }
            let block = if tile.chunks_exact(channels).all(|t| *t == tile[..channels]) {
                let mut bytes = Vec::with_capacity(channels * S::BYTES);
                tile[..channels].iter().for_each(|s| s.write(&mut bytes));
                let word = block_word(bytes.len(), Encoding::Constant);
                EncodedBlock { word, bytes }
            } else {
                packed(&tile, channels, effort)?
            };
            words.extend(block.word.to_le_bytes());
            data.extend(block.bytes);
        }
    }
    let words = deflate(&words);
    let mut bytes = vec![tile_res.ulog2 as u8, tile_res.vlog2 as u8];
    bytes.extend((words.len() as u32).to_le_bytes());
    bytes.extend(words);
    bytes.extend(data);
    finished(bytes, Encoding::Tiles)
}

/// A face or a tile as one stream.
fn packed<S: Sample>(samples: &[S], channels: usize, effort: Effort) -> Result<EncodedBlock> {
    let planes = to_planes(samples, channels);
    let bytes = match effort {
        Effort::Full => deflate(&planes),
        Effort::Quick => deflate_fast(&planes),
    };
    let encoding = if S::DIFFERENCES {
        Encoding::DiffZip
    } else {
        Encoding::Zip
    };
    finished(bytes, encoding)
}

fn finished(bytes: Vec<u8>, encoding: Encoding) -> Result<EncodedBlock> {
    if bytes.len() > MAX_BLOCK {
        return Err(Error::request(
            format!(
                "takes {} bytes when compressed, and {MAX_BLOCK} can be stored",
                bytes.len()
            ),
            "give it fewer texels",
        ));
    }
    let word = block_word(bytes.len(), encoding);
    Ok(EncodedBlock { word, bytes })
}

/// The size of the tiles of a face with `pixel` bytes a texel, its own if it is stored whole: a power of two of tiles,
/// of 64 to 128 KB each.
pub(crate) fn tile_res(res: Res, pixel: u64) -> Res {
    let bytes = pixel << (res.ulog2 + res.vlog2) as u32;
    let tiles_log2 = (bytes / TILE_BYTES).checked_ilog2().unwrap_or(0) as i8;
    if tiles_log2 == 0 {
        return res;
    }
    let log2 = res.ulog2 + res.vlog2 - tiles_log2;
    let ulog2 = ((log2 + 1) / 2).min(res.ulog2);
    let vlog2 = (log2 - ulog2).min(res.vlog2);
    Res { ulog2, vlog2 }
}
