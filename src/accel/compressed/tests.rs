//! The compressed surface against its dicing, its instruction sets against each other, rays that must not escape; its
//! boxes against random ones.

use std::sync::Arc;

use proptest::prelude::*;
use rayon::prelude::*;

use super::*;
use crate::accel::Tessellated;
use crate::accel::simd::LANES;
use crate::accel::tests::random_ray;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{Diced, Displacement, Rates, Surface};

fn compressed(surface: &Surface, rates: &Rates, leaf_quads: u16) -> Compressed {
    let options = CompressedOptions { leaf_quads };
    Compressed::build(surface, rates, &options, &|_| true).expect("nobody stops it")
}

impl Compressed {
    fn first_hit(&self, ray: &Ray) -> Option<(u32, Hit)> {
        (0..self.primitives())
            .filter_map(|p| Some((p, self.intersect(p, ray)?)))
            .min_by(|a, b| a.1.t.total_cmp(&b.1.t))
    }

    /// Checks that every box encloses what is below it, which is where `vertex` says. Returns what is below `at`.
    fn check(
        &self,
        face: &Face,
        at: [usize; 3],
        key: usize,
        vertex: &dyn Fn(usize, usize) -> Vec3,
    ) -> Bounds3 {
        let [level, i, j] = at;
        let shape = self.shape(face);
        if level == 0 {
            let [leaves, quads] = [shape.size(0), face.size.map(usize::from)];
            let first = |axis: usize, leaf| first_quad(leaf, leaves[axis], quads[axis]);
            let vertices = (first(1, j)..=first(1, j + 1))
                .flat_map(|y| (first(0, i)..=first(0, i + 1)).map(move |x| (x, y)));
            return Bounds3::of(vertices.map(|(x, y)| vertex(x, y)));
        }
        let node = self.node(face, shape, at, key);
        let [columns, rows] = shape.fan(level, i, j);
        let mut all = Bounds3::EMPTY;
        for (cj, ci) in (0..rows).flat_map(|cj| (0..columns).map(move |ci| (cj, ci))) {
            let below = [level - 1, FAN * i + ci, FAN * j + cj];
            let content = self.check(face, below, key, vertex);
            let child = node.child(FAN * cj + ci);
            assert_eq!(child, child.union(content), "{face:?} {at:?}");
            all = all.union(content);
        }
        all
    }

    /// The same for all faces, whose boxes in the object's space hold all their vertices.
    fn check_all(&self, diced: &Diced, name: &str) {
        for (p, (face, grid)) in (0..).zip(self.faces.iter().zip(diced.grids())) {
            for (key, positions) in diced.positions().iter().enumerate() {
                let vertex = |i, j| positions[grid.vertex(i as u16, j as u16) as usize];
                let root = [self.shape(face).levels(), 0, 0];
                let all = self.check(face, root, key, &|i, j| face.frame.point(vertex(i, j)));
                let largest = all.min.abs().max(all.max.abs()).max_element();
                assert!(largest <= face.reach, "{name}");
                let bounds = self.bounds(p, key as u32);
                let [nu, nv] = face.size.map(usize::from);
                for (j, i) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (j, i))) {
                    assert_eq!(
                        bounds,
                        bounds.including(vertex(i, j)),
                        "{name}: {p} {i} {j}"
                    );
                }
            }
        }
    }
}

#[test]
fn every_box_encloses_what_is_below_it() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            let surface = surface(base.clone().moving(|p| 1.5 * p), displacement);
            for rates in [
                mixed(&surface),
                Rates::by_edge(&surface, |e| 1 + 11 * e % 70),
            ] {
                let diced = Diced::new(&surface, &rates);
                for leaf_quads in [1, 2, 3] {
                    let tree = compressed(&surface, &rates, leaf_quads);
                    tree.check_all(&diced, &format!("{shape} {kind}"));
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
    for scale in [1e-30, 1e-12, 1.0, 1e12, 1e15] {
        for (number, squeeze) in squeezes.into_iter().enumerate() {
            for (kind, displacement) in displacements(0.0) {
                let base = Patches::sphere(2).mapped(|p| scale * squeeze(p));
                let surface = surface(base, displacement);
                let rates = mixed(&surface);
                let diced = Diced::new(&surface, &rates);
                let tree = compressed(&surface, &rates, 2);
                let name = format!("{kind}, squeeze {number}, {scale}");
                tree.check_all(&diced, &name);
                let mut random = Random(1);
                for &p in &diced.positions()[0] {
                    let origin = p + 2.0 * scale * random.direction();
                    let ray = Ray::new(origin, p - origin, 0.0);
                    assert!(tree.first_hit(&ray).is_some(), "{name}: {ray:?}");
                }
            }
        }
    }
}

#[test]
fn instruction_sets_agree_and_hits_are_in_their_boxes() {
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
                let mut tree = compressed(&surface, &mixed(&surface), 1);
                let mut random = Random(3);
                let mut hits = 0;
                for _ in 0..30 {
                    let ray = random_ray(&mut random);
                    for p in 0..tree.primitives() {
                        tree.isa = Isa::all()[0];
                        let expected = tree.intersect(p, &ray);
                        for isa in Isa::all() {
                            tree.isa = isa;
                            assert_eq!(tree.intersect(p, &ray), expected, "{isa:?}");
                            assert_eq!(tree.occluded(p, &ray), expected.is_some());
                        }
                        let Some(hit) = expected else { continue };
                        hits += 1;
                        let face = &tree.faces[p as usize];
                        assert_eq!(hit.face, face.face);
                        assert!(hit.normal.is_finite() && (hit.normal.length() - 1.0).abs() < 1e-5);
                        let met = tree.trace::<false>(face, &ray).expect("as before");
                        let moment = Moment::new(tree.keys, ray.time);
                        let boxes = tree.boxes(face, [met.column, met.row], &moment);
                        let leaf = boxes.leaf(met.column % FAN, met.row % FAN);
                        let at = face.frame.point(ray.at(hit.t));
                        let off = (leaf.min - at).max(at - leaf.max).max_element();
                        assert!(off < 1e-5, "{shape} {kind}: {off}");
                        assert!(hit.error <= leaf.extent().element_sum() + 1e-30);
                        let all = tree.bounds(p, 0).union(tree.bounds(p, tree.keys - 1));
                        assert_eq!(all, all.including(ray.at(hit.t)), "{shape} {kind}");
                    }
                }
                assert!(hits > 10, "{shape} {kind}: {hits}");
            }
        }
    }
}

#[test]
fn boxes_are_hit_where_the_plain_tree_is() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.1) {
            let surface = surface(base.clone(), displacement);
            let rates = Rates::uniform(&surface, 48);
            let plain = Tessellated::build(Arc::new(Diced::new(&surface, &rates)));
            let tree = compressed(&surface, &rates, 1);
            let mut random = Random(5);
            let (mut near, mut all) = (0, 0);
            for _ in 0..300 {
                let ray = random_ray(&mut random);
                let Some(a) = plain.intersect(0, &ray) else {
                    continue;
                };
                let (_, b) = tree.first_hit(&ray).expect("boxes enclose the triangles");
                let point = surface.evaluate(b.face, b.uv, 0);
                assert!(
                    ray.at(b.t).distance(point.position) < 0.2,
                    "{shape} {kind}: {b:?}"
                );
                all += 1;
                near += usize::from(point.normal.dot(b.normal) > 0.5);
                // In front, or in the boxes that the triangle is in.
                let length = ray.direction.length();
                assert!(
                    b.t * length < a.t * length + 0.3,
                    "{shape} {kind}: {a:?} {b:?}"
                );
            }
            // But at creases and poles. Where heights are rough, boxes cannot tell the normal.
            let rough = kind.contains("image") || kind == "heights";
            assert!(
                rough || near * 10 >= all * 9,
                "{shape} {kind}: {near} of {all}"
            );
        }
    }
}

/// A hundred thousand rays (times `RELIEVO_EFFORT`) from inside of closed, creased, displaced shapes of mixed rates,
/// near the origin and far from it, still and moving. None escapes.
#[test]
fn no_ray_escapes() {
    let cases: Vec<_> = [false, true].into_iter().flat_map(leaks::solids).collect();
    let each = effort(100_000).div_ceil(cases.len());
    let escaped: usize = cases
        .par_iter()
        .map(
            |leaks::Solid {
                 name,
                 surface,
                 inside,
             }| {
                let rates = mixed(surface);
                let (tree, diced) = (compressed(surface, &rates, 1), Diced::new(surface, &rates));
                let mut random = Random(7);
                let escaped = (0..each)
                    .filter(|&i| {
                        let mut ray = leaks::ray(&diced, *inside, i, &mut random);
                        ray.time = if i % 3 == 0 { 0.0 } else { random.next() };
                        !(0..tree.primitives()).any(|p| tree.occluded(p, &ray))
                    })
                    .count();
                if escaped > 0 {
                    println!("{name}: {escaped} of {each} rays escaped");
                }
                escaped
            },
        )
        .sum();
    assert_eq!(escaped, 0, "of {} rays", each * cases.len());
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
        pool.install(|| compressed(&surface, &rates, 2))
    });
    assert_eq!(built[0].nodes, built[1].nodes);
    let reaches = built
        .each_ref()
        .map(|tree| -> Vec<_> { tree.faces.iter().map(|f| f.reach).collect() });
    assert_eq!(reaches[0], reaches[1]);
}

#[test]
fn the_lowest_nodes_are_full() {
    for quads in 1..=4096 {
        for leaf_quads in 1..=8 {
            let n = leaves(quads, leaf_quads);
            assert!(n >= 1 && n <= quads, "{n} for {quads}");
            assert!(n.is_multiple_of(4) || n == quads, "{n} for {quads}");
            // No more than half of them again.
            assert!(
                n <= 4 || 2 * n * leaf_quads < 3 * (quads + 3 * leaf_quads),
                "{n} for {quads}"
            );
            let (n, quads) = (usize::from(n), usize::from(quads));
            assert_eq!(
                (first_quad(0, n, quads), first_quad(n, n, quads)),
                (0, quads)
            );
            assert!((0..n).all(|leaf| first_quad(leaf, n, quads) < first_quad(leaf + 1, n, quads)));
        }
    }
}

#[test]
fn a_build_can_be_stopped() {
    let surface = surface(Patches::cube(), Displacement::None);
    let rates = Rates::uniform(&surface, 8);
    let options = CompressedOptions::default();
    let stopped = Compressed::build(&surface, &rates, &options, &|_| false);
    assert!(matches!(stopped, Err(crate::Error::Interrupted)));
}

#[test]
fn an_interval_is_open_and_both_sides_are_hit() {
    let surface = surface(Patches::cube(), Displacement::None);
    let tree = compressed(&surface, &Rates::uniform(&surface, 16), 2);
    let ray = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z, 0.0);
    let (_, first) = tree.first_hit(&ray).expect("a hit");
    assert!((first.t - 2.0).abs() < 1e-4 && first.face == 0, "{first:?}");
    assert!(first.normal.z > 0.9, "{first:?}");
    assert!(
        (first.uv - Vec2::new(0.55, 0.6)).length() < 0.03,
        "{first:?}"
    );
    let beyond = Ray {
        t_min: first.t,
        ..ray
    };
    let (_, second) = tree.first_hit(&beyond).expect("the other side");
    assert!((second.t - 4.0).abs() < 1e-4, "{second:?}");
    let before = Ray {
        t_max: first.t,
        ..ray
    };
    assert!(tree.first_hit(&before).is_none());
    // However long the direction is.
    for scale in [1e-20, 1e-6, 1e6, 1e20] {
        let scaled = Ray::new(ray.origin, scale * ray.direction, 0.0);
        let (_, hit) = tree.first_hit(&scaled).expect("a hit");
        assert!((hit.t * scale - first.t).abs() < 1e-5, "{scale}: {hit:?}");
    }
    let empty = self::surface(Patches::empty(), Displacement::None);
    assert_eq!(compressed(&empty, &mixed(&empty), 2).primitives(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn nodes_enclose_their_children(
        size in -37_i32..38,
        offset in -37_i32..38,
        flat in 0_usize..8,
        there: u16,
        seed: u64,
    ) {
        let mut random = Random(seed);
        let (size, offset) = (10_f32.powi(size), 10_f32.powi(offset));
        let mut corner = || {
            let at = Vec3::from([(); 3].map(|()| random.next() - 0.5));
            let mut at = (size * at + offset).to_array();
            for (k, at) in at.iter_mut().enumerate() {
                if flat >> k & 1 == 1 {
                    *at = -offset;
                }
            }
            Vec3::from(at)
        };
        let mut children = [Bounds3::EMPTY; LANES];
        for (c, child) in children.iter_mut().enumerate() {
            if there >> c & 1 == 1 {
                *child = child.including(corner()).including(corner());
            }
        }
        let node = Node::new(&children);
        for (c, child) in children.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
            let decoded = node.child(c);
            prop_assert_eq!(decoded, decoded.union(*child));
        }
    }
}
