//! Edwin Catmull, Jim Clark, *Recursively generated B-spline surfaces on arbitrary topological meshes*, 1978: each
//! face becomes a quad for each corner, and the points are smoothed so that the limit is a bicubic B-spline wherever
//! the mesh is a regular grid.
//!
//! Face points are the means of their faces. Edge points are the mean of the ends and the two adjacent face points.
//! A vertex of valence n becomes (n − 2)/n of itself, plus 1/n² of each neighbour and of each adjacent face point.
//! Sharp edges and vertices follow DeRose et al. 1998 (see `crease.rs`).
//!
//! The *smooth* rule for triangles, OpenSubdiv's, gives the face points next to an edge the weight 0.47 for a
//! triangle instead of ¼; it evens out the ripples that triangles make in a mesh of quads.

use super::super::cage::Cage;
use super::super::refine::Masks;
use super::super::stencils::Stencils;
use crate::mesh::TriangleRule;

/// Face point's weight next to an edge whose face is a triangle, under the smooth rule; OpenSubdiv's constant.
const SMOOTH_TRIANGLE: f64 = 0.470;

/// Catmull-Clark's masks.
pub(in crate::subdiv) struct CatmullClark;

impl Masks for CatmullClark {
    fn edge(&self, cage: &Cage, edge: u32, share: f64, row: &mut Stencils) {
        let topology = &cage.topology;
        let corners = topology.edge_corners(edge);
        let smooth_triangles = cage.rules.triangle_rule == TriangleRule::Smooth;
        let weight = |corner: u32| {
            let sides = topology.corners(topology.face(corner)).len();
            if smooth_triangles && sides == 3 {
                SMOOTH_TRIANGLE
            } else {
                0.25
            }
        };
        let sum: f64 = corners.iter().map(|&c| weight(c)).sum();
        let face = sum / corners.len() as f64;
        for vertex in topology.edge_vertices(edge) {
            row.add(vertex, share * (0.5 - face));
        }
        for &corner in corners {
            add_face_point(cage, topology.face(corner), share * face, row);
        }
    }

    fn smooth_vertex(&self, cage: &Cage, vertex: u32, share: f64, row: &mut Stencils) {
        let edges = cage.topology.vertex_edges(vertex);
        let n = edges.len() as f64;
        row.add(vertex, share * (n - 2.0) / n);
        let weight = share / (n * n);
        for &edge in edges {
            row.add(cage.topology.far_end(edge, vertex), weight);
        }
        for &corner in cage.topology.vertex_corners(vertex) {
            add_face_point(cage, cage.topology.face(corner), weight, row);
        }
    }
}

/// Adds a face's point: the mean of its vertices.
pub(in crate::subdiv) fn add_face_point(cage: &Cage, face: u32, share: f64, row: &mut Stencils) {
    let vertices = cage.topology.face_vertices(face);
    let weight = share / vertices.len() as f64;
    for &vertex in vertices {
        row.add(vertex, weight);
    }
}
