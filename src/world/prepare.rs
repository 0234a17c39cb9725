//! Shapes of the scene before they are built: their surfaces, and how finely these will be diced. What they will take
//! follows from that.

use std::sync::Arc;

use super::build::{BuildOptions, displacement_of, name_shape, needed_primvars, single};
use super::displacement::{Heights, coordinates};
use super::estimate::Counts;
use super::method::{Choice, Method, is_few_triangles};
use super::patch;
use super::stored::{self, Cage, Source};
use super::textures::Textures;
use crate::error::{Fault, Result, Warnings};
use crate::math::{Affine3A, Bounds3};
use crate::memory::Budget;
use crate::mesh::{ControlMesh, CreaseMethod, NurbsPatch, Scheme, TriangleRule, triangulate};
use crate::scene::{self, Description, Input};
use crate::shade::camera::Camera;
use crate::shade::material::Material;
use crate::surface::{
    Carrier, Dicing, Displacement, Patch, Places, Rates, Subdivision, Surface, Tiles,
};
use crate::trace::check_limits;

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
    pub(super) needs: Vec<String>,
    pub(super) displaced: Option<Displaced<'a>>,
    /// The prim.
    pub(super) path: &'a str,
    /// What is seen in the surface's place, and the primvar with its texture coordinates.
    pub(super) tiles: Option<(Arc<Tiles>, &'a str)>,
}

/// A shape that is ready to be built.
pub(super) struct Prepared<'a> {
    pub(super) wanted: Wanted<'a>,
    /// Placements of the description.
    pub(super) places: Vec<u32>,
    /// Where it stands, if it is built in world space right away.
    pub(super) in_world: Option<Affine3A>,
    pub(super) form: Form<'a>,
}

/// What is built of a shape.
pub(super) enum Form<'a> {
    /// The triangles that it is.
    Polygons(Arc<ControlMesh>),
    Smooth(Box<Smooth<'a>>),
}

/// A surface of ours.
pub(super) struct Smooth<'a> {
    pub(super) cage: Cage,
    /// The same without displacement, with primvars.
    pub(super) carrier: Arc<dyn Carrier>,
    pub(super) surface: Arc<Surface>,
    pub(super) stands: Places<'a>,
    /// None where it was built before.
    pub(super) rates: Option<Rates>,
    /// Everything that its hierarchy follows from, where that is stored.
    pub(super) digest: Option<String>,
    /// The surface as Embree's subdivision shows it, if that is asked for and shows what its tags say.
    pub(super) embree: Option<Arc<Subdivision>>,
}

/// Prepares all shapes of a scene.
pub(super) struct Preparer<'a> {
    description: &'a Description,
    camera: &'a Camera,
    options: &'a BuildOptions,
    textures: &'a Textures,
    materials: &'a [Material],
    /// The number of the material for faces without any.
    unbound: usize,
    heights: Heights<'a>,
    budget: &'a Budget,
}

impl<'a> Preparer<'a> {
    pub(super) fn new(
        description: &'a Description,
        camera: &'a Camera,
        options: &'a BuildOptions,
        textures: &'a Textures,
        (materials, unbound): (&'a [Material], usize),
        budget: &'a Budget,
    ) -> Self {
        Self {
            description,
            camera,
            options,
            textures,
            materials,
            unbound,
            heights: Heights::new(textures),
            budget,
        }
    }

    /// All shapes in their order. `go_on` may end it by false.
    pub(super) fn all(
        &mut self,
        source: &Source<'_>,
        warnings: &mut Warnings,
        go_on: &dyn Fn() -> Result<()>,
    ) -> Result<Vec<Prepared<'a>>> {
        let description = self.description;
        let mut places: Vec<Vec<u32>> = vec![Vec::new(); description.shapes.len()];
        for (i, placement) in description.placements.iter().enumerate() {
            places[placement.shape].push(i as u32);
        }
        let shapes = description.shapes.iter().zip(places);
        shapes
            .map(|(shape, places)| {
                go_on()?;
                self.shape(shape, places, source, warnings)
                    .map_err(|error| name_shape(error, description, shape))
            })
            .collect()
    }

    fn shape(
        &mut self,
        shape: &'a scene::Shape,
        places: Vec<u32>,
        source: &Source<'_>,
        warnings: &mut Warnings,
    ) -> Result<Prepared<'a>> {
        let description = self.description;
        for material in super::build::covering(shape, &places, description).flatten() {
            let material = &description.materials[material];
            (self.textures).check_faces(&shape.geometry, material, self.options)?;
        }
        let needs = needed_primvars(shape, &places, description, self.materials, self.unbound)?;
        let displaced = displacement_of(shape, &places, description, self.materials);
        let keys = |place: u32| {
            description.placements[place as usize]
                .world_from_object
                .iter()
        };
        let in_world = match places[..] {
            [place] if displaced.is_none() && keys(place).len() == 1 => {
                keys(place).map(single).next()
            }
            _ => None,
        };
        let stands = match in_world {
            Some(_) => vec![Affine3A::IDENTITY],
            None => places.iter().flat_map(|&p| keys(p).map(single)).collect(),
        };
        let wanted = Wanted {
            needs,
            displaced: displaced.map(|m| Displaced {
                height: &description.materials[m].surface.displacement,
                material: &self.materials[m],
            }),
            path: &shape.path,
            tiles: (shape.tiles.as_ref()).map(|t| (over(t), t.primvar.as_str())),
        };
        let form = match (&shape.geometry, &in_world) {
            (scene::Geometry::Mesh(mesh), None) => {
                self.mesh(mesh.clone(), &wanted, &stands, source, warnings)
            }
            (scene::Geometry::Mesh(mesh), Some(world_from_object)) => {
                let mesh = Arc::new(super::build::in_space(mesh, world_from_object));
                self.mesh(mesh, &wanted, &stands, source, warnings)
            }
            (scene::Geometry::Nurbs(patch), None) => {
                self.patch(patch.clone(), &wanted, &stands, source, warnings)
            }
            (scene::Geometry::Nurbs(patch), Some(world_from_object)) => {
                let patch = Arc::new(patch::in_space(patch, world_from_object));
                self.patch(patch, &wanted, &stands, source, warnings)
            }
        }?;
        Ok(Prepared {
            wanted,
            places,
            in_world,
            form,
        })
    }

    /// A control mesh or polygons.
    fn mesh(
        &mut self,
        mesh: Arc<ControlMesh>,
        wanted: &Wanted<'_>,
        stands: &[Affine3A],
        source: &Source<'_>,
        warnings: &mut Warnings,
    ) -> Result<Form<'a>> {
        if mesh.scheme == Scheme::None {
            if wanted.tiles.is_some() {
                return Err(tiles_over_polygons().into());
            }
            if wanted.displaced.is_some() {
                warnings.add("displacement of polygons", || {
                    format!(
                        "{}: displacement needs a subdivision scheme or a patch; it is left out",
                        wanted.path
                    )
                });
            }
            return Ok(Form::Polygons(mesh));
        }
        self.budget.ask(limit_surface(&mesh), wanted.path)?;
        let names: Vec<&str> = wanted.needs.iter().map(String::as_str).collect();
        let st = wanted.coordinates();
        let base = Arc::new(Subdivision::carrying(&mesh, &names, st));
        let embree = match self.options.method {
            Choice::One(Method::EmbreeSubdivision) if wanted.tiles.is_none() => {
                match embree_differs(&mesh) {
                    None => Some(base.clone()),
                    Some(reason) => {
                        warnings.add(format!("not in Embree: {reason}"), || {
                            format!(
                                "{}: {reason}; it is traced as {}",
                                wanted.path,
                                Method::EmbreeTriangles.name()
                            )
                        });
                        None
                    }
                }
            }
            Choice::One(_) | Choice::Auto => None,
        };
        let bounds = Bounds3::of(mesh.used_points());
        let stands = Places::nearest(self.camera, &bounds, stands);
        let mut smooth = self.smooth(Cage::Mesh(mesh), base, stands, wanted, source, warnings);
        smooth.embree = embree;
        Ok(Form::Smooth(Box::new(smooth)))
    }

    /// A NURBS patch. Embree knows none: under the name of its subdivision they are traced as our triangles, too.
    fn patch(
        &mut self,
        nurbs: Arc<NurbsPatch>,
        wanted: &Wanted<'_>,
        stands: &[Affine3A],
        source: &Source<'_>,
        warnings: &mut Warnings,
    ) -> Result<Form<'a>> {
        let names: Vec<&str> = wanted.needs.iter().map(String::as_str).collect();
        let st = wanted.coordinates();
        let base = Patch::new(&nurbs, &names, st)?;
        patch::notice(&nurbs, &base, wanted.path, warnings);
        let stands = Places::nearest(self.camera, &nurbs.bounds(), stands);
        let (cage, base) = (Cage::Patch(nurbs), Arc::new(base));
        let smooth = self.smooth(cage, base, stands, wanted, source, warnings);
        Ok(Form::Smooth(Box::new(smooth)))
    }

    fn smooth(
        &mut self,
        cage: Cage,
        carrier: Arc<dyn Carrier>,
        stands: Places<'a>,
        wanted: &Wanted<'_>,
        source: &Source<'_>,
        warnings: &mut Warnings,
    ) -> Smooth<'a> {
        let displacement = match (wanted.displaced, &wanted.tiles) {
            (None, _) => Displacement::None,
            (Some(displaced), None) => self.heights.displacement(displaced.height, &carrier),
            (Some(_), Some(_)) => {
                warnings.add("displacement under tiles", || {
                    format!(
                        "{}: displacement of a surface under tiles of geometry is left out",
                        wanted.path
                    )
                });
                Displacement::None
            }
        };
        let surface = Surface::new(carrier.clone(), displacement);
        let surface = Arc::new(match &wanted.tiles {
            Some((tiles, _)) => surface.under(tiles.clone()),
            None => surface,
        });
        let digest = match (source, self.options.method) {
            (Source::Built, _) | (_, Choice::Auto) => None,
            (Source::Recorded(_) | Source::Stored(_), Choice::One(method)) => {
                let image = self.heights.digest(wanted.displaced.map(|d| d.height));
                let how = (method, self.options);
                Some(stored::digest(
                    image,
                    &cage,
                    wanted,
                    &stands,
                    self.camera,
                    how,
                ))
            }
        };
        // Tiles and few triangles are not stored.
        let is_stored = matches!(source, Source::Stored(_))
            && wanted.tiles.is_none()
            && !is_few_triangles(&surface);
        let rates = (!is_stored).then(|| {
            let rates = if wanted.tiles.is_some() {
                // It is not diced.
                Rates::uniform(&surface, 1)
            } else {
                Rates::on_screen(&surface, &stands, &self.options.dicing)
            };
            surface.report(wanted.path, warnings);
            rates
        });
        Smooth {
            cage,
            carrier,
            surface,
            stands,
            rates,
            digest,
            embree: None,
        }
    }
}

impl<'a> Wanted<'a> {
    /// The primvar with the texture coordinates that the surface itself needs.
    fn coordinates(&self) -> Option<&'a str> {
        match &self.tiles {
            Some((_, primvar)) => Some(primvar),
            None => self.displaced.and_then(|d| coordinates(d.height)),
        }
    }
}

/// Prisms need normals that are alike where faces meet.
pub(super) fn tiles_over_polygons() -> Fault {
    Fault::new(
        "tiles of geometry stand over subdivision surfaces and patches, and this is a polygon mesh",
    )
    .advise("author a subdivisionScheme: bilinear keeps its facets")
}

/// What stands over a surface, ready to be traced.
pub(super) fn over(tiles: &scene::Tiles) -> Arc<Tiles> {
    let mesh = &tiles.mesh;
    let index = |corner: u32| mesh.face_vertex_indices[corner as usize];
    let corners = triangulate(mesh).corners;
    let triangles = corners.iter().map(|corners| corners.map(index));
    let points = mesh.points.first().cloned().unwrap_or_default();
    Arc::new(Tiles::new(
        points,
        triangles.collect(),
        tiles.repeats,
        tiles.height,
    ))
}

impl Prepared<'_> {
    /// Bytes of what it is now.
    pub(super) fn memory(&self) -> usize {
        match &self.form {
            Form::Polygons(_) => 0,
            Form::Smooth(smooth) => smooth.surface.memory(),
        }
    }
}

impl Smooth<'_> {
    /// What it will be diced into, or would be by other rates, and what for paths that have bounced if micro-edges are so
    /// many times as long for them.
    pub(super) fn counts_by(
        &self,
        dicing: Option<&Dicing>,
        bounce_dicing: Option<f32>,
    ) -> (Counts, Option<Counts>) {
        let dicing = dicing.filter(|_| self.surface.tiles().is_none());
        let otherwise = dicing.map(|d| Rates::on_screen(&self.surface, &self.stands, d));
        let Some(rates) = otherwise.as_ref().or(self.rates.as_ref()) else {
            return (Counts::default(), None);
        };
        let diced = bounce_dicing.filter(|_| self.surface.tiles().is_none());
        let bounced = diced.map(|times| {
            let rates = rates.coarser(&self.surface, times);
            Counts::new(&self.surface, &rates)
        });
        (Counts::new(&self.surface, rates), bounced)
    }
}

/// Bytes of a cage's limit surface and of its rates, about. Faces are cut at their corners where not all of them are quads.
pub(super) fn limit_surface(mesh: &ControlMesh) -> u64 {
    let (faces, corners) = (
        mesh.face_vertex_counts.len(),
        mesh.face_vertex_indices.len(),
    );
    let parts = if corners == 4 * faces { faces } else { corners };
    450 * parts as u64
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
