//! Choosing among weights: piecewise constant distributions in one and two dimensions, by binary search in
//! cumulated sums.
//!
//! A probability is always the difference of two stored sums, so what [`Steps::pick`] does and what
//! [`Steps::probability`] says agree to the last bit, however the sums were rounded.

/// A choice among finitely many, each with a probability.
#[derive(Debug, Clone)]
pub(super) struct Steps {
    /// Starts with 0, ends with 1, ascending: one more than there are choices.
    sums: Vec<f32>,
}

impl Steps {
    /// Probabilities in proportion to `weights`, finite and at least 0; equal ones if all are 0.
    pub(super) fn new(weights: &[f32]) -> Self {
        let mut sums = Vec::with_capacity(weights.len() + 1);
        push_sums(&mut sums, weights);
        Self { sums }
    }

    /// The choice that `u` in 0..1 falls on, and where in it, 0..1.
    #[inline]
    pub(super) fn pick(&self, u: f32) -> (usize, f32) {
        pick(&self.sums, u)
    }

    /// How likely choice `i` is.
    pub(super) fn probability(&self, i: usize) -> f32 {
        self.sums[i + 1] - self.sums[i]
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.sums.capacity() * size_of::<f32>()
    }
}

/// A choice among the cells of a grid: first the row, then the cell in it.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    width: usize,
    height: usize,
    rows: Steps,
    /// For each row, `width + 1` sums.
    cells: Vec<f32>,
}

impl Grid {
    /// Probabilities in proportion to `weights`, row by row; `width` is above 0 and divides their number.
    pub(super) fn new(width: usize, weights: &[f32]) -> Self {
        let height = weights.len() / width;
        let mut cells = Vec::with_capacity((width + 1) * height);
        let mut totals = Vec::with_capacity(height);
        for row in weights.chunks_exact(width) {
            totals.push(push_sums(&mut cells, row) as f32);
        }
        Self {
            width,
            height,
            rows: Steps::new(&totals),
            cells,
        }
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The cell (column, row) that `u` falls on, and where in it, 0..1 each.
    pub(super) fn pick(&self, u: [f32; 2]) -> ([usize; 2], [f32; 2]) {
        let (y, fy) = self.rows.pick(u[1]);
        let (x, fx) = pick(self.row(y), u[0]);
        ([x, y], [fx, fy])
    }

    /// How likely the cell is.
    pub(super) fn probability(&self, [x, y]: [usize; 2]) -> f32 {
        let row = self.row(y);
        self.rows.probability(y) * (row[x + 1] - row[x])
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.rows.memory() + self.cells.capacity() * size_of::<f32>()
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.cells[y * (self.width + 1)..(y + 1) * (self.width + 1)]
    }
}

/// Appends the cumulated sums of `weights`, scaled to end with 1; returns their total.
fn push_sums(sums: &mut Vec<f32>, weights: &[f32]) -> f64 {
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let even = 1.0 / weights.len() as f64;
    let mut sum = 0.0;
    sums.push(0.0);
    for (i, &w) in weights.iter().enumerate() {
        sum += if total > 0.0 {
            f64::from(w) / total
        } else {
            even
        };
        let last = i + 1 == weights.len();
        sums.push(if last { 1.0 } else { sum.min(1.0) as f32 });
    }
    total
}

/// The step of `sums` that holds `u`; never one of no width, because `u` lies below its end and not below its
/// start.
#[inline]
fn pick(sums: &[f32], u: f32) -> (usize, f32) {
    let u = u.clamp(0.0, ONE_BELOW);
    let i = sums.partition_point(|&s| s <= u).clamp(1, sums.len() - 1) - 1;
    let width = sums[i + 1] - sums[i];
    let within = if width > 0.0 {
        (u - sums[i]) / width
    } else {
        0.5
    };
    (i, within.clamp(0.0, ONE_BELOW))
}

/// The largest number below 1.
const ONE_BELOW: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_come_as_often_as_they_should_and_empty_ones_never() {
        let steps = Steps::new(&[0.0, 1.0, 0.0, 3.0, 0.0]);
        let mut count = [0; 5];
        for i in 0..4000 {
            count[steps.pick((i as f32 + 0.5) / 4000.0).0] += 1;
        }
        assert_eq!(count, [0, 1000, 0, 3000, 0]);
        assert_eq!(steps.pick(0.0).0, 1);
        assert!((steps.probability(3) - 0.75).abs() < 1e-6);
    }

    #[test]
    fn a_grid_without_weight_is_even() {
        let grid = Grid::new(4, &[0.0; 8]);
        assert_eq!(grid.size(), [4, 2]);
        for x in 0..4 {
            assert!((grid.probability([x, 1]) - 0.125).abs() < 1e-6);
        }
    }
}
