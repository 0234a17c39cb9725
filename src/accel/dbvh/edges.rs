//! Edges along which faces cannot compute the same points: these are kept.
//!
//! So it is at creases and seams, where the faces' normals or texture coordinates differ; where the faces at an edge are
//! not cut alike; and where heights are not a matter of texture coordinates. A kept point is the mean of what the faces
//! have there. There are no more of them than any of the faces has micro-vertices, which go to the nearest one, as in
//! [dicing](crate::surface::Diced).

use std::ops::Range;

use rayon::prelude::*;

use super::Dbvh;
use super::face::{Face, NONE, Side, share};
use super::heights::Source;
use super::part::cut;
use crate::math::Vec3;
use crate::surface::{Amount, Base, DisplacementPoint, FaceGrid, Rates, Shell, Torn, edge_uv};

/// Which edges and vertices are kept, and whose they are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Plan {
    /// Those at an edge or vertex follow one another.
    edge_uses: Vec<Use>,
    vertex_uses: Vec<Use>,
    /// Points within edges come first, then those of vertices, all in this order.
    edges: Vec<Stretch>,
    vertices: Vec<Range<usize>>,
}

/// An edge that is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Stretch {
    uses: Range<usize>,
    segments: u16,
}

/// A side of a face, or the corner where it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Use {
    /// The number of the edge or vertex.
    number: u32,
    /// By its place among the faces that are not holes.
    face: u32,
    k: u32,
}

impl Plan {
    /// Decides what is kept, and notes it in the faces. `matters` says whether faces that differ so compute different
    /// points.
    pub(super) fn new(
        base: &dyn Base,
        rates: &Rates,
        shell: &Shell,
        matters: impl Fn(Torn) -> bool,
        faces: &mut [Face],
    ) -> Self {
        let uses = |number: &dyn Fn(u32, u32) -> u32| {
            let mut uses: Vec<Use> = (0..faces.len() as u32)
                .flat_map(|face| (0..4).map(move |k| (face, k)))
                .map(|(face, k)| Use {
                    number: number(shell.grids()[face as usize].face, k),
                    face,
                    k,
                })
                .collect();
            uses.sort_unstable();
            uses
        };
        let edges = uses(&|face, k| base.edge(face, k).edge);
        let vertices = uses(&|face, k| base.vertex(face, k));
        let vertex_of = |used: &Use, end: u32| {
            base.vertex(shell.grids()[used.face as usize].face, (used.k + end) % 4)
        };
        // Which edges and vertices.
        let mut kept_vertices = vec![false; vertices.last().map_or(0, |v| v.number as usize + 1)];
        let mut kept_edges: Vec<(Stretch, u32)> = Vec::new();
        let mut count = 0_u32;
        for range in groups(&edges) {
            let group = &edges[range.clone()];
            let collapsed = group
                .iter()
                .any(|used| faces[used.face as usize].sides[used.k as usize].collapsed);
            let along = |used: &Use| {
                let (face, axis) = (&faces[used.face as usize], used.k as usize % 2);
                [face.quads[axis], face.cells[axis]]
            };
            let uneven = group.iter().any(|used| along(used) != along(&group[0]));
            let torn = matters(shell.torn_edge(group[0].number));
            if collapsed || group.len() > 1 && (uneven || torn) {
                for end in 0..2 {
                    kept_vertices[vertex_of(&group[0], end) as usize] = true;
                }
                if !collapsed {
                    // As many as the edge is to have, and no more than any of its faces has there.
                    let all = |used: &Use| along(used).map(u32::from).iter().product();
                    let least = group.iter().map(all).min().unwrap_or(1);
                    let segments = rates.edge(group[0].number).min(least) as u16;
                    kept_edges.push((
                        Stretch {
                            uses: range,
                            segments,
                        },
                        count,
                    ));
                    count += u32::from(segments) - 1;
                }
            }
        }
        let mut ends: Vec<(Range<usize>, u32)> = Vec::new();
        for range in groups(&vertices) {
            let number = vertices[range.start].number;
            if kept_vertices[number as usize] || matters(shell.torn_vertex(number)) {
                ends.push((range, count));
                count += 1;
            }
        }

        // Where faces find them.
        for (Stretch { uses, segments }, first) in &kept_edges {
            for used in &edges[uses.clone()] {
                let side = &mut faces[used.face as usize].sides[used.k as usize];
                (side.first, side.segments) = (*first, *segments);
            }
        }
        for (range, first) in &ends {
            for used in &vertices[range.clone()] {
                let face = &mut faces[used.face as usize];
                face.vertices[used.k as usize] = *first;
                face.has_kept = true;
            }
        }
        let mut plan = Self::default();
        for (Stretch { uses, segments }, _) in kept_edges {
            let first = plan.edge_uses.len();
            plan.edge_uses.extend_from_slice(&edges[uses]);
            plan.edges.push(Stretch {
                uses: first..plan.edge_uses.len(),
                segments,
            });
        }
        for (range, _) in ends {
            let first = plan.vertex_uses.len();
            plan.vertex_uses.extend_from_slice(&vertices[range]);
            plan.vertices.push(first..plan.vertex_uses.len());
        }
        plan
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        size_of_val(self.edge_uses.as_slice())
            + size_of_val(self.vertex_uses.as_slice())
            + size_of_val(self.edges.as_slice())
            + size_of_val(self.vertices.as_slice())
    }
}

impl Dbvh {
    /// The points that are kept, by motion key, on the lattice. `amount` is what displaces; none if nothing does.
    pub(super) fn keep(&self, amount: Option<&Amount>) -> Vec<Vec<[f32; 3]>> {
        let plan = &self.plan;
        let line = |used: &Use, key: usize| Line {
            tree: self,
            amount,
            face: &self.faces[used.face as usize],
            k: used.k as usize,
            key,
        };
        let mean = |points: &mut dyn ExactSizeIterator<Item = Vec3>| {
            let count = points.len() as f32;
            (points.sum::<Vec3>() / count).to_array()
        };
        (0..self.corners.len())
            .map(|key| {
                let of_edge = |stretch: &Stretch| {
                    let lines: Vec<Line<'_>> = (plan.edge_uses[stretch.uses.clone()].iter())
                        .map(|used| line(used, key))
                        .collect();
                    let segments = stretch.segments;
                    (1..segments).map(move |sample| {
                        let t = f32::from(sample) / f32::from(segments);
                        mean(&mut lines.iter().map(|line| line.at(t)))
                    })
                };
                let of_vertex = |range: &Range<usize>| {
                    let uses = plan.vertex_uses[range.clone()].iter();
                    mean(&mut uses.map(|used| line(used, key).first()))
                };
                let mut points: Vec<[f32; 3]> =
                    plan.edges.par_iter().flat_map_iter(of_edge).collect();
                points.par_extend(plan.vertices.par_iter().map(of_vertex));
                points
            })
            .collect()
    }
}

/// Runs of the same number.
fn groups(uses: &[Use]) -> impl Iterator<Item = Range<usize>> {
    let mut start = 0;
    uses.chunk_by(|a, b| a.number == b.number)
        .map(move |group| {
            let range = start..start + group.len();
            start = range.end;
            range
        })
}

/// A face along one of its sides.
struct Line<'a> {
    tree: &'a Dbvh,
    amount: Option<&'a Amount>,
    face: &'a Face,
    k: usize,
    key: usize,
}

impl Line<'_> {
    /// The number of the corner of quads in place `x` from the side's corner on.
    fn number(&self, x: u16) -> usize {
        let [nu, nv] = self.face.quads;
        let (i, j) = match self.k {
            0 => (x, 0),
            1 => (nu, x),
            2 => (nu - x, nv),
            _ => (0, nv - x),
        };
        self.face.first as usize + usize::from(j) * (usize::from(nu) + 1) + usize::from(i)
    }

    /// The displaced point at the side's corner.
    fn first(&self) -> Vec3 {
        self.point([self.number(0); 2], [1.0, 0.0], 0.0)
    }

    /// The same at a part of the edge, in its own direction.
    fn at(&self, t: f32) -> Vec3 {
        let t = if self.face.sides[self.k].reversed {
            1.0 - t
        } else {
            t
        };
        let n = self.face.quads[self.k % 2];
        let along = t * f32::from(n);
        let quad = (along as u16).min(n - 1);
        let within = along - f32::from(quad);
        let ends = [quad, quad + 1].map(|x| self.number(x));
        self.point(ends, [1.0 - within, within], t)
    }

    fn point(&self, ends: [usize; 2], [a, b]: [f32; 2], t: f32) -> Vec3 {
        let tree = self.tree;
        let [from, to] = ends.map(|c| tree.corners[self.key][c]);
        let mix = |from: [f32; 3], to: [f32; 3]| a * Vec3::from(from) + b * Vec3::from(to);
        let (position, normal) = (mix(from.p, to.p), mix(from.n, to.n));
        let st = a * tree.st[ends[0]] + b * tree.st[ends[1]];
        let value = match (&tree.heights.source, self.amount) {
            (Source::Flat(value), _) => *value,
            (Source::Image(image), _) => image.texels().eval(st),
            (Source::Kept(_), None) => 0.0,
            (Source::Kept(_), Some(amount)) => {
                let at = DisplacementPoint {
                    face: self.face.face,
                    uv: edge_uv(self.k as u32, t),
                    key: self.key as u32,
                    position: tree.lattice.anchor + tree.lattice.step * position,
                    normal: normal.normalize_or_zero(),
                    st,
                };
                amount.map.value(&at).x
            }
        };
        let height = tree.heights.scale * value + tree.heights.bias;
        let height = if height.is_finite() { height } else { 0.0 };
        position + height * normal
    }
}

/// Faces before anything of their borders is kept.
pub(super) fn face(base: &dyn Base, grid: &FaceGrid, cells: [u16; 2]) -> Face {
    let side = |k: u32| Side {
        first: NONE,
        segments: 0,
        reversed: base.edge(grid.face, k).reversed,
        collapsed: base.is_collapsed(grid.face, k),
    };
    let [(columns, across), (rows, up)] = cells.map(cut);
    let blocks = [columns, rows];
    Face {
        face: grid.face,
        quads: grid.size,
        cells,
        group: Face::group(cells),
        share: cells.map(share),
        blocks,
        steps: [across, up],
        levels: Face::levels(blocks),
        is_flat: false,
        bent: 0.0,
        first: grid.first_vertex as u32,
        first_height: 0,
        sides: [0, 1, 2, 3].map(side),
        vertices: [NONE; 4],
        has_kept: false,
        slack: 0.0,
    }
}
