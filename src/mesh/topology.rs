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
//! Edges are numbered in the order in which the faces first run along them. An edge from a vertex to itself, and an
//! edge that a face runs along twice, is a separate edge each time, as in OpenSubdiv.

/// The incidences of a mesh. Faces have at least three corners.
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
        let face_starts = starts(counts);
        let (corner_edges, edge_vertices) = number_edges(&face_starts, &corner_vertices);
        Self::with_edges(
            counts,
            corner_vertices,
            corner_edges,
            edge_vertices,
            vertices,
        )
    }

    /// As [`new`](Self::new), where the edges are known: the one that leaves each corner, and the two ends of each.
    ///
    /// # Panics
    /// If lengths differ or numbers are out of range.
    pub fn with_edges(
        counts: &[u32],
        corner_vertices: Vec<u32>,
        corner_edges: Vec<u32>,
        edge_vertices: Vec<[u32; 2]>,
        vertices: usize,
    ) -> Self {
        let face_starts = starts(counts);
        assert_eq!(
            face_starts[counts.len()] as usize,
            corner_vertices.len(),
            "the counts are not those of the faces"
        );
        assert_eq!(
            corner_edges.len(),
            corner_vertices.len(),
            "an edge leaves each corner"
        );
        let corner_faces = (0_u32..)
            .zip(counts)
            .flat_map(|(face, &count)| std::iter::repeat_n(face, count as usize))
            .collect();
        let mut topology = Self {
            face_starts,
            vertex_corners: Lists::of(vertices, corner_vertices.iter().map(|&v| [v])),
            vertex_edges: Lists::of(vertices, edge_vertices.iter().copied()),
            edge_corners: Lists::of(edge_vertices.len(), corner_edges.iter().map(|&e| [e])),
            corner_vertices,
            corner_edges,
            corner_faces,
            edge_vertices,
            edge_manifold: Vec::new(),
            vertex_manifold: Vec::new(),
        };
        topology.edge_manifold = (0..topology.edge_count() as u32)
            .map(|e| topology.meets_plainly(e))
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

    fn meets_plainly(&self, edge: u32) -> bool {
        let [a, b] = self.edge_vertices(edge);
        a != b
            && match self.edge_corners(edge) {
                [_] => true,
                &[a, b] => self.vertex(a) != self.vertex(b) && self.face(a) != self.face(b),
                _ => false,
            }
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

fn starts(counts: &[u32]) -> Vec<u32> {
    let mut starts = Vec::with_capacity(counts.len() + 1);
    starts.push(0);
    let mut end = 0;
    for &count in counts {
        end += count;
        starts.push(end);
    }
    starts
}

/// The edge that leaves each corner, and the ends of each edge.
fn number_edges(face_starts: &[u32], corner_vertices: &[u32]) -> (Vec<u32>, Vec<[u32; 2]>) {
    struct Half {
        ends: [u32; 2],
        corner: u32,
        face: u32,
    }
    let mut halves = Vec::with_capacity(corner_vertices.len());
    for (face, range) in (0_u32..).zip(face_starts.windows(2)) {
        let corners = &corner_vertices[range[0] as usize..range[1] as usize];
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            halves.push(Half {
                ends: [a.min(b), a.max(b)],
                corner: range[0] + i as u32,
                face,
            });
        }
    }
    // Sorted by their ends, the corners of an edge lie together, the lowest first.
    halves.sort_unstable_by_key(|h| (h.ends, h.corner));
    let mut first: Vec<u32> = (0..corner_vertices.len() as u32).collect();
    for group in halves.chunk_by(|x, y| x.ends == y.ends) {
        let mut last_face = None;
        for half in group {
            // A face's second run along the same edge is an edge of its own.
            if half.ends[0] != half.ends[1] && last_face != Some(half.face) {
                first[half.corner as usize] = group[0].corner;
                last_face = Some(half.face);
            }
        }
    }
    let mut corner_edges = vec![0; corner_vertices.len()];
    let mut edge_vertices = Vec::new();
    for range in face_starts.windows(2) {
        for corner in range[0]..range[1] {
            let first = first[corner as usize];
            if first == corner {
                let next = if corner + 1 == range[1] {
                    range[0]
                } else {
                    corner + 1
                };
                corner_edges[corner as usize] = edge_vertices.len() as u32;
                edge_vertices.push([corner, next].map(|c| corner_vertices[c as usize]));
            } else {
                corner_edges[corner as usize] = corner_edges[first as usize];
            }
        }
    }
    (corner_edges, edge_vertices)
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
