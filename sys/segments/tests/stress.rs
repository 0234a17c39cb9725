//! The cache under threads that read and build while its segments go all the time.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use segments::{Cache, Entries, Line, Visit};

/// What an entry is: its number and how many lines it has, which differ.
fn fill(entry: usize, room: &mut Vec<Line>) {
    let lines = 1 + entry % 5;
    room.extend((0..lines).map(|line| Line([(entry * 100 + line) as u64; 8])));
}

fn check(entry: usize, lines: &[Line]) {
    assert_eq!(lines.len(), 1 + entry % 5, "entry {entry}");
    for (line, there) in lines.iter().enumerate() {
        assert_eq!(there.0, [(entry * 100 + line) as u64; 8], "entry {entry}");
    }
}

fn look(visit: &mut Visit<'_>, entry: usize, room: &mut Vec<Line>) {
    if visit.found(entry) {
        check(
            entry,
            visit.get(entry).expect("it stays while it is looked at"),
        );
    } else {
        check(entry, visit.build(entry, room, |room| fill(entry, room)));
    }
}

fn effort() -> usize {
    let effort = std::env::var("RELIEVO_EFFORT").ok();
    effort.and_then(|text| text.parse().ok()).unwrap_or(1)
}

fn stressed(threads: usize, bytes: usize, entries: usize) -> Arc<Cache> {
    let cache = Arc::new(Cache::new(bytes));
    let all = Entries::new(cache.clone(), entries);
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let all = &all;
            scope.spawn(move || {
                let mut state = thread as u64 + 1;
                let mut room = Vec::new();
                for _ in 0..400_000 * effort() / threads {
                    let mut visit = all.visit();
                    for _ in 0..4 {
                        state = state
                            .wrapping_mul(6_364_136_223_846_793_005)
                            .wrapping_add(1);
                        // Some are asked for more often.
                        let any = (state >> 33) as usize;
                        look(
                            &mut visit,
                            any % entries % (1 + (any >> 20) % entries),
                            &mut room,
                        );
                    }
                }
            });
        }
    });
    cache
}

#[test]
fn entries_are_what_was_built_while_segments_go() {
    for (threads, bytes, entries) in [
        (2, 16 << 10, 1000),
        (8, 64 << 10, 1000),
        (64, 128 << 10, 5000),
    ] {
        let asked = stressed(threads, bytes, entries).asked();
        println!("{threads} threads, {bytes} bytes: {asked:?}");
        assert_eq!(
            asked.hits + asked.built,
            4 * (400_000 * effort() / threads * threads) as u64
        );
        assert!(asked.hits > 0 && asked.kept > 1000, "{asked:?}");
    }
}

#[test]
fn what_fits_is_built_once() {
    let cache = stressed(2, 4 << 20, 1000);
    let asked = cache.asked();
    assert_eq!(asked.kept, 1000, "{asked:?}");
    assert!(asked.built < 1100, "{asked:?}");
    assert_eq!(cache.bytes(), 4 << 20);
}

#[test]
fn what_is_too_large_or_has_too_many_visitors_is_served_all_the_same() {
    let cache = Arc::new(Cache::new(16 * 64));
    let all = Entries::new(cache.clone(), 10);
    let mut room = Vec::new();
    // A segment has one line.
    for entry in [4, 4, 0, 0] {
        look(&mut all.visit(), entry, &mut room);
    }
    let asked = cache.asked();
    assert_eq!((asked.hits, asked.built, asked.kept), (1, 3, 1));
    // Two hundred and fifty-six are counted.
    let mut visits: Vec<_> = (0..300).map(|_| all.visit()).collect();
    for visit in &mut visits {
        look(visit, 0, &mut room);
    }
    drop(visits);
    assert_eq!(cache.asked().hits, 1 + 256);
}

#[test]
fn building_may_visit_the_cache_and_panic() {
    let all = Entries::new(Arc::new(Cache::new(1 << 20)), 10);
    let (mut room, mut inner) = (Vec::new(), Vec::new());
    let nested = AtomicU64::new(0);
    let mut visit = all.visit();
    let lines = visit.build(0, &mut room, |room| {
        // Another entry, and the one that is being built.
        for entry in [1, 0] {
            look(&mut all.visit(), entry, &mut inner);
            nested.fetch_add(1, Ordering::Relaxed);
        }
        fill(0, room);
    });
    check(0, lines);
    assert!(visit.found(0) && visit.found(1));
    assert_eq!(nested.into_inner(), 2);
    drop(visit);

    let unwound = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        all.visit()
            .build(2, &mut room, |_| panic!("displacement code failed"));
    }));
    assert!(unwound.is_err());
    // Nothing stays locked.
    look(&mut all.visit(), 2, &mut room);
    assert!(all.visit().found(2));
}
