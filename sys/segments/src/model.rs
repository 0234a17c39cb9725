//! The protocol in all orders of events that loom finds, with lines that it watches.

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

use super::protocol::{Protocol, Tag};

/// A cache of segments of one line.
struct Small<const SEGMENTS: u64, const LAG: u64> {
    protocol: Protocol<SEGMENTS, LAG>,
    tags: [Tag; 2],
    /// What entry was written.
    lines: Vec<UnsafeCell<usize>>,
}

impl<const SEGMENTS: u64, const LAG: u64> Small<SEGMENTS, LAG> {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            protocol: Protocol::new(1, 4),
            tags: [Tag::default(), Tag::default()],
            lines: (0..SEGMENTS).map(|_| UnsafeCell::new(usize::MAX)).collect(),
        })
    }

    /// Whether the entry is there; then it is as it was written, for as long as it is looked at.
    fn read(&self, hint: usize, entry: usize) -> bool {
        let mut visitor = self.protocol.enter(hint);
        let found = self.protocol.find(&visitor, &self.tags[entry]);
        if let Some(place) = found {
            for _ in 0..2 {
                // SAFETY: loom watches for writes meanwhile, which is what this is about.
                let value = self.lines[place.first].with(|line| unsafe { *line });
                assert_eq!(value, entry);
                thread::yield_now();
            }
        }
        self.protocol.leave(&mut visitor);
        found.is_some()
    }

    /// Whether the entry was written.
    fn write(&self, hint: usize, entry: usize) -> bool {
        let tag = &self.tags[entry];
        if !tag.try_lock() {
            return false;
        }
        let mut visitor = self.protocol.enter(hint);
        let place = self.protocol.allocate(&visitor, 1);
        match place {
            Some(place) => {
                // SAFETY: loom watches for other accesses.
                self.lines[place.first].with_mut(|line| unsafe { *line = entry });
                tag.publish(place);
            }
            None => tag.unlock(),
        }
        self.protocol.leave(&mut visitor);
        place.is_some()
    }
}

fn model(body: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(body);
}

#[test]
fn what_is_looked_at_is_not_written_to() {
    model(|| {
        let cache = Small::<2, 1>::new();
        assert!(cache.write(0, 0));
        let reader = {
            let cache = cache.clone();
            thread::spawn(move || {
                cache.read(1, 0);
            })
        };
        // The second one takes the first one's line.
        cache.write(0, 1);
        cache.write(0, 0);
        reader.join().expect("it ended well");
    });
}

#[test]
fn those_who_write_at_once_write_to_different_lines() {
    model(|| {
        let cache = Small::<2, 1>::new();
        let other = {
            let cache = cache.clone();
            thread::spawn(move || {
                cache.write(1, 1);
                cache.read(1, 0);
            })
        };
        cache.write(0, 0);
        cache.read(0, 1);
        other.join().expect("it ended well");
    });
}

#[test]
fn one_who_reads_lets_two_others_write() {
    model(|| {
        let cache = Small::<2, 1>::new();
        assert!(cache.write(0, 0));
        let others = [1, 2].map(|hint| {
            let cache = cache.clone();
            thread::spawn(move || {
                if hint == 1 {
                    cache.read(1, 0);
                } else {
                    cache.write(2, 1);
                }
            })
        });
        cache.write(0, 0);
        for other in others {
            other.join().expect("it ended well");
        }
    });
}

#[test]
fn an_entry_has_one_builder_at_a_time() {
    model(|| {
        let cache = Small::<4, 2>::new();
        let built = [1, 2].map(|hint| {
            let cache = cache.clone();
            thread::spawn(move || cache.write(hint, 0))
        });
        let built = built.map(|thread| thread.join().expect("it ended well"));
        assert!(built.contains(&true));
        assert!(cache.read(0, 0));
    });
}

#[test]
fn time_goes_on_without_visitors_and_old_entries_end() {
    model(|| {
        let cache = Small::<4, 2>::new();
        assert!(cache.write(0, 0) && cache.read(0, 0));
        // One segment is kept beside the one at hand.
        assert!(cache.write(0, 1) && cache.read(0, 0) && cache.read(0, 1));
        assert!(cache.write(0, 1) && !cache.read(0, 0) && cache.read(0, 1));
    });
}
