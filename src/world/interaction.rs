//! A point of a surface as the path tracer sees it.

use std::cell::OnceCell;

use super::{Detail, World};
use crate::math::{Area, Cone, Frame, Ray, Vec2, Vec3};
use crate::shade::bsdf::{Bsdf, SurfaceParams, bent_towards};
use crate::shade::material::Tangents;
use crate::shade::texture_map::Primvars;
use crate::trace::{Geometry, SceneHit};

use super::shape::{Place, Shape};
use super::stand::Space;
use super::worn::Found;

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
    /// From the ray's origin, in lengths of its direction.
    pub t: f32,
    error: f32,
    /// Rays that leave ask for nothing nearer. Where hits are but near to the surface, what is around is as thick as
    /// they may be off, and in the way of rays that the surface itself lets go.
    clear: f32,
    params: SurfaceParams,
    place: Place,
    detail: Detail,
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

    /// A ray towards `direction`, whose length is 1, that starts clear of the surface.
    pub fn leave(&self, direction: Vec3, time: f32) -> Ray {
        self.leave_from((self.position, self.error), direction, time)
    }

    /// The side of the surface that a direction leaves to.
    fn side(&self, direction: Vec3) -> f32 {
        if direction.dot(self.geometric_normal) < 0.0 {
            -1.0
        } else {
            1.0
        }
    }

    fn leave_from(&self, (position, error): (Vec3, f32), direction: Vec3, time: f32) -> Ray {
        let origin = position + self.side(direction) * error * self.geometric_normal;
        Ray {
            t_min: self.clear,
            ..Ray::new(origin, direction, time)
        }
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
    /// As [`Interaction::leave`], for a ray that is to meet what is diced for paths that have bounced. Where that lies in
    /// front of the surface, the ray starts on it.
    pub fn bounce(&self, interaction: &Interaction, direction: Vec3, time: f32) -> Ray {
        let placed = &self.placed[interaction.object as usize];
        let shape = &self.shapes[placed.shape as usize];
        let bounced = match interaction.detail {
            Detail::Full => shape.bounced(interaction.place, time),
            Detail::Bounced => None,
        };
        let Some((point, off)) = bounced else {
            return interaction.leave(direction, time);
        };
        let mut moved = None;
        let space = placed.stand.at(time, &mut moved);
        let point = space.map_or(point, |space| space.point_to_world(point));
        let side = interaction.side(direction);
        let ahead = side * (point - interaction.position).dot(interaction.geometric_normal);
        let position = if ahead > 0.0 && point.is_finite() {
            point
        } else {
            interaction.position
        };
        let error = interaction.error + off * space.map_or(1.0, Space::stretch);
        interaction.leave_from((position, error), direction, time)
    }

    /// `ray`'s direction is unit if `cone` is any wider than a line.
    pub(super) fn interaction(
        &self,
        number: u32,
        ray: &Ray,
        cone: Cone,
        (hit, detail): (&SceneHit, Detail),
    ) -> Interaction {
        let placed = &self.placed[number as usize];
        let shape = &self.shapes[placed.shape as usize];
        let mut moved = None;
        let space = placed.stand.at(ray.time, &mut moved);
        let point_to_world = |p: Vec3| space.map_or(p, |space| space.point_to_world(p));
        let unit_normal_to_world =
            |n: Vec3| space.map_or(n, |s| s.normal_to_world(n).normalize_or_zero());

        // Geometry: where, and which way it faces. The facet's normal only tells sides until it is needed.
        let scene = self.scene(detail);
        let geometry = match hit.instance {
            Some(instance) => scene.instanced(instance).map_or_else(
                || scene.geometry(hit.geometry),
                |scene| scene.geometry(hit.geometry),
            ),
            None => scene.geometry(hit.geometry),
        };
        let facet = space.map_or(hit.normal, |space| space.normal_to_world(hit.normal));
        let towards = if facet.dot(ray.direction) <= 0.0 {
            1.0
        } else {
            -1.0
        };
        let on_facet = ray.at(hit.t);
        let place = shape.place(hit, detail, || {
            space.map_or(*ray, |space| space.ray_from_world(ray))
        });
        let point = shape.point(geometry, place, towards * hit.normal, ray.time);
        let largest = on_facet.abs().max(ray.origin.abs()).max_element();
        // The hit's own error is in the object's space.
        let own_error = hit.error * space.map_or(1.0, Space::stretch);
        let error = RELATIVE_ERROR * largest.max(1e-6) + own_error;
        let mut position = on_facet;
        // Degenerate at some poles: the facet's stands in.
        let smooth_normal = (point.smooth.as_ref())
            .map(|smooth| unit_normal_to_world(smooth.normal))
            .filter(|&n| n != Vec3::ZERO);
        let mut geometric_normal = match smooth_normal {
            Some(n) if n.dot(facet) < 0.0 => -n,
            Some(n) => n,
            None => facet.normalize_or_zero(),
        };
        if let Some(smooth) = &point.smooth {
            // Facets cut the corners of a convex surface: rays that leave from the facet would be shadowed by
            // their neighbours. The smooth surface lies in front of them there.
            let gap = point_to_world(smooth.position) - on_facet;
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
        let worn = placed.worn.unwrap_or_else(|| shape.worn(point.face));
        let worn = &self.worn[worn as usize];
        let primvars = Lookup {
            found: &worn.found,
            shape,
            place,
            geometry,
            placed_color: placed.display_color,
            width: cone.at(hit.t),
            ray,
            slopes: &point.derivatives,
            space,
            area: OnceCell::new(),
        };
        let resolved = worn.material.resolve(&primvars);
        if let Some(map) = resolved.normal {
            let tangents = match worn.material.tangents() {
                Some(Tangents::OfRead(read)) => (worn.found[read].slot)
                    .and_then(|slot| shape.tangents(geometry, slot, place, &point)),
                Some(Tangents::OfFace) => shape.face_tangents(place, &point),
                None => None,
            };
            shading_normal = tangents.map_or(shading_normal, |tangents| {
                bumped(
                    shading_normal,
                    geometric_normal,
                    map,
                    tangents.map(|t| space.map_or(t, |space| space.vector_to_world(t))),
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
            clear: if shape.is_near_only() { own_error } else { 0.0 },
            params: resolved.params,
            place,
            detail,
        }
    }
}

/// Tilts `normal` by a tangent-space normal map whose x runs along the texture's s, or the Ptex face's u.
fn bumped(
    normal: Vec3,
    geometric: Vec3,
    map: Vec3,
    [along_s, along_t]: [Vec3; 2],
    towards: f32,
) -> Vec3 {
    let tangent = (along_s - along_s.dot(normal) * normal).normalize_or_zero();
    if tangent == Vec3::ZERO {
        return normal;
    }
    let bitangent = normal.cross(tangent);
    let handed = bitangent.dot(along_t).signum();
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
    /// By the material's reads.
    found: &'a [Found],
    shape: &'a Shape,
    place: Place,
    geometry: &'a Geometry,
    placed_color: Option<[f32; 3]>,
    /// Across the ray that hit, scene units.
    width: f32,
    ray: &'a Ray,
    /// Derivatives of the position by the parameters of the place, object space.
    slopes: &'a [Vec3; 2],
    space: Option<&'a Space>,
    /// See [`Lookup::area`].
    area: OnceCell<Area>,
}

impl Lookup<'_> {
    /// What the ray covers, in the parameters of the place.
    fn area(&self) -> &Area {
        self.area.get_or_init(|| {
            let slopes = (self.slopes).map(|d| self.space.map_or(d, |s| s.vector_to_world(d)));
            covered(self.width, self.ray.direction, slopes)
        })
    }
}

/// What a ray of this width covers of the plane that the derivatives `du` and `dv` of its points span, in its parameters:
/// the axes of the ellipse in which it cuts a round ray. The ray's direction is unit.
///
/// Akenine-Möller, Crassin, Boksansky, Belcour, Panteleev and Wright, "Improved Shader and Texture Level of Detail Using
/// Ray Cones" (JCGT 10, 2021), section 4.
fn covered(width: f32, direction: Vec3, [du, dv]: [Vec3; 2]) -> Area {
    /// Nearer to the horizon nothing gets longer.
    const LEAST_COSINE: f32 = 1e-3;
    let normal = du.cross(dv);
    let squared = normal.length_squared();
    if width <= 0.0 || squared == 0.0 || !squared.is_finite() {
        return Area::POINT;
    }
    let unit = normal / squared.sqrt();
    // Looked at squarely, all directions are alike.
    let across = (unit.cross(direction).try_normalize())
        .or_else(|| du.try_normalize())
        .unwrap_or(Vec3::ZERO);
    let cosine = unit.dot(direction).abs().max(LEAST_COSINE);
    let axes = [width * across, width / cosine * unit.cross(across)];
    let area = axes.map(|x| Vec2::new(x.cross(dv).dot(normal), du.cross(x).dot(normal)) / squared);
    if area.iter().all(|a| a.is_finite()) {
        Area(area)
    } else {
        Area::POINT
    }
}

impl Primvars for Lookup<'_> {
    fn get(&self, read: usize, out: &mut [f32]) -> bool {
        let Found { slot, is_color } = self.found[read];
        match (self.placed_color, slot) {
            (Some(color), _) if is_color => out.copy_from_slice(&color),
            (_, Some(slot)) => self.shape.primvar(self.geometry, slot, self.place, out),
            (_, None) => return false,
        }
        true
    }

    fn coordinates(&self, read: usize) -> Option<(Vec2, Area)> {
        match self.found[read].slot {
            Some(slot) if self.width > 0.0 => {
                let (st, slopes) = self.shape.coordinates(self.geometry, slot, self.place);
                Some((st, self.area().mapped(slopes)))
            }
            _ => {
                let mut st = [0.0; 2];
                self.get(read, &mut st).then(|| (st.into(), Area::POINT))
            }
        }
    }

    fn ptex(&self) -> Option<(u32, Vec2)> {
        self.shape.ptex(self.place)
    }

    fn ptex_area(&self) -> Area {
        if self.width <= 0.0 {
            return Area::POINT;
        }
        self.area().mapped(self.shape.ptex_slopes(self.place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_covers_the_ellipse_that_the_plane_cuts() {
        let slopes = [Vec3::new(2.0, 0.0, 0.1), Vec3::new(-0.5, 0.0, 3.0)];
        let normal = slopes[0].cross(slopes[1]);
        for direction in [
            Vec3::NEG_Y,
            Vec3::new(0.3, -1.0, 0.2),
            Vec3::new(5.0, 0.1, -3.0),
        ] {
            let direction = direction.normalize();
            let area = covered(0.25, direction, slopes);
            // On the plane again.
            let [a, b] = area.0.map(|x| x.x * slopes[0] + x.y * slopes[1]);
            let cosine = normal.normalize().dot(direction).abs();
            assert!((a.length() - 0.25).abs() < 1e-5 && a.dot(direction).abs() < 1e-5);
            assert!((b.length() - 0.25 / cosine).abs() < 1e-4 && a.dot(b).abs() < 1e-4);
            // Seen along the ray, it is round.
            let seen = b - b.dot(direction) * direction;
            assert!((seen.length() - 0.25).abs() < 1e-4, "{seen}");
        }
        let none = [Vec3::X, 2.0 * Vec3::X];
        assert_eq!(covered(0.25, Vec3::NEG_Y, none), Area::POINT);
        assert_eq!(covered(0.0, Vec3::NEG_Y, slopes), Area::POINT);
    }
}
