//! The least and the greatest of a texture's values over any rectangle: a pyramid of minima and maxima, after
//! Williams, "Pyramidal Parametrics" (1983), with extremes in the place of means.
//!
//! The bilinear filter never leaves the range of the texels that it blends, so the texels under a rectangle and one
//! around it bound all that a look-up can give. The finest level has one entry for 4 x 4 texels; smaller rectangles
//! read the texels themselves.

use rayon::prelude::*;

use super::base::UvRect;
use crate::image::{Texture, Wrap};
use crate::math::{Bounds3, Vec2, Vec3};

/// Ranges of a texture's values.
#[derive(Debug, Clone)]
pub struct Pyramid {
    channels: usize,
    tiles: Vec<Tile>,
}

#[derive(Debug, Clone)]
struct Tile {
    number: u32,
    size: [u32; 2],
    /// Level i has an entry for each square of 2^(i + `FINEST`) texels' side.
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    width: u32,
    /// Least and greatest value by channel, row by row from below.
    ranges: Vec<[f32; 2]>,
}

/// Log2 of the side of the finest level's squares.
const FINEST: u32 = 2;

/// A rectangle reaches over at most this many entries of the level that is read, along each side.
const MOST_ENTRIES: u32 = 4;

/// Tiles of a UDIM set that a rectangle is looked up in one by one.
const MOST_TILES: f32 = 64.0;

impl Pyramid {
    /// Over the first `channels` channels, 1 to 3.
    pub fn new(texture: &Texture, channels: usize) -> Self {
        assert!((1..=3).contains(&channels), "{channels} channels");
        let tiles = texture
            .tiles()
            .enumerate()
            .map(|(i, (number, size))| Tile::new(texture, i, number, size, channels))
            .collect();
        Self { channels, tiles }
    }

    /// A box around all values that `texture`, whose pyramid this is, gives in a rectangle of its coordinates.
    /// Channels beyond those of the pyramid are 0.
    pub fn range(&self, texture: &Texture, st: &UvRect) -> Bounds3 {
        if !(st.min.is_finite() && st.max.is_finite()) {
            return self.everything();
        }
        let mut range = Bounds3::EMPTY;
        if texture.is_udim() {
            // The far border of a tile belongs to it where none begins.
            let first = (st.min.ceil() - 1.0).max(Vec2::ZERO);
            let last = st.max.floor();
            let counts = last - st.min.floor() + 1.0;
            if counts.x * counts.y > MOST_TILES {
                return self.everything();
            }
            let mut inside = st.min.cmpge(Vec2::ZERO).all();
            for row in first.y as u32..=last.y.max(0.0) as u32 {
                for column in first.x as u32..=last.x.max(0.0) as u32 {
                    let number = 1001 + column + 10 * row;
                    let found = (column < 10)
                        .then(|| self.tiles.iter().position(|tile| tile.number == number))
                        .flatten();
                    let corner = Vec2::new(column as f32, row as f32);
                    let (min, max) = (st.min - corner, st.max - corner);
                    match found {
                        Some(tile) => {
                            let st = UvRect {
                                min: min.clamp(Vec2::ZERO, Vec2::ONE),
                                max: max.clamp(Vec2::ZERO, Vec2::ONE),
                            };
                            range = range.union(self.tile_range(texture, tile, &st));
                        }
                        None => inside = false,
                    }
                }
            }
            if !inside {
                range = range.including(Vec3::ZERO);
            }
        } else {
            range = self.tile_range(texture, 0, st);
        }
        // Blending rounds a few times.
        let slack = 4.0 * f32::EPSILON * range.min.abs().max(range.max.abs());
        Bounds3 {
            min: range.min - slack,
            max: range.max + slack,
        }
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        let levels = self.tiles.iter().flat_map(|tile| &tile.levels);
        levels
            .map(|level| size_of_val(level.ranges.as_slice()))
            .sum()
    }

    fn everything(&self) -> Bounds3 {
        let mut range = Bounds3::of([Vec3::ZERO]);
        for top in self.tiles.iter().filter_map(|tile| tile.levels.last()) {
            for entry in top.ranges.chunks_exact(self.channels) {
                include(&mut range, entry);
            }
        }
        range
    }

    fn tile_range(&self, texture: &Texture, tile: usize, st: &UvRect) -> Bounds3 {
        let wrap = texture.wrap();
        let Tile { size, .. } = self.tiles[tile];
        let across = spans(wrap[0], st.min.x, st.max.x, size[0]);
        let up = spans(wrap[1], st.min.y, st.max.y, size[1]);
        let mut range = Bounds3::EMPTY;
        for &y in up.inside() {
            for &x in across.inside() {
                self.block_range(texture, tile, x, y, &mut range);
            }
        }
        if across.outside || up.outside {
            range = range.including(Vec3::ZERO);
        }
        range
    }

    /// Widens `range` by the texels of columns `x` and rows `y`, both ends included.
    fn block_range(
        &self,
        texture: &Texture,
        tile: usize,
        x: [u32; 2],
        y: [u32; 2],
        range: &mut Bounds3,
    ) {
        let Tile { levels, .. } = &self.tiles[tile];
        let entries = |shift: u32| [x, y].map(|[low, high]| (high >> shift) - (low >> shift) + 1);
        let few = |shift: u32| entries(shift).into_iter().all(|n| n <= MOST_ENTRIES);
        if few(0) {
            for y in y[0]..=y[1] {
                for x in x[0]..=x[1] {
                    let texel = texture.tile_texel(tile, x, y).to_array();
                    include(range, &texel.map(|v| [v; 2])[..self.channels]);
                }
            }
            return;
        }
        let level = (0..levels.len() as u32)
            .find(|&level| few(level + FINEST))
            .unwrap_or(levels.len() as u32 - 1);
        let (shift, level) = (level + FINEST, &levels[level as usize]);
        for y in y[0] >> shift..=y[1] >> shift {
            for x in x[0] >> shift..=x[1] >> shift {
                let first = (y as usize * level.width as usize + x as usize) * self.channels;
                include(range, &level.ranges[first..first + self.channels]);
            }
        }
    }
}

fn include(range: &mut Bounds3, entry: &[[f32; 2]]) {
    for axis in 0..3 {
        let [low, high] = entry.get(axis).copied().unwrap_or_default();
        range.min[axis] = range.min[axis].min(low);
        range.max[axis] = range.max[axis].max(high);
    }
}

impl Tile {
    fn new(texture: &Texture, tile: usize, number: u32, size: [u32; 2], channels: usize) -> Self {
        const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
        let extend = |range: &mut [f32; 2], low: f32, high: f32| {
            *range = [range[0].min(low), range[1].max(high)];
        };
        let side = 1 << FINEST;
        let [mut width, mut height] = size.map(|n| n.div_ceil(side));
        let mut finest = vec![NOTHING; width as usize * height as usize * channels];
        finest
            .par_chunks_exact_mut(width as usize * channels)
            .enumerate()
            .for_each(|(row, ranges)| {
                let first = row as u32 * side;
                for y in first..(first + side).min(size[1]) {
                    for x in 0..size[0] {
                        let texel = texture.tile_texel(tile, x, y);
                        let entry = (x / side) as usize * channels;
                        for (c, range) in ranges[entry..entry + channels].iter_mut().enumerate() {
                            extend(range, texel[c], texel[c]);
                        }
                    }
                }
            });
        let mut levels = vec![Level {
            width,
            ranges: finest,
        }];
        while width > 1 || height > 1 {
            let (finer, finer_width) = (&levels[levels.len() - 1].ranges, width as usize);
            let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
            let mut ranges = vec![NOTHING; half_width as usize * half_height as usize * channels];
            for (i, &[low, high]) in finer.iter().enumerate() {
                let (place, c) = (i / channels, i % channels);
                let (x, y) = (place % finer_width / 2, place / finer_width / 2);
                extend(
                    &mut ranges[(y * half_width as usize + x) * channels + c],
                    low,
                    high,
                );
            }
            (width, height) = (half_width, half_height);
            levels.push(Level { width, ranges });
        }
        Self {
            number,
            size,
            levels,
        }
    }
}

/// Ranges of texels along one side, both ends included.
struct Spans {
    ranges: [[u32; 2]; 3],
    count: usize,
    /// Whether black from beyond the border is blended in.
    outside: bool,
}

impl Spans {
    fn inside(&self) -> &[[u32; 2]] {
        &self.ranges[..self.count]
    }

    fn push(&mut self, low: i64, high: i64) {
        if low <= high {
            self.ranges[self.count] = [low as u32, high as u32];
            self.count += 1;
        }
    }
}

/// The texels that look-ups between coordinates `low` and `high` blend, in a row of `size`.
fn spans(wrap: Wrap, low: f32, high: f32, size: u32) -> Spans {
    let n = i64::from(size);
    // The look-up works in single precision on coordinates that it has brought near 0..1 before.
    let slack = 4.0 * f64::from(f32::EPSILON) * f64::from(size);
    let texel = |s: f32, slack: f64| {
        let s = match wrap {
            Wrap::Black => s.clamp(-1.0, 2.0),
            Wrap::Clamp => s.clamp(0.0, 1.0),
            Wrap::Repeat | Wrap::Mirror => s,
        };
        (f64::from(s) * f64::from(size) - 0.5 + slack).floor() as i64
    };
    let (first, last) = (texel(low, -slack), texel(high, slack).saturating_add(1));
    let mut spans = Spans {
        ranges: [[0; 2]; 3],
        count: 0,
        outside: false,
    };
    match wrap {
        Wrap::Black => {
            spans.outside = first < 0 || last >= n;
            spans.push(first.max(0), last.min(n - 1));
        }
        Wrap::Clamp => spans.push(first.clamp(0, n - 1), last.clamp(0, n - 1)),
        Wrap::Repeat | Wrap::Mirror if last.saturating_sub(first) >= n => spans.push(0, n - 1),
        Wrap::Repeat => {
            let start = first.rem_euclid(n);
            let end = start + last - first;
            spans.push(start, end.min(n - 1));
            spans.push(0, end - n);
        }
        Wrap::Mirror => {
            // Two images after one another, the second one mirrored; then the first again.
            let start = first.rem_euclid(2 * n);
            let end = start + last - first;
            spans.push(start, end.min(n - 1));
            let mirrored = [start.max(n), end.min(2 * n - 1)].map(|i| 2 * n - 1 - i);
            spans.push(mirrored[1], mirrored[0]);
            spans.push(0, end - 2 * n);
        }
    }
    spans
}
