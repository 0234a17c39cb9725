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
use crate::trace::{
    Device, Displacement, DisplacementPoint, Geometry, Rates, SubdivisionOptions, check_limits,
};

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
    if let Some(reason) = refined_because(mesh, displaced.is_some()) {
        warnings.add(format!("refinement: {reason}"), || {
            format!("{path}: {reason}; the mesh is refined to polygons on the limit surface")
        });
        warn_flat(warnings);
        let levels = refinement_levels(mesh, places, camera, &options.dicing);
        let mut refined = subdiv::refine(mesh, levels);
        refined.move_to_limit(mesh);
        return polygons(device, &Arc::new(refined.mesh), Some(&refined.parent_face));
    }
    if mesh.scheme == Scheme::None {
        warn_flat(warnings);
        return polygons(device, mesh, parent_face);
    }
    if has_chaikin_creases(mesh) {
        warnings.add("crease method chaikin", || {
            format!("{path}: {NO_CHAIKIN}; under displacement, sharpness decays uniformly")
        });
    }
    if has_smooth_triangles(mesh) {
        warnings.add("triangle rule smooth", || {
            format!(
                "{path}: {NO_SMOOTH_TRIANGLES}; under displacement, they are refined like any face"
            )
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

const NO_CHAIKIN: &str = "Embree knows no Chaikin creasing";
const NO_SMOOTH_TRIANGLES: &str = "Embree knows no smooth rule for triangles";

fn has_chaikin_creases(mesh: &ControlMesh) -> bool {
    mesh.crease_method == CreaseMethod::Chaikin && !mesh.creases.is_empty()
}

fn has_smooth_triangles(mesh: &ControlMesh) -> bool {
    mesh.triangle_rule == TriangleRule::Smooth && mesh.face_vertex_counts.contains(&3)
}

/// Why a mesh is refined by ourselves, if it is one that Embree cannot subdivide, or not as it says. Displaced ones
/// stay with Embree as far as it can hold them.
pub(super) fn refined_because(mesh: &ControlMesh, displaced: bool) -> Option<String> {
    match mesh.scheme {
        Scheme::None => None,
        Scheme::Loop => Some("Embree knows no Loop subdivision".to_owned()),
        Scheme::CatmullClark | Scheme::Bilinear if displaced => None,
        Scheme::CatmullClark | Scheme::Bilinear => match check_limits(mesh) {
            Err(fault) => Some(fault.to_string()),
            Ok(()) if has_chaikin_creases(mesh) => Some(NO_CHAIKIN.to_owned()),
            Ok(()) if has_smooth_triangles(mesh) => Some(NO_SMOOTH_TRIANGLES.to_owned()),
            Ok(()) => None,
        },
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

/// Levels after which the longest edge is no longer than the dicing rate; each makes four faces of one.
pub(super) fn refinement_levels(
    mesh: &ControlMesh,
    places: &[Affine3A],
    camera: &Camera,
    dicing: &Dicing,
) -> u32 {
    const MOST_TRIANGLES: f64 = 4e6;
    let longest = dicing::rates(mesh, places, camera, dicing)
        .into_iter()
        .fold(1.0, f32::max);
    let affordable = (MOST_TRIANGLES / mesh.face_vertex_indices.len().max(1) as f64)
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
