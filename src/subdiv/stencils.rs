//! Weighted sums of points, written once and applied to everything that follows the points.

/// A row of (point, weight) for each new point. Sums are in f64: a vertex of valence 64 adds 129 terms.
#[derive(Debug, Clone)]
pub(super) struct Stencils {
    starts: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Stencils {
    /// No rows, with room for `rows` of them.
    pub(super) fn with_capacity(rows: usize) -> Self {
        let mut starts = Vec::with_capacity(rows + 1);
        starts.push(0);
        Self {
            starts,
            entries: Vec::with_capacity(rows.saturating_mul(6)),
        }
    }

    /// How many rows are finished.
    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Adds a term to the row being written; a point may occur more than once.
    pub(super) fn add(&mut self, point: u32, weight: f64) {
        if weight != 0.0 {
            self.entries.push((point, weight));
        }
    }

    /// Ends the row being written: terms of one point become one.
    pub(super) fn end_row(&mut self) {
        let start = self.starts[self.len()] as usize;
        let row = &mut self.entries[start..];
        row.sort_by_key(|e| e.0);
        let mut kept = 0;
        for i in 1..row.len() {
            if row[i].0 == row[kept].0 {
                row[kept].1 += row[i].1;
            } else {
                kept += 1;
                row[kept] = row[i];
            }
        }
        if !row.is_empty() {
            self.entries.truncate(start + kept + 1);
        }
        self.starts.push(self.entries.len() as u32);
    }

    /// The terms of a row, by ascending point.
    pub(super) fn row(&self, row: usize) -> &[(u32, f64)] {
        &self.entries[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// All rows.
    pub(super) fn rows(&self) -> impl Iterator<Item = &[(u32, f64)]> {
        (0..self.len()).map(|i| self.row(i))
    }

    /// The new values of `width` numbers each, one for each row.
    pub(super) fn apply(&self, width: usize, values: &[f64]) -> Vec<f64> {
        let mut new = vec![0.0; self.len() * width];
        for (new, row) in new.chunks_exact_mut(width.max(1)).zip(self.rows()) {
            for &(point, weight) in row {
                let value = &values[point as usize * width..][..width];
                for (sum, &x) in new.iter_mut().zip(value) {
                    *sum += weight * x;
                }
            }
        }
        new
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(self.entries.as_slice())
    }
}
