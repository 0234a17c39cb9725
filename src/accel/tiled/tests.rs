//! Bent rays through tiles against a loop over all copies in double precision, and rays that must not escape.

use std::sync::Arc;

use super::*;
use crate::accel::Intersector;
use crate::accel::tests::{met_in_double, random_ray};
use crate::accel::traversal::place;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, effort, leaks};
use crate::surface::{Displacement, Surface, Tiles};

fn tiled(surface: &Surface, tiles: Tiles) -> Tiled {
    Tiled::build(surface, &Arc::new(tiles), &|_| true).expect("nobody stops it")
}

fn plain(base: Patches) -> Surface {
    Surface::new(Arc::new(base), Displacement::None)
}

/// Slivers that lean, some of them over the tile's border.
fn blades(repeats: f32, height: f32) -> Tiles {
    halved_blades(repeats, height, 0)
}

/// The same triangles, cut into four so many times.
fn halved_blades(repeats: f32, height: f32, halvings: u32) -> Tiles {
    let mut random = Random(5);
    let mut points = Vec::new();
    for _ in 0..40 {
        let foot = Vec3::new(random.next(), random.next(), 0.0);
        let lean = 0.6 * Vec3::new(random.next() - 0.5, random.next() - 0.5, 0.0);
        let side = 0.1 * Vec3::new(random.next() - 0.5, random.next() - 0.5, 0.0);
        points.extend([foot, foot + side, foot + lean + Vec3::Z * random.next()]);
    }
    for _ in 0..halvings {
        let cut = |corners: &[Vec3]| {
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            let (ab, bc, ca) = (a.midpoint(b), b.midpoint(c), c.midpoint(a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        points = points.chunks(3).flat_map(cut).flatten().collect();
    }
    let triangles = (0..points.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    Tiles::new(points, triangles.collect(), Vec2::splat(repeats), height)
}

/// A lid over all of a tile, which is flat and whose triangles are not alike.
fn lid(repeats: f32, height: f32) -> Tiles {
    let points = [
        [0.0, 0.0],
        [0.4, 0.0],
        [1.0, 0.0],
        [0.0, 0.7],
        [0.3, 0.6],
        [1.0, 0.7],
        [0.0, 1.0],
        [0.4, 1.0],
        [1.0, 1.0],
    ];
    let points = points.map(|[x, y]| Vec3::new(x, y, 1.0)).to_vec();
    let quads = [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]];
    let triangles = quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    Tiles::new(points, triangles.collect(), Vec2::splat(repeats), height)
}

/// The nearest hit among copies, and how far inside of its triangle it is.
fn brute_force(copies: &Copies, ray: &Ray) -> Option<(f64, usize, f64)> {
    let last = copies.positions.len() - 1;
    let time = f64::from(ray.time);
    (0..copies.triangles.len())
        .filter_map(|number| {
            let corners = copies.triangles[number].map(|v| {
                let at = |key: usize| copies.positions[key][v as usize].as_dvec3();
                at(0).lerp(at(last), time)
            });
            let (t, inside) = met_in_double(ray, corners)?;
            Some((t, number, inside))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

#[test]
fn hits_are_those_of_a_loop_over_all_copies() {
    for (shape, base) in closed() {
        let surface = plain(base.moving(|p| p + 0.3 * Vec3::X));
        let tree = tiled(&surface, blades(3.0, 0.2));
        // Straight ones are the nearer to those that are traced, the smaller they are.
        let halved = tiled(&surface, halved_blades(3.0, 0.2, 2));
        let copies = halved.copies(&|_| true).expect("few of them");
        let mut random = Random(3);
        let mut hits = 0;
        let mut misses = 0;
        for _ in 0..200 {
            let ray = random_ray(&mut random);
            let (expected, got) = (brute_force(&copies, &ray), tree.intersect(0, &ray));
            assert_eq!(tree.occluded(0, &ray), got.is_some(), "{shape}");
            match (expected, got) {
                (None, None) => {}
                (Some((t, number, inside)), Some(hit)) => {
                    hits += 1;
                    // Where the ray passes by a copy's side, the bent one is met or missed.
                    let near = (t - f64::from(hit.t)).abs() < 1e-2;
                    misses += usize::from(!near && inside < 0.05);
                    assert!(near || inside < 0.05, "{shape}: {t} {inside} {hit:?}");
                    if near && copies.faces[number] == hit.face {
                        let [a, b, c] = copies.triangles[number]
                            .map(|v| copies.positions[0][v as usize].as_dvec3());
                        let normal = (b - a).cross(c - a).normalize_or_zero();
                        let cos = normal.dot(hit.normal.as_dvec3().normalize_or_zero());
                        assert!(cos > 0.8, "{shape}: {cos}");
                    }
                    assert!(hit.error < 1e-5, "{hit:?}");
                }
                (Some((_, _, inside)), None) => {
                    misses += 1;
                    assert!(inside < 0.05, "{shape}: {inside}");
                }
                (None, Some(_)) => misses += 1,
            }
        }
        println!("{shape}: {hits} hits, {misses} elsewhere");
        assert!(hits > 20 && misses < hits / 10, "{shape}: {hits} {misses}");
    }
}

#[test]
fn copying_can_be_stopped() {
    let tree = tiled(&plain(Patches::sphere(4)), blades(3.0, 0.2));
    let most = std::cell::Cell::new(0.0_f64);
    let stopped = tree.copies(&|done| {
        most.set(done);
        done < 0.5
    });
    assert!(matches!(stopped, Err(crate::Error::Interrupted)));
    assert!((0.5..0.9).contains(&most.get()), "{most:?}");
}

/// Where prisms do not lean, nothing is bent, and the two are the same but for roundings.
#[test]
fn over_a_plane_copies_are_the_same() {
    let points = [
        Vec3::new(-1.0, -1.0, 0.0),
        Vec3::new(1.5, -1.0, 0.0),
        Vec3::new(1.0, 1.0, 0.0),
        Vec3::new(-1.0, 0.7, 0.0),
    ];
    let surface = plain(Patches::bilinear(&points, vec![[0, 1, 2, 3]]));
    let tree = tiled(&surface, blades(7.0, 0.3));
    let copies = tree.copies(&|_| true).expect("few of them");
    let mut random = Random(4);
    let mut hits = 0;
    for _ in 0..2000 {
        let ray = random_ray(&mut random);
        match (brute_force(&copies, &ray), tree.intersect(0, &ray)) {
            (None, None) => {}
            (Some((t, number, inside)), Some(hit)) => {
                hits += 1;
                let near = (t - f64::from(hit.t)).abs() < 1e-5;
                assert!(near || inside < 1e-4, "{t} {number} {inside} {hit:?}");
            }
            (expected, got) => {
                let inside = expected.map_or(0.0, |(_, _, inside)| inside);
                assert!(inside < 1e-4, "{expected:?} {got:?}");
            }
        }
    }
    assert!(hits > 300, "{hits}");
}

/// A million rays (times `RELIEVO_EFFORT`) from inside of closed shapes, smooth and creased, under a lid, near the origin and far from it,
/// still and moving. None escapes.
#[test]
fn no_ray_escapes() {
    let mut solids = leaks::still_and_moving();
    solids.retain(|solid| matches!(solid.surface.displacement(), Displacement::None));
    let lost = leaks::lost(
        effort(1_000_000),
        solids,
        |surface, _| tiled(surface, lid(2.3, 0.05)),
        |tree, ray, _, _| tree.occluded(0, &ray),
    );
    assert_eq!(lost, 0);
}

/// Who goes on behind a hit, as where a surface is trimmed, never finds it again.
#[test]
fn behind_a_hit_is_the_next_one() {
    let tree = tiled(&plain(Patches::torus(5, 4)), blades(6.0, 0.3));
    let mut random = Random(6);
    let mut hits = 0;
    for _ in 0..100 {
        let mut ray = random_ray(&mut random);
        while let Some(hit) = tree.intersect(0, &ray) {
            assert!(hit.t > ray.t_min, "{hit:?} {ray:?}");
            ray.t_min = hit.t;
            hits += 1;
        }
    }
    assert!(hits > 20, "{hits}");
}

/// A flat tile far from the surface, triangles without area, and none at all.
#[test]
fn degenerate_tiles_are_traced() {
    let surface = plain(Patches::sphere(2));
    let ray = Ray::new(Vec3::new(0.3, 5.0, 0.2), -Vec3::Y, 0.0);
    let flat = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let lifted = |z: f32| flat.map(|[x, y]| Vec3::new(x, y, z)).to_vec();
    let whole = vec![[0, 1, 2], [0, 2, 3], [1, 1, 3]];
    let far = Tiles::new(lifted(1e5), whole, Vec2::splat(3.0), 1e-5);
    assert_eq!(far.triangles().len(), 2);
    let hit = tiled(&surface, far).intersect(0, &ray).expect("a shell");
    let place = ray.at(hit.t).length();
    assert!((place - 2.0).abs() < 0.02, "{place}");
    let none = Tiles::new(Vec::new(), Vec::new(), Vec2::ONE, 1.0);
    assert!(tiled(&surface, none).intersect(0, &ray).is_none());
}

#[test]
fn all_instruction_sets_meet_the_same() {
    let surface = plain(Patches::torus(5, 4));
    let mut tree = tiled(&surface, blades(4.0, 0.2));
    let mut random = Random(8);
    for _ in 0..500 {
        let ray = random_ray(&mut random);
        let met = Isa::all().into_iter().map(|isa| {
            tree.isa = isa;
            place(&mut &tree, &ray)
        });
        let met: Vec<_> = met.collect();
        assert!(met.iter().all(|m| *m == met[0]), "{met:?}");
    }
}

#[test]
fn memory_does_not_grow_with_repeats() {
    let surface = plain(Patches::sphere(3));
    let held = |repeats| tiled(&surface, blades(repeats, 0.1)).memory();
    assert_eq!(held(2.0), held(300.0));
    let expected = Tiled::expected_bytes(&surface, &Arc::new(blades(2.0, 0.1)));
    let held = held(2.0) as u64;
    assert!((held..2 * held).contains(&expected), "{held} {expected}");
}

#[test]
fn too_many_tiles_are_an_error_that_says_where() {
    let surface = plain(Patches::sphere(1));
    let build = |repeats| Tiled::build(&surface, &Arc::new(blades(repeats, 0.1)), &|_| true);
    let error = build(1e9).err().expect("too many").to_string();
    assert!(
        error.contains("face 0") && error.contains("tiles"),
        "{error}"
    );
    assert!(build(f32::NAN).is_err());
}
