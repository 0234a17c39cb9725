//! The edges of a triangle mesh, who meets at them, and how sharp they are.
//!
//! Border edges are infinitely sharp, and so is every edge that is not a plain meeting of two faces: more than two
//! faces, two faces that run the same way along it, or both ends in one point. A vertex where the faces are not one
//! fan is an infinitely sharp corner, unless exactly two such edges pass through it and make it a crease. All of this
//! follows from the faces alone and holds again after refinement, so only authored sharpness is handed on.

use crate::mesh::{BoundaryInterpolation, ControlMesh, Crease, CreaseMethod};

/// Edges by number, with their neighbours. Corner `c` of a triangle is where its edge `c` starts.
#[derive(Debug)]
pub(super) struct Edges {
    /// The ends of each edge, the smaller number first.
    pub(super) ends: Vec<[u32; 2]>,
    /// The edge that starts at each corner.
    pub(super) of_corner: Vec<u32>,
    /// What a border or a tangle makes of each edge.
    kinds: Vec<Kind>,
    /// Corners where each edge starts, edge after edge.
    corner_starts: Vec<u32>,
    corners: Vec<u32>,
    /// Edges at each vertex, vertex after vertex, ascending.
    vertex_starts: Vec<u32>,
    at_vertex: Vec<u32>,
    /// Authored sharpness of each edge.
    authored: Vec<f32>,
    /// Authored sharpness of each vertex; infinite where the faces ask for it.
    pub(super) vertex_sharpness: Vec<f32>,
    /// Sum and number of the semi-sharp edges at each vertex, for Chaikin's rule only.
    semi_sharp: Vec<(f32, u32)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Inner,
    Border,
    Tangled,
}

/// The corner after `c` in its triangle.
pub(super) fn next(c: u32) -> u32 {
    if c % 3 == 2 { c - 2 } else { c + 1 }
}

/// The corner before `c` in its triangle.
pub(super) fn previous(c: u32) -> u32 {
    next(next(c))
}

/// Whether an edge or vertex is sharp for a while only.
pub(super) fn is_semi_sharp(sharpness: f32) -> bool {
    sharpness > 0.0 && sharpness < Crease::INFINITE
}

/// One step of uniform decay.
pub(super) fn decayed(sharpness: f32) -> f32 {
    if sharpness >= Crease::INFINITE {
        sharpness
    } else {
        (sharpness - 1.0).max(0.0)
    }
}

impl Edges {
    /// The edges of `mesh`, whose faces are triangles.
    pub(super) fn of(mesh: &ControlMesh) -> Self {
        let indices = &mesh.face_vertex_indices;
        let points = mesh.point_count();

        // Number the edges in the order of their ends.
        let mut halves: Vec<([u32; 2], u32)> = (0..indices.len() as u32)
            .map(|c| {
                let (a, b) = (indices[c as usize], indices[next(c) as usize]);
                ([a.min(b), a.max(b)], c)
            })
            .collect();
        halves.sort_unstable();
        let mut edges = Self {
            ends: Vec::new(),
            of_corner: vec![0; indices.len()],
            kinds: Vec::new(),
            corner_starts: vec![0],
            corners: halves.iter().map(|h| h.1).collect(),
            vertex_starts: Vec::new(),
            at_vertex: Vec::new(),
            authored: Vec::new(),
            vertex_sharpness: vec![0.0; points],
            semi_sharp: Vec::new(),
        };
        for group in halves.chunk_by(|x, y| x.0 == y.0) {
            let ends = group[0].0;
            for &(_, c) in group {
                edges.of_corner[c as usize] = edges.ends.len() as u32;
            }
            edges.ends.push(ends);
            edges
                .corner_starts
                .push(edges.corner_starts[edges.ends.len() - 1] + group.len() as u32);
            edges.kinds.push(match group {
                _ if ends[0] == ends[1] => Kind::Tangled,
                [_] => Kind::Border,
                [x, y] if indices[x.1 as usize] != indices[y.1 as usize] => Kind::Inner,
                _ => Kind::Tangled,
            });
        }

        let ends_of = edges.ends.iter().map(|e| {
            let twice = e[0] == e[1];
            e[..if twice { 1 } else { 2 }].iter().copied()
        });
        (edges.vertex_starts, edges.at_vertex) = gather(points, ends_of);
        edges.author(mesh);
        edges.sharpen_vertices(mesh);
        edges
    }

    /// The edges at vertex `v`, ascending.
    pub(super) fn at(&self, v: u32) -> &[u32] {
        let v = v as usize;
        &self.at_vertex[self.vertex_starts[v] as usize..self.vertex_starts[v + 1] as usize]
    }

    /// The corners where edge `e` starts, one for each face there.
    pub(super) fn corners(&self, e: u32) -> &[u32] {
        let e = e as usize;
        &self.corners[self.corner_starts[e] as usize..self.corner_starts[e + 1] as usize]
    }

    /// The end of `e` that is not `v`.
    pub(super) fn far_end(&self, e: u32, v: u32) -> u32 {
        let [a, b] = self.ends[e as usize];
        if a == v { b } else { a }
    }

    /// How sharp `e` is, infinite at borders and tangles.
    pub(super) fn sharpness(&self, e: u32) -> f32 {
        match self.kinds[e as usize] {
            Kind::Inner => self.authored[e as usize],
            Kind::Border | Kind::Tangled => Crease::INFINITE,
        }
    }

    /// What sharpness the author gave to `e` that matters: none where the faces decide.
    pub(super) fn authored(&self, e: u32) -> f32 {
        match self.kinds[e as usize] {
            Kind::Inner => self.authored[e as usize],
            Kind::Border | Kind::Tangled => 0.0,
        }
    }

    /// Whether `v` lies at a border of the mesh.
    pub(super) fn at_border(&self, v: u32) -> bool {
        self.at(v)
            .iter()
            .any(|&e| self.kinds[e as usize] == Kind::Border)
    }

    /// How sharp the half of `e` next to its end `v` is after one step.
    pub(super) fn child_sharpness(&self, e: u32, v: u32) -> f32 {
        let s = self.sharpness(e);
        let (sum, count) = self.semi_sharp.get(v as usize).copied().unwrap_or_default();
        if !is_semi_sharp(s) || count < 2 {
            return decayed(s);
        }
        let others = (sum - s) / (count - 1) as f32;
        (0.75 * s + 0.25 * others - 1.0).max(0.0)
    }

    fn author(&mut self, mesh: &ControlMesh) {
        self.authored = vec![0.0; self.ends.len()];
        for crease in &mesh.creases {
            let [a, b] = crease.vertices;
            if let Ok(e) = self.ends.binary_search(&[a.min(b), a.max(b)]) {
                self.authored[e] = crease.sharpness.max(0.0);
            }
        }
        for corner in &mesh.corners {
            self.vertex_sharpness[corner.vertex as usize] = corner.sharpness.max(0.0);
        }
        if mesh.crease_method == CreaseMethod::Chaikin {
            self.semi_sharp = (0..self.vertex_sharpness.len() as u32)
                .map(|v| {
                    let semi = self.at(v).iter().map(|&e| self.sharpness(e));
                    semi.filter(|&s| is_semi_sharp(s))
                        .fold((0.0, 0), |(sum, n), s| (sum + s, n + 1))
                })
                .collect();
        }
    }

    /// Makes corners of vertices with one face, where the rule asks for it, and of those that are not one fan.
    fn sharpen_vertices(&mut self, mesh: &ControlMesh) {
        let corners = mesh.face_vertex_indices.iter().map(|&v| std::iter::once(v));
        let (starts, corners) = gather(mesh.point_count(), corners);
        // Which place an edge has among those of the vertex at hand; a union-find forest over these places.
        let mut place = vec![0_u32; self.ends.len()];
        let mut root: Vec<u32> = Vec::new();
        for v in 0..mesh.point_count() {
            let corners = &corners[starts[v] as usize..starts[v + 1] as usize];
            let edges = self.at(v as u32);
            let lone = corners.len() == 1 && mesh.boundary == BoundaryInterpolation::EdgeAndCorner;

            root.clear();
            root.extend(0..edges.len() as u32);
            for (i, &e) in edges.iter().enumerate() {
                place[e as usize] = i as u32;
            }
            let mut fans = edges.len();
            for &c in corners {
                let out = self.of_corner[c as usize];
                let into = self.of_corner[previous(c) as usize];
                let a = find(&mut root, place[out as usize]);
                let b = find(&mut root, place[into as usize]);
                if a != b {
                    root[a.max(b) as usize] = a.min(b);
                    fans -= 1;
                }
            }
            let count = |kind| {
                let same = edges.iter().filter(|&&e| self.kinds[e as usize] == kind);
                same.count()
            };
            let tangled = count(Kind::Tangled);
            let crease = tangled == 2 && count(Kind::Border) == 0;
            if lone || fans > 1 || (tangled > 0 && !crease) {
                self.vertex_sharpness[v] = Crease::INFINITE;
            }
        }
    }
}

/// For each of `count` keys the items that name it, as starts and one list; items are numbered from 0.
fn gather<I: Iterator<Item = u32>>(
    count: usize,
    items: impl Iterator<Item = I> + Clone,
) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; count + 1];
    for key in items.clone().flatten() {
        starts[key as usize + 1] += 1;
    }
    for i in 0..count {
        starts[i + 1] += starts[i];
    }
    let mut end = starts.clone();
    let mut list = vec![0; starts[count] as usize];
    for (item, keys) in items.enumerate() {
        for key in keys {
            list[end[key as usize] as usize] = item as u32;
            end[key as usize] += 1;
        }
    }
    (starts, list)
}

/// The root of `i`, halving the way there.
fn find(root: &mut [u32], mut i: u32) -> u32 {
    while root[i as usize] != i {
        root[i as usize] = root[root[i as usize] as usize];
        i = root[i as usize];
    }
    i
}
