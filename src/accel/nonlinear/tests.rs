//! Bent rays against a loop over all micro-triangles in double precision, and rays that must not escape.

use proptest::prelude::*;
use rayon::prelude::*;

use super::*;
use crate::accel::tests::random_ray;
use crate::error::Error;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, leaks, mixed, surface};
use crate::surface::{Diced, Displacement, Rates, Surface};

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

impl Nonlinear {
    /// The point of a quad at u and v in micro-quads, in double precision.
    fn point(&self, quad: &Quad, uv: [f64; 2], moment: &Moment) -> DVec3 {
        let [nu, nv] = quad.size.quads();
        let cell = [(uv[0] as usize).min(nu - 1), (uv[1] as usize).min(nv - 1)];
        let [x, y] = [uv[0] - cell[0] as f64, uv[1] - cell[1] as f64];
        let [a, b, c, d] = self
            .cell(quad, cell.map(|x| x as u32), moment)
            .map(f64::from);
        let height = if x + y <= 1.0 {
            a + x * (b - a) + y * (c - a)
        } else {
            d + (1.0 - x) * (c - d) + (1.0 - y) * (b - d)
        };
        let (x, y) = (uv[0] / nu as f64, uv[1] / nv as f64);
        let weights = if x + y <= 1.0 {
            [1.0 - x - y, x, y, 0.0]
        } else {
            [0.0, 1.0 - y, 1.0 - x, x + y - 1.0]
        };
        let corners = self.corners(quad, moment);
        (0..4)
            .map(|k| weights[k] * (corners[k][0] + height * corners[k][1]))
            .sum()
    }

    /// The nearest hit among straight triangles that halve the micro-edges so many times; they are a little off those
    /// that are traced, which are bent.
    fn brute_force(&self, ray: &Ray, halvings: u32) -> Option<Brute> {
        let moment = Moment::new(self.keys, ray.time);
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let mut nearest: Option<Brute> = None;
        for number in 0..self.quads.len() as u32 {
            let quad = &self.quad(number);
            let fine = 1 << halvings;
            let [nu, nv] = quad.size.quads().map(|n| n * fine);
            let row = |j: usize| -> Vec<DVec3> {
                let at = |i: usize| [i, j].map(|x| x as f64 / fine as f64);
                (0..=nu).map(|i| self.point(quad, at(i), &moment)).collect()
            };
            let mut below = row(0);
            for j in 1..=nv {
                let above = row(j);
                for i in 0..nu {
                    let [a, b, c, e] = [below[i], below[i + 1], above[i], above[i + 1]];
                    for [a, b, c] in [[a, b, c], [e, c, b]] {
                        let (e1, e2) = (b - a, c - a);
                        let p = d.cross(e2);
                        let det = e1.dot(p);
                        let s = o - a;
                        let u = s.dot(p) / det;
                        let q = s.cross(e1);
                        let v = d.dot(q) / det;
                        let t = e2.dot(q) / det;
                        let inside = u.min(v).min(1.0 - u - v);
                        let met =
                            inside >= 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max);
                        if met && nearest.is_none_or(|n| t < n.t) {
                            nearest = Some(Brute { t, inside });
                        }
                    }
                }
                below = above;
            }
        }
        nearest
    }

    /// A surface of a single quad.
    fn of_quad(corners: [[Vec3; 2]; 4], size: Size, heights: Vec<u16>) -> Self {
        let mut ranges = Vec::new();
        field::ranges(size, &heights, size.quads()[0] + 1, &mut ranges);
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
            }],
            corners: corners.to_vec(),
            heights,
            ranges,
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
                let Some(met) = tree.trace::<false>(&ray) else {
                    continue;
                };
                let moment = Moment::new(tree.keys, ray.time);
                let quad = tree.quad(met.quad);
                let point = tree.point(&quad, met.uv.map(f64::from), &moment);
                let hit = tree.hit(&ray, &met);
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
    let solids = [false, true].into_iter().flat_map(leaks::solids);
    let cases: Vec<_> = solids
        .filter(|solid| !matches!(solid.surface.displacement(), Displacement::Vector(..)))
        .collect();
    let each = effort(1_000_000).div_ceil(cases.len());
    let escaped: usize = cases
        .par_iter()
        .map(
            |leaks::Solid {
                 name,
                 surface,
                 inside,
             }| {
                let rates = mixed(surface);
                let (tree, diced) = (nonlinear(surface, &rates), Diced::new(surface, &rates));
                let mut random = Random(7);
                let escaped = (0..each)
                    .filter(|&i| {
                        let mut ray = leaks::ray(&diced, *inside, i, &mut random);
                        ray.time = if i % 3 == 0 { 0.0 } else { random.next() };
                        if i % 4 == 0 {
                            let quad = (random.next() * tree.quads.len() as f32) as usize;
                            let quad = &tree.quad(quad.min(tree.quads.len() - 1) as u32);
                            let uv = quad.size.quads().map(|n| {
                                let at = (random.next() * (n + 1) as f32).floor();
                                // A half of them on edges.
                                f64::from(if i % 8 == 0 {
                                    at
                                } else {
                                    (at / n as f32).round() * n as f32
                                })
                            });
                            let moment = Moment::new(tree.keys, ray.time);
                            ray.direction = tree.point(quad, uv, &moment).as_vec3() - *inside;
                        }
                        !tree.occluded(0, &ray)
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Prisms that lean, twist, shrink to a point or turn over, heights that jump.
    #[test]
    fn awkward_prisms_are_hit_where_a_loop_says(
        seed in 0_u64..1 << 40,
        twist in prop::sample::select(vec![0.0_f32, 0.2, 0.9]),
        log in 2_u8..5,
        flat in any::<bool>(),
    ) {
        let mut random = Random(seed);
        let mut near = |by: f32| by * random.direction() * random.next();
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|[x, y]| {
            [Vec3::new(x, y, 0.0) + near(0.3), (0.4 * Vec3::Z + near(twist)) / 1000.0]
        });
        let size = Size([log, 2 + (seed % 3) as u8]);
        let heights: Vec<u16> = (0..size.quads().map(|n| n + 1).iter().product())
            .map(|_| if flat { 500 } else { 300 + (400.0 * random.next()) as u16 })
            .collect();
        let tree = Nonlinear::of_quad(corners, size, heights);
        for _ in 0..20 {
            let target = Vec3::new(random.next(), random.next(), 0.2);
            let origin = target + 2.0 * random.direction();
            let ray = Ray::new(origin, target - origin, 0.0);
            let (coarse, fine) = (tree.brute_force(&ray, 0), tree.brute_force(&ray, 3));
            let got = tree.intersect(0, &ray);
            prop_assert_eq!(tree.occluded(0, &ray), got.is_some());
            // What bent and straight triangles, and finer ones, agree on.
            match (coarse, fine, got) {
                (Some(a), Some(b), got) if (a.t - b.t).abs() < 3e-3 && a.inside.min(b.inside) > 0.05 => {
                    let t = got.map(|hit| f64::from(hit.t));
                    prop_assert!(t.is_some_and(|t| (t - b.t).abs() < 3e-3 + 2.0 * (a.t - b.t).abs()), "{t:?} {a:?} {b:?}");
                }
                (None, None, Some(hit)) => {
                    let cos = hit.normal.normalize().dot(ray.direction.normalize()).abs();
                    // Along the quad's own border rays are let in by a rounding, so that none passes between two quads.
                    let to_border = hit.uv.min(1.0 - hit.uv).min_element();
                    prop_assert!(cos < 0.3 || to_border < 1e-3, "{hit:?} on nothing");
                }
                _ => {}
            }
            if let Some(hit) = got {
                prop_assert!(hit.error < 2e-4, "{hit:?}");
            }
        }
    }
}

#[test]
fn rays_along_axes_and_planes_are_not_lost() {
    // A flat quad with a ridge across, and rays that run along its plane.
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
        .map(|[x, y]| [Vec3::new(x, y, 0.0), Vec3::Z / 1000.0]);
    let size = Size([4, 4]);
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
            .map(|ray| tree.trace::<false>(ray))
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
