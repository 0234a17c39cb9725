//! How far micro-vertices may be moved by compression, and how far they were.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::stats::AchievedError;

/// The farthest that a micro-vertex may be moved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub enum MaxError {
    /// 3.6e-5 diagonals of the object. Roundings are even within a cube: along a normal, the root of their mean square
    /// is 1 / sqrt(18) of that over a triangle, below 1e-5. And no more than a quarter of a pixel at the closest view, where there is one.
    #[default]
    Usual,
    /// Pixels at the closest view of the object, above 0.
    Pixels(f32),
    /// Diagonals of the object's box, above 0.
    Diagonals(f32),
    /// Units of the object, above 0.
    Units(f32),
}

const USUAL_DIAGONALS: f32 = 3.6e-5;
const USUAL_PIXELS: f32 = 0.25;

impl MaxError {
    /// In units of an object of this diagonal, of which a unit covers so many pixels at the closest view.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is in pixels, and there is no view.
    pub(in crate::accel) fn units(
        self,
        diagonal: f32,
        pixels_per_unit: Option<f32>,
    ) -> Result<f32> {
        match (self, pixels_per_unit) {
            (Self::Usual, None) => Ok(USUAL_DIAGONALS * diagonal),
            (Self::Usual, Some(pixels)) => {
                Ok((USUAL_DIAGONALS * diagonal).min(USUAL_PIXELS / pixels))
            }
            (Self::Pixels(error), Some(pixels)) => Ok(error / pixels),
            // Without an extent there is nothing to be moved.
            (Self::Pixels(_), None) if diagonal <= 0.0 => Ok(0.0),
            (Self::Pixels(error), None) => Err(Error::usage(
                format!("an error of {error} pixels, where no pixels are known"),
                "dice by pixels too, with --dicing-rate, or give the error in diagonals: --max-error 1e-5",
            )),
            (Self::Diagonals(error), _) => Ok(error * diagonal),
            (Self::Units(error), _) => Ok(error),
        }
    }
}

/// How far micro-vertices were moved, in units of the object.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Accuracy {
    /// The farthest that was asked for.
    pub asked: f64,
    /// The farthest. More than was asked for only where the lattice, of 24 bits, is too coarse for that.
    pub max: f64,
    /// The root of the mean square. The distance to the surface has about 0.6 of it.
    pub rms: f64,
    /// How many there are, at all motion keys.
    pub vertices: u64,
    /// The diagonal of the box around what the object's faces share.
    pub diagonal: f64,
    /// Pixels that a unit covers at the closest view; none where no pixels are known.
    pub pixels_per_unit: Option<f64>,
}

impl Accuracy {
    /// The same in diagonals and pixels.
    pub fn achieved(&self) -> AchievedError {
        let diagonals = |error: f64| match self.diagonal {
            diagonal if diagonal > 0.0 => error / diagonal,
            _ => 0.0,
        };
        AchievedError {
            max_diagonals: diagonals(self.max),
            rms_diagonals: diagonals(self.rms),
            max_pixels: (self.pixels_per_unit).map(|pixels| pixels * self.max),
            linear_normals: None,
            vertices: self.vertices,
        }
    }
}
