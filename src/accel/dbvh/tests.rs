//! Against single triangles in plain arithmetic, and against rays that must not escape.

use std::sync::Arc;

use rayon::prelude::*;

use super::block::{Block, Quad, Single};
use super::part::Part;
use super::woven::{Net, Woven};
use super::*;
use crate::accel::Intersector;
use crate::accel::lattice::{Extent, LatticeRay};
use crate::accel::quads::Sheared;
use crate::accel::simd::{Body, Lanes};
use crate::accel::tests::random_ray;
use crate::accel::top::Child;
use crate::accel::triangle::origin_in;
use crate::image::Wrap;
use crate::math::Bounds3;
use crate::math::Vec3;
use crate::surface::tests::shapes::{Patches, Random, noise};
use crate::surface::tests::{amount, closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{
    Amount, Channels, Diced, Displacement, Function, ImageMap, Rates, Shell, Space, Surface,
};

fn usual(surface: &Surface, rates: &Rates) -> Dbvh {
    Dbvh::build(surface, rates, &DbvhOptions::default(), &|_| true).expect("it is built")
}

/// Every kind of displacement that it knows, and images of all kinds.
fn scalars(scale: f32) -> Vec<(&'static str, Displacement)> {
    let image = |size, names: &str, wrap, channels| {
        let map = ImageMap::new(noise(size, names, wrap, 5), channels);
        Displacement::Scalar(Amount {
            bias: -0.2 * scale,
            ..amount(map, scale)
        })
    };
    let mut all = displacements(scale);
    all.retain(|(_, displacement)| !matches!(displacement, Displacement::Vector(..)));
    all.push((
        "clamped",
        image([3, 90], "RGB", Wrap::Clamp, Channels::Component(2)),
    ));
    all.push(("black", image([64, 1], "Y", Wrap::Black, Channels::Scalar)));
    all.push((
        "mirrored",
        image([1, 1], "RGBA", Wrap::Mirror, Channels::Scalar),
    ));
    let flat = Function::scalar(|_| 0.4).bounded(|_| Bounds3::of([Vec3::new(0.4, 0.0, 0.0)]));
    all.push(("raised", Displacement::Scalar(amount(flat, scale))));
    all
}

/// A block's vertices across a ray.
struct Vertices<'a> {
    tree: &'a Dbvh,
    patch: &'a Patch,
    block: &'a Block<'a>,
    moment: &'a Moment,
}

impl Body for Vertices<'_> {
    type Output = Sheared;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Sheared {
        let Self {
            tree,
            patch,
            block,
            moment,
        } = self;
        let mut to = Sheared::default();
        let reader = tree.heights.reader();
        let of = (&reader, block);
        if block.face.is_woven() {
            let net = Net::new(tree, block.face, patch, moment);
            let sheet = Woven::new(lanes, block.face, patch, &net);
            tree.vertices(lanes, of, (&sheet, None), moment, |p| p, &mut to);
        } else {
            let numbers = block.face.corners(patch.quad);
            let quad = Quad::new(tree.corners_at(numbers, moment));
            let sheet = Single::new(lanes, tree, patch, block, &quad);
            tree.vertices(lanes, of, (&sheet, None), moment, |p| p, &mut to);
        }
        to
    }
}

/// Blocks of a patch.
fn blocks(tree: &Dbvh, patch: &Patch) -> Vec<face::Span> {
    fn below(face: &Face, part: Part, patch: &Patch, found: &mut Vec<face::Span>) {
        if part.level == 0 {
            found.push(face.span(patch, part.at));
            return;
        }
        let there = face.there(&part);
        for c in (0..16).filter(|c| there >> c & 1 == 1) {
            below(face, part.child(c), patch, found);
        }
    }
    let face = &tree.faces[patch.face as usize];
    let mut found = Vec::new();
    below(face, face.root(patch), patch, &mut found);
    found
}

impl Dbvh {
    /// The micro-vertices of a block on the lattice, as registers compute them.
    fn block_vertices(&self, patch: &Patch, span: &face::Span, moment: &Moment) -> Vec<[f32; 3]> {
        let block = Block::new(self, patch, span);
        let found = self.isa.run(Vertices {
            tree: self,
            patch,
            block: &block,
            moment,
        });
        let [columns, rows] = span.cells;
        let all = (0..=rows).flat_map(|j| (0..=columns).map(move |i| SIDE * j + i));
        let of = |v: &[[f32; 16]; 4], i: usize| v.as_flattened()[i];
        all.map(|i| [of(&found.x, i), of(&found.y, i), of(&found.z, i)])
            .collect()
    }

    /// The nearest `t`, triangle by triangle of the vertices on the lattice.
    fn one_by_one(&self, ray: &Ray) -> Option<f32> {
        let on_lattice = LatticeRay::new(&self.lattice, ray, self.reach);
        let LatticeRay { origin, k, s, .. } = on_lattice;
        let moment = Moment::new(self.keys(), ray.time);
        let mut nearest = ray.t_max;
        for patch in &self.patches {
            for span in blocks(self, patch) {
                let [columns, rows] = span.cells;
                let vertices: Vec<[f32; 3]> = (self.block_vertices(patch, &span, &moment).iter())
                    .map(|p| {
                        let [x, y, z] = k.map(|k| p[k] - origin[k]);
                        [x - s[0] * z, y - s[1] * z, s[2] * z]
                    })
                    .collect();
                for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
                    let at = |i, j| vertices[j * (columns + 1) + i];
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
            }
        }
        (nearest < ray.t_max).then_some(nearest)
    }
}

#[test]
fn every_instruction_set_hits_what_single_triangles_do() {
    for (shape, base) in closed() {
        for (kind, displacement) in scalars(0.15) {
            for moves in [false, true] {
                let base = base.clone();
                let base = if moves {
                    base.moving(|p| p + 0.3 * Vec3::X)
                } else {
                    base
                };
                let surface = surface(base, displacement.clone());
                let mut tree = usual(&surface, &mixed(&surface));
                let mut random = Random(3);
                let (mut hits, mut differing) = (0, 0);
                for _ in 0..6 {
                    let ray = random_ray(&mut random);
                    let expected = tree.one_by_one(&ray);
                    hits += usize::from(expected.is_some());
                    let mut all = Vec::new();
                    for isa in Isa::all() {
                        tree.isa = isa;
                        let got = tree.intersect(0, &ray);
                        assert_eq!(tree.occluded(0, &ray), got.is_some());
                        all.push(got);
                    }
                    let got = all[0];
                    assert!(
                        all.iter().all(|other| *other == got),
                        "{shape} {kind}: {all:?}"
                    );
                    // The same but for roundings, which decide at outlines.
                    let near = match (got.map(|hit| hit.t), expected) {
                        (Some(a), Some(b)) => (a - b).abs() < 1e-4 * b,
                        (a, b) => a == b,
                    };
                    differing += usize::from(!near);
                    if let Some(hit) = got {
                        assert!(hit.error < 1e-5 && hit.normal.is_finite(), "{hit:?}");
                        let box_ = tree.bounds(0, 0).union(tree.bounds(0, tree.keys() - 1));
                        let at = ray.at(hit.t);
                        assert_eq!(box_, box_.including(at), "{shape} {kind}");
                    }
                }
                assert!(
                    hits > 0 && differing < 2,
                    "{shape} {kind}: {differing} of {hits}"
                );
            }
        }
    }
}

/// A value of a map in double precision.
fn value(source: &heights::Source, face: &Face, at: [usize; 2], st: [f64; 2]) -> f64 {
    match source {
        heights::Source::Flat(value) => f64::from(*value),
        heights::Source::Kept(keys) => {
            let number = at[1] * face.micro_vertices()[0] + at[0];
            f64::from(keys[0][face.first_height as usize + number])
        }
        heights::Source::Image(image) => {
            let texels = image.texels();
            let [(x, fx), (y, fy)] = [0, 1].map(|axis| {
                let at = st[axis] * f64::from(texels.size[axis]) - 0.5;
                (at.floor(), at - at.floor())
            });
            let four = texels.four(x as i64, y as i64);
            let [low, high] = four.map(|[a, b]| {
                let (a, b) = (f64::from(a), f64::from(b));
                a + (b - a) * fx
            });
            low + (high - low) * fy
        }
    }
}

/// All micro-triangles by the method's own definition, in double precision: P + h N, all three bilinear between the
/// corners of the shell's quads, h by the map. What edges keep is as it is kept.
fn defined(tree: &Dbvh, shell: &Shell, amount: Option<&Amount>) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    let lattice = &tree.lattice;
    let vertex = |face: &Face, [i, j]: [usize; 2]| -> DVec3 {
        let kept = face.kept([i, j]);
        if face.has_kept && kept != face::NONE {
            let on_lattice = Vec3::from(tree.kept[0][kept as usize]).as_dvec3();
            return lattice.anchor.as_dvec3() + lattice.step() * on_lattice;
        }
        let along = [(i, 0), (j, 1)].map(|(at, k)| {
            let n = usize::from(face.cells[k]);
            let quad = (at / n).min(usize::from(face.quads[k]) - 1);
            (quad as u16, (at - quad * n) as f64 / n as f64)
        });
        let [(qi, u), (qj, v)] = along;
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let corners = face.corners([qi, qj]);
        let of = |value: &dyn Fn(usize) -> DVec3| -> DVec3 {
            (0..4).map(|c| weights[c] * value(corners[c])).sum()
        };
        let position = of(&|c| shell.points(0)[c].position.as_dvec3());
        let normal = of(&|c| shell.points(0)[c].normal.as_dvec3());
        let st = of(&|c| tree.st[c].extend(0.0).as_dvec3());
        let height = amount.map_or(0.0, |amount| {
            let value = value(&tree.heights.source, face, [i, j], [st.x, st.y]);
            f64::from(amount.scale) * value + f64::from(amount.bias)
        });
        position + height * normal
    };
    for face in &tree.faces {
        let [columns, rows] = face.micro_vertices();
        let all: Vec<DVec3> = (0..rows)
            .flat_map(|j| (0..columns).map(move |i| [i, j]))
            .map(|at| vertex(face, at))
            .collect();
        for (i, j) in (0..rows - 1).flat_map(|j| (0..columns - 1).map(move |i| (i, j))) {
            let at = |i: usize, j: usize| all[j * columns + i];
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            triangles.extend([[a, b, c], [d, c, b]]);
        }
    }
    triangles
}

/// The distance from a point to a triangle: to its plane, where that is met within it, or to its sides.
fn distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let to_side = |from: DVec3, to: DVec3| {
        let along = to - from;
        let t = (p - from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
        p.distance(from + t.clamp(0.0, 1.0) * along)
    };
    let normal = (b - a).cross(c - a);
    let within = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|(from, to)| (*to - *from).cross(p - *from).dot(normal) >= 0.0);
    let sides = to_side(a, b).min(to_side(b, c)).min(to_side(c, a));
    if within && normal.length_squared() > 0.0 {
        sides.min((p - a).dot(normal).abs() / normal.length())
    } else {
        sides
    }
}

/// Where rays hit is what is defined, to a hundred thousandth of the shape's size.
#[test]
fn hits_are_on_what_is_defined() {
    let cases: Vec<_> = closed()
        .into_iter()
        .flat_map(|(shape, base)| {
            scalars(0.1)
                .into_iter()
                .map(move |kind| (shape, base.clone(), kind))
        })
        .collect();
    let far: f64 = cases
        .par_iter()
        .map(|(shape, base, (kind, displacement))| {
            let surface = surface(base.clone(), displacement.clone());
            let rates = mixed(&surface);
            let options = DbvhOptions {
                heights: Some([-0.1, 0.1]),
                ..DbvhOptions::default()
            };
            let tree = Dbvh::build(&surface, &rates, &options, &|_| true).expect("it is built");
            let tolerance = ShellTolerance {
                heights: [-0.1, 0.1],
                ..options.tolerance
            };
            let shell = Shell::new(&surface, &rates, &tolerance, Face::fitting);
            assert_eq!(shell.achieved(), tree.shell());
            let amount = match surface.displacement() {
                Displacement::Scalar(amount) => Some(amount),
                _ => None,
            };
            let triangles = defined(&tree, &shell, amount);
            assert_eq!(triangles.len() as u64, tree.micro_triangles());
            let mut random = Random(11);
            let mut most = 0.0_f64;
            for _ in 0..40 {
                let ray = Ray {
                    time: 0.0,
                    ..random_ray(&mut random)
                };
                let Some(hit) = tree.intersect(0, &ray) else {
                    continue;
                };
                let p = ray.origin.as_dvec3() + f64::from(hit.t) * ray.direction.as_dvec3();
                let all = triangles.iter().map(|triangle| distance(p, *triangle));
                most = most.max(all.fold(f64::MAX, f64::min));
            }
            let diagonal = f64::from(tree.bounds(0, 0).extent().length());
            assert!(
                most < 1e-5 * diagonal,
                "{shape} {kind}: {most} of {diagonal}"
            );
            most / diagonal
        })
        .reduce(|| 0.0, f64::max);
    println!("{far} diagonals at most");
}

/// What all say of one place is the same to the bit: blocks, quads and faces beside each other.
#[test]
fn shared_vertices_have_the_same_bits() {
    for (shape, base) in closed() {
        for (kind, displacement) in scalars(0.15) {
            let surface = surface(base.clone(), displacement);
            let rates = Rates::by_edge(&surface, |edge| 3 + 17 * (edge % 3));
            let tree = usual(&surface, &rates);
            let moment = Moment::new(1, 0.0);
            let mut of_face: Vec<std::collections::BTreeMap<[usize; 2], [f32; 3]>> =
                vec![Default::default(); tree.faces.len()];
            for patch in &tree.patches {
                let face = &tree.faces[patch.face as usize];
                for span in blocks(&tree, patch) {
                    let vertices = tree.block_vertices(patch, &span, &moment);
                    let [columns, rows] = span.cells;
                    let places = (0..=rows).flat_map(|j| (0..=columns).map(move |i| [i, j]));
                    for ([i, j], p) in places.zip(vertices) {
                        let in_quad = [span.first[0] + i, span.first[1] + j];
                        let at = [0, 1].map(|k| {
                            usize::from(patch.quad[k]) * usize::from(face.cells[k]) + in_quad[k]
                        });
                        let known = of_face[patch.face as usize].insert(at, p);
                        assert!(
                            known.is_none_or(|known| known == p),
                            "{shape} {kind} {at:?}"
                        );
                        // Single look-ups add bits up alike.
                        assert_eq!(tree.vertex(patch, in_quad, &moment), p, "{shape} {kind}");
                    }
                }
            }
            // Each border's points, of both faces.
            let base = surface.base();
            let mut borders = std::collections::BTreeMap::new();
            for (face, points) in tree.faces.iter().zip(&of_face) {
                let [nu, nv] = face.micro_vertices().map(|n| n - 1);
                for k in 0..4 {
                    let side = |x: usize| match k {
                        0 => [x, 0],
                        1 => [nu, x],
                        2 => [nu - x, nv],
                        _ => [0, nv - x],
                    };
                    let n = if k % 2 == 0 { nu } else { nv };
                    let mut line: Vec<[u32; 3]> = (0..=n)
                        .map(|x| points[&side(x)].map(f32::to_bits))
                        .collect();
                    line.dedup();
                    let used = base.edge(face.face, k);
                    if used.reversed {
                        line.reverse();
                    }
                    let known = borders.entry(used.edge).or_insert_with(|| line.clone());
                    assert_eq!(*known, line, "{shape} {kind}: edge {}", used.edge);
                }
            }
        }
    }
}

#[test]
fn hits_are_near_those_of_the_diced_surface() {
    for (shape, base) in closed() {
        for (kind, displacement) in scalars(0.1) {
            let surface = surface(base.clone(), displacement);
            let rates = Rates::uniform(&surface, 64);
            let plain = crate::accel::Tessellated::build(Arc::new(Diced::new(&surface, &rates)));
            let tree = usual(&surface, &rates);
            let most = tree.micro_triangles() as f64 / plain.diced().triangles() as f64;
            assert!((0.7..1.5).contains(&most), "{shape} {kind}: {most}");
            let mut random = Random(5);
            let (mut near, mut all) = (0, 0);
            for _ in 0..300 {
                let ray = random_ray(&mut random);
                let (Some(a), Some(b)) = (plain.intersect(0, &ray), tree.intersect(0, &ray)) else {
                    continue;
                };
                all += 1;
                let off = ray.at(a.t).distance(ray.at(b.t));
                near += usize::from(a.face == b.face && a.uv.distance(b.uv) < 0.03 && off < 0.02);
            }
            // Silhouettes, creases and edges of faces may fall to either side.
            assert!(near * 20 >= all * 18, "{shape} {kind}: {near} of {all}");
        }
    }
}

#[test]
fn every_box_encloses_what_is_below_it() {
    fn walk(tree: &Dbvh, child: Child, key: usize) -> Extent {
        let moment = Moment {
            from: key,
            to: key,
            weights: [1.0, 0.0],
        };
        match child {
            Child::Node(number) => {
                let node = tree.top.node(number, key);
                (0..node.children()).fold(Extent::EMPTY, |all, c| {
                    let below = walk(tree, node.child(c), key);
                    let around = node.boxes.get(c);
                    assert_eq!(around, around.union(below));
                    all.union(below)
                })
            }
            Child::Patch(number) => {
                let patch = &tree.patches[number as usize];
                let all = blocks(tree, patch).into_iter();
                let points = all.flat_map(|span| tree.block_vertices(patch, &span, &moment));
                let points: Vec<DVec3> = points.map(|p| Vec3::from(p).as_dvec3()).collect();
                Extent::around(&points)
            }
        }
    }
    for (shape, base) in closed() {
        for (kind, displacement) in scalars(0.2) {
            for base in [base.clone(), base.clone().moving(|p| 1.5 * p)] {
                let surface = surface(base, displacement.clone());
                let rates = Rates::by_edge(&surface, |edge| if edge % 2 == 0 { 3 } else { 40 });
                let tree = usual(&surface, &rates);
                for key in 0..tree.keys() {
                    let content = walk(&tree, tree.top.root().expect("a root"), key as usize);
                    let bounds = tree.bounds(0, key);
                    for corner in [content.min, content.max] {
                        let at = tree.lattice.position(corner).as_vec3();
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
        leaks::along_normals(),
        |surface, rates| usual(surface, rates),
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
        pool.install(|| usual(&surface, &rates))
    });
    assert_eq!(built[0].ranges, built[1].ranges);
    assert_eq!(built[0].patches, built[1].patches);
    assert_eq!(built[0].corners, built[1].corners);
    assert_eq!(built[0].kept, built[1].kept);
    assert!(built[0].top == built[1].top);
}

#[test]
fn what_cannot_be_traced_is_told_and_a_build_can_be_stopped() {
    let rates = |surface: &Surface| Rates::uniform(surface, 8);
    let build = |surface: &Surface, go_on: bool| {
        Dbvh::build(surface, &rates(surface), &DbvhOptions::default(), &|_| {
            go_on
        })
    };
    let flat = surface(Patches::cube(), Displacement::None);
    assert!(matches!(
        build(&flat, false),
        Err(crate::Error::Interrupted)
    ));
    let vectors = Function::vector(|_| Vec3::ONE);
    let moved = Displacement::Vector(amount(vectors, 0.1), Space::Object);
    let refused = build(&surface(Patches::cube(), moved), true)
        .err()
        .expect("it is refused");
    assert_eq!(refused.exit_code(), 2);
    let nothing = usual(
        &surface(Patches::empty(), Displacement::None),
        &rates(&surface(Patches::empty(), Displacement::None)),
    );
    assert!(
        nothing
            .intersect(0, &Ray::new(Vec3::ZERO, Vec3::X, 0.0))
            .is_none()
    );
    assert!(nothing.bounds(0, 0).is_empty());
}
