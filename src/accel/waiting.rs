//! What a ray has yet to visit, below a tree over patches: nodes, patches, and the parts of the patch at hand.
//!
//! Of the children that a node's boxes let through, the nearest is visited at once and the others wait, nearest on top.

use arrayvec::ArrayVec;

use super::top::{Child, MOST_LEVELS};

/// What waits to be visited: each level leaves fifteen of its children behind.
const MOST_WAITING: usize = 15 * (MOST_LEVELS + 1) + 1;

/// An entry of the stack: where the ray enters, above the place; so that integers compare as distances do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Waiting(u64);

/// What waits.
pub(super) enum Place {
    Node(u32),
    Patch(u32),
    /// A part of the patch at hand, by its place in it.
    Part(usize),
}

impl Waiting {
    const PATCH: u32 = 1 << 31;
    const NODE: u32 = 1 << 30;

    #[inline(always)]
    pub(super) fn child(near: f32, child: Child) -> Self {
        let place = match child {
            Child::Patch(patch) => Self::PATCH | patch,
            Child::Node(node) => Self::NODE | node,
        };
        Self(u64::from(near.to_bits()) << 32 | u64::from(place))
    }
    #[inline(always)]
    pub(super) fn part(near: f32, part: usize) -> Self {
        Self(u64::from(near.to_bits()) << 32 | part as u64)
    }
    #[inline(always)]
    pub(super) fn near(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }
    #[inline(always)]
    fn is_part(self) -> bool {
        self.0 as u32 & (Self::PATCH | Self::NODE) == 0
    }
    #[inline(always)]
    pub(super) fn place(self) -> Place {
        let place = self.0 as u32;
        if place & Self::PATCH != 0 {
            Place::Patch(place & !Self::PATCH)
        } else if place & Self::NODE != 0 {
            Place::Node(place & !Self::NODE)
        } else {
            Place::Part(place as usize)
        }
    }
}

/// Takes the lowest of the bits that are set.
#[inline(always)]
fn take(bits: &mut u32) -> Option<usize> {
    let lowest = (*bits != 0).then(|| bits.trailing_zeros() as usize);
    *bits &= bits.wrapping_sub(1);
    lowest
}

/// What is to be visited, the nearest of each node's children on top.
#[derive(Default)]
pub(super) struct Stack(ArrayVec<Waiting, MOST_WAITING>);

impl Stack {
    /// The nearest of children, which are given by bits; the others are put aside.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        mut children: u32,
        waiting: impl Fn(usize) -> Waiting,
    ) -> Option<Waiting> {
        let first = waiting(take(&mut children)?);
        // One or two are the most frequent by far, and are put in order without a branch.
        let Some(second) = take(&mut children).map(&waiting) else {
            return Some(first);
        };
        let (mut nearest, farther) = (first.min(second), first.max(second));
        let bottom = self.0.len();
        self.0.push(farther);
        while let Some(child) = take(&mut children).map(&waiting) {
            let farther = nearest.max(child);
            nearest = nearest.min(child);
            self.0.push(farther);
            let mut at = self.0.len() - 1;
            while at > bottom && self.0[at - 1] < farther {
                self.0[at] = self.0[at - 1];
                at -= 1;
            }
            self.0[at] = farther;
        }
        Some(nearest)
    }

    /// The same of parts alone, which lie above everything else.
    #[inline(always)]
    pub(super) fn next_part(&mut self, t_max: f32) -> Option<Waiting> {
        while let Some(&waiting) = self.0.last()
            && waiting.is_part()
        {
            self.0.pop();
            if waiting.near() <= t_max {
                return Some(waiting);
            }
        }
        None
    }

    /// The nearest of those that begin by `t_max`; what begins later is dropped.
    #[inline(always)]
    pub(super) fn next(&mut self, t_max: f32) -> Option<Waiting> {
        loop {
            let waiting = self.0.pop()?;
            if waiting.near() <= t_max {
                return Some(waiting);
            }
        }
    }
}
