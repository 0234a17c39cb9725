//! Building: bands of a face are diced, fitted and forgotten.
//!
//! A band is a row of patches at all motion keys. Bands are made in parallel, a batch at a time, and joined in order: the
//! bytes are the same for any number of threads, and beside the result only a batch's bands and one band of vertices
//! a thread exist.

use rayon::prelude::*;

use super::patch::{self, Fan, Patch, first, patches};
use super::tile::{FAN, Tile};
use super::{Compressed, fit};
use crate::accel::boxes::Boxes;
use crate::accel::face::Face;
use crate::accel::lattice::{Extent, Lattice, REACH};
use crate::accel::simd::{Isa, LANES};
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::math::{DVec3, Vec3};
use crate::memory::{room_for, rooms_for};
use crate::stats::AchievedError;
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// Bands that are in work at once.
const BATCH: usize = 256;

/// Where a band lies.
#[derive(Clone, Copy)]
struct Place {
    grid: usize,
    row: usize,
}

/// A patch: its tiles by motion key, their boxes and what encloses these.
struct Made {
    patch: Patch,
    tiles: Vec<Vec<Tile>>,
    boxes: Vec<Boxes>,
    extents: Vec<Extent>,
    thick: Thick,
}

/// How thick slabs are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Thick {
    largest: f64,
    squares: f64,
    leaves: u64,
}

/// What a thread works with: kept from band to band, so that large pieces of memory do not come and go between the small
/// ones that bands leave.
#[derive(Default)]
struct Work {
    scratch: Scratch,
    points: Vec<Vec3>,
    /// The same on the lattice, by motion key.
    keys: Vec<Vec<DVec3>>,
}

/// Why a build ends early.
enum Stop {
    /// Some vertex is too far away for the lattice.
    TooFar,
    Error(Error),
}

impl Compressed {
    /// Dices and compresses all faces. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Memory`] beyond 2^32 tiles.
    pub fn build(surface: &Surface, rates: &Rates, progress: &dyn Fn(f64) -> bool) -> Result<Self> {
        let shared: Vec<SharedSamples> = (0..surface.base().keys())
            .map(|key| SharedSamples::new(surface, rates, key))
            .collect();
        let bounds = SharedSamples::bounds(surface, &shared);
        let mut lattice = Lattice::around(&bounds, 0.0);
        loop {
            match Builder::new(surface, rates, &shared, lattice)?.run(progress) {
                Ok(mut built) => {
                    // Steps of the lattice become diagonals and pixels.
                    let (thick, step) = (&mut built.thick, lattice.step());
                    thick.max_pixels = (rates.pixels_per_unit())
                        .map(|pixels| f64::from(pixels) * step * thick.max_diagonals);
                    let scale = match f64::from(bounds.extent().length()) {
                        diagonal if diagonal > 0.0 => step / diagonal,
                        _ => 0.0,
                    };
                    thick.max_diagonals *= scale;
                    thick.rms_diagonals *= scale;
                    return Ok(built);
                }
                Err(Stop::Error(error)) => return Err(error),
                // What is displaced that far has grown accordingly.
                Err(Stop::TooFar) => lattice.step *= 16.0,
            }
        }
    }
}

struct Builder<'a> {
    surface: &'a Surface,
    shared: &'a [SharedSamples],
    lattice: Lattice,
    grids: Vec<FaceGrid>,
    patches: Vec<Patch>,
    tiles: Vec<Tile>,
    /// What each patch encloses, and its fan, by motion key.
    extents: Vec<Vec<Extent>>,
    fans: Vec<Vec<Fan>>,
    thick: Thick,
}

impl<'a> Builder<'a> {
    fn new(
        surface: &'a Surface,
        rates: &Rates,
        shared: &'a [SharedSamples],
        lattice: Lattice,
    ) -> Result<Self> {
        let base = surface.base();
        let grids: Vec<FaceGrid> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .map(|face| FaceGrid::new(surface, rates, face))
            .collect();
        // Room for all of them from the start: what grows is copied, and is there twice for a moment.
        let of_all = |along: fn(usize) -> usize| {
            let of_grid =
                |grid: &FaceGrid| grid.size.map(|n| along(n.into())).iter().product::<usize>();
            grids.iter().map(of_grid).sum::<usize>()
        };
        let patches = of_all(patches);
        let tiles = shared.len() * of_all(patch::tiles_of_patches);
        u32::try_from(tiles).map_err(|_| Error::Memory {
            message: "one object takes more than 256 GB of compressed tiles".into(),
            help: Some("Raise the dicing rate, or lower the most segments of an edge.".into()),
        })?;
        let what = "patches of micro-triangles";
        Ok(Self {
            surface,
            shared,
            lattice,
            grids,
            patches: room_for(patches, what)?,
            tiles: room_for(tiles, "tiles of micro-triangles")?,
            extents: rooms_for(shared.len(), patches, what)?,
            fans: rooms_for(shared.len(), patches, what)?,
            thick: Thick::default(),
        })
    }

    fn run(mut self, progress: &dyn Fn(f64) -> bool) -> Result<Compressed, Stop> {
        let mut places = Vec::with_capacity(BATCH);
        let all = self.grids.len();
        for grid in 0..all {
            for row in 0..patches(self.grids[grid].size[1].into()) {
                places.push(Place { grid, row });
                if places.len() == BATCH {
                    self.batch(&places)?;
                    places.clear();
                    if !progress(grid as f64 / all as f64) {
                        return Err(Stop::Error(Error::Interrupted));
                    }
                }
            }
        }
        self.batch(&places)?;
        if !progress(1.0) {
            return Err(Stop::Error(Error::Interrupted));
        }
        debug_assert_eq!(self.tiles.len(), self.tiles.capacity(), "all were counted");
        self.tiles.shrink_to_fit();
        let extents = self.extents.iter().flatten();
        let all = extents.copied().fold(Extent::EMPTY, Extent::union);
        let reach = if all.is_empty() {
            0
        } else {
            let largest = |k: usize| all.min[k].abs().max(all.max[k].abs());
            (0..3).map(largest).max().unwrap_or(0)
        };
        let (top, order) = Top::new(self.extents);
        let mut patches = Vec::with_capacity(order.len());
        let mut fans = Vec::with_capacity(self.fans.iter().map(Vec::len).sum());
        for number in order.into_iter().map(|number| number as usize) {
            let mut patch = self.patches[number];
            if !patch.is_single() {
                let root = fans.len() as u32;
                fans.extend(self.fans.iter().map(|key| key[patch.root as usize]));
                patch.root = root;
            }
            patches.push(patch);
        }
        let faces: Vec<Face> = self.grids.iter().map(Face::new).collect();
        Ok(Compressed {
            isa: Isa::best(),
            lattice: self.lattice,
            reach: reach as f32,
            keys: self.surface.base().keys(),
            left_handed: self.surface.base().left_handed(),
            faces: faces.into(),
            top,
            patches: patches.into(),
            fans: fans.into(),
            tiles: self.tiles.into(),
            thick: self.thick.told(),
        })
    }

    /// Makes some bands in parallel, and joins them.
    fn batch(&mut self, places: &[Place]) -> Result<(), Stop> {
        let this: &Self = self;
        let bands: Vec<Result<Vec<Made>, Stop>> = places
            .par_iter()
            .map_init(Work::default, |work, place| this.band(*place, work))
            .collect();
        for band in bands {
            for made in band? {
                self.join(made);
            }
        }
        Ok(())
    }

    fn band(&self, place: Place, work: &mut Work) -> Result<Vec<Made>, Stop> {
        let grid = &self.grids[place.grid];
        let [nu, nv] = grid.size.map(usize::from);
        let (below, above) = (first(place.row, nv), first(place.row + 1, nv));
        let stride = nu + 1;
        let Work {
            scratch,
            points,
            keys,
        } = work;
        points.clear();
        points.resize(stride * (above - below + 1), Vec3::ZERO);
        keys.resize_with(self.shared.len(), Vec::new);
        for ((key, shared), on_lattice) in (0..).zip(self.shared).zip(keys.iter_mut()) {
            let rows = below as u16..=above as u16;
            self.surface
                .dice_rows(grid, rows, key, shared, scratch, points);
            on_lattice.clear();
            for &p in points.iter() {
                let p = self.lattice.on_lattice(p);
                let is_within = p.abs().max_element() < f64::from(REACH - 1);
                if !is_within {
                    return Err(Stop::TooFar);
                }
                on_lattice.push(p);
            }
        }
        let columns = 0..patches(nu);
        Ok(columns
            .map(|column| {
                let (left, right) = (first(column, nu), first(column + 1, nu));
                let quads = [right - left, above - below];
                let patch = Patch {
                    face: place.grid as u32,
                    place: [column as u8, place.row as u8],
                    quads: quads.map(|n| n as u8),
                    root: 0,
                };
                make(patch, left, keys, stride)
            })
            .collect())
    }

    /// Adds a patch.
    fn join(&mut self, made: Made) {
        let mut patch = made.patch;
        if patch.is_single() {
            patch.root = self.tiles.len() as u32;
        } else {
            patch.root = self.fans[0].len() as u32;
        }
        for (key, tiles) in made.tiles.into_iter().enumerate() {
            if !patch.is_single() {
                self.fans[key].push(Fan {
                    boxes: made.boxes[key],
                    first: self.tiles.len() as u32,
                });
            }
            self.tiles.extend(tiles);
            self.extents[key].push(made.extents[key]);
        }
        self.patches.push(patch);
        self.thick = self.thick.and(made.thick);
    }
}

/// A patch of the vertices of a band from column `left` on, row by row, key by key.
fn make(patch: Patch, left: usize, keys: &[Vec<DVec3>], stride: usize) -> Made {
    let mut made = Made {
        patch,
        tiles: vec![Vec::new(); keys.len()],
        boxes: Vec::new(),
        extents: Vec::new(),
        thick: Thick::default(),
    };
    let mut children = vec![[Extent::EMPTY; LANES]; keys.len()];
    let [columns, rows] = patch.tiles();
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let place = FAN * j + i;
        let [nu, nv] = patch.quads_of(place);
        let (x, y) = (left + patch.before(0, i), patch.before(1, j));
        let vertices: Vec<Vec<DVec3>> = (keys.iter())
            .map(|key| {
                let row = |y: usize| &key[stride * y + x..][..=nu];
                (y..=y + nv).flat_map(row).copied().collect()
            })
            .collect();
        for (children, vertices) in children.iter_mut().zip(&vertices) {
            children[place] = Extent::around(vertices);
        }
        let (tiles, thick) = fit::tiles(&vertices, [nu, nv]);
        for (all, tile) in made.tiles.iter_mut().zip(tiles) {
            all.push(tile);
        }
        for thick in thick {
            made.thick = made.thick.and(Thick {
                largest: thick,
                squares: thick * thick,
                leaves: 1,
            });
        }
    }
    for children in &children {
        made.boxes.push(Boxes::new(children));
        made.extents
            .push(children.iter().copied().fold(Extent::EMPTY, Extent::union));
    }
    made
}

impl Thick {
    fn and(self, other: Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            squares: self.squares + other.squares,
            leaves: self.leaves + other.leaves,
        }
    }

    /// In lattice steps.
    fn told(self) -> AchievedError {
        AchievedError {
            max_diagonals: self.largest,
            rms_diagonals: (self.squares / self.leaves.max(1) as f64).sqrt(),
            max_pixels: None,
            linear_normals: None,
            vertices: self.leaves,
        }
    }
}
