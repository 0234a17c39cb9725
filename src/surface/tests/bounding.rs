//! Nothing outside of its bounds.

use rayon::prelude::*;

use super::cages::cages;
use super::shapes::Random;
use super::*;
use crate::image::{Channel, ChannelFormat, Compression, Part, Picture};
use crate::image::{ColorSpace, ImageSource, Texture};
use crate::math::Bounds3;

fn holds(bounds: &Bounds3, p: Vec3) -> bool {
    bounds.min.cmple(p).all() && p.cmple(bounds.max).all()
}

/// Two million points (times `RELIEVO_EFFORT`), in random rectangles of all shapes and displacements, near the origin
/// and far from it; and how tight the bounds are.
#[test]
fn no_displaced_point_is_outside_of_its_bounds() {
    let mut cases = Vec::new();
    for (kind, displacement) in displacements(0.1) {
        for offset in [0.0, 300.0] {
            for (shape, base) in closed() {
                let moved = base.mapped(|p| p + offset);
                cases.push((shape, kind, surface(moved, displacement.clone())));
            }
            for (shape, base) in cages(offset) {
                cases.push((shape, kind, Surface::new(base, displacement.clone())));
            }
        }
    }
    let rounds = effort(120);
    let (outside, points, size) = cases
        .par_iter()
        .enumerate()
        .map(|(i, (shape, kind, surface))| {
            let mut random = Random(i as u64);
            let (mut outside, mut points, mut size) = (0, 0, 0.0);
            for round in 0..rounds as u32 {
                let face = round % surface.base().faces();
                if surface.base().is_hole(face) {
                    continue;
                }
                let mut rect = random.rect();
                // Smaller ones too, and some at the border.
                let shrink = 0.5_f32.powi((round % 6) as i32);
                rect.max = rect.min + shrink * (rect.max - rect.min);
                if round % 3 == 0 {
                    rect.min.x = 0.0;
                }
                if round % 5 == 0 {
                    rect.max.y = 1.0;
                }
                let bounds = surface.bounds(face, &rect, 0).expect("all are bounded");
                let mut seen = Bounds3::EMPTY;
                for _ in 0..200 {
                    let uv = (rect.min + random.uv() * (rect.max - rect.min)).min(rect.max);
                    let p = surface.evaluate(face, uv, 0).position;
                    seen = seen.including(p);
                    points += 1;
                    if !holds(&bounds, p) {
                        outside += 1;
                        eprintln!("{shape} {kind}: {p} at {uv} of {face} outside {bounds:?}");
                    }
                }
                size += bounds.extent().length() / (seen.extent().length() + 1e-3);
            }
            (outside, points, size / rounds as f32)
        })
        .reduce(|| (0, 0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2));
    println!(
        "{points} points, boxes {:.2} times the samples' extent on average",
        size / cases.len() as f32
    );
    assert_eq!(outside, 0);
    assert!(points >= 2_000_000, "{points}");
}

/// The grids of diced surfaces, shared samples included, lie in their faces' bounds at every key.
#[test]
fn no_micro_vertex_is_outside_of_its_face() {
    let mut vertices = 0;
    for (kind, displacement) in displacements(0.15) {
        let moving = |(shape, base): (_, Patches)| {
            let moving = base.moving(|p| 1.5 * p + Vec3::X);
            (shape, surface(moving, displacement.clone()))
        };
        let still = |(shape, base)| (shape, Surface::new(base, displacement.clone()));
        let all = closed().into_iter().map(moving);
        for (shape, surface) in all.chain(cages(0.0).into_iter().map(still)) {
            let diced = Diced::new(&surface, &Rates::by_edge(&surface, |e| 8 + e % 17));
            for (key, positions) in diced.positions().iter().enumerate() {
                for grid in diced.grids() {
                    let bounds = surface
                        .bounds(grid.face, &UvRect::UNIT, key as u32)
                        .expect("bounded");
                    let [columns, rows] = grid.vertices();
                    let first = grid.first_vertex as usize;
                    for &p in &positions[first..first + (columns * rows) as usize] {
                        assert!(holds(&bounds, p), "{shape} {kind}: {p} {bounds:?}");
                        vertices += 1;
                    }
                }
            }
        }
    }
    println!("{vertices} micro-vertices");
}

/// Shared samples of parts of edges lie in the bounds of both faces' parts.
#[test]
fn shared_samples_are_in_both_faces_bounds() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.15) {
            let surface = surface(base.clone(), displacement);
            let rates = Rates::uniform(&surface, 16);
            let shared = SharedSamples::new(&surface, &rates, 0);
            for face in 0..surface.base().faces() {
                for k in 0..4 {
                    let points: Vec<Vec3> = shared.walk(&surface, face, k).collect();
                    let segments = points.len() - 1;
                    for part in 0..segments.min(4) {
                        let (from, to) = (part * segments / 4, (part + 1) * segments / 4);
                        let at = |i: usize| edge_uv(k, i as f32 / segments as f32);
                        let (a, b) = (at(from), at(to));
                        let inward = (Vec2::splat(0.5) - 0.5 * (a + b)).normalize() * 0.1;
                        let corners = [a, b, a + inward, b + inward];
                        let rect = UvRect {
                            min: corners
                                .into_iter()
                                .fold(Vec2::ONE, Vec2::min)
                                .max(Vec2::ZERO),
                            max: corners.into_iter().fold(Vec2::ZERO, Vec2::max),
                        };
                        let bounds = surface.bounds(face, &rect, 0).expect("bounded");
                        for &p in &points[from..=to] {
                            assert!(holds(&bounds, p), "{shape} {kind}: {p} {bounds:?}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_function_without_bound_gives_none() {
    let displacement = Displacement::Scalar(amount(Function::scalar(waves), 1.0));
    let surface = surface(Patches::cube(), displacement);
    assert!(surface.bounds(0, &UvRect::UNIT, 0).is_none());
}

#[test]
fn no_look_up_is_outside_of_the_pyramids_range() {
    let mut random = Random(8);
    for wrap in [Wrap::Black, Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
        for (names, channels) in [("Y", 1), ("RGB", 3)] {
            let texture = noise([61, 45], names, wrap, 6);
            let pyramid = Pyramid::new(&texture, channels);
            for round in 0..3000 {
                let mut st = random.rect();
                let size = [3.0, 0.2, 0.01][round % 3];
                st.min = 6.0 * st.min - 3.0;
                st.max = st.min + size * random.uv();
                let range = pyramid.range(&texture, &st);
                for _ in 0..20 {
                    let at = (st.min + random.uv() * (st.max - st.min)).min(st.max);
                    let mut value = texture.eval(at).truncate();
                    if channels == 1 {
                        value = Vec3::new(value.x, 0.0, 0.0);
                    }
                    assert!(
                        holds(&range, value),
                        "{wrap:?} {at} {st:?}: {value} {range:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn tiles_of_a_udim_set_are_bounded_apart() {
    let folder = tempfile::tempdir().expect("a folder");
    for (number, value) in [(1001, 51_u8), (1012, 204)] {
        let picture = Picture {
            width: 1,
            height: 1,
            display_window: (1, 1, 0, 0),
            parts: vec![Part {
                name: String::new(),
                channels: ["R", "G", "B"]
                    .map(|name| Channel {
                        name: name.into(),
                        format: ChannelFormat::Half,
                    })
                    .to_vec(),
                pixels: vec![f32::from(value) / 255.0; 3],
            }],
            metadata: Vec::new(),
            tile: None,
            compression: Compression::Zip,
        };
        let path = folder.path().join(format!("h.{number}.exr"));
        crate::image::write_exr(&path, &picture).expect("written");
    }
    let source = ImageSource::File(folder.path().join("h.<UDIM>.exr"));
    let texture = Texture::load(&source, [Wrap::Repeat; 2], ColorSpace::Raw).expect("loaded");
    let pyramid = Pyramid::new(&texture, 1);
    let range = |a: [f32; 2], b: [f32; 2]| {
        let range = pyramid.range(
            &texture,
            &UvRect {
                min: a.into(),
                max: b.into(),
            },
        );
        [range.min.x, range.max.x]
    };
    let near = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() < 1e-3 && (a[1] - b[1]).abs() < 1e-3;
    assert!(near(range([0.1, 0.1], [0.9, 0.9]), [0.2, 0.2]));
    assert!(near(range([1.1, 1.1], [1.9, 1.9]), [0.8, 0.8]));
    // Over both, and over what has no tile.
    assert!(near(range([0.5, 0.5], [1.5, 1.5]), [0.0, 0.8]));
    assert!(near(range([3.5, 0.5], [3.6, 0.6]), [0.0, 0.0]));
    assert!(near(range([-9e9, 0.5], [9e9, 0.6]), [0.0, 0.8]));
    // A tile's far border is its own.
    assert!(near(range([0.5, 0.5], [1.0, 1.0]), [0.0, 0.8]));
    assert!(texture.eval(Vec2::ONE).x > 0.7 && texture.eval(Vec2::new(1.0, 0.5)).x < 0.3);
}
