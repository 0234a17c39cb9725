//! Trees that are kept in a store.

use bytemuck::{Pod, Zeroable};

use super::lattice::Lattice;
use super::top::Top;
use crate::error::{Fault, Result};
use crate::math::Vec3;
use crate::store::Sections;
use crate::surface::Surface;

/// What takes sections by their names.
pub type Keep<'a> = dyn FnMut(&[(&str, &[u8])]) -> Result<()> + 'a;

/// A tree that is sections of a store, too.
///
/// Whatever a traversal takes as an index, a size or a shift is checked before anything is traced: a file may come from
/// anywhere. What is but a coordinate is not: wrong ones make a wrong picture, and nothing worse.
pub trait Stored: Sized {
    /// Gives all of it to `keep`.
    ///
    /// # Errors
    /// Those of `keep`.
    fn store(&self, keep: &mut Keep<'_>) -> Result<()>;

    /// That of a surface, from a store.
    ///
    /// # Errors
    /// If it is not one that was built of such a surface.
    fn stored(surface: &Surface, sections: &Sections<'_>) -> Result<Self, Fault>;
}

/// Where a tree over patches is, and of what surface.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ground {
    anchor: [f32; 3],
    step: f32,
    pub(super) reach: f32,
    pub(super) keys: u32,
    left_handed: u32,
    zero: u32,
}

impl Ground {
    pub(super) fn new(lattice: &Lattice, reach: f32, keys: u32, left_handed: bool) -> Self {
        Self {
            anchor: lattice.anchor.to_array(),
            step: lattice.step,
            reach,
            keys,
            left_handed: left_handed.into(),
            zero: 0,
        }
    }

    pub(super) fn lattice(&self) -> Lattice {
        Lattice {
            anchor: Vec3::from(self.anchor),
            step: self.step,
        }
    }

    /// Whether a surface can have it.
    pub(super) fn is_of(&self, surface: &Surface) -> bool {
        let base = surface.base();
        let lattice = self.lattice();
        self.keys == base.keys()
            && self.left_handed == u32::from(base.left_handed())
            && lattice.anchor.is_finite()
            && lattice.step.is_normal()
            && lattice.step > 0.0
            && self.reach.is_finite()
            && self.reach >= 0.0
    }

    /// Whether what is in the tree has bounds in the world.
    pub(super) fn is_around(&self, top: &Top) -> bool {
        (0..self.keys as usize).all(|key| {
            let bounds = self.lattice().bounds(&top.extent(key));
            bounds.is_empty() || bounds.min.is_finite() && bounds.max.is_finite()
        })
    }
}
