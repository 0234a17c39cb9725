//! Baking into an image, by the cage's texture coordinates.
//!
//! Each pixel whose middle lies on the limit surface is looked from. What lies beyond the islands' borders is read too,
//! by filters and by smaller images: the first pixels go on linearly, so that lookups at the very border are as good as
//! within, and further ones are means of those before, ring by ring.

use std::path::Path;

use rayon::prelude::*;
use relievo_ptex::DataType;

use super::fill::fill;
use super::layout::Pixel;
use super::sizes::{Probed, Sizes, edge, probe};
use super::{
    Cage, Counts, Dense, Heights, Layout, Options, Report, Run, Source, What, residual, warn,
};
use crate::convert::{MOST_AT_ONCE, admit};
use crate::error::{Fault, Result, Warnings};
use crate::image::{
    Channel, ChannelFormat, ColorSpace, Compression, ImageSource, Part, Picture, Texture, Wrap,
    write_exr, write_whole,
};
use crate::math::Vec2;

/// Sides that are chosen, as powers of two.
const CHOSEN: std::ops::RangeInclusive<u32> = 4..=13;
/// The part of all faces that get as many pixels as they ask for.
const CONTENT: f64 = 0.9;

/// Bakes the heights of `dense` over the limit surface of `cage`, laid out by `layout`, into a square OpenEXR image with a
/// channel R, or vectors into one of R, G and B, and writes it.
///
/// # Errors
/// As [`to_ptex`](super::to_ptex), if the layout leaves the unit square, and if the file cannot be written.
pub fn to_exr(
    cage: &Cage,
    layout: &Layout,
    dense: &Dense,
    what: What<'_>,
    options: &Options,
    path: &Path,
    run: Run<'_>,
) -> Result<(Report, Warnings)> {
    layout.check(cage)?;
    let reach = options.reach(dense);
    let probed = probe(cage, dense, reach, run)?;
    let heights = Heights::new(cage, dense, options, &probed);
    let mut report = heights.report();
    let source = what.source(heights);
    let channels = source.channels();
    let side = side(cage, layout, &probed, options.sizes)?;
    let size = format!("an image of {side} x {side} pixels");
    let bytes = (side * side) as u64 * 4 * channels as u64;
    admit(
        bytes,
        MOST_AT_ONCE,
        &size,
        "ask for fewer by --texels or --rate",
    )
    .map_err(|fault| cage.name(fault))?;

    let pixels = layout.pixels(cage, side, false, run)?;
    let (mut values, found) = find_all(&*source, &pixels, side, &mut report, run)?;
    if report.missed == report.texels {
        return Err(what.nothing(dense, &report).into());
    }
    let covered = &found.covered;
    fill(&mut values, channels, &found.known, |pixel, out| {
        if covered[pixel] {
            out.extend(beside(pixel, side).filter(|&other| covered[other]));
        }
    });
    report.step = step(&values, channels, covered, side);
    dilate(
        &mut values,
        channels,
        covered.clone(),
        side,
        options.dilation,
    );
    let mut warnings = Warnings::default();
    warn(&report, what, &mut warnings);
    if found.overlaps > 0 {
        warnings.add("bake-overlaps", || {
            let count = found.overlaps;
            format!("{count} pixels lie on more than one face: the first face has them, and others show its displacement")
        });
    }

    // It has its name only when it is checked: an interrupt leaves nothing.
    write_whole(path, |temporary| {
        write(temporary, side, channels, options.data_type, values)?;
        let image = ImageSource::File(temporary.to_owned());
        let image = Texture::load(&image, [Wrap::Clamp; 2], ColorSpace::Raw)?;
        let places = layout.pixels(cage, side, true, run)?;
        report.residual = residual::of(&*source, cage.faces().len(), run, |face, tell| {
            for pixel in &places[face] {
                let st = layout.texcoord(face as u32, pixel.uv).unwrap_or(Vec2::ZERO);
                tell(pixel.uv, image.eval(st).to_array());
            }
        })?;
        Ok(())
    })?;
    Ok((report, warnings))
}

/// Pixels along a side.
fn side(cage: &Cage, layout: &Layout, probed: &Probed, sizes: Sizes) -> Result<usize, Fault> {
    let rate = match sizes {
        Sizes::Log2(log2) => return Ok(1 << log2),
        Sizes::PerEdge(rate) => rate,
    };
    let mut wanted: Vec<f64> = (0..cage.faces().len() as u32)
        .into_par_iter()
        .flat_map_iter(|ptex| {
            let on_surface = cage.lengths(ptex);
            let in_image = layout.lengths(cage, ptex);
            let edge = edge(probed, ptex);
            let pixels = [0, 1].map(|i| edge.map(|edge| rate * on_surface[i] / edge / in_image[i]));
            pixels
                .into_iter()
                .flatten()
                .filter(|pixels| pixels.is_finite())
        })
        .collect();
    wanted.sort_by(f64::total_cmp);
    let index = (CONTENT * wanted.len() as f64) as usize;
    let Some(&pixels) = wanted.get(index.min(wanted.len().saturating_sub(1))) else {
        let fault = Fault::new("its texture coordinates have no area");
        return Err(cage.name(fault.advise("lay it out anew, or bake to .ptx")));
    };
    let log2 = (pixels.max(1.0).log2().ceil() as u32).clamp(*CHOSEN.start(), *CHOSEN.end());
    Ok(1 << log2)
}

/// What is known of an image's pixels.
struct FoundPixels {
    /// Whether there is a displacement.
    known: Vec<bool>,
    /// Whether there is a surface.
    covered: Vec<bool>,
    /// Pixels of more than one face.
    overlaps: u64,
}

fn find_all(
    source: &dyn Source,
    pixels: &[Vec<Pixel>],
    side: usize,
    report: &mut Report,
    run: Run<'_>,
) -> Result<(Vec<f32>, FoundPixels)> {
    /// Parameters this close to a face's border may be those of the next face's too.
    const BORDER: f64 = 1e-6;
    let channels = source.channels();
    let count = side * side;
    let mut owner = vec![u32::MAX; count];
    let mut overlaps = 0;
    let inside = |uv: [f64; 2]| uv.iter().all(|x| (BORDER..1.0 - BORDER).contains(x));
    // The first face has a pixel.
    for (face, pixels) in (0_u32..).zip(pixels) {
        for pixel in pixels {
            let owner = &mut owner[pixel.number];
            if *owner == u32::MAX {
                *owner = face;
            } else if inside(pixel.uv) {
                overlaps += 1;
            }
        }
    }
    let owned: Vec<(u32, Pixel)> = (0_u32..)
        .zip(pixels)
        .flat_map(|(face, pixels)| pixels.iter().map(move |pixel| (face, *pixel)))
        .filter(|(face, pixel)| owner[pixel.number] == *face)
        .collect();
    run.progress.stage("bake", owned.len() as u64);
    const AT_ONCE: usize = 1024;
    let found: Vec<(Counts, Vec<f32>, Vec<bool>)> = owned
        .par_chunks(AT_ONCE)
        .map(|owned| {
            let mut counts = Counts::default();
            let mut values = vec![0.0; channels * owned.len()];
            let mut known = Vec::with_capacity(owned.len());
            if run.goes_on() {
                for ((face, pixel), value) in owned.iter().zip(values.chunks_exact_mut(channels)) {
                    known.push(counts.take(source.find(*face, pixel.uv), value));
                }
                run.progress.by(owned.len() as u64);
            }
            (counts, values, known)
        })
        .collect();
    run.check()?;

    let mut values = vec![0.0; channels * count];
    let mut all = FoundPixels {
        known: vec![false; count],
        covered: owner.iter().map(|&face| face != u32::MAX).collect(),
        overlaps,
    };
    let mut counts = Counts::default();
    for (owned, (of_these, found, known)) in owned.chunks(AT_ONCE).zip(found) {
        counts = counts.and(of_these);
        let each = found.chunks_exact(channels).zip(known);
        for ((_, pixel), (value, known)) in owned.iter().zip(each) {
            values[channels * pixel.number..][..channels].copy_from_slice(value);
            all.known[pixel.number] = known;
        }
    }
    // Pixels that nothing is looked for from belong to nobody: they are filled with those that were missed.
    counts.tell(report);
    Ok((values, all))
}

/// The pixels that share a side with one.
fn beside(pixel: usize, side: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % side, pixel / side);
    [
        (x > 0).then(|| pixel - 1),
        (x + 1 < side).then_some(pixel + 1),
        (y > 0).then(|| pixel - side),
        (y + 1 < side).then_some(pixel + side),
    ]
    .into_iter()
    .flatten()
}

/// The largest difference between two covered pixels side by side.
fn step(values: &[f32], channels: usize, covered: &[bool], side: usize) -> f64 {
    let value = |pixel: usize| &values[channels * pixel..][..channels];
    let pixels = (0..covered.len()).into_par_iter().filter(|&p| covered[p]);
    let steps = pixels.map(|pixel| {
        beside(pixel, side)
            .filter(|&other| covered[other])
            .map(|other| super::distance(value(pixel), value(other)))
            .fold(0.0, f64::max)
    });
    steps.reduce(|| 0.0, f64::max)
}

/// Sets `rings` rings of pixels around those that are covered.
fn dilate(values: &mut [f32], channels: usize, mut covered: Vec<bool>, side: usize, rings: u32) {
    const DIRECTIONS: [[isize; 2]; 8] = [
        [1, 0],
        [1, 1],
        [0, 1],
        [-1, 1],
        [-1, 0],
        [-1, -1],
        [0, -1],
        [1, -1],
    ];
    let step = |pixel: usize, [dx, dy]: [isize; 2]| {
        let x = (pixel % side)
            .checked_add_signed(dx)
            .filter(|x| *x < side)?;
        let y = (pixel / side)
            .checked_add_signed(dy)
            .filter(|y| *y < side)?;
        Some(y * side + x)
    };
    let touches = |covered: &[bool], pixel: usize| {
        let mut around = DIRECTIONS.iter().filter_map(|d| step(pixel, *d));
        around.any(|other| covered[other])
    };
    let mut ring: Vec<usize> = (0..covered.len())
        .into_par_iter()
        .filter(|&pixel| !covered[pixel] && touches(&covered, pixel))
        .collect();
    for number in 0..rings {
        let grown: Vec<f32> = ring
            .par_iter()
            .flat_map_iter(|&pixel| {
                let (mut sum, mut count) = (vec![0.0_f32; channels], 0.0);
                for direction in DIRECTIONS {
                    let Some(near) = step(pixel, direction).filter(|&p| covered[p]) else {
                        continue;
                    };
                    // On from the surface, where it lies side by side.
                    let far = step(near, direction).filter(|&p| covered[p] && number == 0);
                    count += 1.0;
                    for (c, sum) in sum.iter_mut().enumerate() {
                        let [a, b] = [near, far.unwrap_or(near)].map(|p| values[channels * p + c]);
                        *sum += 2.0 * a - b;
                    }
                }
                sum.into_iter().map(move |sum| sum / count)
            })
            .collect();
        for (&pixel, value) in ring.iter().zip(grown.chunks_exact(channels)) {
            values[channels * pixel..][..channels].copy_from_slice(value);
            covered[pixel] = true;
        }
        let next = ring
            .iter()
            .flat_map(|&pixel| DIRECTIONS.iter().filter_map(move |d| step(pixel, *d)));
        let mut next: Vec<usize> = next.filter(|&pixel| !covered[pixel]).collect();
        next.sort_unstable();
        next.dedup();
        ring = next;
    }
}

fn write(
    path: &Path,
    side: usize,
    channels: usize,
    data_type: DataType,
    pixels: Vec<f32>,
) -> Result<()> {
    let format = match data_type {
        DataType::F16 => ChannelFormat::Half,
        _ => ChannelFormat::Float,
    };
    let channels = ["R", "G", "B"][..channels].iter().map(|name| Channel {
        name: (*name).to_owned(),
        format,
    });
    let part = Part {
        name: String::new(),
        channels: channels.collect(),
        pixels,
    };
    let side = side as u32;
    let picture = Picture {
        width: side,
        height: side,
        display_window: (side, side, 0, 0),
        parts: vec![part],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    };
    write_exr(path, &picture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_goes_on_beyond_its_border_and_levels_off() {
        let side = 8;
        let covered: Vec<bool> = (0..64).map(|p| p % side < 4).collect();
        let ramp = |p: usize| (p % side) as f32;
        let mut values: Vec<f32> = (0..64)
            .map(|p| if covered[p] { ramp(p) } else { -9.0 })
            .collect();
        dilate(&mut values, 1, covered, side, 2);
        for row in values.chunks_exact(side) {
            assert!(
                (row[4] - 4.0).abs() < 0.35 && (3.5..4.5).contains(&row[5]),
                "{row:?}"
            );
            assert_eq!(row[6], -9.0);
        }
    }
}
