//! Building: bands of a face are diced, rounded, written and forgotten.
//!
//! A band is a row of patches. Bands are made in parallel, a batch at a time, and joined in
//! order: the bytes are the same for any number of threads, and beside the result only a batch's bands and one band of
//! floats a thread exist.

use rayon::prelude::*;

use super::block::{CELLS, PADDING, SIDE, UNIT, Vertices};
use super::patch::{FAN, Node, Patch, SPAN};
use super::{Accuracy, Compact, CompactOptions, Face};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::math::{Bounds3, Vec3};
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// The usual bound on the error, in diagonals of the object. Roundings are even within a cube: along a normal, the root
/// of their mean square is a third of the bound at a vertex and 1 / sqrt(18) of it over a triangle, here below 1e-5.
const USUAL_ERROR: f32 = 3.6e-5;

/// Bands that are in work at once.
const BATCH: usize = 256;

/// A band of a face at one motion key.
struct Band {
    /// A node for each patch, and what it encloses.
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
    /// What each patch encloses and its node, if it has one, by motion key.
    extents: Vec<Vec<Extent>>,
    nodes: Vec<Vec<Option<Node>>>,
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
            faces: grids.iter().map(face).collect(),
            top: Top::default(),
            patches: Vec::new(),
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
            extents: vec![Vec::new(); shared.len()],
            nodes: vec![Vec::new(); shared.len()],
        }
    }

    fn run(mut self, progress: &dyn Fn(f64) -> bool) -> Result<Compact, Stop> {
        let mut places = Vec::with_capacity(BATCH);
        let all = self.grids.len();
        for grid in 0..all {
            let bands = usize::from(self.grids[grid].size[1]).div_ceil(SPAN);
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
        let extents = self.extents.iter().flatten();
        let all = extents.copied().fold(Extent::EMPTY, Extent::union);
        if !all.is_empty() {
            let largest = |k: usize| all.min[k].abs().max(all.max[k].abs());
            built.reach = (0..3).map(largest).max().unwrap_or(0) as f32;
        }
        let (top, order) = Top::new(&self.extents);
        built.top = top;
        let mut patches = Vec::with_capacity(order.len());
        let with_node = self.nodes.iter().flatten().flatten().count();
        let mut nodes = Vec::with_capacity(with_node);
        for number in order.into_iter().map(|number| number as usize) {
            let mut patch = built.patches[number];
            if self.nodes[0][number].is_some() {
                patch.root = nodes.len() as u32;
                nodes.extend(self.nodes.iter().filter_map(|key| key[number]));
            }
            patches.push(patch);
        }
        (built.patches, built.nodes) = (patches, nodes);
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
        let first = SPAN * place.row;
        let last = (first + SPAN).min(nv);
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
            nodes: Vec::with_capacity(nu.div_ceil(SPAN)),
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
        for left in (0..nu).step_by(SPAN) {
            let start = (band.data.len() / UNIT) as u32;
            let mut children = [Extent::EMPTY; 16];
            let mut sizes = [0; 16];
            let fan = |from: usize, n: usize| (n - from).min(SPAN).div_ceil(CELLS);
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

    /// Adds a band.
    fn join(&mut self, place: Place, band: Band) {
        let built = &mut self.built;
        let start = (built.data.len() / UNIT) as u32;
        built.data.extend_from_slice(&band.data);
        self.largest = self.largest.max(band.largest);
        self.squares += band.squares;
        self.vertices += band.vertices;
        let key = place.key as usize;
        for (column, (mut node, extent)) in band.nodes.into_iter().enumerate() {
            node.data += start;
            let patch = Patch {
                face: place.grid as u32,
                column: column as u16,
                row: place.row as u16,
                root: node.data,
            };
            if key == 0 {
                built.patches.push(patch);
            }
            let has_node = built.has_node(&built.fan(&patch));
            self.nodes[key].push(has_node.then_some(node));
            self.extents[key].push(extent);
        }
    }
}

fn face(grid: &FaceGrid) -> Face {
    Face {
        face: grid.face,
        size: grid.size,
        segments: grid.segments,
    }
}
