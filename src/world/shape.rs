//! What is kept of a shape once Embree has its geometry: which face a hit is on, its limit point, its primvars.

use std::sync::Arc;

use super::Detail;
use super::displacement::{embree_slot, of_embree};
use super::method::HitPlaces;
use crate::math::{Ray, Vec2, Vec3};
use crate::mesh::{ControlMesh, Interpolation, Primvar};
use crate::shade::texture_map::Read;
use crate::surface::{self, Carrier, FaceGrid, Rates, Subdivision};
use crate::trace::{Geometry, SceneHit, SurfacePoint};

/// Farther than this part of a face, a step of [`Smooth::refined`] is none: the surface is too bent there.
const FARTHEST_STEP: f32 = 0.25;

pub(super) struct Shape {
    pub(super) surface: Surface,
    /// Numbers of worn materials, by face; one for all if there is but one.
    pub(super) worn: Vec<u32>,
}

pub(super) enum Surface {
    /// Embree's subdivision geometry: its primitives are the control mesh's faces.
    Subdivision {
        /// Primvars that Embree interpolates, name and width, by slot.
        primvars: Vec<(String, usize)>,
        /// Our surface of the same cage, to tell Ptex faces.
        base: Arc<Subdivision>,
    },
    /// A surface of ours.
    Smooth(Smooth),
    Polygons(Polygons),
}

/// A surface of ours, which answers for its points and primvars itself.
pub(super) struct Smooth {
    pub(super) surface: Arc<surface::Surface>,
    /// The same without displacement, with primvars.
    pub(super) carrier: Arc<dyn Carrier>,
    pub(super) places: HitPlaces,
    /// The same diced more coarsely, if it is.
    pub(super) bounced: Option<Bounced>,
}

/// A surface as it is diced for paths that have bounced.
pub(super) struct Bounced {
    pub(super) places: HitPlaces,
    pub(super) rates: Rates,
    /// How far what is traced may be from the micro-triangles of these rates.
    pub(super) off: f32,
}

/// Triangles of a polygon mesh.
pub(super) struct Polygons {
    pub(super) mesh: Arc<ControlMesh>,
    /// Corners of each triangle: indices into the mesh's `face_vertex_indices`.
    pub(super) corners: Vec<[u32; 3]>,
    /// Face of each triangle.
    pub(super) faces: Vec<u32>,
}

/// Where on a shape a hit is: a face of a surface of ours, or a primitive of Embree's, and parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) face: u32,
    pub(super) uv: Vec2,
}

/// What a shape is like at a hit, in object space.
pub(super) struct Point {
    /// Face of the control mesh.
    pub(super) face: u32,
    /// Derivatives of the position by the parameters of the place.
    pub(super) derivatives: [Vec3; 2],
    /// On the smooth surface that the traced facets stand for, if there is one.
    pub(super) smooth: Option<SmoothPoint>,
}

/// A point of a limit surface, with its displacement, or of the surface that a polygon mesh's normals imply.
pub(super) struct SmoothPoint {
    pub(super) position: Vec3,
    /// Unit, or zero where there is none.
    pub(super) normal: Vec3,
}

impl Shape {
    pub(super) fn worn(&self, face: u32) -> u32 {
        match self.worn[..] {
            [all] => all,
            _ => self.worn[face as usize],
        }
    }

    /// `ray` is asked for the ray that hit, in object space, only where that is needed.
    #[inline]
    pub(super) fn place(&self, hit: &SceneHit, detail: Detail, ray: impl FnOnce() -> Ray) -> Place {
        let (face, uv) = match &self.surface {
            Surface::Smooth(smooth) => smooth.places(detail).face_uv(hit),
            Surface::Subdivision { .. } | Surface::Polygons(_) => (hit.primitive, hit.uv),
        };
        let place = Place { face, uv };
        match &self.surface {
            Surface::Smooth(smooth) if self.is_near_only() => smooth.refined(place, hit, &ray()),
            _ => place,
        }
    }

    /// Whether hits are but near to the surface, which is to be asked where it is.
    pub(super) fn is_near_only(&self) -> bool {
        matches!(&self.surface, Surface::Smooth(smooth) if matches!(smooth.places, HitPlaces::NearHit))
    }

    /// The point of the micro-triangle at a place, as it is diced for paths that have bounced, and how far what is traced
    /// may be from it; none if that is diced as for all others.
    pub(super) fn bounced(&self, place: Place, time: f32) -> Option<(Vec3, f32)> {
        let Surface::Smooth(smooth) = &self.surface else {
            return None;
        };
        let bounced = smooth.bounced.as_ref()?;
        let grid = FaceGrid::new(&smooth.surface, &bounced.rates, place.face);
        let (corners, weights) = grid.facet(place.uv);
        let [a, b, c] = corners.map(|uv| smooth.position(Place { uv, ..place }, time));
        let point = a + weights.x * (b - a) + weights.y * (c - a);
        Some((point, bounced.off))
    }

    /// `facet` is the hit's normal on the side that the ray comes from.
    pub(super) fn point(&self, geometry: &Geometry, place: Place, facet: Vec3, time: f32) -> Point {
        let Place { face, uv } = place;
        match &self.surface {
            Surface::Subdivision { .. } => {
                let point = geometry.displaced_point(face, uv, time);
                Point {
                    face,
                    derivatives: [point.du, point.dv],
                    smooth: Some(SmoothPoint {
                        position: point.position,
                        normal: point.du.cross(point.dv).normalize_or_zero(),
                    }),
                }
            }
            Surface::Smooth(smooth) => {
                let mut point = smooth.point(place, time);
                if smooth.places.are_below() {
                    point.smooth = None;
                }
                point
            }
            Surface::Polygons(polygons) => {
                let triangle = geometry.surface_point(face, uv, time);
                Point {
                    face: polygons.faces[face as usize],
                    derivatives: [triangle.du, triangle.dv],
                    smooth: polygons.smooth(face, uv, &triangle, facet),
                }
            }
        }
    }

    /// The first components of the primvar in a slot, as many as `out` is long.
    pub(super) fn primvar(
        &self,
        geometry: &Geometry,
        slot: usize,
        Place { face, uv }: Place,
        out: &mut [f32],
    ) {
        match &self.surface {
            Surface::Subdivision { .. } => geometry.primvar(slot, face, uv, out),
            Surface::Smooth(Smooth { carrier, .. }) => carrier.primvar(slot, face, uv, out),
            Surface::Polygons(polygons) => {
                polygons.blend(&polygons.mesh.primvars[slot], face, uv, out);
            }
        }
    }

    /// The Ptex face, and the point on it.
    pub(super) fn ptex(&self, Place { face, uv }: Place) -> Option<(u32, Vec2)> {
        match &self.surface {
            Surface::Smooth(Smooth { carrier, .. }) => carrier.ptex(face, uv),
            Surface::Subdivision { base, .. } => {
                let (face, uv) = of_embree(base, face, uv);
                base.ptex(face, uv)
            }
            Surface::Polygons(_) => None,
        }
    }

    /// Texture coordinates that a slot holds, with their derivatives by the parameters of the place.
    pub(super) fn coordinates(
        &self,
        geometry: &Geometry,
        slot: usize,
        place: Place,
    ) -> (Vec2, [Vec2; 2]) {
        let st = |uv: Vec2| {
            let mut out = [0.0; 2];
            self.primvar(geometry, slot, Place { uv, ..place }, &mut out);
            Vec2::from(out)
        };
        match &self.surface {
            Surface::Smooth(Smooth { carrier, .. }) => {
                match carrier.primvar_first_slopes(slot, place.face, place.uv) {
                    Some(known) => (known.st, [known.du, known.dv]),
                    None => (st(place.uv), [Vec2::ZERO; 2]),
                }
            }
            Surface::Subdivision { .. } => (st(place.uv), self.differences(geometry, slot, place)),
            // Linear over a triangle.
            Surface::Polygons(_) => {
                let first = st(Vec2::ZERO);
                (st(place.uv), [Vec2::X, Vec2::Y].map(|uv| st(uv) - first))
            }
        }
    }

    /// The derivatives of the parameters on the Ptex face by those of the place.
    pub(super) fn ptex_slopes(&self, Place { face, uv }: Place) -> [Vec2; 2] {
        match &self.surface {
            Surface::Smooth(Smooth { carrier, .. }) => carrier.ptex_slopes(face, uv),
            // Embree's faces and sub-faces are Ptex faces.
            Surface::Subdivision { .. } | Surface::Polygons(_) => [Vec2::X, Vec2::Y],
        }
    }

    /// Directions in which the texture coordinates that a slot holds grow, object space.
    pub(super) fn tangents(
        &self,
        geometry: &Geometry,
        slot: usize,
        place: Place,
        point: &Point,
    ) -> Option<[Vec3; 2]> {
        let [along_u, along_v] = match &self.surface {
            Surface::Smooth(Smooth { carrier, .. }) => {
                let st = carrier.primvar_slopes(slot, place.face, place.uv)?;
                [st.du, st.dv]
            }
            Surface::Subdivision { .. } | Surface::Polygons(_) => {
                self.differences(geometry, slot, place)
            }
        };
        growing(point, [along_u, along_v])
    }

    /// Directions in which the parameters of the Ptex face grow, object space.
    pub(super) fn face_tangents(&self, place: Place, point: &Point) -> Option<[Vec3; 2]> {
        growing(point, self.ptex_slopes(place))
    }

    /// Derivatives of texture coordinates over a small step in the face's own parameters.
    fn differences(&self, geometry: &Geometry, slot: usize, place: Place) -> [Vec2; 2] {
        const STEP: f32 = 1e-3;
        let Place { face, uv } = place;
        let step = Vec2::new(
            if uv.x < 0.5 { STEP } else { -STEP },
            if uv.y < 0.5 { STEP } else { -STEP },
        );
        let st = |uv: Vec2| {
            let mut out = [0.0; 2];
            self.primvar(geometry, slot, Place { face, uv }, &mut out);
            Vec2::from(out)
        };
        let here = st(uv);
        [
            (st(uv + Vec2::new(step.x, 0.0)) - here) / step.x,
            (st(uv + Vec2::new(0.0, step.y)) - here) / step.y,
        ]
    }
}

/// Directions in which coordinates grow that have these derivatives by the parameters of a point's place.
fn growing(point: &Point, [along_u, along_v]: [Vec2; 2]) -> Option<[Vec3; 2]> {
    let determinant = along_u.perp_dot(along_v);
    if determinant.abs() < 1e-20 {
        return None;
    }
    let [du, dv] = point.derivatives;
    let along_s = (du * along_v.y - dv * along_u.y) / determinant;
    let along_t = (dv * along_u.x - du * along_v.x) / determinant;
    Some([along_s, along_t])
}

impl Surface {
    /// The slot of a primvar with the components that are read.
    pub(super) fn slot(&self, read: &Read) -> Option<usize> {
        match self {
            Self::Subdivision { primvars, .. } => embree_slot(primvars, read),
            Self::Smooth(Smooth { carrier, .. }) => carrier.slot(&read.name, read.width),
            Self::Polygons(Polygons { mesh, .. }) => {
                let fits = |p: &Primvar| p.name == read.name && p.width as usize >= read.width;
                mesh.primvars.iter().position(fits)
            }
        }
    }
}

impl Smooth {
    /// How hits on what is diced for such a ray tell where they are.
    #[inline]
    fn places(&self, detail: Detail) -> &HitPlaces {
        match (&self.bounced, detail) {
            (Some(bounced), Detail::Bounced) => &bounced.places,
            _ => &self.places,
        }
    }

    /// Where the ray meets the tangent plane at a place near the hit: one step of Newton's, no farther than the hit may
    /// be from the surface.
    fn refined(&self, place: Place, hit: &SceneHit, ray: &Ray) -> Place {
        let point = self.point(place, ray.time);
        let [du, dv] = point.derivatives;
        let Some(smooth) = &point.smooth else {
            return place;
        };
        let normal = du.cross(dv);
        let slant = normal.dot(ray.direction);
        let at = ray.at(hit.t);
        let along = normal.dot(smooth.position - at) / slant;
        let to_plane = (along * ray.direction).clamp_length_max(hit.error);
        // Along an outline the plane is nowhere near.
        let to_plane = if to_plane.is_finite() {
            to_plane
        } else {
            Vec3::ZERO
        };
        let off = at + to_plane - smooth.position;
        // The one of least squares: what is across the plane does not count.
        let (uu, uv, vv) = (du.length_squared(), du.dot(dv), dv.length_squared());
        let (u, v) = (du.dot(off), dv.dot(off));
        let step = Vec2::new(u * vv - v * uv, v * uu - u * uv) / (uu * vv - uv * uv);
        let uv = place.uv + step;
        if uv.is_finite() && uv.distance(place.uv) < FARTHEST_STEP {
            Place {
                uv: uv.clamp(Vec2::ZERO, Vec2::ONE),
                ..place
            }
        } else {
            place
        }
    }

    /// The motion key before a time, and how far that is from it to the next.
    fn moment(&self, time: f32) -> (u32, f32) {
        let last = self.surface.base().keys() - 1;
        let at = time.clamp(0.0, 1.0) * last as f32;
        let key = (at as u32).min(last.saturating_sub(1));
        (key, at - key as f32)
    }

    fn position(&self, Place { face, uv }: Place, time: f32) -> Vec3 {
        let (key, part) = self.moment(time);
        let position = self.surface.position(face, uv, key);
        if part > 0.0 {
            position.lerp(self.surface.position(face, uv, key + 1), part)
        } else {
            position
        }
    }

    fn point(&self, Place { face, uv }: Place, time: f32) -> Point {
        let (key, part) = self.moment(time);
        let mut point = self.surface.evaluate(face, uv, key);
        if part > 0.0 {
            let next = self.surface.evaluate(face, uv, key + 1);
            point.position = point.position.lerp(next.position, part);
            point.du = point.du.lerp(next.du, part);
            point.dv = point.dv.lerp(next.dv, part);
            point.normal = point.normal.lerp(next.normal, part);
            let normal = point.du.cross(point.dv);
            if let Some(normal) = normal.try_normalize() {
                point.normal = normal;
            }
        }
        Point {
            face: self.carrier.parent(face),
            derivatives: [point.du, point.dv],
            smooth: Some(SmoothPoint {
                position: point.position,
                normal: point.normal,
            }),
        }
    }
}

impl Polygons {
    /// The first components of a primvar of the mesh over a triangle.
    fn blend(&self, primvar: &Primvar, triangle: u32, uv: Vec2, out: &mut [f32]) {
        match primvar.interpolation {
            Interpolation::Constant => out.copy_from_slice(&primvar.get(0)[..out.len()]),
            Interpolation::Uniform => out
                .copy_from_slice(&primvar.get(self.faces[triangle as usize] as usize)[..out.len()]),
            Interpolation::Varying | Interpolation::Vertex | Interpolation::FaceVarying => {
                let corners = self.corners[triangle as usize];
                let element = |corner: u32| match primvar.interpolation {
                    Interpolation::FaceVarying => primvar.get(corner as usize),
                    _ => primvar.get(self.mesh.face_vertex_indices[corner as usize] as usize),
                };
                let [a, b, c] = corners.map(element);
                for (i, value) in out.iter_mut().enumerate() {
                    *value = (1.0 - uv.x - uv.y) * a[i] + uv.x * b[i] + uv.y * c[i];
                }
            }
        }
    }

    /// The point of the smooth surface that the mesh's normals imply, over a point of a triangle; none without
    /// normals. `facet` is the triangle's normal on the side that the ray comes from.
    ///
    /// Hanika, "Hacking the Shadow Terminator" (Ray Tracing Gems II, 2021, ch. 4): each corner pulls the point up
    /// to its own tangent plane if it lies below, by the corner's barycentric weight. Rays that leave from there
    /// are not shadowed by neighbouring facets of a convex part of the mesh, and the shadow begins where the
    /// interpolated normal says, not along the facets' edges. Unlike the chapter we turn the normals to the ray's
    /// side, so that the mesh may be seen from either, and only use the lift along the interpolated normal.
    fn smooth(
        &self,
        triangle: u32,
        uv: Vec2,
        at: &SurfacePoint,
        facet: Vec3,
    ) -> Option<SmoothPoint> {
        let normals = self.mesh.normals.as_ref()?;
        let mut normal = [0.0; 3];
        self.blend(normals, triangle, uv, &mut normal);
        let normal = Vec3::from(normal);
        let towards = if normal.dot(facet) < 0.0 { -1.0 } else { 1.0 };
        let first = at.position - uv.x * at.du - uv.y * at.dv;
        let corners = [
            (1.0 - uv.x - uv.y, Vec2::ZERO, first),
            (uv.x, Vec2::X, first + at.du),
            (uv.y, Vec2::Y, first + at.dv),
        ];
        let mut position = at.position;
        for (weight, uv, corner) in corners {
            let mut n = [0.0; 3];
            self.blend(normals, triangle, uv, &mut n);
            let n = towards * Vec3::from(n).normalize_or_zero();
            position -= weight * (at.position - corner).dot(n).min(0.0) * n;
        }
        Some(SmoothPoint {
            position,
            normal: normal.normalize_or_zero(),
        })
    }
}
