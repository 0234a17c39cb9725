//! A cache of fixed size for many threads, which gives up what is oldest segment by segment.
//!
//! ```text
//!   buffer    | 32 | 33 | 34 | .. | 41 | 26 | 27 | .. | 31 |      16 segments, by the time at which they began
//!               live                 ^^  going, filled next
//!   entry     time | offset | lines | busy                       a word for whatever may be cached
//! ```
//!
//! A look-up is one load and one compare: what was put in place recently enough is there. Lines are given out by one
//! addition. When a segment is full the oldest is taken for the next one, as soon as all who might look at it have moved
//! on; nobody is stopped for that and nobody waits for it. Who finds no room, or finds that somebody else is building the
//! same entry, keeps what it built to itself. No lock is held and nothing is looked at while something is built: building
//! may itself visit the cache.
//!
//! After Benthin, Woop, Nießner, Selgrad, Wald, "Efficient Ray Tracing of Subdivision Surfaces using Tessellation
//! Caching", High Performance Graphics 2015, and Embree 2's implementation: one buffer in segments, tags with a time, and
//! one addition to allocate are theirs. Theirs stops all readers to begin a segment; here they show the time at which
//! they came, and a segment begins once none shows too early a one (see `protocol`).

#[cfg(test)]
mod model;
mod protocol;

use std::cell::UnsafeCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::{Pod, Zeroable};

use protocol::{Protocol, Tag, Visitor};

/// Segments of a cache, and how many of them a visitor may fall behind.
const SEGMENTS: u64 = 16;
const LAG: u64 = 2;

/// Visitors at a time that a cache serves; others build what they want for themselves.
pub const SLOTS: usize = 256;

/// What a cache is made of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Line(pub [u64; 8]);

/// The memory, shared by all [`Entries`] that were made for it.
pub struct Cache {
    protocol: Protocol<SEGMENTS, LAG>,
    lines: Box<[Slot<Line>]>,
    counts: Box<[Counts]>,
}

/// A line that the protocol says when to touch.
#[repr(transparent)]
struct Slot<T>(UnsafeCell<T>);

// SAFETY: plain numbers, which are touched as the protocol says: written to by one thread while nobody else looks at
// them, then read only.
unsafe impl<T: Send> Sync for Slot<T> {}

/// What was asked for, by the slots of those who asked.
#[derive(Default)]
#[repr(align(64))]
struct Counts {
    hits: AtomicU64,
    built: AtomicU64,
    kept: AtomicU64,
}

/// What a cache was asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Asked {
    /// Entries that were there.
    pub hits: u64,
    /// Entries that had to be built.
    pub built: u64,
    /// Those of them that found room.
    pub kept: u64,
}

impl Cache {
    /// Of about so many bytes, at most.
    pub fn new(bytes: usize) -> Self {
        let segment = (bytes / size_of::<Line>() / SEGMENTS as usize).max(1);
        let lines = bytemuck::zeroed_slice_box::<Line>(SEGMENTS as usize * segment);
        let lines = Box::into_raw(lines) as *mut [Slot<Line>];
        Self {
            protocol: Protocol::new(segment, SLOTS),
            // SAFETY: a slot is a transparent wrapper of an `UnsafeCell` of a line, which has the layout of a line.
            lines: unsafe { Box::from_raw(lines) },
            counts: (0..SLOTS).map(|_| Counts::default()).collect(),
        }
    }

    /// Bytes of its lines.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.lines)
    }

    /// What it was asked for so far by visits that have ended.
    pub fn asked(&self) -> Asked {
        self.counts.iter().fold(Asked::default(), |sum, counts| {
            let get = |count: &AtomicU64| count.load(Ordering::Relaxed);
            Asked {
                hits: sum.hits + get(&counts.hits),
                built: sum.built + get(&counts.built),
                kept: sum.kept + get(&counts.kept),
            }
        })
    }
}

impl std::fmt::Debug for Cache {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cache")
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}

/// What may be in a cache, by number.
pub struct Entries {
    cache: Arc<Cache>,
    tags: Box<[Tag]>,
}

impl Entries {
    /// So many, none of which is there yet.
    pub fn new(cache: Arc<Cache>, count: usize) -> Self {
        Self {
            cache,
            tags: (0..count).map(|_| Tag::default()).collect(),
        }
    }

    /// Where they are kept.
    pub fn cache(&self) -> &Arc<Cache> {
        &self.cache
    }

    /// Bytes held beside the cache.
    pub fn memory(&self) -> usize {
        size_of_val(&*self.tags)
    }

    /// Begins a visit. What it finds stays there until it moves on, so it should be short: a ray.
    #[inline]
    pub fn visit(&self) -> Visit<'_> {
        Visit {
            entries: self,
            visitor: self.cache.protocol.enter(hint()),
            asked: Asked::default(),
        }
    }
}

/// Where the search for a slot starts: by thread, so that each finds its own again.
#[inline]
fn hint() -> usize {
    thread_local!(static HERE: u8 = const { 0 });
    let here = HERE.with(|here| std::ptr::from_ref(here).addr());
    // Fibonacci hashing: threads' memories lie at distances with many zeros.
    ((here as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize
}

/// A thread that looks at entries.
pub struct Visit<'a> {
    entries: &'a Entries,
    visitor: Visitor,
    asked: Asked,
}

impl Visit<'_> {
    /// An entry that is there.
    ///
    /// # Panics
    /// If there is no such entry.
    #[inline(always)]
    pub fn get(&self, entry: usize) -> Option<&[Line]> {
        let place = (self.entries.cache.protocol).find(&self.visitor, &self.entries.tags[entry])?;
        let lines = &self.entries.cache.lines[place.first..][..place.lines];
        // SAFETY: whoever put the entry there wrote these lines before it published them, and the protocol lets nobody
        // write to them until this visitor renews, rests or leaves. All of that takes `&mut self`, which outlives the
        // slice. The layout is that of lines.
        Some(unsafe { std::slice::from_raw_parts(lines.as_ptr().cast::<Line>(), lines.len()) })
    }

    /// Its slot, below [`SLOTS`], which is nobody else's meanwhile; none if there are too many visitors.
    pub fn slot(&self) -> Option<usize> {
        self.visitor.slot()
    }

    /// Whether an entry is there, which is counted. It stays there for as long as the visitor does not build.
    #[inline(always)]
    pub fn found(&mut self, entry: usize) -> bool {
        let found = self.get(entry).is_some();
        if found {
            self.asked.hits += 1;
        }
        found
    }

    /// Builds an entry that was not there: `make` makes it in `room`, which is empty. Nothing is locked and nothing
    /// looked at meanwhile. Puts it into the cache, unless somebody else builds it too or there is no room without
    /// waiting.
    ///
    /// # Panics
    /// If there is no such entry, or `make` does.
    pub fn build<'v>(
        &'v mut self,
        entry: usize,
        room: &'v mut Vec<Line>,
        make: impl FnOnce(&mut Vec<Line>),
    ) -> &'v [Line] {
        let protocol = &self.entries.cache.protocol;
        let building = Building::of(&self.entries.tags[entry]);
        // Somebody may just have built it.
        if building.is_some() && self.found(entry) {
            drop(building);
            return self.get(entry).expect("it stays while it is looked at");
        }
        self.asked.built += 1;
        protocol.rest(&mut self.visitor);
        room.clear();
        make(room);
        protocol.renew(&mut self.visitor);
        if let Some(building) = building
            && let Some(place) = protocol.allocate(&self.visitor, room.len())
        {
            let to = &self.entries.cache.lines[place.first..][..place.lines];
            for (to, line) in to.iter().zip(room.iter()) {
                // SAFETY: the protocol gave these lines to this visitor alone: nobody looks at them or writes to them
                // until they are published.
                unsafe { to.0.get().write(*line) };
            }
            building.publish(place);
            self.asked.kept += 1;
        }
        room
    }
}

impl Drop for Visit<'_> {
    #[inline]
    fn drop(&mut self) {
        if let Some(slot) = self.visitor.slot() {
            // The slot is this visitor's until it leaves.
            let counts = &self.entries.cache.counts[slot];
            let add = |count: &AtomicU64, more: u64| {
                if more > 0 {
                    count.store(count.load(Ordering::Relaxed) + more, Ordering::Relaxed);
                }
            };
            add(&counts.hits, self.asked.hits);
            add(&counts.built, self.asked.built);
            add(&counts.kept, self.asked.kept);
        }
        self.entries.cache.protocol.leave(&mut self.visitor);
    }
}

/// The right to build an entry, given back when it is dropped.
struct Building<'a>(Option<&'a Tag>);

impl<'a> Building<'a> {
    fn of(tag: &'a Tag) -> Option<Self> {
        tag.try_lock().then_some(Self(Some(tag)))
    }

    fn publish(mut self, place: protocol::Place) {
        if let Some(tag) = self.0.take() {
            tag.publish(place);
        }
    }
}

impl Drop for Building<'_> {
    fn drop(&mut self) {
        if let Some(tag) = self.0 {
            tag.unlock();
        }
    }
}
