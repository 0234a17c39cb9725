//! The control mesh and the NURBS patch: what a file says of a surface, as plain arrays.

mod nurbs;
mod polyline;
mod ptex;
mod tags;
mod topology;
mod triangulate;
mod validate;

pub use nurbs::{MAX_ORDER, NurbsDirection, NurbsForm, NurbsPatch, TrimCurve, TrimLoop};
pub use tags::{
    BoundaryInterpolation, Corner, Crease, CreaseMethod, FaceVaryingInterpolation, Scheme,
    TriangleRule,
};

pub use polyline::Polyline;
pub use ptex::{PtexFace, ptex_face_count, ptex_faces, ptex_kind};
pub use topology::Topology;
pub use triangulate::{Triangles, triangulate};

use crate::math::{Bounds3, DVec3, Vec3};

/// A control mesh (cage), or a plain polygon mesh where the scheme is [`Scheme::None`].
///
/// Face `f` has `face_vertex_counts[f]` corners; the corners of all faces follow one another in
/// `face_vertex_indices`. Corners run counterclockwise seen from the front, clockwise if `left_handed`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ControlMesh {
    /// How the faces become a surface.
    pub scheme: Scheme,
    /// Corners of each face, at least 3.
    pub face_vertex_counts: Vec<u32>,
    /// Point of each corner.
    pub face_vertex_indices: Vec<u32>,
    /// The points at each motion key, evenly over the shutter: at least one key, all of one length.
    pub points: Vec<Vec<Vec3>>,
    /// Sharp edges, one by one.
    pub creases: Vec<Crease>,
    /// Sharp vertices.
    pub corners: Vec<Corner>,
    /// Faces that shape their neighbours but are not seen.
    pub holes: Vec<u32>,
    /// What the surface does at the mesh's border.
    pub boundary: BoundaryInterpolation,
    /// Where face-varying primvars stay linear.
    pub face_varying: FaceVaryingInterpolation,
    /// How Catmull-Clark refines triangles.
    pub triangle_rule: TriangleRule,
    /// How sharpness decays along a crease.
    pub crease_method: CreaseMethod,
    /// Whether the front is where the corners run clockwise.
    pub left_handed: bool,
    /// Values that the surface carries.
    pub primvars: Vec<Primvar>,
    /// Shading normals of a polygon mesh (3 components); `None` for subdivision surfaces.
    pub normals: Option<Primvar>,
}

/// Values on a mesh or patch, of `width` components each.
#[derive(Debug, Clone, PartialEq)]
pub struct Primvar {
    /// Its name without `primvars:`.
    pub name: String,
    /// What each element belongs to.
    pub interpolation: Interpolation,
    /// Components of an element, at least 1.
    pub width: u32,
    /// Elements, one after the other.
    pub values: Vec<f32>,
    /// Which element each point, face or corner has; without it they have them in order.
    pub indices: Option<Vec<u32>>,
}

/// What an element of a primvar belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The whole mesh.
    Constant,
    /// A face.
    Uniform,
    /// A point, linear over each face.
    Varying,
    /// A point, following the subdivision rules.
    Vertex,
    /// A corner of a face; neighbouring faces may differ.
    FaceVarying,
}

impl ControlMesh {
    /// How many faces there are, holes included.
    pub fn face_count(&self) -> usize {
        self.face_vertex_counts.len()
    }

    /// How many points each motion key has.
    pub fn point_count(&self) -> usize {
        self.points.first().map_or(0, Vec::len)
    }

    /// The primvar of this name.
    pub fn primvar(&self, name: &str) -> Option<&Primvar> {
        self.primvars.iter().find(|p| p.name == name)
    }

    /// The box around the points at all motion keys. Subdivision surfaces without displacement lie within it.
    pub fn bounds(&self) -> Bounds3 {
        Bounds3::of(self.points.iter().flatten().copied())
    }

    /// The points that faces use, at all motion keys: unused ones must not spoil a picture's framing.
    pub fn used_points(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.points
            .iter()
            .flat_map(|key| self.face_vertex_indices.iter().map(|&v| key[v as usize]))
    }

    /// Whether any face spans an area at any motion key. Its numbers must be [valid](Self::validate).
    pub fn has_area(&self) -> bool {
        self.points.iter().any(|points| {
            self.faces().any(|range| {
                let corners = &self.face_vertex_indices[range];
                let [first, ..] = corners else {
                    return false;
                };
                let from_first =
                    |v: u32| points[v as usize].as_dvec3() - points[*first as usize].as_dvec3();
                corners
                    .windows(2)
                    .any(|pair| from_first(pair[0]).cross(from_first(pair[1])) != DVec3::ZERO)
            })
        })
    }

    /// The faces as ranges of `face_vertex_indices`.
    pub fn faces(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        self.face_vertex_counts.iter().scan(0, |start, &count| {
            let range = *start..*start + count as usize;
            *start = range.end;
            Some(range)
        })
    }

    /// Who meets whom in this mesh.
    ///
    /// # Panics
    /// If the mesh is not valid.
    pub fn topology(&self) -> Topology {
        Topology::new(
            &self.face_vertex_counts,
            self.face_vertex_indices.clone(),
            self.point_count(),
        )
    }

    /// Bytes that its arrays hold.
    pub fn memory(&self) -> usize {
        4 * (self.face_vertex_counts.len() + self.face_vertex_indices.len() + self.holes.len())
            + self
                .points
                .iter()
                .map(|p| size_of_val(p.as_slice()))
                .sum::<usize>()
            + size_of_val(self.creases.as_slice())
            + size_of_val(self.corners.as_slice())
            + self
                .primvars
                .iter()
                .chain(&self.normals)
                .map(Primvar::memory)
                .sum::<usize>()
    }
}

impl Primvar {
    /// How many elements `values` holds.
    pub fn elements(&self) -> usize {
        self.values.len() / self.width.max(1) as usize
    }

    /// Bytes that its arrays hold.
    pub fn memory(&self) -> usize {
        4 * (self.values.len() + self.indices.as_ref().map_or(0, Vec::len))
    }

    /// Element `i` of the point, face or corner with that number (0 for a constant), through the indices.
    ///
    /// # Panics
    /// If `i` is out of range; [`ControlMesh::validate`] makes sure that the mesh's own numbers are not.
    pub fn get(&self, i: usize) -> &[f32] {
        let element = self
            .indices
            .as_ref()
            .map_or(i, |indices| indices[i] as usize);
        self.element(element)
    }

    /// The element of this number, whatever has it.
    ///
    /// # Panics
    /// If there is none.
    pub fn element(&self, element: usize) -> &[f32] {
        let width = self.width as usize;
        &self.values[element * width..][..width]
    }
}
