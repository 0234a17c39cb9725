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
mod skeleton;
mod stored;
#[cfg(test)]
mod tests;
mod traverse;

use mapped::Items;

use super::traversal::{any, nearest};
use super::{Hit, Intersector};
use crate::math::{Bounds3, Ray};
pub use accuracy::{Accuracy, MaxError};
pub(super) use block::PADDING;
use block::UNIT;
pub(super) use build::{lattice, reach};
pub(super) use patch::{Node, Patch, SPAN, pack};
pub(super) use skeleton::Skeleton;
pub(super) use traverse::{Patches, Through, View};

/// How to compress.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CompactOptions {
    /// The farthest that a micro-vertex may be moved.
    pub max_error: MaxError,
}

/// A compressed surface.
pub struct Compact {
    skeleton: Skeleton,
    /// Patch by patch, at each motion key.
    nodes: Items<Node>,
    data: Items<u8>,
    accuracy: Accuracy,
}

impl Compact {
    /// How far micro-vertices were moved.
    pub fn accuracy(&self) -> Accuracy {
        self.accuracy
    }

    /// Bytes of faces, patches and the tree above, of nodes, and of blocks.
    pub fn parts(&self) -> [usize; 3] {
        [
            self.skeleton.memory(),
            size_of_val(&*self.nodes),
            self.data.len(),
        ]
    }
}

impl Compact {
    #[inline(always)]
    fn view(&self, patch: &Patch) -> View<'_> {
        let fan = patch.fan();
        let root = patch.root as usize;
        let (nodes, start) = if self.skeleton.has_node(&fan) {
            (&self.nodes[root..root + self.skeleton.keys as usize], 0)
        } else {
            (&self.nodes[..0], root * UNIT)
        };
        View {
            nodes,
            data: &self.data,
            start,
            fan,
        }
    }
}

impl<'s> Patches<'s> for &'s Compact {
    #[inline(always)]
    fn skeleton(&self) -> &'s Skeleton {
        &self.skeleton
    }

    #[inline(always)]
    fn enter(&mut self, number: u32) -> View<'_> {
        self.view(&self.skeleton.patches[number as usize])
    }
}

impl Intersector for Compact {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.skeleton.keys
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        self.skeleton.bounds(key)
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        nearest(&mut Through(self), ray)
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        any(&mut Through(self), ray)
    }

    fn memory(&self) -> usize {
        self.parts().iter().sum()
    }
}
