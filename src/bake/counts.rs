//! How many texels met the dense mesh, and how far away.

use super::{Found, Report};

/// What became of some texels.
pub(super) struct Counts {
    texels: u64,
    missed: u64,
    faced_away: u64,
    least: f64,
    greatest: f64,
}

impl Default for Counts {
    fn default() -> Self {
        Self {
            texels: 0,
            missed: 0,
            faced_away: 0,
            least: f64::INFINITY,
            greatest: f64::NEG_INFINITY,
        }
    }
}

impl Counts {
    /// Counts what was found, and sets `value` to it if there is one.
    pub(super) fn take(&mut self, found: Found, value: &mut [f32]) -> bool {
        self.texels += u64::from(found != Found::NoSurface);
        match found {
            Found::Value(all) => {
                value.copy_from_slice(&all[..value.len()]);
                let amount = match *value {
                    [height] => f64::from(height),
                    _ => length(value),
                };
                self.least = self.least.min(amount);
                self.greatest = self.greatest.max(amount);
                return true;
            }
            Found::Missed { faced_away } => {
                self.missed += 1;
                self.faced_away += u64::from(faced_away);
            }
            Found::NoSurface => {}
        }
        false
    }

    /// Both together.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            texels: self.texels + other.texels,
            missed: self.missed + other.missed,
            faced_away: self.faced_away + other.faced_away,
            least: self.least.min(other.least),
            greatest: self.greatest.max(other.greatest),
        }
    }

    /// Tells a report.
    pub(super) fn tell(self, report: &mut Report) {
        (report.texels, report.missed, report.faced_away) =
            (self.texels, self.missed, self.faced_away);
        if self.missed < self.texels {
            (report.least, report.greatest) = (self.least, self.greatest);
        }
    }
}

fn length(vector: &[f32]) -> f64 {
    let squares = vector.iter().map(|&x| f64::from(x) * f64::from(x));
    squares.sum::<f64>().sqrt()
}
