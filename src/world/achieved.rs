//! How far compression moved the micro-vertices of a scene.

use serde::Serialize;

use crate::accel::Accuracy;

/// Of all objects that are traced by a method that moves them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct AchievedError {
    /// The farthest, in diagonals of its object's box.
    pub max_diagonals: f64,
    /// The root of the mean square over all micro-vertices, in diagonals of their objects' boxes.
    pub rms_diagonals: f64,
    /// The farthest, in pixels at its object's closest view; none where no pixels are known.
    pub max_pixels: Option<f64>,
    #[serde(skip)]
    vertices: u64,
}

impl AchievedError {
    /// That of one object.
    pub fn of(accuracy: &Accuracy) -> Self {
        let diagonals = |error: f64| match accuracy.diagonal {
            diagonal if diagonal > 0.0 => error / diagonal,
            _ => 0.0,
        };
        Self {
            max_diagonals: diagonals(accuracy.max),
            rms_diagonals: diagonals(accuracy.rms),
            max_pixels: (accuracy.pixels_per_unit).map(|pixels| pixels * accuracy.max),
            vertices: accuracy.vertices,
        }
    }

    /// That of these objects and those.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let squares = |error: Self| error.vertices as f64 * error.rms_diagonals.powi(2);
        let vertices = self.vertices + other.vertices;
        let pixels = [self.max_pixels, other.max_pixels].into_iter().flatten();
        Self {
            max_diagonals: self.max_diagonals.max(other.max_diagonals),
            rms_diagonals: ((squares(self) + squares(other)) / vertices.max(1) as f64).sqrt(),
            max_pixels: pixels.reduce(f64::max),
            vertices,
        }
    }

    /// That of several: none if none of them has one.
    pub fn of_all(all: impl IntoIterator<Item = Option<Self>>) -> Option<Self> {
        all.into_iter().flatten().reduce(Self::and)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_count_by_their_vertices() {
        let of = |max, rms, vertices, pixels_per_unit| {
            AchievedError::of(&Accuracy {
                asked: 1.0,
                max,
                rms,
                vertices,
                diagonal: 10.0,
                pixels_per_unit,
            })
        };
        let all = [
            Some(of(1.0, 0.5, 300, None)),
            None,
            Some(of(0.4, 0.1, 100, Some(2.0))),
        ];
        let all = AchievedError::of_all(all).expect("two have one");
        assert_eq!((all.max_diagonals, all.max_pixels), (0.1, Some(0.8)));
        let expected = ((3.0 * 0.25 + 0.01_f64) / 4.0).sqrt() / 10.0;
        assert!((all.rms_diagonals - expected).abs() < 1e-12);
        assert_eq!(AchievedError::of_all([None]), None);
    }
}
