//! Samples into pixels and planes.
//!
//! The film is a list of tiles, each rendered by one thread at a time and in the order of the samples, so the
//! sums are the same to the bit whatever the number of threads.

use crate::integrate::{FirstHit, PathSample};
use crate::math::Vec3;

/// A pixel's sums.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pixel {
    radiance: [f64; 3],
    alpha: f64,
    albedo: [f64; 3],
    normal: [f64; 3],
    samples: u32,
    nearest: Option<Nearest>,
}

/// The sample nearest to a pixel's centre, among those that hit.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    offset: f32,
    first: FirstHit,
    depth: f32,
}

impl Pixel {
    /// Adds a sample that lies `offset` pixels from the pixel's centre; `depth` is asked how deep its first hit
    /// lies, if that is wanted. Samples that are not finite are refused.
    pub fn add(
        &mut self,
        sample: &PathSample,
        offset: f32,
        depth: impl FnOnce(Vec3) -> f32,
    ) -> Result<(), NotFinite> {
        let good = sample.radiance.is_finite() && sample.alpha.is_finite();
        self.samples += 1;
        if !good {
            return Err(NotFinite);
        }
        for axis in 0..3 {
            self.radiance[axis] += f64::from(sample.radiance[axis]);
            self.albedo[axis] += f64::from(sample.albedo[axis]);
            self.normal[axis] += f64::from(sample.normal[axis]);
        }
        self.alpha += f64::from(sample.alpha);
        // Depth, position and ids cannot be averaged: the sample nearest to the centre speaks for the pixel.
        if let Some(first) = sample.first
            && self.nearest.is_none_or(|best| offset < best.offset)
        {
            self.nearest = Some(Nearest {
                offset,
                first,
                depth: depth(first.position),
            });
        }
        Ok(())
    }

    /// How many samples it has.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    fn mean(&self, sum: [f64; 3]) -> Vec3 {
        let n = f64::from(self.samples.max(1));
        Vec3::new(
            (sum[0] / n) as f32,
            (sum[1] / n) as f32,
            (sum[2] / n) as f32,
        )
    }

    /// Mean radiance.
    pub fn radiance(&self) -> Vec3 {
        self.mean(self.radiance)
    }

    /// Mean coverage, 0..1.
    pub fn alpha(&self) -> f32 {
        (self.alpha / f64::from(self.samples.max(1))) as f32
    }

    /// Mean albedo.
    pub fn albedo(&self) -> Vec3 {
        self.mean(self.albedo)
    }

    /// Mean normal, shorter than 1 where normals differ or the background shows.
    pub fn normal(&self) -> Vec3 {
        self.mean(self.normal)
    }

    /// The first hit of the sample nearest to the centre, among those that hit.
    pub fn first(&self) -> Option<FirstHit> {
        self.nearest.map(|nearest| nearest.first)
    }

    /// How deep that hit lies along the camera's axis, scene units.
    pub fn depth(&self) -> Option<f32> {
        self.nearest.map(|nearest| nearest.depth)
    }
}

/// A sample was not a finite number and was left out; its pixel counts it as black.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotFinite;

/// A rectangle of pixels with their sums.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Left and top pixel.
    pub origin: [u32; 2],
    /// Width and height.
    pub size: [u32; 2],
    /// Row by row from the top.
    pub pixels: Vec<Pixel>,
}

/// All pixels that are rendered: a rectangle of the whole picture.
#[derive(Debug, Clone)]
pub struct Film {
    /// Left and top pixel of the rectangle.
    pub origin: [u32; 2],
    /// Its width and height.
    pub size: [u32; 2],
    /// Tiles along Hilbert's curve.
    pub tiles: Vec<Tile>,
}

/// Small enough to balance two threads and sixty-four, large enough to keep rays together.
const TILE: u32 = 16;

/// The left top pixel and the size of each tile of a picture, in the order in which they are best rendered: along
/// Hilbert's curve. A run of tiles then sees a part of the scene that is as small as it can be, which is what caches
/// ask for; row by row it would see all that a row does, and see it again in the next.
pub(crate) fn tiles([width, height]: [u32; 2]) -> Vec<[[u32; 2]; 2]> {
    let [columns, rows] = [width, height].map(|n| n.div_ceil(TILE));
    let side = columns.max(rows).next_power_of_two();
    let mut places: Vec<[u32; 2]> = (0..rows)
        .flat_map(|y| (0..columns).map(move |x| [x, y]))
        .collect();
    places.sort_by_key(|&place| along_curve(place, side));
    let tile = |place: [u32; 2]| {
        let [x, y] = place.map(|n| n * TILE);
        [[x, y], [TILE.min(width - x), TILE.min(height - y)]]
    };
    places.into_iter().map(tile).collect()
}

/// How far along Hilbert's curve a place is, in a square whose side is a power of two.
fn along_curve([mut x, mut y]: [u32; 2], side: u32) -> u64 {
    let mut along = 0;
    let mut half = side / 2;
    while half > 0 {
        let right = u32::from(x & half != 0);
        let low = u32::from(y & half != 0);
        // The quarters come in the order of 00, 01, 11, 10, the first and the last turned.
        along = 4 * along + u64::from((3 * right) ^ low);
        if low == 0 {
            if right == 1 {
                (x, y) = (!x, !y);
            }
            (x, y) = (y, x);
        }
        half /= 2;
    }
    along
}

impl Film {
    /// A black film.
    pub fn new(origin: [u32; 2], size: [u32; 2]) -> Self {
        let tiles = tiles(size).into_iter().map(|[at, size]| Tile {
            origin: [origin[0] + at[0], origin[1] + at[1]],
            size,
            pixels: vec![Pixel::default(); (size[0] * size[1]) as usize],
        });
        Self {
            origin,
            size,
            tiles: tiles.collect(),
        }
    }

    /// Calls `f` with each pixel and its place in the picture, counted row by row from the top.
    pub fn for_each(&self, mut f: impl FnMut(usize, &Pixel)) {
        for tile in &self.tiles {
            for (i, pixel) in tile.pixels.iter().enumerate() {
                let x = tile.origin[0] - self.origin[0] + i as u32 % tile.size[0];
                let y = tile.origin[1] - self.origin[1] + i as u32 / tile.size[0];
                f(y as usize * self.size[0] as usize + x as usize, pixel);
            }
        }
    }

    /// Bytes that a film of this size holds.
    pub fn bytes(size: [u32; 2]) -> usize {
        size[0] as usize * size[1] as usize * size_of::<Pixel>()
    }

    /// The fewest samples that any pixel has.
    pub fn samples(&self) -> u32 {
        self.tiles
            .iter()
            .flat_map(|t| &t.pixels)
            .map(Pixel::samples)
            .min()
            .unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_in_one_tile() {
        let film = Film::new([3, 5], [37, 18]);
        let mut seen = vec![0; 37 * 18];
        film.for_each(|i, _| seen[i] += 1);
        assert!(seen.iter().all(|&n| n == 1));
    }

    #[test]
    fn each_tile_of_a_square_touches_the_next() {
        let tiles = tiles([64 * TILE; 2]);
        assert_eq!(tiles.len(), 64 * 64);
        for pair in tiles.windows(2) {
            let [[[x, y], _], [[next_x, next_y], _]] = [pair[0], pair[1]];
            assert_eq!(x.abs_diff(next_x) + y.abs_diff(next_y), TILE);
        }
    }

    #[test]
    fn a_sample_that_is_not_finite_is_refused() {
        let mut pixel = Pixel::default();
        let bad = PathSample {
            radiance: Vec3::splat(f32::NAN),
            ..PathSample::default()
        };
        assert_eq!(pixel.add(&bad, 0.0, |_| 0.0), Err(NotFinite));
        assert_eq!(pixel.radiance(), Vec3::ZERO);
    }

    #[test]
    fn the_nearest_sample_names_the_object() {
        let mut pixel = Pixel::default();
        for (offset, object) in [(0.4, 1), (0.1, 2), (0.3, 3)] {
            let first = Some(FirstHit {
                object,
                ..FirstHit::default()
            });
            pixel
                .add(
                    &PathSample {
                        first,
                        ..PathSample::default()
                    },
                    offset,
                    |_| object as f32,
                )
                .expect("finite");
        }
        assert_eq!(pixel.first().map(|f| f.object), Some(2));
        assert_eq!(pixel.depth(), Some(2.0));
    }
}
