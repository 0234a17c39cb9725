//! The function along an edge, the same for both sides.

use super::topology::{Beyond, Side};
use super::{Grid, Lookup, Value, lerp};
use crate::error::Result;

/// An edge between vertices. Its parameter runs from 0 to 1 along the side that owns it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rim {
    owner: Side,
    other: Other,
}

/// The other side.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Other {
    None,
    Edge(Side),
    /// Half an edge of a face: the first or the second.
    Half(Side, usize),
}

/// Both sides' texels, and how they are weighed.
pub(super) struct Rows<'a> {
    owner: (Grid<'a>, usize),
    /// Their weight, as a part of one, is the last.
    other: Option<(Grid<'a>, usize, f32)>,
    /// Places along the rim at which it has values, one in the middle of each of so many equal parts.
    pub(super) count: usize,
}

impl Rim {
    /// The rim at `t` along a side, and where on the rim that is. Sides with two rims have the second from ½ on.
    pub(super) fn at(lookup: &Lookup, side: Side, t: f32) -> (Self, f32) {
        let half = usize::from(t >= 0.5);
        let rim = Self::of(lookup, side)[half];
        let s = match rim.other {
            _ if rim.owner == side => t,
            Other::Half(..) => (1 + half) as f32 - 2.0 * t,
            _ => 1.0 - t,
        };
        // What one side sees as `1 - t` has no more digits than this, and the other side must see the same.
        let digits = match rim.other {
            Other::Half(..) => 23,
            _ => 24,
        };
        let steps = (1_u32 << digits) as f32;
        (rim, (s * steps).round_ties_even() / steps)
    }

    /// The rims of a side's two halves; mostly the same.
    pub(super) fn of(lookup: &Lookup, side: Side) -> [Self; 2] {
        let one = |owner, other| [Self { owner, other }; 2];
        match Beyond::of(lookup.reader, side) {
            Beyond::Nothing => one(side, Other::None),
            Beyond::Edge(other) => one(side.min(other), Other::Edge(side.max(other))),
            Beyond::HalfOf(other, half) => one(side, Other::Half(other, half)),
            Beyond::Halves(owners) => [0, 1].map(|half| Self {
                owner: owners[half],
                other: Other::Half(side, half),
            }),
        }
    }

    /// The function at `s`.
    pub(super) fn eval(&self, lookup: &Lookup, s: f32) -> Result<Value> {
        if s == 0.0 {
            return self.start(lookup);
        } else if s == 1.0 {
            return self.end(lookup);
        }
        let rows = self.rows(lookup)?;
        let count = rows.count as f32;
        let (place, from_end) = (s * count, (1.0 - s) * count);
        if place < 0.5 {
            Ok(lerp(
                self.start(lookup)?,
                self.value(lookup, &rows, 0)?,
                2.0 * place,
            ))
        } else if from_end < 0.5 {
            let last = self.value(lookup, &rows, rows.count - 1)?;
            Ok(lerp(self.end(lookup)?, last, 2.0 * from_end))
        } else {
            let p = place - 0.5;
            let first = (p as usize).min(rows.count - 1);
            let value = self.value(lookup, &rows, first)?;
            let part = p - first as f32;
            if part == 0.0 {
                return Ok(value);
            }
            Ok(lerp(value, self.value(lookup, &rows, first + 1)?, part))
        }
    }

    pub(super) fn start(&self, lookup: &Lookup) -> Result<Value> {
        lookup.vertex(self.owner)
    }

    pub(super) fn end(&self, lookup: &Lookup) -> Result<Value> {
        lookup.vertex(self.owner.next())
    }

    /// What is needed for its values.
    pub(super) fn rows<'a>(&self, lookup: &Lookup<'a>) -> Result<Rows<'a>> {
        let owner = (lookup.grid(self.owner.face)?, self.owner.edge);
        let length = owner.0.length(owner.1);
        let (other, count) = match self.other {
            Other::None => (None, length),
            Other::Edge(side) | Other::Half(side, _) => {
                let grid = lookup.grid(side.face)?;
                let across = |grid: &Grid, edge: usize| grid.density[1 - (edge & 1)];
                let (a, b) = (across(&owner.0, owner.1), across(&grid, side.edge));
                let theirs = match self.other {
                    Other::Half(..) => grid.length(side.edge) / 2,
                    _ => grid.length(side.edge),
                };
                (Some((grid, side.edge, b / (a + b))), length.max(theirs))
            }
        };
        Ok(Rows {
            owner,
            other,
            count,
        })
    }

    /// One of its values, at the middle of a texel of the finer side.
    pub(super) fn value(&self, lookup: &Lookup, rows: &Rows, i: usize) -> Result<Value> {
        let s = (i as f32 + 0.5) / rows.count as f32;
        let (grid, edge) = &rows.owner;
        let own = row(lookup, grid, *edge, s)?;
        let Some((grid, edge, weight)) = &rows.other else {
            return Ok(own);
        };
        let t = match self.other {
            Other::Half(_, half) => 0.5 * ((1 + half) as f32 - s),
            _ => 1.0 - s,
        };
        Ok(lerp(own, row(lookup, grid, *edge, t)?, *weight))
    }

    /// Where along a side that `Rim::of` gave this one for a half of it, the rim has `s`.
    pub(super) fn along(&self, side: Side, s: f32) -> f32 {
        match self.other {
            _ if self.owner == side => s,
            Other::Half(_, half) => 0.5 * ((1 + half) as f32 - s),
            _ => 1.0 - s,
        }
    }
}

/// Between the middles of the texels along an edge, at `t` of its length.
fn row(lookup: &Lookup, grid: &Grid, edge: usize, t: f32) -> Result<Value> {
    let length = grid.length(edge);
    let p = (t * length as f32 - 0.5).clamp(0.0, (length - 1) as f32);
    let (first, part) = (p as usize, p - p.floor());
    let value = lookup.texel(grid, grid.along(edge, first))?;
    if part == 0.0 {
        return Ok(value);
    }
    Ok(lerp(
        value,
        lookup.texel(grid, grid.along(edge, first + 1))?,
        part,
    ))
}
