//! Bent rays against a loop over all micro-triangles in double precision, and rays that must not escape.

use proptest::prelude::*;

use super::*;
use crate::accel::Intersector;
use crate::accel::tests::{met_in_double, random_ray};
use crate::accel::traversal::place;
use crate::error::Error;
use crate::math::Bounds3;
use crate::math::DVec2;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{Displacement, Rates, Surface};

fn nonlinear(surface: &Surface, rates: &Rates) -> Nonlinear {
    Nonlinear::build(surface, rates, &|_| true).expect("nobody stops it")
}

fn heights() -> impl Iterator<Item = (&'static str, Displacement)> {
    let all = displacements(0.1).into_iter();
    all.filter(|(_, displacement)| !matches!(displacement, Displacement::Vector(..)))
}

/// What a loop knows of a hit.
#[derive(Debug, Clone, Copy)]
struct Brute {
    t: f64,
    /// How far inside of its triangle, as a weight.
    inside: f64,
}

/// A convex polygon in two, where a line passes.
fn split(polygon: &[DVec2], side: impl Fn(DVec2) -> f64) -> [Vec<DVec2>; 2] {
    let mut parts = [Vec::new(), Vec::new()];
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        let (x, y) = (side(a), side(b));
        if x <= 0.0 {
            parts[0].push(a);
        }
        if x >= 0.0 {
            parts[1].push(a);
        }
        if x * y < 0.0 {
            let cut = a + x / (x - y) * (b - a);
            parts.iter_mut().for_each(|part| part.push(cut));
        }
    }
    parts
}

impl Nonlinear {
    /// The point of a quad at u and v in micro-quads, in double precision.
    fn point(&self, quad: &Quad, uv: [f64; 2], moment: &Moment) -> DVec3 {
        let cell = [0, 1].map(|k| (quad.first[k] + uv[k] as u32).min(quad.last[k]));
        let [x, y] = [0, 1].map(|k| uv[k] - f64::from(cell[k] - quad.first[k]));
        let [a, b, c, d] = self.cell(quad, cell, moment).map(f64::from);
        let height = if x + y <= 1.0 {
            a + x * (b - a) + y * (c - a)
        } else {
            d + (1.0 - x) * (c - d) + (1.0 - y) * (b - d)
        };
        let weights = weights(quad.part(uv));
        let corners = self.corners(quad.corner, moment);
        (0..4)
            .map(|k| weights[k] * (corners[k][0] + height * corners[k][1]))
            .sum()
    }

    /// The nearest hit among straight triangles that halve the micro-edges so many times; they are a little off those
    /// that are traced, which are bent. None reaches across a diagonal, of its micro-quad or of its quad.
    fn brute_force(&self, ray: &Ray, halvings: u32) -> Option<Brute> {
        let moment = Moment::new(self.keys, ray.time);
        let mut nearest: Option<Brute> = None;
        let mut test = |a: DVec3, b: DVec3, c: DVec3| {
            if let Some((t, inside)) = met_in_double(ray, [a, b, c])
                && nearest.is_none_or(|n| t < n.t)
            {
                nearest = Some(Brute { t, inside });
            }
        };
        for number in 0..self.quads.len() as u32 {
            let quad = &self.quad(number);
            let fine = f64::from(1 << halvings);
            // Where the quad begins and ends, and the lines in between.
            let lines = [0, 1].map(|k| {
                let (begin, end) = (quad.begin[k], quad.end[k]);
                let inner = (begin * fine) as u32 + 1..(end * fine).ceil() as u32;
                let inner = inner.map(|x| f64::from(x) / fine);
                [begin].into_iter().chain(inner).chain([end]).collect()
            });
            let [us, vs]: [Vec<f64>; 2] = lines;
            let point = |uv: DVec2| self.point(quad, uv.to_array(), &moment);
            let of_quad = |uv: DVec2| {
                let [x, y] = quad.part(uv.to_array());
                x + y - 1.0
            };
            let row =
                |v: f64| -> Vec<DVec3> { us.iter().map(|&u| point(DVec2::new(u, v))).collect() };
            let mut below = row(vs[0]);
            for v in vs.windows(2) {
                let above = row(v[1]);
                for (i, u) in us.windows(2).enumerate() {
                    let [p, q, r, s] =
                        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| DVec2::new(u[i], v[j]));
                    let cell = (0.5 * (p + r)).floor();
                    let of_cell = |uv: DVec2| (uv - cell).element_sum() - 1.0;
                    let is_cut = |by: &dyn Fn(DVec2) -> f64| by(p) < -1e-9 && by(r) > 1e-9;
                    let is_regular =
                        (of_cell(q).abs() + of_cell(s).abs() < 1e-9) || !is_cut(&of_cell);
                    if is_regular && !is_cut(&of_quad) {
                        test(below[i], below[i + 1], above[i]);
                        test(above[i + 1], above[i], below[i + 1]);
                        continue;
                    }
                    for part in split(&[p, q, r, s], of_cell) {
                        for part in split(&part, of_quad) {
                            for k in 2..part.len() {
                                test(point(part[0]), point(part[k - 1]), point(part[k]));
                            }
                        }
                    }
                }
                below = above;
            }
            self.walls(quad, fine, &moment, &mut test);
        }
        nearest
    }

    /// The walls along a quad's sides, cut so many times a micro-edge.
    fn walls(
        &self,
        quad: &Quad,
        fine: f64,
        moment: &Moment,
        test: &mut impl FnMut(DVec3, DVec3, DVec3),
    ) {
        let all = self.corners(quad.corner, moment);
        for (triangle, side) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2)] {
            let Some(k) = self.border(quad, triangle, side) else {
                continue;
            };
            let axis = k % 2;
            let (begin, end) = (quad.begin[axis], quad.end[axis]);
            let steps = (32.0 * fine * (end - begin)) as usize;
            let ends = |step: usize| {
                let along = begin + (end - begin) * step as f64 / steps as f64;
                let across = [quad.begin, quad.end][usize::from(k == 1 || k == 2)][1 - axis];
                let uv = if axis == 0 {
                    [along, across]
                } else {
                    [across, along]
                };
                let weights = weights(quad.part(uv));
                let heights = self.wall(quad, k, uv, moment);
                heights.map(|height| -> DVec3 {
                    let at = |k: usize| weights[k] * (all[k][0] + height * all[k][1]);
                    (0..4).map(at).sum()
                })
            };
            for step in 0..steps {
                let ([a, b], [c, d]) = (ends(step), ends(step + 1));
                test(a, b, c);
                test(d, c, b);
            }
        }
    }

    /// A surface of a single quad.
    fn of_quad(corners: [[Vec3; 2]; 4], size: Size, heights: Vec<u16>) -> Self {
        let mut ranges = Vec::new();
        field::ranges(size, &heights, &mut ranges);
        let [nu, nv] = size.quads();
        let row = |from: usize, step: usize, n: usize| -> Vec<u16> {
            (0..=n).map(|x| heights[from + x * step]).collect()
        };
        let mut edges = Edges::default();
        edges.push(&[row(0, 1, nu)]);
        edges.push(&[row(nu, nu + 1, nv)]);
        edges.push(&[row(nv * (nu + 1), 1, nu)]);
        edges.push(&[row(0, nu + 1, nv)]);
        let (low, high) = heights
            .iter()
            .fold((u16::MAX, 0), |(a, b), &h| (a.min(h), b.max(h)));
        let mut new = Self {
            isa: Isa::best(),
            lattice: Lattice::around(&Bounds3::EMPTY, 0.0),
            reach: 0.0,
            keys: 1,
            left_handed: false,
            cuts: 1,
            top: Top::default(),
            quads: vec![Leaf {
                face: 0,
                place: [0, 0],
                low,
                high,
            }],
            faces: vec![Face {
                face: 0,
                corner: 0,
                heights: 0,
                ranges: 0,
                size,
                collapsed: 0,
                edges: [0, 1, 2, 3].map(|edge| EdgeUse {
                    edge,
                    reversed: edge > 1,
                }),
            }],
            corners: corners.to_vec(),
            heights,
            ranges,
            edges,
            shifts: Vec::new(),
            achieved: AchievedError::default(),
        };
        new.arrange(4);
        new
    }
}

#[test]
fn hits_are_those_of_a_loop_over_all_triangles() {
    for (shape, base) in closed() {
        for (kind, displacement) in heights() {
            let surface = surface(base.clone().moving(|p| p + 0.3 * Vec3::X), displacement);
            let tree = nonlinear(&surface, &mixed(&surface));
            let mut random = Random(3);
            let mut hits = 0;
            for _ in 0..60 {
                let ray = random_ray(&mut random);
                let (expected, got) = (tree.brute_force(&ray, 1), tree.intersect(0, &ray));
                assert_eq!(tree.occluded(0, &ray), got.is_some(), "{shape} {kind}");
                match (expected, got) {
                    (None, None) => {}
                    (Some(Brute { t, inside }), Some(hit)) => {
                        hits += 1;
                        // Where the ray grazes the loop's triangles, bent ones are met elsewhere.
                        let near = (t - f64::from(hit.t)).abs() < 2e-2;
                        assert!(
                            near || inside < 0.02,
                            "{shape} {kind}: {t} {inside} {hit:?}"
                        );
                        let here = surface
                            .evaluate(hit.face, hit.uv, 0)
                            .position
                            .lerp(surface.evaluate(hit.face, hit.uv, 1).position, ray.time);
                        assert!(here.distance(ray.at(hit.t)) < 0.5, "{shape} {kind}: {here}");
                        assert!(hit.error < 1e-4, "{hit:?}");
                        assert!(hit.normal.is_finite());
                    }
                    (Some(Brute { inside, .. }), None) => {
                        assert!(inside < 0.02, "{shape} {kind}: {inside}");
                    }
                    (None, Some(hit)) => {
                        // An outline that is bent outward.
                        let cos = hit.normal.normalize().dot(ray.direction.normalize()).abs();
                        assert!(cos < 0.3, "{shape} {kind}: {hit:?} on nothing");
                    }
                }
            }
            assert!(hits > 10, "{shape} {kind}: {hits}");
        }
    }
}

/// Distances to the bent micro-triangles in double precision, across them: below 1e-5 of the diagonal.
#[test]
fn hits_lie_on_the_bent_triangles() {
    for (shape, base) in closed() {
        for (kind, displacement) in heights() {
            let surface = surface(base.clone().moving(|p| p + 0.3 * Vec3::X), displacement);
            let tree = nonlinear(&surface, &mixed(&surface));
            let diagonal = f64::from(tree.bounds(0, 0).extent().length());
            let mut random = Random(11);
            let mut largest = 0.0_f64;
            for _ in 0..2000 {
                let ray = random_ray(&mut random);
                let Some(met) = place(&mut &tree, &ray) else {
                    continue;
                };
                let moment = Moment::new(tree.keys, ray.time);
                let quad = tree.quad(met.quad);
                let point = tree.point(&quad, met.uv.map(f64::from), &moment);
                let hit = tree.hit_on(&ray, &met);
                let normal = hit.normal.as_dvec3().normalize_or_zero();
                let gap =
                    ray.origin.as_dvec3() + f64::from(met.t) * ray.direction.as_dvec3() - point;
                largest = largest.max(gap.dot(normal).abs());
            }
            assert!(largest < 1e-5 * diagonal, "{shape} {kind}: {largest}");
        }
    }
}

/// A million rays (times `RELIEVO_EFFORT`) from inside of closed, creased, displaced shapes of mixed rates, near the
/// origin and far from it, still and moving; a quarter of them at micro-vertices. None escapes.
#[test]
fn no_ray_escapes() {
    let lost = leaks::lost(
        effort(1_000_000),
        leaks::along_normals(),
        |surface, rates| nonlinear(surface, rates),
        |tree, mut ray, i, random| {
            if i % 4 == 0 {
                let quad = (random.next() * tree.quads.len() as f32) as usize;
                let quad = &tree.quad(quad.min(tree.quads.len() - 1) as u32);
                let uv = [0, 1].map(|k| {
                    let count = quad.last[k] - quad.first[k] + 2;
                    let at = (random.next() * count as f32).floor();
                    // A half of them on edges.
                    let at = if i % 8 == 0 {
                        at
                    } else {
                        (at / (count - 1) as f32).round() * (count - 1) as f32
                    };
                    f64::from(at).clamp(quad.begin[k], quad.end[k])
                });
                let moment = Moment::new(tree.keys, ray.time);
                ray.direction = tree.point(quad, uv, &moment).as_vec3() - ray.origin;
            }
            tree.occluded(0, &ray)
        },
    );
    assert_eq!(lost, 0);
}

/// Prisms that lean, twist, shrink to a point or turn over, heights that jump: rays hit them where the loop says.
fn awkward(seed: u64, twist: f32, log: u8, flat: bool) -> Result<(), TestCaseError> {
    let mut random = Random(seed);
    let mut near = |by: f32| by * random.direction() * random.next();
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|[x, y]| {
        [
            Vec3::new(x, y, 0.0) + near(0.3),
            (0.4 * Vec3::Z + near(twist)) / 1000.0,
        ]
    });
    let size = Size([1 << log, 4 << (seed % 3)]);
    let heights: Vec<u16> = (0..size.quads().map(|n| n + 1).iter().product())
        .map(|_| {
            if flat {
                500
            } else {
                300 + (400.0 * random.next()) as u16
            }
        })
        .collect();
    let tree = Nonlinear::of_quad(corners, size, heights);
    for _ in 0..20 {
        let target = Vec3::new(random.next(), random.next(), 0.2);
        let origin = target + 2.0 * random.direction();
        let ray = Ray::new(origin, target - origin, 0.0);
        let (coarse, fine) = (tree.brute_force(&ray, 0), tree.brute_force(&ray, 3));
        let got = tree.intersect(0, &ray);
        prop_assert_eq!(tree.occluded(0, &ray), got.is_some());
        let t = got.map(|hit| f64::from(hit.t));
        // Crests bulge over the straight edges of a loop, and are cut off by them: where a loop says other than the tree, one
        // of much smaller triangles decides.
        let is_there = || {
            let finer = tree.brute_force(&ray, 7);
            match (t, finer) {
                (Some(t), Some(finer)) => (finer.t - t).abs() < 1e-3,
                (t, finer) => t.is_none() && finer.is_none(),
            }
        };
        // What bent and straight triangles, and finer ones, agree on.
        match (coarse, fine) {
            (Some(a), Some(b)) if (a.t - b.t).abs() < 3e-3 && a.inside.min(b.inside) > 0.05 => {
                // A crest that the ray passes within a rounding of is met: that must be on the surface, and before.
                let grazes = place(&mut &tree, &ray).is_some_and(|met| {
                    let uv = met.uv.map(f64::from);
                    let on = tree.point(&tree.quad(met.quad), uv, &Moment::new(1, 0.0));
                    let at = ray.origin.as_dvec3() + f64::from(met.t) * ray.direction.as_dvec3();
                    f64::from(met.t) < b.t && on.distance(at) < 1e-5
                });
                let near = |t: f64| (t - b.t).abs() < 3e-3 + 2.0 * (a.t - b.t).abs();
                prop_assert!(
                    t.is_some_and(near) || grazes || is_there(),
                    "{t:?} {a:?} {b:?}"
                );
            }
            (None, None) => {
                if let Some(hit) = got {
                    let cos = hit.normal.normalize().dot(ray.direction.normalize()).abs();
                    // Along the quad's own border rays are let in by a rounding, so that none passes between two quads.
                    let to_border = hit.uv.min(1.0 - hit.uv).min_element();
                    prop_assert!(
                        cos < 0.3 || to_border < 1e-3 || is_there(),
                        "{hit:?} on nothing"
                    );
                }
            }
            _ => {}
        }
        if let Some(hit) = got {
            prop_assert!(hit.error < 2e-4, "{hit:?}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn awkward_prisms_are_hit_where_a_loop_says(
        seed in 0_u64..1 << 40,
        twist in prop::sample::select(vec![0.0_f32, 0.2, 0.9]),
        log in 2_u8..5,
        flat in prop::bool::ANY,
    ) {
        awkward(seed, twist, log, flat)?;
    }
}

/// Rays just beside the quad's diagonal, and beside one of a micro-quad: crests that straight triangles cut off.
#[test]
fn crests_that_straight_triangles_cut_off_are_hit() {
    for (seed, flat) in [
        (825_703_037_432, true),
        (141_692_928_341, false),
        (90_410_070_764, false),
    ] {
        awkward(seed, 0.9, 2, flat).expect("where the loop says");
    }
}

/// A prism that folds over: the curve meets the surface first at what lies farther along the ray.
#[test]
fn where_prisms_fold_the_nearer_hit_counts() {
    awkward(1_060_266_502_182, 0.9, 4, false).expect("where the loop says");
}

#[test]
fn rays_along_axes_and_planes_are_not_lost() {
    // A flat quad with a ridge across, and rays that run along its plane.
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
        .map(|[x, y]| [Vec3::new(x, y, 0.0), Vec3::Z / 1000.0]);
    let size = Size([16, 16]);
    let heights = (0..17 * 17)
        .map(|at| if at % 17 == 8 { 1000 } else { 0 })
        .collect();
    let tree = Nonlinear::of_quad(corners, size, heights);
    for y in [0.1, 0.25, 0.5, 0.501, 0.9] {
        let ray = Ray::new(Vec3::new(-2.0, y, 0.5), Vec3::X, 0.0);
        let hit = tree.intersect(0, &ray).expect("the ridge");
        assert!((hit.t - (2.0 + 7.5 / 16.0)).abs() < 1e-4, "{hit:?}");
        let along = Ray::new(Vec3::new(0.5, y, 1.5), -Vec3::Z, 0.0);
        assert!((tree.intersect(0, &along).expect("its crest").t - 0.5).abs() < 1e-3);
    }
}

#[test]
fn instruction_sets_agree() {
    let surface = surface(Patches::torus(5, 4), heights().last().expect("an image").1);
    let mut tree = nonlinear(&surface, &Rates::uniform(&surface, 16));
    let mut random = Random(9);
    let rays: Vec<Ray> = (0..2000).map(|_| random_ray(&mut random)).collect();
    let met = Isa::all().into_iter().map(|isa| {
        tree.isa = isa;
        rays.iter()
            .map(|ray| place(&mut &tree, ray))
            .collect::<Vec<_>>()
    });
    let met: Vec<_> = met.collect();
    assert!(met[0].iter().flatten().count() > 500);
    assert!(met.iter().all(|other| *other == met[0]));
}

#[test]
fn an_interval_is_open_and_both_sides_are_hit() {
    let surface = surface(Patches::cube(), Displacement::None);
    let tree = nonlinear(&surface, &Rates::uniform(&surface, 4));
    let ray = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z, 0.0);
    let first = tree.intersect(0, &ray).expect("a hit");
    assert!((first.t - 2.0).abs() < 1e-6 && first.face == 0, "{first:?}");
    assert!(first.normal.z > 0.0 && (first.uv - Vec2::new(0.55, 0.6)).length() < 1e-5);
    let beyond = Ray { t_min: 2.5, ..ray };
    let second = tree.intersect(0, &beyond).expect("the other side");
    assert!((second.t - 4.0).abs() < 1e-6, "{second:?}");
    let before = Ray { t_max: 1.9, ..ray };
    assert!(tree.intersect(0, &before).is_none() && !tree.occluded(0, &before));
}

#[test]
fn vectors_are_refused_and_nothing_is_nothing() {
    let (_, vectors) = displacements(0.1).pop().expect("vectors");
    let shape = surface(Patches::cube(), vectors);
    let refused = Nonlinear::build(&shape, &Rates::uniform(&shape, 4), &|_| true);
    assert!(matches!(refused, Err(Error::Input(_))));
    let empty = surface(Patches::empty(), Displacement::None);
    let tree = nonlinear(&empty, &Rates::uniform(&empty, 1));
    assert!(
        tree.intersect(0, &Ray::new(Vec3::ZERO, Vec3::X, 0.0))
            .is_none()
    );
    assert!(tree.bounds(0, 0).is_empty());
    let stopped = Nonlinear::build(
        &shape.with_displacement(Displacement::None),
        &Rates::uniform(&shape, 4),
        &|_| false,
    );
    assert!(matches!(stopped, Err(Error::Interrupted)));
}

#[test]
fn bytes_do_not_depend_on_threads_and_are_few() {
    let surface = surface(Patches::torus(5, 3), heights().last().expect("an image").1);
    let rates = Rates::by_edge(&surface, |edge| 256 + 64 * (edge % 3));
    let built = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| nonlinear(&surface, &rates))
    });
    assert!(built[0].heights == built[1].heights && built[0].ranges == built[1].ranges);
    assert_eq!(built[0].top, built[1].top);
    let each = built[0].memory() as f64 / (2.0 * built[0].heights.len() as f64);
    assert!(each < 1.6, "{each} bytes a micro-triangle");
}
