//! Building: where patches are, how far they reach, and the tree over them. For that each patch is diced once, and
//! forgotten.

use std::sync::Arc;

use rayon::prelude::*;
use segments::{Cache, Entries, SLOTS};

use super::Cached;
use super::dice::{Dicer, Measured, Part, Work};
use crate::accel::compact::{Accuracy, MaxError, Patch, SPAN, Skeleton, lattice, reach};
use crate::accel::face::Face;
use crate::accel::lattice::Extent;
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::surface::{FaceGrid, Rates, SharedSamples, Surface};

/// Patches that are measured before progress is told of.
const BATCH: usize = 256;

impl Cached {
    /// Measures all patches of a surface. `progress` is told from 0 to 1, and stops the build by returning false.
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
                let [columns, rows] = grid.size.map(|n| usize::from(n).div_ceil(SPAN));
                let places = (0..rows).flat_map(move |row| (0..columns).map(move |c| [c, row]));
                places.map(move |at| Patch::new(face, at, grid.size, 0))
            })
            .collect();
        let mut lattice = lattice(&bounds, error);
        let (extents, moved) = loop {
            let dicer = Dicer {
                surface,
                shared: &shared,
                lattice,
            };
            match measure(dicer, &grids, &patches, progress)? {
                Some(measured) => break measured,
                // What is displaced that far has grown accordingly.
                None => lattice.step *= 16.0,
            }
        };
        let reach = reach(&extents);
        let (top, order) = Top::new(extents);
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
            accuracy: Accuracy {
                asked: error.into(),
                max: moved.largest.sqrt(),
                rms: (moved.squares / moved.vertices.max(1) as f64).sqrt(),
                vertices: moved.vertices,
                diagonal: diagonal.into(),
                pixels_per_unit: rates.pixels_per_unit().map(f64::from),
            },
        })
    }
}

/// What each patch encloses, by motion key, and how far vertices are moved; none if they lie beyond the lattice.
fn measure(
    dicer: Dicer<'_>,
    grids: &[FaceGrid],
    patches: &[Patch],
    progress: &dyn Fn(f64) -> bool,
) -> Result<Option<(Vec<Vec<Extent>>, Measured)>> {
    let keys = dicer.shared.len() as u32;
    let mut extents = vec![Vec::with_capacity(patches.len()); keys as usize];
    let mut moved = Measured::NOTHING;
    for (done, batch) in (0..).zip(patches.chunks(BATCH)) {
        let measured: Option<Vec<Vec<Measured>>> = batch
            .par_iter()
            .map_init(Work::default, |work, patch| {
                let part = Part::of(grids[patch.face as usize], patch);
                let of_key = |key| dicer.measure(&part, key, work);
                (0..keys).map(of_key).collect()
            })
            .collect();
        let Some(measured) = measured else {
            return Ok(None);
        };
        for of_patch in measured {
            for (of_key, measured) in extents.iter_mut().zip(of_patch) {
                of_key.push(measured.extent);
                moved = moved.and(measured);
            }
        }
        if !progress((done * BATCH) as f64 / patches.len() as f64) {
            return Err(Error::Interrupted);
        }
    }
    if !progress(1.0) {
        return Err(Error::Interrupted);
    }
    Ok(Some((extents, moved)))
}
