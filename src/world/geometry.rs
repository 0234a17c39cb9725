//! From a shape of the scene to a geometry of Embree's: subdivision surfaces by the method asked for, polygons as the
//! triangles that they are.

use std::sync::Arc;

use super::build::BuildOptions;
use super::displacement::{Heights, by_callback, coordinates};
use super::method::{How, Method, TracedSurface};
use super::patch;
use super::shape::{Polygons, Smooth, Surface};
use super::stored::{self, Cage, Source};
use crate::accel::{Accuracy, Cache};
use crate::error::{Error, Result, Warnings};
use crate::math::{Affine3A, Bounds3};
use crate::mesh::{ControlMesh, CreaseMethod, NurbsPatch, Scheme, TriangleRule, triangulate};
use crate::scene::Input;
use crate::shade::camera::Camera;
use crate::shade::material::Material;
use crate::stats::AchievedError;
use crate::surface::{self, Carrier, Displacement, Patch, Places, Rates, Subdivision};
use crate::trace::{self, Device, Geometry, SubdivisionOptions, check_limits};

/// Makes the geometries of a scene, one after the other.
pub(super) struct Maker<'a> {
    pub(super) device: &'a Device,
    pub(super) camera: &'a Camera,
    pub(super) options: &'a BuildOptions,
    pub(super) source: Source<'a>,
    /// Told how far the scene's surfaces are, 0..1; ends the build by false.
    pub(super) go_on: &'a dyn Fn(f64) -> bool,
    /// The part of the surfaces that the one at hand is, from where to where.
    pub(super) share: [f64; 2],
    pub(super) heights: Heights<'a>,
    /// For the method that dices while rays are traced.
    pub(super) cache: &'a Arc<Cache>,
    /// Bytes that surfaces and methods hold beside Embree.
    pub(super) bytes: usize,
    /// How far micro-vertices were moved, by methods that do.
    pub(super) error: Option<AchievedError>,
}

/// What displaces a shape.
#[derive(Clone, Copy)]
pub(super) struct Displaced<'a> {
    /// The scene's input.
    pub(super) height: &'a Input<f32>,
    /// The material that it is part of.
    pub(super) material: &'a Material,
}

/// What is asked of a shape.
pub(super) struct Wanted<'a> {
    /// Primvars to be had at hits.
    pub(super) needs: &'a [String],
    pub(super) displaced: Option<Displaced<'a>>,
    /// Where it stands, at all motion keys.
    pub(super) places: &'a [Affine3A],
    /// The prim.
    pub(super) path: &'a str,
}

impl Maker<'_> {
    /// A control mesh or polygons.
    pub(super) fn mesh(
        &mut self,
        mesh: &Arc<ControlMesh>,
        wanted: &Wanted<'_>,
        warnings: &mut Warnings,
    ) -> Result<(Geometry, Surface)> {
        if mesh.scheme == Scheme::None {
            if wanted.displaced.is_some() {
                warnings.add("displacement of polygons", || {
                    format!(
                        "{}: displacement needs a subdivision scheme or a patch; it is left out",
                        wanted.path
                    )
                });
            }
            return polygons(self.device, mesh);
        }
        let names: Vec<&str> = wanted.needs.iter().map(String::as_str).collect();
        let st = wanted.displaced.and_then(|d| coordinates(d.height));
        let base = Arc::new(Subdivision::carrying(mesh, &names, st));
        let carrier: Arc<dyn Carrier> = base.clone();
        let surface = self.displaced(&carrier, wanted);
        let bounds = Bounds3::of(mesh.used_points());
        let places = Places::nearest(self.camera, &bounds, wanted.places);
        if self.options.method == Method::EmbreeSubdivision {
            match embree_differs(mesh) {
                None => {
                    let rates = self.rates(&surface, &places, wanted, warnings);
                    return self.embree_subdivision(mesh, &base, &rates, wanted);
                }
                Some(reason) => warnings.add(format!("not in Embree: {reason}"), || {
                    format!(
                        "{}: {reason}; it is traced as {}",
                        wanted.path,
                        Method::EmbreeTriangles.name()
                    )
                }),
            }
        }
        let smooth = (carrier, surface);
        self.surface(Cage::Mesh(mesh), smooth, &places, wanted, warnings)
    }

    /// A NURBS patch. Embree knows none: under the name of its subdivision they are traced as our triangles, too.
    pub(super) fn patch(
        &mut self,
        nurbs: &NurbsPatch,
        wanted: &Wanted<'_>,
        warnings: &mut Warnings,
    ) -> Result<(Geometry, Surface)> {
        let names: Vec<&str> = wanted.needs.iter().map(String::as_str).collect();
        let st = wanted.displaced.and_then(|d| coordinates(d.height));
        let base = Patch::new(nurbs, &names, st)?;
        patch::notice(nurbs, &base, wanted.path, warnings);
        let carrier: Arc<dyn Carrier> = Arc::new(base);
        let surface = self.displaced(&carrier, wanted);
        let places = Places::nearest(self.camera, &nurbs.bounds(), wanted.places);
        let smooth = (carrier, surface);
        self.surface(Cage::Patch(nurbs), smooth, &places, wanted, warnings)
    }

    fn displaced(&mut self, carrier: &Arc<dyn Carrier>, wanted: &Wanted<'_>) -> surface::Surface {
        let displacement = wanted.displaced.map_or(Displacement::None, |displaced| {
            self.heights.displacement(displaced.height, carrier)
        });
        surface::Surface::new(carrier.clone(), displacement)
    }

    fn rates(
        &self,
        surface: &surface::Surface,
        places: &Places<'_>,
        wanted: &Wanted<'_>,
        warnings: &mut Warnings,
    ) -> Rates {
        let rates = Rates::on_screen(surface, places, &self.options.dicing);
        surface.report(wanted.path, warnings);
        rates
    }

    /// A surface of ours by the method asked for.
    fn surface(
        &mut self,
        cage: Cage<'_>,
        (carrier, surface): (Arc<dyn Carrier>, surface::Surface),
        places: &Places<'_>,
        wanted: &Wanted<'_>,
        warnings: &mut Warnings,
    ) -> Result<(Geometry, Surface)> {
        let surface = Arc::new(surface);
        let traced = if let Source::Stored(store) = self.source {
            let digest = self.digest(cage, places, wanted);
            let sections = store.object(wanted.path, &digest)?;
            (self.options.method).stored(&surface, self.device, &sections)?
        } else {
            let rates = self.rates(&surface, places, wanted, warnings);
            self.check_memory(&rates, carrier.keys(), wanted)?;
            self.build(cage, &surface, &rates, places, wanted)?
        };
        if let Some(accuracy) = &traced.accuracy {
            notice(accuracy, wanted.path, warnings);
        }
        self.error = AchievedError::of_all([self.error, traced.error()]);
        self.bytes += traced.bytes + traced.geometry.memory() + surface.memory();
        let smooth = Smooth {
            surface,
            carrier,
            places: traced.places,
        };
        Ok((traced.geometry, Surface::Smooth(smooth)))
    }

    fn build(
        &mut self,
        cage: Cage<'_>,
        surface: &Arc<surface::Surface>,
        rates: &Rates,
        places: &Places<'_>,
        wanted: &Wanted<'_>,
    ) -> Result<TracedSurface> {
        let recorded = matches!(self.source, Source::Recorded(_));
        let digest = recorded.then(|| self.digest(cage, places, wanted));
        let ([from, to], go_on) = (self.share, self.go_on);
        let mut keep = |sections: &[(&str, &[u8])]| match (&mut self.source, &digest) {
            (Source::Recorded(store), Some(digest)) => store.add(wanted.path, digest, sections),
            _ => Ok(()),
        };
        let how = How {
            max_error: self.options.max_error,
            cache: self.cache,
            go_on: &|done| go_on(from + (to - from) * done),
            keep: recorded.then_some(&mut keep),
        };
        (self.options.method).build(surface, rates, self.device, how)
    }

    fn digest(&mut self, cage: Cage<'_>, places: &Places<'_>, wanted: &Wanted<'_>) -> String {
        let image = self.heights.digest(wanted.displaced.map(|d| d.height));
        stored::digest(image, cage, wanted, places, self.camera, self.options)
    }

    fn embree_subdivision(
        &self,
        mesh: &Arc<ControlMesh>,
        base: &Arc<Subdivision>,
        rates: &Rates,
        wanted: &Wanted<'_>,
    ) -> Result<(Geometry, Surface)> {
        self.check_memory(rates, mesh.points.len() as u32, wanted)?;
        let width = |name: &str| mesh.primvar(name).map_or(0, |p| p.width as usize);
        let primvars: Vec<(String, usize)> =
            (wanted.needs.iter().map(|n| (n.clone(), width(n)))).collect();
        let corners = base.corner_rates(&mesh.topology(), rates);
        let options = SubdivisionOptions {
            rates: trace::Rates::PerCorner(corners.into_iter().map(|n| n as f32).collect()),
            displacement: (wanted.displaced)
                .map(|d| by_callback(d.material.clone(), &primvars, base)),
            primvars: wanted.needs.to_vec(),
        };
        let geometry = Geometry::subdivision(self.device, mesh.clone(), options)?;
        Ok((
            geometry,
            Surface::Subdivision {
                primvars,
                base: base.clone(),
            },
        ))
    }

    /// What will not fit is not begun.
    fn check_memory(&self, rates: &Rates, keys: u32, wanted: &Wanted<'_>) -> Result<()> {
        let Some(budget) = self.device.memory_budget() else {
            return Ok(());
        };
        let (method, triangles) = (self.options.method, rates.micro_triangles());
        let needed = triangles as f64 * f64::from(keys) * method.bytes_per_micro_triangle() as f64;
        let left = budget.saturating_sub(self.bytes + self.device.memory()) as f64;
        if needed <= left {
            return Ok(());
        }
        let rate = f64::from(self.options.dicing.rate) * (needed / left.max(1.0)).sqrt();
        Err(Error::Memory {
            message: format!(
                "{}: {triangles} micro-triangles take about {} by {}, and {} of the memory budget are left",
                wanted.path,
                amount(needed),
                method.name(),
                amount(left),
            ),
            help: Some(format!(
                "raise --memory-budget, or dice more coarsely: --dicing-rate {:.1} would fit",
                (10.0 * rate).ceil() / 10.0
            )),
        })
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

/// Bytes as a person says them.
fn amount(bytes: f64) -> String {
    match bytes {
        ..1e6 => format!("{:.1} KB", bytes / 1e3),
        ..1e9 => format!("{:.1} MB", bytes / 1e6),
        _ => format!("{:.1} GB", bytes / 1e9),
    }
}

/// Why Embree's subdivision of a mesh would not be what its tags say, or nothing at all.
fn embree_differs(mesh: &ControlMesh) -> Option<String> {
    match check_limits(mesh) {
        Err(fault) => Some(fault.to_string()),
        Ok(()) if mesh.crease_method == CreaseMethod::Chaikin && !mesh.creases.is_empty() => {
            Some("Embree knows no Chaikin creasing".to_owned())
        }
        Ok(())
            if mesh.triangle_rule == TriangleRule::Smooth
                && mesh.face_vertex_counts.contains(&3) =>
        {
            Some("Embree knows no smooth rule for triangles".to_owned())
        }
        Ok(()) => None,
    }
}

fn polygons(device: &Device, mesh: &Arc<ControlMesh>) -> Result<(Geometry, Surface)> {
    let triangles = triangulate(mesh);
    let index = |corner: u32| mesh.face_vertex_indices[corner as usize];
    let indices = triangles.corners.iter().map(|t| t.map(index)).collect();
    let geometry = Geometry::triangles(device, indices, Arc::new(mesh.points.clone()))?;
    let polygons = Polygons {
        mesh: mesh.clone(),
        corners: triangles.corners,
        faces: triangles.faces,
    };
    Ok((geometry, Surface::Polygons(polygons)))
}
