//! Edges along which faces cannot compute the same points: these are kept.
//!
//! So it is at creases and seams, where the faces' normals or texture coordinates differ; where the faces at an edge are
//! not cut alike; and where heights are not a matter of texture coordinates. A kept point is the mean of what the faces
//! have there. There are no more of them than any of the faces has micro-vertices, which go to the nearest one, as in
//! [dicing](crate::surface::Diced).

use std::ops::Range;

use rayon::prelude::*;

use super::build::Values;
use super::face::{Face, NONE, Side, share};
use crate::math::{Vec2, Vec3};
use crate::surface::{Base, FaceGrid, Rates, Shell, Torn, edge_uv};

/// Points that are kept: by motion key, in the space of the surface.
pub(super) type Kept = Vec<Vec<Vec3>>;

/// A side of a face, or the corner where it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Use {
    /// The number of the edge or vertex.
    number: u32,
    /// By its place among the faces that are not holes.
    face: u32,
    k: u32,
}

/// What each face has at a point.
struct Own {
    position: Vec3,
    displacement: Vec3,
}

/// Decides what is kept, notes it in the faces, and makes the points.
pub(super) fn keep(
    base: &dyn Base,
    rates: &Rates,
    shell: &Shell,
    values: &Values<'_>,
    faces: &mut [Face],
) -> Kept {
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
    let matters = |torn: Torn| values.matters(torn);

    // Which edges and vertices.
    let mut kept_vertices = vec![false; vertices.last().map_or(0, |v| v.number as usize + 1)];
    let mut kept_edges: Vec<(Range<usize>, u16, u32)> = Vec::new();
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
                let segments = rates.edge(group[0].number).min(least);
                kept_edges.push((range, segments as u16, count));
                count += segments - 1;
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

    // Their points.
    let keys = 0..shell.keys();
    let mean = |own: &[Own]| {
        let sum: Vec3 = own.iter().map(|own| own.position + own.displacement).sum();
        sum / own.len() as f32
    };
    let kept = keys
        .map(|key| {
            let of_edge = |(range, segments, _): &(Range<usize>, u16, u32)| -> Vec<Vec3> {
                let lines: Vec<Line<'_>> = (edges[range.clone()].iter())
                    .map(|used| Line::new(shell, values, &faces[used.face as usize], used, key))
                    .collect();
                (1..*segments)
                    .map(|sample| {
                        let t = f32::from(sample) / f32::from(*segments);
                        mean(&lines.iter().map(|line| line.at(t)).collect::<Vec<_>>())
                    })
                    .collect()
            };
            let of_vertex = |(range, _): &(Range<usize>, u32)| {
                let own = vertices[range.clone()].iter().map(|used| {
                    let face = &faces[used.face as usize];
                    Line::new(shell, values, face, used, key).first()
                });
                mean(&own.collect::<Vec<_>>())
            };
            let mut points: Vec<Vec3> = kept_edges.par_iter().flat_map_iter(of_edge).collect();
            points.par_extend(ends.par_iter().map(of_vertex));
            points
        })
        .collect();

    // Where faces find them.
    for (range, segments, first) in kept_edges {
        for used in &edges[range] {
            let side = &mut faces[used.face as usize].sides[used.k as usize];
            (side.first, side.segments) = (first, segments);
        }
    }
    for (range, first) in ends {
        for used in &vertices[range] {
            let face = &mut faces[used.face as usize];
            face.vertices[used.k as usize] = first;
            face.has_kept = true;
        }
    }
    kept
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
    values: &'a Values<'a>,
    shell: &'a Shell,
    grid: FaceGrid,
    reversed: bool,
    k: u32,
    key: u32,
}

impl<'a> Line<'a> {
    fn new(shell: &'a Shell, values: &'a Values<'a>, face: &Face, used: &Use, key: u32) -> Self {
        Self {
            values,
            shell,
            grid: shell.grids()[used.face as usize],
            reversed: face.sides[used.k as usize].reversed,
            k: used.k,
            key,
        }
    }

    /// The number of the corner of quads in place `x` from the side's corner on.
    fn number(&self, x: u16) -> usize {
        let [nu, nv] = self.grid.size;
        let (i, j) = match self.k {
            0 => (x, 0),
            1 => (nu, x),
            2 => (nu - x, nv),
            _ => (0, nv - x),
        };
        self.grid.vertex(i, j) as usize
    }

    /// At the side's corner.
    fn first(&self) -> Own {
        self.own([self.number(0); 2], [1.0, 0.0], 0.0)
    }

    /// At a part of the edge, in its own direction.
    fn at(&self, t: f32) -> Own {
        let t = if self.reversed { 1.0 - t } else { t };
        let n = self.grid.size[self.k as usize % 2];
        let along = t * f32::from(n);
        let quad = (along as u16).min(n - 1);
        let within = along - f32::from(quad);
        let ends = [quad, quad + 1].map(|x| self.number(x));
        self.own(ends, [1.0 - within, within], t)
    }

    fn own(&self, ends: [usize; 2], [a, b]: [f32; 2], t: f32) -> Own {
        let [from, to] = ends.map(|c| self.shell.points(self.key)[c]);
        let st: [Vec2; 2] = ends.map(|c| self.shell.st()[c]);
        let normal = a * from.normal + b * to.normal;
        let position = a * from.position + b * to.position;
        let height = self.values.height(
            (self.grid.face, edge_uv(self.k, t)),
            self.key,
            [position, normal],
            a * st[0] + b * st[1],
        );
        Own {
            position,
            displacement: height * normal,
        }
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
    Face {
        face: grid.face,
        quads: grid.size,
        cells,
        share: cells.map(share),
        first: grid.first_vertex as u32,
        first_height: 0,
        sides: [0, 1, 2, 3].map(side),
        vertices: [NONE; 4],
        has_kept: false,
        slack: 0.0,
    }
}
