//! Nira Dyn, John Gregory, David Levin, *A Butterfly Subdivision Scheme for Surface Interpolation with Tension
//! Control*, 1990, with the rules for extraordinary vertices of Zorin, Schröder, Sweldens, *Interpolating Subdivision
//! for Meshes with Arbitrary Topology*, 1996.
//!
//! Each triangle becomes four. Old points stay, and a new one on each edge is a weighted sum of points around it, so
//! the surface passes through all points of every level. Between vertices of valence 6 the weights are those of the
//! butterfly below with no tension; they reproduce cubic polynomials on the regular lattice. At an end of another
//! valence the weights come from the ring of that end alone; if both ends are such, the point is the mean of the two.
//!
//! ```text
//!     c --- b --- c        a  1/2
//!      \   / \   /         b  1/8          The middle of the edge a-a is computed.
//!       \ /   \ /          c -1/16
//!        a --- a
//!       / \   / \          On borders, along the curve: -1/16, 9/16, 9/16, -1/16.
//!      /   \ /   \
//!     c --- b --- c
//! ```
//!
//! Departure: Zorin's rules for ends on the border need rings that are cut open; here such an end counts as regular,
//! and a wing `c` that would lie beyond the border is the fourth corner of the parallelogram over its edge. Planes and
//! linear functions are kept, and the surface is continuous there, but its tangents need not be.

use std::f64::consts::TAU;

use super::classic::{Rules, Step, holes, numbers};
use super::sharp::{Kind, Sharp};
use crate::mesh::{ControlMesh, Topology};
use crate::subdiv::stencils::Stencils;

/// The rules; no step depends on another.
#[derive(Debug)]
pub(super) struct Butterfly;

impl Rules for Butterfly {
    fn step<'a>(&mut self, mesh: &'a ControlMesh, topology: &'a Topology) -> Step<'a> {
        let faces = topology.face_count();
        let points = topology.vertex_count() as u32;
        let mut indices = Vec::with_capacity(12 * faces);
        for f in 0..faces as u32 {
            let v = topology.face_vertices(f);
            let e = topology.face_edges(f);
            indices.extend(split(
                [v[0], v[1], v[2]],
                [e[0], e[1], e[2]].map(|e| points + e),
            ));
        }
        let hole = holes(mesh);
        Step {
            counts: vec![3; 4 * faces],
            indices,
            parent_face: (0..4 * faces as u32).map(|f| f / 4).collect(),
            holes: numbers((0..4 * faces).map(|f| hole[f / 4])),
            kept_corners: Vec::new(),
            points: masks(mesh, topology),
            linear: linear(topology),
            corners: Box::new(|_| corners(topology)),
        }
    }
}

/// The corners of a triangle's four children, from its own and the middles of its edges.
fn split<T: Copy>([v0, v1, v2]: [T; 3], [e0, e1, e2]: [T; 3]) -> [T; 12] {
    [v0, e0, e2, e0, v1, e1, e2, e1, v2, e1, e2, e0]
}

fn masks(mesh: &ControlMesh, topology: &Topology) -> Stencils {
    let sharp = Sharp::of(mesh, topology);
    let mut stencils = stay(topology);
    for edge in 0..topology.edge_count() as u32 {
        let [a, b] = topology.edge_vertices(edge);
        if sharp.edge(edge) {
            stencils.add(a, 9.0 / 16.0);
            stencils.add(b, 9.0 / 16.0);
            for (point, weight) in [sharp.before(a, b), sharp.before(b, a)].concat() {
                stencils.add(point, -weight / 16.0);
            }
        } else {
            let corners = topology.edge_corners(edge);
            let irregular = |corner: u32| {
                let v = topology.vertex(corner);
                sharp.vertex(v) == Kind::Inner && topology.vertex_corners(v).len() != 6
            };
            let ends: Vec<u32> = corners.iter().copied().filter(|&c| irregular(c)).collect();
            if ends.is_empty() {
                butterfly(topology, edge, &mut stencils);
            }
            for &corner in &ends {
                around(topology, corner, 1.0 / ends.len() as f64, &mut stencils);
            }
        }
        stencils.end_row();
    }
    stencils
}

/// The regular mask, from the edge's two triangles and the four beyond them.
fn butterfly(topology: &Topology, edge: u32, stencils: &mut Stencils) {
    for &corner in topology.edge_corners(edge) {
        let (next, previous) = (topology.next(corner), topology.previous(corner));
        stencils.add(topology.vertex(corner), 1.0 / 2.0);
        stencils.add(topology.vertex(previous), 1.0 / 8.0);
        for side in [next, previous] {
            wing(topology, side, -1.0 / 16.0, stencils);
        }
    }
}

/// The vertex beyond the edge that leaves `corner`, or where it would be.
fn wing(topology: &Topology, corner: u32, weight: f64, stencils: &mut Stencils) {
    let across = match topology.edge_corners(topology.edge(corner)) {
        &[a, b] if topology.is_edge_manifold(topology.edge(corner)) => {
            Some(if a == corner { b } else { a })
        }
        _ => None,
    };
    if let Some(across) = across {
        stencils.add(topology.vertex(topology.previous(across)), weight);
    } else {
        stencils.add(topology.vertex(corner), weight);
        stencils.add(topology.vertex(topology.next(corner)), weight);
        stencils.add(topology.vertex(topology.previous(corner)), -weight);
    }
}

/// Zorin's mask of the ring around the vertex at `corner`, for the edge that leaves it.
fn around(topology: &Topology, corner: u32, share: f64, stencils: &mut Stencils) {
    let vertex = topology.vertex(corner);
    let valence = topology.vertex_corners(vertex).len();
    stencils.add(vertex, share * 0.75);
    let mut at = corner;
    for j in 0..valence {
        let end = topology.vertex(topology.next(at));
        stencils.add(end, share * ring_weight(j, valence));
        at = topology
            .turn_left(at)
            .expect("an inner vertex has a closed fan");
    }
}

/// Weight of the ring's point `j`, counted from the edge; with the vertex's 3/4 they sum to 1. A valence of 2, which
/// the paper leaves out, takes what of its formula keeps the sum.
fn ring_weight(j: usize, valence: usize) -> f64 {
    match (valence, j) {
        (2, 0) => 1.0 / 4.0,
        (2, _) => 0.0,
        (3, 0) => 5.0 / 12.0,
        (3, _) => -1.0 / 12.0,
        (4, 0) => 3.0 / 8.0,
        (4, 2) => -1.0 / 8.0,
        (4, _) => 0.0,
        _ => {
            let angle = TAU * j as f64 / valence as f64;
            (0.25 + angle.cos() + 0.5 * (2.0 * angle).cos()) / valence as f64
        }
    }
}

fn stay(topology: &Topology) -> Stencils {
    let points = topology.vertex_count();
    let mut stencils = Stencils::with_capacity(points + topology.edge_count());
    for v in 0..points as u32 {
        stencils.add(v, 1.0);
        stencils.end_row();
    }
    stencils
}

fn linear(topology: &Topology) -> Stencils {
    let mut stencils = stay(topology);
    for edge in 0..topology.edge_count() as u32 {
        for vertex in topology.edge_vertices(edge) {
            stencils.add(vertex, 0.5);
        }
        stencils.end_row();
    }
    stencils
}

/// Each child lies in its parent, so that seams need no care.
fn corners(topology: &Topology) -> Stencils {
    let mut stencils = Stencils::with_capacity(4 * topology.corner_count());
    for c in (0..topology.corner_count() as u32).step_by(3) {
        let own = [c, c + 1, c + 2];
        let children = split(own.map(|c| [c, c]), own.map(|c| [c, topology.next(c)]));
        for pair in children {
            for corner in pair {
                stencils.add(corner, 0.5);
            }
            stencils.end_row();
        }
    }
    stencils
}
