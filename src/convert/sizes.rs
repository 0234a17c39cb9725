//! How long a Ptex face is, and how many texels that makes.

use relievo_ptex::{MAX_LOG2, MeshType};

use crate::math::DVec3;

/// How much too few texels are still enough, as a logarithm: 3 in 100. What covers 16 texels but for rounding shall not
/// have 32.
pub(super) const SLACK: f64 = 0.05;
/// Pieces of a line over a face that is measured.
const PIECES: u32 = 8;

/// How long a face is along u and v: the longest of some lines over it. Triangles are as long both ways.
pub(crate) fn lengths(kind: MeshType, at: impl Fn([f64; 2]) -> Option<DVec3>) -> [f64; 2] {
    let length = |from: [f64; 2], to: [f64; 2]| {
        let points = (0..=PIECES).map(|i| {
            let t = f64::from(i) / f64::from(PIECES);
            at([0, 1].map(|c| from[c] + t * (to[c] - from[c])))
        });
        let points: Option<Vec<_>> = points.collect();
        let pieces = points.iter().flat_map(|points| points.windows(2));
        pieces.map(|p| p[0].distance(p[1])).sum::<f64>()
    };
    match kind {
        MeshType::Triangle => {
            let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
            let sides = [0, 1, 2].map(|i| length(corners[i], corners[(i + 1) % 3]));
            [sides.into_iter().fold(0.0, f64::max); 2]
        }
        MeshType::Quad => [0, 1].map(|axis| {
            let lines = [0.0, 0.5, 1.0].map(|across| {
                let (mut from, mut to) = ([across; 2], [across; 2]);
                (from[axis], to[axis]) = (0.0, 1.0);
                length(from, to)
            });
            lines.into_iter().fold(0.0, f64::max)
        }),
    }
}

/// The logarithm of the number of texels for a length in texels.
pub(crate) fn log2(length: f64) -> i8 {
    (length.max(1.0).log2() - SLACK)
        .ceil()
        .clamp(0.0, f64::from(MAX_LOG2)) as i8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_enough_texels_and_not_twice_as_many() {
        for (length, wanted) in [
            (0.0, 0),
            (1.0, 0),
            (1.5, 1),
            (16.0, 4),
            (16.0001, 4),
            (17.0, 5),
            (f64::NAN, 0),
            (f64::INFINITY, MAX_LOG2),
        ] {
            assert_eq!(log2(length), wanted, "{length}");
        }
    }
}
