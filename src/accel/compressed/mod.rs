//! Compressed hierarchies without geometry: implicit trees of quantised boxes, whose smallest boxes are what rays hit.
//!
//! After Selgrad, Lier, Martinek, Buchenau, Guthe, Kranz, Schäfer, Stamminger, "A Compressed Representation for Ray Tracing
//! Parametric Surfaces", ACM Transactions on Graphics 36(1), 2016: the parametrisation is known beforehand, so a patch's
//! tree is complete and balanced and needs no pointers; boxes are quantised to a few bits in a frame along the patch; and
//! where they are as small as pixels they stand for the surface: the place in the tree says the parameters, and the
//! surface itself is asked for the point and the normal there.
//!
//! ```text
//!   Embree's tree          one primitive a face
//!     face                 its frame, its rates, and where its tree starts                    80 bytes
//!       nodes              4 x 4 children: 6 x 16 planes of four bits, origin and units       64 bytes
//!         leaves           the children of the lowest nodes: 2 x 2 micro-quads or so           nothing
//! ```
//!
//! A leaf's box encloses all its micro-quads, those of the diced surface ([`Diced`](crate::surface::Diced) shows the same
//! ones), so that boxes overlap wherever micro-quads touch, within faces and between them: there are no cracks. The ray
//! meets a box halfway through it. What is hit is thus off the surface by no more than the box is large, and
//! [`Hit::error`] says so; who shades goes on from there to the surface itself.
//!
//! We differ from the paper, whose tables are not public, in this: nodes have sixteen children, for registers of sixteen
//! lanes; their boxes are quantised in a frame of the node's own rather than in the decoded parent's, since 16 bytes for 16
//! boxes buy decoding without a stack of boxes; the planes of an axis are decoded and met at once, by a table of
//! the sixteen places where the ray meets any (see `traverse`); and leaves are no multiple of micro-quads but cut so
//! that the lowest nodes are full.

mod build;
mod frame;
mod node;
mod shape;
#[cfg(test)]
mod tests;
mod traverse;

use super::moment::Moment;
use super::simd::Isa;
use super::{Hit, Intersector};
use crate::math::{Bounds3, Ray, Vec2, Vec3};
use crate::surface::FaceGrid;
use frame::Frame;
use node::Node;
use shape::{FAN, Shape};
use traverse::{Boxes, Met};

/// How to compress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CompressedOptions {
    /// Micro-quads along a leaf's side, 1 or more, about: leaves are cut so that the lowest nodes are full. Memory goes
    /// with the inverse of its square, and so do errors with it.
    pub leaf_quads: u16,
}

impl Default for CompressedOptions {
    fn default() -> Self {
        Self { leaf_quads: 2 }
    }
}

/// A compressed surface.
pub struct Compressed {
    isa: Isa,
    keys: u32,
    left_handed: bool,
    faces: Vec<Face>,
    /// Shapes of trees, one for each number of leaves.
    shapes: Vec<Shape>,
    /// Each face's trees, key by key.
    nodes: Vec<Node>,
}

/// A face that is not a hole.
#[derive(Debug, Clone, Copy)]
struct Face {
    frame: Frame,
    /// The largest coordinate in the frame.
    reach: f32,
    face: u32,
    size: [u16; 2],
    segments: [u16; 4],
    /// The root of its first tree.
    root: u32,
    /// The number of its tree's shape.
    shape: u32,
}

/// Bends of less than this, a cosine, may be a box's: what looks away from the ray by less is seen from the front.
const GRAZING: f32 = 0.25;

impl Compressed {
    /// Bytes of faces with the shapes of their trees, and of nodes.
    pub fn parts(&self) -> [usize; 2] {
        [
            size_of_val(self.faces.as_slice()) + size_of_val(self.shapes.as_slice()),
            size_of_val(self.nodes.as_slice()),
        ]
    }

    #[inline(always)]
    fn shape(&self, face: &Face) -> &Shape {
        &self.shapes[face.shape as usize]
    }

    /// The node of a level, column and row at a motion key.
    #[inline(always)]
    fn node(&self, face: &Face, shape: &Shape, [level, i, j]: [usize; 3], key: usize) -> &Node {
        let number = shape.node(level, i, j) + key * shape.nodes();
        &self.nodes[face.root as usize + number]
    }

    fn hit(&self, face: &Face, ray: &Ray, met: &Met) -> Hit {
        let boxes = self.boxes(
            face,
            [met.column, met.row],
            &Moment::new(self.keys, ray.time),
        );
        let leaf = boxes.leaf(met.column % FAN, met.row % FAN);
        let up = self.normal(face, met, &boxes);
        // From the middle of the box to its sides along the normal.
        let error = 0.5 * up.abs().dot(leaf.extent());
        let mut normal = face.frame.object_vector(up);
        if self.left_handed {
            normal = -normal;
        }
        // At an outline the ray may meet the box beside what faces away.
        let direction = ray.direction.normalize_or_zero();
        let cos = normal.dot(direction);
        if cos > 0.0 && cos < GRAZING {
            normal -= 2.0 * cos * direction;
        }

        let within = (face.frame.point(ray.at(met.t)) - leaf.min) / leaf.extent();
        let leaves = self.shape(face).size(0);
        let along = |axis: usize, leaf: usize, within: f32| {
            let quads = usize::from(face.size[axis]);
            let quad = |leaf| first_quad(leaf, leaves[axis], quads) as f32;
            // Flat boxes have no inside: not a number becomes the middle.
            let within = if within.is_finite() {
                within.clamp(0.0, 1.0)
            } else {
                0.5
            };
            (quad(leaf) + within * (quad(leaf + 1) - quad(leaf))) / quads as f32
        };
        let uv = Vec2::new(along(0, met.column, within.x), along(1, met.row, within.y));
        Hit {
            t: met.t,
            face: face.face,
            uv: face.unsnapped(uv),
            normal,
            error: error + f32::MIN_POSITIVE,
        }
    }

    /// The normal at a leaf, of unit length, in the face's frame: across the lines between its neighbours' centres, as
    /// far as they are children of the same node.
    fn normal(&self, face: &Face, met: &Met, boxes: &Boxes) -> Vec3 {
        let (i, j) = (met.column % FAN, met.row % FAN);
        let [columns, rows] = self.shape(face).fan(1, met.column / FAN, met.row / FAN);
        let centre = |i, j| boxes.leaf(i, j).centre();
        let (left, right) = (i.saturating_sub(1), (i + 1).min(columns - 1));
        let (below, above) = (j.saturating_sub(1), (j + 1).min(rows - 1));
        // Where there is one leaf only, the frame tells.
        let along_u = if columns == 1 {
            Vec3::X
        } else {
            centre(right, j) - centre(left, j)
        };
        let along_v = if rows == 1 {
            Vec3::Y
        } else {
            centre(i, above) - centre(i, below)
        };
        along_u.cross(along_v).normalize_or(Vec3::Z)
    }
}

impl Face {
    /// The face's parameters of a point whose parameters over the whole grid, as if nothing were snapped, are `uv`.
    fn unsnapped(&self, uv: Vec2) -> Vec2 {
        let [nu, nv] = self.size;
        if self.segments == [nu, nv, nu, nv] {
            return uv;
        }
        let grid = FaceGrid {
            face: self.face,
            size: self.size,
            segments: self.segments,
            first_vertex: 0,
            first_triangle: 0,
        };
        grid.grid_uv(uv)
    }
}

/// The first quad of a leaf along an axis of so many leaves and quads.
#[inline(always)]
fn first_quad(leaf: usize, leaves: usize, quads: usize) -> usize {
    leaf * quads / leaves
}

/// Leaves along an axis of so many quads: as many as fill the lowest nodes, with about `leaf_quads` quads each.
fn leaves(quads: u16, leaf_quads: u16) -> u16 {
    let wanted = quads.div_ceil(leaf_quads.max(1));
    let fan = FAN as u16;
    ((wanted + 1) / fan * fan).max(fan).min(quads)
}

impl Intersector for Compressed {
    fn primitives(&self) -> u32 {
        self.faces.len() as u32
    }

    fn keys(&self) -> u32 {
        self.keys
    }

    fn bounds(&self, p: u32, key: u32) -> Bounds3 {
        let face = &self.faces[p as usize];
        let shape = self.shape(face);
        // Turned boxes are larger than what is in them: those of the root's children's children less so than the root's.
        let lowest = shape.levels().saturating_sub(1).max(1);
        let [columns, rows] = shape.size(lowest);
        let mut all = Bounds3::EMPTY;
        for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
            let node = self.node(face, shape, [lowest, i, j], key as usize);
            let [columns, rows] = shape.fan(lowest, i, j);
            for (cj, ci) in (0..rows).flat_map(|cj| (0..columns).map(move |ci| (cj, ci))) {
                all = all.union(face.frame.object_bounds(&node.child(FAN * cj + ci)));
            }
        }
        all
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
