//! Trees that are kept in a store.

use crate::error::{Fault, Result};
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
