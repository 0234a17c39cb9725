//! How the Ptex faces of a subdivision surface are cut into squares that meet at whole edges.
//!
//! A mesh of quads needs no cuts. Where other faces are about, their sub-faces meet whole quads at half edges, so all
//! faces are cut at the middles of their edges: a quad into quarters, each from one of its corners; a triangle of
//! Loop's into three, with its centroid; a sub-face is such a part already. Then every edge of a part is half an edge
//! of the cage or a spoke, from the middle of an edge to that of the face.
//!
//! ```text
//!   3 --- m --- 2      The part at corner 1: (0,0) is the corner, (1,0) the middle of the edge to the next corner,
//!   |     |     |      (1,1) the middle of the face, (0,1) that of the edge from the corner before.
//!   m --- o --- m
//!   |     |  u  |
//!   0 --- m v-- 1
//! ```

use super::base::{EdgeUse, LimitPoint};
use crate::math::{Vec2, Vec3};
use crate::mesh::{ControlMesh, Topology};

/// A part of a Ptex face, as a square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Part {
    pub(super) ptex: u32,
    pub(super) shape: Shape,
    pub(super) vertices: [u32; 4],
    /// Numbers times two, plus one where reversed.
    edges: [u32; 4],
}

/// How a part's parameters lie in its Ptex face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// They are the same.
    Whole,
    /// The quarter at this corner of a quad.
    Quarter(u8),
    /// The third at this corner of a triangle.
    Third(u8),
}

impl Part {
    pub(super) fn edge(&self, k: u32) -> EdgeUse {
        let edge = self.edges[k as usize];
        EdgeUse {
            edge: edge >> 1,
            reversed: edge & 1 == 1,
        }
    }
}

/// The parts of all faces of a valid mesh, face by face, and whether faces are cut. `triangular` says that a Ptex face
/// is a triangle.
pub(super) fn parts(
    mesh: &ControlMesh,
    topology: &Topology,
    triangular: bool,
) -> (Vec<Part>, bool) {
    let is_cut = triangular || mesh.face_vertex_counts.iter().any(|&n| n != 4);
    let mut parts = Vec::with_capacity(if is_cut {
        topology.corner_count()
    } else {
        topology.face_count()
    });
    let mut ptex = 0;
    for face in 0..topology.face_count() as u32 {
        let corners = topology.corners(face);
        let sides = corners.len();
        if is_cut {
            for (i, corner) in corners.enumerate() {
                let (number, shape) = match (triangular, sides) {
                    (true, _) => (ptex, Shape::Third(i as u8)),
                    (false, 4) => (ptex, Shape::Quarter(i as u8)),
                    _ => (ptex + i as u32, Shape::Whole),
                };
                parts.push(at_corner(topology, face, corner, number, shape));
            }
        } else {
            parts.push(whole(topology, face));
        }
        ptex += if triangular || sides == 4 {
            1
        } else {
            sides as u32
        };
    }
    (parts, is_cut)
}

/// Whether a face runs along the edge that leaves its corner in the edge's own direction.
fn runs_along(topology: &Topology, corner: u32) -> bool {
    topology.edge_vertices(topology.edge(corner))[0] == topology.vertex(corner)
}

fn whole(topology: &Topology, face: u32) -> Part {
    let first = topology.corners(face).start;
    Part {
        ptex: face,
        shape: Shape::Whole,
        vertices: [0, 1, 2, 3].map(|k| topology.vertex(first + k)),
        edges: [0, 1, 2, 3]
            .map(|k| 2 * topology.edge(first + k) + u32::from(!runs_along(topology, first + k))),
    }
}

fn at_corner(topology: &Topology, face: u32, corner: u32, ptex: u32, shape: Shape) -> Part {
    let before = topology.previous(corner);
    let (vertices, edges) = (topology.vertex_count() as u32, topology.edge_count() as u32);
    // The first and the second half of an edge, as the face runs along it; halves run as their edges do.
    let half = |corner: u32, second: bool| {
        let along = runs_along(topology, corner);
        2 * (2 * topology.edge(corner) + u32::from(second == along)) + u32::from(!along)
    };
    let spoke = |corner: u32| 2 * (2 * edges + corner);
    Part {
        ptex,
        shape,
        vertices: [
            topology.vertex(corner),
            vertices + topology.edge(corner),
            vertices + edges + face,
            vertices + topology.edge(before),
        ],
        edges: [
            half(corner, false),
            spoke(corner),
            spoke(before) + 1,
            half(before, true),
        ],
    }
}

/// Ptex parameters with their derivatives by those of the part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) uv: [f64; 2],
    pub(super) du: [f64; 2],
    pub(super) dv: [f64; 2],
    pub(super) duv: [f64; 2],
}

impl Shape {
    /// Where a part's parameters lie in its Ptex face.
    #[inline]
    pub(super) fn place(self, uv: Vec2) -> Placed {
        let [u, v] = [f64::from(uv.x), f64::from(uv.y)];
        let (origin, du, dv, duv) = match self {
            Self::Whole => ([0.0; 2], [1.0, 0.0], [0.0, 1.0], [0.0; 2]),
            Self::Quarter(corner) => {
                let [origin, du, dv] = QUARTERS[usize::from(corner)];
                (origin, du, dv, [0.0; 2])
            }
            Self::Third(corner) => {
                let at = |k: u8| THIRD_CORNERS[usize::from((corner + k) % 3)];
                let (a, next, last) = (at(0), at(1), at(2));
                let middle = |b: [f64; 2]| [0, 1].map(|i| 0.5 * (b[i] - a[i]));
                let (du, dv) = (middle(next), middle(last));
                (a, du, dv, [0, 1].map(|i| 1.0 / 3.0 - a[i] - du[i] - dv[i]))
            }
        };
        Placed {
            uv: [0, 1].map(|i| origin[i] + u * du[i] + v * dv[i] + u * v * duv[i]),
            du: [0, 1].map(|i| du[i] + v * duv[i]),
            dv: [0, 1].map(|i| dv[i] + u * duv[i]),
            duv,
        }
    }

    /// The corner of the quad whose quarter holds parameters of the quad, and those on the quarter.
    pub(super) fn quarter_at(uv: Vec2) -> (u8, Vec2) {
        let corner = match [uv.x > 0.5, uv.y > 0.5] {
            [false, false] => 0,
            [true, false] => 1,
            [true, true] => 2,
            [false, true] => 3,
        };
        let [origin, du, dv] =
            QUARTERS[usize::from(corner)].map(|x| Vec2::from(x.map(|x| x as f32)));
        // Both directions are half a unit long.
        (
            corner,
            4.0 * Vec2::new(du.dot(uv - origin), dv.dot(uv - origin)),
        )
    }

    /// The smallest rectangle of the Ptex face around a rectangle of the part; rounded by less than 1e-15.
    pub(super) fn place_rect(self, min: Vec2, max: Vec2) -> [[f64; 2]; 2] {
        // A bilinear map takes a rectangle to the quad of its corners.
        let corners = [min, Vec2::new(max.x, min.y), max, Vec2::new(min.x, max.y)]
            .map(|uv| self.place(uv).uv);
        let bound = |pick: fn(f64, f64) -> f64| {
            [0, 1].map(|i| {
                corners[1..]
                    .iter()
                    .fold(corners[0][i], |x, c| pick(x, c[i]))
            })
        };
        [bound(f64::min), bound(f64::max)]
    }
}

/// Origin and derivatives by u and v of the quarters of a quad.
const QUARTERS: [[[f64; 2]; 3]; 4] = [
    [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]],
    [[1.0, 0.0], [0.0, 0.5], [-0.5, 0.0]],
    [[1.0, 1.0], [-0.5, 0.0], [0.0, -0.5]],
    [[0.0, 1.0], [0.0, -0.5], [0.5, 0.0]],
];

const THIRD_CORNERS: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

impl Placed {
    /// First derivatives by the Ptex face's parameters as those by the part's.
    #[inline]
    pub(super) fn pull_back_slopes(&self, [du, dv]: [Vec3; 2]) -> [Vec3; 2] {
        [self.du, self.dv].map(|d| d[0] as f32 * du + d[1] as f32 * dv)
    }

    /// A point of the Ptex face with derivatives by the part's parameters.
    pub(super) fn pull_back(&self, p: &LimitPoint) -> LimitPoint {
        let [a, b, c] = [self.du, self.dv, self.duv].map(|d| d.map(|x| x as f32));
        let second = |x: [f32; 2], y: [f32; 2]| {
            x[0] * y[0] * p.duu + (x[0] * y[1] + x[1] * y[0]) * p.duv + x[1] * y[1] * p.dvv
        };
        let [du, dv] = self.pull_back_slopes([p.du, p.dv]);
        LimitPoint {
            position: p.position,
            du,
            dv,
            duu: second(a, a),
            duv: second(a, b) + c[0] * p.du + c[1] * p.dv,
            dvv: second(b, b),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::edge_uv;

    #[test]
    fn quarters_are_found_again() {
        for corner in 0..4 {
            for uv in [Vec2::new(0.25, 0.75), Vec2::new(0.5, 0.125), Vec2::ZERO] {
                let of_quad = Shape::Quarter(corner).place(uv).uv.map(|x| x as f32);
                assert_eq!(Shape::quarter_at(Vec2::from(of_quad)), (corner, uv));
            }
        }
    }

    #[test]
    fn parts_meet_in_parameters() {
        // The second edge of the part at a corner is the third of that at the next one.
        for (count, shape) in [(4, Shape::Quarter as fn(u8) -> Shape), (3, Shape::Third)] {
            for corner in 0..count {
                for t in [0.0, 0.3, 1.0] {
                    let one = shape(corner).place(edge_uv(1, t)).uv;
                    let other = shape((corner + 1) % count).place(edge_uv(2, 1.0 - t)).uv;
                    assert!(
                        (0..2).all(|i| (one[i] - other[i]).abs() < 1e-7),
                        "{one:?} {other:?}"
                    );
                }
            }
        }
    }
}
