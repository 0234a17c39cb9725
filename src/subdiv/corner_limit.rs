//! The limit exactly at an extraordinary vertex: its point, and two tangents whose cross product is the normal.
//!
//! Smooth vertices: Halstead, Kass, DeRose, *Efficient, Fair Interpolation using Catmull-Clark Surfaces*, 1993
//! (Catmull-Clark); Hoppe et al. 1994 (Loop). Creases: Biermann, Levin, Zorin, *Piecewise Smooth Subdivision Surfaces
//! with Normal Control*, 2000, without their modified rules. Darts and corners have no closed form for every valence;
//! there the step's matrix is applied until it has converged. OpenSubdiv takes the smooth masks at darts, which is an
//! approximation; here they are the limit.

use std::f64::consts::{PI, TAU};

use super::crease::{Rule, is_semi_sharp};
use super::regular::{Span, full_span};
use super::ring::Ring;
use super::schemes::loop_scheme::neighbour_weight;
use super::step::{Shape, Step};

/// Weights over the vertices of a ring.
pub(super) type Row = Vec<f64>;

/// The limit at a corner.
#[derive(Debug, Clone)]
pub(super) struct CornerLimit {
    /// Sums to 1.
    pub(super) position: Row,
    /// Sum to 0; of no particular length. Towards the next and the previous corner of the face where these span the
    /// tangent plane, elsewhere along the crease and away from it.
    pub(super) tangents: [Row; 2],
}

impl CornerLimit {
    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        3 * size_of_val(self.position.as_slice())
    }
}

/// What OpenSubdiv takes a corner for at the level where it stops refining: masks over the ring at that level.
///
/// They are the limit on creases, and the limit's position at smooth vertices; the tangents there are those of its
/// Gregory patches. At darts they are the smooth masks, at corners the vertex and the edges as they are. All come
/// nearer to the limit with each level.
#[derive(Debug, Clone)]
pub(super) struct CornerMask {
    pub(super) limit: CornerLimit,
    /// Whether the tangents are derivatives at the scale of this level, and not directions only.
    pub(super) has_lengths: bool,
}

/// The masks at each corner of the ring's face where nothing decays any more and all faces are of the usual kind.
pub(super) fn corner_masks(ring: &Ring) -> Vec<Option<CornerMask>> {
    let topology = &ring.cage.topology;
    let sides = usual_sides(ring);
    (0..ring.sides())
        .map(|corner| {
            let vertex = topology.vertex(corner);
            let mut faces = topology.vertex_corners(vertex).iter();
            let usual = faces.all(|&c| topology.corners(topology.face(c)).len() == sides as usize);
            (usual && ring.sides() == sides && is_settled(ring, vertex))
                .then(|| corner_mask(ring, corner))
        })
        .collect()
}

fn corner_mask(ring: &Ring, corner: u32) -> CornerMask {
    let topology = &ring.cage.topology;
    let vertex = topology.vertex(corner);
    let span = Span::of(ring, corner);
    let alone = span.corners.len() == 1;
    let mut edges = topology.vertex_edges(vertex).iter();
    let on_border = edges.any(|&e| topology.is_border(e)) && topology.is_vertex_manifold(vertex);
    let form = match ring.cage.rule(vertex) {
        Rule::Smooth => full_span(ring, corner).and_then(|full| {
            let mut limit = smooth(ring, corner, &full)?;
            if !ring.cage.rules.triangles() {
                limit.tangents = gregory_tangents(ring, &full);
            }
            Some(limit)
        }),
        Rule::Crease if alone && on_border => None,
        Rule::Crease => crease(ring, corner, &span),
        Rule::Corner => None,
    };
    let has_lengths = form.is_none() && alone;
    let limit = form.unwrap_or_else(|| {
        let size = ring.vertices.len();
        let mut position = vec![0.0; size];
        position[vertex as usize] = 1.0;
        let tangents = [topology.next(corner), topology.previous(corner)].map(|end| {
            let mut row = vec![0.0; size];
            row[topology.vertex(end) as usize] += 1.0;
            row[vertex as usize] -= 1.0;
            row
        });
        CornerLimit { position, tangents }
    });
    CornerMask { limit, has_lengths }
}

/// The tangents of OpenSubdiv's Gregory patches at a smooth vertex of any valence: twice the mean over the faces at an
/// edge, instead of the eigenvector that [`catmull_clark_tangent`] takes. They are the same at valence 4.
fn gregory_tangents(ring: &Ring, span: &Span) -> [Row; 2] {
    let (ends, across) = (span.far_ends(ring), across(ring, span));
    let n = ends.len();
    let theta = TAU / n as f64;
    [0, 1].map(|first| {
        let mut row = vec![0.0; ring.vertices.len()];
        for i in 0..n {
            let (j, angle) = ((first + i) % n, i as f64 * theta);
            row[ends[j] as usize] += 4.0 * (1.0 + theta.cos()) * angle.cos();
            row[across[j] as usize] += angle.cos() + (angle + theta).cos();
        }
        row
    })
}

fn usual_sides(ring: &Ring) -> u32 {
    if ring.cage.rules.triangles() { 3 } else { 4 }
}

/// The limit at each corner of the ring's face that is an extraordinary vertex no longer changing its kind, if `step`,
/// of this number, repeats itself there.
pub(super) fn corner_limits(ring: &Ring, number: u32, step: &Step) -> Vec<Option<CornerLimit>> {
    if ring.sides() != usual_sides(ring) {
        return vec![None; ring.sides() as usize];
    }
    (0..ring.sides())
        .map(|corner| {
            let Shape::Split {
                step: child,
                ring: points,
            } = &step.children[corner as usize]
            else {
                return None;
            };
            (*child == number && is_settled(ring, ring.cage.topology.vertex(corner))).then(|| {
                let span = Span::of(ring, corner);
                let closed = match ring.cage.rule(ring.cage.topology.vertex(corner)) {
                    Rule::Smooth if span.closed => smooth(ring, corner, &span),
                    Rule::Crease => crease(ring, corner, &span),
                    _ => None,
                };
                closed.unwrap_or_else(|| iterate(ring, corner, step, points))
            })
        })
        .collect()
}

/// Whether nothing at the vertex decays any more.
fn is_settled(ring: &Ring, vertex: u32) -> bool {
    let edges = ring.cage.topology.vertex_edges(vertex);
    let mut edges = edges.iter().map(|&e| ring.cage.edge_sharpness[e as usize]);
    !is_semi_sharp(ring.cage.vertex_sharpness[vertex as usize]) && !edges.any(is_semi_sharp)
}

/// Vertices across the faces of a span; triangles have none, and name an edge's end.
fn across(ring: &Ring, span: &Span) -> Vec<u32> {
    let topology = &ring.cage.topology;
    let opposite = |&c: &u32| topology.vertex(topology.next(topology.next(c)));
    span.corners.iter().map(opposite).collect()
}

/// At a smooth vertex with this closed span.
fn smooth(ring: &Ring, corner: u32, span: &Span) -> Option<CornerLimit> {
    let (ends, across) = (span.far_ends(ring), across(ring, span));
    if ends.len() < 3 {
        return None;
    }
    let n = ends.len() as f64;
    let size = ring.vertices.len();
    let mut position = vec![0.0; size];
    let own = ring.cage.topology.vertex(corner) as usize;
    let tangent = if ring.cage.rules.triangles() {
        let weight = 1.0 / (n + 3.0 / (8.0 * neighbour_weight(ends.len())));
        position[own] = 1.0 - n * weight;
        for &end in &ends {
            position[end as usize] += weight;
        }
        loop_tangent
    } else {
        position[own] = n / (n + 5.0);
        for (&end, &across) in ends.iter().zip(&across) {
            position[end as usize] += 4.0 / (n * (n + 5.0));
            position[across as usize] += 1.0 / (n * (n + 5.0));
        }
        catmull_clark_tangent
    };
    let tangents = [0, 1].map(|first| tangent(size, &ends, &across, first));
    Some(CornerLimit { position, tangents })
}

/// On a crease with this span on the face's side.
fn crease(ring: &Ring, corner: u32, span: &Span) -> Option<CornerLimit> {
    let topology = &ring.cage.topology;
    let vertex = topology.vertex(corner);
    let (ends, across) = (span.far_ends(ring), across(ring, span));
    let size = ring.vertices.len();
    let mut position = vec![0.0; size];
    position[vertex as usize] = 2.0 / 3.0;
    for edge in ring.cage.sharp_edges(vertex) {
        position[topology.far_end(edge, vertex) as usize] += 1.0 / 6.0;
    }
    let mut along = vec![0.0; size];
    along[*ends.first()? as usize] += 0.5;
    along[*ends.last()? as usize] -= 0.5;
    let mut inwards = vec![0.0; size];
    if ring.cage.rules.triangles() {
        loop_inwards(vertex as usize, &ends, &mut inwards);
    } else {
        catmull_clark_inwards(vertex as usize, &ends, &across, &mut inwards);
    }
    Some(CornerLimit {
        position,
        tangents: [along, inwards],
    })
}

/// Towards the `first` of the edges around a smooth vertex.
fn catmull_clark_tangent(size: usize, ends: &[u32], across: &[u32], first: usize) -> Row {
    let n = ends.len();
    let theta = TAU / n as f64;
    let root = (2.0 * (9.0 + theta.cos())).sqrt();
    let lambda = 5.0 / 16.0 + (theta.cos() + (0.5 * theta).cos() * root) / 16.0;
    let mut row = vec![0.0; size];
    for i in 0..n {
        let (j, angle) = ((first + i) % n, i as f64 * theta);
        row[ends[j] as usize] += 4.0 * angle.cos();
        row[across[j] as usize] += (angle.cos() + (angle + theta).cos()) / (4.0 * lambda - 1.0);
    }
    row
}

fn loop_tangent(size: usize, ends: &[u32], _: &[u32], first: usize) -> Row {
    let n = ends.len();
    let mut row = vec![0.0; size];
    for i in 0..n {
        row[ends[(first + i) % n] as usize] += (TAU * i as f64 / n as f64).cos();
    }
    row
}

/// Away from a crease, across the faces between its two edges.
fn catmull_clark_inwards(vertex: usize, ends: &[u32], across: &[u32], row: &mut Row) {
    let k = across.len();
    let theta = PI / k as f64;
    if k == 1 {
        row[vertex] -= 6.0;
        row[ends[0] as usize] += 3.0;
        row[ends[1] as usize] += 3.0;
        return;
    }
    let r = (theta.cos() + 1.0) / theta.sin();
    row[vertex] += 4.0 * r * (theta.cos() - 1.0);
    for end in [ends[0], ends[k]] {
        row[end as usize] -= r * (1.0 + 2.0 * theta.cos());
    }
    for i in 0..k {
        let angle = i as f64 * theta;
        if i > 0 {
            row[ends[i] as usize] += 4.0 * angle.sin();
        }
        row[across[i] as usize] += angle.sin() + (angle + theta).sin();
    }
}

fn loop_inwards(vertex: usize, ends: &[u32], row: &mut Row) {
    let k = ends.len() - 1;
    let theta = PI / k as f64;
    match k {
        1 => {
            row[vertex] -= 2.0;
            row[ends[0] as usize] += 1.0;
            row[ends[1] as usize] += 1.0;
        }
        2 => {
            row[vertex] -= 1.0;
            row[ends[1] as usize] += 1.0;
        }
        _ => {
            for end in [ends[0], ends[k]] {
                row[end as usize] -= theta.sin();
            }
            for (i, &end) in ends.iter().enumerate().take(k).skip(1) {
                row[end as usize] += (2.0 - 2.0 * theta.cos()) * (i as f64 * theta).sin();
            }
        }
    }
    // What the neighbours' weights leave; 0 but for k = 3, where it is rounding.
    let sum: f64 = row.iter().sum();
    row[vertex] -= sum;
}

/// Steps until the limit no longer moves; each at least halves most of what is left.
const ITERATIONS: usize = 200;

/// The limit by repeating the step towards `corner`.
fn iterate(ring: &Ring, corner: u32, step: &Step, points: &[u32]) -> CornerLimit {
    let size = ring.vertices.len();
    let once = |row: &Row| -> Row {
        // A new point's weight falls back on what it was made of.
        let mut weights = vec![0.0; size + step.rows.len()];
        for (&point, &weight) in points.iter().zip(row) {
            weights[point as usize] += weight;
        }
        for i in (0..step.rows.len()).rev() {
            let weight = weights[size + i];
            for &(point, share) in step.rows.row(i) {
                weights[point as usize] += weight * share;
            }
        }
        weights.truncate(size);
        weights
    };
    let mut position = vec![0.0; size];
    let topology = &ring.cage.topology;
    let vertex = topology.vertex(corner) as usize;
    position[vertex] = 1.0;
    for _ in 0..ITERATIONS {
        position = once(&position);
    }
    let start = [topology.next(corner), topology.previous(corner)].map(|end| {
        let mut row = vec![0.0; size];
        row[topology.vertex(end) as usize] += 1.0;
        row[vertex] -= 1.0;
        row
    });
    let step = |row: &mut Row| {
        *row = once(row);
        // Rounding brings a bit of the position back, which would grow.
        let sum: f64 = row.iter().sum();
        add_multiple(row, -sum, &position);
    };
    let mut tangents = start.clone();
    for _ in 0..ITERATIONS {
        for row in &mut tangents {
            step(row);
            normalise(row);
        }
    }
    // Where one direction shrinks more slowly than all others both rows have become that one. The plane is still that
    // of the two slowest: what is left of the second row beside the first.
    if is_along(&tangents[1], &tangents[0]) {
        tangents = start;
        for _ in 0..ITERATIONS {
            let [first, second] = &mut tangents;
            step(first);
            normalise(first);
            step(second);
            let along = dot(second, first) / dot(first, first).max(f64::MIN_POSITIVE);
            add_multiple(second, -along, first);
            normalise(second);
        }
    }
    CornerLimit { position, tangents }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn add_multiple(row: &mut Row, factor: f64, other: &Row) {
    for (x, y) in row.iter_mut().zip(other) {
        *x += factor * y;
    }
}

/// To a largest weight of 1; what vanishes stays.
fn normalise(row: &mut Row) {
    let length = row.iter().fold(0.0, |m: f64, &w| m.max(w.abs()));
    if length > 0.0 {
        for weight in row {
            *weight /= length;
        }
    }
}

fn is_along(a: &Row, b: &Row) -> bool {
    let product = dot(a, b);
    product * product > (1.0 - 1e-9) * dot(a, a) * dot(b, b)
}
