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
    /// How far what is displaced along linear normals is from what unit normals would make of the same heights, by a method
    /// that has linear ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear_normals: Option<Spread>,
    /// How many there are.
    #[serde(skip)]
    pub vertices: u64,
}

/// A distance at many places, in diagonals of their objects' boxes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spread {
    /// The largest.
    pub max_diagonals: f64,
    /// The root of the mean square.
    pub rms_diagonals: f64,
}

/// Distances as they are measured, in any unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Distances {
    largest: f64,
    squares: f64,
    count: u64,
}

impl Distances {
    /// One more.
    pub(crate) fn include(&mut self, distance: f64) {
        self.largest = self.largest.max(distance);
        self.squares += distance * distance;
        self.count += 1;
    }

    /// These and those.
    #[must_use]
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            squares: self.squares + other.squares,
            count: self.count + other.count,
        }
    }

    /// In diagonals of this length.
    pub(crate) fn spread(&self, diagonal: f64) -> Spread {
        Spread {
            max_diagonals: self.largest / diagonal,
            rms_diagonals: (self.squares / self.count.max(1) as f64).sqrt() / diagonal,
        }
    }
}

impl Spread {
    /// Of so many places and so many others.
    fn and(self, other: Self, places: [u64; 2]) -> Self {
        let [a, b] = places.map(|places| places as f64);
        let squares = a * self.rms_diagonals.powi(2) + b * other.rms_diagonals.powi(2);
        Self {
            max_diagonals: self.max_diagonals.max(other.max_diagonals),
            rms_diagonals: (squares / (a + b).max(1.0)).sqrt(),
        }
    }
}

impl AchievedError {
    /// That of these objects and those.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let places = [self.vertices, other.vertices];
        let own = |error: Self| Spread {
            max_diagonals: error.max_diagonals,
            rms_diagonals: error.rms_diagonals,
        };
        let all = own(self).and(own(other), places);
        let pixels = [self.max_pixels, other.max_pixels].into_iter().flatten();
        let linear = [self, other].map(|error| error.linear_normals);
        let [a, b] = linear.map(Option::unwrap_or_default);
        Self {
            max_diagonals: all.max_diagonals,
            rms_diagonals: all.rms_diagonals,
            max_pixels: pixels.reduce(f64::max),
            linear_normals: linear.iter().any(Option::is_some).then(|| a.and(b, places)),
            vertices: places.iter().sum(),
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
            linear_normals: max_pixels.map(|_| Spread {
                max_diagonals: 0.5 * max,
                rms_diagonals: 2.0 * rms,
            }),
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
        let linear = all.linear_normals.expect("one has it");
        assert!((linear.rms_diagonals - 0.01).abs() < 1e-12 && linear.max_diagonals == 0.02);
        assert_eq!(AchievedError::of_all([None]), None);
    }
}
