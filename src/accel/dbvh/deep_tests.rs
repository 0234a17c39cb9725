//! Patches of several levels: what is in a part is found through all that encloses it.

use super::part::Part;
use super::*;
use crate::accel::Intersector;
use crate::accel::simd::LANES;
use crate::math::Vec3;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{displacements, surface};
use crate::surface::{Displacement, Rates};

/// A block of a patch, anyone.
fn any_block(face: &Face, patch: &Patch, random: &mut Random) -> Part {
    let mut part = face.root(patch);
    while part.level > 0 {
        let there = face.there(&part);
        let children: Vec<usize> = (0..LANES).filter(|c| there >> c & 1 == 1).collect();
        part = part.child(children[(random.next() * children.len() as f32) as usize]);
    }
    part
}

/// A ray through the inside of some micro-triangle, from near it or from far away, that is to end soon behind it.
fn aimed(tree: &Dbvh, random: &mut Random) -> Option<Ray> {
    let patch = &tree.patches[(random.next() * tree.patches.len() as f32) as usize];
    let face = &tree.faces[patch.face as usize];
    let span = face.span(patch, any_block(face, patch, random).at);
    let [i, j] = [0, 1].map(|k| span.first[k] + (random.next() * span.cells[k] as f32) as usize);
    let corners = if random.next() < 0.5 {
        [[i, j], [i + 1, j], [i, j + 1]]
    } else {
        [[i + 1, j + 1], [i, j + 1], [i + 1, j]]
    };
    let time = random.next();
    let moment = Moment::new(tree.keys(), time);
    let [a, b, c] = corners.map(|at| {
        let on_lattice = Vec3::from(tree.vertex(patch, at, &moment)).as_dvec3();
        (tree.lattice.anchor.as_dvec3() + tree.lattice.step() * on_lattice).as_vec3()
    });
    let weight = 0.2 + 0.6 * random.next();
    let rest = (1.0 - weight) * (0.2 + 0.6 * random.next());
    let point = weight * a + rest * b + (1.0 - weight - rest) * c;
    let direction = random.direction();
    let square = (b - a).cross(c - a).dot(direction).abs();
    // Seen squarely enough that roundings do not lead past it.
    let longest = (b - a).length().max((c - a).length());
    if square < 0.1 * longest * longest {
        return None;
    }
    let size = tree.bounds(0, 0).extent().length();
    let distance = size * [0.01, 0.3, 3.0][(random.next() * 3.0) as usize];
    Some(Ray {
        t_min: (distance - longest).max(0.0),
        t_max: distance + longest,
        ..Ray::new(point - distance * direction, direction, time)
    })
}

#[test]
fn every_micro_triangle_is_found_through_all_levels() {
    // Coarse quads, so that there is much in each.
    let tolerance = ShellTolerance {
        distance: 0.1,
        ..ShellTolerance::default()
    };
    let mut deepest = 0;
    for (shape, base, most) in [
        ("cube", Patches::cube(), 1000),
        ("turned cube", Patches::cube().turned(), 300),
        ("torus", Patches::torus(5, 4), 450),
        (
            "twisted",
            Patches::cube().mapped(|p| p + 0.3 * p.x * p.y * Vec3::ONE),
            600,
        ),
    ] {
        for (kind, displacement) in displacements(0.1) {
            if matches!(displacement, Displacement::Vector(..)) {
                continue;
            }
            for moves in [false, true] {
                let base = base.clone();
                let base = if moves {
                    base.moving(|p| 1.2 * p)
                } else {
                    base
                };
                let surface = surface(base, displacement.clone());
                for even in [false, true] {
                    let rates = Rates::by_edge(&surface, |edge| {
                        let part = if even { 0 } else { edge % 4 };
                        most >> (2 * part)
                    });
                    let options = DbvhOptions {
                        tolerance,
                        ..DbvhOptions::default()
                    };
                    let tree = Dbvh::build(&surface, &rates, &options, &|_| true);
                    let tree = tree.expect("it is built");
                    let levels = tree.faces.iter().map(|face| face.levels).max();
                    deepest = deepest.max(levels.unwrap_or(0));
                    if shape == "cube" {
                        assert!(tree.faces.iter().all(|face| face.is_flat), "{kind}");
                    }
                    let mut random = Random(3);
                    let rays = (0..400).filter_map(|_| aimed(&tree, &mut random));
                    let mut count = 0;
                    for ray in rays {
                        let hit = tree.intersect(0, &ray);
                        assert!(hit.is_some(), "{shape} {kind} {moves} {even}: {ray:?}");
                        count += 1;
                    }
                    assert!(count > 100, "{shape} {kind}: {count}");
                }
            }
        }
    }
    assert!(deepest >= 3, "{deepest}");
}
