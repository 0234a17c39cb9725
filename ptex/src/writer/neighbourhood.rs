//! Which faces lie among faces of the same constant texel: a filter need not look further there.

use crate::types::{BorderMode, FaceInfo, MeshType, Neighbour};

/// A walk around a vertex meets no more faces than this, or the adjacency is wrong.
const LONGEST_WALK: usize = 10_000;

/// For every face, whether it is constant and so are, with the same texel, all faces around its corners. A corner on
/// the mesh's border counts only if both border modes are clamp. `same` compares the texels of two constant faces.
pub(crate) fn constant_neighbourhoods(
    faces: &[FaceInfo],
    mesh_type: MeshType,
    borders: (BorderMode, BorderMode),
    same: impl Fn(usize, usize) -> bool,
) -> Vec<bool> {
    let edges = match mesh_type {
        MeshType::Triangle => 3,
        MeshType::Quad => 4,
    };
    let walk = Walk {
        faces,
        edges,
        clamp: borders == (BorderMode::Clamp, BorderMode::Clamp),
    };
    (0..faces.len())
        .map(|face| {
            let like = |other: usize| faces[other].constant && same(face, other);
            faces[face].constant && (0..edges).all(|corner| walk.around(face, corner, &like))
        })
        .collect()
}

struct Walk<'a> {
    faces: &'a [FaceInfo],
    edges: usize,
    clamp: bool,
}

/// How a walk in one direction ends.
enum End {
    /// Where it began, or at the middle of the edge of a large face, beyond which nothing touches the vertex that is
    /// not met elsewhere.
    Closed,
    Border,
    /// At a face that is not alike.
    Other,
}

impl Walk<'_> {
    /// Whether all faces around the vertex at which an edge of a face begins are alike.
    fn around(&self, face: usize, corner: usize, like: &impl Fn(usize) -> bool) -> bool {
        match self.turn(face, corner, true, like) {
            End::Closed => true,
            End::Other => false,
            End::Border => {
                self.clamp && !matches!(self.turn(face, corner, false, like), End::Other)
            }
        }
    }

    /// Clockwise a face is left across the edge that begins at the vertex, else across the one that ends there.
    fn turn(
        &self,
        start: usize,
        corner: usize,
        clockwise: bool,
        like: &impl Fn(usize) -> bool,
    ) -> End {
        let before = |edge: usize| (edge + self.edges - 1) % self.edges;
        let first = if clockwise { corner } else { before(corner) };
        let (mut face, mut edge) = (start, first);
        for _ in 0..LONGEST_WALK {
            let Some(mut next) = self.faces[face].neighbours[edge] else {
                return End::Border;
            };
            // Of the two sub-faces along the edge of a large face the other one touches the edge's end.
            let halves = !self.faces[face].subface && self.faces[next.face as usize].subface;
            if halves && !clockwise {
                match self.other_half(next) {
                    Some(other) => next = other,
                    None => return End::Other,
                }
            }
            let (from, entered) = (face, usize::from(next.edge) % self.edges);
            face = next.face as usize;
            if !like(face) {
                return End::Other;
            }
            // A large face names the sub-face at which its edge begins. Clockwise, a walk around the edge's middle
            // comes from that one, the other way round from the other.
            let large = self.faces[from].subface && !self.faces[face].subface;
            let names = self.faces[face].neighbours[entered].map(|n| n.face as usize);
            if large && (names == Some(from)) == clockwise {
                return End::Closed;
            }
            edge = if clockwise {
                (entered + 1) % self.edges
            } else {
                before(entered)
            };
            if (face, edge) == (start, first) {
                return End::Closed;
            }
        }
        End::Other
    }

    /// The sub-face behind the one that a large face names, which borders on the same edge.
    fn other_half(&self, named: Neighbour) -> Option<Neighbour> {
        let between = usize::from(named.edge + 3) % self.edges;
        let other = self.faces[named.face as usize].neighbours[between]?;
        Some(Neighbour {
            edge: ((usize::from(other.edge) + 3) % self.edges) as u8,
            ..other
        })
    }
}
