//! Values that a file gives its control mesh, carried to every point of the limit surface.

use crate::mesh::{ControlMesh, FaceVaryingInterpolation, Interpolation, Primvar, Topology};
use crate::subdiv::{Field, LimitSurface};

/// A primvar on a limit surface.
pub(super) enum Carried {
    /// One value for all of it.
    Constant(Vec<f32>),
    /// A value for each face of the mesh.
    Uniform(Primvar),
    /// A value that varies within faces.
    Varying(Varying),
}

/// Values that follow a subdivision rule.
pub(super) struct Varying {
    /// The surface over which they are smooth, unless that is the points' one.
    pub(super) limit: Option<LimitSurface>,
    /// Those of up to three components have three, the last ones 0: points are evaluated faster.
    pub(super) field: Field<f32>,
    pub(super) width: usize,
    /// The largest value.
    pub(super) largest: f32,
}

impl Carried {
    /// `limit` is the surface of the mesh's points.
    pub(super) fn new(
        mesh: &ControlMesh,
        topology: &Topology,
        limit: &LimitSurface,
        primvar: &Primvar,
    ) -> Self {
        let face_varying = |primvar: &Primvar, rule| {
            let (own, elements) = LimitSurface::face_varying(mesh, primvar, rule);
            let values = elements.iter().map(|&e| primvar.element(e as usize));
            let field = padded(&own, primvar, values);
            (Some(own), field)
        };
        let (own, field) = match primvar.interpolation {
            Interpolation::Constant => return Self::Constant(primvar.get(0).to_vec()),
            Interpolation::Uniform => return Self::Uniform(primvar.clone()),
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
        Self::Varying(Varying {
            limit: own,
            largest: field.largest() as f32,
            width: primvar.width as usize,
            field,
        })
    }

    /// Components.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Constant(value) => value.len(),
            Self::Uniform(primvar) => primvar.width as usize,
            Self::Varying(varying) => varying.width,
        }
    }

    pub(super) fn memory(&self) -> usize {
        match self {
            Self::Constant(value) => size_of_val(value.as_slice()),
            Self::Uniform(primvar) => primvar.memory(),
            Self::Varying(Varying { limit, field, .. }) => {
                limit.as_ref().map_or(0, LimitSurface::memory) + field.memory()
            }
        }
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
