//! Baking: what a dense mesh has beyond the limit surface of a cage, as displacement.
//!
//! A [`Cage`] is the limit surface of a control mesh, a [`Dense`] is a mesh of polygons behind Embree. [`to_ptex`]
//! looks from each texel's place on the limit surface for the dense mesh, along the normal, fills what
//! it misses from around, and reads the result back as a render will, to tell by how much that is off. [`to_exr`] does so
//! for the pixels of an image, which the cage's texture coordinates ([`Layout`]) lay over it. [`fit()`] moves a cage's points closer first.
//!
//! The same meshes and options give the same bytes for any number of threads: each texel is found alone, and sums are
//! taken face by face.

mod along_normal;
mod cage;
mod counts;
mod dense;
mod fill;
mod fit;
mod image;
mod layout;
mod ptex;
mod residual;
mod sizes;
mod texels;
mod vectors;

use std::sync::atomic::{AtomicBool, Ordering};

use relievo_ptex::DataType;
use serde::Serialize;

use crate::error::{Error, Fault, Result, Warnings};
use crate::render::Progress;
use crate::surface::Space;
use along_normal::Facing;
use counts::Counts;
use sizes::Probed;
use vectors::Vectors;

pub use cage::Cage;
pub use dense::Dense;
pub use fit::{Fit, fit};
pub use image::to_exr;
pub use layout::Layout;
pub use ptex::{Baked, to_ptex};
pub use residual::Residual;
pub use sizes::Sizes;
pub use vectors::Flat;

/// How to bake.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// How far from the limit surface the dense mesh is looked for, in units of the meshes' space; `None`: a tenth of
    /// the diagonal of the dense mesh's box.
    pub reach: Option<f64>,
    /// Takes what is nearest, whichever way it faces. Else only what faces as the cage does is met.
    pub two_sided: bool,
    /// How many texels faces get.
    pub sizes: Sizes,
    /// Their type: floats or halves.
    pub data_type: DataType,
    /// How many rings of pixels of an image are filled beyond the islands' borders.
    pub dilation: u32,
}

/// The part of the diagonal of the dense mesh's box within which it is looked for.
const REACH: f64 = 0.1;

impl Options {
    fn reach(&self, dense: &Dense) -> f64 {
        let diagonal = f64::from(dense.bounds().extent().length());
        self.reach.unwrap_or(REACH * diagonal)
    }
}

/// What came of it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    /// Faces of the cage.
    pub cage_faces: usize,
    /// Triangles of the dense mesh.
    pub dense_triangles: usize,
    /// How far from the limit surface the dense mesh was looked for.
    pub reach: f64,
    /// Whether the dense mesh faces the other way than the cage, and was taken as turned.
    pub turned: bool,
    /// Texels on the limit surface.
    pub texels: u64,
    /// Those of them from which nothing was met, for any reason; they were filled from around.
    pub missed: u64,
    /// Those of the missed ones that met only what faces away.
    pub faced_away: u64,
    /// The least displacement that was met (of a vector, the least length).
    pub least: f64,
    /// The greatest one.
    pub greatest: f64,
    /// The largest difference between two texels side by side.
    pub step: f64,
    /// What moving the cage's points first came to, if that was asked for.
    pub fit: Option<Fit>,
    /// How far what a render reads between texels is from the dense mesh.
    pub residual: Residual,
}

/// Tells how far a bake is, and whether it shall end.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Is told.
    pub progress: &'a Progress,
    /// Is set when it shall end.
    pub interrupt: &'a AtomicBool,
}

impl Run<'_> {
    /// # Errors
    /// [`Error::Interrupted`] if it shall end.
    fn check(self) -> Result<()> {
        match self.goes_on() {
            true => Ok(()),
            false => Err(Error::Interrupted),
        }
    }

    /// Whether it shall not end.
    pub fn goes_on(self) -> bool {
        !self.interrupt.load(Ordering::Relaxed)
    }
}

/// What is found of the dense mesh from a place on the limit surface.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Found {
    /// The displacement: a height, or a vector.
    Value([f32; 3]),
    /// Nothing within reach, or only what faces away.
    Missed { faced_away: bool },
    /// There is no limit surface.
    NoSurface,
}

/// Where displacements come from.
trait Source: Sync {
    /// Components of a displacement: 1 or 3.
    fn channels(&self) -> usize;
    /// At a place of a Ptex face.
    fn find(&self, ptex: u32, uv: [f64; 2]) -> Found;
}

/// What displacements are.
#[derive(Clone, Copy)]
pub enum What<'a> {
    /// Heights along the normal.
    Heights,
    /// Vectors to where both meshes have the same texture coordinates.
    Vectors {
        /// The cage's.
        layout: &'a Layout,
        /// The dense mesh's.
        flat: &'a Flat,
        /// In which space vectors are.
        space: Space,
    },
}

impl What<'_> {
    /// Where displacements come from.
    fn source<'a>(&'a self, heights: Heights<'a>) -> Box<dyn Source + 'a> {
        match *self {
            What::Heights => Box::new(heights),
            What::Vectors {
                layout,
                flat,
                space,
            } => Box::new(Vectors {
                cage: heights.cage,
                dense: heights.dense,
                layout,
                flat,
                space,
            }),
        }
    }

    /// That nothing was found anywhere.
    fn nothing(&self, dense: &Dense, report: &Report) -> Fault {
        match self {
            What::Heights => dense.name(nothing_met(report.reach, report.faced_away)),
            What::Vectors { flat, .. } => flat.nothing_met(),
        }
    }
}

/// Displacement along the normal.
struct Heights<'a> {
    cage: &'a Cage,
    dense: &'a Dense,
    reach: f64,
    facing: Facing,
}

impl<'a> Heights<'a> {
    fn new(cage: &'a Cage, dense: &'a Dense, options: &Options, probed: &Probed) -> Self {
        Self {
            cage,
            dense,
            reach: options.reach(dense),
            facing: match options.two_sided {
                true => Facing::Any,
                false => probed.facing,
            },
        }
    }

    /// What is known beforehand.
    fn report(&self) -> Report {
        Report {
            cage_faces: self.cage.face_count(),
            dense_triangles: self.dense.triangle_count(),
            reach: self.reach,
            turned: self.facing == Facing::Opposite,
            ..Report::default()
        }
    }
}

impl Source for Heights<'_> {
    fn channels(&self) -> usize {
        1
    }

    fn find(&self, ptex: u32, uv: [f64; 2]) -> Found {
        let Some(line) = self.cage.line(ptex, uv) else {
            return Found::NoSurface;
        };
        match along_normal::closest(self.dense, &line, self.reach, self.facing) {
            Ok(hit) => Found::Value([hit.height as f32, 0.0, 0.0]),
            Err(faced_away) => Found::Missed { faced_away },
        }
    }
}

/// How far two displacements differ.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    let squares = a
        .iter()
        .zip(b)
        .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    squares.sum::<f64>().sqrt()
}

/// What is worth knowing of a report.
fn warn(report: &Report, what: What<'_>, warnings: &mut Warnings) {
    if report.turned && matches!(what, What::Heights) {
        warnings.add("bake-turned", || {
            "the dense mesh faces the other way than the cage: it is taken as turned".to_owned()
        });
    }
    if report.missed > 0 && matches!(what, What::Vectors { .. }) {
        let Report { missed, texels, .. } = report;
        warnings.add("bake-missed", || {
            format!(
                "{missed} of {texels} texels have texture coordinates that the dense mesh has not: they are filled from \
                 around"
            )
        });
    } else if report.missed > 0 {
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

/// Nothing was met anywhere.
fn nothing_met(reach: f64, faced_away: u64) -> Fault {
    let message = format!("no normal of the cage's limit surface meets it within {reach}");
    Fault::new(message).advise(match faced_away {
        0 => "see whether both meshes lie in the same place at the same size, or raise --reach",
        _ => "parts of it that face away are not met: give --two-sided, or turn its faces",
    })
}
