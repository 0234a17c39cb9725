//! Compressed micro-geometry: quantised blocks of displaced vertices under implicit trees of quantised boxes.
//!
//! After Lier, Martinek, Stamminger, Selgrad, "A High-Resolution Compression Scheme for Ray Tracing Subdivision Surfaces
//! with Displacement", Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018: the
//! parametrisation is known beforehand, so a patch's tree is complete and needs no pointers; boxes are quantised; and the
//! leaves hold a compact approximation of the displaced geometry itself, so that fine displacement is not lost.
//!
//! ```text
//!   tree over patches      see `top`                                                  some 9 bytes a patch
//!     patch                where in which face, and where its node is                           12 bytes
//!       node               4 x 4 blocks: 6 x 16 planes of a byte, a frame, sizes               128 bytes
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
//! that borders need no stitching; patches are parts of faces, of up to 28 x 28 quads, and the tree above them is chosen
//! by their boxes, since that costs less than the complete tree over a face and fits better; a node has sixteen
//! children, and its boxes a frame of its own on that lattice rather than the decoded parent's, since 16 bytes for 16
//! blocks buy exact decoding without a stack of boxes; leaves are as large as two registers of vertices are, as
//! decoding and testing 98 triangles at once costs less than descending to a few of them; and vertices are predicted by
//! a plane and a direction of displacement (see `block`).

mod accuracy;
mod block;
mod build;
mod patch;
mod stored;
#[cfg(test)]
mod tests;
mod traverse;

use bytemuck::{Pod, Zeroable};
use mapped::Items;

use super::lattice::Lattice;
use super::simd::Isa;
use super::top::Top;
use super::traversal::{any, nearest};
use super::{Hit, Intersector};
use crate::math::{Bounds3, DVec3, Ray, Vec2};
use crate::surface::FaceGrid;
pub use accuracy::{Accuracy, MaxError};
use block::{CELLS, Head, SIDE};
use patch::{FAN, Fan, Node, Patch, SPAN};
pub use stored::Keep;
use traverse::Met;

/// How to compress.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CompactOptions {
    /// The farthest that a micro-vertex may be moved.
    pub max_error: MaxError,
}

/// A compressed surface.
pub struct Compact {
    isa: Isa,
    lattice: Lattice,
    /// The largest coordinate on the lattice.
    reach: f32,
    keys: u32,
    left_handed: bool,
    /// Those that are not holes.
    faces: Items<Face>,
    /// The tree over the patches, which are in its order.
    top: Top,
    patches: Items<Patch>,
    /// Patch by patch, at each motion key.
    nodes: Items<Node>,
    data: Items<u8>,
    accuracy: Accuracy,
}

/// How a face is diced.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Face {
    face: u32,
    size: [u16; 2],
    segments: [u16; 4],
}

impl Compact {
    /// How far micro-vertices were moved.
    pub fn accuracy(&self) -> Accuracy {
        self.accuracy
    }

    /// Bytes of faces, patches and the tree above, of nodes, and of blocks.
    pub fn parts(&self) -> [usize; 3] {
        [
            self.top.memory() + size_of_val(&*self.faces) + size_of_val(&*self.patches),
            size_of_val(&*self.nodes),
            self.data.len(),
        ]
    }

    #[inline(always)]
    fn fan(&self, patch: &Patch) -> Fan {
        patch.fan(self.faces[patch.face as usize].size)
    }

    /// The head of a patch's block at a motion key.
    #[inline(always)]
    fn head(&self, patch: &Patch, fan: &Fan, block: usize, key: usize) -> Head {
        let root = patch.root as usize;
        let at = if self.has_node(fan) {
            self.nodes[root + key].block(block)
        } else {
            root * block::UNIT
        };
        Head::read(&self.data, at, fan.cells_of(block).map(|n| n + 1))
    }

    #[inline(always)]
    fn has_node(&self, fan: &Fan) -> bool {
        self.keys > 1 || !fan.is_single()
    }

    /// What a ray met: a triangle with these corners on the lattice.
    #[inline(always)]
    fn hit_at(&self, ray: &Ray, met: &Met, [a, b, c]: [DVec3; 3]) -> Hit {
        let patch = &self.patches[met.patch as usize];
        let normal = (b - a).cross(c - a);
        let normal = if self.left_handed { -normal } else { normal };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let point = self.lattice.on_lattice(ray.at(met.hit.t));
        let distance = normal.dot(point - a).abs() / normal.length().max(f64::MIN_POSITIVE);
        let distance = distance * self.lattice.step();
        let face = &self.faces[patch.face as usize];
        let grid = FaceGrid {
            face: face.face,
            size: face.size,
            segments: face.segments,
            first_vertex: 0,
            first_triangle: 0,
        };
        let at = |patch: u16, block: usize, cell: usize| {
            (SPAN * usize::from(patch) + CELLS * block + cell) as u16
        };
        let column = at(patch.column, met.block % FAN, met.cell % SIDE);
        let row = at(patch.row, met.block / FAN, met.cell / SIDE);
        let weights = Vec2::new(met.hit.u, met.hit.v);
        Hit {
            t: met.hit.t,
            face: face.face,
            uv: grid.cell_uv((column, row), met.second, weights),
            normal: normal.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }
}

impl Intersector for Compact {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.keys
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        self.lattice.bounds(&self.top.extent(key as usize))
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        nearest(self, ray)
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        any(self, ray)
    }

    fn memory(&self) -> usize {
        self.parts().iter().sum()
    }
}
