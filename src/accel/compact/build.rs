//! Building: bands of a face are diced, rounded, written and forgotten.
//!
//! A band is a row of the lowest nodes: 28 rows of quads. Bands are made in parallel, a batch at a time, and joined in
//! order: the bytes are the same for any number of threads, and beside the result only a batch's bands and one band of
//! floats a thread exist.

use std::collections::HashMap;

use rayon::prelude::*;

use super::block::{CELLS, PADDING, SIDE, UNIT, Vertices};
use super::lattice::{Extent, Lattice};
use super::tree::Node;
use super::{Accuracy, Compact, CompactOptions, Face};
use crate::accel::shape::{FAN, Shape};
use crate::accel::simd::Isa;
use crate::error::{Error, Result};
use crate::math::{Bounds3, Vec3};
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// The usual bound on the error, in diagonals of the object: the root of the mean square of the distance to the
/// surface, which is a third of it, then is below 1e-5.
const USUAL_ERROR: f32 = 2.4e-5;

/// Bands that are in work at once.
const BATCH: usize = 256;

/// Quads along a band.
const BAND: usize = FAN * CELLS;

/// A band of a face at one motion key.
struct Band {
    /// The lowest nodes, with what they enclose.
    nodes: Vec<(Node, Extent)>,
    data: Vec<u8>,
    /// Squared distances that its vertices were moved by.
    largest: f64,
    squares: f64,
    vertices: usize,
}

/// Where a band lies.
#[derive(Clone, Copy)]
struct Place {
    grid: usize,
    key: u32,
    row: usize,
}

/// Why a build ends early.
enum Stop {
    /// Some vertex is too far away for the lattice.
    TooFar,
    Error(Error),
}

impl Compact {
    /// Dices and compresses all faces. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Memory`] beyond 16 GB of blocks.
    pub fn build(
        surface: &Surface,
        rates: &Rates,
        options: &CompactOptions,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let shared: Vec<SharedSamples> = (0..surface.base().keys())
            .map(|key| SharedSamples::new(surface, rates, key))
            .collect();
        let mut lattice = lattice(surface, &shared, options);
        loop {
            match Builder::new(surface, rates, &shared, lattice).run(progress) {
                Ok(built) => return Ok(built),
                Err(Stop::Error(error)) => return Err(error),
                // What is displaced that far has grown accordingly.
                Err(Stop::TooFar) => lattice.step *= 16.0,
            }
        }
    }
}

/// The lattice around what the faces share.
fn lattice(surface: &Surface, shared: &[SharedSamples], options: &CompactOptions) -> Lattice {
    let base = surface.base();
    let faces = (0..base.faces()).filter(|&face| !base.is_hole(face));
    let bounds = faces.flat_map(|face| (0..4).map(move |k| (face, k))).fold(
        Bounds3::EMPTY,
        |bounds, (face, k)| {
            shared.iter().fold(bounds, |bounds, shared| {
                shared
                    .walk(surface, face, k)
                    .fold(bounds, Bounds3::including)
            })
        },
    );
    let error = options
        .max_error
        .unwrap_or(USUAL_ERROR * bounds.extent().length());
    // A vertex moves by half of a cube's diagonal at most.
    let step = 2.0 / 3.0_f32.sqrt() * error;
    const LEAST: f32 = 1e-30;
    Lattice {
        anchor: if bounds.is_empty() {
            Vec3::ZERO
        } else {
            bounds.centre()
        },
        step: if step >= LEAST { step } else { LEAST },
    }
}

struct Builder<'a> {
    surface: &'a Surface,
    shared: &'a [SharedSamples],
    lattice: Lattice,
    grids: Vec<FaceGrid>,
    built: Compact,
    /// Squared distances that vertices were moved by.
    largest: f64,
    squares: f64,
    vertices: usize,
    /// The number of each size's shape.
    shapes: HashMap<[u16; 2], u32>,
    /// The lowest nodes of the face at hand, and what they enclose.
    pending: Vec<(Node, Extent)>,
}

impl<'a> Builder<'a> {
    fn new(
        surface: &'a Surface,
        rates: &Rates,
        shared: &'a [SharedSamples],
        lattice: Lattice,
    ) -> Self {
        let base = surface.base();
        let grids: Vec<FaceGrid> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .map(|face| FaceGrid::new(surface, rates, face))
            .collect();
        let built = Compact {
            isa: Isa::best(),
            lattice,
            reach: 0.0,
            keys: base.keys(),
            left_handed: base.left_handed(),
            faces: Vec::with_capacity(grids.len()),
            shapes: Vec::new(),
            nodes: Vec::new(),
            data: Vec::new(),
            accuracy: Accuracy::default(),
        };
        Self {
            surface,
            shared,
            lattice,
            grids,
            built,
            largest: 0.0,
            squares: 0.0,
            vertices: 0,
            shapes: HashMap::new(),
            pending: Vec::new(),
        }
    }

    fn run(mut self, progress: &dyn Fn(f64) -> bool) -> Result<Compact, Stop> {
        let mut places = Vec::with_capacity(BATCH);
        let all = self.grids.len();
        for grid in 0..all {
            let bands = usize::from(self.grids[grid].size[1]).div_ceil(BAND);
            for key in 0..self.built.keys {
                for row in 0..bands {
                    places.push(Place { grid, key, row });
                    if places.len() == BATCH {
                        self.batch(&places)?;
                        places.clear();
                        if !progress(grid as f64 / all as f64) {
                            return Err(Stop::Error(Error::Interrupted));
                        }
                    }
                }
            }
        }
        self.batch(&places)?;
        if !progress(1.0) {
            return Err(Stop::Error(Error::Interrupted));
        }
        let mut built = self.built;
        built.data.resize(built.data.len() + PADDING, 0);
        built.data.shrink_to_fit();
        built.nodes.shrink_to_fit();
        built.accuracy = Accuracy {
            max: self.largest.sqrt(),
            rms: (self.squares / self.vertices.max(1) as f64).sqrt(),
        };
        Ok(built)
    }

    /// Makes some bands in parallel, and joins them.
    fn batch(&mut self, places: &[Place]) -> Result<(), Stop> {
        let this: &Self = self;
        let bands: Vec<Result<Band, Stop>> = places
            .par_iter()
            .map_init(
                || (Scratch::default(), Vec::new()),
                |(scratch, points), place| this.band(*place, scratch, points),
            )
            .collect();
        for (place, band) in places.iter().zip(bands) {
            self.join(*place, band?);
        }
        let most = u32::MAX as usize * UNIT;
        if self.built.data.len() < most {
            return Ok(());
        }
        Err(Stop::Error(Error::Memory {
            message: format!(
                "one object takes more than {} GB of compressed blocks",
                most >> 30
            ),
            help: Some("Raise the dicing rate, or lower the most segments of an edge.".into()),
        }))
    }

    fn band(
        &self,
        place: Place,
        scratch: &mut Scratch,
        points: &mut Vec<Vec3>,
    ) -> Result<Band, Stop> {
        let grid = &self.grids[place.grid];
        let [nu, nv] = grid.size.map(usize::from);
        let first = BAND * place.row;
        let last = (first + BAND).min(nv);
        let stride = nu + 1;
        points.clear();
        points.resize(stride * (last - first + 1), Vec3::ZERO);
        self.surface.dice_rows(
            grid,
            first as u16..=last as u16,
            place.key,
            &self.shared[place.key as usize],
            scratch,
            points,
        );
        let mut band = Band {
            nodes: Vec::with_capacity(nu.div_ceil(BAND)),
            data: Vec::new(),
            largest: 0.0,
            squares: 0.0,
            vertices: points.len(),
        };
        // The far side of each block is the near side of the next one, and rounded with that.
        let mut lattice = vec![[0_i32; 3]; points.len()];
        for (to, &p) in lattice.iter_mut().zip(points.iter()) {
            *to = self.lattice.nearest(p).ok_or(Stop::TooFar)?;
            let off = (self.lattice.position(*to) - p.as_dvec3()).length_squared();
            band.largest = band.largest.max(off);
            band.squares += off;
        }
        for left in (0..nu).step_by(BAND) {
            let start = (band.data.len() / UNIT) as u32;
            let mut children = [Extent::EMPTY; 16];
            let mut sizes = [0; 16];
            let fan = |from: usize, n: usize| (n - from).min(BAND).div_ceil(CELLS);
            for (cj, ci) in
                (0..fan(first, last)).flat_map(|cj| (0..fan(left, nu)).map(move |ci| (cj, ci)))
            {
                let (i, j) = (left + CELLS * ci, CELLS * cj);
                let mut block = Vertices {
                    columns: (nu - i).min(CELLS) + 1,
                    rows: (last - first - j).min(CELLS) + 1,
                    values: [[0; SIDE * SIDE]; 3],
                };
                for y in 0..block.rows {
                    let row = &lattice[stride * (j + y) + i..][..block.columns];
                    for (x, p) in row.iter().enumerate() {
                        for (values, p) in block.values.iter_mut().zip(p) {
                            values[SIDE * y + x] = *p;
                        }
                    }
                }
                let before = band.data.len();
                block.write(&mut band.data);
                let child = FAN * cj + ci;
                children[child] = block.extent();
                sizes[child] = ((band.data.len() - before) / UNIT) as u8;
            }
            let extent = children.iter().fold(Extent::EMPTY, |a, b| a.union(*b));
            band.nodes
                .push((Node::new(&children, start, sizes), extent));
        }
        Ok(band)
    }

    /// Adds a band. The last one of a face completes its tree.
    fn join(&mut self, place: Place, band: Band) {
        let built = &mut self.built;
        let grid = &self.grids[place.grid];
        let number = *self.shapes.entry(grid.size).or_insert_with(|| {
            // What moves has a node in any case: it says where the block of each motion key is.
            let blocks = grid.size.map(|n| n.div_ceil(CELLS as u16));
            built.shapes.push(Shape::new(blocks, built.keys > 1));
            built.shapes.len() as u32 - 1
        });
        let shape = built.shapes[number as usize];
        let start = (built.data.len() / UNIT) as u32;
        if place.key == 0 && place.row == 0 {
            built.faces.push(Face {
                face: grid.face,
                size: grid.size,
                segments: grid.segments,
                root: if shape.levels() == 0 {
                    start
                } else {
                    built.nodes.len() as u32
                },
                shape: number,
            });
        }
        self.largest = self.largest.max(band.largest);
        self.squares += band.squares;
        self.vertices += band.vertices;
        built.data.extend_from_slice(&band.data);
        self.pending
            .extend(band.nodes.into_iter().map(|(mut node, extent)| {
                node.data += start;
                (node, extent)
            }));
        if (place.row + 1) * BAND < usize::from(grid.size[1]) {
            return;
        }
        for (_, extent) in &self.pending {
            for k in 0..3 {
                let largest = extent.min[k].abs().max(extent.max[k].abs());
                built.reach = built.reach.max(largest as f32);
            }
        }
        if shape.levels() == 0 {
            self.pending.clear();
            return;
        }
        // From the lowest level up; the root is stored first.
        let first = built.nodes.len();
        let empty = Node::new(&[Extent::EMPTY; 16], 0, [0; 16]);
        built.nodes.resize(first + shape.nodes(), empty);
        let mut below: Vec<Extent> = Vec::new();
        for level in 1..=shape.levels() {
            let [columns, rows] = shape.size(level);
            let mut extents = Vec::with_capacity(columns * rows);
            for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
                let (node, extent) = if level == 1 {
                    self.pending[j * columns + i]
                } else {
                    let mut children = [Extent::EMPTY; 16];
                    let [fan, fans] = shape.fan(level, i, j);
                    for (cj, ci) in (0..fans).flat_map(|cj| (0..fan).map(move |ci| (cj, ci))) {
                        children[FAN * cj + ci] =
                            below[(FAN * j + cj) * shape.size(level - 1)[0] + FAN * i + ci];
                    }
                    let all = children.iter().fold(Extent::EMPTY, |a, b| a.union(*b));
                    (Node::new(&children, 0, [0; 16]), all)
                };
                built.nodes[first + shape.node(level, i, j)] = node;
                extents.push(extent);
            }
            below = extents;
        }
        self.pending.clear();
    }
}
