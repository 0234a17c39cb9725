//! What is kept of a shape once Embree has its geometry: which face a hit is on, its limit point, its primvars.

use std::sync::Arc;

use crate::math::{Vec2, Vec3};
use crate::mesh::{ControlMesh, Interpolation, Primvar};
use crate::scene::Binding;
use crate::trace::{Geometry, SceneHit, SurfacePoint};

pub(super) struct Shape {
    pub(super) surface: Surface,
    /// By face; one for all if there is but one.
    materials: Vec<u32>,
}

pub(super) enum Surface {
    /// Embree's subdivision geometry: its primitives are the control mesh's faces.
    Subdivision {
        /// Primvars that Embree interpolates, name and width, by slot.
        primvars: Vec<(String, usize)>,
    },
    Polygons(Polygons),
}

/// Triangles of a polygon mesh, or of a refined control mesh.
pub(super) struct Polygons {
    mesh: Arc<ControlMesh>,
    /// Corners of each triangle: indices into the mesh's `face_vertex_indices`.
    corners: Vec<[u32; 3]>,
    /// Face of each triangle, in `mesh`.
    faces: Vec<u32>,
    /// Face of the control mesh for each face of `mesh`, if that was refined.
    parents: Option<Vec<u32>>,
}

/// A hit's place on its shape, in object space.
pub(super) struct Point {
    /// Face of the control mesh.
    pub(super) face: u32,
    /// On the smooth surface that the traced facets stand for, if there is one.
    pub(super) smooth: Option<SmoothPoint>,
}

/// A point of a limit surface, with its displacement, or of the surface that a polygon mesh's normals imply.
pub(super) struct SmoothPoint {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
}

impl Shape {
    /// `number` gives a material of the binding its number in the world.
    pub(super) fn new(
        surface: Surface,
        binding: &Binding,
        faces: usize,
        mut number: impl FnMut(Option<usize>) -> u32,
    ) -> Self {
        let mut materials = vec![number(binding.whole)];
        if !binding.subsets.is_empty() {
            materials.resize(faces, materials[0]);
            for subset in &binding.subsets {
                let number = number(subset.material);
                for &face in &subset.faces {
                    if let Some(material) = materials.get_mut(face as usize) {
                        *material = number;
                    }
                }
            }
        }
        Self { surface, materials }
    }

    pub(super) fn material(&self, face: u32) -> u32 {
        if self.materials.len() == 1 {
            self.materials[0]
        } else {
            self.materials[face as usize]
        }
    }

    /// `side` is 1 for a ray that comes from where the hit's `facet` normal points, else -1.
    pub(super) fn point(&self, geometry: &Geometry, hit: &SceneHit, side: f32, time: f32) -> Point {
        let (primitive, uv) = (hit.primitive, hit.uv);
        match &self.surface {
            Surface::Subdivision { .. } => {
                let point = geometry.displaced_point(primitive, uv, time);
                Point {
                    face: primitive,
                    smooth: Some(SmoothPoint {
                        position: point.position,
                        normal: point.du.cross(point.dv),
                    }),
                }
            }
            Surface::Polygons(polygons) => {
                let triangle = geometry.surface_point(primitive, uv, time);
                Point {
                    face: polygons.face(primitive),
                    smooth: polygons.smooth(primitive, uv, &triangle, side * hit.normal),
                }
            }
        }
    }

    /// Directions in which the texture coordinates that the primvar `name` holds grow, object space.
    pub(super) fn tangents(
        &self,
        geometry: &Geometry,
        name: &str,
        hit: &SceneHit,
        time: f32,
    ) -> Option<[Vec3; 2]> {
        let (primitive, uv) = (hit.primitive, hit.uv);
        // Differences over a small step in the face's own parameters give st's derivatives.
        const STEP: f32 = 1e-3;
        let step = Vec2::new(
            if uv.x < 0.5 { STEP } else { -STEP },
            if uv.y < 0.5 { STEP } else { -STEP },
        );
        let st = |uv: Vec2| {
            let mut out = [0.0; 2];
            let found = match &self.surface {
                Surface::Subdivision { primvars, .. } => primvars
                    .iter()
                    .position(|(n, width)| n == name && *width >= 2)
                    .map(|slot| {
                        geometry.primvar(slot, primitive, uv, &mut out);
                    }),
                Surface::Polygons(p) => p.primvar(name, primitive, uv, &mut out).then_some(()),
            };
            found.map(|()| Vec2::from(out))
        };
        let here = st(uv)?;
        let along_u = (st(uv + Vec2::new(step.x, 0.0))? - here) / step.x;
        let along_v = (st(uv + Vec2::new(0.0, step.y))? - here) / step.y;
        let determinant = along_u.perp_dot(along_v);
        if determinant.abs() < 1e-20 {
            return None;
        }
        let point = geometry.displaced_point(primitive, uv, time);
        let along_s = (point.du * along_v.y - point.dv * along_u.y) / determinant;
        let along_t = (point.dv * along_u.x - point.du * along_v.x) / determinant;
        Some([along_s, along_t])
    }
}

impl Polygons {
    pub(super) fn new(
        mesh: Arc<ControlMesh>,
        corners: Vec<[u32; 3]>,
        faces: Vec<u32>,
        parents: Option<&[u32]>,
    ) -> Self {
        Self {
            mesh,
            corners,
            faces,
            parents: parents.map(<[u32]>::to_vec),
        }
    }

    /// The control mesh's face that a triangle is part of.
    fn face(&self, triangle: u32) -> u32 {
        let face = self.faces[triangle as usize];
        self.parents
            .as_ref()
            .map_or(face, |parents| parents[face as usize])
    }

    /// Blends a primvar over a triangle; false if there is none of this name and width.
    pub(super) fn primvar(&self, name: &str, triangle: u32, uv: Vec2, out: &mut [f32]) -> bool {
        match self.mesh.primvar(name) {
            Some(primvar) if primvar.width as usize >= out.len() => {
                self.blend(primvar, triangle, uv, out);
                true
            }
            _ => false,
        }
    }

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
        Some(SmoothPoint { position, normal })
    }
}
