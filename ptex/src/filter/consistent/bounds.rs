//! Between which values lookups in a part of a face lie: a pyramid of bounds, for those who intersect displaced
//! surfaces.
//!
//! A lookup interpolates. Within the square of one texel it takes part of that texel and of the eight around it; at an
//! edge also of the edge's values over that texel and the next to either side. The bounds of a square are those of all
//! that; four squares make the next larger one.

use super::rim::Rim;
use super::topology::Side;
use super::{Consistent, LANES, Lookup, Value};
use crate::error::Result;
use crate::reader::Reader;

/// Widens bounds for the rounding of what they bound: a lookup nests up to four interpolations, each of which may be
/// off by two units in the last place of the largest value in it.
const ROUNDING: f32 = 16.0 * f32::EPSILON;

/// The lowest and the highest that lookups in a face can give, for any part of it.
#[derive(Clone, Debug)]
pub struct FaceBounds {
    channels: usize,
    /// How often the finest level kept is halved.
    finest: u8,
    /// From fine to coarse, down to a single square.
    levels: Vec<Level>,
}

/// Bounds of squares, row after row, those of a square's channels side by side.
#[derive(Clone, Debug)]
struct Level {
    /// Columns and rows.
    size: [usize; 2],
    bounds: Vec<[f32; 2]>,
}

impl FaceBounds {
    pub(super) fn new(
        consistent: &Consistent,
        reader: &Reader,
        face: u32,
        first_channel: usize,
        channels: usize,
        finest: u8,
    ) -> Result<Self> {
        let res = consistent.res(reader, face);
        let mut level = Level::new([1 << res.ulog2, 1 << res.vlog2], channels);
        for from in (0..channels).step_by(LANES) {
            let lookup = Lookup {
                of: consistent,
                reader,
                first: first_channel + from,
                count: (channels - from).min(LANES),
            };
            let mut lanes = Lanes {
                level: &mut level,
                lookup,
                channels,
                from,
            };
            lanes.add_texels(face)?;
            (0..4).try_for_each(|edge| lanes.add_rim(Side::new(face, edge)))?;
        }
        let one = reader.data_type().one();
        for [low, high] in &mut level.bounds {
            let margin = ROUNDING * low.abs().max(high.abs());
            (*low, *high) = ((*low - margin) / one, (*high + margin) / one);
        }

        let mut levels = vec![];
        let mut halvings = 0;
        loop {
            let last = level.size == [1, 1];
            let next = (!last).then(|| level.halved(channels));
            if halvings >= finest || last {
                levels.push(level);
            }
            match next {
                Some(next) => level = next,
                None => break,
            }
            halvings += 1;
        }
        Ok(Self {
            channels,
            finest: finest.min(halvings),
            levels,
        })
    }

    /// The lowest and the highest in the rectangle from `u[0]` to `u[1]` and from `v[0]` to `v[1]`, for one of the
    /// channels that this was made for. A little more than the rectangle may be looked at.
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn range(&self, u: [f32; 2], v: [f32; 2], channel: usize) -> [f32; 2] {
        assert!(
            channel < self.channels,
            "channel {channel} of {}",
            self.channels
        );
        let finest = self.levels[0].size;
        let squares = |[from, to]: [f32; 2], size: usize| {
            let square = |x: f32| (x.clamp(0.0, 1.0) * size as f32) as usize;
            [square(from), square(to)].map(|x| x.min(size - 1))
        };
        let (mut x, mut y) = (squares(u, finest[0]), squares(v, finest[1]));
        // Up to where two squares a side cover it.
        let mut level = &self.levels[0];
        for next in &self.levels[1..] {
            if x[1].saturating_sub(x[0]) <= 1 && y[1].saturating_sub(y[0]) <= 1 {
                break;
            }
            if next.size[0] < level.size[0] {
                x = x.map(|x| x / 2);
            }
            if next.size[1] < level.size[1] {
                y = y.map(|y| y / 2);
            }
            level = next;
        }
        let mut range = NOTHING;
        for y in y[0]..=y[1] {
            for x in x[0]..=x[1] {
                let at = (y * level.size[0] + x) * self.channels + channel;
                join(&mut range, level.bounds[at]);
            }
        }
        range
    }

    /// The lowest and the highest in the whole face.
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn whole(&self, channel: usize) -> [f32; 2] {
        self.range([0.0, 1.0], [0.0, 1.0], channel)
    }

    /// How many texels, as a logarithm, the squares that are told apart have on a side.
    #[must_use]
    pub fn finest(&self) -> u8 {
        self.finest
    }

    /// Bytes that it takes.
    #[must_use]
    pub fn memory(&self) -> usize {
        let bounds = |level: &Level| size_of_val(level.bounds.as_slice());
        self.levels.iter().map(bounds).sum()
    }
}

/// Bounds of no value.
const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn join(range: &mut [f32; 2], [low, high]: [f32; 2]) {
    range[0] = range[0].min(low);
    range[1] = range[1].max(high);
}

impl Level {
    fn new(size: [usize; 2], channels: usize) -> Self {
        Self {
            size,
            bounds: vec![NOTHING; size[0] * size[1] * channels],
        }
    }

    /// Half the columns and half the rows, where there are two.
    fn halved(&self, channels: usize) -> Self {
        let shift = self.size.map(|n| usize::from(n > 1));
        let mut half = Self::new(
            [self.size[0] >> shift[0], self.size[1] >> shift[1]],
            channels,
        );
        for (at, bounds) in self.bounds.iter().enumerate() {
            let (square, channel) = (at / channels, at % channels);
            let (x, y) = (square % self.size[0], square / self.size[0]);
            let to = (y >> shift[1]) * half.size[0] + (x >> shift[0]);
            join(&mut half.bounds[to * channels + channel], *bounds);
        }
        half
    }
}

/// A few channels of a level that is being made. Bounds are in stored units.
struct Lanes<'a> {
    level: &'a mut Level,
    lookup: Lookup<'a>,
    channels: usize,
    /// The first of the few.
    from: usize,
}

impl Lanes<'_> {
    fn add(&mut self, x: usize, y: usize, value: &Value) {
        let at = (y * self.level.size[0] + x) * self.channels + self.from;
        let bounds = &mut self.level.bounds[at..][..self.lookup.count];
        for (bounds, value) in bounds.iter_mut().zip(value) {
            join(bounds, [*value; 2]);
        }
    }

    /// To each square its texel and those around it.
    fn add_texels(&mut self, face: u32) -> Result<()> {
        let grid = self.lookup.grid(face)?;
        let [width, height] = grid.size;
        for y in 0..height {
            for x in 0..width {
                let value = self.lookup.texel(&grid, [x, y])?;
                for to_y in y.saturating_sub(1)..(y + 2).min(height) {
                    for to_x in x.saturating_sub(1)..(x + 2).min(width) {
                        self.add(to_x, to_y, &value);
                    }
                }
            }
        }
        Ok(())
    }

    /// To each square along an edge the edge's values over it, and those before and after.
    fn add_rim(&mut self, side: Side) -> Result<()> {
        let mut values: Vec<(f32, Value)> = vec![];
        let mut add = |lookup: &Lookup, rim: &Rim| -> Result<()> {
            let rows = rim.rows(lookup)?;
            values.push((rim.along(side, 0.0), rim.start(lookup)?));
            for i in 0..rows.count {
                let s = (i as f32 + 0.5) / rows.count as f32;
                values.push((rim.along(side, s), rim.value(lookup, &rows, i)?));
            }
            values.push((rim.along(side, 1.0), rim.end(lookup)?));
            Ok(())
        };
        let [first, second] = Rim::of(&self.lookup, side);
        add(&self.lookup, &first)?;
        if second != first {
            add(&self.lookup, &second)?;
        }
        values.sort_by(|a, b| a.0.total_cmp(&b.0));

        let grid = self.lookup.grid(side.face)?;
        let length = grid.length(side.edge);
        for i in 0..length {
            let [from, to] = [i, i + 1].map(|i| i as f32 / length as f32);
            let before = values.partition_point(|(t, _)| *t < from).saturating_sub(1);
            let after = values
                .partition_point(|(t, _)| *t <= to)
                .min(values.len() - 1);
            let [x, y] = grid.along(side.edge, i);
            for (_, value) in &values[before..=after] {
                self.add(x, y, value);
            }
        }
        Ok(())
    }
}
