//! Bilinear subdivision: faces split like Catmull-Clark's, and all points stay where they are.

use super::super::cage::Cage;
use super::super::refine::Masks;
use super::super::stencils::Stencils;

/// Bilinear masks; sharpness makes no difference to them.
pub(in crate::subdiv) struct Bilinear;

impl Masks for Bilinear {
    fn edge(&self, cage: &Cage, edge: u32, share: f64, row: &mut Stencils) {
        for vertex in cage.topology.edge_vertices(edge) {
            row.add(vertex, 0.5 * share);
        }
    }

    fn smooth_vertex(&self, _: &Cage, vertex: u32, share: f64, row: &mut Stencils) {
        row.add(vertex, share);
    }

    fn is_linear(&self) -> bool {
        true
    }
}
