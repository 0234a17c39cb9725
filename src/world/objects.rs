//! The surfaces of a scene one by one, each with its displacement: for whoever compares ways of tracing them.

use std::sync::Arc;

use super::build::{BuildOptions, displacement_of, name_shape, single};
use super::displacement::{Heights, by_callback, coordinates};
use super::prepare::{limit_surface, over, tiles_over_polygons};
use super::textures::Textures;
use crate::error::{Fault, Result, Warnings};
use crate::math::{Affine3A, Bounds3, Vec3};
use crate::memory::Budget;
use crate::mesh::{ControlMesh, Scheme};
use crate::scene::{self, Description};
use crate::shade::material::Material;
use crate::surface::{Carrier, Displacement, Patch, Rates, Subdivision, Surface};
use crate::trace::{self, Device, Geometry, SubdivisionOptions};

/// A surface of a scene.
pub struct Object {
    /// The prim.
    pub path: String,
    /// Where it stands when the shutter opens.
    pub world_from_object: Vec<Affine3A>,
    /// The surface, displaced.
    pub surface: Arc<Surface>,
    /// Around all control points that it uses.
    pub bounds: Bounds3,
    /// What it was made of, unless that is a NURBS patch.
    cage: Option<Cage>,
}

struct Cage {
    mesh: Arc<ControlMesh>,
    base: Arc<Subdivision>,
    /// What moves its points.
    material: Option<Material>,
    /// The primvars that the displacement reads.
    needs: Vec<String>,
}

/// All surfaces that stand somewhere.
///
/// # Errors
/// If a texture cannot be read, a patch is too large to hold, or the budget does not suffice.
pub fn objects(
    description: &Description,
    budget: &Budget,
    warnings: &mut Warnings,
) -> Result<Vec<Object>> {
    let options = BuildOptions {
        clay: Some(0.5),
        ..BuildOptions::default()
    };
    let textures = Textures::load(description, &options, budget, warnings)?;
    let (materials, _) = textures.materials(description, &options);
    let mut heights = Heights::new(&textures);
    let mut objects = Vec::new();
    for (number, shape) in description.shapes.iter().enumerate() {
        let places: Vec<u32> = (0_u32..)
            .zip(&description.placements)
            .filter(|(_, placement)| placement.shape == number)
            .map(|(i, _)| i)
            .collect();
        if places.is_empty() || shape.geometry.face_count() == 0 {
            continue;
        }
        let number = displacement_of(shape, &places, description, &materials);
        let material = number.map(|m| &materials[m]);
        let needs: Vec<String> = material
            .into_iter()
            .flat_map(Material::displacement_needs)
            .map(str::to_owned)
            .collect();
        if let Some(m) = number {
            textures
                .check_faces(&shape.geometry, &description.materials[m], &options)
                .map_err(|fault| name_shape(fault.into(), description, shape))?;
        }
        let height = number.map(|m| &description.materials[m].surface.displacement);
        let names: Vec<&str> = needs.iter().map(String::as_str).collect();
        let tiles = shape.tiles.as_ref();
        let st = match tiles {
            Some(tiles) => Some(tiles.primvar.as_str()),
            None => height.and_then(coordinates),
        };
        let lies_by = tiles.and(st).filter(|name| !names.contains(name));
        let names: Vec<&str> = names.iter().copied().chain(lies_by).collect();
        let (carrier, bounds, cage): (Arc<dyn Carrier>, _, _) = match &shape.geometry {
            scene::Geometry::Mesh(mesh) => {
                if tiles.is_some() && mesh.scheme == Scheme::None {
                    return Err(name_shape(tiles_over_polygons().into(), description, shape));
                }
                budget.ask(limit_surface(mesh), &shape.path)?;
                let base = Arc::new(Subdivision::carrying(mesh, &names, st));
                let cage = Cage {
                    mesh: mesh.clone(),
                    base: base.clone(),
                    material: material.cloned(),
                    needs: (needs.iter().filter(|name| mesh.primvar(name).is_some()))
                        .cloned()
                        .collect(),
                };
                (base, Bounds3::of(mesh.used_points()), Some(cage))
            }
            scene::Geometry::Nurbs(patch) => {
                let base = Patch::new(patch, &names, st)
                    .map_err(|fault| name_shape(fault.into(), description, shape))?;
                (Arc::new(base), patch.bounds(), None)
            }
        };
        let height = height.filter(|_| tiles.is_none());
        let displacement = height.map_or(Displacement::None, |height| {
            heights.displacement(height, &carrier)
        });
        let surface = Surface::new(carrier, displacement);
        objects.push(Object {
            path: shape.path.clone(),
            world_from_object: places
                .iter()
                .map(|&p| single(&description.placements[p as usize].world_from_object[0]))
                .collect(),
            surface: Arc::new(match tiles {
                Some(tiles) => surface.under(over(tiles)),
                None => surface,
            }),
            bounds,
            cage,
        });
    }
    Ok(objects)
}

impl Object {
    /// Embree's subdivision of it, and our limit surface of the same cage.
    ///
    /// # Errors
    /// If Embree cannot subdivide it.
    pub fn embree_subdivision(
        &self,
        rates: &Rates,
        device: &Device,
    ) -> Result<(Geometry, Arc<Subdivision>)> {
        let Some(cage) = &self.cage else {
            return Err(Fault::new("Embree subdivides control meshes only").into());
        };
        let corners = cage.base.corner_rates(&cage.mesh.topology(), rates);
        let width = |name: &str| cage.mesh.primvar(name).map_or(0, |p| p.width as usize);
        let widths: Vec<_> = cage.needs.iter().map(|n| (n.clone(), width(n))).collect();
        let options = SubdivisionOptions {
            rates: trace::Rates::PerCorner(corners.into_iter().map(|n| n as f32).collect()),
            displacement: (cage.material.clone())
                .map(|material| by_callback(material, &widths, &cage.base)),
            primvars: cage.needs.clone(),
        };
        let geometry = Geometry::subdivision(device, cage.mesh.clone(), options)?;
        Ok((geometry, cage.base.clone()))
    }

    /// Its box's diagonal.
    pub fn diagonal(&self) -> f32 {
        self.bounds.extent().length()
    }

    /// The diagonal's middle.
    pub fn centre(&self) -> Vec3 {
        self.bounds.centre()
    }
}
