//! The limit surface that is baked over.

use std::path::{Path, PathBuf};

use relievo_ptex::MeshType;

use super::along_normal::Line;
use crate::convert::lengths;
use crate::error::Fault;
use crate::math::{DVec3, Vec2};
use crate::mesh::{ControlMesh, PtexFace, Scheme, Topology, ptex_faces, ptex_kind};
use crate::subdiv::{Field, LimitSurface};
use crate::surface::tangents;

/// The limit surface of a control mesh, in double precision.
pub struct Cage {
    limit: LimitSurface,
    points: Field<f64>,
    /// -1 where `du × dv` points to the back.
    front: f64,
    kind: MeshType,
    faces: Vec<PtexFace>,
    face_count: usize,
    file: PathBuf,
}

impl Cage {
    /// The limit surface at the mesh's first motion key. `file` is what faults name.
    ///
    /// # Errors
    /// If the mesh is not valid, is no subdivision surface, or is not manifold: an edge has more than two faces or two
    /// that run along it in the same direction, or the faces at a point are not one fan. Displaced, such surfaces open.
    pub fn new(mesh: &ControlMesh, file: &Path) -> Result<Self, Fault> {
        check(mesh).map_err(|fault| fault.in_file(file))?;
        let limit = LimitSurface::new(mesh);
        Ok(Self {
            points: limit.points(mesh, 0),
            limit,
            front: if mesh.left_handed { -1.0 } else { 1.0 },
            kind: ptex_kind(mesh),
            faces: ptex_faces(mesh),
            face_count: mesh.face_count(),
            file: file.to_owned(),
        })
    }

    /// The same with the points of a mesh that has moved.
    pub(super) fn moved(&self, mesh: &ControlMesh) -> Self {
        let limit = LimitSurface::new(mesh);
        Self {
            points: limit.points(mesh, 0),
            limit,
            faces: self.faces.clone(),
            file: self.file.clone(),
            ..*self
        }
    }

    /// Faces of the control mesh.
    pub fn face_count(&self) -> usize {
        self.face_count
    }

    /// Names its file in a fault.
    pub(super) fn name(&self, fault: Fault) -> Fault {
        fault.in_file(&self.file)
    }

    /// Which Ptex faces it has.
    pub(super) fn kind(&self) -> MeshType {
        self.kind
    }

    /// Its Ptex faces.
    pub(super) fn faces(&self) -> &[PtexFace] {
        &self.faces
    }

    /// The limit point at a place of a Ptex face; none where there is no surface.
    pub(super) fn point(&self, ptex: u32, [u, v]: [f64; 2]) -> Option<DVec3> {
        let seen = !self.limit.is_hole(ptex);
        seen.then(|| {
            let point = self.limit.first_order(&self.points, ptex, u, v);
            DVec3::from(point.position)
        })
    }

    /// The directions x, y and z of tangent space where the texture coordinates have these derivatives; none where there
    /// is no normal.
    pub(super) fn frame(&self, ptex: u32, uv: [f64; 2], st: [Vec2; 2]) -> Option<[DVec3; 3]> {
        let normal = self.line(ptex, uv)?.normal;
        let point = self.limit.first_order(&self.points, ptex, uv[0], uv[1]);
        let slopes = [point.du, point.dv].map(|d| DVec3::from(d).as_vec3());
        let [t, b] = tangents(slopes, normal.as_vec3(), self.front < 0.0, st);
        Some([t.as_dvec3(), b.as_dvec3(), normal])
    }

    /// The area of the limit surface for a unit of parameters at a place; 0 where there is no surface.
    pub(super) fn area(&self, ptex: u32, [u, v]: [f64; 2]) -> f64 {
        if self.limit.is_hole(ptex) {
            return 0.0;
        }
        let point = self.limit.first_order(&self.points, ptex, u, v);
        DVec3::from(point.du).cross(point.dv.into()).length()
    }

    /// How long a Ptex face is along u and v.
    pub(super) fn lengths(&self, ptex: u32) -> [f64; 2] {
        lengths(self.kind, |uv| self.point(ptex, uv))
    }

    /// The limit point with the normal through it; none where there is no surface, or it has no normal.
    pub(super) fn line(&self, ptex: u32, [u, v]: [f64; 2]) -> Option<Line> {
        if self.limit.is_hole(ptex) {
            return None;
        }
        let point = self.limit.evaluate(&self.points, ptex, u, v);
        let normal = point.normal(u, v)?;
        Some(Line {
            point: DVec3::from(point.position),
            normal: self.front * DVec3::from(normal),
        })
    }
}

fn check(mesh: &ControlMesh) -> Result<(), Fault> {
    mesh.validate()?;
    if mesh.scheme == Scheme::None {
        let fault = Fault::new("a mesh of polygons has no limit surface to be displaced");
        return Err(fault.advise("give it a subdivision scheme"));
    }
    check_manifold(&mesh.topology())
}

fn check_manifold(topology: &Topology) -> Result<(), Fault> {
    const HELP: &str = "displacement would tear it open there: split the mesh, or remove the faces that are too many";
    for edge in 0..topology.edge_count() as u32 {
        if !topology.is_edge_manifold(edge) {
            let [a, b] = topology.edge_vertices(edge);
            let corners = topology.edge_corners(edge);
            let what = match corners.len() {
                2 => "two faces run along it in the same direction".to_owned(),
                n => format!("it has {n} faces"),
            };
            let message = format!("the edge from point {a} to {b} is not manifold: {what}");
            let face = topology.face(corners[corners.len() - 1]);
            return Err(Fault::new(message).at_face(face as usize).advise(HELP));
        }
    }
    for vertex in 0..topology.vertex_count() as u32 {
        if let Some(&corner) = topology.vertex_corners(vertex).first()
            && !topology.is_vertex_manifold(vertex)
        {
            let message =
                format!("point {vertex} is not manifold: its faces meet there and at no edge");
            let face = topology.face(corner);
            return Err(Fault::new(message).at_face(face as usize).advise(HELP));
        }
    }
    Ok(())
}
