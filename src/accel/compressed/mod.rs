//! Compressed hierarchies without geometry: implicit trees of quantised boxes, whose leaves are thin slabs that rays hit.
//!
//! After Selgrad, Lier, Martinek, Buchenau, Guthe, Kranz, Schäfer, Stamminger, "A Compressed Representation for Ray Tracing
//! Parametric Surfaces", ACM Transactions on Graphics 36(1), 2016: the parametrisation is known beforehand, so a patch's
//! tree is complete and balanced and needs no pointers; its boxes are quantised to a few bits; and where they are about
//! as small as pixels they stand for the surface: the place in the tree says the parameters, and the surface itself is
//! asked for the point and the normal there.
//!
//! ```text
//!   tree over patches      see `top`                                                  some 9 bytes a patch
//!     patch                where in which face, and where its fan is                           12 bytes
//!       fan                4 x 4 tiles: 6 x 16 planes of a byte, a frame                      112 bytes
//!         tile             4 x 4 leaves: slabs along the surface, in coordinates of their own  96 bytes
//!           leaves         2 x 2 micro-quads or so                                              nothing
//! ```
//!
//! A leaf's slab encloses all its micro-quads, those of the diced surface ([`Diced`](crate::surface::Diced) shows the same
//! ones), so that slabs overlap wherever micro-quads touch, within faces and between them: there are no cracks. The ray
//! meets a slab halfway through it, or where it enters or leaves it if it passes above or below that. What is hit is thus
//! off the surface by no more than the slab is thick, and [`Hit::error`] says so; who shades goes on from there to the
//! surface itself.
//!
//! We differ from the paper, whose tables are not public, in this: a leaf is no box but a slab along the mean plane of its
//! corners, whose heights leaves share with each other (see `tile`). A box is as thick as its content is steep: rays that
//! leave a surface point, and rays that should pass close by, are caught by the boxes around, and the picture becomes
//! darker. A slab is as thick as its content is bent, which goes with the square of its size. Nodes have sixteen
//! children, for registers of sixteen lanes; only the two lowest levels are implicit, and above these patches are
//! parts of faces under a tree chosen by their boxes, since that fits better than a complete tree over each face.

mod build;
mod fit;
mod leaf;
mod patch;
mod stored;
#[cfg(test)]
mod tests;
mod tile;
mod traverse;

use mapped::Items;

use super::Hit;
use super::face::Face;
use super::lattice::Lattice;
use super::moment::Moment;
use super::simd::Isa;
use super::top::Top;
use super::traversal::{Tree, Trunk};
use crate::math::{Ray, Vec2};
use crate::stats::AchievedError;
use leaf::Leaf;
use patch::{Fan, Patch};
use tile::{FAN, Tile};
use traverse::{Met, Walk};

/// A compressed surface.
pub struct Compressed {
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
    fans: Items<Fan>,
    tiles: Items<Tile>,
    thick: AchievedError,
}

impl Compressed {
    /// How thick leaves' slabs are at most, and in the mean over all leaves: no farther from a hit is the diced surface.
    pub fn achieved(&self) -> AchievedError {
        self.thick
    }

    /// Bytes of faces, patches and the tree above, of fans, and of tiles.
    pub fn parts(&self) -> [usize; 3] {
        [
            self.top.memory() + size_of_val(&*self.faces) + size_of_val(&*self.patches),
            size_of_val(&*self.fans),
            size_of_val(&*self.tiles),
        ]
    }

    /// A patch's tile at a motion key.
    #[inline(always)]
    fn tile(&self, patch: &Patch, number: usize, key: usize) -> &Tile {
        let root = patch.root as usize + key;
        if patch.is_single() {
            return &self.tiles[root];
        }
        &self.tiles[self.fans[root].first as usize + patch.number(number)]
    }

    /// A leaf of a tile at a moment.
    #[inline(always)]
    fn leaf(&self, patch: &Patch, tile: usize, leaf: usize, moment: &Moment) -> Leaf {
        let quads = patch.quads_of(tile);
        let at = |key| Leaf::of(self.tile(patch, tile, key), leaf, quads);
        let from = at(moment.from);
        if moment.from == moment.to {
            return from;
        }
        from.on_the_way(&at(moment.to), moment)
    }
}

impl Tree for Compressed {
    type Met = Met;
    type Walk<'a, const ANY: bool, const MOVES: bool> = Walk<'a, MOVES>;

    #[inline(always)]
    fn trunk(&self) -> Trunk<'_> {
        Trunk {
            isa: self.isa,
            keys: self.keys,
            lattice: &self.lattice,
            top: &self.top,
        }
    }

    #[inline(always)]
    fn walk<'a, const ANY: bool, const MOVES: bool>(
        &'a self,
        moment: &'a Moment,
        ray: &Ray,
    ) -> Option<Self::Walk<'a, ANY, MOVES>> {
        Walk::new(self, moment, ray)
    }

    /// What a ray met on a leaf.
    #[inline(always)]
    fn hit_on(&self, ray: &Ray, met: &Met) -> Hit {
        let patch = &self.patches[met.patch as usize];
        let leaf = self.leaf(patch, met.tile, met.leaf, &Moment::new(self.keys, ray.time));
        let at = (ray.at(met.t) - self.lattice.anchor) * (1.0 / self.lattice.step);
        let p = leaf.place(at);
        let normal = leaf.normal();
        // From one side of the slab to the other.
        let across = (leaf.above + leaf.below) / normal.length();
        let within = leaf.quads(Vec2::new(p.x, p.y));

        let face = &self.faces[patch.face as usize];
        let [i, j] = [met.tile % FAN, met.tile / FAN];
        let first = patch.first(face.size);
        let first = Vec2::new(
            (first[0] + patch.before(0, i)) as f32,
            (first[1] + patch.before(1, j)) as f32,
        );
        let size = Vec2::from(face.size.map(f32::from));
        Hit {
            t: met.t,
            face: face.face,
            uv: face.grid().grid_uv((first + within) / size),
            normal: if self.left_handed { -normal } else { normal },
            error: self.lattice.step * across + f32::MIN_POSITIVE,
        }
    }

    fn bytes(&self) -> usize {
        self.parts().iter().sum()
    }
}
