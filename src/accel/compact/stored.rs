//! A compressed surface as sections of a store, and back.
//!
//! ```text
//!   facts     one `Facts`: lattice, keys, accuracy
//!   faces     16 bytes a face that is not a hole
//!   top       128 bytes a node of the tree over patches, key by key
//!   patches   12 bytes each
//!   nodes     128 bytes each
//!   data      blocks
//! ```

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::block::{HEAD, Head, PADDING, UNIT};
use super::{Accuracy, Compact, Node, Patch, SPAN, Skeleton};
use crate::accel::simd::{Isa, WIDEST};
use crate::accel::stored::{Ground, Keep, Stored};
use crate::accel::top::Top;
use crate::error::{Fault, Result};
use crate::store::Sections;
use crate::surface::Surface;

/// Everything that is one of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Facts {
    ground: Ground,
    asked: f64,
    max: f64,
    rms: f64,
    vertices: u64,
    diagonal: f64,
    /// 0 where there are none.
    pixels_per_unit: f64,
}

impl Stored for Compact {
    fn store(&self, keep: &mut Keep<'_>) -> Result<()> {
        let accuracy = self.accuracy;
        let facts = Facts {
            ground: Ground::new(
                &self.skeleton.lattice,
                self.skeleton.reach,
                self.skeleton.keys,
                self.skeleton.left_handed,
            ),
            asked: accuracy.asked,
            max: accuracy.max,
            rms: accuracy.rms,
            vertices: accuracy.vertices,
            diagonal: accuracy.diagonal,
            pixels_per_unit: accuracy.pixels_per_unit.unwrap_or(0.0),
        };
        keep(&[
            ("facts", bytemuck::bytes_of(&facts)),
            ("faces", bytemuck::cast_slice(&self.skeleton.faces)),
            ("top", bytemuck::cast_slice(self.skeleton.top.nodes())),
            ("patches", bytemuck::cast_slice(&self.skeleton.patches)),
            ("nodes", bytemuck::cast_slice(&self.nodes)),
            ("data", &self.data),
        ])
    }

    fn stored(surface: &Surface, sections: &Sections<'_>) -> Result<Self, Fault> {
        let wrong = |what: &str| sections.fault(&format!("{what} out of bounds"));
        let facts = sections.items::<Facts>("facts")?;
        let [facts] = *facts else {
            return Err(wrong("facts"));
        };
        let ground = &facts.ground;
        if !ground.is_of(surface) {
            return Err(wrong("facts"));
        }
        let patches = sections.items::<Patch>("patches")?;
        let top = Top::of_nodes(sections.items("top")?, ground.keys as usize, patches.len());
        let compact = Self {
            skeleton: Skeleton {
                isa: Isa::best(),
                lattice: ground.lattice(),
                reach: ground.reach,
                keys: ground.keys,
                left_handed: surface.base().left_handed(),
                faces: sections.items("faces")?,
                top: top.ok_or_else(|| wrong("the tree over patches is"))?,
                patches,
            },
            nodes: sections.items("nodes")?,
            data: sections.items("data")?,
            accuracy: Accuracy {
                asked: facts.asked,
                max: facts.max,
                rms: facts.rms,
                vertices: facts.vertices,
                diagonal: facts.diagonal,
                pixels_per_unit: (facts.pixels_per_unit > 0.0).then_some(facts.pixels_per_unit),
            },
        };
        if !compact
            .skeleton
            .faces
            .iter()
            .all(|face| face.is_of(surface))
        {
            return Err(wrong("a face is"));
        }
        if !(compact.skeleton.patches)
            .par_iter()
            .all(|patch| compact.is_sound(patch))
        {
            return Err(wrong("a patch is"));
        }
        if !ground.is_around(&compact.skeleton.top) {
            return Err(wrong("the lattice is"));
        }
        Ok(compact)
    }
}

impl Compact {
    /// Whether all that a patch leads to is there.
    fn is_sound(&self, patch: &Patch) -> bool {
        let Some(face) = self.skeleton.faces.get(patch.face as usize) else {
            return false;
        };
        let at = [patch.column, patch.row].map(usize::from);
        let begins = |k: usize| SPAN * at[k] < usize::from(face.size[k]);
        if !(begins(0) && begins(1)) || *patch != Patch::new(patch.face, at, face.size, patch.root)
        {
            return false;
        }
        let fan = patch.fan();
        let is_block = |start: u64, block: usize| {
            let at = start as usize * UNIT;
            let Some(after) = at
                .checked_add(HEAD)
                .filter(|&after| after <= self.data.len())
            else {
                return false;
            };
            let vertices = fan.cells_of(block).map(|n| n + 1);
            let head = Head::read(&self.data[..after], at, vertices);
            let end = head.rows[2] + vertices[1] * head.strides[2];
            head.axes.iter().all(|axis| axis.width <= WIDEST) && end + PADDING <= self.data.len()
        };
        if !self.skeleton.has_node(&fan) {
            return is_block(patch.root.into(), 0);
        }
        let root = patch.root as usize;
        let nodes = self.nodes.get(root..root + self.skeleton.keys as usize);
        nodes.is_some_and(|nodes| {
            nodes.iter().all(|node| {
                let there = |block: &usize| fan.there() >> block & 1 == 1;
                let blocks = (0..16).filter(there);
                node.boxes.is_sound()
                    && blocks
                        .map(|block| (node.start(block), block))
                        .all(|(start, block)| start <= u32::MAX.into() && is_block(start, block))
            })
        })
    }
}

impl Node {
    /// Where a block starts, in [`UNIT`]s: [`Node::block`] that cannot wrap around.
    fn start(&self, block: usize) -> u64 {
        let before = self.sizes[..block].iter().map(|&size| u64::from(size));
        u64::from(self.data) + before.sum::<u64>()
    }
}
