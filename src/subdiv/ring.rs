//! The one-ring of a face: the faces that share a vertex with it, as a small mesh of its own.
//!
//! A face's limit surface depends on nothing else, and so do the rings of its children. Rings are written down in
//! one order, so that faces in equal surroundings have equal rings: the face first, then around each of its
//! corners in turn, counterclockwise.

use super::cage::Cage;
use crate::mesh::{CreaseMethod, Topology};

/// A face's surroundings: face 0 of `cage`, whose vertices come first and in its order.
#[derive(Debug, Clone)]
pub(super) struct Ring {
    /// All faces at the face's vertices. Sharpness is known at the face's own vertices and at the edges that touch
    /// them; it is 0 further out, where it does not matter.
    pub(super) cage: Cage,
    /// The vertices in the numbers of the cage that the ring is of.
    pub(super) vertices: Vec<u32>,
    /// How many of them are the face's own; they come first.
    pub(super) own: u32,
}

impl Ring {
    /// The ring of `face`.
    pub(super) fn of(cage: &Cage, face: u32) -> Self {
        let topology = &cage.topology;
        // Corners at which faces are entered: they start there.
        let mut entries: Vec<u32> = vec![topology.corners(face).start];
        let add = |corner: u32, entries: &mut Vec<u32>| {
            let known = |&e: &u32| topology.face(e) == topology.face(corner);
            if !entries.iter().any(known) {
                entries.push(corner);
            }
        };
        for start in topology.corners(face) {
            let mut corner = start;
            while let Some(left) = topology.turn_left(corner).filter(|&c| c != start) {
                add(left, &mut entries);
                corner = left;
            }
            // An open fan: its other side, too. Then whatever else meets there.
            let mut corner = start;
            while let Some(right) = topology.turn_right(corner).filter(|&c| c != start) {
                add(right, &mut entries);
                corner = right;
            }
            for &corner in topology.vertex_corners(topology.vertex(start)) {
                add(corner, &mut entries);
            }
        }

        let mut vertices: Vec<u32> = Vec::with_capacity(4 * entries.len());
        let mut edges: Vec<u32> = Vec::with_capacity(4 * entries.len());
        let mut counts = Vec::with_capacity(entries.len());
        let mut corner_vertices = Vec::with_capacity(4 * entries.len());
        let mut corner_edges = Vec::with_capacity(4 * entries.len());
        let mut own = 0;
        for &entry in &entries {
            let mut corner = entry;
            counts.push(topology.corners(topology.face(entry)).len() as u32);
            loop {
                corner_vertices.push(number(&mut vertices, topology.vertex(corner)));
                corner_edges.push(number(&mut edges, topology.edge(corner)));
                corner = topology.next(corner);
                if corner == entry {
                    break;
                }
            }
            if counts.len() == 1 {
                own = vertices.len() as u32;
            }
        }
        let mut edge_vertices = Vec::with_capacity(edges.len());
        let mut edge_sharpness = Vec::with_capacity(edges.len());
        let mut halves = Vec::new();
        for &edge in &edges {
            let whole_ends = topology.edge_vertices(edge);
            let ends = whole_ends.map(|v| number(&mut vertices, v));
            let touches = ends.iter().any(|&v| v < own);
            edge_vertices.push(ends);
            if cage.rules.crease_method == CreaseMethod::Chaikin {
                halves.push(whole_ends.map(|v| match touches {
                    true => cage.child_sharpness(edge, v),
                    false => 0.0,
                }));
            }
            edge_sharpness.push(if touches {
                cage.edge_sharpness[edge as usize]
            } else {
                0.0
            });
        }
        let local = Topology::with_edges(
            &counts,
            corner_vertices,
            corner_edges,
            edge_vertices,
            vertices.len(),
        );
        let mut vertex_sharpness = vec![0.0; vertices.len()];
        for (sharpness, &vertex) in vertex_sharpness.iter_mut().zip(&vertices[..own as usize]) {
            *sharpness = cage.vertex_sharpness[vertex as usize];
        }
        Self {
            cage: Cage {
                hole: vec![false; counts.len()],
                topology: local,
                rules: cage.rules,
                halves,
                edge_sharpness,
                vertex_sharpness,
            },
            vertices,
            own,
        }
    }

    /// How many corners the face has.
    pub(super) fn sides(&self) -> u32 {
        self.cage.topology.corners(0).len() as u32
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        let cage = &self.cage;
        size_of::<Self>()
            + cage.topology.memory()
            + size_of_val(cage.edge_sharpness.as_slice())
            + size_of_val(cage.vertex_sharpness.as_slice())
            + size_of_val(cage.hole.as_slice())
            + size_of_val(cage.halves.as_slice())
            + size_of_val(self.vertices.as_slice())
    }

    /// Everything that decides about the limit surface but the points: equal keys mean equal weights.
    pub(super) fn key(&self) -> Vec<u32> {
        let topology = &self.cage.topology;
        let faces = topology.face_count() as u32;
        let mut key = Vec::with_capacity(2 + topology.corner_count() + faces as usize);
        key.push(faces);
        key.extend((0..faces).map(|f| topology.corners(f).len() as u32));
        let corners = 0..topology.corner_count() as u32;
        key.extend(corners.clone().map(|c| topology.vertex(c)));
        key.extend(corners.map(|c| topology.edge(c)));
        let bits = |sharpness: &f32| sharpness.min(crate::mesh::Crease::INFINITE).to_bits();
        key.extend(self.cage.edge_sharpness.iter().map(bits));
        key.extend(self.cage.halves.iter().flatten().map(bits));
        key.extend(
            self.cage.vertex_sharpness[..self.own as usize]
                .iter()
                .map(bits),
        );
        key
    }
}

/// The place of `item` in `list`, at its end if it is new.
fn number(list: &mut Vec<u32>, item: u32) -> u32 {
    let known = list.iter().position(|&i| i == item);
    known.unwrap_or_else(|| {
        list.push(item);
        list.len() - 1
    }) as u32
}
