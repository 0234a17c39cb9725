//! From a shape that is prepared to a geometry of Embree's: subdivision surfaces by the method chosen, polygons as the
//! triangles that they are.

use std::cell::Cell;
use std::sync::Arc;

use super::build::BuildOptions;
use super::displacement::by_callback;
use super::method::{How, Method, TracedSurface, is_few_triangles};
use super::prepare::{Form, Prepared, Smooth, Wanted};
use super::shape::{self, Bounced, Polygons, Surface};
use super::stored::{Cage, Source};
use crate::accel::{Accuracy, Cache};
use crate::error::{Error, Result, Warnings};
use crate::mesh::{ControlMesh, triangulate};
use crate::stats::AchievedError;
use crate::surface::{Rates, Subdivision};
use crate::trace::{self, Device, Geometry, SubdivisionOptions};

/// Makes the geometries of a scene, one after the other.
pub(super) struct Maker<'a> {
    pub(super) device: &'a Device,
    pub(super) options: &'a BuildOptions,
    pub(super) source: Source<'a>,
    /// Told how far the scene's surfaces are, 0..1; ends the build by false.
    pub(super) go_on: &'a dyn Fn(f64) -> bool,
    /// The part of the surfaces that the one at hand is, from where to where.
    pub(super) share: [f64; 2],
    /// For the method that dices while rays are traced.
    pub(super) cache: &'a Arc<Cache>,
    /// Bytes that surfaces and methods hold beside Embree.
    pub(super) bytes: usize,
    /// How far micro-vertices were moved, by methods that do.
    pub(super) error: Option<AchievedError>,
}

/// A shape that was made.
pub(super) struct Made {
    /// What all rays meet.
    pub(super) geometry: Geometry,
    /// What those of paths that have bounced meet in its place.
    pub(super) bounced: Option<Geometry>,
    /// What is kept of it.
    pub(super) surface: Surface,
}

impl Made {
    /// The same for all rays.
    fn once(geometry: Geometry, surface: Surface) -> Self {
        Self {
            geometry,
            bounced: None,
            surface,
        }
    }
}

impl Maker<'_> {
    /// What Embree traces of a shape, for all rays and for those of paths that have bounced, if these see something else;
    /// and what is kept of it.
    pub(super) fn make(
        &mut self,
        prepared: Prepared<'_>,
        method: Method,
        warnings: &mut Warnings,
    ) -> Result<Made> {
        let wanted = &prepared.wanted;
        match prepared.form {
            Form::Polygons(mesh) => polygons(self.device, &mesh),
            Form::Smooth(smooth) => match (*smooth, method) {
                (
                    Smooth {
                        cage: Cage::Mesh(mesh),
                        embree: Some(base),
                        rates: Some(rates),
                        ..
                    },
                    Method::EmbreeSubdivision,
                ) => self.embree_subdivision(&mesh, &base, &rates, wanted),
                (smooth, method) => self.surface(smooth, method, wanted, warnings),
            },
        }
    }

    /// A surface of ours.
    fn surface(
        &mut self,
        smooth: Smooth<'_>,
        method: Method,
        wanted: &Wanted<'_>,
        warnings: &mut Warnings,
    ) -> Result<Made> {
        let (surface, digest) = (
            &smooth.surface,
            smooth.digest.as_deref().unwrap_or_default(),
        );
        let is_diced = method.is_diced() && surface.tiles().is_none() && !is_few_triangles(surface);
        let bounces = self.options.bounce_dicing.filter(|_| is_diced);
        // Progress goes by time, about.
        let share = self.share;
        let middle = match bounces {
            Some(times) => share[0] + (share[1] - share[0]) / (1.0 + f64::from(times).powi(-2)),
            None => share[1],
        };
        self.share = [share[0], middle];
        let traced = match (&self.source, &smooth.rates) {
            (Source::Stored(store), None) => {
                let sections = store.object(wanted.path, digest)?;
                method.stored(surface, self.device, &sections)?
            }
            (_, Some(rates)) => self.build(surface, rates, method, (wanted, digest))?,
            (Source::Built | Source::Recorded(_), None) => {
                unreachable!("rates are known of all that is not stored")
            }
        };
        if let Some(accuracy) = &traced.accuracy {
            notice(accuracy, wanted.path, warnings);
        }
        self.error = AchievedError::of_all([self.error, traced.error()]);
        self.bytes += traced.bytes + traced.geometry.memory() + surface.memory();
        let mut bounced_geometry = None;
        let mut bounced = None;
        self.share = [middle, share[1]];
        if let (Some(times), Some(rates)) = (bounces, &smooth.rates) {
            let rates = rates.coarser(surface, times);
            let traced = self.build(surface, &rates, method, (wanted, digest))?;
            self.bytes += traced.bytes + traced.geometry.memory() + rates.memory();
            bounced_geometry = Some(traced.geometry);
            bounced = Some(Bounced {
                places: traced.places,
                rates,
                off: traced.accuracy.map_or(0.0, |accuracy| accuracy.max as f32),
            });
        }
        let kept = shape::Smooth {
            surface: smooth.surface,
            carrier: smooth.carrier,
            places: traced.places,
            bounced,
        };
        Ok(Made {
            geometry: traced.geometry,
            bounced: bounced_geometry,
            surface: Surface::Smooth(kept),
        })
    }

    fn build(
        &mut self,
        surface: &Arc<crate::surface::Surface>,
        rates: &Rates,
        method: Method,
        (wanted, digest): (&Wanted<'_>, &str),
    ) -> Result<TracedSurface> {
        let recorded = matches!(self.source, Source::Recorded(_));
        let ([from, to], go_on) = (self.share, self.go_on);
        let mut keep = |sections: &[(&str, &[u8])]| match &mut self.source {
            Source::Recorded(store) => store.add(wanted.path, digest, sections),
            Source::Built | Source::Stored(_) => Ok(()),
        };
        let budget = self.device.memory_budget();
        let passed = Cell::new(false);
        let how = How {
            max_error: self.options.max_error,
            cache: self.cache,
            go_on: &|done| {
                passed.set(passed.get() || !budget.is_kept());
                !passed.get() && go_on(from + (to - from) * done)
            },
            keep: recorded.then_some(&mut keep),
        };
        match method.build(surface, rates, self.device, how) {
            Err(Error::Interrupted) if passed.get() => Err(budget.exceeded(format!(
                "{}: building it by {} takes more than was expected",
                wanted.path,
                method.name()
            ))),
            built => built,
        }
    }

    fn embree_subdivision(
        &self,
        mesh: &Arc<ControlMesh>,
        base: &Arc<Subdivision>,
        rates: &Rates,
        wanted: &Wanted<'_>,
    ) -> Result<Made> {
        let width = |name: &str| mesh.primvar(name).map_or(0, |p| p.width as usize);
        let primvars: Vec<(String, usize)> =
            (wanted.needs.iter().map(|n| (n.clone(), width(n)))).collect();
        let corners = base.corner_rates(&mesh.topology(), rates);
        let options = SubdivisionOptions {
            rates: trace::Rates::PerCorner(corners.into_iter().map(|n| n as f32).collect()),
            displacement: (wanted.displaced)
                .map(|d| by_callback(d.material.clone(), &primvars, base)),
            primvars: wanted.needs.clone(),
        };
        let geometry = Geometry::subdivision(self.device, mesh.clone(), options)?;
        let surface = Surface::Subdivision {
            primvars,
            base: base.clone(),
        };
        Ok(Made::once(geometry, surface))
    }
}

/// Warns of an error that the lattice could not keep to.
fn notice(accuracy: &Accuracy, path: &str, warnings: &mut Warnings) {
    let &Accuracy { asked, max, .. } = accuracy;
    if max > asked * (1.0 + 1e-6) {
        warnings.add("max error", || {
            format!(
                "{path}: micro-vertices are moved by up to {max:.1e} units, not {asked:.1e}: a lattice of 24 bits is no finer"
            )
        });
    }
}

fn polygons(device: &Device, mesh: &Arc<ControlMesh>) -> Result<Made> {
    let triangles = triangulate(mesh);
    let index = |corner: u32| mesh.face_vertex_indices[corner as usize];
    let indices = triangles.corners.iter().map(|t| t.map(index)).collect();
    let geometry = Geometry::triangles(device, indices, Arc::new(mesh.points.clone()))?;
    let polygons = Polygons {
        mesh: mesh.clone(),
        corners: triangles.corners,
        faces: triangles.faces,
    };
    Ok(Made::once(geometry, Surface::Polygons(polygons)))
}
