//! Known maps, and all kinds of cages: each face once in the square, none on another.

mod shapes;

use proptest::prelude::*;

use super::cage::lay;
use super::*;
use crate::math::{DVec3, Vec3};
use crate::mesh::triangulate;
use shapes::{ball, bent, cube, grid, mesh, torus};

fn unfolded(mesh: &ControlMesh) -> Atlas {
    atlas(mesh, &AtlasOptions::default()).unwrap_or_else(|fault| panic!("{fault}"))
}

fn coordinate(atlas: &Atlas, corner: u32) -> DVec2 {
    let st = atlas.coordinates.get(corner as usize);
    DVec2::new(st[0].into(), st[1].into())
}

/// The greatest and the least stretch of each triangle of a quad's corners, with the triangle's area.
fn stretches(mesh: &ControlMesh, atlas: &Atlas) -> Vec<([f64; 2], f64)> {
    let cage = Cage::new(mesh);
    let unit = (cage.points[0] - cage.points[1]).length()
        / (mesh.points[0][0].as_dvec3() - mesh.points[0][1].as_dvec3()).length();
    let faces = 0..mesh.face_count() as u32;
    faces
        .flat_map(|face| {
            let first = cage.topology.corners(face).start;
            let triangles = cage.triangles(face).iter();
            let of = |t: &cage::Triangle| {
                let stretch = t.stretch(t.corners.map(|c| coordinate(atlas, first + c)));
                (stretch.map(|s| s * unit), t.area() / unit / unit)
            };
            triangles.map(of).collect::<Vec<_>>()
        })
        .collect()
}

/// Rasterises all faces: no pixel's middle may lie in two triangles, and none within `margin` texels of another
/// chart's. Gives how many pixels are covered.
fn check_apart(mesh: &ControlMesh, atlas: &Atlas, options: &AtlasOptions) -> usize {
    let n = options.resolution as usize;
    let mut owner = vec![u32::MAX; n * n];
    let whole = ControlMesh {
        holes: Vec::new(),
        ..mesh.clone()
    };
    let triangles = triangulate(&whole);
    let point = |v: u32| mesh.points[0][v as usize].as_dvec3();
    let is_stand_in: Vec<bool> = {
        let cage = Cage::new(mesh);
        cage.usable.iter().map(|usable| !usable).collect()
    };
    for (corners, &face) in triangles.corners.iter().zip(&triangles.faces) {
        let uv = corners.map(|c| coordinate(atlas, c));
        for p in uv {
            assert!(
                p.cmpge(DVec2::ZERO).all() && p.cmple(DVec2::ONE).all(),
                "{p}"
            );
        }
        let [a, b, c] = uv.map(|p| p * n as f64);
        let area = (b - a).perp_dot(c - a);
        let flat = lay(corners.map(|c| point(whole.face_vertex_indices[c as usize]))).is_none();
        // Coordinates are floats below 1: each side is off by one of their last places, half of one at each end.
        let last_place = 0.5 * f64::from(f32::EPSILON) * n as f64;
        let sides = (b - a).abs().element_sum() + (c - a).abs().element_sum();
        let is_rounded = area > -last_place * sides;
        assert!(
            area > 0.0 || is_stand_in[face as usize] || (flat && is_rounded),
            "face {face}: {area}"
        );
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        for y in low.y as usize..=(high.y as usize).min(n - 1) {
            for x in low.x as usize..=(high.x as usize).min(n - 1) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(from, to)| (*to - *from).perp_dot(p - *from) > 1e-9);
                if inside {
                    let pixel = &mut owner[y * n + x];
                    assert_eq!(*pixel, u32::MAX, "faces {face} and {pixel} at {p}");
                    *pixel = face;
                }
            }
        }
    }
    // A pixel's middle is up to half a pixel within its chart: charts that are m apart have pixels m apart and more.
    let reach = options.margin.ceil() as usize;
    for (at, &face) in owner.iter().enumerate().filter(|(_, f)| **f != u32::MAX) {
        let (x, y) = (at % n, at / n);
        for (dx, dy) in [(reach, 0), (0, reach), (reach / 2, reach / 2)] {
            for (dx, dy) in (1..=dx.max(dy)).map(|i| (i.min(dx), i.min(dy))) {
                if x + dx < n && y + dy < n {
                    let other = owner[(y + dy) * n + x + dx];
                    let same = other == u32::MAX
                        || atlas.charts[other as usize] == atlas.charts[face as usize];
                    let near = dx.max(dy) < reach;
                    assert!(
                        same || !near,
                        "charts of faces {face} and {other} at {x} {y}"
                    );
                }
            }
        }
    }
    owner.iter().filter(|f| **f != u32::MAX).count()
}

fn check(mesh: &ControlMesh) -> Atlas {
    let options = AtlasOptions {
        resolution: 512,
        ..AtlasOptions::default()
    };
    let made = atlas(mesh, &options).unwrap_or_else(|fault| panic!("{fault}"));
    let covered = check_apart(mesh, &made, &options);
    let part = covered as f64 / (512.0 * 512.0);
    assert!(
        (part - made.filled).abs() < 0.02 + 0.1 * part,
        "{part} {}",
        made.filled
    );
    assert_eq!(made.charts.iter().max(), Some(&(made.chart_count - 1)));
    let mut worn = mesh.clone();
    made.clone().put_on(&mut worn);
    assert_eq!(worn.validate(), Ok(()));
    made
}

#[test]
fn what_can_be_unrolled_keeps_all_its_lengths() {
    for (angle, top) in [(2.5, 1.0), (4.5, 1.0), (3.0, 0.4), (0.0, 2.0)] {
        let mesh = match angle {
            0.0 => grid([6, 5], [false; 2], |u, v| {
                Vec3::new(3.0 * u, v + 0.2 * u, 0.3 * u)
            }),
            _ => bent([24, 9], angle, top),
        };
        let atlas = check(&mesh);
        assert_eq!(atlas.chart_count, 1, "{angle} {top}");
        let all = stretches(&mesh, &atlas);
        let mean = all.iter().map(|(s, _)| s[0]).sum::<f64>() / all.len() as f64;
        for ([greatest, least], _) in all {
            let off = (greatest / mean - 1.0)
                .abs()
                .max((least / mean - 1.0).abs());
            assert!(
                off < 1e-4,
                "{angle} {top}: {greatest} and {least} by {mean}"
            );
        }
    }
}

/// The conformal map of a hemisphere is the stereographic one, whose scale doubles from the pole to the rim, as long as
/// the border that is left free stays as round as it is.
#[test]
fn angles_are_kept_on_half_a_ball() {
    let unfold = |rows: u32| {
        let columns = 4 * rows;
        let mut half = ball([columns, rows], 0.5, 1.0 - 0.5 / rows as f32, false);
        let last = columns * rows;
        half.face_vertex_counts.push(columns);
        half.face_vertex_indices.extend(last..last + columns);
        let atlas = check(&half);
        assert_eq!(atlas.chart_count, 1);
        let all = stretches(&half, &atlas);
        let quads = all[..4 * last as usize].iter();
        let sums =
            quads.map(|&([greatest, least], area)| DVec2::new(area * greatest / least, area));
        let sum: DVec2 = sums.sum();
        let at = |row: u32| {
            let ([greatest, least], _) = all[4 * (columns * row) as usize];
            (greatest * least).sqrt()
        };
        (sum.x / sum.y, at(0) / at(rows - 1))
    };
    let (coarse, _) = unfold(6);
    let (fine, ratio) = unfold(24);
    // In proportion to the length of edges.
    assert!(
        coarse < 1.11 && fine - 1.0 < 0.3 * (coarse - 1.0),
        "{coarse} {fine}"
    );
    assert!((1.7..2.3).contains(&ratio), "{ratio}");
}

#[test]
fn closed_shapes_are_cut_into_disks_of_one_density() {
    let bodies = [
        (cube(), 2..=4),
        (torus([24, 12], 0.4), 4..=10),
        (torus([7, 3], 0.3), 2..=10),
        (ball([20, 10], 0.05, 0.95, true), 2..=4),
        (ball([6, 1], 0.3, 0.7, true), 2..=6),
        (ball([16, 6], 0.2, 0.8, false), 2..=4),
    ];
    for (i, (mesh, count)) in bodies.into_iter().enumerate() {
        let atlas = check(&mesh);
        assert!(
            count.contains(&atlas.chart_count),
            "{i}: {}",
            atlas.chart_count
        );
        assert!(atlas.filled > 0.3, "{i}: {}", atlas.filled);
        // Texels for each unit of area, chart by chart.
        let mut sums = vec![DVec2::ZERO; atlas.chart_count as usize];
        let cage = Cage::new(&mesh);
        for face in 0..mesh.face_count() as u32 {
            let first = cage.topology.corners(face).start;
            for t in cage.triangles(face).iter().filter(|t| t.weight > 0.0) {
                let [a, b, c] = t.corners.map(|c| coordinate(&atlas, first + c));
                let area = 0.5 * (b - a).perp_dot(c - a);
                sums[atlas.charts[face as usize] as usize] += t.weight * DVec2::new(area, t.area());
            }
        }
        let density = sums[0].x / sums[0].y;
        for sum in sums {
            assert!((sum.x / sum.y / density - 1.0).abs() < 1e-3, "{i}");
        }
    }
}

#[test]
fn every_kind_of_cage_gets_coordinates() {
    let square = || grid([3, 3], [false; 2], |u, v| Vec3::new(u, v, 0.0));
    let mut left_handed = ball([12, 6], 0.1, 0.9, true);
    left_handed.left_handed = true;
    left_handed.holes = vec![3, 4];
    let mut moebius = bent([12, 2], 6.2, 1.0);
    // The last column runs into the first one, the other way round.
    for v in &mut moebius.face_vertex_indices {
        if *v % 13 == 12 {
            *v = (2 - *v / 13) * 13;
        }
    }
    let l = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.)];
    let l = l.map(|(x, y)| Vec3::new(x, y, 0.1 * x)).to_vec();
    let fan = vec![Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::Y, -Vec3::X];
    let quad = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let mut flat = square();
    flat.points[0][5] = flat.points[0][6];
    let mut point = square();
    point.points[0].fill(Vec3::ONE);
    let mut twice = square();
    twice.face_vertex_indices[1] = twice.face_vertex_indices[0];
    // Left and right of the place, two triangles hang together by a corner alone.
    let pinched = [
        (-3., 1., -3.),
        (2., -3., -1.),
        (2., -3., -1.),
        (-2., -1., 2.),
        (2., 0., 2.),
    ];
    let pinched = pinched.map(|(x, y, z)| Vec3::new(x, y, z)).to_vec();
    let mut pinched = mesh(pinched, &[vec![3, 0, 1, 2, 4]]);
    pinched.left_handed = true;
    let mut scaled = square();
    scaled.points[0].iter_mut().for_each(|p| *p *= 1e17);
    let two = || ball([8, 4], 0.1, 0.9, true);
    let mut islands = two();
    let other = two();
    islands.points[0].extend(other.points[0].iter().map(|p| *p * 0.2 + Vec3::X));
    islands.face_vertex_counts.extend(&other.face_vertex_counts);
    let first = other.points[0].len() as u32;
    islands
        .face_vertex_indices
        .extend(other.face_vertex_indices.iter().map(|v| v + first));
    let cages = [
        ("left-handed", left_handed),
        ("moebius", moebius),
        ("an l", mesh(l, &[vec![0, 1, 2, 3, 4, 5]])),
        (
            "three at an edge",
            mesh(fan, &[vec![0, 1, 2], vec![0, 1, 3], vec![1, 0, 4]]),
        ),
        ("crossed", mesh(quad.clone(), &[vec![0, 1, 3, 2]])),
        (
            "a face on its own back",
            mesh(quad.clone(), &[vec![0, 1, 2, 3], vec![3, 2, 1, 0]]),
        ),
        ("a triangle", mesh(quad, &[vec![0, 1, 2]])),
        ("two points in one place", flat),
        ("all in one place", point),
        ("an edge from a point to itself", twice),
        ("two corners in one place", pinched),
        ("huge", scaled),
        ("islands", islands),
    ];
    for (name, mesh) in cages {
        println!("{name}");
        check(&mesh);
    }
}

#[test]
fn a_cylinder_with_ends_takes_a_few_charts() {
    let mut mesh = grid([16, 6], [true, false], |u, v| {
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        Vec3::new(cos, sin, 4.0 * v)
    });
    mesh.face_vertex_counts.extend([16; 2]);
    mesh.face_vertex_indices.extend((0..16).rev());
    mesh.face_vertex_indices.extend(96..112);
    let atlas = check(&mesh);
    assert!(atlas.chart_count <= 5, "{}", atlas.chart_count);
}

#[test]
fn what_cannot_be_made_says_why() {
    let fault = |mesh: &ControlMesh, options: AtlasOptions| {
        let fault = atlas(mesh, &options).expect_err("a fault");
        assert!(fault.help.is_some(), "{fault}");
        fault.to_string()
    };
    let default = AtlasOptions::default;
    assert!(fault(&mesh(vec![Vec3::ZERO], &[]), default()).contains("no faces"));
    let small = AtlasOptions {
        resolution: 8,
        margin: 5.0,
        ..default()
    };
    let said = fault(&cube(), small);
    assert!(said.contains("do not fit into 8 x 8 texels"), "{said}");
    for (resolution, margin, most_stretch) in [
        (0, 0.0, 2.0),
        (8, 8.0, 2.0),
        (8, f64::NAN, 2.0),
        (8, 1.0, 1.0),
    ] {
        let options = AtlasOptions {
            resolution,
            margin,
            most_stretch,
            ..default()
        };
        fault(&cube(), options);
    }
    let mut broken = cube();
    broken.points[0][3].x = f32::NAN;
    assert!(atlas(&broken, &default()).is_err());
}

#[test]
fn the_same_cage_gives_the_same_bits() {
    let mesh = torus([31, 17], 0.35);
    assert_eq!(unfolded(&mesh), unfolded(&mesh.clone()));
}

/// Charts stay whole where faces of very different size meet: what is rounded is checked again.
#[test]
fn small_faces_beside_large_ones_are_not_turned_over() {
    let mesh = grid([40, 4], [false; 2], |u, v| {
        let x = (14.0 * u).exp();
        Vec3::new(x, x * v, 0.0)
    });
    check(&mesh);
}

#[test]
fn the_sphere_of_many_faces_is_two_charts_or_a_few() {
    let mesh = ball([128, 64], 0.01, 0.99, true);
    let atlas = unfolded(&mesh);
    assert!(atlas.chart_count <= 4, "{}", atlas.chart_count);
    let worst = stretches(&mesh, &atlas)
        .into_iter()
        .fold(DVec3::ZERO, |sum, (s, area)| {
            sum + DVec3::new(area * s[0] / s[1], area, 0.0)
        });
    assert!(worst.x / worst.y < 1.05, "{}", worst.x / worst.y);
}

fn any_mesh() -> impl Strategy<Value = ControlMesh> {
    let point = prop::array::uniform3(-3_i8..4).prop_map(|p| Vec3::from(p.map(f32::from)));
    let points = prop::collection::vec(point, 3..12);
    (points, any::<bool>()).prop_flat_map(|(points, left_handed)| {
        let corner = 0..points.len() as u32;
        let face = prop::collection::vec(corner, 3..7);
        prop::collection::vec(face, 1..10).prop_map(move |faces| ControlMesh {
            left_handed,
            ..mesh(points.clone(), &faces)
        })
    })
}

/// A bumpy grid, of which some faces are left out and some points moved at random.
fn torn_grid() -> impl Strategy<Value = ControlMesh> {
    let heights = prop::collection::vec(-0.3_f32..0.3, 64);
    let left_out = prop::collection::vec(any::<u8>(), 36);
    (heights, left_out).prop_map(|(heights, left_out)| {
        let whole = grid([6, 6], [true, false], |u, v| {
            let bump =
                heights[(u * 6.0).round() as usize * 8 % 64 + (v * 6.0).round() as usize % 8];
            let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
            Vec3::new((1.0 + bump) * cos, (1.0 + bump) * sin, 2.0 * v + bump)
        });
        let quads = whole.face_vertex_indices.chunks_exact(4).zip(left_out);
        let kept = quads.filter(|(_, out)| *out > 40).map(|(f, _)| f.to_vec());
        let faces: Vec<_> = kept.chain([vec![0, 1, 2]]).collect();
        mesh(whole.points[0].clone(), &faces)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(96) })]

    #[test]
    fn any_faces_get_coordinates(mesh in any_mesh()) {
        check(&mesh);
    }

    #[test]
    fn bumps_and_gaps_get_coordinates(mesh in torn_grid()) {
        check(&mesh);
    }
}
