//! What faces have along their edges, of the same bits where they agree.

use rayon::prelude::*;

use super::{ShellPoint, Torn, normal};
use crate::math::Vec2;
use crate::surface::adjacency::Side;
use crate::surface::base::{Texcoord, edge_uv};
use crate::surface::dice::FaceGrid;
use crate::surface::evaluate::Surface;

/// Cosine of the angle below which two faces' normals at one point are one, but for roundings: a milliradian.
const SAME_NORMAL: f32 = 1.0 - 5e-7;

/// Texture coordinates that differ by less than this are one, but for roundings: a fiftieth of a texel in 2000.
const SAME_TEXCOORD: f32 = 1e-5;

/// What a face has at a point, by its own evaluation.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Own {
    /// By motion key.
    pub(super) points: Vec<ShellPoint>,
    pub(super) st: Vec2,
}

impl Own {
    /// Takes another's bits for what is the same but for roundings, and its position in any case; what differs.
    fn join(&mut self, other: &Self) -> Torn {
        let same = |(a, b): (&ShellPoint, &ShellPoint)| {
            a.normal == b.normal || a.normal.dot(b.normal) >= SAME_NORMAL
        };
        let normals = self.points.iter().zip(&other.points).all(same);
        for (own, other) in self.points.iter_mut().zip(&other.points) {
            own.position = other.position;
            if normals {
                own.normal = other.normal;
            }
        }
        let size = self.st.abs().max_element().max(1.0);
        let texcoords = (self.st - other.st).abs().max_element() <= SAME_TEXCOORD * size;
        if texcoords {
            self.st = other.st;
        }
        Torn {
            normals: !normals,
            texcoords: !texcoords,
        }
    }
}

impl Torn {
    fn or(self, other: Self) -> Self {
        Self {
            normals: self.normals || other.normals,
            texcoords: self.texcoords || other.texcoords,
        }
    }
}

/// What faces have along their edges, and what they share of it.
pub(super) struct Joined {
    /// By edge and side, in the order of the adjacency: at the corners of the side's quads, both ends included, in the
    /// edge's direction. At both ends alone, if the edge is but a point.
    edges: Vec<Vec<Vec<Own>>>,
    pub(super) torn_edges: Vec<Torn>,
    pub(super) torn_vertices: Vec<Torn>,
}

impl Joined {
    /// Each face's own, of so many quads along u and v.
    pub(super) fn new(flat: &Surface, sizes: &[[u16; 2]]) -> Self {
        let of_edge = |edge: u32| {
            let of_side = |side: Side| {
                let collapsed = flat.base().is_collapsed(side.face, side.k);
                let n = if collapsed {
                    1
                } else {
                    sizes[side.face as usize][(side.k % 2) as usize]
                };
                let sample = |s: u16| {
                    let t = f32::from(s) / f32::from(n);
                    let uv = edge_uv(side.k, if side.reversed { 1.0 - t } else { t });
                    own(flat, side.face, uv)
                };
                (0..=n).map(sample).collect()
            };
            flat.adjacency.edge(edge).map(of_side).collect()
        };
        let count = flat.adjacency.edge_count();
        Self {
            edges: (0..count).into_par_iter().map(of_edge).collect(),
            torn_edges: vec![Torn::default(); count as usize],
            torn_vertices: vec![Torn::default(); flat.adjacency.vertex_count() as usize],
        }
    }

    /// Gives all sides the same bits where they agree.
    pub(super) fn join(&mut self, flat: &Surface) {
        // Within edges: the first side's, at those that have as many.
        for sides in &mut self.edges {
            let Some((first, others)) = sides.split_first_mut() else {
                continue;
            };
            for other in others {
                if other.len() == first.len() {
                    for s in 1..first.len() - 1 {
                        let _ = other[s].join(&first[s]);
                    }
                }
            }
        }
        // At vertices: of those that agree, the first one's; positions are the first one's of all.
        for vertex in 0..flat.adjacency.vertex_count() {
            let mut kinds: Vec<Own> = Vec::new();
            let mut torn = Torn::default();
            for corner in flat.adjacency.vertex(vertex) {
                for (k, at_end) in [(corner.k, false), ((corner.k + 3) % 4, true)] {
                    let used = flat.base().edge(corner.face, k);
                    let same = |side: Side| side.face == corner.face && side.k == k;
                    let Some(side) = flat.adjacency.edge(used.edge).position(same) else {
                        continue;
                    };
                    let samples = &mut self.edges[used.edge as usize][side];
                    let s = if at_end == used.reversed {
                        0
                    } else {
                        samples.len() - 1
                    };
                    let mut differs = Torn::default();
                    let mut known = false;
                    for kind in &kinds {
                        let torn = samples[s].join(kind);
                        known |= torn == Torn::default();
                        differs = differs.or(torn);
                        if known {
                            break;
                        }
                    }
                    torn = torn.or(differs);
                    if !known {
                        kinds.push(samples[s].clone());
                    }
                }
            }
            self.torn_vertices[vertex as usize] = torn;
        }
        for (sides, torn) in self.edges.iter().zip(&mut self.torn_edges) {
            let Some((first, others)) = sides.split_first() else {
                continue;
            };
            let whole = first.len() - 1;
            for other in others {
                let n = other.len() - 1;
                // Where both have a corner.
                for s in (0..=n).filter(|s| (s * whole).is_multiple_of(n)) {
                    *torn = torn.or(other[s].clone().join(&first[s * whole / n]));
                }
            }
        }
    }

    /// What a face has at all vertices of its grid.
    pub(super) fn grid(&self, flat: &Surface, grid: &FaceGrid) -> Vec<Own> {
        let [nu, nv] = grid.size;
        let along = |k: u32| {
            let used = flat.base().edge(grid.face, k);
            let same = |side: Side| side.face == grid.face && side.k == k;
            let side = flat.adjacency.edge(used.edge).position(same).unwrap_or(0);
            (&self.edges[used.edge as usize][side], used.reversed)
        };
        let sides = [0, 1, 2, 3].map(along);
        let collapsed = [0, 1, 2, 3].map(|k| flat.base().is_collapsed(grid.face, k));
        let mut all = Vec::with_capacity((usize::from(nu) + 1) * (usize::from(nv) + 1));
        for (i, j) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))) {
            let on_edges = [
                (j == 0).then_some((0, i)),
                (i == nu).then_some((1, j)),
                (j == nv).then_some((2, nu - i)),
                (i == 0).then_some((3, nv - j)),
            ];
            let on_edges = || on_edges.into_iter().flatten();
            all.push(match on_edges().find(|&(k, _)| !collapsed[k]) {
                Some((k, x)) => {
                    let (samples, reversed) = sides[k];
                    let s = usize::from(x);
                    let s = if reversed { samples.len() - 1 - s } else { s };
                    samples[s].clone()
                }
                None => {
                    let mut own = own(flat, grid.face, grid.vertex_uv(i, j));
                    // All along an edge that is but a point, each with its own parameters.
                    if let Some((k, _)) = on_edges().next() {
                        for (own, point) in own.points.iter_mut().zip(&sides[k].0[0].points) {
                            own.position = point.position;
                        }
                    }
                    own
                }
            });
        }
        all
    }
}

fn own(flat: &Surface, face: u32, uv: Vec2) -> Own {
    let of_key = |key: u32| {
        let limit = flat.base().first_order(face, uv, key);
        ShellPoint {
            position: limit.position,
            normal: normal(flat, face, uv, key, [limit.du, limit.dv]),
        }
    };
    let texcoord = if flat.has_texcoords() {
        flat.texcoord(face, uv)
    } else {
        Texcoord::of_parameters(uv)
    };
    Own {
        points: (0..flat.base().keys()).map(of_key).collect(),
        st: texcoord.st,
    }
}
