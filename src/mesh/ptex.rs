//! The faces of a Ptex file for a control mesh, and which of them meet.
//!
//! A quad is one face. Any other polygon is one sub-face for each corner: (0, 0) is the corner, u runs along the edge
//! that leaves it and v along the one that comes, both to the edge's middle. Under Loop's scheme every triangle is one
//! face. An edge that more than two faces share, or that two run along in the same direction, is a border.

use relievo_ptex::{FaceInfo, MeshType, Neighbour, Res};

use super::{ControlMesh, Scheme, Topology};

/// One face of a Ptex file for a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PtexFace {
    /// The mesh's face.
    pub face: u32,
    /// The corner at which it lies, if it is a sub-face.
    pub corner: Option<u32>,
    /// The faces beyond its edges.
    pub neighbours: [Option<Neighbour>; 4],
}

impl PtexFace {
    /// As the file has it, at a size.
    pub fn info(&self, res: Res) -> FaceInfo {
        FaceInfo {
            res,
            neighbours: self.neighbours,
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: self.corner.is_some(),
        }
    }
}

/// Which kind of Ptex file a mesh takes.
pub fn ptex_kind(mesh: &ControlMesh) -> MeshType {
    match mesh.scheme {
        Scheme::Loop => MeshType::Triangle,
        _ => MeshType::Quad,
    }
}

/// How many faces it has.
pub fn ptex_face_count(mesh: &ControlMesh) -> u32 {
    let kind = ptex_kind(mesh);
    let counts = mesh.face_vertex_counts.iter();
    counts.map(|&sides| faces_of(kind, sides)).sum()
}

fn faces_of(kind: MeshType, sides: u32) -> u32 {
    match (kind, sides) {
        (MeshType::Triangle, _) | (MeshType::Quad, 4) => 1,
        (MeshType::Quad, sides) => sides,
    }
}

/// All faces of a Ptex file for a valid mesh, in order.
pub fn ptex_faces(mesh: &ControlMesh) -> Vec<PtexFace> {
    let kind = ptex_kind(mesh);
    let topology = mesh.topology();
    let mut first = Vec::with_capacity(topology.face_count());
    let mut count = 0;
    for &sides in &mesh.face_vertex_counts {
        first.push(count);
        count += faces_of(kind, sides);
    }
    let places = Places {
        topology: &topology,
        first: &first,
        kind,
    };
    let mut faces = Vec::with_capacity(count as usize);
    for face in 0..topology.face_count() as u32 {
        let corners = topology.corners(face);
        if places.is_whole(face) {
            let mut neighbours = [None; 4];
            for (to, corner) in neighbours.iter_mut().zip(corners) {
                // Of two sub-faces, the one that a walk along the own edge meets first.
                *to = places.beyond(corner).map(|other| places.side(other, true));
            }
            faces.push(PtexFace {
                face,
                corner: None,
                neighbours,
            });
            continue;
        }
        let sides = corners.len() as u32;
        for (i, corner) in (0..).zip(corners) {
            let before = topology.previous(corner);
            let own = |i: u32| first[face as usize] + i % sides;
            let inner = |i: u32, edge: u8| Neighbour { face: own(i), edge };
            faces.push(PtexFace {
                face,
                corner: Some(i),
                neighbours: [
                    places.beyond(corner).map(|other| places.side(other, true)),
                    Some(inner(i + 1, 2)),
                    Some(inner(i + sides - 1, 1)),
                    places.beyond(before).map(|other| places.side(other, false)),
                ],
            });
        }
    }
    faces
}

struct Places<'a> {
    topology: &'a Topology,
    /// The first Ptex face of each face.
    first: &'a [u32],
    kind: MeshType,
}

impl Places<'_> {
    fn is_whole(&self, face: u32) -> bool {
        faces_of(self.kind, self.topology.corners(face).len() as u32) == 1
    }

    /// The corner from which the other face runs along the edge that leaves a corner.
    fn beyond(&self, corner: u32) -> Option<u32> {
        let topology = self.topology;
        match *topology.edge_corners(topology.edge(corner)) {
            [a, b] if topology.vertex(a) != topology.vertex(b) => {
                Some(if a == corner { b } else { a })
            }
            _ => None,
        }
    }

    /// The face along the edge that leaves a corner: of sub-faces, the one at the edge's end or at its start.
    fn side(&self, corner: u32, at_end: bool) -> Neighbour {
        let topology = self.topology;
        let face = topology.face(corner);
        let first = topology.corners(face).start;
        let own = self.first[face as usize];
        if self.is_whole(face) {
            return Neighbour {
                face: own,
                edge: (corner - first) as u8,
            };
        }
        let (corner, edge) = if at_end {
            (topology.next(corner), 3)
        } else {
            (corner, 0)
        };
        Neighbour {
            face: own + corner - first,
            edge,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn mesh(counts: &[u32], corners: &[u32]) -> ControlMesh {
        let points = corners.iter().max().map_or(0, |&last| last as usize + 1);
        ControlMesh {
            scheme: Scheme::CatmullClark,
            face_vertex_counts: counts.to_vec(),
            face_vertex_indices: corners.to_vec(),
            points: vec![vec![Vec3::ZERO; points]],
            ..ControlMesh::default()
        }
    }

    #[test]
    fn a_quad_and_the_sub_faces_of_a_triangle_name_each_other() {
        // The triangle runs from 2 to 1 along the quad's edge from 1 to 2.
        let faces = ptex_faces(&mesh(&[4, 3], &[0, 1, 2, 3, 2, 1, 4]));
        assert_eq!(faces.len(), 4);
        let at = |face, edge| Some(Neighbour { face, edge });
        // First met from 1 on: the sub-face at 1, along its edge 3.
        assert_eq!(faces[0].neighbours, [None, at(2, 3), None, None]);
        assert_eq!(faces[1].neighbours, [at(0, 1), at(2, 2), at(3, 1), None]);
        assert_eq!(faces[2].neighbours, [None, at(3, 2), at(1, 1), at(0, 1)]);
        assert_eq!(faces[3].corner, Some(2));
    }

    #[test]
    fn two_quads_meet_at_their_edges_and_a_third_one_makes_a_border() {
        let two = ptex_faces(&mesh(&[4, 4], &[0, 1, 2, 3, 1, 4, 5, 2]));
        let at = |face, edge| Some(Neighbour { face, edge });
        assert_eq!(two[0].neighbours, [None, at(1, 3), None, None]);
        assert_eq!(two[1].neighbours, [None, None, None, at(0, 1)]);
        let three = mesh(&[4, 4, 4], &[0, 1, 2, 3, 1, 4, 5, 2, 1, 6, 7, 2]);
        assert!(ptex_faces(&three).iter().all(|f| f.neighbours == [None; 4]));
    }
}
