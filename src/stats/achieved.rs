//! How far compression moved the micro-vertices of a scene, or how thick the slabs are that stand for them.

use serde::Serialize;

/// Of all objects that are traced by a method that moves them, or has slabs instead.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct AchievedError {
    /// The farthest, in diagonals of its object's box.
    pub max_diagonals: f64,
    /// The root of the mean square over all micro-vertices, or all slabs, in diagonals of their objects' boxes.
    pub rms_diagonals: f64,
    /// The farthest, in pixels at its object's closest view; none where no pixels are known.
    pub max_pixels: Option<f64>,
    /// How many there are.
    #[serde(skip)]
    pub vertices: u64,
}

impl AchievedError {
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
        let of = |max, rms, vertices, max_pixels| AchievedError {
            max_diagonals: max,
            rms_diagonals: rms,
            max_pixels,
            vertices,
        };
        let all = [
            Some(of(0.1, 0.05, 300, None)),
            None,
            Some(of(0.04, 0.01, 100, Some(0.8))),
        ];
        let all = AchievedError::of_all(all).expect("two have one");
        assert_eq!((all.max_diagonals, all.max_pixels), (0.1, Some(0.8)));
        let expected = ((3.0 * 0.05 * 0.05 + 0.01 * 0.01_f64) / 4.0).sqrt();
        assert!((all.rms_diagonals - expected).abs() < 1e-12);
        assert_eq!(AchievedError::of_all([None]), None);
    }
}
