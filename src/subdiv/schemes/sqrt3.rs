//! Leif Kobbelt, *√3-Subdivision*, 2000.
//!
//! A step puts a point into the centre of each triangle, connects it with the corners, and turns every old edge so
//! that it joins two new points; old points move towards the mean of their n neighbours by (4 - 2 cos(2π/n)) / 9. Two
//! steps divide each triangle into nine, and the scheme is as smooth as Loop's with half the growth of faces per step.
//!
//! At the border an edge cannot turn. There the first of two steps leaves the border alone, and the second one cuts
//! each of its edges into three with the ternary mask of cubic B-splines:
//!
//! ```text
//!          m               Even step at a border edge a-b; m is the centre that the odd step put in.
//!        / | \             p = (prev + 16 a + 10 b) / 27, q = (10 a + 16 b + next) / 27,
//!       /  |  \            a = (4 prev + 19 a + 4 b) / 27. Where the curve has a corner, the mirror image
//!      x  / \  y           of the next point stands for the previous one; the corner stays.
//!     /| /   \ |\          x, y are centres of the neighbours: the edges m-a and m-b turn to join p-x and q-y.
//!    a - p - q - b
//! ```
//!
//! In that step m misses its neighbour beyond a-b and takes the mirror image a + b - m for it.
//!
//! The smooth limit of a point is p + β (mean of its ring - p), β = 3α / (1 + 3α): the left eigenvector of the step
//! on p and the ring's mean. On the border it is the cubic B-spline's 1/6, 4/6, 1/6.
//!
//! Face-varying values are linear in each face of the control mesh: after an even step they are those of a split into
//! nine. After an odd one the triangles that reach over a seam continue one side by the parallelogram.

use super::classic::{Rules, Step, holes, numbers, points};
use super::sharp::{Kind, Sharp};
use crate::math::Vec3;
use crate::mesh::{BoundaryInterpolation, ControlMesh, Corner, Crease, Topology};
use crate::subdiv::stencils::Stencils;

/// The rules. Every second step needs to know what the first one did.
#[derive(Debug, Default)]
pub(super) struct Sqrt3 {
    odd: Option<Odd>,
}

/// What an odd step leaves for the even one.
#[derive(Debug)]
struct Odd {
    /// How many points there were; the rest are centres of the faces, in their order.
    points: u32,
    /// The parent of each face.
    parents: Vec<u32>,
    /// One child of each parent.
    children: Vec<u32>,
}

/// Where the mesh's points lie in the limit, by motion key: those inside on the smooth surface, those of the border on
/// its curve. It is the same for a control mesh and its refinements, but for odd levels' new points next to the border.
///
/// # Panics
/// If a face is not a triangle, or names a point twice.
pub fn limit(mesh: &ControlMesh) -> Vec<Vec<Vec3>> {
    assert!(
        mesh.face_vertex_counts.iter().all(|&n| n == 3),
        "√3 subdivision is of triangles"
    );
    let topology = mesh.topology();
    let sharp = Sharp::of(mesh, &topology);
    let mut stencils = Stencils::with_capacity(topology.vertex_count());
    for v in 0..topology.vertex_count() as u32 {
        match sharp.vertex(v) {
            Kind::Inner => {
                let triple = 3.0 * relaxation(topology.vertex_edges(v).len());
                let edges = topology.vertex_edges(v);
                stencils.add(v, 1.0 / (1.0 + triple));
                for &e in edges {
                    let share = triple / (1.0 + triple) / edges.len() as f64;
                    stencils.add(topology.far_end(e, v), share);
                }
            }
            Kind::Curve(ends) => on_curve(v, ends, 4.0 / 6.0, &mut stencils),
            Kind::Fixed => stencils.add(v, 1.0),
        }
        stencils.end_row();
    }
    mesh.points.iter().map(|p| points(&stencils, p)).collect()
}

impl Rules for Sqrt3 {
    fn step<'a>(&mut self, mesh: &'a ControlMesh, topology: &'a Topology) -> Step<'a> {
        let plan = Plan::of(mesh, topology, self.odd.take());
        let hole = holes(mesh);
        let parent_face: Vec<u32> = plan.triangles.iter().map(|t| t.parent).collect();
        if !plan.cuts_borders {
            let mut children = vec![0; topology.face_count()];
            for (i, &parent) in (0..).zip(&parent_face) {
                children[parent as usize] = i;
            }
            self.odd = Some(Odd {
                points: topology.vertex_count() as u32,
                parents: parent_face.clone(),
                children,
            });
        }
        Step {
            counts: vec![3; parent_face.len()],
            indices: plan.indices(),
            holes: numbers(parent_face.iter().map(|&f| hole[f as usize])),
            kept_corners: kept_corners(mesh, topology),
            points: plan.points(true),
            linear: plan.points(false),
            parent_face,
            corners: Box::new(move |seams| plan.corners(seams)),
        }
    }
}

/// The corners that stay: those tagged, and those that the border's rule finds. After a step they have more faces.
fn kept_corners(mesh: &ControlMesh, topology: &Topology) -> Vec<Corner> {
    let mut corners = mesh.corners.clone();
    if mesh.boundary == BoundaryInterpolation::EdgeAndCorner {
        let one_face = |&v: &u32| topology.vertex_corners(v).len() == 1;
        let vertices = (0..topology.vertex_count() as u32).filter(one_face);
        corners.extend(vertices.map(|vertex| Corner {
            vertex,
            sharpness: Crease::INFINITE,
        }));
    }
    corners
}

/// The weight with which a point moves to the mean of its `valence` neighbours, α.
fn relaxation(valence: usize) -> f64 {
    (4.0 - 2.0 * (std::f64::consts::TAU / valence as f64).cos()) / 9.0
}

fn on_curve(v: u32, ends: [u32; 2], weight: f64, stencils: &mut Stencils) {
    stencils.add(v, weight);
    for end in ends {
        stencils.add(end, (1.0 - weight) / 2.0);
    }
}

/// The triangles of one step.
struct Plan<'a> {
    topology: &'a Topology,
    sharp: Sharp,
    /// Whether border edges are cut into three.
    cuts_borders: bool,
    /// The first new point of each face, or of each border edge that is cut; `NONE` for those without.
    centres: Vec<u32>,
    cuts: Vec<u32>,
    triangles: Vec<Triangle>,
}

const NONE: u32 = u32::MAX;

/// A finer triangle.
struct Triangle {
    corners: [Place; 3],
    /// The coarser face that it counts to.
    parent: u32,
    /// The coarser face from which it takes face-varying values.
    chart: u32,
}

/// A corner of a finer triangle, named by corners of coarser ones.
#[derive(Clone, Copy)]
enum Place {
    /// The old point at a corner.
    Old(u32),
    /// The new point on the left of the edge that leaves a corner: its face's centre, or the nearest cut of the
    /// face's border edge.
    Apex(u32),
    /// A new point of the border.
    Cut(Cut),
}

/// Of the border edge that leaves a corner, the cut near its start or its end.
#[derive(Clone, Copy)]
struct Cut {
    corner: u32,
    near_end: bool,
}

impl<'a> Plan<'a> {
    fn of(mesh: &ControlMesh, topology: &'a Topology, odd: Option<Odd>) -> Self {
        let sharp = Sharp::of(mesh, topology);
        let cuts_borders = odd.is_some();
        let mut plan = Self {
            topology,
            sharp,
            cuts_borders,
            centres: vec![NONE; topology.face_count()],
            cuts: vec![NONE; topology.edge_count()],
            triangles: Vec::with_capacity(3 * topology.face_count()),
        };
        let mut points = topology.vertex_count() as u32;
        for f in 0..topology.face_count() as u32 {
            if plan.cut_corner(f).is_none() {
                plan.centres[f as usize] = points;
                points += 1;
            }
        }
        for e in 0..topology.edge_count() as u32 {
            if cuts_borders && plan.sharp.edge(e) {
                plan.cuts[e as usize] = points;
                points += 2;
            }
        }
        for edge in 0..topology.edge_count() as u32 {
            let corners = topology.edge_corners(edge);
            match corners {
                &[left, right] if !plan.sharp.edge(edge) => plan.turn(left, right, odd.as_ref()),
                _ => corners.iter().for_each(|&c| plan.keep(c)),
            }
        }
        plan
    }

    /// The corner whose edge on the border is cut in this step. After an odd step a face has one such edge at most.
    fn cut_corner(&self, face: u32) -> Option<u32> {
        let mut corners = self.topology.corners(face);
        corners.find(|&c| self.cuts_borders && self.sharp.edge(self.topology.edge(c)))
    }

    /// The two triangles at an inner edge, once it has turned.
    fn turn(&mut self, left: u32, right: u32, odd: Option<&Odd>) {
        let faces = [left, right].map(|c| self.topology.face(c));
        for (at, other, face) in [(left, right, faces[0]), (right, left, faces[1])] {
            let (mut parent, mut chart) = (face, face);
            if let Some(odd) = odd {
                // Which face of the level before the last it lies in is known by the centre at one of the edge's
                // ends.
                let [near, far] = [at, other].map(|c| self.topology.vertex(c));
                let centre = if near >= odd.points { near } else { far };
                if let Some(within) = centre.checked_sub(odd.points) {
                    parent = odd.children[within as usize];
                    let is_within = |&f: &u32| odd.parents[f as usize] == within;
                    chart = faces.into_iter().find(is_within).unwrap_or(face);
                }
            }
            self.triangles.push(Triangle {
                corners: [Place::Old(at), Place::Apex(other), Place::Apex(at)],
                parent,
                chart,
            });
        }
    }

    /// What remains at a border edge, for the face at one of its sides.
    fn keep(&mut self, corner: u32) {
        let t = self.topology;
        let face = t.face(corner);
        let corners = if self.cuts_borders {
            let [p, q] = [false, true].map(|near_end| Place::Cut(Cut { corner, near_end }));
            [p, q, Place::Old(t.previous(corner))]
        } else {
            let end = Place::Old(t.next(corner));
            [Place::Old(corner), end, Place::Apex(corner)]
        };
        self.triangles.push(Triangle {
            corners,
            parent: face,
            chart: face,
        });
    }

    /// The cut on the left of the edge that leaves a corner; none where a centre is.
    fn cut_beside(&self, corner: u32) -> Option<Cut> {
        let cut = self.cut_corner(self.topology.face(corner))?;
        Some(Cut {
            corner: cut,
            near_end: self.topology.next(corner) != cut,
        })
    }

    fn indices(&self) -> Vec<u32> {
        let t = self.topology;
        let cut_point = |cut: Cut| {
            let edge = t.edge(cut.corner);
            // Faces may run along the edge in either direction.
            let along = t.edge_vertices(edge)[0] == t.vertex(cut.corner);
            self.cuts[edge as usize] + u32::from(cut.near_end == along)
        };
        let places = self.triangles.iter().flat_map(|t| t.corners);
        places
            .map(|place| match place {
                Place::Old(corner) => t.vertex(corner),
                Place::Apex(corner) => (self.cut_beside(corner))
                    .map_or_else(|| self.centres[t.face(corner) as usize], cut_point),
                Place::Cut(cut) => cut_point(cut),
            })
            .collect()
    }

    /// The finer points from the coarser ones, smooth or linear.
    fn points(&self, smooth: bool) -> Stencils {
        let t = self.topology;
        let mut stencils = Stencils::with_capacity(t.vertex_count() + t.face_count());
        for v in 0..t.vertex_count() as u32 {
            match self.sharp.vertex(v) {
                Kind::Inner if smooth => self.relax(v, &mut stencils),
                Kind::Curve(ends) if smooth && self.cuts_borders => {
                    on_curve(v, ends, 19.0 / 27.0, &mut stencils);
                }
                _ => stencils.add(v, 1.0),
            }
            stencils.end_row();
        }
        for f in 0..t.face_count() as u32 {
            if self.centres[f as usize] != NONE {
                for &v in t.face_vertices(f) {
                    stencils.add(v, 1.0 / 3.0);
                }
                stencils.end_row();
            }
        }
        for e in 0..t.edge_count() as u32 {
            if self.cuts[e as usize] == NONE {
                continue;
            }
            let [a, b] = t.edge_vertices(e);
            for (near, far) in [(a, b), (b, a)] {
                if smooth {
                    stencils.add(near, 16.0 / 27.0);
                    stencils.add(far, 10.0 / 27.0);
                    for (point, weight) in self.sharp.before(near, far) {
                        stencils.add(point, weight / 27.0);
                    }
                } else {
                    stencils.add(near, 2.0 / 3.0);
                    stencils.add(far, 1.0 / 3.0);
                }
                stencils.end_row();
            }
        }
        stencils
    }

    /// Moves an inner point. A centre whose face has border edges has lost the neighbours beyond them: it takes their
    /// mirror images for the lost ones, so that a straight border leaves a regular lattice as it is.
    fn relax(&self, v: u32, stencils: &mut Stencils) {
        let t = self.topology;
        let faces_border = |&&c: &&u32| self.cut_corner(t.face(c)) == Some(t.next(c));
        let mirrored = t.vertex_corners(v).iter().filter(faces_border);
        let edges = t.vertex_edges(v);
        let valence = edges.len() + mirrored.clone().count();
        let weight = relaxation(valence);
        let each = weight / valence as f64;
        stencils.add(v, 1.0 - weight);
        for &e in edges {
            stencils.add(t.far_end(e, v), each);
        }
        for &c in mirrored {
            stencils.add(t.vertex(t.next(c)), each);
            stencils.add(t.vertex(t.previous(c)), each);
            stencils.add(v, -each);
        }
    }

    /// The finer corners from the coarser ones.
    fn corners(&self, seams: &[bool]) -> Stencils {
        let mut stencils = Stencils::with_capacity(3 * self.triangles.len());
        for triangle in &self.triangles {
            for place in triangle.corners {
                self.corner(place, triangle.chart, seams, &mut stencils);
                stencils.end_row();
            }
        }
        stencils
    }

    /// The value at a place as seen from the face `chart`: by the parallelogram if the place is beyond a seam.
    fn corner(&self, place: Place, chart: u32, seams: &[bool], stencils: &mut Stencils) {
        let t = self.topology;
        match place {
            Place::Apex(c) if t.face(c) != chart && seams[t.edge(c) as usize] => {
                let own = self.across(c);
                stencils.add(own, 1.0);
                stencils.add(t.next(own), 1.0);
                self.add_apex(own, -1.0, stencils);
            }
            Place::Apex(c) => self.add_apex(c, 1.0, stencils),
            Place::Old(c) if t.face(c) != chart => stencils.add(t.next(self.across(c)), 1.0),
            Place::Old(c) => stencils.add(c, 1.0),
            Place::Cut(cut) => self.add_cut(cut, 1.0, stencils),
        }
    }

    /// The corner from which the other face runs along an inner edge.
    fn across(&self, corner: u32) -> u32 {
        let corners = self.topology.edge_corners(self.topology.edge(corner));
        let other = corners.iter().copied().find(|&c| c != corner);
        other.expect("an inner edge has two faces")
    }

    fn add_apex(&self, corner: u32, weight: f64, stencils: &mut Stencils) {
        if let Some(cut) = self.cut_beside(corner) {
            self.add_cut(cut, weight, stencils);
            return;
        }
        for c in self.topology.corners(self.topology.face(corner)) {
            stencils.add(c, weight / 3.0);
        }
    }

    fn add_cut(&self, cut: Cut, weight: f64, stencils: &mut Stencils) {
        let [start, end] = if cut.near_end { [1.0, 2.0] } else { [2.0, 1.0] };
        stencils.add(cut.corner, weight * start / 3.0);
        stencils.add(self.topology.next(cut.corner), weight * end / 3.0);
    }
}
