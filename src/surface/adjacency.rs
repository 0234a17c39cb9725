//! Which faces meet at each edge and vertex: the reverse of [`Base::edge`] and [`Base::vertex`].

use super::base::{Base, EdgeUse};

/// A face and one of its four edges or corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side {
    pub(super) face: u32,
    pub(super) k: u32,
    /// Of edges: whether the edge's own direction runs from corner `k + 1` to corner `k`.
    pub(super) reversed: bool,
}

/// The sides of each edge and vertex, lowest face first: that one is the owner of what they share. Holes have none.
pub(super) struct Adjacency {
    edges: Lists,
    vertices: Lists,
}

impl Adjacency {
    pub(super) fn new(base: &dyn Base) -> Self {
        let sides = || {
            (0..base.faces())
                .filter(|&face| !base.is_hole(face))
                .flat_map(|face| (0..4).map(move |k| (face, k)))
        };
        Self {
            edges: Lists::new(|| {
                sides().map(|(face, k)| {
                    let EdgeUse { edge, reversed } = base.edge(face, k);
                    (edge, pack(face, k, reversed))
                })
            }),
            vertices: Lists::new(|| {
                sides().map(|(face, k)| (base.vertex(face, k), pack(face, k, false)))
            }),
        }
    }

    /// One more than the highest edge number.
    pub(super) fn edge_count(&self) -> u32 {
        self.edges.count()
    }

    /// One more than the highest vertex number.
    pub(super) fn vertex_count(&self) -> u32 {
        self.vertices.count()
    }

    pub(super) fn edge(&self, edge: u32) -> impl ExactSizeIterator<Item = Side> {
        self.edges.get(edge)
    }

    pub(super) fn vertex(&self, vertex: u32) -> impl ExactSizeIterator<Item = Side> {
        self.vertices.get(vertex)
    }

    pub(super) fn memory(&self) -> usize {
        self.edges.memory() + self.vertices.memory()
    }
}

/// Face, edge or corner, and direction in one number: there are at most 2^29 faces.
fn pack(face: u32, k: u32, reversed: bool) -> u32 {
    debug_assert!(face < 1 << 29, "face {face}");
    face << 3 | k << 1 | u32::from(reversed)
}

/// One list after the other; list `i` ends where list `i + 1` starts.
struct Lists {
    starts: Vec<u32>,
    sides: Vec<u32>,
}

impl Lists {
    /// Sorts sides by number, keeping their order.
    fn new<I: Iterator<Item = (u32, u32)>>(sides: impl Fn() -> I) -> Self {
        let mut starts = vec![0];
        for (number, _) in sides() {
            let next = number as usize + 1;
            if starts.len() <= next {
                starts.resize(next + 1, 0);
            }
            starts[next] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut places = starts.clone();
        let mut sorted = vec![0; starts[starts.len() - 1] as usize];
        for (number, side) in sides() {
            let place = &mut places[number as usize];
            sorted[*place as usize] = side;
            *place += 1;
        }
        Self {
            starts,
            sides: sorted,
        }
    }

    fn count(&self) -> u32 {
        (self.starts.len() - 1) as u32
    }

    fn get(&self, i: u32) -> impl ExactSizeIterator<Item = Side> {
        let i = i as usize;
        let range = self.starts[i] as usize..self.starts[i + 1] as usize;
        self.sides[range].iter().map(|&side| Side {
            face: side >> 3,
            k: side >> 1 & 3,
            reversed: side & 1 == 1,
        })
    }

    fn memory(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(self.sides.as_slice())
    }
}
