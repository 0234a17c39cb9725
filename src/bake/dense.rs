//! The dense mesh, behind Embree.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Fault, Result};
use crate::math::{Bounds3, DVec3, Ray, Vec3};
use crate::mesh::{ControlMesh, triangulate};
use crate::trace::{Device, Geometry, Scene, SceneBuilder, SceneHit, SceneOptions};

/// A mesh of polygons that rays meet. Faces need not fit together: each stands for itself.
pub struct Dense {
    /// At one motion key.
    points: Arc<Vec<Vec<Vec3>>>,
    triangles: Vec<[u32; 3]>,
    scene: Scene,
    file: PathBuf,
}

impl Dense {
    /// The polygons of a mesh at its first motion key, whatever its scheme. `file` is what faults name. `go_on` is told from 0 to 1 how far Embree
    /// is, and ends it by returning false.
    ///
    /// # Errors
    /// If the mesh is not valid or has no faces, and as [`SceneBuilder::commit`].
    pub fn new(
        mesh: &ControlMesh,
        file: &Path,
        device: &Device,
        go_on: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<Self> {
        mesh.validate().map_err(|fault| fault.in_file(file))?;
        let corners = &mesh.face_vertex_indices;
        let triangles: Vec<[u32; 3]> = triangulate(mesh)
            .corners
            .iter()
            .map(|t| t.map(|corner| corners[corner as usize]))
            .collect();
        if triangles.is_empty() {
            let fault = Fault::new("there is no face to be met").in_file(file);
            return Err(fault
                .advise("give a mesh with faces that are no holes")
                .into());
        }
        let points = Arc::new(vec![mesh.points[0].clone()]);
        let scene = robust(device, triangles.clone(), points.clone(), go_on)?;
        Ok(Self {
            points,
            triangles,
            scene,
            file: file.to_owned(),
        })
    }

    /// How many triangles its faces are.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// The box around its faces.
    pub fn bounds(&self) -> Bounds3 {
        self.scene.bounds()
    }

    /// Names its file in a fault.
    pub(super) fn name(&self, fault: Fault) -> Fault {
        fault.in_file(&self.file)
    }

    /// The nearest triangle that a ray meets.
    pub(super) fn meet(&self, ray: &Ray) -> Option<SceneHit> {
        self.scene.intersect(ray)
    }

    /// The corners of a triangle, counterclockwise seen from the front.
    pub(super) fn triangle(&self, triangle: u32) -> [DVec3; 3] {
        let points = &self.points[0];
        self.triangles[triangle as usize].map(|v| points[v as usize].as_dvec3())
    }
}

/// Triangles behind Embree, for rays that slip through no edge.
pub(super) fn robust(
    device: &Device,
    triangles: Vec<[u32; 3]>,
    points: Arc<Vec<Vec<Vec3>>>,
    go_on: &(dyn Fn(f64) -> bool + Sync),
) -> Result<Scene> {
    let options = SceneOptions {
        robust: true,
        ..SceneOptions::default()
    };
    let mut builder = SceneBuilder::new(device, options)?;
    builder.attach(Geometry::triangles(device, triangles, points)?);
    builder.commit(go_on)
}
