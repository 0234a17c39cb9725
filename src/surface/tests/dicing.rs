//! Micro-vertices: shared bits, no cracks, rates.

use std::collections::BTreeMap;

use super::shapes::Random;
use super::*;
use crate::math::{Affine3A, Bounds3};

/// The bits of a point; both zeros are one place.
fn bits(p: Vec3) -> [u32; 3] {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// How often each edge of the micro-triangles is passed one way rather than the other. In a closed surface never.
fn open_edges(diced: &Diced, key: usize) -> usize {
    let positions = &diced.positions()[key];
    let mut passes: BTreeMap<([u32; 3], [u32; 3]), i32> = BTreeMap::new();
    for triangle in 0..diced.triangles() {
        let corners = diced.corners(triangle).map(|v| bits(positions[v as usize]));
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a < b {
                *passes.entry((a, b)).or_default() += 1;
            } else if b < a {
                *passes.entry((b, a)).or_default() -= 1;
            }
        }
    }
    passes.values().filter(|&&n| n != 0).count()
}

#[test]
fn closed_surfaces_stay_closed_at_any_rates() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            for offset in [0.0, 2e5] {
                let base = base.clone().moving(|p| 2.0 * p).mapped(|p| p + offset);
                let surface = surface(base, displacement.clone());
                for rates in [mixed(&surface), Rates::uniform(&surface, 5)] {
                    let diced = Diced::new(&surface, &rates);
                    for key in 0..2 {
                        assert_eq!(open_edges(&diced, key), 0, "{shape} {kind} at {offset}");
                    }
                }
            }
        }
    }
}

/// Three faces at one edge, and two fans at one vertex.
#[test]
fn non_manifold_edges_are_shared_by_all_their_faces() {
    let points = [
        Vec3::ZERO,
        Vec3::Z,
        Vec3::X,
        Vec3::new(1.0, 0.0, 1.0),
        Vec3::Y,
        Vec3::new(0.0, 1.0, 1.0),
        Vec3::new(-1.0, -1.0, 0.0),
        Vec3::new(-1.0, -1.0, 1.0),
    ];
    let quads = vec![[0, 2, 3, 1], [4, 0, 1, 5], [1, 0, 6, 7]];
    for (kind, displacement) in displacements(0.3) {
        let surface = surface(Patches::bilinear(&points, quads.clone()), displacement);
        let rates = Rates::by_edge(&surface, |edge| 3 + edge % 4);
        let shared = SharedSamples::new(&surface, &rates, 0);
        let mut lines: Vec<Vec<[u32; 3]>> = [(0, 3), (1, 1), (2, 0)]
            .into_iter()
            .map(|(face, k)| shared.walk(&surface, face, k).map(bits).collect())
            .collect();
        // All from point 0 to point 1.
        for line in [0, 2] {
            lines[line].reverse();
        }
        assert!(lines[0] == lines[1] && lines[1] == lines[2], "{kind}");
    }
}

#[test]
fn grids_show_their_edges_samples_in_order() {
    let surface = surface(Patches::sphere(2).turned(), displacements(0.2).remove(1).1);
    let rates = mixed(&surface);
    let shared = SharedSamples::new(&surface, &rates, 0);
    let diced = Diced::new(&surface, &rates);
    for grid in diced.grids() {
        let [nu, nv] = grid.size;
        for k in 0..4_u32 {
            let n = if k % 2 == 0 { nu } else { nv };
            let place = |x: u16| match k {
                0 => (x, 0),
                1 => (nu, x),
                2 => (nu - x, nv),
                _ => (0, nv - x),
            };
            let mut line = Vec::new();
            for x in 0..=n {
                let (i, j) = place(x);
                let p = diced.positions()[0][grid.vertex(i, j) as usize];
                // The parameters are those of the sample.
                let there = surface
                    .evaluate(grid.face, grid.vertex_uv(i, j), 0)
                    .position;
                assert!((there - p).length() < 0.05, "{there} {p}");
                line.push(bits(p));
            }
            line.dedup();
            let samples: Vec<_> = shared.walk(&surface, grid.face, k).map(bits).collect();
            assert_eq!(line, samples);
        }
        // Inside, the surface itself.
        for (i, j) in (1..nu).flat_map(|i| (1..nv).map(move |j| (i, j))) {
            let p = diced.positions()[0][grid.vertex(i, j) as usize];
            let there = surface
                .evaluate(grid.face, grid.vertex_uv(i, j), 0)
                .position;
            assert!((there - p).length() < 1e-5, "{there} {p}");
        }
    }
}

#[test]
fn holes_are_left_out() {
    let mut base = Patches::cube();
    base.holes = vec![2, 4];
    let surface = surface(base, Displacement::None);
    let rates = Rates::uniform(&surface, 3);
    let diced = Diced::new(&surface, &rates);
    let faces: Vec<u32> = diced.grids().iter().map(|grid| grid.face).collect();
    assert_eq!(faces, [0, 1, 3, 5]);
    assert_eq!((rates.micro_vertices(), rates.micro_triangles()), (64, 72));
    assert_eq!(diced.triangles(), 72);
    assert!(
        surface
            .bounds(2, &UvRect::UNIT, 0)
            .expect("bounded")
            .is_empty()
    );
    // One face at a time gives the same.
    let shared = SharedSamples::new(&surface, &rates, 0);
    let grid = FaceGrid::new(&surface, &rates, 3);
    let mut out = vec![Vec3::ZERO; 16];
    surface.dice_face(&grid, 0, &shared, &mut Scratch::default(), &mut out);
    assert_eq!(out, diced.positions()[0][32..48]);
}

#[test]
fn coarser_rates_are_those_divided_and_their_facets_are_known() {
    let surface = surface(Patches::sphere(6), displacements(0.2).remove(2).1);
    let fine = mixed(&surface);
    let coarse = fine.coarser(&surface, 2.5);
    let fewer = |segments: u32| (segments as f32 / 2.5).ceil() as u32;
    let diced = Diced::new(&surface, &coarse);
    let mut random = Random(1);
    for grid in diced.grids() {
        for k in 0..4 {
            let edge = surface.base().edge(grid.face, k).edge;
            assert_eq!(coarse.edge(edge), fewer(fine.edge(edge)));
        }
        assert_eq!(coarse.face(grid.face), fine.face(grid.face).map(fewer));
        let alone = FaceGrid::new(&surface, &coarse, grid.face);
        for _ in 0..20 {
            let uv = random.uv();
            let (corners, weights) = alone.facet(uv);
            let [a, b, c] = corners;
            if grid.triangle_at(uv).is_some() {
                let there = a + weights.x * (b - a) + weights.y * (c - a);
                assert!((there - uv).length() < 1e-5, "{uv} {there}");
            }
            let is_one = |triangle: u64| {
                let of_grid = grid.corners(triangle).map(|(i, j)| grid.vertex_uv(i, j));
                of_grid == corners
            };
            assert!((0..grid.triangles()).any(is_one), "{grid:?} at {uv}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let surface = surface(Patches::sphere(6), displacements(0.2).remove(2).1);
    let rates = mixed(&surface);
    let dice = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let diced = pool
            .expect("threads")
            .install(|| Diced::new(&surface, &rates));
        diced.positions()[0]
            .iter()
            .map(|&p| bits(p))
            .collect::<Vec<_>>()
    };
    assert_eq!(dice(1), dice(5));
}

/// A camera at 0, 0, 10 that sees 45° to either side, 1000 pixels wide.
struct Pinhole;

impl View for Pinhole {
    fn position(&self) -> Vec3 {
        10.0 * Vec3::Z
    }
    fn pixels_per_unit(&self, p: Vec3) -> f32 {
        500.0 / p.distance(self.position()).max(1e-3)
    }
    fn outside(&self, centre: Vec3, radius: f32) -> f32 {
        let d = centre - self.position();
        (((d.truncate().length() - radius) / -d.z).abs() - 1.0).max(0.0) / 2.0
    }
}

fn on_screen(surface: &Surface, places: &[Affine3A], dicing: &Dicing) -> Rates {
    let bounds = Bounds3 {
        min: Vec3::splat(-1.5),
        max: Vec3::splat(1.5),
    };
    let places = Places::nearest(&Pinhole, &bounds, places);
    Rates::on_screen(surface, &places, dicing)
}

#[test]
fn micro_edges_have_the_rate_that_was_asked_for() {
    let here = [Affine3A::IDENTITY];
    for (kind, displacement) in displacements(0.1) {
        let surface = surface(Patches::sphere(2), displacement);
        let dicing = Dicing {
            rate: 2.0,
            max_segments: 1000,
            off_screen: 0.0,
        };
        let diced = Diced::new(&surface, &on_screen(&surface, &here, &dicing));
        let positions = &diced.positions()[0];
        let (mut sum, mut count) = (0.0, 0.0);
        for grid in diced.grids() {
            for j in 0..=grid.size[1] {
                for i in 1..=grid.size[0] {
                    let [a, b] =
                        [(i - 1, j), (i, j)].map(|(i, j)| positions[grid.vertex(i, j) as usize]);
                    sum += a.distance(b) * Pinhole.pixels_per_unit(0.5 * (a + b));
                    count += 1.0;
                }
            }
        }
        let mean = sum / count;
        assert!((1.2..2.3).contains(&mean), "{kind}: {mean}");
    }
}

#[test]
fn rates_follow_displacement_distance_picture_and_cap() {
    let dicing = Dicing {
        rate: 1.0,
        max_segments: 4000,
        off_screen: 0.0,
    };
    let here = Affine3A::IDENTITY;
    let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, y, z));
    // Not quite even.
    let cube = || Patches::cube().mapped(|p| p * (1.0 + 1e-4 * p.length_squared()));
    let flat = surface(cube(), Displacement::None);
    let count = |surface: &Surface, places: &[Affine3A], dicing: &Dicing| {
        on_screen(surface, places, dicing).micro_triangles()
    };
    let near = count(&flat, &[here], &dicing);
    // Noise is longer than what it lies on.
    let noisy = surface(
        cube(),
        Displacement::Scalar(amount(
            ImageMap::new(noise([64, 64], "Y", Wrap::Clamp, 1), Channels::Scalar),
            0.2,
        )),
    );
    assert!(count(&noisy, &[here], &dicing) > 2 * near);
    // Further away it is coarser; of several places the nearest decides.
    let far = count(&flat, &[at(0.0, 0.0, -50.0)], &dicing);
    assert!(10 * far < near);
    assert_eq!(count(&flat, &[at(0.0, 0.0, -50.0), here], &dicing), near);
    // Beyond the picture it is coarser as well, if asked for.
    let beside = [at(50.0, 0.0, 0.0)];
    let falling = Dicing {
        off_screen: 4.0,
        ..dicing
    };
    assert!(2 * count(&flat, &beside, &falling) < count(&flat, &beside, &dicing));
    assert_eq!(count(&flat, &[here], &falling), near);
    let capped = Dicing {
        max_segments: 7,
        ..dicing
    };
    assert_eq!(count(&flat, &[here], &capped), 6 * 7 * 7 * 2);
    // A face that bulges between short edges is as fine as its middle.
    let bulge = Displacement::Scalar(amount(
        Function::scalar(|at| 20.0 * (at.uv * (1.0 - at.uv)).element_product()),
        1.0,
    ));
    let bulging = on_screen(&surface(cube(), bulge), &[here], &dicing);
    let flat = on_screen(&flat, &[here], &dicing);
    assert_eq!(bulging.edge(0), flat.edge(0));
    assert!(2 * bulging.face(0)[0] > 3 * flat.face(0)[0]);
}

#[test]
fn the_closest_view_is_measured_on_the_surface() {
    let cube = surface(Patches::cube(), Displacement::None);
    let dicing = Dicing {
        off_screen: 1.0,
        ..Dicing::default()
    };
    let top = Diced::new(&cube, &Rates::uniform(&cube, 1)).positions()[0]
        .iter()
        .fold(0.0, |top: f32, p| top.max(p.z));
    let closest = |places: &[Affine3A]| {
        let rates = on_screen(&cube, places, &dicing);
        rates.pixels_per_unit().expect("a camera sees it")
    };
    let here = closest(&[Affine3A::IDENTITY]);
    let expected = 500.0 / (10.0 - top);
    assert!((here / expected - 1.0).abs() < 1e-4, "{here} {expected}");
    // A unit of what is shown twice as large covers twice as much, and more since it is nearer.
    let twice = closest(&[Affine3A::from_scale(Vec3::splat(2.0))]);
    let expected = 2.0 * 500.0 / (10.0 - 2.0 * top);
    assert!((twice / expected - 1.0).abs() < 1e-4, "{twice} {expected}");
    // Beyond the picture it counts for less.
    let beside = [Affine3A::from_translation(Vec3::new(50.0, 0.0, 0.0))];
    let seen = Pinhole.pixels_per_unit(Vec3::new(50.0 - top, 0.0, top));
    assert!(closest(&beside) < 0.5 * seen);
    assert_eq!(Rates::uniform(&cube, 4).pixels_per_unit(), None);
}

#[test]
fn a_part_of_a_face_has_the_bits_of_the_whole() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.2) {
            let surface = surface(base.clone().moving(|p| 2.0 * p), displacement);
            let rates = Rates::by_edge(&surface, |edge| [3, 17, 30][edge as usize % 3]);
            let diced = Diced::new(&surface, &rates);
            let held: Vec<_> = (0..2)
                .map(|key| SharedSamples::new(&surface, &rates, key))
                .collect();
            let (vertices, bounds) = SharedSamples::of_vertices(&surface, &rates);
            assert_eq!(bounds, SharedSamples::bounds(&surface, &held));
            let mut scratch = Scratch::default();
            for grid in diced.grids() {
                let cuts = grid.size.map(|n| [0, n / 3, n / 2, n]);
                for (key, c, r) in (0..18).map(|i| (i / 9, i % 3, i / 3 % 3)) {
                    let (columns, rows) =
                        (cuts[0][c]..=cuts[0][c + 1], cuts[1][r]..=cuts[1][r + 1]);
                    let mut out = vec![Vec3::NAN; columns.len() * rows.len()];
                    for shared in [&held[key], &vertices[key]] {
                        let ranges = [columns.clone(), rows.clone()];
                        surface.dice_part(grid, ranges, key as u32, shared, &mut scratch, &mut out);
                        let places = rows
                            .clone()
                            .flat_map(|j| columns.clone().map(move |i| (i, j)));
                        for ((i, j), p) in places.zip(&out) {
                            let whole = diced.positions()[key][grid.vertex(i, j) as usize];
                            assert_eq!(bits(*p), bits(whole), "{shape} {kind} {grid:?} {i} {j}");
                        }
                    }
                }
            }
        }
    }
}

/// The walls of a cube, one of which is bent: what is even keeps the cuts that its neighbours need, and no others.
#[test]
fn what_is_even_is_not_cut() {
    let here = [Affine3A::IDENTITY];
    let dicing = Dicing::default();
    let flat = surface(Patches::cube(), Displacement::None);
    assert_eq!(on_screen(&flat, &here, &dicing).micro_triangles(), 12);
    let round = surface(Patches::sphere(1), Displacement::None);
    assert!((0..6).all(|face| !round.is_even(face)));
    let (_, displacement) = displacements(0.1).swap_remove(1);
    let displaced = surface(Patches::cube(), displacement);
    assert!((0..6).all(|face| !displaced.is_even(face)));

    let mut house = Patches::cube();
    house.control[0][0].0[5] += Vec3::Z;
    house.holes = vec![1];
    let house = surface(house, Displacement::None);
    assert!(!house.is_even(0));
    let rates = Rates::uniform(&house, 9).sparing_even_faces(&house);
    assert_eq!(rates.face(0), [9, 9]);
    assert_eq!(rates.face(1), [0, 0]);
    for face in 2..6 {
        assert!(house.is_even(face));
        let edges = [0, 1, 2, 3].map(|k| rates.edge(house.base().edge(face, k).edge));
        let cut = edges.iter().filter(|&&segments| segments == 9).count();
        let expected = if cut == 0 { [1, 1] } else { [1, 9] };
        let mut size = rates.face(face);
        size.sort_unstable();
        assert_eq!((cut < 2, size), (true, expected), "{face}");
    }
}
