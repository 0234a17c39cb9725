//! Daniel Doo, Malcolm Sabin, *Behaviour of Recursive Division Surfaces near Extraordinary Points*, 1978.
//!
//! A step gives each corner of each face a point of its own, a weighted sum over that face, and connects these points
//! with three kinds of faces: one inside each old face, one across each edge, one around each vertex. After one step
//! every vertex has four faces, and faces with other than four corners are apart from one another. On regular parts
//! the limit is a uniform biquadratic B-spline; [`super::doo_sabin_limit`] evaluates it.
//!
//! Weights of the i-th corner of n, counted from the point's own: (n + 5) / 4n for i = 0, (3 + 2 cos(2πi/n)) / 4n for
//! the others. With them the polygon's first harmonic shrinks by 1/2 in each step and all others by 1/4.
//!
//! The paper leaves the border to shrink, and so does [`BoundaryInterpolation::None`]. Otherwise the border is a curve
//! of its own, the quadratic B-spline of the border's polygon (Chaikin's), and the surface ends there:
//!
//! ```text
//!      :       q0 --- q1  :        q0, q1  points of the face at the border edge v0-v1
//!      :       |  E   |   :        b0 = 3/4 v0 + 1/4 v1,  b1 = 1/4 v0 + 3/4 v1
//!    --+-------b0 --- b1--+--      E is the face of the border edge. The face of a border vertex joins the
//!      v0                 v1       points of its faces and the two border points next to it.
//! ```
//!
//! Across the border that is the B-spline with mirrored phantom points: it is linear in the first half of a face.
//! Under [`BoundaryInterpolation::EdgeAndCorner`] a vertex with one face stays as a corner of its vertex' face.
//! A vertex inside with two faces gets no face of its own; the faces of its two edges share an edge instead.
//!
//! Holes: a face of the control mesh that is a hole leaves out just its own part of the limit surface, whose border
//! lies half-way between points. At each level those faces are holes all of whose points belong to it.

use std::f64::consts::TAU;

use super::classic::{Rules, Step, holes, numbers};
use crate::mesh::{BoundaryInterpolation, ControlMesh, Topology};
use crate::subdiv::stencils::Stencils;

/// The rules.
#[derive(Debug, Default)]
pub(super) struct DooSabin {
    /// From the second step on: which points belong to holes of the control mesh.
    hole_points: Option<Vec<bool>>,
}

impl Rules for DooSabin {
    fn step<'a>(&mut self, mesh: &'a ControlMesh, topology: &'a Topology) -> Step<'a> {
        let plan = Plan::of(mesh, topology);
        let hole_corners: Vec<bool> = if let Some(points) = &self.hole_points {
            let corners = 0..topology.corner_count() as u32;
            corners
                .map(|c| points[topology.vertex(c) as usize])
                .collect()
        } else {
            let hole = holes(mesh);
            let corners = 0..topology.corner_count() as u32;
            corners.map(|c| hole[topology.face(c) as usize]).collect()
        };
        let hole_points = plan.hole_points(&hole_corners);
        let mut counts = Vec::new();
        let mut indices = Vec::new();
        let mut parent_face = Vec::new();
        let mut hole = Vec::new();
        plan.faces(|_, corners, parent| {
            let points = corners.iter().map(|&place| plan.number(place));
            counts.push(corners.len() as u32);
            indices.extend(points.clone());
            parent_face.push(topology.face(parent));
            hole.push(points.into_iter().all(|p| hole_points[p as usize]));
        });
        self.hole_points = Some(hole_points);
        Step {
            counts,
            indices,
            parent_face,
            holes: numbers(hole.into_iter()),
            kept_corners: Vec::new(),
            points: plan.points(true),
            linear: plan.points(false),
            corners: Box::new(move |seams| plan.corners(seams)),
        }
    }
}

/// Weight of corner `i` of `n`, counted from the point's own.
pub(super) fn weight(i: usize, n: usize) -> f64 {
    let own = if i == 0 { 0.25 } else { 0.0 };
    own + (3.0 + 2.0 * (TAU * i as f64 / n as f64).cos()) / (4 * n) as f64
}

/// The same for the mean of the corner, the middles of its edges and the face's: linear, and equal if `n` is 4.
fn linear_weight(i: usize, n: usize) -> f64 {
    let near = match i {
        0 => 0.5,
        _ if i == 1 || i == n - 1 => 0.125,
        _ => 0.0,
    };
    near + 1.0 / (4 * n) as f64
}

/// The faces around a vertex from which one comes to the other across plain edges, counterclockwise.
#[derive(Debug)]
pub(super) struct Fan {
    /// Their corners at the vertex; the first one's edge is a border if the fan is open.
    pub(super) corners: Vec<u32>,
    /// Whether the last face is the first one's neighbour.
    pub(super) closed: bool,
}

/// The fans of all vertices: one at each vertex of a plain mesh, none where no face is, more where fans touch.
pub(super) fn fans(topology: &Topology) -> Vec<Fan> {
    let mut fans = Vec::new();
    let mut met = vec![false; topology.corner_count()];
    for v in 0..topology.vertex_count() as u32 {
        let corners = topology.vertex_corners(v);
        let open = |c: &&u32| topology.turn_right(**c).is_none();
        for &first in corners.iter().filter(open).chain(corners) {
            if std::mem::replace(&mut met[first as usize], true) {
                continue;
            }
            let mut fan = Fan {
                corners: vec![first],
                closed: false,
            };
            let mut at = first;
            while let Some(left) = topology.turn_left(at) {
                if left == first {
                    fan.closed = true;
                    break;
                }
                met[left as usize] = true;
                fan.corners.push(left);
                at = left;
            }
            fans.push(fan);
        }
    }
    fans
}

/// A finer point, named by what it comes from.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// The point of a corner.
    Corner(u32),
    /// On the border edge that leaves the corner, the point near its start.
    Start(u32),
    /// The one near its end.
    End(u32),
    /// The vertex at the corner, kept.
    Kept(u32),
}

/// What a finer face is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum For {
    Face,
    Edge,
    Vertex,
}

/// The numbering of one step. Points of corners come first, in their order; then two for each border edge, kept
/// vertices, and points that no face uses.
struct Plan<'a> {
    topology: &'a Topology,
    fans: Vec<Fan>,
    /// Where a border edge's points start; `NONE` for other edges, and if the border is left to shrink.
    borders: Vec<u32>,
    /// Where a vertex that stays is, `NONE` for others.
    kept: Vec<u32>,
    point_count: u32,
}

const NONE: u32 = u32::MAX;

impl<'a> Plan<'a> {
    fn of(mesh: &ControlMesh, topology: &'a Topology) -> Self {
        let mut plan = Self {
            topology,
            fans: fans(topology),
            borders: vec![NONE; topology.edge_count()],
            kept: vec![NONE; topology.vertex_count()],
            point_count: topology.corner_count() as u32,
        };
        if mesh.boundary != BoundaryInterpolation::None {
            for e in 0..topology.edge_count() as u32 {
                if topology.is_border(e) || !topology.is_edge_manifold(e) {
                    plan.borders[e as usize] = plan.point_count;
                    plan.point_count += 2;
                }
            }
        }
        if mesh.boundary == BoundaryInterpolation::EdgeAndCorner {
            for fan in plan.fans.iter().filter(|f| f.corners.len() == 1) {
                keep(
                    &mut plan.kept,
                    topology.vertex(fan.corners[0]),
                    &mut plan.point_count,
                );
            }
        }
        for v in 0..topology.vertex_count() as u32 {
            if topology.vertex_corners(v).is_empty() {
                keep(&mut plan.kept, v, &mut plan.point_count);
            }
        }
        plan
    }

    fn number(&self, place: Place) -> u32 {
        let t = self.topology;
        match place {
            Place::Corner(c) => c,
            Place::Start(c) | Place::End(c) => {
                let edge = t.edge(c);
                // Faces may run along the edge in either direction.
                let along = t.edge_vertices(edge)[0] == t.vertex(c);
                let at_end = matches!(place, Place::End(_));
                self.borders[edge as usize] + u32::from(at_end == along)
            }
            Place::Kept(c) => self.kept[t.vertex(c) as usize],
        }
    }

    /// Hands out the finer faces with a corner of the face that each counts to: those of faces, edges, vertices.
    fn faces(&self, mut face: impl FnMut(For, &[Place], u32)) {
        let t = self.topology;
        let mut places = Vec::new();
        for f in 0..t.face_count() as u32 {
            places.clear();
            places.extend(t.corners(f).map(Place::Corner));
            face(For::Face, &places, t.corners(f).start);
        }
        for e in 0..t.edge_count() as u32 {
            match *t.edge_corners(e) {
                [a, b] if t.is_edge_manifold(e) => {
                    face(
                        For::Edge,
                        &[t.next(b), b, t.next(a), a].map(Place::Corner),
                        a,
                    );
                }
                _ if self.borders[e as usize] == NONE => {}
                ref corners => {
                    for &c in corners {
                        let (near, far) = (Place::Corner(c), Place::Corner(t.next(c)));
                        face(For::Edge, &[Place::Start(c), Place::End(c), far, near], c);
                    }
                }
            }
        }
        for fan in &self.fans {
            let (first, last) = (fan.corners[0], fan.corners[fan.corners.len() - 1]);
            places.clear();
            places.extend(fan.corners.iter().copied().map(Place::Corner));
            if !fan.closed {
                if self.borders[t.edge(first) as usize] == NONE {
                    continue;
                }
                places.push(Place::End(t.previous(last)));
                if fan.corners.len() == 1 && self.kept[t.vertex(first) as usize] != NONE {
                    places.push(Place::Kept(first));
                }
                places.push(Place::Start(first));
            }
            if places.len() > 2 {
                face(For::Vertex, &places, first);
            }
        }
    }

    fn hole_points(&self, hole_corners: &[bool]) -> Vec<bool> {
        let t = self.topology;
        let mut hole = hole_corners.to_vec();
        hole.resize(self.point_count as usize, false);
        for (e, &first) in (0..).zip(&self.borders) {
            if first == NONE {
                continue;
            }
            for (i, v) in (first..).zip(t.edge_vertices(e)) {
                let at_end = |&c: &u32| if t.vertex(c) == v { c } else { t.next(c) };
                let mut corners = t.edge_corners(e).iter().map(at_end);
                hole[i as usize] = corners.all(|c| hole_corners[c as usize]);
            }
        }
        for (v, &kept) in (0..).zip(&self.kept) {
            let corners = t.vertex_corners(v);
            if kept != NONE && !corners.is_empty() {
                hole[kept as usize] = corners.iter().all(|&c| hole_corners[c as usize]);
            }
        }
        hole
    }

    /// The finer points from the coarser ones, smooth or linear.
    fn points(&self, smooth: bool) -> Stencils {
        let t = self.topology;
        let mask = if smooth { weight } else { linear_weight };
        let mut stencils = Stencils::with_capacity(self.point_count as usize);
        for c in 0..t.corner_count() as u32 {
            self.mask(c, mask, |c, w| stencils.add(t.vertex(c), w));
            stencils.end_row();
        }
        for e in (0..t.edge_count() as u32).filter(|&e| self.borders[e as usize] != NONE) {
            let [a, b] = t.edge_vertices(e);
            for (near, far) in [(a, b), (b, a)] {
                stencils.add(near, 0.75);
                stencils.add(far, 0.25);
                stencils.end_row();
            }
        }
        // Kept vertices were numbered in two sweeps.
        let mut kept: Vec<(u32, u32)> = (self.kept.iter().copied().zip(0..))
            .filter(|k| k.0 != NONE)
            .collect();
        kept.sort_unstable();
        for (_, v) in kept {
            stencils.add(v, 1.0);
            stencils.end_row();
        }
        stencils
    }

    /// The mask of a corner, over the corners of its face.
    fn mask(&self, corner: u32, mask: fn(usize, usize) -> f64, mut add: impl FnMut(u32, f64)) {
        let t = self.topology;
        let n = t.corners(t.face(corner)).len();
        let mut at = corner;
        for i in 0..n {
            add(at, mask(i, n));
            at = t.next(at);
        }
    }

    /// The finer corners from the coarser ones. Seams are borders: beyond one, a face across an edge takes the
    /// border's points as seen from the face that it counts to, a face around a vertex the vertex itself.
    fn corners(&self, seams: &[bool]) -> Stencils {
        let t = self.topology;
        let mut stencils = Stencils::with_capacity(self.point_count as usize);
        self.faces(|kind, places, parent| {
            for &place in places {
                match place {
                    Place::Corner(c) if kind == For::Edge && self.is_beyond(parent, c, seams) => {
                        let (near, far) = (parent, t.next(parent));
                        if t.vertex(c) == t.vertex(near) {
                            cut(near, far, &mut stencils);
                        } else {
                            cut(far, near, &mut stencils);
                        }
                    }
                    Place::Corner(c) if kind == For::Vertex && !self.sees(parent, c, seams) => {
                        stencils.add(parent, 1.0);
                    }
                    Place::End(c)
                        if kind == For::Vertex && !self.sees(parent, t.next(c), seams) =>
                    {
                        stencils.add(parent, 1.0);
                    }
                    Place::Corner(c) => self.mask(c, linear_weight, |c, w| stencils.add(c, w)),
                    Place::Start(c) => cut(c, t.next(c), &mut stencils),
                    Place::End(c) => cut(t.next(c), c, &mut stencils),
                    Place::Kept(c) => stencils.add(c, 1.0),
                }
                stencils.end_row();
            }
        });
        stencils
    }

    /// Whether `corner` lies beyond a seam along the edge that leaves `parent`.
    fn is_beyond(&self, parent: u32, corner: u32, seams: &[bool]) -> bool {
        let t = self.topology;
        seams[t.edge(parent) as usize] && t.face(corner) != t.face(parent)
    }

    /// Whether one comes from a corner to another one at the same vertex without crossing a seam.
    fn sees(&self, from: u32, to: u32, seams: &[bool]) -> bool {
        let t = self.topology;
        let left = |c: u32| (t.edge(t.previous(c)), t.turn_left(c));
        let right = |c: u32| (t.edge(c), t.turn_right(c));
        let reaches = |turn: &dyn Fn(u32) -> (u32, Option<u32>)| {
            let mut at = from;
            while at != to {
                match turn(at) {
                    (edge, Some(next)) if !seams[edge as usize] && next != from => at = next,
                    _ => return false,
                }
            }
            true
        };
        reaches(&left) || reaches(&right)
    }
}

/// The point of the border near one end of an edge.
fn cut(near: u32, far: u32, stencils: &mut Stencils) {
    stencils.add(near, 0.75);
    stencils.add(far, 0.25);
}

/// Gives `vertex` the next number, unless it has one.
fn keep(kept: &mut [u32], vertex: u32, next: &mut u32) {
    if kept[vertex as usize] == NONE {
        kept[vertex as usize] = *next;
        *next += 1;
    }
}
