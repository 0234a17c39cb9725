//! What subdivision knows of a mesh at one level: its topology, and how sharp each edge and vertex is.
//!
//! Border edges are infinitely sharp, and so is every edge that is not a plain meeting of two faces. A vertex whose
//! faces are not one fan is an infinitely sharp corner, unless exactly two such edges pass through it and make it a
//! crease. These are OpenSubdiv's rules. Refinement keeps them, so they are applied once, to the control mesh.

use std::collections::HashMap;

use super::crease::{self, Rule, is_infinite, is_semi_sharp, is_sharp};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Crease, CreaseMethod, FaceVaryingInterpolation, Primvar,
    Scheme, Topology, TriangleRule,
};

/// Topology and sharpness at one level.
#[derive(Debug, Clone)]
pub(super) struct Cage {
    pub(super) topology: Topology,
    pub(super) rules: Rules,
    /// By edge; [`Crease::INFINITE`] and more for ever.
    pub(super) edge_sharpness: Vec<f32>,
    /// By vertex.
    pub(super) vertex_sharpness: Vec<f32>,
    /// By face: not part of the surface.
    pub(super) hole: Vec<bool>,
    /// By edge how sharp its halves are at the next level, where this is part of a mesh and does not know all edges at
    /// its outer vertices, by which Chaikin's rule decides; empty elsewhere.
    pub(super) halves: Vec<[f32; 2]>,
}

/// What holds at all levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rules {
    /// How faces split, and the masks unless `linear`.
    pub(super) scheme: Scheme,
    /// Whether points stay where they are.
    pub(super) linear: bool,
    pub(super) crease_method: CreaseMethod,
    pub(super) triangle_rule: TriangleRule,
}

impl Rules {
    /// Whether faces are triangles that split into triangles.
    pub(super) fn triangles(self) -> bool {
        self.scheme == Scheme::Loop
    }
}

impl Cage {
    /// The cage of a valid control mesh. Polygon meshes ([`Scheme::None`]) count as bilinear.
    pub(super) fn of(mesh: &ControlMesh) -> Self {
        let topology = mesh.topology();
        let mut cage = Self {
            edge_sharpness: vec![0.0; topology.edge_count()],
            vertex_sharpness: vec![0.0; topology.vertex_count()],
            hole: vec![false; topology.face_count()],
            halves: Vec::new(),
            rules: Rules {
                scheme: mesh.scheme,
                linear: matches!(mesh.scheme, Scheme::Bilinear | Scheme::None),
                crease_method: mesh.crease_method,
                triangle_rule: mesh.triangle_rule,
            },
            topology,
        };
        for crease in &mesh.creases {
            let [a, b] = crease.vertices;
            if let Some(edge) = cage.topology.find_edge(a, b) {
                cage.edge_sharpness[edge as usize] = crease.sharpness;
            }
        }
        for corner in &mesh.corners {
            cage.vertex_sharpness[corner.vertex as usize] = corner.sharpness;
        }
        for &face in &mesh.holes {
            cage.hole[face as usize] = true;
        }
        if mesh.boundary == BoundaryInterpolation::None && !cage.rules.linear {
            cage.drop_border_faces();
        }
        cage.sharpen_edges();
        cage.sharpen_vertices(mesh.boundary == BoundaryInterpolation::EdgeAndCorner);
        cage
    }

    /// The cage on which a face-varying primvar lives: this one, cut open along the seams. Also the element of the
    /// primvar at each of its vertices.
    ///
    /// Under Chaikin's rule sharpness decays by the edges that are left at a vertex; OpenSubdiv's decays as on the whole
    /// mesh. They differ where semi-sharp creases of several sharpnesses reach a seam.
    ///
    /// Seams are borders. Which points on them are corners is up to `rule`; the words and the cases are OpenSubdiv's.
    pub(super) fn cut(
        &self,
        primvar: &Primvar,
        rule: FaceVaryingInterpolation,
    ) -> (Self, Vec<u32>) {
        let whole = &self.topology;
        let mut number: HashMap<(u32, u32), u32> = HashMap::new();
        let mut elements = Vec::new();
        let mut origin = Vec::new();
        let corner_vertices: Vec<u32> = (0..whole.corner_count() as u32)
            .map(|corner| {
                let element = primvar
                    .indices
                    .as_ref()
                    .map_or(corner, |indices| indices[corner as usize]);
                let vertex = whole.vertex(corner);
                *number.entry((vertex, element)).or_insert_with(|| {
                    elements.push(element);
                    origin.push(vertex);
                    elements.len() as u32 - 1
                })
            })
            .collect();
        let counts: Vec<u32> = (0..whole.face_count() as u32)
            .map(|f| whole.corners(f).len() as u32)
            .collect();
        let topology = Topology::new(&counts, corner_vertices, elements.len());
        let mut cage = Self {
            edge_sharpness: vec![0.0; topology.edge_count()],
            vertex_sharpness: origin
                .iter()
                .map(|&v| self.vertex_sharpness[v as usize])
                .collect(),
            hole: self.hole.clone(),
            halves: Vec::new(),
            rules: Rules {
                linear: self.rules.linear || rule == FaceVaryingInterpolation::All,
                ..self.rules
            },
            topology,
        };
        for corner in 0..whole.corner_count() as u32 {
            let edge = cage.topology.edge(corner);
            cage.edge_sharpness[edge as usize] = self.edge_sharpness[whole.edge(corner) as usize];
        }
        cage.sharpen_edges();
        cage.sharpen_vertices(false);
        cage.sharpen_seams(self, &origin, rule);
        (cage, elements)
    }

    /// The same cage with points that stay where they are.
    pub(super) fn linear(&self) -> Self {
        let rules = Rules {
            linear: true,
            ..self.rules
        };
        Self {
            rules,
            ..self.clone()
        }
    }

    /// The rule that shapes a vertex at this level.
    pub(super) fn rule(&self, vertex: u32) -> Rule {
        crease::rule(
            self.vertex_sharpness[vertex as usize],
            self.sharp_edges(vertex).count(),
        )
    }

    /// The sharp edges at a vertex.
    pub(super) fn sharp_edges(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let edges = self.topology.vertex_edges(vertex).iter().copied();
        edges.filter(|&e| is_sharp(self.edge_sharpness[e as usize]))
    }

    /// How sharp the half of `edge` next to `vertex` is at the next level.
    pub(super) fn child_sharpness(&self, edge: u32, vertex: u32) -> f32 {
        if let Some(halves) = self.halves.get(edge as usize) {
            let [first, _] = self.topology.edge_vertices(edge);
            return halves[usize::from(first != vertex)];
        }
        let around = self.topology.vertex_edges(vertex).iter();
        crease::child_sharpness(
            self.rules.crease_method,
            self.edge_sharpness[edge as usize],
            around.map(|&e| self.edge_sharpness[e as usize]),
        )
    }

    /// Under [`BoundaryInterpolation::None`] a face at a border is not part of the surface, unless all border edges
    /// at its vertices are tagged as infinitely sharp.
    fn drop_border_faces(&mut self) {
        for vertex in 0..self.topology.vertex_count() as u32 {
            let loose = self.topology.vertex_edges(vertex).iter().any(|&e| {
                self.topology.is_border(e) && !is_infinite(self.edge_sharpness[e as usize])
            });
            if loose {
                for &corner in self.topology.vertex_corners(vertex) {
                    self.hole[self.topology.face(corner) as usize] = true;
                }
            }
        }
    }

    fn sharpen_edges(&mut self) {
        for (edge, sharpness) in (0_u32..).zip(&mut self.edge_sharpness) {
            if self.topology.is_border(edge) || !self.topology.is_edge_manifold(edge) {
                *sharpness = Crease::INFINITE;
            }
        }
    }

    fn sharpen_vertices(&mut self, lone_corners: bool) {
        let topology = &self.topology;
        for (vertex, sharpness) in (0_u32..).zip(&mut self.vertex_sharpness) {
            let edges = topology.vertex_edges(vertex);
            let faces = topology.vertex_corners(vertex).len();
            let lone = faces == 1 && edges.len() == 2 && lone_corners;
            let tangled = edges
                .iter()
                .filter(|&&e| !topology.is_edge_manifold(e))
                .count();
            let borders = edges.iter().filter(|&&e| topology.is_border(e)).count();
            // Fins on a crease: two tangled edges, and one more face than edges for each fin.
            let crease = tangled == 2 && borders == 0 && faces > edges.len();
            if lone || (!topology.is_vertex_manifold(vertex) && !crease) {
                *sharpness = Crease::INFINITE;
            }
        }
    }

    /// Makes corners of the points of seams where `rule` says so.
    fn sharpen_seams(&mut self, whole: &Self, origin: &[u32], rule: FaceVaryingInterpolation) {
        use FaceVaryingInterpolation as F;
        let mut values: Vec<Vec<u32>> = vec![Vec::new(); whole.topology.vertex_count()];
        for (value, &vertex) in (0_u32..).zip(origin) {
            values[vertex as usize].push(value);
        }
        let linear_borders = matches!(rule, F::Boundaries | F::All);
        let dependent = matches!(rule, F::CornersPlus1 | F::CornersPlus2);
        for (vertex, values) in (0_u32..).zip(&values) {
            let Some(&first) = values.first() else {
                continue; // No face uses the vertex.
            };
            let edges = whole.topology.vertex_edges(vertex);
            let on_border = edges.iter().any(|&e| whole.topology.is_border(e));
            let cut = |value: u32| {
                let open = self.topology.vertex_edges(value).iter();
                open.filter(|&&e| self.topology.is_border(e)).count()
            };
            let seams = values.len() > 1 || (!on_border && cut(first) > 0);
            if !(seams || on_border) {
                continue;
            }
            let span = |value: u32| self.topology.vertex_corners(value).len();
            let sharp_inside = |value: u32, sharp: fn(f32) -> bool| {
                let inner = self.topology.vertex_edges(value).iter();
                inner
                    .filter(|&&e| !self.topology.is_border(e))
                    .map(|&e| self.edge_sharpness[e as usize])
                    .filter(|&s| sharp(s))
                    .fold(0.0, f32::max)
            };
            let mut all_sharp = linear_borders
                || (seams && !whole.topology.is_vertex_manifold(vertex))
                || (dependent && values.len() > 2)
                || (rule == F::CornersPlus2 && values.len() == 1 && !on_border);
            if dependent && let &[a, b] = values.as_slice() {
                all_sharp |= [a, b].iter().any(|&v| {
                    is_sharp(sharp_inside(v, is_infinite)) || !self.topology.is_vertex_manifold(v)
                });
                all_sharp |= rule == F::CornersPlus2 && (span(a) == 1 || span(b) == 1);
                // A semi-sharp crease that ends here makes the other side as sharp, for as long.
                for (this, other) in [(a, b), (b, a)] {
                    let [mine, theirs] = [this, other].map(|v| sharp_inside(v, is_semi_sharp));
                    if is_sharp(theirs) && !is_sharp(mine) && !all_sharp {
                        let own = &mut self.vertex_sharpness[this as usize];
                        *own = own.max(theirs);
                    }
                }
            }
            for &value in values {
                if all_sharp || (rule != F::None && span(value) == 1) {
                    self.vertex_sharpness[value as usize] = Crease::INFINITE;
                }
            }
        }
    }
}
