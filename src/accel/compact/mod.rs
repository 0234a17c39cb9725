//! Compressed micro-geometry: quantised blocks of displaced vertices under implicit trees of quantised boxes.
//!
//! After Lier, Martinek, Stamminger, Selgrad, "A High-Resolution Compression Scheme for Ray Tracing Subdivision Surfaces
//! with Displacement", Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018: the
//! parametrisation is known beforehand, so a patch's tree is complete and needs no pointers; boxes are quantised; and the
//! leaves hold a compact approximation of the displaced geometry itself, so that fine displacement is not lost.
//!
//! ```text
//!   Embree's tree          one primitive a face
//!     face                 its rates, and where its tree starts                              24 bytes
//!       nodes              4 x 4 children: 6 x 16 planes of a byte, a frame, block sizes    128 bytes for 16 blocks
//!         blocks           7 x 7 quads: head of 24 bytes, 64 vertices of some 5 to 15 bits
//! ```
//!
//! It traces the micro-triangles of the diced surface ([`Diced`](crate::surface::Diced) shows the same ones), each vertex
//! moved to the nearest point of one lattice for the whole object, which bounds the error ([`Accuracy`]). What two
//! blocks or two faces share has the same three integers and meets rays in the same arithmetic: there are no cracks.
//! Per ray it moves the ray into the lattice once; then a node takes one test of sixteen boxes, and a block one of all
//! its edges at once, of which only the few triangles around the ray are computed any further.
//!
//! We differ from the paper, whose tables are not public, in this: the lattice is the object's and not a patch's, so
//! that borders need no stitching; a node has sixteen children, and its boxes a frame of its own on that lattice rather
//! than the decoded parent's, since 16 bytes for 16 blocks buy exact decoding without a stack of boxes; leaves are as
//! large as two registers of vertices are, as decoding and testing 98 triangles at once costs less than descending
//! to a few of them; and vertices are predicted by a plane and a direction of displacement (see `block`).

mod block;
mod build;
mod lattice;
#[cfg(test)]
mod tests;
mod traverse;
mod tree;

use super::moment::Moment;
use super::shape::{FAN, Shape};
use super::simd::Isa;
use super::{Hit, Intersector};
use crate::math::{Bounds3, DVec3, Ray, Vec2};
use crate::surface::FaceGrid;
use block::{CELLS, Head};
use lattice::{Extent, Lattice};
use traverse::Met;
use tree::Node;

/// How to compress.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CompactOptions {
    /// The farthest that a micro-vertex may be moved, in units of the object, above 0. By default it is 2.4e-5
    /// diagonals of the object.
    pub max_error: Option<f32>,
}

/// How far micro-vertices were moved, in units of the object.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Accuracy {
    /// The farthest.
    pub max: f64,
    /// The root of the mean square. The distance to the surface has about 0.6 of it.
    pub rms: f64,
}

/// A compressed surface.
pub struct Compact {
    isa: Isa,
    lattice: Lattice,
    /// The largest coordinate on the lattice.
    reach: f32,
    keys: u32,
    left_handed: bool,
    faces: Vec<Face>,
    /// Shapes of trees, one for each size of faces.
    shapes: Vec<Shape>,
    /// Each face's trees, key by key.
    nodes: Vec<Node>,
    data: Vec<u8>,
    accuracy: Accuracy,
}

/// A face that is not a hole.
#[derive(Debug, Clone, Copy)]
struct Face {
    face: u32,
    size: [u16; 2],
    segments: [u16; 4],
    /// The root of its first tree, or where its block starts if it is but one.
    root: u32,
    /// The number of its tree's shape.
    shape: u32,
}

impl Compact {
    /// How far micro-vertices were moved.
    pub fn accuracy(&self) -> Accuracy {
        self.accuracy
    }

    /// Bytes of faces with the shapes of their trees, of nodes, and blocks.
    pub fn parts(&self) -> [usize; 3] {
        [
            size_of_val(self.faces.as_slice()) + size_of_val(self.shapes.as_slice()),
            size_of_val(self.nodes.as_slice()),
            self.data.len(),
        ]
    }

    #[inline(always)]
    fn shape(&self, face: &Face) -> &Shape {
        &self.shapes[face.shape as usize]
    }

    /// A block's head at a motion key.
    #[inline(always)]
    fn head(&self, face: &Face, shape: &Shape, [i, j]: [usize; 2], key: usize) -> Head {
        let at = if shape.levels() == 0 {
            face.root as usize * block::UNIT
        } else {
            let node = shape.node(1, i / FAN, j / FAN) + key * shape.nodes();
            let child = j % FAN * FAN + i % FAN;
            self.nodes[face.root as usize + node].block(child)
        };
        let [nu, nv] = face.size.map(usize::from);
        let vertices = [
            (nu - CELLS * i).min(CELLS) + 1,
            (nv - CELLS * j).min(CELLS) + 1,
        ];
        Head::read(&self.data, at, vertices)
    }

    /// All that a face shows at a motion key.
    fn extent(&self, face: &Face, key: usize) -> Extent {
        let shape = self.shape(face);
        if shape.levels() > 0 {
            let node = &self.nodes[face.root as usize + key * shape.nodes()];
            let [columns, rows] = shape.fan(shape.levels(), 0, 0);
            return (0..rows)
                .flat_map(|j| (0..columns).map(move |i| FAN * j + i))
                .fold(Extent::EMPTY, |all, c| all.union(node.child(c)));
        }
        let head = self.head(face, shape, [0, 0], key);
        let [nu, nv] = face.size.map(usize::from);
        (0..=nv)
            .flat_map(|j| (0..=nu).map(move |i| (i, j)))
            .fold(Extent::EMPTY, |all, (i, j)| {
                all.including(head.vertex(&self.data, i, j))
            })
    }

    /// The corners of a triangle, where they are at a time.
    fn corners(&self, face: &Face, met: &Met, moment: &Moment) -> [DVec3; 3] {
        let shape = self.shape(face);
        let [bi, bj] = [met.column / CELLS, met.row / CELLS];
        let (i, j) = (met.column % CELLS, met.row % CELLS);
        let corners = if met.second {
            [(i + 1, j + 1), (i, j + 1), (i + 1, j)]
        } else {
            [(i, j), (i + 1, j), (i, j + 1)]
        };
        let at = |key: usize| {
            let head = self.head(face, shape, [bi, bj], key);
            corners.map(|(i, j)| self.lattice.position(head.vertex(&self.data, i, j)))
        };
        let from = at(moment.from);
        if self.keys == 1 {
            return from;
        }
        let to = at(moment.to);
        let weight = f64::from(moment.weights[1]);
        std::array::from_fn(|k| from[k].lerp(to[k], weight))
    }

    fn hit(&self, face: &Face, ray: &Ray, met: &Met) -> Hit {
        let [a, b, c] = self.corners(face, met, &Moment::new(self.keys, ray.time));
        let normal = (b - a).cross(c - a);
        let normal = if self.left_handed { -normal } else { normal };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let distance = normal
            .normalize_or_zero()
            .dot(ray.at(met.hit.t).as_dvec3() - a)
            .abs();
        let grid = FaceGrid {
            face: face.face,
            size: face.size,
            segments: face.segments,
            first_vertex: 0,
            first_triangle: 0,
        };
        let cell = met.row as u64 * u64::from(face.size[0]) + met.column as u64;
        let triangle = 2 * cell + u64::from(met.second);
        Hit {
            t: met.hit.t,
            face: face.face,
            uv: grid.triangle_uv(triangle, Vec2::new(met.hit.u, met.hit.v)),
            normal: normal.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }
}

impl Intersector for Compact {
    fn primitives(&self) -> u32 {
        self.faces.len() as u32
    }

    fn keys(&self) -> u32 {
        self.keys
    }

    fn bounds(&self, p: u32, key: u32) -> Bounds3 {
        let extent = self.extent(&self.faces[p as usize], key as usize);
        self.lattice.bounds(&extent)
    }

    fn intersect(&self, p: u32, ray: &Ray) -> Option<Hit> {
        let face = &self.faces[p as usize];
        let met = self.trace::<false>(face, ray)?;
        Some(self.hit(face, ray, &met))
    }

    fn occluded(&self, p: u32, ray: &Ray) -> bool {
        self.trace::<true>(&self.faces[p as usize], ray).is_some()
    }

    fn memory(&self) -> usize {
        self.parts().iter().sum()
    }
}
