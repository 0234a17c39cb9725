//! The compressed surface against its dicing, its instruction sets against each other, rays that must not escape; its
//! slabs against random vertices.

use std::sync::Arc;

use proptest::prelude::*;

use super::tile::{MOST_QUADS, leaves, there};
use super::*;
use crate::accel::Intersector;
use crate::accel::Tessellated;
use crate::accel::lattice::Extent;
use crate::accel::simd::Portable;
use crate::accel::tests::random_ray;
use crate::accel::top::Child;
use crate::accel::traversal::Traversal;
use crate::math::{DVec3, Vec3};
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{Diced, Displacement, Rates, Surface};

fn compressed(surface: &Surface, rates: &Rates) -> Compressed {
    Compressed::build(surface, rates, &|_| true).expect("nobody stops it")
}

/// How far a vertex is out of a leaf's slab, in quads and in heights, beyond what rounding may explain.
fn outside(leaf: &Leaf, p: DVec3) -> f32 {
    let at = leaf.place(p.as_vec3());
    // Coordinates of up to 2^23 are rounded to single precision, and so is what is computed with them.
    let slack = leaf.rounding();
    let uv = Vec2::new(at.x, at.y);
    let beside = (leaf.from - uv).max(uv - leaf.to) - Vec2::new(slack.x, slack.y);
    let height = leaf.height(at);
    let over = (height - leaf.above).max(-leaf.below - height) - slack.z;
    beside.max_element().max(over)
}

impl Leaf {
    /// How far a place is above the plane.
    fn height(&self, p: Vec3) -> f32 {
        let mean = 0.25 * self.corners.iter().sum::<f32>();
        let middle = 0.5 * (self.first + self.last);
        p.z - mean - self.slopes().dot(Vec2::new(p.x, p.y) - middle)
    }

    /// The length of quads along u and along v, in lattice steps, about.
    fn long(&self) -> Vec2 {
        let [u, v, h] = self.axes;
        let volume = u.dot(v.cross(h)).abs();
        Vec2::new(v.cross(h).length(), h.cross(u).length()) / volume
    }

    /// By how much places may be rounded.
    fn rounding(&self) -> Vec3 {
        let [u, v, h] = self.axes.map(|axis| {
            let steps = axis.abs().element_sum();
            8.0 * f32::EPSILON * (steps * (1 << 23) as f32 + 300.0)
        });
        let [a, b] = self.slopes().abs().to_array();
        Vec3::new(u, v, h + a * u + b * v)
    }
}

impl Compressed {
    /// What is in a leaf, on the lattice.
    fn content(
        &self,
        diced: &Diced,
        patch: &Patch,
        tile: usize,
        leaf: usize,
        key: usize,
    ) -> Vec<DVec3> {
        let grid = &diced.grids()[patch.face as usize];
        let quads = patch.quads_of(tile);
        let range = |k: usize| {
            let (tile, leaf) = ([tile % FAN, tile / FAN][k], [leaf % FAN, leaf / FAN][k]);
            let first = patch.first(grid.size)[k] + patch.before(k, tile);
            first + tile::cut(leaf, quads[k])..=first + tile::cut(leaf + 1, quads[k])
        };
        let vertex = |i: usize, j: usize| {
            let vertex = grid.vertex(i as u16, j as u16) as usize;
            self.lattice.on_lattice(diced.positions()[key][vertex])
        };
        range(1)
            .flat_map(|j| range(0).map(move |i| (i, j)))
            .map(|(i, j)| vertex(i, j))
            .collect()
    }

    /// Checks that all slabs of a patch enclose their micro-vertices, at motion keys and between them, and all boxes
    /// what is below them. Returns what the patch encloses.
    fn check_patch(&self, diced: &Diced, patch: &Patch, key: usize, name: &str) -> Extent {
        let mut all = Extent::EMPTY;
        for tile in (0..16).filter(|tile| patch.there() >> tile & 1 == 1) {
            let quads = patch.quads_of(tile);
            assert!(
                quads.into_iter().all(|n| (1..=MOST_QUADS).contains(&n)),
                "{quads:?}"
            );
            let mut content = Vec::new();
            for leaf in (0..16).filter(|leaf| there(quads) >> leaf & 1 == 1) {
                let at = |key| self.content(diced, patch, tile, leaf, key);
                let here = at(key);
                for step in 0..4 {
                    // From this key on to the next.
                    let next = (key + 1).min(self.keys as usize - 1);
                    let time = if self.keys == 1 {
                        0.0
                    } else {
                        (key as f32 + 0.25 * step as f32) / (self.keys - 1) as f32
                    };
                    let moment = Moment::new(self.keys, time);
                    let slab = self.leaf(patch, tile, leaf, &moment);
                    for (a, b) in here.iter().zip(at(next)) {
                        let part = if next == key {
                            0.0
                        } else {
                            0.25 * f64::from(step)
                        };
                        let out = outside(&slab, a.lerp(b, part));
                        assert!(
                            out <= 0.0,
                            "{name}: {patch:?} {tile} {leaf} {time}: {out} {slab:?}"
                        );
                    }
                }
                content.extend(here);
            }
            let extent = Extent::around(&content);
            if !patch.is_single() {
                let around = self.fans[patch.root as usize + key].boxes.get(tile);
                assert_eq!(around, around.union(extent), "{name}: {patch:?}");
            }
            all = all.union(extent);
        }
        all
    }

    fn check(&self, diced: &Diced, name: &str) {
        fn walk(
            tree: &Compressed,
            child: Child,
            key: usize,
            patch: &dyn Fn(&Patch) -> Extent,
        ) -> Extent {
            match child {
                Child::Patch(number) => patch(&tree.patches[number as usize]),
                Child::Node(number) => {
                    let node = tree.top.node(number, key);
                    let mut all = Extent::EMPTY;
                    for c in 0..node.children() {
                        let content = walk(tree, node.child(c), key, patch);
                        let around = node.boxes.get(c);
                        assert_eq!(around, around.union(content));
                        all = all.union(content);
                    }
                    all
                }
            }
        }
        let quads: usize = diced
            .grids()
            .iter()
            .map(|grid| grid.triangles() as usize / 2)
            .sum();
        let of = |patch: &Patch| usize::from(patch.quads[0]) * usize::from(patch.quads[1]);
        assert_eq!(self.patches.iter().map(of).sum::<usize>(), quads, "{name}");
        for key in 0..self.keys as usize {
            let patch = |patch: &Patch| self.check_patch(diced, patch, key, name);
            let content = walk(self, self.top.root().expect("there are faces"), key, &patch);
            let largest = content
                .min
                .iter()
                .chain(&content.max)
                .map(|x| x.abs())
                .max();
            assert!(largest.expect("six") as f32 <= self.reach);
            let bounds = self.bounds(0, key as u32);
            for p in &diced.positions()[key] {
                assert_eq!(bounds, bounds.including(*p), "{name}");
            }
        }
    }
}

#[test]
fn every_slab_and_every_box_encloses_what_is_below() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            // Turned, grown, and three keys of it.
            for motion in 0..2 {
                let base = match motion {
                    0 => base.clone(),
                    _ => base
                        .clone()
                        .moving(|p| Vec3::new(-1.5 * p.y, p.x, 1.1 * p.z)),
                };
                let surface = surface(base, displacement.clone());
                for rates in [
                    mixed(&surface),
                    Rates::by_edge(&surface, |e| 1 + 11 * e % 70),
                ] {
                    let diced = Diced::new(&surface, &rates);
                    let tree = compressed(&surface, &rates);
                    tree.check(&diced, &format!("{shape} {kind}, motion {motion}"));
                }
            }
        }
    }
}

#[test]
fn flat_and_thin_and_huge_and_tiny_faces_are_enclosed_and_hit() {
    let squeezes: [fn(Vec3) -> Vec3; 4] = [
        |p| p,
        |p| Vec3::new(p.x, p.y, 0.0),
        |p| Vec3::new(p.x, p.x, p.x),
        |_| Vec3::new(0.3, 0.2, 0.1),
    ];
    for scale in [1e-20, 1e-12, 1.0, 1e12, 1e15] {
        for (number, squeeze) in squeezes.into_iter().enumerate() {
            for (kind, displacement) in displacements(0.0) {
                let base = Patches::sphere(2).mapped(|p| scale * squeeze(p));
                let surface = surface(base, displacement);
                let rates = mixed(&surface);
                let diced = Diced::new(&surface, &rates);
                let tree = compressed(&surface, &rates);
                let name = format!("{kind}, squeeze {number}, {scale}");
                tree.check(&diced, &name);
                let mut random = Random(1);
                for &p in &diced.positions()[0] {
                    let origin = p + 2.0 * scale * random.direction();
                    let ray = Ray::new(origin, p - origin, 0.0);
                    assert!(tree.intersect(0, &ray).is_some(), "{name}: {ray:?}");
                }
            }
        }
    }
}

#[test]
fn instruction_sets_agree_and_hits_are_in_their_slabs() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.15) {
            for moves in [false, true] {
                let base = base.clone();
                let base = if moves {
                    base.moving(|p| p + 0.3 * Vec3::X)
                } else {
                    base
                };
                let surface = surface(base, displacement.clone());
                let mut tree = compressed(&surface, &mixed(&surface));
                let mut random = Random(3);
                let mut hits = 0;
                for _ in 0..100 {
                    let ray = random_ray(&mut random);
                    tree.isa = Isa::all()[0];
                    let expected = tree.intersect(0, &ray);
                    for isa in Isa::all() {
                        tree.isa = isa;
                        assert_eq!(tree.intersect(0, &ray), expected, "{isa:?}");
                        assert_eq!(tree.occluded(0, &ray), expected.is_some());
                    }
                    let Some(hit) = expected else { continue };
                    hits += 1;
                    assert!(hit.normal.is_finite() && hit.normal != Vec3::ZERO);
                    let met = match (&tree).moves() {
                        true => (&mut &tree).meet::<_, false, true>(Portable, &ray),
                        false => (&mut &tree).meet::<_, false, false>(Portable, &ray),
                    };
                    let met = met.expect("as before");
                    let patch = &tree.patches[met.patch as usize];
                    let moment = Moment::new(tree.keys, ray.time);
                    let leaf = tree.leaf(patch, met.tile, met.leaf, &moment);
                    let at = ray.at(hit.t).as_dvec3();
                    let at = (at - tree.lattice.anchor.as_dvec3()) / f64::from(tree.lattice.step);
                    // Rays are moved by as much as coordinates are rounded.
                    let out = outside(&leaf, at);
                    let allowed = 3.0 * leaf.rounding().max_element();
                    assert!(out <= allowed, "{shape} {kind}: {out} {leaf:?}");
                    let all = tree.bounds(0, 0).union(tree.bounds(0, tree.keys - 1));
                    let near = ray.at(hit.t).clamp(all.min, all.max);
                    let off = near.distance(ray.at(hit.t)) / tree.lattice.step;
                    // Along h, and beside by the margin.
                    let [u, v, h] = leaf.axes;
                    let along_h = u.cross(v).length() / u.cross(v).dot(h).abs();
                    let wide = (leaf.to - leaf.from).dot(leaf.long());
                    let most = (leaf.below + leaf.above) * along_h + wide;
                    assert!(off <= most + 100.0, "{shape} {kind}: {off} {most}");
                }
                assert!(hits > 10, "{shape} {kind}: {hits}");
            }
        }
    }
}

#[test]
fn slabs_are_hit_where_the_plain_tree_is() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.1) {
            let surface = surface(base.clone(), displacement);
            let rates = Rates::uniform(&surface, 48);
            let plain = Tessellated::build(Arc::new(Diced::new(&surface, &rates)));
            let tree = compressed(&surface, &rates);
            let mut random = Random(5);
            // Where neighbours are displaced apart by more than quads are long, a leaf tells no more than itself.
            let is_smooth = !kind.contains("image") && kind != "heights";
            let (near, aside) = if is_smooth {
                (1e-3, 1e-2)
            } else {
                (5e-2, 0.15)
            };
            let (mut alike, mut all) = (0, 0);
            for _ in 0..300 {
                let ray = random_ray(&mut random);
                let Some(a) = plain.intersect(0, &ray) else {
                    continue;
                };
                let b = tree
                    .intersect(0, &ray)
                    .expect("slabs enclose the triangles");
                let normals = [a, b].map(|hit| hit.normal.normalize());
                let across = (a.t - b.t) * ray.direction.dot(normals[1]);
                // The surface is where the hit says, but for what triangles cut off.
                let point = surface.evaluate(b.face, b.uv, 0).position;
                let off = point.distance(ray.at(b.t)) - b.error;
                let faces_alike = normals[0].dot(normals[1]) > 0.9 || !is_smooth;
                all += 1;
                alike += usize::from(across.abs() < b.error + near && off < aside && faces_alike);
            }
            // But at creases and poles and outlines; and where displacement tears faces apart, along all their borders.
            let tears = kind.contains("object") || kind.contains("image");
            let least = if tears { 8 } else { 9 };
            assert!(
                alike * 10 >= all * least,
                "{shape} {kind}: {alike} of {all}"
            );
        }
    }
}

/// A million rays (times `RELIEVO_EFFORT`) from inside of closed, creased, displaced shapes of mixed rates,
/// near the origin and far from it, still and moving. None escapes.
#[test]
fn no_ray_escapes() {
    let lost = leaks::lost(
        effort(1_000_000),
        leaks::still_and_moving(),
        |surface, rates| compressed(surface, rates),
        |tree, ray, _, _| tree.occluded(0, &ray),
    );
    assert_eq!(lost, 0);
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let surface = surface(Patches::torus(5, 3), displacements(0.1).remove(2).1);
    let rates = Rates::by_edge(&surface, |edge| 20 + 13 * (edge % 5));
    let built = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| compressed(&surface, &rates))
    });
    assert_eq!(built[0].tiles, built[1].tiles);
    assert_eq!(built[0].fans, built[1].fans);
    assert_eq!(built[0].patches, built[1].patches);
    assert!(built[0].top == built[1].top);
}

#[test]
fn tiles_and_leaves_are_full() {
    for quads in 1..=4096 {
        let count = patch::patches(quads);
        assert_eq!(
            (patch::first(0, quads), patch::first(count, quads)),
            (0, quads)
        );
        for n in 0..count {
            let within = patch::first(n + 1, quads) - patch::first(n, quads);
            let tiles = patch::tiles(within);
            assert!((1..=FAN).contains(&tiles), "{within} of {quads}");
            let patch = Patch {
                face: 0,
                place: [n as u8; 2],
                quads: [within as u8; 2],
                root: 0,
            };
            assert_eq!((patch.before(0, 0), patch.before(1, tiles)), (0, within));
            for tile in 0..tiles {
                let [of_tile, _] = patch.quads_of(tile * (FAN + 1));
                assert!((1..=MOST_QUADS).contains(&of_tile), "{of_tile} of {within}");
                assert!(of_tile >= 6 || tiles == 1, "{of_tile} of {within}");
                assert_eq!(tile::cut(leaves(of_tile), of_tile), of_tile);
            }
        }
    }
}

#[test]
fn what_is_displaced_beyond_the_lattice_gets_a_coarser_one() {
    // Only within faces: the lattice is chosen by what they share.
    let far =
        crate::surface::Function::scalar(|at| if at.uv == Vec2::splat(0.5) { 1e7 } else { 0.0 });
    let amount = crate::surface::tests::amount(far, 1.0);
    let surface = surface(Patches::cube(), Displacement::Scalar(amount));
    let rates = Rates::uniform(&surface, 8);
    let tree = compressed(&surface, &rates);
    tree.check(&Diced::new(&surface, &rates), "spikes");
    assert!(tree.bounds(0, 0).extent().max_element() > 9e6);
}

#[test]
fn a_build_can_be_stopped() {
    let surface = surface(Patches::cube(), Displacement::None);
    let rates = Rates::uniform(&surface, 8);
    let stopped = Compressed::build(&surface, &rates, &|_| false);
    assert!(matches!(stopped, Err(crate::Error::Interrupted)));
}

#[test]
fn an_interval_is_open_and_both_sides_are_hit() {
    let surface = surface(Patches::cube(), Displacement::None);
    let tree = compressed(&surface, &Rates::uniform(&surface, 16));
    let ray = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z, 0.0);
    let first = tree.intersect(0, &ray).expect("a hit");
    assert!((first.t - 2.0).abs() < 1e-4 && first.face == 0, "{first:?}");
    assert!(first.normal.normalize().z > 0.999, "{first:?}");
    assert!(
        (first.uv - Vec2::new(0.55, 0.6)).length() < 1e-3,
        "{first:?}"
    );
    let beyond = Ray {
        t_min: first.t,
        ..ray
    };
    let second = tree.intersect(0, &beyond).expect("the other side");
    assert!((second.t - 4.0).abs() < 1e-4, "{second:?}");
    let before = Ray {
        t_max: first.t,
        ..ray
    };
    assert!(tree.intersect(0, &before).is_none());
    // However long the direction is.
    for scale in [1e-20, 1e-6, 1e6, 1e20] {
        let scaled = Ray::new(ray.origin, scale * ray.direction, 0.0);
        let hit = tree.intersect(0, &scaled).expect("a hit");
        assert!((hit.t * scale - first.t).abs() < 1e-5, "{scale}: {hit:?}");
    }
    let empty = self::surface(Patches::empty(), Displacement::None);
    assert!(
        compressed(&empty, &mixed(&empty))
            .intersect(0, &ray)
            .is_none()
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn tiles_enclose_their_vertices(
        columns in 1..=MOST_QUADS,
        rows in 1..=MOST_QUADS,
        keys in 1_usize..3,
        size in -3_i32..23,
        rough in 0_i32..24,
        flat in 0_usize..8,
        seed: u64,
    ) {
        let mut random = Random(seed);
        let mut vector = |size: i32| {
            DVec3::from([(); 3].map(|()| f64::from(random.next() - 0.5))) * 2.0_f64.powi(size)
        };
        let quads = [columns, rows];
        let vertices: Vec<Vec<DVec3>> = (0..keys)
            .map(|_| {
                let (first, du, dv) = (vector(22), vector(size - 3), vector(size - 3));
                (0..=rows)
                    .flat_map(|j| (0..=columns).map(move |i| (i as f64, j as f64)))
                    .map(|(i, j)| {
                        let mut p = first + i * du + j * dv + vector(size - rough);
                        for k in (0..3).filter(|k| flat >> k & 1 == 1) {
                            p[k] = 17.25;
                        }
                        p.clamp(DVec3::splat(-8e6), DVec3::splat(8e6))
                    })
                    .collect()
            })
            .collect();
        let (tiles, _) = fit::tiles(&vertices, quads);
        let stride = columns + 1;
        for leaf in (0..16).filter(|leaf| there(quads) >> leaf & 1 == 1) {
            let ends = |k: usize| {
                let leaf = [leaf % FAN, leaf / FAN][k];
                tile::cut(leaf, quads[k])..=tile::cut(leaf + 1, quads[k])
            };
            let at = |key: usize| Leaf::of(&tiles[key], leaf, quads);
            for (y, x) in ends(1).flat_map(|y| ends(0).map(move |x| (y, x))) {
                for step in 0..4 {
                    let time = 0.25 * step as f32;
                    let moment = Moment::new(keys as u32, time);
                    let slab = at(moment.from).on_the_way(&at(moment.to), &moment);
                    let p = |key: usize| vertices[key][stride * y + x];
                    let p = p(moment.from).lerp(p(moment.to), f64::from(moment.weights[1]));
                    let out = outside(&slab, p);
                    prop_assert!(out <= 0.0, "{} {:?}", out, slab);
                }
            }
        }
    }
}
