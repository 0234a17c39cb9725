//! What trees that are walked in lanes have in common: a ray goes in, and a hit comes out, or whether there is any; all
//! between is compiled for the instruction set that was chosen.

use super::lattice::{Lattice, LatticeRay};
use super::moment::Moment;
use super::simd::{Body, Isa, Lanes};
use super::top::{Child, Top};
use super::waiting::{Place, Stack, Waiting};
use super::{Hit, Intersector};
use crate::math::{Bounds3, Ray};

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

/// What all trees over patches are made of.
pub(super) struct Trunk<'t> {
    pub(super) isa: Isa,
    pub(super) keys: u32,
    pub(super) lattice: &'t Lattice,
    pub(super) top: &'t Top,
}

/// A tree that has all that its rays ask for, and so is a traversal and an intersector of a single primitive.
pub(super) trait Tree: Send + Sync {
    /// As in [`Traversal`].
    type Met;
    /// A ray on its way through it.
    type Walk<'a, const ANY: bool, const MOVES: bool>: Visitor<MOVES, Met = Self::Met>
    where
        Self: 'a;
    /// What it has of the above.
    fn trunk(&self) -> Trunk<'_>;
    /// A ray at the root; none if there is nothing in the tree.
    fn walk<'a, const ANY: bool, const MOVES: bool>(
        &'a self,
        moment: &'a Moment,
        ray: &Ray,
    ) -> Option<Self::Walk<'a, ANY, MOVES>>;
    /// All that is to be known of a place that a ray met.
    fn hit_on(&self, ray: &Ray, met: &Self::Met) -> Hit;
    /// Bytes held.
    fn bytes(&self) -> usize;
}

impl<T: Tree> Traversal for &T {
    type Met = T::Met;

    #[inline(always)]
    fn isa(&self) -> Isa {
        self.trunk().isa
    }

    #[inline(always)]
    fn moves(&self) -> bool {
        self.trunk().keys > 1
    }

    #[inline(always)]
    fn meet<L: Lanes, const ANY: bool, const MOVES: bool>(
        &mut self,
        lanes: L,
        ray: &Ray,
    ) -> Option<T::Met> {
        let Trunk { keys, top, .. } = self.trunk();
        let moment = Moment::new(keys, ray.time);
        let mut walk = self.walk::<ANY, MOVES>(&moment, ray)?;
        visit::<L, _, ANY, MOVES>(lanes, top.root()?, &mut walk)
    }

    #[inline(always)]
    fn hit<L: Lanes, const MOVES: bool>(&mut self, _lanes: L, ray: &Ray, met: &T::Met) -> Hit {
        self.hit_on(ray, met)
    }
}

impl<T: Tree> Intersector for T {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.trunk().keys
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        let Trunk { lattice, top, .. } = self.trunk();
        lattice.bounds(&top.extent(key as usize))
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        nearest(&mut &*self, ray)
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        any(&mut &*self, ray)
    }

    fn memory(&self) -> usize {
        self.bytes()
    }
}

/// A tree as a ray sees it.
pub(super) struct Way<'w> {
    pub(super) top: &'w Top,
    pub(super) moment: &'w Moment,
    /// What the ray asks about ends at the nearest hit so far.
    pub(super) ray: &'w LatticeRay,
}

/// A ray on its way through a tree, which `MOVES` if it has more than one motion key.
pub(super) trait Visitor<const MOVES: bool> {
    /// Where it meets what is in the tree.
    type Met;
    /// Where it is on its way.
    fn way(&self) -> Way<'_>;
    /// Of a node's children the nearest; the others wait.
    #[inline(always)]
    fn node<L: Lanes>(&mut self, lanes: L, node: u32, stack: &mut Stack) -> Option<Waiting> {
        let Way { top, moment, ray } = self.way();
        top.enter::<L, MOVES>(lanes, node, moment, ray, stack)
    }
    /// Comes to a patch, which begins at `near`.
    fn patch<L: Lanes>(
        &mut self,
        lanes: L,
        patch: u32,
        near: f32,
        stack: &mut Stack,
    ) -> Found<Self::Met>;
    /// Comes to a part of the patch at hand, if patches have parts.
    fn part<L: Lanes>(&mut self, _lanes: L, _part: usize, _stack: &mut Stack) -> Found<Self::Met> {
        Found::Next(None)
    }
}

/// What there is in a patch, or in a part of one.
pub(super) enum Found<M> {
    /// A place to go on to at once, if there is one.
    Next(Option<Waiting>),
    /// Something that the ray meets.
    Met(M),
}

impl<M> From<Option<M>> for Found<M> {
    #[inline(always)]
    fn from(met: Option<M>) -> Self {
        match met {
            Some(met) => Self::Met(met),
            None => Self::Next(None),
        }
    }
}

/// Goes through a tree from its root on: to the nearest place that the ray meets, or to `ANY` one.
#[inline(always)]
pub(super) fn visit<L: Lanes, V: Visitor<MOVES>, const ANY: bool, const MOVES: bool>(
    lanes: L,
    root: Child,
    visitor: &mut V,
) -> Option<V::Met> {
    let mut nearest = None;
    let mut stack = Stack::default();
    let mut next = Some(Waiting::child(0.0, root));
    while let Some(at) = next {
        let found = match at.place() {
            Place::Node(node) => Found::Next(visitor.node(lanes, node, &mut stack)),
            Place::Patch(patch) => visitor.patch(lanes, patch, at.near(), &mut stack),
            Place::Part(part) => visitor.part(lanes, part, &mut stack),
        };
        next = match found {
            Found::Next(next) => next,
            Found::Met(met) => {
                nearest = Some(met);
                if ANY {
                    return nearest;
                }
                None
            }
        };
        if next.is_none() {
            next = stack.next(visitor.way().ray.t_max);
        }
    }
    nearest
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
        tree.isa().run(Nearby::<T, true>(tree, ray))
    } else {
        tree.isa().run(Nearby::<T, false>(tree, ray))
    }
}

#[cfg(test)]
struct Nearby<'a, T, const MOVES: bool>(&'a mut T, &'a Ray);

#[cfg(test)]
impl<T: Traversal, const MOVES: bool> Body for Nearby<'_, T, MOVES> {
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
