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
//!
//! Whatever a traversal takes as an index, a size or a shift is checked before anything is traced: a file may come from
//! anywhere. Boxes and vertices are not: wrong ones make a wrong picture, and nothing worse.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::block::{HEAD, Head, PADDING, UNIT};
use super::{Accuracy, Compact, Face, Node, Patch, SPAN, Skeleton};
use crate::accel::lattice::Lattice;
use crate::accel::simd::{Isa, WIDEST};
use crate::accel::top::Top;
use crate::error::{Fault, Result};
use crate::math::Vec3;
use crate::store::Sections;
use crate::surface::{MOST_SEGMENTS, Surface};

/// Everything that is one of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Facts {
    anchor: [f32; 3],
    step: f32,
    reach: f32,
    keys: u32,
    left_handed: u32,
    zero: u32,
    asked: f64,
    max: f64,
    rms: f64,
    vertices: u64,
    diagonal: f64,
    /// 0 where there are none.
    pixels_per_unit: f64,
}

/// What takes sections by their names.
pub type Keep<'a> = dyn FnMut(&[(&str, &[u8])]) -> Result<()> + 'a;

impl Compact {
    /// Gives all of it to `keep`.
    ///
    /// # Errors
    /// Those of `keep`.
    pub fn store(&self, keep: &mut Keep<'_>) -> Result<()> {
        let accuracy = self.accuracy;
        let facts = Facts {
            anchor: self.skeleton.lattice.anchor.to_array(),
            step: self.skeleton.lattice.step,
            reach: self.skeleton.reach,
            keys: self.skeleton.keys,
            left_handed: self.skeleton.left_handed.into(),
            zero: 0,
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

    /// That of a surface, from a store.
    ///
    /// # Errors
    /// If it is not one that was built of such a surface.
    pub fn stored(surface: &Surface, sections: &Sections<'_>) -> Result<Self, Fault> {
        let wrong = |what: &str| sections.fault(&format!("{what} out of bounds"));
        let facts = sections.items::<Facts>("facts")?;
        let [facts] = *facts else {
            return Err(wrong("facts"));
        };
        let base = surface.base();
        let lattice = Lattice {
            anchor: Vec3::from(facts.anchor),
            step: facts.step,
        };
        let right = facts.keys == base.keys()
            && facts.left_handed == u32::from(base.left_handed())
            && lattice.anchor.is_finite()
            && lattice.step.is_normal()
            && lattice.step > 0.0
            && facts.reach.is_finite()
            && facts.reach >= 0.0;
        if !right {
            return Err(wrong("facts"));
        }
        let patches = sections.items::<Patch>("patches")?;
        let top = Top::of_nodes(sections.items("top")?, facts.keys as usize, patches.len());
        let compact = Self {
            skeleton: Skeleton {
                isa: Isa::best(),
                lattice,
                reach: facts.reach,
                keys: facts.keys,
                left_handed: base.left_handed(),
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
        let bounded = (0..facts.keys as usize).all(|key| {
            let bounds = compact
                .skeleton
                .lattice
                .bounds(&compact.skeleton.top.extent(key));
            bounds.is_empty() || bounds.min.is_finite() && bounds.max.is_finite()
        });
        if !bounded {
            return Err(wrong("the lattice is"));
        }
        Ok(compact)
    }

    /// Whether all that a patch leads to is there.
    fn is_sound(&self, patch: &Patch) -> bool {
        let Some(face) = self.skeleton.faces.get(patch.face as usize) else {
            return false;
        };
        let begins = |at: u16, size: u16| SPAN * usize::from(at) < usize::from(size);
        if !(begins(patch.column, face.size[0]) && begins(patch.row, face.size[1])) {
            return false;
        }
        let fan = patch.fan(face.size);
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

impl Face {
    /// Whether a surface has it, at rates that can be.
    fn is_of(&self, surface: &Surface) -> bool {
        let base = surface.base();
        let most = MOST_SEGMENTS as u16;
        let [nu, nv] = self.size;
        let beside = [nu, nv, nu, nv];
        let rates = self.segments.iter().zip(beside);
        self.face < base.faces()
            && self.size.iter().all(|n| (1..=most).contains(n))
            && rates
                .into_iter()
                .all(|(&n, beside)| (1..=beside).contains(&n))
    }
}

impl Node {
    /// Where a block starts, in [`UNIT`]s: [`Node::block`] that cannot wrap around.
    fn start(&self, block: usize) -> u64 {
        let before = self.sizes[..block].iter().map(|&size| u64::from(size));
        u64::from(self.data) + before.sum::<u64>()
    }
}
