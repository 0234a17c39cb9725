//! What an atlas needs to know of the cage: its triangles in their own planes, and which corners are glued.

use std::collections::BTreeMap;

use super::chart::{join, root};
use crate::math::{Bounds3, DVec2, DVec3};
use crate::mesh::{ControlMesh, Crease, Topology, triangulate};

/// No corner is across the edge that leaves a corner.
pub(super) const NONE: u32 = u32::MAX;
/// A triangle as high as this part of its longest side, or lower, has no shape.
const FLAT: f64 = 1e-5;

/// A triangle of a face, laid into its own plane without distortion, counterclockwise seen from the front.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    /// Corners of the face, from 0.
    pub(super) corners: [u32; 3],
    /// Where these lie.
    pub(super) flat: [DVec2; 3],
    /// How much it counts; 0 for those that say no more than that a convex face is to stay convex.
    pub(super) weight: f64,
}

impl Triangle {
    pub(super) fn area(&self) -> f64 {
        let [a, b, c] = self.flat;
        0.5 * (b - a).perp_dot(c - a)
    }

    /// The greatest and the least length that a unit of length gets where the corners are mapped to `to`; the least is
    /// below 0 where the triangle is turned over.
    pub(super) fn stretch(&self, to: [DVec2; 3]) -> [f64; 2] {
        let [a, b, c] = self.flat;
        let sides = [c - b, a - c, b - a];
        // An affine map of the plane is p z + q conj(z) in complex numbers: of these sums over corners the first
        // vanishes for z, the other one for its conjugate.
        let mut turned = [DVec2::ZERO; 2];
        for (side, to) in sides.into_iter().zip(to) {
            turned[0] += side.rotate(to);
            turned[1] += conj(side).rotate(to);
        }
        let twice = 4.0 * self.area();
        let [q, p] = turned.map(|sum| sum.length() / twice);
        [p + q, p - q]
    }
}

/// The conjugate complex number.
pub(super) fn conj(z: DVec2) -> DVec2 {
    DVec2::new(z.x, -z.y)
}

/// The cage, in units of its own size.
pub(super) struct Cage {
    pub(super) topology: Topology,
    /// By vertex.
    pub(super) points: Vec<DVec3>,
    /// The corner from which the other face runs along the edge that leaves a corner, or [`NONE`].
    pub(super) mates: Vec<u32>,
    triangles: Vec<Triangle>,
    starts: Vec<usize>,
    /// By face: unit normals, zero where there is none.
    pub(super) normals: Vec<DVec3>,
    /// By face: means of the corners.
    pub(super) middles: Vec<DVec3>,
    /// By face: whether it has a shape that can be flattened.
    pub(super) usable: Vec<bool>,
    /// By edge: 1 where it is infinitely sharp, 0 where it is smooth.
    pub(super) sharp: Vec<f64>,
}

impl Cage {
    /// Of a valid mesh's points at the first motion key; faces of holes are faces.
    pub(super) fn new(mesh: &ControlMesh) -> Self {
        let whole = ControlMesh {
            holes: Vec::new(),
            ..mesh.clone()
        };
        let topology = whole.topology();
        let bounds = Bounds3::of(whole.used_points());
        let (least, most) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let (middle, size) = (0.5 * (least + most), (most - least).length());
        let unit = if size > 0.0 { size.recip() } else { 1.0 };
        let points = whole.points[0]
            .iter()
            .map(|p| (p.as_dvec3() - middle) * unit);
        let mut cage = Self {
            points: points.collect(),
            mates: Vec::new(),
            triangles: Vec::new(),
            starts: vec![0],
            normals: Vec::new(),
            middles: Vec::new(),
            usable: Vec::new(),
            sharp: vec![0.0; topology.edge_count()],
            topology,
        };
        let plain = triangulate(&whole);
        let mut plain = plain.corners.iter().zip(&plain.faces).peekable();
        for face in 0..cage.topology.face_count() as u32 {
            let first = cage.topology.corners(face).start;
            let mut own = Vec::new();
            while let Some((corners, _)) = plain.next_if(|(_, f)| **f == face) {
                own.push(corners.map(|c| c - first));
            }
            cage.add_face(face, own, mesh.left_handed);
        }
        for crease in &mesh.creases {
            let [a, b] = crease.vertices;
            if let Some(edge) = cage.topology.find_edge(a, b) {
                let sharp = f64::from((crease.sharpness / Crease::INFINITE).min(1.0));
                cage.sharp[edge as usize] = sharp.max(cage.sharp[edge as usize]);
            }
        }
        cage.mates = (0..cage.topology.corner_count() as u32)
            .map(|corner| cage.mate(corner))
            .collect();
        cage
    }

    fn add_face(&mut self, face: u32, plain: Vec<[u32; 3]>, left_handed: bool) {
        let vertices = self.topology.face_vertices(face);
        let n = vertices.len() as u32;
        let point = |i: u32| self.points[vertices[(i % n) as usize] as usize];
        let middle = (0..n).map(point).sum::<DVec3>() / f64::from(n);
        let turn = if left_handed { -1.0 } else { 1.0 };
        let normal: DVec3 = (0..n)
            .map(|i| (point(i) - point(0)).cross(point(i + 1) - point(0)))
            .sum();
        let normal = (turn * normal).try_normalize().unwrap_or(DVec3::ZERO);
        let corner = |i: u32| {
            let around = [(i + n - 1) % n, i, (i + 1) % n];
            match left_handed {
                true => [around[2], around[1], around[0]],
                false => around,
            }
        };
        let area = |[a, b, c]: [u32; 3]| {
            let across = (point(b) - point(a)).cross(point(c) - point(a));
            across.dot(normal)
        };
        let convex =
            (0..n).all(|i| area(corner(i)) >= 0.0) && plain.iter().all(|&t| area(t) >= 0.0);
        let mut weighted: Vec<([u32; 3], f64)> = Vec::new();
        match n {
            // Both diagonals: neither is better than the other.
            4 if convex => weighted.extend((0..n).map(|i| (corner(i), 0.5))),
            _ => {
                weighted.extend(plain.into_iter().map(|t| (t, 1.0)));
                if n > 4 && convex {
                    weighted.extend((0..n).map(|i| (corner(i), 0.0)));
                }
            }
        }
        let mut covered = vec![false; n as usize];
        let mut positive = true;
        let mut shapes = Vec::with_capacity(weighted.len());
        for (corners, weight) in weighted {
            let Some(flat) = lay(corners.map(point)) else {
                continue;
            };
            if weight > 0.0 {
                shapes.push(corners);
                positive &= area(corners) > 0.0;
                corners.iter().for_each(|&i| covered[i as usize] = true);
            }
            self.triangles.push(Triangle {
                corners,
                flat,
                weight,
            });
        }
        self.starts.push(self.triangles.len());
        let mut sorted = vertices.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        let once = sorted.len() == vertices.len();
        self.usable
            .push(once && positive && covered.iter().all(|&c| c) && hang_together(&shapes));
        self.normals.push(normal);
        self.middles.push(middle);
    }

    fn mate(&self, corner: u32) -> u32 {
        let topology = &self.topology;
        let edge = topology.edge(corner);
        let &[a, b] = topology.edge_corners(edge) else {
            return NONE;
        };
        let usable = [a, b]
            .iter()
            .all(|&c| self.usable[topology.face(c) as usize]);
        match usable && topology.is_edge_manifold(edge) {
            true => a ^ b ^ corner,
            false => NONE,
        }
    }

    /// The triangles of a face.
    pub(super) fn triangles(&self, face: u32) -> &[Triangle] {
        let face = face as usize;
        &self.triangles[self.starts[face]..self.starts[face + 1]]
    }

    /// The area of a face: of its triangles.
    pub(super) fn area(&self, face: u32) -> f64 {
        let triangles = self.triangles(face).iter();
        triangles.map(|t| t.weight * t.area()).sum()
    }

    /// The length of the edge that leaves a corner.
    pub(super) fn length(&self, corner: u32) -> f64 {
        let ends = [corner, self.topology.next(corner)];
        let [a, b] = ends.map(|c| self.points[self.topology.vertex(c) as usize]);
        a.distance(b)
    }
}

/// Whether all triangles are one piece by their common sides. Two that only share a corner, as where one between them has no
/// shape, would turn about it as they like.
fn hang_together(triangles: &[[u32; 3]]) -> bool {
    let mut pieces: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut by_side: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for (number, &[a, b, c]) in triangles.iter().enumerate() {
        for side in [[a, b], [b, c], [c, a]] {
            let side = [side[0].min(side[1]), side[0].max(side[1])];
            join(&mut pieces, number, *by_side.entry(side).or_insert(number));
        }
    }
    (0..triangles.len()).all(|number| root(&mut pieces, number) == 0)
}

/// A triangle in its own plane, its first corner at the origin; none if it has no shape.
pub(super) fn lay([a, b, c]: [DVec3; 3]) -> Option<[DVec2; 3]> {
    let (ab, ac) = (b - a, c - a);
    let across = ab.cross(ac).length();
    let longest = (ab.length_squared())
        .max(ac.length_squared())
        .max(b.distance_squared(c));
    if across <= FLAT * longest || longest == 0.0 {
        return None;
    }
    let length = ab.length();
    let x = ac.dot(ab) / length;
    Some([
        DVec2::ZERO,
        DVec2::new(length, 0.0),
        DVec2::new(x, across / length),
    ])
}
