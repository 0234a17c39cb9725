//! The texels of all Ptex faces of a cage: where they lie, and which ones are side by side.

use std::ops::Range;

use relievo_ptex::{MeshType, Res};

use super::sizes::middle;
use crate::mesh::PtexFace;

/// Texels are numbered face by face and row by row.
pub(super) struct Texels<'a> {
    kind: MeshType,
    faces: &'a [PtexFace],
    res: Vec<Res>,
    starts: Vec<usize>,
}

impl<'a> Texels<'a> {
    /// Those of faces of these sizes.
    pub(super) fn new(kind: MeshType, faces: &'a [PtexFace], res: Vec<Res>) -> Self {
        let mut starts = vec![0];
        let mut end = 0;
        for res in &res {
            end += 1_usize << (res.ulog2 + res.vlog2) as u32;
            starts.push(end);
        }
        Self {
            kind,
            faces,
            res,
            starts,
        }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.starts[self.res.len()]
    }

    /// Those of a face.
    pub(super) fn of(&self, face: usize) -> Range<usize> {
        self.starts[face]..self.starts[face + 1]
    }

    /// The size of a face.
    pub(super) fn res(&self, face: usize) -> Res {
        self.res[face]
    }

    /// Columns and rows of a face.
    pub(super) fn size(&self, face: usize) -> [usize; 2] {
        let Res { ulog2, vlog2 } = self.res[face];
        [1 << ulog2, 1 << vlog2]
    }

    /// Where the middles of a row of a face's texels are.
    pub(super) fn middles(
        &self,
        face: usize,
        row: usize,
    ) -> impl Iterator<Item = [f64; 2]> + use<> {
        let (kind, size) = (self.kind, self.size(face));
        (0..size[0]).map(move |x| middle(kind, [x, row], size))
    }

    /// Corners of a face's texels, one of each: the one away from the face's own, and of triangles the middle of the
    /// side that two halves of a cell share.
    pub(super) fn corners(&self, face: usize) -> impl Iterator<Item = [f64; 2]> + use<> {
        let (kind, size) = (self.kind, self.size(face));
        let places = (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| [x, y]));
        places.filter_map(move |at| {
            let within = match kind {
                MeshType::Quad => 1.0,
                MeshType::Triangle if at[0] + at[1] < size[0] => 0.5,
                MeshType::Triangle => return None,
            };
            Some([0, 1].map(|i| (at[i] as f64 + within) / size[i] as f64))
        })
    }

    /// Adds the texels that share an edge with a texel of a face, over the face's own edges too. Beside a finer or
    /// coarser face it is the one that lies nearest there.
    pub(super) fn neighbours(&self, face: usize, texel: usize, out: &mut Vec<usize>) {
        let size = self.size(face);
        let at = texel - self.starts[face];
        let (x, y) = (at % size[0], at / size[0]);
        match self.kind {
            MeshType::Quad => {
                let number = |x: usize, y: usize| self.starts[face] + y * size[0] + x;
                let [right, top] = [size[0] - 1, size[1] - 1];
                for (edge, ends) in [y == 0, x == right, y == top, x == 0]
                    .into_iter()
                    .enumerate()
                {
                    if ends {
                        let (along, count) = match edge {
                            0 => (x, size[0]),
                            1 => (y, size[1]),
                            2 => (right - x, size[0]),
                            _ => (top - y, size[1]),
                        };
                        out.extend(self.beyond(face, edge, along, count));
                    } else {
                        out.push(match edge {
                            0 => number(x, y - 1),
                            1 => number(x + 1, y),
                            2 => number(x, y + 1),
                            _ => number(x - 1, y),
                        });
                    }
                }
            }
            MeshType::Triangle => {
                let n = size[0];
                let number = |x: usize, y: usize| self.starts[face] + y * n + x;
                // Beyond the diagonal texels are the other halves of cells, upside down.
                let other = |i: usize, j: usize| number(n - 1 - j, n - 1 - i);
                if x + y >= n {
                    let (i, j) = (n - 1 - y, n - 1 - x);
                    out.extend([number(i, j), number(i + 1, j), number(i, j + 1)]);
                    return;
                }
                match y {
                    0 => out.extend(self.beyond(face, 0, x, n)),
                    _ => out.push(other(x, y - 1)),
                }
                match x + y + 1 == n {
                    true => out.extend(self.beyond(face, 1, y, n)),
                    false => out.push(other(x, y)),
                }
                match x {
                    0 => out.extend(self.beyond(face, 2, n - 1 - y, n)),
                    _ => out.push(other(x - 1, y)),
                }
            }
        }
    }

    /// The texel of the next face beside number `along` of `count` along an edge, counted counterclockwise.
    fn beyond(&self, face: usize, edge: usize, along: usize, count: usize) -> Option<usize> {
        let neighbour = self.faces[face].neighbours[edge]?;
        let (next, edge_there) = (neighbour.face as usize, usize::from(neighbour.edge));
        let here = (along as f64 + 0.5) / count as f64;
        let is_sub = |face: usize| self.faces[face].corner.is_some();
        // The next face runs the other way; a sub-face has half of a whole one's edge.
        let there = match (is_sub(face), is_sub(next), edge) {
            (true, false, 0) => 1.0 - 0.5 * here,
            (true, false, _) => 0.5 * (1.0 - here),
            (false, true, _) => (1.0 - 2.0 * here).max(0.0),
            _ => 1.0 - here,
        };
        let size = self.size(next);
        let count = size[edge_there & 1];
        let along = ((there * count as f64) as usize).min(count - 1);
        let [last_x, last_y] = size.map(|n| n - 1);
        let (x, y) = match (self.kind, edge_there) {
            (_, 0) => (along, 0),
            (MeshType::Quad, 1) => (last_x, along),
            (MeshType::Quad, 2) => (last_x - along, last_y),
            (MeshType::Quad, _) => (0, last_y - along),
            (MeshType::Triangle, 1) => (last_x - along, along),
            (MeshType::Triangle, _) => (0, last_y - along),
        };
        Some(self.starts[next] + y * size[0] + x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::mesh::{ControlMesh, Scheme, ptex_faces, ptex_kind};

    fn mesh(scheme: Scheme, counts: &[u32], corners: &[u32]) -> ControlMesh {
        let points = corners.iter().max().map_or(0, |&last| last as usize + 1);
        ControlMesh {
            scheme,
            face_vertex_counts: counts.to_vec(),
            face_vertex_indices: corners.to_vec(),
            points: vec![vec![Vec3::ZERO; points]],
            ..ControlMesh::default()
        }
    }

    /// Each texel's neighbours, where all faces have 2^`log2` texels a side.
    fn neighbours(mesh: &ControlMesh, log2: i8) -> Vec<Vec<usize>> {
        let faces = ptex_faces(mesh);
        let res = Res {
            ulog2: log2,
            vlog2: log2,
        };
        let texels = Texels::new(ptex_kind(mesh), &faces, vec![res; faces.len()]);
        let of_face = |face: usize| texels.of(face).map(move |texel| (face, texel));
        (0..faces.len())
            .flat_map(of_face)
            .map(|(face, texel)| {
                let mut out = Vec::new();
                texels.neighbours(face, texel, &mut out);
                out
            })
            .collect()
    }

    /// Who is named names the one that names it, and as often as there are edges.
    fn is_mutual(lists: &[Vec<usize>]) {
        for (texel, list) in lists.iter().enumerate() {
            for other in list {
                assert_ne!(*other, texel);
                assert!(lists[*other].contains(&texel), "{texel} {other}");
            }
        }
    }

    #[test]
    fn texels_of_equal_faces_name_each_other() {
        let tetrahedron = [0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0];
        let triangles = neighbours(&mesh(Scheme::Loop, &[3; 4], &tetrahedron), 2);
        assert!(triangles.iter().all(|list| list.len() == 3));
        is_mutual(&triangles);
        let sub_faces = neighbours(&mesh(Scheme::CatmullClark, &[3; 4], &tetrahedron), 2);
        assert!(sub_faces.iter().all(|list| list.len() == 4));
        is_mutual(&sub_faces);
        let cube = [
            0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4,
        ];
        let quads = neighbours(&mesh(Scheme::CatmullClark, &[4; 6], &cube), 3);
        assert!(quads.iter().all(|list| list.len() == 4));
        is_mutual(&quads);
    }

    #[test]
    fn a_quad_meets_the_sub_faces_of_a_triangle() {
        // The triangle runs from 2 to 1 along the quad's edge from 1 to 2.
        let lists = neighbours(
            &mesh(Scheme::CatmullClark, &[4, 3], &[0, 1, 2, 3, 2, 1, 4]),
            1,
        );
        // Texels 4 to 7 are the sub-face at 2, 8 to 11 the one at 1.
        assert_eq!(lists[1], [8, 3, 0]);
        assert!(lists[4].contains(&3) && lists[5].contains(&3), "{lists:?}");
        assert!(lists[8].contains(&1) && lists[10].contains(&1), "{lists:?}");
    }
}
