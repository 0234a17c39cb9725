//! A second evaluator to check the first: every mesh is refined as a whole, in double precision, by plain code that
//! shares nothing with the library; then the masks of the papers give the limit at its vertices.
//!
//! It knows faces as lists of vertices and finds neighbours by looking. Rules: Catmull and Clark 1978, Loop 1987,
//! DeRose, Kass, Truong 1998 with OpenSubdiv's blending; limit masks: Halstead et al. 1993, Hoppe et al. 1994.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use crate::math::DVec3;
use crate::mesh::{BoundaryInterpolation, ControlMesh, CreaseMethod, Scheme, TriangleRule};

const INFINITE: f64 = 10.0;

/// A corner of a face: its vertex, and where it is on its Ptex face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub(super) vertex: usize,
    pub(super) ptex: u32,
    pub(super) uv: [f64; 2],
}

/// A face: its corners, and whether it is part of the surface.
#[derive(Debug, Clone)]
pub(super) struct Face {
    pub(super) corners: Vec<Corner>,
    pub(super) hole: bool,
    /// Whether it is several Ptex faces.
    whole: bool,
}

impl Face {
    fn vertices(&self) -> impl Iterator<Item = usize> + '_ {
        self.corners.iter().map(|c| c.vertex)
    }

    fn place(&self, vertex: usize) -> Option<usize> {
        self.vertices().position(|v| v == vertex)
    }

    /// Before and after the corner at `place`.
    fn around(&self, place: usize) -> [usize; 2] {
        let n = self.corners.len();
        [
            self.corners[(place + n - 1) % n].vertex,
            self.corners[(place + 1) % n].vertex,
        ]
    }
}

type Edge = (usize, usize);

fn edge(a: usize, b: usize) -> Edge {
    (a.min(b), a.max(b))
}

/// A mesh at one level.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub(super) points: Vec<DVec3>,
    pub(super) faces: Vec<Face>,
    /// Of the edges that are sharp.
    edge_sharpness: BTreeMap<Edge, f64>,
    vertex_sharpness: Vec<f64>,
    scheme: Scheme,
    chaikin: bool,
    smooth_triangles: bool,
}

/// Who meets whom.
struct Incidence {
    edge_faces: BTreeMap<Edge, Vec<usize>>,
    vertex_faces: Vec<Vec<usize>>,
    vertex_edges: Vec<Vec<Edge>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Smooth,
    Dart,
    Crease,
    Corner,
}

impl Level {
    /// A mesh without edges of more than two faces.
    pub(super) fn of(mesh: &ControlMesh) -> Self {
        let mut ptex = 0;
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let mut faces = Vec::new();
        for (number, range) in mesh.faces().enumerate() {
            let vertices = &mesh.face_vertex_indices[range];
            let n = vertices.len();
            let whole = mesh.scheme != Scheme::Loop && n != 4;
            let corners = (0..n).map(|i| Corner {
                vertex: vertices[i] as usize,
                ptex: ptex + if whole { i as u32 } else { 0 },
                uv: match (whole, mesh.scheme) {
                    (true, _) => [0.0, 0.0],
                    (_, Scheme::Loop) => triangle[i],
                    _ => square[i],
                },
            });
            faces.push(Face {
                corners: corners.collect(),
                hole: mesh.holes.contains(&(number as u32)),
                whole,
            });
            ptex += if whole { n as u32 } else { 1 };
        }
        let mut level = Self {
            points: mesh.points[0].iter().map(|p| p.as_dvec3()).collect(),
            faces,
            edge_sharpness: BTreeMap::new(),
            vertex_sharpness: vec![0.0; mesh.point_count()],
            scheme: mesh.scheme,
            chaikin: mesh.crease_method == CreaseMethod::Chaikin,
            smooth_triangles: mesh.triangle_rule == TriangleRule::Smooth,
        };
        let meets = level.incidence();
        for crease in &mesh.creases {
            let [a, b] = crease.vertices.map(|v| v as usize);
            if meets.edge_faces.contains_key(&edge(a, b)) {
                let sharpness = f64::from(crease.sharpness).min(INFINITE);
                level.edge_sharpness.insert(edge(a, b), sharpness);
            }
        }
        for corner in &mesh.corners {
            let sharpness = f64::from(corner.sharpness).min(INFINITE);
            level.vertex_sharpness[corner.vertex as usize] = sharpness;
        }
        let border = |e: &Edge| meets.edge_faces[e].len() == 1;
        for v in 0..level.points.len() {
            let loose = |e: &&Edge| border(e) && level.sharpness(**e) < INFINITE;
            if mesh.boundary == BoundaryInterpolation::None
                && level.scheme != Scheme::Bilinear
                && meets.vertex_edges[v].iter().any(|e| loose(&e))
            {
                for &face in &meets.vertex_faces[v] {
                    level.faces[face].hole = true;
                }
            }
        }
        for e in meets.edge_faces.keys().filter(|e| border(e)) {
            level.edge_sharpness.insert(*e, INFINITE);
        }
        for v in 0..level.points.len() {
            let lone = meets.vertex_faces[v].len() == 1
                && mesh.boundary == BoundaryInterpolation::EdgeAndCorner;
            if lone || meets.fans(&level, v) > 1 {
                level.vertex_sharpness[v] = INFINITE;
            }
        }
        level
    }

    /// Refined once more. Vertices keep their numbers.
    pub(super) fn refined(&self) -> Self {
        let meets = self.incidence();
        let face_point = |f: usize| {
            let face = &self.faces[f];
            let sum: DVec3 = face.vertices().map(|v| self.points[v]).sum();
            sum / face.corners.len() as f64
        };
        let mut points: Vec<DVec3> = (0..self.points.len())
            .map(|v| self.vertex_point(&meets, v, &face_point))
            .collect();
        let mut edge_number = BTreeMap::new();
        for (&e, faces) in &meets.edge_faces {
            edge_number.insert(e, points.len());
            points.push(self.edge_point(&meets, e, faces, &face_point));
        }
        let face_number = points.len();
        if self.scheme != Scheme::Loop {
            points.extend((0..self.faces.len()).map(face_point));
        }
        let mut edge_sharpness = BTreeMap::new();
        for (&e, &middle) in &edge_number {
            for end in [e.0, e.1] {
                let sharpness = self.child_sharpness(&meets, e, end);
                if sharpness > 0.0 {
                    edge_sharpness.insert(edge(end, middle), sharpness);
                }
            }
        }
        let mut vertex_sharpness: Vec<f64> =
            self.vertex_sharpness.iter().map(|&s| decayed(s)).collect();
        vertex_sharpness.resize(points.len(), 0.0);
        let mut faces = Vec::new();
        for (f, face) in self.faces.iter().enumerate() {
            let n = face.corners.len();
            let middle = |i: usize| {
                let [a, b] = [face.corners[i % n], face.corners[(i + 1) % n]];
                Corner {
                    vertex: edge_number[&edge(a.vertex, b.vertex)],
                    ptex: a.ptex,
                    uv: mean(&[a.uv, b.uv]),
                }
            };
            let mut add = |corners: Vec<Corner>| {
                faces.push(Face {
                    corners,
                    hole: face.hole,
                    whole: false,
                });
            };
            if self.scheme == Scheme::Loop {
                for i in 0..3 {
                    add(vec![face.corners[i], middle(i), middle(i + 2)]);
                }
                add(vec![middle(0), middle(1), middle(2)]);
                continue;
            }
            let uvs: Vec<[f64; 2]> = face.corners.iter().map(|c| c.uv).collect();
            for i in 0..n {
                let own = face.corners[i];
                let centre = Corner {
                    vertex: face_number + f,
                    ptex: own.ptex,
                    uv: mean(&uvs),
                };
                let mut corners = vec![own, middle(i), centre, middle(i + n - 1)];
                if face.whole {
                    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
                    for (corner, uv) in corners.iter_mut().zip(square) {
                        (corner.ptex, corner.uv) = (own.ptex, uv);
                    }
                }
                add(corners);
            }
        }
        Self {
            points,
            faces,
            edge_sharpness,
            vertex_sharpness,
            ..*self
        }
    }

    /// The limit at a vertex by refining the faces around it alone, again and again: for darts, which have no mask.
    pub(super) fn limit_by_refinement(&self, v: usize) -> DVec3 {
        let (mut level, mut v) = self.around(v);
        for _ in 0..80 {
            (level, v) = level.refined().around(v);
        }
        level.points[v]
    }

    /// The faces at a vertex, and its number among their vertices.
    fn around(&self, v: usize) -> (Self, usize) {
        let mut faces: Vec<Face> = self.faces.clone();
        faces.retain(|f| f.place(v).is_some());
        let mut numbers = BTreeMap::new();
        let mut old = Vec::new();
        for corner in faces.iter_mut().flat_map(|f| &mut f.corners) {
            let number = *numbers.entry(corner.vertex).or_insert(old.len());
            if number == old.len() {
                old.push(corner.vertex);
            }
            corner.vertex = number;
        }
        let sharp = self
            .edge_sharpness
            .iter()
            .filter_map(|(e, &s)| Some((edge(*numbers.get(&e.0)?, *numbers.get(&e.1)?), s)));
        let level = Self {
            points: old.iter().map(|&o| self.points[o]).collect(),
            edge_sharpness: sharp.collect(),
            vertex_sharpness: old.iter().map(|&o| self.vertex_sharpness[o]).collect(),
            faces,
            ..*self
        };
        (level, numbers[&v])
    }

    /// The limit at a vertex where no sharpness decays any more and that is no dart.
    pub(super) fn limit(&self, meets: &Neighbours, v: usize) -> DVec3 {
        let own = self.points[v];
        let ring = &meets.0.vertex_edges[v];
        let far = |e: &Edge| self.points[if e.0 == v { e.1 } else { e.0 }];
        if self.scheme == Scheme::Bilinear {
            return own;
        }
        match self.kind(&meets.0, v) {
            Kind::Corner => own,
            Kind::Crease => {
                let ends = ring.iter().filter(|e| self.sharpness(**e) > 0.0);
                2.0 / 3.0 * own + ends.map(far).sum::<DVec3>() / 6.0
            }
            _ if self.scheme == Scheme::Loop => {
                let n = ring.len() as f64;
                let weight = 1.0 / (3.0 / (8.0 * loop_beta(ring.len())) + n);
                (1.0 - n * weight) * own + weight * ring.iter().map(far).sum::<DVec3>()
            }
            _ => {
                let n = ring.len() as f64;
                let across: DVec3 = meets.0.vertex_faces[v]
                    .iter()
                    .map(|&f| {
                        let face = &self.faces[f];
                        let at = face.place(v).expect("a face at the vertex");
                        self.points[face.corners[(at + 2) % 4].vertex]
                    })
                    .sum();
                (n * n * own + 4.0 * ring.iter().map(far).sum::<DVec3>() + across) / (n * (n + 5.0))
            }
        }
    }

    /// The unit normal in the limit at a smooth vertex, if that has three neighbours and more.
    pub(super) fn normal(&self, meets: &Neighbours, v: usize) -> Option<DVec3> {
        let (edges, across) = self.walk(&meets.0, v);
        let n = edges.len();
        if n < 3 {
            return None;
        }
        let angle = |i: f64| (TAU * i / n as f64).cos();
        let edge_weight = {
            let c = (TAU / n as f64).cos();
            1.0 + c + (PI / n as f64).cos() * (2.0 * (9.0 + c)).sqrt()
        };
        let tangent = |turn: f64| -> DVec3 {
            (0..n)
                .map(|i| {
                    let i_ = i as f64 - turn;
                    match self.scheme {
                        Scheme::Loop => angle(i_) * self.points[edges[i]],
                        _ => {
                            edge_weight * angle(i_) * self.points[edges[i]]
                                + (angle(i_) + angle(i_ + 1.0)) * self.points[across[i]]
                        }
                    }
                })
                .sum()
        };
        tangent(0.0).cross(tangent(1.0)).try_normalize()
    }

    pub(super) fn kind_of(&self, meets: &Neighbours, v: usize) -> Kind {
        self.kind(&meets.0, v)
    }

    /// Whether sharpness still decays somewhere.
    pub(super) fn decays(&self) -> bool {
        let mut all = self.edge_sharpness.values().chain(&self.vertex_sharpness);
        all.any(|&s| s > 0.0 && s < INFINITE)
    }

    pub(super) fn neighbours(&self) -> Neighbours {
        Neighbours(self.incidence())
    }

    /// The neighbours of an inner vertex and the vertices across its faces, counterclockwise.
    fn walk(&self, meets: &Incidence, v: usize) -> (Vec<usize>, Vec<usize>) {
        let (mut edges, mut across) = (Vec::new(), Vec::new());
        let mut at = meets.vertex_faces[v][0];
        for _ in 0..meets.vertex_faces[v].len() {
            let face = &self.faces[at];
            let place = face.place(v).expect("a face at the vertex");
            let [before, after] = face.around(place);
            edges.push(after);
            across.push(face.corners[(place + 2) % face.corners.len()].vertex);
            at = *meets.edge_faces[&edge(v, before)]
                .iter()
                .find(|&&f| f != at)
                .expect("an inner vertex");
        }
        (edges, across)
    }

    fn incidence(&self) -> Incidence {
        let mut edge_faces: BTreeMap<Edge, Vec<usize>> = BTreeMap::new();
        let mut vertex_faces = vec![Vec::new(); self.points.len()];
        let mut vertex_edges = vec![Vec::new(); self.points.len()];
        for (f, face) in self.faces.iter().enumerate() {
            for (i, v) in face.vertices().enumerate() {
                vertex_faces[v].push(f);
                edge_faces
                    .entry(edge(v, face.around(i)[1]))
                    .or_default()
                    .push(f);
            }
        }
        for &e in edge_faces.keys() {
            vertex_edges[e.0].push(e);
            vertex_edges[e.1].push(e);
        }
        Incidence {
            edge_faces,
            vertex_faces,
            vertex_edges,
        }
    }

    fn sharpness(&self, e: Edge) -> f64 {
        self.edge_sharpness.get(&e).copied().unwrap_or(0.0)
    }

    fn kind(&self, meets: &Incidence, v: usize) -> Kind {
        let edges = meets.vertex_edges[v].iter().map(|&e| self.sharpness(e));
        kind(self.vertex_sharpness[v], edges)
    }

    fn child_sharpness(&self, meets: &Incidence, e: Edge, end: usize) -> f64 {
        let own = self.sharpness(e);
        if self.chaikin && own > 0.0 && own < INFINITE {
            let others = meets.vertex_edges[end].iter().filter(|&&o| o != e);
            let others: Vec<f64> = others
                .map(|&o| self.sharpness(o))
                .filter(|&s| s > 0.0 && s < INFINITE)
                .collect();
            if !others.is_empty() {
                let mean = others.iter().sum::<f64>() / others.len() as f64;
                return single(0.75 * own + 0.25 * mean - 1.0);
            }
        }
        decayed(own)
    }

    fn edge_point(
        &self,
        meets: &Incidence,
        e: Edge,
        faces: &[usize],
        face_point: &dyn Fn(usize) -> DVec3,
    ) -> DVec3 {
        let ends = self.points[e.0] + self.points[e.1];
        let sharpness = self.sharpness(e);
        let stays = [e.0, e.1]
            .iter()
            .all(|&end| self.child_sharpness(meets, e, end) > 0.0);
        if self.scheme == Scheme::Bilinear || sharpness >= 1.0 || (sharpness > 0.0 && stays) {
            return 0.5 * ends;
        }
        let smooth = if self.scheme == Scheme::Loop {
            let opposite = faces.iter().map(|&f| {
                let mut vertices = self.faces[f].vertices();
                self.points[vertices
                    .find(|&v| v != e.0 && v != e.1)
                    .expect("a triangle")]
            });
            0.375 * ends + 0.125 * opposite.sum::<DVec3>()
        } else {
            let weight = |f: &usize| match self.faces[*f].corners.len() {
                3 if self.smooth_triangles => 0.47,
                _ => 0.25,
            };
            let weight = faces.iter().map(weight).sum::<f64>() / faces.len() as f64;
            let middles: DVec3 = faces.iter().map(|&f| face_point(f)).sum();
            weight * middles + (0.5 - weight) * ends
        };
        smooth.lerp(0.5 * ends, sharpness)
    }

    fn vertex_point(
        &self,
        meets: &Incidence,
        v: usize,
        face_point: &dyn Fn(usize) -> DVec3,
    ) -> DVec3 {
        let own = self.points[v];
        let edges = &meets.vertex_edges[v];
        if self.scheme == Scheme::Bilinear || edges.is_empty() {
            return own;
        }
        let far = |e: &Edge| self.points[if e.0 == v { e.1 } else { e.0 }];
        let child = |e: &Edge| self.child_sharpness(meets, *e, v);
        let n = edges.len() as f64;
        let by = |kind: Kind, sharp: &dyn Fn(&Edge) -> bool| -> DVec3 {
            match kind {
                Kind::Corner => own,
                Kind::Crease => {
                    let ends = edges.iter().filter(|e| sharp(e)).map(far);
                    0.75 * own + 0.125 * ends.sum::<DVec3>()
                }
                _ if self.scheme == Scheme::Loop => {
                    let beta = loop_beta(edges.len());
                    (1.0 - n * beta) * own + beta * edges.iter().map(far).sum::<DVec3>()
                }
                _ => {
                    let faces = meets.vertex_faces[v].iter().map(|&f| face_point(f));
                    let around = faces.sum::<DVec3>() + edges.iter().map(far).sum::<DVec3>();
                    (n - 2.0) / n * own + around / (n * n)
                }
            }
        };
        let before = self.kind(meets, v);
        let after = kind(decayed(self.vertex_sharpness[v]), edges.iter().map(child));
        let old = by(before, &|e| self.sharpness(*e) > 0.0);
        if before == after || matches!((before, after), (Kind::Dart, Kind::Smooth)) {
            return old;
        }
        // The share of the old rule: the mean of the sharpnesses that end in this step.
        let mut ending: Vec<f64> = Vec::new();
        let own_sharpness = self.vertex_sharpness[v];
        if own_sharpness > 0.0 && decayed(own_sharpness) == 0.0 {
            ending.push(own_sharpness);
        }
        ending.extend(edges.iter().filter_map(|e| {
            let sharpness = self.sharpness(*e);
            let ends = if self.chaikin {
                sharpness > 0.0 && child(e) == 0.0
            } else {
                sharpness > 0.0 && sharpness <= 1.0
            };
            ends.then_some(sharpness)
        }));
        let share = (ending.iter().sum::<f64>() / ending.len() as f64).min(1.0);
        by(after, &|e| child(e) > 0.0).lerp(old, share)
    }
}

/// See [`Level::neighbours`].
pub(super) struct Neighbours(Incidence);

impl Incidence {
    /// How many fans the faces at a vertex are.
    fn fans(&self, level: &Level, v: usize) -> usize {
        let mut left = self.vertex_faces[v].clone();
        let mut fans = 0;
        while let Some(first) = left.pop() {
            fans += 1;
            let mut reached = vec![first];
            while let Some(f) = reached.pop() {
                let face = &level.faces[f];
                for side in face.around(face.place(v).expect("a face at the vertex")) {
                    for &next in &self.edge_faces[&edge(v, side)] {
                        if let Some(i) = left.iter().position(|&l| l == next) {
                            reached.push(left.swap_remove(i));
                        }
                    }
                }
            }
        }
        fans
    }
}

fn kind(vertex_sharpness: f64, edges: impl Iterator<Item = f64>) -> Kind {
    if vertex_sharpness > 0.0 {
        return Kind::Corner;
    }
    match edges.filter(|&s| s > 0.0).count() {
        0 => Kind::Smooth,
        1 => Kind::Dart,
        2 => Kind::Crease,
        _ => Kind::Corner,
    }
}

fn decayed(sharpness: f64) -> f64 {
    if sharpness >= INFINITE {
        INFINITE
    } else {
        single(sharpness - 1.0)
    }
}

/// What is left of a sharpness, in the precision of the library, so that it is 0 here where it is 0 there.
fn single(left: f64) -> f64 {
    if left > 1e-6 {
        f64::from(left as f32)
    } else {
        0.0
    }
}

fn loop_beta(n: usize) -> f64 {
    let n = n as f64;
    (0.625 - (0.375 + 0.25 * (TAU / n).cos()).powi(2)) / n
}

fn mean(uvs: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|i| uvs.iter().map(|uv| uv[i]).sum::<f64>() / uvs.len() as f64)
}
