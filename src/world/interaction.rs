//! A point of a surface as the path tracer sees it.

use super::{World, at_time};
use crate::math::{Affine3A, Frame, Ray, Vec3};
use crate::shade::bsdf::{Bsdf, SurfaceParams, bent_towards};
use crate::shade::texture_map::Primvars;
use crate::trace::SceneHit;

use super::shape::{Place, Shape};

/// Where a path met a surface. Normals are unit vectors on the side that the ray came from.
#[derive(Debug, Clone)]
pub struct Interaction {
    /// World space; on the smooth surface where that lies in front of the traced facets.
    pub position: Vec3,
    /// Of the surface that light sees: of the limit surface with its displacement, of the surface that a polygon
    /// mesh's normals imply, or of the polygon.
    pub geometric_normal: Vec3,
    /// With normal maps.
    pub shading_normal: Vec3,
    /// Face of the control mesh.
    pub face: u32,
    /// Number of the placement, from 0.
    pub object: u32,
    /// 0..1.
    pub opacity: f32,
    /// Radiance that the surface itself emits.
    pub emission: Vec3,
    t: f32,
    error: f32,
    params: SurfaceParams,
}

impl Interaction {
    /// How the surface scatters light.
    pub fn bsdf(&self) -> Bsdf {
        Bsdf::new(
            &self.params,
            Frame::around(self.shading_normal),
            self.geometric_normal,
        )
    }

    /// Where a ray towards `direction` starts, clear of the surface.
    pub fn leave(&self, direction: Vec3) -> Vec3 {
        let side = if direction.dot(self.geometric_normal) < 0.0 {
            -1.0
        } else {
            1.0
        };
        self.position + side * self.error * self.geometric_normal
    }

    /// From where on the same ray goes on behind this point.
    pub fn beyond(&self, ray: &Ray) -> f32 {
        let slant = ray
            .direction
            .dot(self.geometric_normal)
            .abs()
            .max(0.05 * ray.direction.length());
        self.t + 2.0 * self.error / slant
    }
}

/// Rounding of Embree's triangle test and of our transforms stays below this many times the largest coordinate.
const RELATIVE_ERROR: f32 = 8e-6;

impl World {
    pub(super) fn interaction(&self, number: u32, ray: &Ray, hit: &SceneHit) -> Interaction {
        let placed = &self.placed[number as usize];
        let shape = &self.shapes[placed.shape as usize];
        let moved;
        let (world_from_object, object_from_world) = match &placed.world_from_object[..] {
            [still] => (still, &placed.object_from_world),
            keys => {
                let now = at_time(keys, ray.time);
                moved = (now, now.inverse());
                (&moved.0, &moved.1)
            }
        };

        // Geometry: where, and which way it faces. The facet's normal only tells sides until it is needed.
        let geometry = match hit.instance {
            Some(instance) => self.scene.instanced(instance).map_or_else(
                || self.scene.geometry(hit.geometry),
                |scene| scene.geometry(hit.geometry),
            ),
            None => self.scene.geometry(hit.geometry),
        };
        let facet = normal_transformed(object_from_world, hit.normal);
        let towards = if facet.dot(ray.direction) <= 0.0 {
            1.0
        } else {
            -1.0
        };
        let on_facet = ray.at(hit.t);
        let place = shape.place(hit, &ray.transformed(object_from_world));
        let point = shape.point(geometry, place, towards * hit.normal, ray.time);
        let largest = on_facet.abs().max(ray.origin.abs()).max_element();
        let error = RELATIVE_ERROR * largest.max(1e-6) + hit.error * stretch(world_from_object);
        // A normal of unit length on the facet's side; none where it is degenerate, as at some poles.
        let unit_normal = |n: Vec3| {
            let n = normal_transformed(object_from_world, n).try_normalize()?;
            Some(if n.dot(facet) < 0.0 { -n } else { n })
        };
        let mut position = on_facet;
        let mut geometric_normal = (point.smooth.as_ref())
            .and_then(|smooth| unit_normal(smooth.normal))
            .unwrap_or_else(|| facet.normalize_or_zero());
        if let Some(smooth) = &point.smooth {
            // Facets cut the corners of a convex surface: rays that leave from the facet would be shadowed by
            // their neighbours. The smooth surface lies in front of them there.
            let gap = world_from_object.transform_point3(smooth.position) - on_facet;
            let ahead = towards * gap.dot(geometric_normal);
            if shape.is_near_only() && gap.is_finite() {
                // A box is no facet: the surface may as well lie behind what was hit, within the error.
                position = on_facet + gap.clamp_length_max(error);
            } else if ahead > 0.0 && ahead.is_finite() {
                position = on_facet + towards * ahead * geometric_normal;
            }
        }
        geometric_normal *= towards;
        if geometric_normal.dot(ray.direction) > 0.0 {
            // Near an outline the facet is seen, and the smooth surface from behind.
            geometric_normal = bent_towards(geometric_normal, -ray.direction);
        }
        let mut shading_normal = geometric_normal;

        // Appearance.
        let material = placed
            .material
            .unwrap_or_else(|| shape.material(point.face));
        let primvars = Lookup {
            shape,
            place,
            geometry,
            placed_color: placed.display_color,
        };
        let resolved = self.materials[material as usize].resolve(&primvars);
        if let Some(map) = resolved.normal {
            shading_normal = self.materials[material as usize]
                .normal_primvar()
                .and_then(|name| shape.tangents(geometry, name, place, &point))
                .map_or(shading_normal, |tangents| {
                    bumped(
                        shading_normal,
                        geometric_normal,
                        map,
                        world_from_object,
                        tangents,
                        towards,
                    )
                });
        }
        shading_normal = bent_towards(shading_normal, -ray.direction);
        Interaction {
            position,
            geometric_normal,
            shading_normal,
            face: point.face,
            object: number,
            opacity: resolved.opacity,
            emission: resolved.emission,
            t: hit.t,
            error,
            params: resolved.params,
        }
    }
}

/// No vector gets longer by more than this: its square bounds the eigenvalues of the matrix's product with itself
/// (Gershgorin). What only turns and scales it bounds exactly.
fn stretch(map: &Affine3A) -> f32 {
    let columns = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let row = |a: &glam::Vec3A| columns.iter().map(|b| a.dot(*b).abs()).sum::<f32>();
    columns.iter().map(row).fold(0.0, f32::max).sqrt()
}

/// Normals transform by the inverse transpose.
fn normal_transformed(object_from_world: &Affine3A, normal: Vec3) -> Vec3 {
    Vec3::from(object_from_world.matrix3.transpose() * glam::Vec3A::from(normal))
}

/// Tilts `normal` by a tangent-space normal map whose x runs along the texture's s.
fn bumped(
    normal: Vec3,
    geometric: Vec3,
    map: Vec3,
    world_from_object: &Affine3A,
    [along_s, along_t]: [Vec3; 2],
    towards: f32,
) -> Vec3 {
    let tangent = world_from_object.transform_vector3(along_s);
    let tangent = (tangent - tangent.dot(normal) * normal).normalize_or_zero();
    if tangent == Vec3::ZERO {
        return normal;
    }
    let bitangent = normal.cross(tangent);
    let handed = bitangent
        .dot(world_from_object.transform_vector3(along_t))
        .signum();
    // Seen from behind, the map's bumps are dents.
    let tilted = (towards * map.x * tangent
        + towards * map.y * handed * bitangent
        + map.z.max(1e-3) * normal)
        .normalize();
    // Never beyond the horizon of the surface itself.
    if tilted.dot(geometric) > 1e-3 {
        tilted
    } else {
        normal
    }
}

struct Lookup<'a> {
    shape: &'a Shape,
    place: Place,
    geometry: &'a crate::trace::Geometry,
    placed_color: Option<[f32; 3]>,
}

impl Primvars for Lookup<'_> {
    fn get(&self, name: &str, out: &mut [f32]) -> bool {
        if name == "displayColor"
            && let Some(color) = self.placed_color
            && out.len() == 3
        {
            out.copy_from_slice(&color);
            return true;
        }
        self.shape.primvar(self.geometry, name, self.place, out)
    }
}
