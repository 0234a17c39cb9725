//! What trees that are walked in lanes have in common: a ray goes in, and a hit comes out, or whether there is any; all
//! between is compiled for the instruction set that was chosen.

use super::Hit;
use super::simd::{Body, Isa, Lanes};
use crate::math::Ray;

/// A tree that is walked in lanes. Methods with lanes are `#[inline(always)]`, and so is all that they call.
pub(super) trait Traversal {
    /// Where a ray meets what is in the tree.
    type Met;
    /// The instruction set to walk with.
    fn isa(&self) -> Isa;
    /// Whether there is more than one motion key.
    fn moves(&self) -> bool;
    /// The nearest place where a ray meets anything, or `ANY` one. `MOVES` is what [`moves`](Self::moves) says.
    fn meet<L: Lanes, const ANY: bool, const MOVES: bool>(
        &mut self,
        lanes: L,
        ray: &Ray,
    ) -> Option<Self::Met>;
    /// All that is to be known of the nearest place.
    fn hit<L: Lanes, const MOVES: bool>(&mut self, lanes: L, ray: &Ray, met: &Self::Met) -> Hit;
}

/// The nearest hit.
#[inline]
pub(super) fn nearest<T: Traversal>(tree: &mut T, ray: &Ray) -> Option<Hit> {
    if tree.moves() {
        tree.isa().run(Nearest::<T, true>(tree, ray))
    } else {
        tree.isa().run(Nearest::<T, false>(tree, ray))
    }
}

/// Whether there is any.
#[inline]
pub(super) fn any<T: Traversal>(tree: &mut T, ray: &Ray) -> bool {
    if tree.moves() {
        tree.isa().run(Any::<T, true>(tree, ray))
    } else {
        tree.isa().run(Any::<T, false>(tree, ray))
    }
}

/// The nearest place itself.
#[cfg(test)]
pub(super) fn place<T: Traversal>(tree: &mut T, ray: &Ray) -> Option<T::Met> {
    if tree.moves() {
        tree.isa().run(Place::<T, true>(tree, ray))
    } else {
        tree.isa().run(Place::<T, false>(tree, ray))
    }
}

#[cfg(test)]
struct Place<'a, T, const MOVES: bool>(&'a mut T, &'a Ray);

#[cfg(test)]
impl<T: Traversal, const MOVES: bool> Body for Place<'_, T, MOVES> {
    type Output = Option<T::Met>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<T::Met> {
        let Self(tree, ray) = self;
        tree.meet::<L, false, MOVES>(lanes, ray)
    }
}

struct Nearest<'a, T, const MOVES: bool>(&'a mut T, &'a Ray);

impl<T: Traversal, const MOVES: bool> Body for Nearest<'_, T, MOVES> {
    type Output = Option<Hit>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<Hit> {
        let Self(tree, ray) = self;
        let met = tree.meet::<L, false, MOVES>(lanes, ray)?;
        Some(tree.hit::<L, MOVES>(lanes, ray, &met))
    }
}

struct Any<'a, T, const MOVES: bool>(&'a mut T, &'a Ray);

impl<T: Traversal, const MOVES: bool> Body for Any<'_, T, MOVES> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> bool {
        let Self(tree, ray) = self;
        tree.meet::<L, true, MOVES>(lanes, ray).is_some()
    }
}
