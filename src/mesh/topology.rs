//! Who meets whom in a mesh: faces, corners, edges and vertices by number, derived once from the faces.
//!
//! A *corner* is a place in the list of face vertices. Corner `c` also stands for the edge that starts there: from
//! its vertex to that of the face's next corner.
//!
//! ```text
//!        e(p)            p = previous(c), n = next(c); faces run counterclockwise.
//!     p ------ c         The edge that leaves c is edge(c), the one that arrives is edge(p).
//!     |        |         Counterclockwise around c's vertex, the face lies between edge(c) and edge(p):
//!     |   f    | edge(c) the next face is the one whose edge leaves along edge(p).
//!     |        |
//!     o ------ n
//! ```
//!
//! Edges are numbered in the order in which the faces first run along them.

/// The incidences of a mesh. Faces have at least three corners and name no vertex twice.
#[derive(Debug, Clone)]
pub struct Topology {
    face_starts: Vec<u32>,
    corner_vertices: Vec<u32>,
    corner_edges: Vec<u32>,
    corner_faces: Vec<u32>,
    edge_vertices: Vec<[u32; 2]>,
    edge_corners: Lists,
    edge_manifold: Vec<bool>,
    vertex_corners: Lists,
    vertex_edges: Lists,
    vertex_manifold: Vec<bool>,
}

impl Topology {
    /// The incidences of faces with `counts[f]` corners each, over `vertices` vertices.
    ///
    /// # Panics
    /// If the counts do not add up to the indices, or an index is not below `vertices`.
    pub fn new(counts: &[u32], corner_vertices: Vec<u32>, vertices: usize) -> Self {
        let mut face_starts = Vec::with_capacity(counts.len() + 1);
        face_starts.push(0);
        let mut corner_faces = Vec::with_capacity(corner_vertices.len());
        for (face, &count) in (0_u32..).zip(counts) {
            corner_faces.extend(std::iter::repeat_n(face, count as usize));
            face_starts.push(corner_faces.len() as u32);
        }
        assert_eq!(
            corner_faces.len(),
            corner_vertices.len(),
            "the counts are not those of the faces"
        );
        let mut topology = Self {
            face_starts,
            corner_edges: vec![0; corner_vertices.len()],
            vertex_corners: Lists::of(vertices, corner_vertices.iter().map(|&v| [v])),
            corner_vertices,
            corner_faces,
            edge_vertices: Vec::new(),
            edge_corners: Lists::default(),
            edge_manifold: Vec::new(),
            vertex_edges: Lists::default(),
            vertex_manifold: Vec::new(),
        };
        topology.number_edges();
        topology.vertex_edges = Lists::of(vertices, topology.edge_vertices.iter().copied());
        topology.edge_manifold = (0..topology.edge_count() as u32)
            .map(|e| match topology.edge_corners(e) {
                [_] => true,
                &[a, b] => topology.vertex(a) != topology.vertex(b),
                _ => false,
            })
            .collect();
        topology.vertex_manifold = (0..vertices as u32).map(|v| topology.is_fan(v)).collect();
        topology
    }

    /// How many faces there are.
    pub fn face_count(&self) -> usize {
        self.face_starts.len() - 1
    }

    /// How many vertices there are, those that no face uses included.
    pub fn vertex_count(&self) -> usize {
        self.vertex_manifold.len()
    }

    /// How many edges there are.
    pub fn edge_count(&self) -> usize {
        self.edge_vertices.len()
    }

    /// How many corners all faces have.
    pub fn corner_count(&self) -> usize {
        self.corner_vertices.len()
    }

    /// The corners of a face.
    pub fn corners(&self, face: u32) -> std::ops::Range<u32> {
        self.face_starts[face as usize]..self.face_starts[face as usize + 1]
    }

    /// The vertices of a face, in its order.
    pub fn face_vertices(&self, face: u32) -> &[u32] {
        let corners = self.corners(face);
        &self.corner_vertices[corners.start as usize..corners.end as usize]
    }

    /// The edges of a face: the first one leaves its first corner.
    pub fn face_edges(&self, face: u32) -> &[u32] {
        let corners = self.corners(face);
        &self.corner_edges[corners.start as usize..corners.end as usize]
    }

    /// The vertex at a corner.
    pub fn vertex(&self, corner: u32) -> u32 {
        self.corner_vertices[corner as usize]
    }

    /// The edge that leaves a corner.
    pub fn edge(&self, corner: u32) -> u32 {
        self.corner_edges[corner as usize]
    }

    /// The face of a corner.
    pub fn face(&self, corner: u32) -> u32 {
        self.corner_faces[corner as usize]
    }

    /// The next corner of the face.
    pub fn next(&self, corner: u32) -> u32 {
        let corners = self.corners(self.face(corner));
        if corner + 1 == corners.end {
            corners.start
        } else {
            corner + 1
        }
    }

    /// The previous corner of the face.
    pub fn previous(&self, corner: u32) -> u32 {
        let corners = self.corners(self.face(corner));
        if corner == corners.start {
            corners.end - 1
        } else {
            corner - 1
        }
    }

    /// The two ends of an edge, in the direction of the face that was first.
    pub fn edge_vertices(&self, edge: u32) -> [u32; 2] {
        self.edge_vertices[edge as usize]
    }

    /// The end of `edge` that is not `vertex`.
    pub fn far_end(&self, edge: u32, vertex: u32) -> u32 {
        let [a, b] = self.edge_vertices(edge);
        if a == vertex { b } else { a }
    }

    /// The corners that `edge` leaves, one for each face along it, ascending.
    pub fn edge_corners(&self, edge: u32) -> &[u32] {
        self.edge_corners.get(edge)
    }

    /// The corners at a vertex, ascending.
    pub fn vertex_corners(&self, vertex: u32) -> &[u32] {
        self.vertex_corners.get(vertex)
    }

    /// The edges at a vertex, ascending.
    pub fn vertex_edges(&self, vertex: u32) -> &[u32] {
        self.vertex_edges.get(vertex)
    }

    /// Whether an edge has one face only.
    pub fn is_border(&self, edge: u32) -> bool {
        self.edge_corners(edge).len() == 1
    }

    /// Whether an edge has one face, or two that run along it in opposite directions.
    pub fn is_edge_manifold(&self, edge: u32) -> bool {
        self.edge_manifold[edge as usize]
    }

    /// Whether the faces at a vertex are one fan, open or closed, of manifold edges.
    pub fn is_vertex_manifold(&self, vertex: u32) -> bool {
        self.vertex_manifold[vertex as usize]
    }

    /// The corner of the face that follows counterclockwise around the corner's vertex, if there is just one.
    pub fn turn_left(&self, corner: u32) -> Option<u32> {
        let arriving = self.edge(self.previous(corner));
        let &[a, b] = self.edge_corners(arriving) else {
            return None;
        };
        let other = if self.face(a) == self.face(corner) {
            b
        } else {
            a
        };
        (self.vertex(other) == self.vertex(corner)).then_some(other)
    }

    /// The corner of the face that follows clockwise around the corner's vertex, if there is just one.
    pub fn turn_right(&self, corner: u32) -> Option<u32> {
        let &[a, b] = self.edge_corners(self.edge(corner)) else {
            return None;
        };
        let other = if a == corner { b } else { a };
        let at_vertex = self.next(other);
        (self.vertex(at_vertex) == self.vertex(corner)).then_some(at_vertex)
    }

    /// The edge between two vertices.
    pub fn find_edge(&self, a: u32, b: u32) -> Option<u32> {
        self.vertex_edges(a)
            .iter()
            .copied()
            .find(|&e| self.far_end(e, a) == b)
    }

    /// Bytes that its arrays hold.
    pub fn memory(&self) -> usize {
        let words = self.face_starts.len()
            + 3 * self.corner_vertices.len()
            + 2 * self.edge_vertices.len()
            + self.edge_corners.words()
            + self.vertex_corners.words()
            + self.vertex_edges.words();
        4 * words + self.edge_manifold.len() + self.vertex_manifold.len()
    }

    /// Numbers the edges, and gathers the corners of each.
    fn number_edges(&mut self) {
        // Sorted by their ends, the corners of an edge lie together, the lowest first.
        let mut by_ends: Vec<(u32, u32, u32)> = (0..self.corner_count() as u32)
            .map(|c| {
                let (a, b) = (self.vertex(c), self.vertex(self.next(c)));
                (a.min(b), a.max(b), c)
            })
            .collect();
        by_ends.sort_unstable();
        const NONE: u32 = u32::MAX;
        let mut first = vec![NONE; self.corner_count()];
        for group in by_ends.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            for &(_, _, corner) in group {
                first[corner as usize] = group[0].2;
            }
        }
        for corner in 0..self.corner_count() as u32 {
            let first = first[corner as usize];
            if first == corner {
                self.corner_edges[corner as usize] = self.edge_count() as u32;
                let ends = [self.vertex(corner), self.vertex(self.next(corner))];
                self.edge_vertices.push(ends);
            } else {
                self.corner_edges[corner as usize] = self.corner_edges[first as usize];
            }
        }
        let edges = self.corner_edges.iter().map(|&e| [e]);
        self.edge_corners = Lists::of(self.edge_count(), edges);
    }

    fn is_fan(&self, vertex: u32) -> bool {
        let corners = self.vertex_corners(vertex);
        let edges = self.vertex_edges(vertex);
        if corners.is_empty() || !edges.iter().all(|&e| self.is_edge_manifold(e)) {
            return false;
        }
        // From the border, or from anywhere in a closed fan, one turn must meet all.
        let first = corners
            .iter()
            .copied()
            .find(|&c| self.turn_right(c).is_none())
            .unwrap_or(corners[0]);
        let mut met = 1;
        let mut corner = first;
        while let Some(left) = self.turn_left(corner) {
            if left == first {
                break;
            }
            corner = left;
            met += 1;
        }
        met == corners.len()
    }
}

/// A list of numbers for each key, all in one array.
#[derive(Debug, Clone, Default)]
struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// For each of `count` keys the numbers of the items that name it, ascending.
    fn of<const N: usize>(
        count: usize,
        keys_of_items: impl Iterator<Item = [u32; N]> + Clone,
    ) -> Self {
        let mut starts = vec![0_u32; count + 1];
        for key in keys_of_items.clone().flatten() {
            starts[key as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut end = starts.clone();
        let mut items = vec![0; starts[count] as usize];
        for (item, keys) in (0_u32..).zip(keys_of_items) {
            for key in keys {
                items[end[key as usize] as usize] = item;
                end[key as usize] += 1;
            }
        }
        Self { starts, items }
    }

    fn get(&self, key: u32) -> &[u32] {
        let key = key as usize;
        &self.items[self.starts[key] as usize..self.starts[key + 1] as usize]
    }

    fn words(&self) -> usize {
        self.starts.len() + self.items.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube: six faces counterclockwise from outside.
    fn cube() -> Topology {
        let faces = [
            [0, 1, 3, 2],
            [2, 3, 5, 4],
            [4, 5, 7, 6],
            [6, 7, 1, 0],
            [1, 7, 5, 3],
            [6, 0, 2, 4],
        ];
        Topology::new(&[4; 6], faces.concat(), 8)
    }

    #[test]
    fn a_cube_is_closed() {
        let cube = cube();
        assert_eq!((cube.edge_count(), cube.vertex_count()), (12, 8));
        assert!((0..12).all(|e| cube.is_edge_manifold(e) && !cube.is_border(e)));
        assert!((0..8).all(|v| cube.is_vertex_manifold(v)));
        for c in 0..24 {
            // Three turns around a vertex of valence 3 come back, and left undoes right.
            let left = |c| cube.turn_left(c).expect("closed");
            assert_eq!(left(left(left(c))), c);
            assert_eq!(cube.turn_right(left(c)), Some(c));
            assert_eq!(cube.vertex(left(c)), cube.vertex(c));
        }
    }

    #[test]
    fn a_bow_tie_and_a_fin_are_not_manifold() {
        let bow = Topology::new(&[3, 3], vec![0, 1, 2, 0, 3, 4], 6);
        assert!(!bow.is_vertex_manifold(0) && bow.is_vertex_manifold(1));
        assert!(!bow.is_vertex_manifold(5), "no face uses it");
        let fin = Topology::new(&[3, 3, 3], vec![0, 1, 2, 1, 0, 3, 0, 1, 4], 5);
        let edge = fin.find_edge(1, 0).expect("shared");
        assert_eq!(fin.edge_corners(edge).len(), 3);
        assert!(!fin.is_edge_manifold(edge) && !fin.is_vertex_manifold(0));
        let twisted = Topology::new(&[3, 3], vec![0, 1, 2, 0, 1, 3], 4);
        assert!(!twisted.is_edge_manifold(0));
    }
}
