//! Building: where patches are, how far they reach, and the tree over them. No micro-vertex is evaluated, unless the
//! displacement's source is certain of no bound.

use std::sync::Arc;

use rayon::prelude::*;
use segments::{Cache, Entries, SLOTS};

use super::Cached;
use super::dice::{Dicer, Part, TooFar, Work};
use crate::accel::compact::{Accuracy, Face, MaxError, Patch, SPAN, Skeleton, lattice, reach};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::surface::{FaceGrid, Rates, SharedSamples, Surface};

/// Patches that are bounded before progress is told of.
const BATCH: usize = 1024;

impl Cached {
    /// Bounds all patches of a surface. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Usage`] if the error is to be measured in pixels, of which the rates
    /// know nothing.
    pub fn build(
        surface: &Arc<Surface>,
        rates: &Rates,
        max_error: MaxError,
        cache: &Arc<Cache>,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let (shared, bounds) = SharedSamples::of_vertices(surface, rates);
        let diagonal = bounds.extent().length();
        let error = max_error.units(diagonal, rates.pixels_per_unit())?;
        let base = surface.base();
        let grids: Vec<FaceGrid> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .map(|face| FaceGrid::new(surface, rates, face))
            .collect();
        let patches: Vec<Patch> = (0..)
            .zip(&grids)
            .flat_map(|(face, grid)| {
                let [columns, rows] = grid.size.map(|n| n.div_ceil(SPAN as u16));
                let places = (0..rows).flat_map(move |row| (0..columns).map(move |c| (c, row)));
                places.map(move |(column, row)| Patch {
                    face,
                    column,
                    row,
                    root: 0,
                })
            })
            .collect();
        let mut lattice = lattice(&bounds, error);
        let extents = loop {
            let dicer = Dicer {
                surface,
                shared: &shared,
                lattice,
            };
            match extents(dicer, &grids, &patches, progress)? {
                Ok(extents) => break extents,
                // What is displaced that far has grown accordingly.
                Err(TooFar) => lattice.step *= 16.0,
            }
        };
        let reach = reach(&extents);
        let (top, order) = Top::new(&extents);
        let patches: Vec<Patch> = order.iter().map(|&n| patches[n as usize]).collect();
        let faces: Vec<Face> = grids.iter().map(Face::new).collect();
        Ok(Self {
            entries: Entries::new(cache.clone(), patches.len()),
            skeleton: Skeleton {
                isa: Isa::best(),
                lattice,
                reach,
                keys: base.keys(),
                left_handed: base.left_handed(),
                faces: faces.into(),
                top,
                patches: patches.into(),
            },
            surface: surface.clone(),
            shared,
            rooms: (0..SLOTS).map(|_| None.into()).collect(),
            accuracy: accuracy(&lattice, error, diagonal, rates, base.keys()),
        })
    }
}

/// Of roundings that are even within a cube.
fn accuracy(lattice: &Lattice, error: f32, diagonal: f32, rates: &Rates, keys: u32) -> Accuracy {
    Accuracy {
        asked: error.into(),
        max: lattice.step() * 0.75_f64.sqrt(),
        rms: lattice.step() * 0.5,
        vertices: rates.micro_vertices() * u64::from(keys),
        diagonal: diagonal.into(),
        pixels_per_unit: rates.pixels_per_unit().map(f64::from),
    }
}

/// What each patch encloses, by motion key.
fn extents(
    dicer: Dicer<'_>,
    grids: &[FaceGrid],
    patches: &[Patch],
    progress: &dyn Fn(f64) -> bool,
) -> Result<Result<Vec<Vec<Extent>>, TooFar>> {
    let keys = dicer.shared.len() as u32;
    let mut extents = vec![Vec::with_capacity(patches.len()); keys as usize];
    for (done, batch) in (0..).zip(patches.chunks(BATCH)) {
        let bounded: Result<Vec<Vec<Extent>>, TooFar> = batch
            .par_iter()
            .map_init(Work::default, |work, patch| {
                let part = Part::of(grids[patch.face as usize], patch);
                (0..keys)
                    .map(|key| match dicer.bound(&part, key) {
                        Some(bounded) => bounded,
                        None => dicer.measure(&part, key, work),
                    })
                    .collect()
            })
            .collect();
        let Ok(bounded) = bounded else {
            return Ok(Err(TooFar));
        };
        for of_patch in bounded {
            for (of_key, extent) in extents.iter_mut().zip(of_patch) {
                of_key.push(extent);
            }
        }
        if !progress((done * BATCH) as f64 / patches.len() as f64) {
            return Err(Error::Interrupted);
        }
    }
    if !progress(1.0) {
        return Err(Error::Interrupted);
    }
    Ok(Ok(extents))
}
