//! Uniform refinement: a finer control mesh of the same surface, with everything that the mesh carries.

use rayon::prelude::*;

use super::cage::Cage;
use super::crease::is_sharp;
use super::limit::{Field, LimitSurface};
use super::refine::{split, stencils};
use super::stencils::Stencils;
use crate::math::{DVec2, Vec3};
use crate::mesh::{BoundaryInterpolation, ControlMesh, Corner, Crease, Interpolation, Primvar};

/// A refined mesh, and where its faces come from.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The finer mesh: all motion keys, primvars, and the sharpness that is left.
    pub mesh: ControlMesh,
    /// The face of the control mesh that each face lies in.
    pub parent_face: Vec<u32>,
    origins: Vec<Origin>,
}

/// Where a face lies on the control mesh's surface.
#[derive(Debug, Clone, Copy)]
enum Origin {
    /// A face that no step has split yet and that is several Ptex faces, from this one on.
    Whole(u32),
    /// Part of one Ptex face: its parameters at the corners; triangles have three.
    Part(u32, [DVec2; 4]),
}

/// Refines a valid mesh `levels` times.
///
/// Vertex primvars follow the points, face-varying ones their own rule; varying ones are linear over each face.
/// Faces that have no limit surface, holes and those that the boundary rule leaves out, become holes. At each level
/// the vertices' points come first, in their order, then the faces' (not with Loop), then the edges'.
///
/// # Panics
/// If the result had more corners than 32 bits can number.
pub fn refine(mesh: &ControlMesh, levels: u32) -> Refined {
    let mut cage = Cage::of(mesh);
    let mut parent_face: Vec<u32> = (0..cage.topology.face_count() as u32).collect();
    let mut origins = origins(&cage);
    let mut points: Vec<Values> = mesh
        .points
        .iter()
        .map(|key| Values::of_points(key))
        .collect();
    let mut primvars: Vec<Carried> = mesh
        .primvars
        .iter()
        .map(|primvar| Carried::new(mesh, &cage, primvar))
        .collect();

    for _ in 0..levels {
        let rows = stencils(&cage, &|_| true);
        let varies = |p: &Carried| matches!(p, Carried::Linear(_));
        let linear = primvars
            .iter()
            .any(varies)
            .then(|| stencils(&cage.linear(), &|_| true));
        for values in &mut points {
            values.refine(&rows);
        }
        for primvar in &mut primvars {
            match primvar {
                Carried::Same => {}
                Carried::Smooth(values) => values.refine(&rows),
                Carried::Linear(values) => {
                    values.refine(linear.as_ref().expect("made where something is linear"));
                }
                Carried::FaceVarying(cage, values) => {
                    values.refine(&stencils(cage, &|_| true));
                    **cage = split(cage);
                }
            }
        }
        let children = children(&cage);
        let all = |&(face, _): &(u32, usize)| parent_face[face as usize];
        parent_face = children.iter().map(all).collect();
        origins = children
            .iter()
            .map(|&(face, child)| {
                origins[face as usize].child(cage.topology.corners(face).len(), child)
            })
            .collect();
        cage = split(&cage);
    }
    let primvars = mesh
        .primvars
        .iter()
        .zip(primvars)
        .map(|(primvar, carried)| carried.finish(primvar, &parent_face))
        .collect();
    Refined {
        mesh: finish(mesh, &cage, &points, primvars),
        parent_face,
        origins,
    }
}

impl Refined {
    /// Moves the points to the limit surface of the mesh that was refined, at all motion keys, and gives the corners
    /// its unit normals if nothing moves. Points that only holes use stay.
    pub fn move_to_limit(&mut self, original: &ControlMesh) {
        let surface = LimitSurface::new(original);
        let topology = self.mesh.topology();
        let places: Vec<Option<(u32, DVec2)>> = (0..topology.vertex_count() as u32)
            .map(|vertex| {
                let mut corners = topology.vertex_corners(vertex).iter();
                corners.find_map(|&corner| {
                    let face = topology.face(corner);
                    let place = self.place(face, (corner - topology.corners(face).start) as usize);
                    (!surface.is_hole(place.0)).then_some(place)
                })
            })
            .collect();
        let fields: Vec<Field<f64>> = (0..self.mesh.points.len())
            .map(|key| surface.points(original, key))
            .collect();
        for (points, field) in self.mesh.points.iter_mut().zip(&fields) {
            points
                .par_iter_mut()
                .zip(&places)
                .with_min_len(256)
                .for_each(|(point, place)| {
                    if let Some((face, uv)) = place {
                        let limit = surface.evaluate(field, *face, uv.x, uv.y).position;
                        *point = Vec3::from(limit.map(|x| x as f32));
                    }
                });
        }
        if let [field] = fields.as_slice() {
            self.mesh.normals = Some(self.normals(&surface, field));
        }
    }

    /// Normals at the corners of all faces: at creases the two sides differ.
    fn normals(&self, surface: &LimitSurface, field: &Field<f64>) -> Primvar {
        let turned = if self.mesh.left_handed { -1.0 } else { 1.0 };
        let faces: Vec<_> = self.mesh.faces().collect();
        let values =
            faces
                .par_iter()
                .enumerate()
                .with_min_len(64)
                .flat_map_iter(|(face, corners)| {
                    (0..corners.len()).flat_map(move |corner| {
                        let (ptex, uv) = self.place(face as u32, corner);
                        if surface.is_hole(ptex) {
                            return [0.0; 3];
                        }
                        let point = surface.evaluate(field, ptex, uv.x, uv.y);
                        let normal = point.normal(uv.x, uv.y).unwrap_or_default();
                        normal.map(|x| turned * x as f32)
                    })
                });
        Primvar {
            name: "normals".to_owned(),
            interpolation: Interpolation::FaceVarying,
            width: 3,
            values: values.collect(),
            indices: None,
        }
    }

    /// The Ptex face and the parameters at a corner of a face.
    pub fn place(&self, face: u32, corner: usize) -> (u32, DVec2) {
        match self.origins[face as usize] {
            Origin::Whole(first) => (first + corner as u32, DVec2::ZERO),
            Origin::Part(ptex, uv) => (ptex, uv[corner]),
        }
    }
}

impl Origin {
    /// Of a child; numbered as in `refine.rs`.
    fn child(self, sides: usize, child: usize) -> Self {
        const SQUARE: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        match self {
            Self::Whole(first) => Self::Part(first + child as u32, SQUARE),
            Self::Part(ptex, [a, b, c, _]) if sides == 3 => {
                let [e0, e1, e2] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
                let corners = [[a, e0, e2], [e0, b, e1], [e2, e1, c], [e1, e2, e0]][child];
                Self::Part(ptex, [corners[0], corners[1], corners[2], corners[2]])
            }
            Self::Part(ptex, corners) => {
                let centre = 0.25 * corners.iter().sum::<DVec2>();
                let edge = |i: usize| 0.5 * (corners[i % 4] + corners[(i + 1) % 4]);
                let mut quarter = [corners[child], edge(child), centre, edge(child + 3)];
                quarter.rotate_right(child);
                Self::Part(ptex, quarter)
            }
        }
    }
}

fn origins(cage: &Cage) -> Vec<Origin> {
    let mut next = 0;
    (0..cage.topology.face_count() as u32)
        .map(|face| {
            let first = next;
            let sides = cage.topology.corners(face).len() as u32;
            if cage.rules.triangles() {
                next += 1;
                Origin::Part(first, [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::Y])
            } else if sides == 4 {
                next += 1;
                Origin::Part(first, [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y])
            } else {
                next += sides;
                Origin::Whole(first)
            }
        })
        .collect()
}

/// The face that each face of the next level lies in, and which of its children it is.
fn children(cage: &Cage) -> Vec<(u32, usize)> {
    let count = |face: u32| match cage.rules.triangles() {
        true => 4,
        false => cage.topology.corners(face).len(),
    };
    (0..cage.topology.face_count() as u32)
        .flat_map(|face| (0..count(face)).map(move |child| (face, child)))
        .collect()
}

/// Values at the points of one level, in double precision so that rounding does not add up over the levels.
#[derive(Debug)]
struct Values {
    width: usize,
    values: Vec<f64>,
}

impl Values {
    fn of_points(points: &[Vec3]) -> Self {
        let values = points.iter().flat_map(|p| p.as_dvec3().to_array());
        Self {
            width: 3,
            values: values.collect(),
        }
    }

    fn of_elements<'a>(primvar: &'a Primvar, elements: impl Iterator<Item = &'a [f32]>) -> Self {
        Self {
            width: primvar.width as usize,
            values: elements.flatten().map(|&x| f64::from(x)).collect(),
        }
    }

    fn refine(&mut self, rows: &Stencils) {
        self.values = rows.apply(self.width, &self.values);
    }

    fn single(&self) -> Vec<f32> {
        self.values.iter().map(|&x| x as f32).collect()
    }
}

/// A primvar on its way.
enum Carried {
    /// Constant, or one for each face of the control mesh.
    Same,
    Smooth(Values),
    Linear(Values),
    FaceVarying(Box<Cage>, Values),
}

impl Carried {
    fn new(mesh: &ControlMesh, cage: &Cage, primvar: &Primvar) -> Self {
        let of_points =
            || Values::of_elements(primvar, (0..mesh.point_count()).map(|i| primvar.get(i)));
        match primvar.interpolation {
            Interpolation::Constant | Interpolation::Uniform => Self::Same,
            Interpolation::Vertex => Self::Smooth(of_points()),
            Interpolation::Varying => Self::Linear(of_points()),
            Interpolation::FaceVarying => {
                let (cut, elements) = cage.cut(primvar, mesh.face_varying);
                let elements = elements.iter().map(|&e| primvar.element(e as usize));
                let values = Values::of_elements(primvar, elements);
                Self::FaceVarying(Box::new(cut), values)
            }
        }
    }

    fn finish(self, primvar: &Primvar, parent_face: &[u32]) -> Primvar {
        let (values, indices) = match self {
            Self::Same => (
                primvar.values.clone(),
                (primvar.interpolation == Interpolation::Uniform).then(|| {
                    let element = |&face: &u32| match &primvar.indices {
                        Some(indices) => indices[face as usize],
                        None => face,
                    };
                    parent_face.iter().map(element).collect()
                }),
            ),
            Self::Smooth(values) | Self::Linear(values) => (values.single(), None),
            Self::FaceVarying(cage, values) => {
                let corners = 0..cage.topology.corner_count() as u32;
                let indices = corners.map(|c| cage.topology.vertex(c)).collect();
                (values.single(), Some(indices))
            }
        };
        Primvar {
            name: primvar.name.clone(),
            interpolation: primvar.interpolation,
            width: primvar.width,
            indices: match primvar.interpolation {
                Interpolation::Constant => primvar.indices.clone(),
                _ => indices,
            },
            values,
        }
    }
}

fn finish(
    mesh: &ControlMesh,
    cage: &Cage,
    points: &[Values],
    primvars: Vec<Primvar>,
) -> ControlMesh {
    let topology = &cage.topology;
    // Borders and tangles are sharp by themselves.
    let creases = (0..topology.edge_count() as u32)
        .filter(|&e| topology.is_edge_manifold(e) && !topology.is_border(e))
        .map(|e| Crease {
            vertices: topology.edge_vertices(e),
            sharpness: cage.edge_sharpness[e as usize],
        })
        .filter(|crease| is_sharp(crease.sharpness));
    let corners = (0_u32..)
        .zip(&cage.vertex_sharpness)
        .filter(|&(_, &sharpness)| is_sharp(sharpness))
        .map(|(vertex, &sharpness)| Corner { vertex, sharpness });
    let holes = (0_u32..).zip(&cage.hole).filter(|&(_, &hole)| hole);
    let faces = 0..topology.face_count() as u32;
    ControlMesh {
        scheme: mesh.scheme,
        face_vertex_counts: faces.map(|f| topology.corners(f).len() as u32).collect(),
        face_vertex_indices: (0..topology.corner_count() as u32)
            .map(|c| topology.vertex(c))
            .collect(),
        points: points
            .iter()
            .map(|key| {
                key.values
                    .chunks_exact(3)
                    .map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32))
                    .collect()
            })
            .collect(),
        creases: creases.collect(),
        corners: corners.collect(),
        holes: holes.map(|(face, _)| face).collect(),
        // Faces that it leaves out are holes now; it must not take another row.
        boundary: match mesh.boundary {
            BoundaryInterpolation::None => BoundaryInterpolation::EdgeOnly,
            boundary => boundary,
        },
        face_varying: mesh.face_varying,
        triangle_rule: mesh.triangle_rule,
        crease_method: mesh.crease_method,
        left_handed: mesh.left_handed,
        primvars,
        normals: None,
    }
}
