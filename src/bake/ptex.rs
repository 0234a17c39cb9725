//! Baking into a Ptex file.

use std::sync::Arc;

use rayon::prelude::*;
use relievo_ptex::{Cache, EncodedFace, Format, Writer};

use super::fill::fill;
use super::residual;
use super::sizes::{probe, sizes};
use super::texels::Texels;
use super::{Cage, Dense, Facing, Found, Heights, Options, Report, Run, Source, nothing_met};
use crate::convert::store;
use crate::error::{Fault, Result, Warnings};
use crate::image::{ColorSpace, ImageSource, PtexFilter, PtexOptions, PtexTexture};

/// A baked file, and how well it is.
pub struct Baked {
    /// The file, not yet written.
    pub writer: Writer,
    /// What came of it.
    pub report: Report,
    /// What is worth knowing.
    pub warnings: Warnings,
}

/// Bakes the heights of `dense` over the limit surface of `cage` into a Ptex file of one channel: to be displaced by
/// along the normal, in the meshes' units.
///
/// # Errors
/// If nothing is met, or the texels would take too much memory: bad input, about the dense mesh, or the cage. If interrupted.
pub fn to_ptex(cage: &Cage, dense: &Dense, options: &Options, run: Run<'_>) -> Result<Baked> {
    let reach = options.reach(dense);
    let probed = probe(cage, dense, reach, run)?;
    let heights = Heights {
        cage,
        dense,
        reach,
        facing: match options.two_sided {
            true => Facing::Any,
            false => probed.facing,
        },
    };
    let format = Format::new(cage.kind(), options.data_type, heights.channels());
    let chosen = sizes(cage, &probed, options.sizes, format.pixel_bytes());
    let chosen = chosen.map_err(|fault| cage.name(fault))?;
    let texels = Texels::new(cage.kind(), cage.faces(), chosen);
    let mut report = Report {
        cage_faces: cage.face_count(),
        dense_triangles: dense.triangle_count(),
        reach,
        turned: heights.facing == Facing::Opposite,
        ..Report::default()
    };
    let values = find_all(&heights, &texels, cage.faces().len(), &mut report, run)?;
    if report.missed == report.texels {
        return Err(dense.name(nothing_met(reach, report.faced_away)).into());
    }
    let mut warnings = Warnings::default();
    warn(&report, &mut warnings);
    let writer = encode(&format, &texels, cage, &values, run)?;
    let file = read_back(&writer)?;
    report.residual = residual::of_ptex(&heights, &texels, cage.faces().len(), &file, run)?;
    Ok(Baked {
        writer,
        report,
        warnings,
    })
}

/// What is worth knowing of a report.
fn warn(report: &Report, warnings: &mut Warnings) {
    if report.turned {
        warnings.add("bake-turned", || {
            "the dense mesh faces the other way than the cage: it is taken as turned".to_owned()
        });
    }
    if report.missed > 0 {
        let Report {
            missed,
            texels,
            faced_away,
            reach,
            ..
        } = report;
        warnings.add("bake-missed", || {
            format!(
                "{missed} of {texels} texels met nothing within {reach:.6}, {faced_away} of them but for what faces \
                 away: they are filled from around"
            )
        });
    }
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

/// What became of some texels.
struct Counts {
    texels: u64,
    missed: u64,
    faced_away: u64,
    least: f64,
    greatest: f64,
}

impl Default for Counts {
    fn default() -> Self {
        Self {
            texels: 0,
            missed: 0,
            faced_away: 0,
            least: f64::INFINITY,
            greatest: f64::NEG_INFINITY,
        }
    }
}

impl Counts {
    /// Counts what was found, and sets `value` to it if there is one.
    fn take(&mut self, found: Found, value: &mut [f32]) -> bool {
        self.texels += u64::from(found != Found::NoSurface);
        match found {
            Found::Value(all) => {
                value.copy_from_slice(&all[..value.len()]);
                let amount = match *value {
                    [height] => f64::from(height),
                    _ => length(value),
                };
                self.least = self.least.min(amount);
                self.greatest = self.greatest.max(amount);
                return true;
            }
            Found::Missed { faced_away } => {
                self.missed += 1;
                self.faced_away += u64::from(faced_away);
            }
            Found::NoSurface => {}
        }
        false
    }

    fn and(self, other: Self) -> Self {
        Self {
            texels: self.texels + other.texels,
            missed: self.missed + other.missed,
            faced_away: self.faced_away + other.faced_away,
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
        }
    }

    fn tell(self, report: &mut Report) {
        (report.texels, report.missed, report.faced_away) =
            (self.texels, self.missed, self.faced_away);
        if self.missed < self.texels {
            (report.least, report.greatest) = (self.least, self.greatest);
        }
    }
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
                let off: Vec<f32> = (value(texel).iter().zip(value(other)))
                    .map(|(a, b)| a - b)
                    .collect();
                largest = largest.max(length(&off));
            }
        }
        largest
    };
    (0..faces)
        .into_par_iter()
        .map(largest)
        .reduce(|| 0.0, f64::max)
}

fn length(vector: &[f32]) -> f64 {
    let squares = vector.iter().map(|&x| f64::from(x) * f64::from(x));
    squares.sum::<f64>().sqrt()
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
    PtexTexture::open(&image, &options, &Cache::default())
}
