//! Cached patches against the compressed surface, which has the same bits, for caches of all sizes; rays that must not
//! escape while segments go; threads and nested visits.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use segments::Cache;

use super::*;
use crate::accel::tests::random_ray;
use crate::accel::{Compact, CompactOptions, MaxError};
use crate::math::Vec3;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{amount, closed, displacements, effort, leaks, surface};
use crate::surface::{Displacement, Function, Rates};

/// Segments of three patches, or so.
const TINY: usize = 48 << 10;

fn cached(surface: &Arc<Surface>, rates: &Rates, bytes: usize) -> Cached {
    let cache = Arc::new(Cache::new(bytes));
    Cached::build(surface, rates, MaxError::Usual, &cache, &|_| true).expect("nobody stops it")
}

/// Faces of many patches, of one, and of less than a block.
fn uneven(surface: &Surface) -> Rates {
    Rates::by_edge(surface, |edge| [3, 40, 20][edge as usize % 3])
}

#[test]
fn hits_are_those_of_compact_to_the_bit_whatever_the_size() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.15) {
            for moves in [false, true] {
                let base = base.clone();
                let base = if moves {
                    base.moving(|p| p + 0.3 * Vec3::X)
                } else {
                    base
                };
                let surface = Arc::new(surface(base, displacement.clone()));
                let rates = uneven(&surface);
                let options = CompactOptions::default();
                let all = Compact::build(&surface, &rates, &options, &|_| true).expect("built");
                let trees = [0, TINY, 8 << 20].map(|bytes| cached(&surface, &rates, bytes));
                let mut random = Random(3);
                let mut hits = 0;
                for _ in 0..60 {
                    let ray = random_ray(&mut random);
                    let expected = all.intersect(0, &ray);
                    hits += usize::from(expected.is_some());
                    for tree in &trees {
                        let got = tree.intersect(0, &ray);
                        assert_eq!(got, expected, "{shape} {kind} moving: {moves}");
                        assert_eq!(tree.occluded(0, &ray), expected.is_some());
                        if let Some(hit) = got {
                            let last = tree.keys() - 1;
                            let around = tree.bounds(0, 0).union(tree.bounds(0, last));
                            let at = ray.at(hit.t);
                            assert_eq!(around, around.including(at), "{shape} {kind}");
                        }
                    }
                }
                assert!(hits > 10, "{shape} {kind}: {hits}");
                let [none, tiny, large] = trees.map(|tree| tree.entries.cache().asked());
                assert_eq!(none.hits, 0);
                assert!(large.hits > large.built && tiny.built >= large.built);
            }
        }
    }
}

/// A million rays (times `RELIEVO_EFFORT`) from inside of closed, creased, displaced shapes of mixed rates, near the origin
/// and far from it, still and moving, by a cache whose segments go all the time. None escapes.
#[test]
fn no_ray_escapes_while_segments_go() {
    // One cache for all of them, which has room for some patches of a solid. Where it moves they take most of a segment.
    let cache = Arc::new(Cache::new(TINY / 4));
    let lost = leaks::lost(
        effort(1_000_000),
        leaks::still_and_moving(),
        |surface, rates| {
            Cached::build(surface, rates, MaxError::Usual, &cache, &|_| true).expect("built")
        },
        |tree, ray, _, _| tree.occluded(0, &ray),
    );
    let asked = cache.asked();
    println!("{asked:?}");
    assert_eq!(lost, 0);
    assert!(asked.kept > 10_000 && asked.hits > 10_000, "{asked:?}");
}

#[test]
fn more_threads_than_processors_hit_the_same() {
    let surface = Arc::new(surface(
        Patches::torus(5, 3),
        displacements(0.1).remove(2).1,
    ));
    let rates = Rates::uniform(&surface, 40);
    let whole = cached(&surface, &rates, 8 << 20);
    let expected: Vec<Option<Hit>> = rays().map(|ray| whole.intersect(0, &ray)).collect();
    let tiny = cached(&surface, &rates, TINY);
    std::thread::scope(|scope| {
        for thread in 0..16 {
            let (tiny, expected) = (&tiny, &expected);
            scope.spawn(move || {
                let there = rays().zip(expected).skip(thread).step_by(7);
                for (ray, expected) in there {
                    assert_eq!(tiny.intersect(0, &ray), *expected);
                }
            });
        }
    });
}

fn rays() -> impl Iterator<Item = Ray> {
    let mut random = Random(11);
    std::iter::repeat_with(move || random_ray(&mut random)).take(2000)
}

/// Displacement that is looked up while other surfaces of the same cache are traced.
#[test]
fn displacement_may_trace_rays_itself() {
    let cache = Arc::new(Cache::new(TINY));
    let build = |surface: &Arc<Surface>| {
        let rates = Rates::uniform(surface, 30);
        Cached::build(surface, &rates, MaxError::Usual, &cache, &|_| true).expect("built")
    };
    let inner = Arc::new(surface(Patches::cube(), displacements(0.1).remove(1).1));
    let inner = Arc::new(build(&inner));
    let asked = Arc::new(AtomicU64::new(0));
    let height = {
        let asked = asked.clone();
        Function::scalar(move |at| {
            asked.fetch_add(1, Ordering::Relaxed);
            let ray = Ray::new(3.0 * Vec3::ONE, Vec3::new(at.uv.x, at.uv.y, 0.5) - 3.0, 0.0);
            inner.intersect(0, &ray).map_or(0.0, |hit| 0.1 * hit.t)
        })
    };
    let outer = Displacement::Scalar(amount(height, 1.0));
    let outer = Arc::new(surface(Patches::cube(), outer));
    let tree = build(&outer);
    let before = asked.load(Ordering::Relaxed);
    let options = CompactOptions::default();
    let rates = Rates::uniform(&outer, 30);
    let all = Compact::build(&outer, &rates, &options, &|_| true).expect("built");
    for ray in rays().take(100) {
        assert_eq!(tree.intersect(0, &ray), all.intersect(0, &ray));
    }
    assert!(asked.load(Ordering::Relaxed) > before);
}

#[test]
fn a_build_can_be_stopped() {
    let surface = Arc::new(surface(Patches::cube(), Displacement::None));
    let rates = Rates::uniform(&surface, 8);
    let cache = Arc::new(Cache::new(TINY));
    let stopped = Cached::build(&surface, &rates, MaxError::Usual, &cache, &|_| false);
    assert!(matches!(stopped, Err(crate::Error::Interrupted)));
}

#[test]
fn no_faces_are_no_hits() {
    let surface = Arc::new(surface(Patches::empty(), Displacement::None));
    let tree = cached(&surface, &Rates::uniform(&surface, 1), TINY);
    let ray = Ray::new(Vec3::ZERO, Vec3::X, 0.0);
    assert!(tree.intersect(0, &ray).is_none() && !tree.occluded(0, &ray));
    assert!(tree.bounds(0, 0).is_empty());
}
