//! Heights along edges, and the walls between them and those of a face.
//!
//! Faces that share an edge need not have as many micro-quads along it. The edge has heights of its own, at as many samples
//! as its dicing rate says; in between they are linear. Each face has what is there at its micro-vertices. Where those are not
//! the edge's samples, the two are a little apart, and in that place stands a wall along the corners' lines: a ray that
//! passes from prism to prism between the face's height and the edge's meets it. So it cannot pass between two faces,
//! neither of which knows the other.

use super::{Collapsed, Nonlinear, Quad};
use crate::accel::moment::Moment;

/// The heights of all edges.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Edges {
    edges: Vec<Edge>,
    /// Edge by edge in its own direction, at each motion key.
    heights: Vec<u16>,
}

/// An edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Edge {
    first: u32,
    segments: u32,
}

/// How far from a wall's ends a ray still meets it, in steps: more than rounding may do to heights on a curve.
const SLACK: f64 = 0.1;

impl Edges {
    /// Adds the next edge: its heights at each motion key.
    pub(super) fn push(&mut self, keys: &[Vec<u16>]) {
        self.edges.push(Edge {
            first: self.heights.len() as u32,
            segments: keys.first().map_or(0, |heights| heights.len() as u32 - 1),
        });
        self.heights.extend(keys.iter().flatten());
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        size_of_val(self.edges.as_slice()) + size_of_val(self.heights.as_slice())
    }

    /// An edge's heights at a motion key.
    fn heights(&self, edge: u32, key: usize) -> &[u16] {
        let Edge { first, segments } = self.edges[edge as usize];
        let count = segments as usize + 1;
        &self.heights[first as usize + key * count..][..count]
    }

    /// The least and the greatest height of an edge between two places on it, 0..1, in its own direction.
    pub(super) fn range(&self, edge: u32, key: usize, [from, to]: [f64; 2]) -> [u16; 2] {
        let heights = self.heights(edge, key);
        let last = heights.len() - 1;
        let first = (from * last as f64).floor() as usize;
        let end = ((to * last as f64).ceil() as usize).min(last);
        let part = heights[first.min(last)..=end].iter();
        part.fold([u16::MAX, 0], |[a, b], &h| [a.min(h), b.max(h)])
    }
}

/// What is between places of a list, of which `x` counts.
pub(super) fn between(x: f64, last: usize, at: impl Fn(usize) -> f64) -> f64 {
    let i = (x.max(0.0) as usize).min(last.saturating_sub(1));
    let part = (x - i as f64).clamp(0.0, 1.0);
    let from = at(i);
    if part == 0.0 {
        from
    } else {
        from + part * (at(i + 1) - from)
    }
}

impl Nonlinear {
    /// The face's edge that a side of one of the quad's triangles is on; none if it is within the face, or has the same
    /// heights.
    #[inline(always)]
    pub(super) fn border(&self, quad: &Quad, triangle: usize, side: usize) -> Option<usize> {
        let last = self.cuts as u16 - 1;
        let [i, j] = quad.place;
        let (k, there) = match (triangle, side) {
            (0, 1) => (3, i == 0),
            (0, 2) => (0, j == 0),
            (1, 1) => (1, i == last),
            (1, 2) => (2, j == last),
            // The diagonal is the side next to one that is a point.
            _ => match quad.collapsed {
                Collapsed::None => return None,
                Collapsed::Top => (1, i == last),
                Collapsed::Right => (2, j == last),
                Collapsed::Bottom => (3, i == 0),
                Collapsed::Left => (0, j == 0),
            },
        };
        let face = &self.faces[quad.of as usize];
        let segments = self.edges.edges[face.edges[k].edge as usize].segments;
        let same = segments == u32::from(quad.size.0[k % 2]);
        (there && !same).then_some(k)
    }

    /// Whether a height on edge `k` of the face, at u and v of the quad, is between the face's height and the edge's; if so,
    /// whether the face is above the edge.
    pub(super) fn is_wall(
        &self,
        quad: &Quad,
        k: usize,
        uv: [f64; 2],
        height: f64,
        moment: &Moment,
    ) -> Option<bool> {
        let [own, edge] = self.wall(quad, k, uv, moment);
        let between = height > own.min(edge) - SLACK && height < own.max(edge) + SLACK;
        between.then_some(own > edge)
    }

    /// The heights of the face and of its edge `k` there, at u and v of the quad.
    pub(super) fn wall(&self, quad: &Quad, k: usize, uv: [f64; 2], moment: &Moment) -> [f64; 2] {
        let [nu, nv] = quad.size.quads();
        let axis = k % 2;
        let n = [nu, nv][axis];
        let x = uv[axis] + f64::from(quad.first[axis]);
        let (first, step) = match k {
            0 => (0, 1),
            1 => (nu, quad.stride),
            2 => (nv * quad.stride, 1),
            _ => (0, quad.stride),
        };
        let used = self.faces[quad.of as usize].edges[k];
        // An edge's own direction runs as u and v do along the first two sides.
        let along = if used.reversed == (k < 2) {
            1.0 - x / n as f64
        } else {
            x / n as f64
        };
        let at = |key: usize| {
            let face = &self.heights[quad.heights + key * quad.in_face + first..];
            let own = between(x, n, |i| f64::from(face[i * step]));
            let heights = self.edges.heights(used.edge, key);
            let last = heights.len() - 1;
            let edge = between(along * last as f64, last, |i| f64::from(heights[i]));
            [own, edge]
        };
        let [mut own, mut edge] = at(moment.from);
        if moment.from != moment.to {
            let to = at(moment.to);
            let [a, b] = moment.weights.map(f64::from);
            (own, edge) = (a * own + b * to[0], a * edge + b * to[1]);
        }
        [own, edge]
    }
}
