//! A tessellation cache: patches are diced when a ray first visits them, into memory of a fixed size.
//!
//! After Benthin, Woop, Nießner, Selgrad, Wald, "Efficient Ray Tracing of Subdivision Surfaces using Tessellation
//! Caching", High Performance Graphics 2015: one cache for all surfaces and threads, an entry for each patch, looked up
//! by one load and one compare, and given up segment by segment, the oldest first ([`segments`]).
//!
//! ```text
//!   always there   tree over patches, 9 bytes a patch       where each patch is, 12        its entry, 8
//!   in the cache   node, 128 bytes for up to 28 x 28 quads, and blocks of 7 x 7: what `compact` keeps of the patch
//!   on a miss      dice the patch, round it to the lattice, pack it, put it in place, go on with the same ray
//! ```
//!
//! What is traced are the micro-triangles of the diced surface as [`Compact`](super::Compact) has them, to the bit, and
//! so they are as far from the displaced limit surface: a micro-quad's chord, and [`Accuracy`]. What faces share is
//! evaluated anew with each patch, always by its owner: the same bits whoever asks, whatever is in the cache, so there
//! are no cracks and pictures do not depend on the size of the cache, on threads or on the order of rays.
//!
//! We differ from the paper in this: what is cached is quantised, at about a byte a micro-triangle instead of 16 bytes a
//! vertex, so that the same memory holds ten times the surface; and nobody is stopped when a segment is given up. As
//! in the paper, each patch is diced once before the first ray, to know its box. Certified bounds
//! ([`Surface::bounds`]) take a tenth of the time on smooth displacement, and two fifths where it is rough; but there
//! they are so wide that rays visit several times as many patches, and are traced at a third of the speed.

mod build;
mod dice;
#[cfg(test)]
mod tests;

use std::sync::{Arc, Mutex};

use segments::{Asked, Cache, Entries, Line, Visit};

use super::compact::{Accuracy, Patches, Skeleton, Through, View};
use super::traversal::{any, nearest};
use super::{Hit, Intersector};
use crate::math::{Bounds3, Ray};
use crate::stats::CacheUse;
use crate::surface::{SharedSamples, Surface};
use dice::{Dicer, LINES_OF_NODE, Part, Room};

/// Bytes of a tessellation cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CacheSize(pub usize);

impl Default for CacheSize {
    /// 128 MB: some hundred million micro-triangles.
    fn default() -> Self {
        Self(128 << 20)
    }
}

/// What a cache was asked for so far.
pub fn cache_use(cache: &Cache) -> CacheUse {
    let Asked { hits, built, kept } = cache.asked();
    CacheUse {
        bytes: cache.bytes(),
        hits,
        diced: built,
        kept,
    }
}

/// A surface whose patches are diced when rays come to them.
pub struct Cached {
    skeleton: Skeleton,
    surface: Arc<Surface>,
    /// Vertices, by motion key.
    shared: Vec<SharedSamples>,
    entries: Entries,
    /// Room to dice in, by the visitor's slot.
    rooms: Box<[Mutex<Option<Box<Room>>>]>,
    accuracy: Accuracy,
}

impl Cached {
    /// How far micro-vertices are moved.
    pub fn accuracy(&self) -> Accuracy {
        self.accuracy
    }

    fn visiting(&self) -> Visiting<'_> {
        Visiting {
            cached: self,
            visit: self.entries.visit(),
            room: None,
            holds: None,
        }
    }
}

/// A ray's visit to the cache.
struct Visiting<'a> {
    cached: &'a Cached,
    visit: Visit<'a>,
    room: Option<Box<Room>>,
    /// The patch that the room holds.
    holds: Option<u32>,
}

impl<'s> Patches<'s> for Visiting<'s> {
    #[inline(always)]
    fn skeleton(&self) -> &'s Skeleton {
        &self.cached.skeleton
    }

    #[inline(always)]
    fn enter(&mut self, number: u32) -> View<'_> {
        if self.visit.found(number as usize) {
            let cached = self.cached;
            return cached.view(
                number,
                (self.visit).get(number as usize).expect("it was found"),
            );
        }
        self.miss(number)
    }
}

impl Visiting<'_> {
    /// Dices a patch, unless it was diced last.
    #[cold]
    #[inline(never)]
    fn miss(&mut self, number: u32) -> View<'_> {
        let cached = self.cached;
        let slot = self.visit.slot();
        let room = self.room.get_or_insert_with(|| cached.room(slot));
        let Room { work, lines } = &mut **room;
        if self.holds == Some(number) {
            return cached.view(number, lines);
        }
        // Whatever becomes of it, a patch that somebody else put in place meanwhile leaves the room as it is.
        self.holds = None;
        let mut made = false;
        let built = self.visit.build(number as usize, lines, |lines| {
            let part = Part::new(&cached.skeleton, number);
            cached.dicer().pack(&part, work, lines);
            made = true;
        });
        if made {
            self.holds = Some(number);
        }
        cached.view(number, built)
    }
}

impl Drop for Visiting<'_> {
    #[inline]
    fn drop(&mut self) {
        if let Some(room) = self.room.take()
            && let Some(slot) = self.visit.slot()
            && let Ok(mut kept) = self.cached.rooms[slot].try_lock()
        {
            *kept = Some(room);
        }
    }
}

impl Cached {
    /// The room of a slot, which nobody else asks for.
    fn room(&self, slot: Option<usize>) -> Box<Room> {
        let kept = slot.and_then(|slot| self.rooms[slot].try_lock().ok()?.take());
        kept.unwrap_or_default()
    }

    fn dicer(&self) -> Dicer<'_> {
        Dicer {
            surface: &self.surface,
            shared: &self.shared,
            lattice: self.skeleton.lattice,
        }
    }

    /// A patch by its lines.
    #[inline(always)]
    fn view<'v>(&self, number: u32, lines: &'v [Line]) -> View<'v> {
        let skeleton = &self.skeleton;
        let fan = skeleton.patches[number as usize].fan();
        let nodes = if skeleton.has_node(&fan) {
            skeleton.keys as usize
        } else {
            0
        };
        let (nodes, data) = lines.split_at(nodes * LINES_OF_NODE);
        View {
            nodes: bytemuck::cast_slice(nodes),
            data: bytemuck::cast_slice(data),
            start: 0,
            fan,
        }
    }
}

impl Intersector for Cached {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.skeleton.keys
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        self.skeleton.bounds(key)
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        nearest(&mut Through(self.visiting()), ray)
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        any(&mut Through(self.visiting()), ray)
    }

    fn memory(&self) -> usize {
        let shared: usize = self.shared.iter().map(SharedSamples::memory).sum();
        let rooms = size_of_val(&*self.rooms);
        self.skeleton.memory() + shared + self.entries.memory() + rooms
    }
}
