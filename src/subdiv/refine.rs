//! One step of refinement, for any mesh: faces split, sharpness decays, and each new point is a weighted sum.
//!
//! ```text
//!   Quads (Catmull-Clark, bilinear)            Triangles (Loop)
//!    3 ---- e2 ---- 2                                  2
//!    |  3   |   2   |   Child i has corner i          / \
//!    e3 --- f ----- e1  of a quad in place i.        / 2 \        Child i has corner i in place i; child 3
//!    |  0   |   1   |   Other faces' children      e2 --- e1      is the middle one, turned by half:
//!    0 ---- e0 ---- 1   start at their corner.     / \ 3 / \      (e1, e2, e0).
//!                                                 / 0 \ / 1 \
//!                                                0 --- e0 --- 1
//! ```
//!
//! Points of the result: first the vertices' in their order, then the faces' (quads only), then the edges'; that and
//! the order of edges and faces are OpenSubdiv's.

use super::cage::{Cage, Rules};
use super::crease::{self, Rule, decayed, is_sharp};
use super::schemes::bilinear::Bilinear;
use super::schemes::catmull_clark::{CatmullClark, add_face_point};
use super::schemes::loop_scheme::LoopScheme;
use super::stencils::Stencils;
use crate::mesh::{Scheme, Topology};

/// What a scheme has of its own: the smooth masks. Sharp ones are the same for all.
pub(super) trait Masks: Sync {
    /// Adds `share` of a smooth edge's point to the row being written.
    fn edge(&self, cage: &Cage, edge: u32, share: f64, row: &mut Stencils);
    /// Adds `share` of a smooth vertex' point; the vertex has faces.
    fn smooth_vertex(&self, cage: &Cage, vertex: u32, share: f64, row: &mut Stencils);
    /// Whether points stay where they are, however sharp.
    fn is_linear(&self) -> bool {
        false
    }
}

fn masks(rules: Rules) -> &'static dyn Masks {
    match rules.scheme {
        _ if rules.linear => &Bilinear,
        Scheme::Loop => &LoopScheme,
        _ => &CatmullClark,
    }
}

/// Where the points of the next level come from, by number.
#[derive(Debug, Clone, Copy)]
struct Children {
    vertices: u32,
    /// 0 where faces have no points.
    faces: u32,
    edges: u32,
}

impl Children {
    fn of(cage: &Cage) -> Self {
        Self {
            vertices: cage.topology.vertex_count() as u32,
            faces: match cage.rules.triangles() {
                true => 0,
                false => cage.topology.face_count() as u32,
            },
            edges: cage.topology.edge_count() as u32,
        }
    }

    fn of_face(self, face: u32) -> u32 {
        self.vertices + face
    }

    fn of_edge(self, edge: u32) -> u32 {
        self.vertices + self.faces + edge
    }

    fn count(self) -> u32 {
        self.vertices + self.faces + self.edges
    }
}

/// The next level, without its points.
///
/// Its edges are first those within the faces of this one, then the two halves of each edge.
///
/// # Panics
/// If the result had more corners than 32 bits can number, or if a face of a Loop cage is not a triangle.
pub(super) fn split(cage: &Cage) -> Cage {
    let topology = &cage.topology;
    let children = Children::of(cage);
    let corners = topology.corner_count() as u64 * 4;
    assert!(
        u32::try_from(corners).is_ok(),
        "{} corners cannot be refined within 32 bits",
        topology.corner_count()
    );
    // One inner edge for each corner: from the face's point to its edge's, or from that of the corner's edge to the
    // previous one's. Which end comes first decides the order of points two levels on.
    let inner = topology.corner_count() as u32;
    let mut edge_vertices = Vec::with_capacity(3 * inner as usize);
    for corner in 0..inner {
        let own = children.of_edge(topology.edge(corner));
        edge_vertices.push(match cage.rules.triangles() {
            true => [
                own,
                children.of_edge(topology.edge(topology.previous(corner))),
            ],
            false => [children.of_face(topology.face(corner)), own],
        });
    }
    let mut edge_sharpness = vec![0.0; inner as usize];
    for edge in 0..topology.edge_count() as u32 {
        for vertex in topology.edge_vertices(edge) {
            edge_vertices.push([children.of_edge(edge), vertex]);
            edge_sharpness.push(cage.child_sharpness(edge, vertex));
        }
    }
    // The half of the corner's edge at its start, or at its end.
    let half = |corner: u32, end: bool| {
        let edge = topology.edge(corner);
        let second = match topology.edge_vertices(edge) {
            // From a vertex to itself: the one corner runs along it in its direction.
            [a, b] if a == b => end,
            [a, _] => (a == topology.vertex(corner)) == end,
        };
        inner + 2 * edge + u32::from(second)
    };

    let mut counts = Vec::new();
    let mut corner_vertices = Vec::with_capacity(corners as usize);
    let mut corner_edges = Vec::with_capacity(corners as usize);
    let mut hole = Vec::new();
    for face in 0..topology.face_count() as u32 {
        let own: Vec<u32> = topology.corners(face).collect();
        let n = own.len();
        let v = |i: usize| topology.vertex(own[i]);
        let e = |i: usize| children.of_edge(topology.edge(own[i % n]));
        if cage.rules.triangles() {
            assert_eq!(n, 3, "Loop subdivision of a face with {n} corners");
            corner_vertices.extend([v(0), e(0), e(2), e(0), v(1), e(1)]);
            corner_vertices.extend([e(2), e(1), v(2), e(1), e(2), e(0)]);
            for i in 0..3 {
                let before = own[(i + 2) % 3];
                let mut edges = [half(own[i], false), own[i], half(before, true)];
                edges.rotate_right(i);
                corner_edges.extend(edges);
            }
            corner_edges.extend([own[2], own[0], own[1]]);
            counts.extend([3; 4]);
            hole.extend([cage.hole[face as usize]; 4]);
        } else {
            for i in 0..n {
                let before = (i + n - 1) % n;
                let mut vertices = [v(i), e(i), children.of_face(face), e(before)];
                let mut edges = [
                    half(own[i], false),
                    own[i],
                    own[before],
                    half(own[before], true),
                ];
                if n == 4 {
                    vertices.rotate_right(i);
                    edges.rotate_right(i);
                }
                corner_vertices.extend(vertices);
                corner_edges.extend(edges);
            }
            counts.resize(counts.len() + n, 4);
            hole.resize(hole.len() + n, cage.hole[face as usize]);
        }
    }
    let count = children.count() as usize;
    let mut vertex_sharpness: Vec<f32> =
        cage.vertex_sharpness.iter().copied().map(decayed).collect();
    vertex_sharpness.resize(count, 0.0);
    Cage {
        topology: Topology::with_edges(
            &counts,
            corner_vertices,
            corner_edges,
            edge_vertices,
            count,
        ),
        rules: cage.rules,
        edge_sharpness,
        vertex_sharpness,
        hole,
        halves: Vec::new(),
    }
}

/// The points of the next level in terms of this one's. Rows that `wanted` does not ask for stay empty.
pub(super) fn stencils(cage: &Cage, wanted: &dyn Fn(Source) -> bool) -> Stencils {
    let masks = masks(cage.rules);
    let children = Children::of(cage);
    let mut rows = Stencils::with_capacity(children.count() as usize);
    for vertex in 0..children.vertices {
        if wanted(Source::Vertex(vertex)) {
            vertex_row(cage, masks, vertex, &mut rows);
        }
        rows.end_row();
    }
    for face in 0..children.faces {
        if wanted(Source::Face) {
            add_face_point(cage, face, 1.0, &mut rows);
        }
        rows.end_row();
    }
    for edge in 0..children.edges {
        if wanted(Source::Edge(edge)) {
            edge_row(cage, masks, edge, &mut rows);
        }
        rows.end_row();
    }
    rows
}

/// What a point of the next level comes from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Source {
    Vertex(u32),
    Face,
    Edge(u32),
}

fn edge_row(cage: &Cage, masks: &dyn Masks, edge: u32, row: &mut Stencils) {
    let sharpness = cage.edge_sharpness[edge as usize];
    let ends = cage.topology.edge_vertices(edge);
    // Under Chaikin's rule both halves may stay sharp though the edge is less than wholly sharp.
    let stays = || {
        ends.iter()
            .all(|&v| is_sharp(cage.child_sharpness(edge, v)))
    };
    let crease = if masks.is_linear() || !is_sharp(sharpness) {
        0.0
    } else if sharpness >= 1.0 || stays() {
        1.0
    } else {
        f64::from(sharpness)
    };
    if crease > 0.0 {
        for vertex in ends {
            row.add(vertex, 0.5 * crease);
        }
    }
    if crease < 1.0 {
        masks.edge(cage, edge, 1.0 - crease, row);
    }
}

fn vertex_row(cage: &Cage, masks: &dyn Masks, vertex: u32, row: &mut Stencils) {
    let topology = &cage.topology;
    if masks.is_linear() || topology.vertex_corners(vertex).is_empty() {
        row.add(vertex, 1.0);
        return;
    }
    let before = cage.rule(vertex);
    if before == Rule::Smooth {
        masks.smooth_vertex(cage, vertex, 1.0, row);
        return;
    }
    let edges = topology.vertex_edges(vertex);
    let sharpness = cage.vertex_sharpness[vertex as usize];
    let child = |edge: u32| cage.child_sharpness(edge, vertex);
    let ends_after = edges.iter().copied().filter(|&e| is_sharp(child(e)));
    let after = crease::rule(decayed(sharpness), ends_after.clone().count());
    let share = if before == after {
        1.0
    } else {
        crease::share_of_old_rule(
            cage.rules.crease_method,
            (sharpness, decayed(sharpness)),
            edges
                .iter()
                .map(|&e| (cage.edge_sharpness[e as usize], child(e))),
        )
    };
    let mut add = |rule: Rule, share: f64, ends: &mut dyn Iterator<Item = u32>| match rule {
        Rule::Smooth => masks.smooth_vertex(cage, vertex, share, row),
        Rule::Corner => row.add(vertex, share),
        Rule::Crease => {
            row.add(vertex, 0.75 * share);
            for edge in ends {
                row.add(topology.far_end(edge, vertex), 0.125 * share);
            }
        }
    };
    add(before, share, &mut cage.sharp_edges(vertex));
    if share < 1.0 {
        add(after, 1.0 - share, &mut ends_after.clone());
    }
}
