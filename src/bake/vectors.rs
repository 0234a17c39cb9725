//! Displacement by vectors, from where the cage and the dense mesh have the same texture coordinates.
//!
//! A vector leads from a limit point to the point of the dense mesh with the limit point's texture coordinates: nothing is
//! looked for along normals, so overhangs are kept. Both meshes must have one layout, as they have where the dense one was
//! sculpted on the subdivided cage. The dense mesh is laid out flat, and rays find the triangle at a place of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::dense::robust;
use super::{Cage, Dense, Found, Layout, Source};
use crate::error::{Fault, Result};
use crate::math::{DVec2, DVec3, Ray, Vec2, Vec3};
use crate::mesh::{ControlMesh, triangulate};
use crate::surface::Space;
use crate::trace::{Device, Scene};

/// A dense mesh laid out flat by its texture coordinates.
pub struct Flat {
    /// The corners of all triangles, three each, numbered as the dense mesh's.
    corners: Arc<Vec<Vec<Vec3>>>,
    scene: Scene,
    file: PathBuf,
}

/// How far beside a place another one is tried, where rounding leads out of the mesh.
const BESIDE: f32 = 1e-5;

impl Flat {
    /// The mesh of which a [`Dense`] was made, valid.
    ///
    /// # Errors
    /// If it has no texture coordinates in its corners or points, and as [`SceneBuilder::commit`](crate::trace::SceneBuilder::commit). `file` is what faults
    /// name.
    pub fn new(mesh: &ControlMesh, file: &Path, device: &Device) -> Result<Self> {
        let st = mesh.primvar("st").filter(|st| st.width == 2);
        let Some(st) = st else {
            let message = "it has no texture coordinates, by which vectors are found";
            let help = "export it with those of the cage (vt), or bake heights without --vector";
            return Err(Fault::new(message).in_file(file).advise(help).into());
        };
        let place = |corner: u32| {
            let place = st.get(corner as usize);
            Vec3::new(place[0], place[1], 0.0)
        };
        let triangles = triangulate(mesh).corners;
        let corners: Vec<Vec3> = triangles.iter().flatten().map(|&c| place(c)).collect();
        let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let corners = Arc::new(vec![corners]);
        let scene = robust(device, indices.collect(), corners.clone(), &|_| true)?;
        Ok(Self {
            corners,
            scene,
            file: file.to_owned(),
        })
    }

    /// The triangle at a place, and the weights of its corners there.
    fn at(&self, st: Vec2) -> Option<(u32, [f64; 3])> {
        let beside = [
            [0.0, 0.0],
            [1.0, 1.0],
            [-1.0, 1.0],
            [1.0, -1.0],
            [-1.0, -1.0],
        ];
        let triangle = beside.into_iter().find_map(|beside| {
            let place = st + BESIDE * Vec2::from(beside);
            let ray = Ray::new(place.extend(-1.0), Vec3::Z, 0.0);
            Some(self.scene.intersect(&ray)?.primitive)
        })?;
        let first = 3 * triangle as usize;
        let corner = |k: usize| self.corners[0][first + k].truncate().as_dvec2();
        let [a, b, c] = [0, 1, 2].map(corner);
        let p: DVec2 = st.as_dvec2();
        let areas = [
            (b - p).perp_dot(c - p),
            (c - p).perp_dot(a - p),
            (a - p).perp_dot(b - p),
        ];
        let area = (b - a).perp_dot(c - a);
        let weights = areas.map(|part| (part / area).clamp(0.0, 1.0));
        let sum: f64 = weights.iter().sum();
        (sum.is_finite() && sum > 0.0).then(|| (triangle, weights.map(|w| w / sum)))
    }

    /// What it is if no texture coordinates are found.
    pub(super) fn nothing_met(&self) -> Fault {
        let fault = Fault::new("none of the cage's texture coordinates lie on it");
        fault.in_file(&self.file).advise(
            "vectors need both meshes laid out alike: export both from one sculpt, or bake heights",
        )
    }
}

/// Displacement by vectors.
pub(super) struct Vectors<'a> {
    pub(super) cage: &'a Cage,
    pub(super) dense: &'a Dense,
    pub(super) layout: &'a Layout,
    pub(super) flat: &'a Flat,
    pub(super) space: Space,
}

impl Source for Vectors<'_> {
    fn channels(&self) -> usize {
        3
    }

    fn find(&self, ptex: u32, uv: [f64; 2]) -> Found {
        let (Some(point), Some(st)) = (self.cage.point(ptex, uv), self.layout.texcoord(ptex, uv))
        else {
            return Found::NoSurface;
        };
        let Some((triangle, weights)) = self.flat.at(st) else {
            return Found::Missed { faced_away: false };
        };
        let corners = self.dense.triangle(triangle).into_iter().zip(weights);
        let there: DVec3 = corners.map(|(corner, weight)| weight * corner).sum();
        let vector = there - point;
        let vector = match self.space {
            Space::Object => vector,
            Space::Tangent => {
                let frame = self.layout.slopes(ptex, uv);
                let Some([t, b, n]) = frame.and_then(|st| self.cage.frame(ptex, uv, st)) else {
                    return Found::Missed { faced_away: false };
                };
                DVec3::new(vector.dot(t), vector.dot(b), vector.dot(n))
            }
        };
        Found::Value(vector.as_vec3().to_array())
    }
}
