//! A compressed surface as sections of a store, and back.
//!
//! ```text
//!   facts     one `Facts`: lattice, keys, how thick slabs are
//!   faces     16 bytes a face that is not a hole
//!   top       128 bytes a node of the tree over patches, key by key
//!   patches   12 bytes each
//!   fans      112 bytes each
//!   tiles     96 bytes each
//! ```

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::Compressed;
use super::patch::{Patch, first, patches};
use crate::accel::simd::Isa;
use crate::accel::stored::{Ground, Keep, Stored};
use crate::accel::top::Top;
use crate::error::{Fault, Result};
use crate::stats::AchievedError;
use crate::store::Sections;
use crate::surface::Surface;

/// Everything that is one of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Facts {
    ground: Ground,
    thickest: f64,
    thick_rms: f64,
    leaves: u64,
    /// 0 where it is not known.
    thickest_in_pixels: f64,
}

impl Stored for Compressed {
    fn store(&self, keep: &mut Keep<'_>) -> Result<()> {
        let facts = Facts {
            ground: Ground::new(&self.lattice, self.reach, self.keys, self.left_handed),
            thickest: self.thick.max_diagonals,
            thick_rms: self.thick.rms_diagonals,
            leaves: self.thick.vertices,
            thickest_in_pixels: self.thick.max_pixels.unwrap_or(0.0),
        };
        keep(&[
            ("facts", bytemuck::bytes_of(&facts)),
            ("faces", bytemuck::cast_slice(&self.faces)),
            ("top", bytemuck::cast_slice(self.top.nodes())),
            ("patches", bytemuck::cast_slice(&self.patches)),
            ("fans", bytemuck::cast_slice(&self.fans)),
            ("tiles", bytemuck::cast_slice(&self.tiles)),
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
        let tree = Self {
            isa: Isa::best(),
            lattice: ground.lattice(),
            reach: ground.reach,
            keys: ground.keys,
            left_handed: surface.base().left_handed(),
            faces: sections.items("faces")?,
            top: top.ok_or_else(|| wrong("the tree over patches is"))?,
            patches,
            fans: sections.items("fans")?,
            tiles: sections.items("tiles")?,
            thick: AchievedError {
                max_diagonals: facts.thickest,
                rms_diagonals: facts.thick_rms,
                max_pixels: (facts.thickest_in_pixels > 0.0).then_some(facts.thickest_in_pixels),
                linear_normals: None,
                vertices: facts.leaves,
            },
        };
        if !tree.faces.iter().all(|face| face.is_of(surface)) {
            return Err(wrong("a face is"));
        }
        if !tree.patches.par_iter().all(|patch| tree.is_sound(patch)) {
            return Err(wrong("a patch is"));
        }
        if !ground.is_around(&tree.top) {
            return Err(wrong("the lattice is"));
        }
        Ok(tree)
    }
}

impl Compressed {
    /// Whether all that a patch leads to is there.
    fn is_sound(&self, patch: &Patch) -> bool {
        let Some(face) = self.faces.get(patch.face as usize) else {
            return false;
        };
        let fits = (0..2).all(|k| {
            let (place, size) = (usize::from(patch.place[k]), usize::from(face.size[k]));
            place < patches(size)
                && usize::from(patch.quads[k]) == first(place + 1, size) - first(place, size)
        });
        if !fits {
            return false;
        }
        let (root, keys) = (patch.root as usize, self.keys as usize);
        let all = root..root + keys;
        if patch.is_single() {
            return all.end <= self.tiles.len();
        }
        let [columns, rows] = patch.tiles();
        self.fans.get(all).is_some_and(|fans| {
            fans.iter().all(|fan| {
                fan.boxes.is_sound() && fan.first as usize + columns * rows <= self.tiles.len()
            })
        })
    }
}
