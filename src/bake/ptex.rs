//! Baking into a Ptex file.

use std::sync::Arc;

use rayon::prelude::*;
use relievo_ptex::{Cache, EncodedFace, Format, Writer};

use super::fill::fill;
use super::sizes::{probe, sizes};
use super::texels::Texels;
use super::{
    Cage, Counts, Dense, Heights, Options, Report, Run, Source, What, distance, residual, warn,
};
use crate::convert::store;
use crate::error::{Fault, Result, Warnings};
use crate::image::{ColorSpace, ImageSource, PtexFilter, PtexOptions, PtexTexture};
use crate::math::{Area, Vec2};

/// A baked file, and how well it is.
pub struct Baked {
    /// The file, not yet written.
    pub writer: Writer,
    /// What came of it.
    pub report: Report,
    /// What is worth knowing.
    pub warnings: Warnings,
}

/// Bakes the heights of `dense` over the limit surface of `cage` into a Ptex file of one channel, or
/// vectors into one of three, in the meshes' units.
///
/// # Errors
/// If nothing is met, or the texels would take too much memory: bad input, about the dense mesh, or the cage. If interrupted.
pub fn to_ptex(
    cage: &Cage,
    dense: &Dense,
    what: What<'_>,
    options: &Options,
    run: Run<'_>,
) -> Result<Baked> {
    let reach = options.reach(dense);
    let probed = probe(cage, dense, reach, run)?;
    let heights = Heights::new(cage, dense, options, &probed);
    let mut report = heights.report();
    let source = what.source(heights);
    let format = Format::new(cage.kind(), options.data_type, source.channels());
    let chosen = sizes(cage, &probed, options.sizes, format.pixel_bytes());
    let chosen = chosen.map_err(|fault| cage.name(fault))?;
    let texels = Texels::new(cage.kind(), cage.faces(), chosen);
    let values = find_all(&*source, &texels, cage.faces().len(), &mut report, run)?;
    if report.missed == report.texels {
        return Err(what.nothing(dense, &report).into());
    }
    let mut warnings = Warnings::default();
    warn(&report, what, &mut warnings);
    let writer = encode(&format, &texels, cage, &values, run)?;
    let file = read_back(&writer)?;
    report.residual = residual::of(&*source, cage.faces().len(), run, |face, tell| {
        for uv in texels.corners(face) {
            let read = file.eval(face as u32, Vec2::from(uv.map(|x| x as f32)), &Area::POINT);
            tell(uv, read.to_array());
        }
    })?;
    Ok(Baked {
        writer,
        report,
        warnings,
    })
}

/// The displacements of all texels, those that were missed filled from around.
fn find_all(
    source: &dyn Source,
    texels: &Texels<'_>,
    faces: usize,
    report: &mut Report,
    run: Run<'_>,
) -> Result<Vec<f32>> {
    let channels = source.channels();
    run.progress.stage("bake", texels.len() as u64);
    let mut values = vec![0.0; channels * texels.len()];
    let mut known = vec![false; texels.len()];
    let mut work = Vec::with_capacity(faces);
    let (mut rest, mut rest_known) = (&mut values[..], &mut known[..]);
    for face in 0..faces {
        let count = texels.of(face).len();
        let (own, after) = rest.split_at_mut(channels * count);
        let (own_known, after_known) = rest_known.split_at_mut(count);
        work.push((face, own, own_known));
        (rest, rest_known) = (after, after_known);
    }
    let counts: Vec<Counts> = work
        .into_par_iter()
        .map(|(face, values, known)| {
            // Faces may be few and large.
            let rows = texels.size(face)[0];
            let rows = (values.par_chunks_mut(channels * rows))
                .zip(known.par_chunks_mut(rows))
                .enumerate();
            let counts = rows.map(|(row, (values, known))| {
                let mut counts = Counts::default();
                if run.goes_on() {
                    let places = texels.middles(face, row);
                    let out = values.chunks_exact_mut(channels).zip(known);
                    for (uv, (value, known)) in places.zip(out) {
                        *known = counts.take(source.find(face as u32, uv), value);
                    }
                    run.progress.by(texels.size(face)[0] as u64);
                }
                counts
            });
            counts.reduce(Counts::default, Counts::and)
        })
        .collect();
    run.check()?;
    counts
        .into_iter()
        .fold(Counts::default(), Counts::and)
        .tell(report);

    let starts: Vec<usize> = (0..faces).map(|face| texels.of(face).start).collect();
    let face = |texel: usize| starts.partition_point(|&start| start <= texel) - 1;
    fill(&mut values, channels, &known, |texel, out| {
        texels.neighbours(face(texel), texel, out);
    });
    report.step = step(texels, faces, &values, channels);
    Ok(values)
}

/// The largest difference between two texels side by side.
fn step(texels: &Texels<'_>, faces: usize, values: &[f32], channels: usize) -> f64 {
    let value = |texel: usize| &values[channels * texel..][..channels];
    let largest = |face: usize| {
        let (mut largest, mut around) = (0.0_f64, Vec::new());
        for texel in texels.of(face) {
            around.clear();
            texels.neighbours(face, texel, &mut around);
            for &other in &around {
                largest = largest.max(distance(value(texel), value(other)));
            }
        }
        largest
    };
    (0..faces)
        .into_par_iter()
        .map(largest)
        .reduce(|| 0.0, f64::max)
}

fn encode(
    format: &Format,
    texels: &Texels<'_>,
    cage: &Cage,
    values: &[f32],
    run: Run<'_>,
) -> Result<Writer> {
    let faces = cage.faces();
    run.progress.stage("encode", faces.len() as u64);
    let encode = |face: usize| -> Result<EncodedFace, Fault> {
        let range = texels.of(face);
        let numbers = &values[format.channels * range.start..format.channels * range.end];
        let mut bytes = Vec::new();
        store(format.data_type, numbers, &mut bytes);
        let encoded = format.encode(texels.res(face), &bytes);
        run.progress.by(1);
        encoded.map_err(|e| Fault::from(e).at_face(faces[face].face as usize))
    };
    let encoded: Vec<EncodedFace> = (0..faces.len())
        .into_par_iter()
        .map(encode)
        .collect::<Result<_, _>>()?;
    run.check()?;
    let mut writer = Writer::new(format.clone(), faces.len() as u32)?;
    for ((number, face), encoded) in faces.iter().enumerate().zip(encoded) {
        writer.encoded_face(number as u32, &face.info(texels.res(number)), encoded)?;
    }
    Ok(writer)
}

/// The file as displacement reads it.
fn read_back(writer: &Writer) -> Result<PtexTexture, Fault> {
    let bytes: Arc<[u8]> = writer.bytes()?.into();
    let name = "what was baked".to_owned();
    let image = ImageSource::Packed {
        package: std::path::PathBuf::new(),
        tiles: vec![(0, name, bytes)],
    };
    let options = PtexOptions {
        filter: PtexFilter::Consistent,
        first_channel: 0,
        color_space: ColorSpace::Raw,
    };
    PtexTexture::new(PtexTexture::open(&image, &Cache::default())?, &options)
}
