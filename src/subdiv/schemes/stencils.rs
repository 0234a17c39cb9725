//! Weighted sums of points, written once and applied to everything that follows the points.

use crate::math::{DVec3, Vec3};

/// A row of (point, weight) for each new point. Sums are in f64: a vertex of valence 64 adds 65 terms.
#[derive(Debug)]
pub(super) struct Stencils {
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

impl Stencils {
    /// No rows, with room for `rows` of them.
    pub(super) fn with_capacity(rows: usize) -> Self {
        let mut starts = Vec::with_capacity(rows + 1);
        starts.push(0);
        Self {
            starts,
            entries: Vec::with_capacity(rows.saturating_mul(5)),
        }
    }

    /// Adds a term to the row being written; a point may occur more than once.
    pub(super) fn add(&mut self, point: u32, weight: f64) {
        if weight != 0.0 {
            self.entries.push((point, weight));
        }
    }

    /// Ends the row being written.
    pub(super) fn end_row(&mut self) {
        self.starts.push(self.entries.len());
    }

    fn rows(&self) -> impl Iterator<Item = &[(u32, f64)]> {
        self.starts.windows(2).map(|w| &self.entries[w[0]..w[1]])
    }

    /// The new points.
    pub(super) fn points(&self, points: &[Vec3]) -> Vec<Vec3> {
        let sum = |row: &[(u32, f64)]| {
            row.iter()
                .map(|&(i, w)| points[i as usize].as_dvec3() * w)
                .sum::<DVec3>()
        };
        self.rows().map(|row| sum(row).as_vec3()).collect()
    }

    /// The new elements of `width` numbers each, one for each row; `element` gives the old ones.
    pub(super) fn values<'a>(
        &self,
        width: usize,
        element: impl Fn(usize) -> &'a [f32],
    ) -> Vec<f32> {
        let mut values = Vec::with_capacity((self.starts.len() - 1) * width);
        let mut sum = vec![0.0; width];
        for row in self.rows() {
            sum.fill(0.0);
            for &(i, w) in row {
                for (s, &x) in sum.iter_mut().zip(element(i as usize)) {
                    *s += w * f64::from(x);
                }
            }
            values.extend(sum.iter().map(|&s| s as f32));
        }
        values
    }
}
