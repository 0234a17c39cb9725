//! Where a mesh of triangles has its borders, for the schemes that treat these as curves of their own.

use crate::mesh::{BoundaryInterpolation, ControlMesh, Crease, Topology};

/// What a vertex is to the curves of the border.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Inside, its faces one closed fan.
    Inner,
    /// A curve passes, to and from these neighbours.
    Curve([u32; 2]),
    /// Stays where it is: a corner of the border, one tagged as infinitely sharp, a place where curves meet or where
    /// fans touch, a point that no face uses.
    Fixed,
}

/// Borders by edge and vertex. Edges that are not a plain meeting of two faces count as borders.
#[derive(Debug)]
pub(super) struct Sharp {
    edges: Vec<bool>,
    kinds: Vec<Kind>,
}

impl Sharp {
    pub(super) fn of(mesh: &ControlMesh, topology: &Topology) -> Self {
        let edges: Vec<bool> = (0..topology.edge_count() as u32)
            .map(|e| topology.is_border(e) || !topology.is_edge_manifold(e))
            .collect();
        let corners_stay = mesh.boundary == BoundaryInterpolation::EdgeAndCorner;
        let mut tagged = vec![false; topology.vertex_count()];
        for corner in &mesh.corners {
            tagged[corner.vertex as usize] = corner.sharpness >= Crease::INFINITE;
        }
        let kind = |v: u32| {
            let mut curve = topology.vertex_edges(v).iter();
            let mut next = || curve.find(|&&e| edges[e as usize]);
            let far_end = |e: &u32| topology.far_end(*e, v);
            let faces = topology.vertex_corners(v).len();
            match [next(), next(), next()] {
                _ if tagged[v as usize] => Kind::Fixed,
                [None, ..] if topology.is_vertex_manifold(v) => Kind::Inner,
                [Some(a), Some(b), None] if !(corners_stay && faces == 1) => {
                    Kind::Curve([a, b].map(far_end))
                }
                _ => Kind::Fixed,
            }
        };
        let kinds = (0..topology.vertex_count() as u32).map(kind).collect();
        Self { edges, kinds }
    }

    /// Whether an edge is part of the border.
    pub(super) fn edge(&self, edge: u32) -> bool {
        self.edges[edge as usize]
    }

    /// What a vertex is.
    pub(super) fn vertex(&self, vertex: u32) -> Kind {
        self.kinds[vertex as usize]
    }

    /// The point before `vertex` on the curve that goes on to `next`, as a sum of two points with weights: where the
    /// curve ends, the mirror image of `next`.
    pub(super) fn before(&self, vertex: u32, next: u32) -> [(u32, f64); 2] {
        match self.vertex(vertex) {
            Kind::Curve([a, b]) => [(if a == next { b } else { a }, 1.0), (vertex, 0.0)],
            Kind::Inner | Kind::Fixed => [(vertex, 2.0), (next, -1.0)],
        }
    }
}
