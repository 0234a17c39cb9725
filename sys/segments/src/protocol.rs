//! Who may read, write and reuse which lines, and when. No memory is touched here but atomics.
//!
//! Time counts segments: segment t lies in region t mod `SEGMENTS`, so that it takes the place of segment
//! t - `SEGMENTS`. What was put in place at time t is good for whoever came at time e if t >= e - kept.
//!
//! Every visitor shows the time at which it came. Segment t may begin when no visitor shows less than t - `LAG`: the
//! oldest that these may look at is t - `LAG` - kept, which is younger than what goes. With `LAG` of 2 a visitor
//! may stay while a whole segment is filled. Nobody waits: who finds that time cannot go on does without the cache.
//!
//! A visitor shows its time, then looks whether it still is that time; who begins a segment has stored the time before,
//! then looks at the visitors. All four accesses are sequentially consistent: either the visitor is seen, or it sees
//! that time and shows that. loom knows no such order of accesses, but of fences: there these stand in for it.

#[cfg(not(test))]
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

#[cfg(test)]
use loom::sync::atomic::{AtomicBool, AtomicU64, Ordering, fence};

/// Bits of a tag that hold a number of lines.
const LENGTH_BITS: u32 = 12;

/// The lowest bit of a tag: someone builds.
const BUSY: u64 = 1;

/// In a slot: nobody, and somebody who looks at nothing. Later than any time.
const FREE: u64 = u64::MAX;
const AWAY: u64 = u64::MAX - 1;

/// On cache lines of its own, and the ones that are fetched with them.
#[repr(align(128))]
struct Padded<T>(T);

/// See the head of the file. `SEGMENTS` is a power of two.
pub(crate) struct Protocol<const SEGMENTS: u64, const LAG: u64> {
    /// Lines of a segment.
    segment: u64,
    /// Bits of a tag below its time.
    tag_bits: u32,
    /// Bits of `next` below its time.
    next_bits: u32,
    /// The time, and how many lines of its segment are taken, or were asked for.
    next: Padded<AtomicU64>,
    /// The time. A moment behind that of `next` while a segment begins.
    time: Padded<AtomicU64>,
    switching: AtomicBool,
    /// The times that visitors show.
    slots: Box<[Padded<AtomicU64>]>,
}

/// What an entry holds: where its lines are, since when, and whether someone builds it.
pub(crate) struct Tag(AtomicU64);

/// Lines that were found, or given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Place {
    /// The first one, counted through all regions.
    pub(crate) first: usize,
    /// How many.
    pub(crate) lines: usize,
    tag: u64,
}

/// A visitor.
#[derive(Debug)]
pub(crate) struct Visitor {
    /// None if there were too many.
    slot: Option<usize>,
    /// The least tag that is good.
    floor: u64,
}

impl Default for Tag {
    fn default() -> Self {
        Self(AtomicU64::new(0))
    }
}

impl Tag {
    /// Whether nobody builds it; now the caller does, and must [`unlock`](Self::unlock) it or publish.
    pub(crate) fn try_lock(&self) -> bool {
        self.0.fetch_or(BUSY, Ordering::Acquire) & BUSY == 0
    }

    /// Ends what [`try_lock`](Self::try_lock) began.
    pub(crate) fn unlock(&self) {
        self.0.fetch_and(!BUSY, Ordering::Release);
    }

    /// The same, with what was built; its lines are written.
    pub(crate) fn publish(&self, place: Place) {
        self.0.swap(place.tag, Ordering::Release);
    }
}

impl Visitor {
    /// Its slot, which is nobody else's; none if there were too many visitors.
    pub(crate) fn slot(&self) -> Option<usize> {
        self.slot
    }
}

impl<const SEGMENTS: u64, const LAG: u64> Protocol<SEGMENTS, LAG> {
    /// How much older than a visitor that may be which it looks at.
    const KEPT: u64 = SEGMENTS - 1 - LAG;

    /// With segments of so many lines, at least 1, for so many visitors at a time: a power of two.
    pub(crate) fn new(segment: usize, slots: usize) -> Self {
        assert!(SEGMENTS.is_power_of_two() && LAG >= 1 && LAG < SEGMENTS);
        assert!(slots.is_power_of_two());
        let segment = segment as u64;
        let offset_bits = u64::BITS - segment.leading_zeros();
        // When a segment is full, each visitor may ask for as much again once.
        let slots_bits = usize::BITS - slots.leading_zeros();
        let this = Self {
            segment,
            tag_bits: offset_bits + LENGTH_BITS + 1,
            next_bits: offset_bits + slots_bits + 1,
            next: Padded(AtomicU64::new(0)),
            time: Padded(AtomicU64::new(SEGMENTS)),
            switching: AtomicBool::new(false),
            slots: (0..slots).map(|_| Padded(AtomicU64::new(FREE))).collect(),
        };
        this.next
            .0
            .store(SEGMENTS << this.next_bits, Ordering::Relaxed);
        this
    }

    /// The most lines that can be had at once.
    pub(crate) fn most_lines(&self) -> usize {
        self.segment.min((1 << LENGTH_BITS) - 1) as usize
    }

    /// Begins a visit. Slots are tried from `hint` on.
    #[inline]
    pub(crate) fn enter(&self, hint: usize) -> Visitor {
        let mut visitor = Visitor {
            slot: None,
            floor: u64::MAX,
        };
        let last = self.slots.len() - 1;
        for slot in (0..=last).map(|i| (hint + i) & last) {
            let shown = &self.slots[slot].0;
            if shown.load(Ordering::Relaxed) != FREE {
                continue;
            }
            let time = self.time.0.load(Ordering::Relaxed);
            let (yes, no) = (Ordering::SeqCst, Ordering::Relaxed);
            if shown.compare_exchange(FREE, time, yes, no).is_ok() {
                visitor.slot = Some(slot);
                self.shown(&mut visitor, time);
                break;
            }
        }
        visitor
    }

    /// As if the visitor left and came again: what it found before may go.
    pub(crate) fn renew(&self, visitor: &mut Visitor) {
        if let Some(slot) = visitor.slot {
            let time = self.time.0.load(Ordering::Relaxed);
            // Whatever was read before is done with.
            self.slots[slot].0.swap(time, Ordering::SeqCst);
            self.shown(visitor, time);
        }
    }

    /// Sees to it that a visitor that shows `time` does not show one that is past.
    #[inline]
    fn shown(&self, visitor: &mut Visitor, mut time: u64) {
        if let Some(slot) = visitor.slot {
            loop {
                #[cfg(test)]
                fence(Ordering::SeqCst);
                let now = self.time.0.load(Ordering::SeqCst);
                if now == time {
                    break;
                }
                time = now;
                self.slots[slot].0.swap(time, Ordering::SeqCst);
            }
            visitor.floor = (time - Self::KEPT) << self.tag_bits;
        }
    }

    /// The visitor looks at nothing until it is [renewed](Self::renew).
    pub(crate) fn rest(&self, visitor: &mut Visitor) {
        if let Some(slot) = visitor.slot {
            self.slots[slot].0.store(AWAY, Ordering::Release);
            visitor.floor = u64::MAX;
        }
    }

    /// Ends a visit.
    #[inline]
    pub(crate) fn leave(&self, visitor: &mut Visitor) {
        if let Some(slot) = visitor.slot.take() {
            self.slots[slot].0.store(FREE, Ordering::Release);
            visitor.floor = u64::MAX;
        }
    }

    /// What an entry holds, for as long as the visitor stays as it is.
    #[inline(always)]
    pub(crate) fn find(&self, visitor: &Visitor, tag: &Tag) -> Option<Place> {
        let tag = tag.0.load(Ordering::Acquire);
        (tag >= visitor.floor).then(|| self.place(tag))
    }

    #[inline(always)]
    fn place(&self, tag: u64) -> Place {
        let offset = (tag & ((1 << self.tag_bits) - 1)) >> (LENGTH_BITS + 1);
        let region = (tag >> self.tag_bits) % SEGMENTS;
        Place {
            first: (region * self.segment + offset) as usize,
            lines: (tag >> 1) as usize & ((1 << LENGTH_BITS) - 1),
            tag,
        }
    }

    /// Lines to write to, which are the visitor's alone until it publishes them, and stay for as long as it stays as it
    /// is. None if there are none without waiting, or there never are so many.
    pub(crate) fn allocate(&self, visitor: &Visitor, lines: usize) -> Option<Place> {
        if visitor.floor == u64::MAX || lines > self.most_lines() {
            return None;
        }
        let lines = lines as u64;
        loop {
            let next = self.next.0.load(Ordering::Relaxed);
            if self.fits(next, lines) {
                // Who has it from here on has it after the readers of what was there before.
                let got = self.next.0.fetch_add(lines, Ordering::Acquire);
                if self.fits(got, lines) {
                    let (time, offset) = self.time_and_offset(got);
                    let tag = time << self.tag_bits | offset << (LENGTH_BITS + 1) | lines << 1;
                    return Some(self.place(tag));
                }
            }
            if !self.begin_segment(next >> self.next_bits) {
                return None;
            }
        }
    }

    fn time_and_offset(&self, next: u64) -> (u64, u64) {
        (next >> self.next_bits, next & ((1 << self.next_bits) - 1))
    }

    fn fits(&self, next: u64, lines: u64) -> bool {
        self.time_and_offset(next).1 + lines <= self.segment
    }

    /// Begins the segment after that of time `full`. False if that has to wait.
    fn begin_segment(&self, full: u64) -> bool {
        if self.switching.swap(true, Ordering::Acquire) {
            return false;
        }
        let time = self.time.0.load(Ordering::Relaxed) + 1;
        let goes_on = if time > full + 1 {
            // Somebody was faster.
            true
        } else {
            #[cfg(test)]
            fence(Ordering::SeqCst);
            let past = |shown: &Padded<AtomicU64>| shown.0.load(Ordering::SeqCst) >= time - LAG;
            let may =
                time < 1 << (u64::BITS - self.tag_bits).min(62) && self.slots.iter().all(past);
            if may {
                self.next.0.swap(time << self.next_bits, Ordering::Release);
                self.time.0.store(time, Ordering::SeqCst);
            }
            may
        };
        self.switching.store(false, Ordering::Release);
        goes_on
    }
}
