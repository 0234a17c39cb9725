//! Building: bands of a face are diced, rounded, written and forgotten.
//!
//! A band is a row of patches. Bands are made in parallel, a batch at a time, and joined in
//! order: the bytes are the same for any number of threads, and beside the result only a batch's bands and one band of
//! floats a thread exist.

use rayon::prelude::*;

use super::block::{PADDING, UNIT};
use super::patch::{Node, Patch, SPAN, pack};
use super::skeleton::Skeleton;
use super::{Accuracy, Compact, CompactOptions};
use crate::accel::face::Face;
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::math::{Bounds3, Vec3};
use crate::memory::{more_room, room_for, rooms_for};
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// What most of the memory is for.
const BLOCKS: &str = "blocks of micro-triangles";

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

/// What a thread works with: kept from band to band, so that large pieces of memory do not come and go between the small
/// ones that bands leave.
#[derive(Default)]
struct Work {
    scratch: Scratch,
    points: Vec<Vec3>,
    /// The same on the lattice.
    lattice: Vec<[i32; 3]>,
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
    /// [`Error::Interrupted`] if stopped, [`Error::Memory`] beyond 16 GB of blocks, [`Error::Usage`] if the error is to
    /// be measured in pixels, of which the rates know nothing.
    pub fn build(
        surface: &Surface,
        rates: &Rates,
        options: &CompactOptions,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let shared: Vec<SharedSamples> = (0..surface.base().keys())
            .map(|key| SharedSamples::new(surface, rates, key))
            .collect();
        let bounds = SharedSamples::bounds(surface, &shared);
        let diagonal = bounds.extent().length();
        let error = (options.max_error).units(diagonal, rates.pixels_per_unit())?;
        let mut lattice = lattice(&bounds, error);
        loop {
            match Builder::new(surface, rates, &shared, lattice)?.run(progress) {
                Ok(mut built) => {
                    built.accuracy.asked = error.into();
                    built.accuracy.diagonal = diagonal.into();
                    built.accuracy.pixels_per_unit = rates.pixels_per_unit().map(f64::from);
                    return Ok(built);
                }
                Err(Stop::Error(error)) => return Err(error),
                // What is displaced that far has grown accordingly.
                Err(Stop::TooFar) => lattice.step *= 16.0,
            }
        }
    }
}

/// The largest coordinate of what is within boxes, by motion key.
pub(in crate::accel) fn reach(extents: &[Vec<Extent>]) -> f32 {
    let extents = extents.iter().flatten();
    let all = extents.copied().fold(Extent::EMPTY, Extent::union);
    let largest = |k: usize| all.min[k].abs().max(all.max[k].abs());
    if all.is_empty() {
        0.0
    } else {
        (0..3).map(largest).max().unwrap_or(0) as f32
    }
}

/// The lattice in which no vertex moves by more than `error`, unless it is too fine for what is within `bounds`.
pub(in crate::accel) fn lattice(bounds: &Bounds3, error: f32) -> Lattice {
    // A vertex moves by half of a cube's diagonal at most.
    Lattice::around(bounds, 2.0 / 3.0_f32.sqrt() * error)
}

struct Builder<'a> {
    surface: &'a Surface,
    shared: &'a [SharedSamples],
    lattice: Lattice,
    grids: Vec<FaceGrid>,
    keys: u32,
    patches: Vec<Patch>,
    data: Vec<u8>,
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
    ) -> Result<Self> {
        let base = surface.base();
        let grids: Vec<FaceGrid> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .map(|face| FaceGrid::new(surface, rates, face))
            .collect();
        // Room for all of them from the start: what grows is copied, and is there twice for a moment.
        let of_grid = |grid: &FaceGrid| -> usize {
            let along = |n: u16| usize::from(n).div_ceil(SPAN);
            grid.size.map(along).iter().product()
        };
        let count = grids.iter().map(of_grid).sum();
        let what = "patches of micro-triangles";
        Ok(Self {
            surface,
            shared,
            lattice,
            grids,
            keys: base.keys(),
            patches: room_for(count, what)?,
            data: Vec::new(),
            largest: 0.0,
            squares: 0.0,
            vertices: 0,
            extents: rooms_for(shared.len(), count, what)?,
            nodes: rooms_for(shared.len(), count, what)?,
        })
    }

    fn run(mut self, progress: &dyn Fn(f64) -> bool) -> Result<Compact, Stop> {
        let mut places = Vec::with_capacity(BATCH);
        let all = self.grids.len();
        for grid in 0..all {
            let bands = usize::from(self.grids[grid].size[1]).div_ceil(SPAN);
            for key in 0..self.keys {
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
        let mut data = self.data;
        more_room(&mut data, PADDING, BLOCKS).map_err(Stop::Error)?;
        data.resize(data.len() + PADDING, 0);
        data.shrink_to_fit();
        let reach = reach(&self.extents);
        let (top, order) = Top::new(self.extents);
        let mut patches = Vec::with_capacity(order.len());
        let with_node = self.nodes.iter().flatten().flatten().count();
        let mut nodes = Vec::with_capacity(with_node);
        for number in order.into_iter().map(|number| number as usize) {
            let mut patch = self.patches[number];
            if self.nodes[0][number].is_some() {
                patch.root = nodes.len() as u32;
                nodes.extend(self.nodes.iter().filter_map(|key| key[number]));
            }
            patches.push(patch);
        }
        let faces: Vec<Face> = self.grids.iter().map(Face::new).collect();
        Ok(Compact {
            skeleton: Skeleton {
                isa: Isa::best(),
                lattice: self.lattice,
                reach,
                keys: self.keys,
                left_handed: self.surface.base().left_handed(),
                faces: faces.into(),
                top,
                patches: patches.into(),
            },
            nodes: nodes.into(),
            data: data.into(),
            accuracy: Accuracy {
                max: self.largest.sqrt(),
                rms: (self.squares / self.vertices.max(1) as f64).sqrt(),
                vertices: self.vertices as u64,
                ..Accuracy::default()
            },
        })
    }

    /// Makes some bands in parallel, and joins them.
    fn batch(&mut self, places: &[Place]) -> Result<(), Stop> {
        let this: &Self = self;
        let bands: Vec<Result<Band, Stop>> = places
            .par_iter()
            .map_init(Work::default, |work, place| this.band(*place, work))
            .collect();
        for (place, band) in places.iter().zip(bands) {
            self.join(*place, band?).map_err(Stop::Error)?;
        }
        let most = u32::MAX as usize * UNIT;
        if self.data.len() < most {
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

    fn band(&self, place: Place, work: &mut Work) -> Result<Band, Stop> {
        let Work {
            scratch,
            points,
            lattice,
        } = work;
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
        lattice.clear();
        lattice.resize(points.len(), [0; 3]);
        for (to, &p) in lattice.iter_mut().zip(points.iter()) {
            *to = self.lattice.nearest(p).ok_or(Stop::TooFar)?;
            let off = (self.lattice.position(*to) - p.as_dvec3()).length_squared();
            band.largest = band.largest.max(off);
            band.squares += off;
        }
        for left in (0..nu).step_by(SPAN) {
            let cells = [(nu - left).min(SPAN), last - first];
            let packed = pack(&lattice[left..], stride, cells, &mut band.data);
            band.nodes.push(packed);
        }
        Ok(band)
    }

    /// Adds a band.
    fn join(&mut self, place: Place, band: Band) -> Result<()> {
        let start = (self.data.len() / UNIT) as u32;
        more_room(&mut self.data, band.data.len(), BLOCKS)?;
        self.data.extend_from_slice(&band.data);
        self.largest = self.largest.max(band.largest);
        self.squares += band.squares;
        self.vertices += band.vertices;
        let key = place.key as usize;
        for (column, (mut node, extent)) in band.nodes.into_iter().enumerate() {
            node.data += start;
            let size = self.grids[place.grid].size;
            let patch = Patch::new(place.grid as u32, [column, place.row], size, node.data);
            if key == 0 {
                self.patches.push(patch);
            }
            let fan = patch.fan();
            let has_node = self.keys > 1 || !fan.is_single();
            self.nodes[key].push(has_node.then_some(node));
            self.extents[key].push(extent);
        }
        Ok(())
    }
}
