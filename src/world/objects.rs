//! The meshes of a scene one by one, each with its displacement: for whoever compares ways of tracing them.

use std::sync::Arc;

use super::build::{BuildOptions, displacement_of, load_textures, materials, name_shape, single};
use super::geometry::displacement;
use crate::error::{Fault, Result, Warnings};
use crate::math::{Affine3A, Vec2, Vec3};
use crate::mesh::ControlMesh;
use crate::scene::Description;
use crate::shade::material::Material;
use crate::shade::texture_map::Primvars;
use crate::surface::{self, Amount, Function, Subdivision, Surface};
use crate::trace::{Rates, SubdivisionOptions};

/// A mesh of a scene.
pub struct Object {
    /// The prim.
    pub path: String,
    /// The cage.
    pub mesh: Arc<ControlMesh>,
    /// Where it stands when the shutter opens.
    pub world_from_object: Vec<Affine3A>,
    /// What moves its points.
    material: Option<Material>,
    /// The primvars that the displacement reads.
    needs: Vec<String>,
}

/// All meshes that stand somewhere. NURBS patches are left out, with a warning.
///
/// # Errors
/// If a texture cannot be read, or a displacement reads a primvar that is not its texture coordinates.
pub fn objects(description: &Description, warnings: &mut Warnings) -> Result<Vec<Object>> {
    let options = BuildOptions {
        clay: Some(0.5),
        ..BuildOptions::default()
    };
    let textures = load_textures(description, &options, warnings)?;
    let (materials, _) = materials(description, &textures, &options);
    let mut objects = Vec::new();
    for (number, shape) in description.shapes.iter().enumerate() {
        let places: Vec<u32> = (0_u32..)
            .zip(&description.placements)
            .filter(|(_, placement)| placement.shape == number)
            .map(|(i, _)| i)
            .collect();
        let Some(mesh) = shape.geometry.mesh() else {
            warnings.add("patches left out", || {
                format!("{}: NURBS patches are not compared", shape.path)
            });
            continue;
        };
        if places.is_empty() || mesh.face_count() == 0 {
            continue;
        }
        let material =
            displacement_of(shape, &places, description, &materials).map(|m| materials[m].clone());
        let needs: Vec<String> = material
            .iter()
            .flat_map(Material::displacement_needs)
            .filter(|name| mesh.primvar(name).is_some())
            .map(str::to_owned)
            .collect();
        let is_st = |name: &String| mesh.primvar(name).is_some_and(|p| p.width == 2);
        if needs.len() > 1 || !needs.iter().all(is_st) {
            let fault = Fault::new(format!("its displacement reads {}", needs.join(", ")))
                .advise("displace by an image over one set of texture coordinates");
            return Err(name_shape(fault.into(), description, shape));
        }
        objects.push(Object {
            path: shape.path.clone(),
            mesh: mesh.clone(),
            world_from_object: places
                .iter()
                .map(|&p| single(&description.placements[p as usize].world_from_object[0]))
                .collect(),
            material,
            needs,
        });
    }
    Ok(objects)
}

impl Object {
    /// Its limit surface, and that with its displacement.
    pub fn surface(&self) -> (Arc<Subdivision>, Arc<Surface>) {
        let name = self.needs.first().cloned();
        let base = Arc::new(Subdivision::new(&self.mesh, name.as_deref()));
        let displacement = match &self.material {
            None => surface::Displacement::None,
            Some(material) => {
                let material = material.clone();
                let height = Function::scalar(move |at| {
                    material.displacement(&At {
                        name: name.as_deref(),
                        st: at.st,
                    })
                });
                surface::Displacement::Scalar(Amount {
                    map: Arc::new(height),
                    scale: 1.0,
                    bias: 0.0,
                })
            }
        };
        let surface = Arc::new(Surface::new(base.clone(), displacement));
        (base, surface)
    }

    /// The same for Embree's subdivision.
    pub fn subdivision_options(&self, rates: Rates) -> SubdivisionOptions {
        SubdivisionOptions {
            rates,
            displacement: self
                .material
                .clone()
                .map(|material| displacement(material, &self.mesh, &self.needs)),
            primvars: self.needs.clone(),
        }
    }

    /// Its box's diagonal.
    pub fn diagonal(&self) -> f32 {
        crate::math::Bounds3::of(self.mesh.used_points())
            .extent()
            .length()
    }

    /// The diagonal's middle.
    pub fn centre(&self) -> Vec3 {
        crate::math::Bounds3::of(self.mesh.used_points()).centre()
    }
}

/// The one primvar that a displacement reads.
struct At<'a> {
    name: Option<&'a str>,
    st: Vec2,
}

impl Primvars for At<'_> {
    fn get(&self, name: &str, out: &mut [f32]) -> bool {
        if self.name != Some(name) || out.len() > 2 {
            return false;
        }
        out.copy_from_slice(&self.st.to_array()[..out.len()]);
        true
    }
}
