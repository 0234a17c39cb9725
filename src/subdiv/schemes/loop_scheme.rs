//! Charles Loop, *Smooth Subdivision Surfaces Based on Triangles*, 1987: each triangle becomes four, and the points
//! are smoothed so that the limit is a quartic box spline away from vertices of valence other than 6.
//!
//! Edge points are 3/8 of each end and 1/8 of each opposite vertex. A vertex of valence n gives each neighbour the
//! weight (5/8 − (3/8 + cos(2π/n)/4)²)/n. Sharp edges, darts, creases and corners are those of Hoppe et al. 1994,
//! with OpenSubdiv's departure: crease points are ½, ½ whatever their ends are (no 3 : 5 at irregular crease
//! vertices).

use std::f64::consts::TAU;

use super::super::cage::Cage;
use super::super::refine::Masks;
use super::super::stencils::Stencils;

/// Loop's masks, for meshes of triangles.
pub(in crate::subdiv) struct LoopScheme;

impl Masks for LoopScheme {
    fn edge(&self, cage: &Cage, edge: u32, share: f64, row: &mut Stencils) {
        let topology = &cage.topology;
        for vertex in topology.edge_vertices(edge) {
            row.add(vertex, 0.375 * share);
        }
        for &corner in topology.edge_corners(edge) {
            row.add(topology.vertex(topology.previous(corner)), 0.125 * share);
        }
    }

    fn smooth_vertex(&self, cage: &Cage, vertex: u32, share: f64, row: &mut Stencils) {
        let edges = cage.topology.vertex_edges(vertex);
        let weight = neighbour_weight(edges.len());
        row.add(vertex, share * (1.0 - edges.len() as f64 * weight));
        for &edge in edges {
            row.add(cage.topology.far_end(edge, vertex), share * weight);
        }
    }
}

/// Loop's weight of each of `n` neighbours in a smooth vertex' step.
pub(in crate::subdiv) fn neighbour_weight(n: usize) -> f64 {
    let n = n as f64;
    let half = 0.375 + 0.25 * (TAU / n).cos();
    (0.625 - half * half) / n
}
