//! A control mesh as Embree's geometry: subdivision where Embree knows the scheme, triangles elsewhere.

use std::sync::Arc;

use super::build::BuildOptions;
use super::dicing::{self, Dicing};
use super::shape::{Polygons, Surface};
use crate::error::{Result, Warnings};
use crate::math::Affine3A;
use crate::mesh::{ControlMesh, CreaseMethod, Scheme, TriangleRule, triangulate};
use crate::shade::camera::Camera;
use crate::shade::material::Material;
use crate::shade::texture_map::Primvars;
use crate::subdiv;
use crate::trace::{Device, Displacement, DisplacementPoint, Geometry, Rates, SubdivisionOptions};

/// `parent_face` has the file's face of each face of `mesh`, where these are not the same.
#[expect(
    clippy::too_many_arguments,
    reason = "one call; a struct of these would have no other use"
)]
pub(super) fn geometry(
    device: &Device,
    mesh: &Arc<ControlMesh>,
    needs: &[String],
    displaced: Option<&Material>,
    places: &[Affine3A],
    camera: &Camera,
    options: &BuildOptions,
    parent_face: Option<&[u32]>,
    path: &str,
    warnings: &mut Warnings,
) -> Result<(Geometry, Surface)> {
    let warn_flat = |warnings: &mut Warnings| {
        if displaced.is_some() {
            warnings.add(format!("displacement of {:?}", mesh.scheme), || {
                format!(
                    "{path}: displacement needs a Catmull-Clark or bilinear mesh; it is left out"
                )
            });
        }
    };
    match mesh.scheme {
        Scheme::CatmullClark | Scheme::Bilinear => {
            if mesh.crease_method == CreaseMethod::Chaikin && !mesh.creases.is_empty() {
                warnings.add("crease method chaikin", || {
                    format!("{path}: Embree knows no Chaikin creasing; sharpness decays uniformly")
                });
            }
            if mesh.triangle_rule == TriangleRule::Smooth && mesh.face_vertex_counts.contains(&3) {
                warnings.add("triangle rule smooth", || {
                    format!("{path}: Embree knows no smooth-triangle rule; triangles are refined like any face")
                });
            }
            let width = |name: &str| mesh.primvar(name).map_or(0, |p| p.width as usize);
            let subdivision = SubdivisionOptions {
                rates: Rates::PerCorner(dicing::rates(mesh, places, camera, &options.dicing)),
                displacement: displaced.map(|material| displacement(material.clone(), mesh, needs)),
                primvars: needs.to_vec(),
            };
            let geometry = Geometry::subdivision(device, mesh.clone(), subdivision)?;
            let primvars = needs.iter().map(|n| (n.clone(), width(n))).collect();
            Ok((geometry, Surface::Subdivision { primvars }))
        }
        Scheme::Loop => {
            warnings.add("Loop by refinement", || {
                format!("{path}: Embree knows no Loop subdivision; the mesh is refined to triangles on the limit surface")
            });
            warn_flat(warnings);
            let levels = loop_levels(mesh, places, camera, &options.dicing);
            let mut refined = subdiv::refine(mesh, levels);
            refined.move_to_limit(mesh);
            polygons(device, &Arc::new(refined.mesh), Some(&refined.parent_face))
        }
        Scheme::None => {
            warn_flat(warnings);
            polygons(device, mesh, parent_face)
        }
    }
}

fn polygons(
    device: &Device,
    mesh: &Arc<ControlMesh>,
    parent_face: Option<&[u32]>,
) -> Result<(Geometry, Surface)> {
    let triangles = triangulate(mesh);
    let index = |corner: u32| mesh.face_vertex_indices[corner as usize];
    let indices = triangles.corners.iter().map(|t| t.map(index)).collect();
    let geometry = Geometry::triangles(device, indices, Arc::new(mesh.points.clone()))?;
    let surface = Surface::Polygons(Polygons::new(
        mesh.clone(),
        triangles.corners,
        triangles.faces,
        parent_face,
    ));
    Ok((geometry, surface))
}

/// Levels after which the longest edge is no longer than the dicing rate; each makes four triangles of one.
pub(super) fn loop_levels(
    mesh: &ControlMesh,
    places: &[Affine3A],
    camera: &Camera,
    dicing: &Dicing,
) -> u32 {
    const MOST_TRIANGLES: f64 = 4e6;
    let longest = dicing::rates(mesh, places, camera, dicing)
        .into_iter()
        .fold(1.0, f32::max);
    let affordable = (MOST_TRIANGLES / mesh.face_count().max(1) as f64)
        .log(4.0)
        .max(1.0);
    (longest.log2().ceil() as u32)
        .clamp(2, 7)
        .min(affordable as u32)
}

/// The material's displacement along the normal.
pub(super) fn displacement(
    material: Material,
    mesh: &ControlMesh,
    needs: &[String],
) -> Displacement {
    let widths = needs
        .iter()
        .map(|n| (n.clone(), mesh.primvar(n).map_or(0, |p| p.width as usize)))
        .collect();
    let carried = Carried { widths };
    Arc::new(move |point| {
        let height = material.displacement(&At {
            point,
            carried: &carried,
        });
        height * point.normal
    })
}

/// Primvars that a displaced surface carries, by slot.
struct Carried {
    widths: Vec<(String, usize)>,
}

struct At<'a> {
    point: &'a DisplacementPoint<'a>,
    carried: &'a Carried,
}

impl Primvars for At<'_> {
    fn get(&self, name: &str, out: &mut [f32]) -> bool {
        let slot = self
            .carried
            .widths
            .iter()
            .position(|(n, width)| n == name && *width >= out.len());
        slot.inspect(|&slot| self.point.primvar(slot, out))
            .is_some()
    }
}
