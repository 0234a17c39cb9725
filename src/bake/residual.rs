//! How far a baked file, read as a render reads it, is from the dense mesh.

use rayon::prelude::*;
use serde::Serialize;

use super::{Found, Run, Source};
use crate::error::Result;

/// Distances between what is read at the corners of texels, which lie furthest from what was looked at, and what is
/// found of the dense mesh there: of heights along the normal, or of vectors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Residual {
    /// Places that were compared.
    pub places: u64,
    /// Places from which nothing was met, and that were not.
    pub missed: u64,
    /// The root of the mean of the squares.
    pub rms: f64,
    /// The largest one.
    pub largest: f64,
}

/// Compares face by face. `read` hands out places of a face with what is read there.
///
/// # Errors
/// If interrupted.
pub(super) fn of(
    source: &dyn Source,
    faces: usize,
    run: Run<'_>,
    read: impl Fn(usize, &mut dyn FnMut([f64; 2], [f32; 4])) + Sync,
) -> Result<Residual> {
    run.progress.stage("check", faces as u64);
    let channels = source.channels();
    let each: Vec<Sum> = (0..faces)
        .into_par_iter()
        .map(|face| {
            let mut sum = Sum::default();
            read(face, &mut |uv, value| {
                if run.goes_on() {
                    sum.add(source.find(face as u32, uv), value, channels);
                }
            });
            run.progress.by(1);
            sum
        })
        .collect();
    run.check()?;
    Ok(each.into_iter().fold(Sum::default(), Sum::and).residual())
}

#[derive(Default)]
struct Sum {
    places: u64,
    missed: u64,
    squares: f64,
    largest: f64,
}

impl Sum {
    fn add(&mut self, found: Found, read: [f32; 4], channels: usize) {
        match found {
            Found::Value(value) => {
                let off = (0..channels).map(|c| f64::from(value[c]) - f64::from(read[c]));
                let square = off.map(|off| off * off).sum::<f64>();
                self.places += 1;
                self.squares += square;
                self.largest = self.largest.max(square.sqrt());
            }
            Found::Missed { .. } => self.missed += 1,
            Found::NoSurface => {}
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            places: self.places + other.places,
            missed: self.missed + other.missed,
            squares: self.squares + other.squares,
            largest: self.largest.max(other.largest),
        }
    }

    fn residual(self) -> Residual {
        Residual {
            places: self.places,
            missed: self.missed,
            rms: (self.squares / (self.places.max(1)) as f64).sqrt(),
            largest: self.largest,
        }
    }
}
