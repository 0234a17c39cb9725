//! Primvars of a control mesh, carried by the rules of subdivision to every point of the limit surface.

use super::carried::{Carried, Varying};
use crate::mesh::{ControlMesh, FaceVaryingInterpolation, Interpolation, Primvar, Topology};
use crate::subdiv::{Field, LimitSurface};

/// Values that follow a subdivision rule.
pub(super) struct Subdivided {
    /// The surface over which they are smooth, unless that is the points' one.
    pub(super) limit: Option<LimitSurface>,
    /// Those of up to three components have three, the last ones 0: points are evaluated faster.
    pub(super) field: Field<f32>,
    width: usize,
    /// The largest value.
    pub(super) largest: f32,
}

impl Subdivided {
    /// A primvar of a mesh. `limit` is the surface of the mesh's points.
    pub(super) fn carried(
        mesh: &ControlMesh,
        topology: &Topology,
        limit: &LimitSurface,
        primvar: &Primvar,
    ) -> Carried<Self> {
        let face_varying = |primvar: &Primvar, rule| {
            let (own, elements) = LimitSurface::face_varying(mesh, primvar, rule);
            let values = elements.iter().map(|&e| primvar.element(e as usize));
            let field = padded(&own, primvar, values);
            (Some(own), field)
        };
        let (own, field) = match primvar.interpolation {
            Interpolation::Constant => return Carried::Constant(primvar.get(0).to_vec()),
            Interpolation::Uniform => {
                let faces = (0..topology.face_count()).map(|face| primvar.get(face));
                return Carried::uniform(primvar.width as usize, faces);
            }
            Interpolation::Vertex => {
                let values = (0..mesh.point_count()).map(|v| primvar.get(v));
                (None, padded(limit, primvar, values))
            }
            Interpolation::Varying => {
                // Linear over each face: as by corners, which are nowhere smooth.
                let indices = (0..topology.corner_count() as u32).map(|corner| {
                    let vertex = topology.vertex(corner);
                    primvar
                        .indices
                        .as_ref()
                        .map_or(vertex, |i| i[vertex as usize])
                });
                let by_corner = Primvar {
                    interpolation: Interpolation::FaceVarying,
                    indices: Some(indices.collect()),
                    ..primvar.clone()
                };
                face_varying(&by_corner, FaceVaryingInterpolation::All)
            }
            Interpolation::FaceVarying => face_varying(primvar, mesh.face_varying),
        };
        Carried::Varying(Self {
            limit: own,
            largest: field.largest() as f32,
            width: primvar.width as usize,
            field,
        })
    }
}

impl Varying for Subdivided {
    fn width(&self) -> usize {
        self.width
    }

    fn memory(&self) -> usize {
        self.limit.as_ref().map_or(0, LimitSurface::memory) + self.field.memory()
    }
}

fn padded<'a>(
    limit: &LimitSurface,
    primvar: &Primvar,
    values: impl Iterator<Item = &'a [f32]>,
) -> Field<f32> {
    let width = (primvar.width as usize).max(3);
    let mut all = Vec::new();
    for value in values {
        all.extend_from_slice(value);
        all.resize(all.len() + width - value.len(), 0.0);
    }
    limit.field(all, width)
}
