//! The compressed surface against its own triangles one by one, against its dicing, and against rays that must not
//! escape; its encoding against random grids.

use std::sync::Arc;

use proptest::prelude::*;

use super::block::{CELLS, Head, PADDING, SIDE, Vertices};
use super::patch::FAN;
use super::*;
use crate::accel::lattice::{Extent, LatticeRay};
use crate::accel::moment::Moment;
use crate::accel::simd::Isa;
use crate::accel::tests::random_ray;
use crate::accel::top::Child;
use crate::accel::triangle::origin_in;
use crate::math::{Vec2, Vec3};
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{Diced, Displacement, Rates, Surface};

fn compact(surface: &Surface, rates: &Rates, options: CompactOptions) -> Compact {
    Compact::build(surface, rates, &options, &|_| true).expect("nobody stops it")
}

fn usual(surface: &Surface) -> Compact {
    compact(surface, &mixed(surface), CompactOptions::default())
}

impl Compact {
    /// A vertex of a face on the lattice.
    fn vertex(&self, face: usize, i: usize, j: usize, key: usize) -> [i32; 3] {
        // The last vertices belong to the last patches and blocks.
        let [nu, nv] = self.skeleton.faces[face].size.map(usize::from);
        let (x, y) = (i.min(nu - 1), j.min(nv - 1));
        let is_in = |patch: &&Patch| {
            let place = [patch.column, patch.row].map(usize::from);
            patch.face as usize == face && place == [x / SPAN, y / SPAN]
        };
        let patch = self
            .skeleton
            .patches
            .iter()
            .find(is_in)
            .expect("it is in a patch");
        let (column, row) = (x % SPAN / CELLS, y % SPAN / CELLS);
        let head = self.view(patch).head(FAN * row + column, key);
        head.vertex(
            &self.data,
            i - x / SPAN * SPAN - CELLS * column,
            j - y / SPAN * SPAN - CELLS * row,
        )
    }

    /// All vertices of a patch's block.
    fn content(&self, patch: &Patch, block: usize, key: usize) -> Extent {
        let fan = patch.fan();
        let head = self.view(patch).head(block, key);
        let [columns, rows] = fan.cells_of(block);
        (0..=rows)
            .flat_map(|j| (0..=columns).map(move |i| (i, j)))
            .fold(Extent::EMPTY, |all, (i, j)| {
                all.including(head.vertex(&self.data, i, j))
            })
    }

    /// The nearest `t` on a face, triangle by triangle, in the arithmetic of the traversal.
    fn one_by_one(&self, face: usize, ray: &Ray) -> Option<f32> {
        let on_lattice = LatticeRay::new(&self.skeleton.lattice, ray, self.skeleton.reach);
        let LatticeRay { origin, k, s, .. } = on_lattice;
        let moment = Moment::new(self.skeleton.keys, ray.time);
        let [nu, nv] = self.skeleton.faces[face].size.map(usize::from);
        let vertices: Vec<[f32; 3]> = (0..=nv)
            .flat_map(|j| (0..=nu).map(move |i| (i, j)))
            .map(|(i, j)| {
                let at = |key| Vec3::from(self.vertex(face, i, j, key).map(|x| x as f32));
                let p = moment.between(at(moment.from), at(moment.to)).to_array();
                let [x, y, z] = k.map(|k| p[k] - origin[k]);
                [x - s[0] * z, y - s[1] * z, s[2] * z]
            })
            .collect();
        let mut nearest = ray.t_max;
        for (i, j) in (0..nv).flat_map(|j| (0..nu).map(move |i| (i, j))) {
            let at = |i, j| vertices[j * (nu + 1) + i];
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            for corners in [[a, b, c], [d, c, b]] {
                let of = |k: usize| corners.map(|corner| corner[k]);
                if let Some(hit) = origin_in(of(0), of(1), of(2))
                    && hit.t > ray.t_min
                    && hit.t < nearest
                {
                    nearest = hit.t;
                }
            }
        }
        (nearest < ray.t_max).then_some(nearest)
    }
}

#[test]
fn every_instruction_set_hits_what_single_triangles_do() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.15) {
            for moves in [false, true] {
                let base = base.clone();
                let base = if moves {
                    base.moving(|p| p + 0.3 * Vec3::X)
                } else {
                    base
                };
                let mut tree = usual(&surface(base, displacement.clone()));
                let mut random = Random(3);
                let mut hits = 0;
                for _ in 0..30 {
                    let ray = random_ray(&mut random);
                    let faces = (0..tree.skeleton.faces.len())
                        .filter_map(|face| tree.one_by_one(face, &ray));
                    let expected = faces.min_by(f32::total_cmp);
                    hits += usize::from(expected.is_some());
                    for isa in Isa::all() {
                        tree.skeleton.isa = isa;
                        let got = tree.intersect(0, &ray);
                        assert_eq!(got.map(|hit| hit.t), expected, "{shape} {kind} {isa:?}");
                        assert_eq!(tree.occluded(0, &ray), expected.is_some());
                        if let Some(hit) = got {
                            assert!(hit.error < 1e-5 && hit.normal.is_finite(), "{hit:?}");
                            let box_ = tree
                                .bounds(0, 0)
                                .union(tree.bounds(0, tree.skeleton.keys - 1));
                            let at = ray.at(hit.t);
                            assert_eq!(box_, box_.including(at), "{shape} {kind}");
                        }
                    }
                }
                assert!(hits > 10, "{shape} {kind}: {hits}");
            }
        }
    }
}

#[test]
fn hits_are_those_of_the_plain_tree_but_for_the_error() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.1) {
            let surface = surface(base.clone(), displacement);
            let rates = mixed(&surface);
            let plain = crate::accel::Tessellated::build(Arc::new(Diced::new(&surface, &rates)));
            let options = CompactOptions {
                max_error: MaxError::Units(1e-5),
            };
            let tree = compact(&surface, &rates, options);
            let mut random = Random(5);
            let (mut near, mut all) = (0, 0);
            for _ in 0..300 {
                let ray = random_ray(&mut random);
                let (Some(a), Some(b)) = (plain.intersect(0, &ray), tree.intersect(0, &ray)) else {
                    continue;
                };
                let cos = a.normal.normalize().dot(ray.direction.normalize()).abs();
                let off = ray.at(a.t).distance(ray.at(b.t)) * cos;
                all += 1;
                near += usize::from(a.face == b.face && a.uv.distance(b.uv) < 1e-2 && off < 1e-4);
            }
            // Silhouettes and edges of faces may fall to either side.
            assert!(near * 50 >= all * 49, "{shape} {kind}: {near} of {all}");
        }
    }
}

#[test]
fn vertices_are_as_near_to_the_dicing_as_promised() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            let surface = surface(base.clone().moving(|p| 1.5 * p), displacement);
            let rates = mixed(&surface);
            let diced = Diced::new(&surface, &rates);
            for max_error in [1e-3, 3e-6] {
                let options = CompactOptions {
                    max_error: MaxError::Units(max_error),
                };
                let tree = compact(&surface, &rates, options);
                let (mut largest, mut sum, mut count) = (0.0_f64, 0.0, 0);
                for (face, grid) in diced.grids().iter().enumerate() {
                    let [nu, nv] = grid.size;
                    for (i, j) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))) {
                        for key in 0..2 {
                            let p = diced.positions()[key][grid.vertex(i, j) as usize];
                            let q = tree.vertex(face, i.into(), j.into(), key);
                            let off = tree.skeleton.lattice.position(q).distance(p.as_dvec3());
                            largest = largest.max(off);
                            sum += off * off;
                            count += 1;
                        }
                    }
                }
                let bound = f64::from(max_error) * 1.000_001;
                assert!(largest <= bound, "{shape} {kind}: {largest} {max_error}");
                let Accuracy { max, rms, .. } = tree.accuracy();
                assert!((max - largest).abs() < 1e-3 * max, "{max} {largest}");
                let mean = (sum / f64::from(count)).sqrt();
                assert!((rms - mean).abs() < 0.2 * rms, "{rms} {mean}");
            }
        }
    }
}

#[test]
fn every_box_encloses_what_is_below_it() {
    /// What is below a child of the tree over patches, which the given boxes enclose.
    fn walk(tree: &Compact, child: Child, key: usize) -> Extent {
        let mut all = Extent::EMPTY;
        let mut below = |around: Extent, content: Extent| {
            assert_eq!(around, around.union(content), "{child:?}");
            all = all.union(content);
        };
        match child {
            Child::Node(number) => {
                let node = tree.skeleton.top.node(number, key);
                for c in 0..node.children() {
                    below(node.boxes.get(c), walk(tree, node.child(c), key));
                }
            }
            Child::Patch(number) => {
                let patch = &tree.skeleton.patches[number as usize];
                let fan = patch.fan();
                for block in (0..16).filter(|block| fan.there() >> block & 1 == 1) {
                    let content = tree.content(patch, block, key);
                    let around = if tree.skeleton.has_node(&fan) {
                        tree.nodes[patch.root as usize + key].boxes.get(block)
                    } else {
                        content
                    };
                    below(around, content);
                }
            }
        }
        all
    }
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            for base in [base.clone(), base.clone().moving(|p| 1.5 * p)] {
                let surface = surface(base, displacement.clone());
                // Faces of many patches, and of less than a block.
                let rates = Rates::by_edge(&surface, |edge| if edge % 2 == 0 { 3 } else { 40 });
                let tree = compact(&surface, &rates, CompactOptions::default());
                for key in 0..tree.skeleton.keys {
                    let root = tree.skeleton.top.root().expect("there are faces");
                    let content = walk(&tree, root, key as usize);
                    let bounds = tree.bounds(0, key);
                    for corner in [content.min, content.max] {
                        let at = tree.skeleton.lattice.position(corner).as_vec3();
                        assert_eq!(bounds, bounds.including(at), "{shape} {kind}");
                    }
                }
            }
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
        |surface, _| usual(surface),
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
        pool.install(|| compact(&surface, &rates, CompactOptions::default()))
    });
    assert_eq!(built[0].data, built[1].data);
    assert_eq!(built[0].nodes, built[1].nodes);
    assert_eq!(built[0].skeleton.patches, built[1].skeleton.patches);
    assert!(built[0].skeleton.top == built[1].skeleton.top);
    assert_eq!(built[0].accuracy, built[1].accuracy);
}

#[test]
fn what_is_displaced_beyond_the_lattice_gets_a_coarser_one() {
    // Only within faces: the lattice is chosen by what they share.
    let far =
        crate::surface::Function::scalar(|at| if at.uv == Vec2::splat(0.5) { 1e7 } else { 0.0 });
    let amount = crate::surface::tests::amount(far, 1.0);
    let surface = surface(Patches::cube(), Displacement::Scalar(amount));
    let tree = compact(
        &surface,
        &Rates::uniform(&surface, 8),
        CompactOptions::default(),
    );
    assert!(tree.accuracy().max < 100.0, "{:?}", tree.accuracy());
    assert!(tree.bounds(0, 0).extent().max_element() > 9e6);
}

#[test]
fn a_build_can_be_stopped() {
    let surface = surface(Patches::cube(), Displacement::None);
    let rates = Rates::uniform(&surface, 8);
    let stopped = Compact::build(&surface, &rates, &CompactOptions::default(), &|_| false);
    assert!(matches!(stopped, Err(crate::Error::Interrupted)));
}

#[test]
fn an_interval_is_open_and_both_sides_are_hit() {
    let surface = surface(Patches::cube(), Displacement::None);
    let tree = compact(
        &surface,
        &Rates::uniform(&surface, 16),
        CompactOptions::default(),
    );
    let ray = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z, 0.0);
    let first = tree.intersect(0, &ray).expect("a hit");
    assert!((first.t - 2.0).abs() < 1e-4 && first.face == 0, "{first:?}");
    assert!(first.normal.z > 0.0 && (first.uv - Vec2::new(0.55, 0.6)).length() < 1e-3);
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
    assert!(usual(&empty).intersect(0, &ray).is_none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn blocks_come_back(
        columns in 2..=SIDE,
        rows in 2..=SIDE,
        size in 0_u32..24,
        slope in -50_000_i32..50_000,
        seed: u64,
    ) {
        let mut random = Random(seed);
        let most = (1_i64 << size) - 1;
        let mut value = |i: usize, j: usize| {
            let noise = (f64::from(random.next()) * 2.0 * most as f64) as i64 - most;
            let plane = i64::from(slope) * (i as i64 - j as i64) / 2;
            (noise + plane).clamp(1 - (1 << 23), (1 << 23) - 1) as i32
        };
        let mut vertices = [[0; 3]; SIDE * SIDE];
        for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
            let [x, y, z] = [(); 3].map(|()| value(i, j));
            // Sometimes one axis follows another.
            let y = if seed.is_multiple_of(2) { x / 3 } else { y };
            vertices[j * SIDE + i] = [x, y, z];
        }
        let block = Vertices::new([columns, rows], |i, j| vertices[j * SIDE + i]);
        let mut data = vec![7; 4];
        block.write(&mut data);
        data.resize(data.len() + PADDING, 0);
        let head = Head::read(&data, 4, [columns, rows]);
        for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
            let expected = [0, 1, 2].map(|k| block.values[k][j * SIDE + i]);
            prop_assert_eq!(head.vertex(&data, i, j), expected);
        }
    }

    #[test]
    fn nodes_enclose_their_children(size in 0_u32..23, there: u16, seed: u64) {
        let mut random = Random(seed);
        let most = f64::from((1_i32 << size) - 1);
        let mut corner = || [(); 3].map(|()| (f64::from(random.next() - 0.5) * 2.0 * most) as i32);
        let mut children = [Extent::EMPTY; 16];
        for (c, child) in children.iter_mut().enumerate() {
            if there >> c & 1 == 1 {
                *child = child.including(corner()).including(corner());
            }
        }
        let sizes = std::array::from_fn(|c| c as u8);
        let node = Node::new(&children, 100, sizes);
        for (c, child) in children.iter().enumerate() {
            prop_assert_eq!(node.block(c), 4 * (100 + c * c.saturating_sub(1) / 2));
            if !child.is_empty() {
                let decoded = node.boxes.get(c);
                prop_assert_eq!(decoded, decoded.union(*child));
            }
        }
    }
}

#[test]
fn errors_may_be_asked_for_in_pixels_and_in_diagonals() {
    struct Ahead;
    impl crate::surface::View for Ahead {
        fn position(&self) -> Vec3 {
            10.0 * Vec3::Z
        }
        fn pixels_per_unit(&self, _: Vec3) -> f32 {
            50.0
        }
        fn outside(&self, _: Vec3, _: f32) -> f32 {
            0.0
        }
    }
    let surface = surface(Patches::sphere(2), Displacement::None);
    let here = [crate::math::Affine3A::IDENTITY];
    let places = crate::surface::Places::nearest(&Ahead, &Bounds3::of([Vec3::ZERO]), &here);
    let seen = Rates::on_screen(&surface, &places, &crate::surface::Dicing::default());
    let build = |rates: &Rates, max_error| {
        Compact::build(&surface, rates, &CompactOptions { max_error }, &|_| true)
    };
    let accuracy = |rates, max_error| build(rates, max_error).expect("it is built").accuracy();
    let diagonal = accuracy(&seen, MaxError::Usual).diagonal;
    assert!((diagonal - 2.0 * 3.0_f64.sqrt()).abs() < 0.01, "{diagonal}");
    for (max_error, expected) in [
        (MaxError::Pixels(0.1), 0.1 / 50.0),
        (MaxError::Diagonals(1e-3), 1e-3 * diagonal),
        (MaxError::Usual, 3.6e-5 * diagonal),
    ] {
        let accuracy = accuracy(&seen, max_error);
        assert!(
            (accuracy.asked / expected - 1.0).abs() < 1e-3,
            "{accuracy:?}"
        );
        assert!(
            accuracy.max <= accuracy.asked * (1.0 + 1e-6),
            "{accuracy:?}"
        );
        assert!(accuracy.max > 0.9 * accuracy.asked, "{accuracy:?}");
    }
    // The lattice has 24 bits: it says what that achieves.
    let finest = accuracy(&seen, MaxError::Diagonals(1e-9));
    assert!(finest.max > finest.asked && finest.max < 1e-6, "{finest:?}");
    let blind = build(&mixed(&surface), MaxError::Pixels(0.25)).map(|_| ());
    assert_eq!(blind.expect_err("no pixels are known").exit_code(), 2);
}
