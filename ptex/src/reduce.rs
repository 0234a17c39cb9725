//! Smaller versions of a face's texels, and premultiplication with alpha.
//!
//! Files hold reductions by 2 x 2 texels down to four texels on the smaller side; all others are computed, one axis at
//! a time. Integers are cut at every step, so that the two ways differ: which one a reduction comes by is part of the
//! format.

use crate::sample::{Pixels, Sample, with_samples};

/// The axis along which pairs of texels become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    U,
    V,
}

/// Half the columns or half the rows of a rectangle of `width` columns.
pub(crate) fn halved(pixels: &Pixels, width: usize, channels: usize, axis: Axis) -> Pixels {
    with_samples!(pixels, s => Sample::wrap(halve(s, width, channels, axis)))
}

fn halve<S: Sample>(from: &[S], width: usize, channels: usize, axis: Axis) -> Vec<S> {
    // Along u a pair is two texels, along v two rows.
    let run = match axis {
        Axis::U => channels,
        Axis::V => width * channels,
    };
    let mut out = Vec::with_capacity(from.len() / 2);
    for pair in from.chunks_exact(2 * run) {
        let (a, b) = pair.split_at(run);
        out.extend(a.iter().zip(b).map(|(a, b)| S::half_sum(*a, *b)));
    }
    out
}

/// Half the columns and half the rows, as stored in files of quad meshes.
pub(crate) fn quartered<S: Sample>(from: &[S], width: usize, channels: usize) -> Vec<S> {
    let row = width * channels;
    let mut out = Vec::with_capacity(from.len() / 4);
    for rows in from.chunks_exact(2 * row) {
        let (lower, upper) = rows.split_at(row);
        for (l, u) in lower
            .chunks_exact(2 * channels)
            .zip(upper.chunks_exact(2 * channels))
        {
            out.extend(
                (0..channels)
                    .map(|c| S::quarter_sum([l[c], l[channels + c], u[c], u[channels + c]])),
            );
        }
    }
    out
}

/// Half the size of a triangle's texels, `size` on a side: three even texels and the odd one between them, or the
/// other way round.
pub(crate) fn triangle(pixels: &Pixels, size: usize, channels: usize) -> Pixels {
    with_samples!(pixels, s => Sample::wrap(triangle_of(s, size, channels)))
}

pub(crate) fn triangle_of<S: Sample>(from: &[S], size: usize, channels: usize) -> Vec<S> {
    let at = |x: usize, y: usize| (y * size + x) * channels;
    let mut out = Vec::with_capacity(from.len() / 4);
    for y in (0..size).step_by(2) {
        for x in (0..size).step_by(2) {
            let texels = [
                at(x, y),
                at(x + 1, y),
                at(x, y + 1),
                at(size - 1 - y, size - 1 - x),
            ];
            out.extend((0..channels).map(|c| S::quarter_sum(texels.map(|t| from[t + c]))));
        }
    }
    out
}

/// Multiplies channels by alpha: all after it if it is the first, those before it otherwise.
pub(crate) fn premultiply(pixels: &mut Pixels, channels: usize, alpha: usize) {
    with_samples!(pixels, s => premultiply_of(s, channels, alpha));
}

pub(crate) fn premultiply_of<S: Sample>(samples: &mut [S], channels: usize, alpha: usize) {
    for texel in samples.chunks_exact_mut(channels) {
        let a = texel[alpha].float();
        for sample in &mut texel[multiplied(channels, alpha)] {
            *sample = sample.times_alpha(a);
        }
    }
}

/// The channels that alpha multiplies.
pub(crate) fn multiplied(channels: usize, alpha: usize) -> std::ops::Range<usize> {
    match alpha {
        0 => 1..channels,
        alpha => 0..alpha,
    }
}
