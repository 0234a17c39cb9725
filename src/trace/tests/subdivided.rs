//! Subdivision surfaces: limits, creases, holes, borders, primvars, displacement, and hard meshes.

use super::*;
use crate::math::Vec2;
use crate::mesh::{BoundaryInterpolation, Corner, Crease, Interpolation, Primvar, Scheme};

fn build(device: &Device, mesh: ControlMesh, options: SubdivisionOptions) -> Scene {
    let geometry = Geometry::subdivision(device, arc(mesh), options).expect("a good mesh");
    commit(device, geometry).expect("it builds")
}

fn primvar(name: &str, interpolation: Interpolation, values: Vec<f32>) -> Primvar {
    Primvar {
        name: name.into(),
        interpolation,
        width: 1,
        values,
        indices: None,
    }
}

#[test]
fn a_corner_of_the_cube_has_its_limit() {
    let device = device();
    let scene = build(&device, cube(), options(16.0));
    // Limit mask at valence 3: (n² v + 4 Σ e + Σ f) / (n (n + 5)), e the edges' other ends, f the faces' corners
    // across. Of the corner (1,1,1): Σ e = (1,1,1), Σ f = (-1,-1,-1).
    let limit = (9.0 + 4.0 - 1.0) / 24.0;
    // Face 0 is 4, 5, 7, 6: point 7 is its corner 2.
    let point = scene.geometry(0).surface_point(0, Vec2::ONE, 0.0);
    assert!(
        (point.position - Vec3::splat(limit)).length() < 1e-5,
        "{point:?}"
    );
    // Slightly outside is inside.
    let out = scene.geometry(0).surface_point(0, Vec2::splat(1.001), 0.0);
    assert!((out.position - point.position).length() < 1e-6);

    let hit = scene.intersect(&down(0.1, 0.2)).expect("a hit");
    let point = scene.geometry(0).surface_point(hit.primitive, hit.uv, 0.0);
    assert!(hit.normal.z > 0.0 && point.du.cross(point.dv).z > 0.0);
    assert!((point.position - Vec3::new(0.1, 0.2, 10.0 - hit.t)).length() < 0.01);
    // Derivatives against differences.
    let h = 1e-2;
    let near = |d: Vec2| {
        let uv = hit.uv + d;
        scene.geometry(0).surface_point(hit.primitive, uv, 0.0)
    };
    let [du, dv] =
        [Vec2::X, Vec2::Y].map(|d| (near(h * d).position - near(-h * d).position) / (2.0 * h));
    assert!(
        (du - point.du).length() < 1e-3 && (dv - point.dv).length() < 1e-3,
        "{du} {dv} {point:?}"
    );
}

#[test]
fn left_handed_meshes_face_the_other_way() {
    let device = device();
    let scene = build(
        &device,
        ControlMesh {
            left_handed: true,
            ..cube()
        },
        options(4.0),
    );
    assert!(scene.intersect(&down(0.1, 0.2)).expect("a hit").normal.z < 0.0);
}

#[test]
fn infinite_creases_keep_the_cube() {
    let device = device();
    let mut mesh = cube();
    for a in 0..8_u32 {
        for bit in [1, 2, 4].into_iter().filter(|bit| a & bit == 0) {
            mesh.creases.push(Crease {
                vertices: [a, a | bit],
                sharpness: Crease::INFINITE,
            });
        }
        mesh.corners.push(Corner {
            vertex: a,
            sharpness: 11.0,
        });
    }
    let scene = build(&device, mesh, options(4.0));
    for (x, y) in [(0.0, 0.0), (0.99, 0.99), (-0.97, 0.3)] {
        assert!((scene.intersect(&down(x, y)).expect("a hit").t - 9.0).abs() < 1e-5);
    }
    assert_eq!(
        scene.geometry(0).surface_point(0, Vec2::ONE, 0.0).position,
        Vec3::ONE
    );
    // A crease of sharpness 1 lies between.
    let half = ControlMesh {
        creases: vec![Crease {
            vertices: [5, 7],
            sharpness: 1.0,
        }],
        ..cube()
    };
    let at = |m| {
        build(&device, m, options(4.0))
            .geometry(0)
            .surface_point(0, Vec2::new(1.0, 0.5), 0.0)
            .position
            .x
    };
    let (smooth, half) = (at(cube()), at(half));
    assert!(smooth + 0.01 < half && half < 0.99, "{smooth} {half}");
}

#[test]
fn holes_are_seen_through() {
    let device = device();
    let scene = build(
        &device,
        ControlMesh {
            holes: vec![4],
            ..sheet(3)
        },
        options(4.0),
    );
    assert!(
        scene.intersect(&down(1.5, 1.5)).is_none() && scene.intersect(&down(0.5, 1.5)).is_some()
    );
    let _ = scene.geometry(0).surface_point(4, Vec2::splat(0.5), 0.0);
}

#[test]
fn borders_are_what_the_mesh_says() {
    let device = device();
    let hits = |boundary| {
        let scene = build(
            &device,
            ControlMesh {
                boundary,
                ..sheet(3)
            },
            options(16.0),
        );
        [(0.02, 0.02), (0.02, 1.5), (1.5, 1.5)].map(|(x, y)| scene.intersect(&down(x, y)).is_some())
    };
    assert_eq!(
        hits(BoundaryInterpolation::EdgeAndCorner),
        [true, true, true]
    );
    assert_eq!(hits(BoundaryInterpolation::EdgeOnly), [false, true, true]);
    assert_eq!(hits(BoundaryInterpolation::None), [false, false, true]);
    let bilinear = build(
        &device,
        ControlMesh {
            scheme: Scheme::Bilinear,
            ..cube()
        },
        options(2.0),
    );
    assert!((bilinear.intersect(&down(0.95, 0.95)).expect("a hit").t - 9.0).abs() < 1e-5);
}

#[test]
fn rates_of_edges_are_followed() {
    let device = device();
    let top = |rates| {
        let scene = build(
            &device,
            cube(),
            SubdivisionOptions {
                rates,
                ..options(1.0)
            },
        );
        10.0 - scene.intersect(&down(0.0, 0.0)).expect("a hit").t
    };
    let exact = build(&device, cube(), options(1.0))
        .geometry(0)
        .surface_point(0, Vec2::splat(0.5), 0.0)
        .position
        .z;
    let (coarse, fine) = (
        top(Rates::PerCorner(vec![1.0; 24])),
        top(Rates::PerCorner(vec![32.0; 24])),
    );
    assert!(
        (fine - exact).abs() < 1e-3 && (coarse - exact).abs() > 0.1,
        "{coarse} {fine} {exact}"
    );
    let wrong = SubdivisionOptions {
        rates: Rates::PerCorner(vec![1.0; 23]),
        ..options(1.0)
    };
    assert!(Geometry::subdivision(&device, arc(cube()), wrong).is_err());
}

#[test]
fn primvars_follow_their_interpolation() {
    let device = device();
    let mut mesh = sheet(2);
    let kinds = [
        primvar("c", Interpolation::Constant, vec![7.0]),
        primvar("u", Interpolation::Uniform, vec![1.0, 2.0, 3.0, 4.0]),
        primvar(
            "y",
            Interpolation::Varying,
            (0..9).map(|i| if i == 4 { 1.0 } else { 0.0 }).collect(),
        ),
        primvar(
            "v",
            Interpolation::Vertex,
            (0..9).map(|i| if i == 4 { 1.0 } else { 0.0 }).collect(),
        ),
        primvar(
            "f",
            Interpolation::FaceVarying,
            (0..16).map(|i| (i / 4) as f32).collect(),
        ),
    ];
    let names = kinds.iter().map(|p| p.name.clone()).collect();
    mesh.primvars = kinds.into();
    let none = SubdivisionOptions {
        primvars: vec!["w".into()],
        ..options(1.0)
    };
    assert!(Geometry::subdivision(&device, arc(mesh.clone()), none).is_err());
    let scene = build(
        &device,
        mesh,
        SubdivisionOptions {
            primvars: names,
            ..options(2.0)
        },
    );
    let get = |slot, face, u, v| {
        let mut out = [f32::NAN];
        scene
            .geometry(0)
            .primvar(slot, face, Vec2::new(u, v), &mut out);
        out[0]
    };
    let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
    close(get(0, 3, 0.3, 0.3), 7.0);
    close(get(1, 2, 0.3, 0.3), 3.0);
    // Face 0's corner 2 is the middle point.
    close(get(2, 0, 0.5, 0.5), 0.25);
    close(get(2, 0, 1.0, 1.0), 1.0);
    // Regular limit mask: 16/36 of the point itself.
    close(get(3, 0, 1.0, 1.0), 16.0 / 36.0);
    (0..4).for_each(|face| close(get(4, face, 0.9, 0.2), face as f32));
}

#[test]
fn displacement_moves_the_surface_and_reads_primvars() {
    let device = device();
    let mut mesh = sheet(8);
    mesh.primvars = vec![primvar(
        "x",
        Interpolation::Vertex,
        mesh.points[0].iter().map(|p| p.x).collect(),
    )];
    let displacement: Displacement = Arc::new(|p| {
        let mut x = [0.0];
        p.primvar(0, &mut x);
        assert!((x[0] - p.position.x).abs() < 1e-4 && (p.normal - Vec3::Z).length() < 1e-4);
        p.normal * x[0]
    });
    let options = SubdivisionOptions {
        displacement: Some(displacement),
        primvars: vec!["x".into()],
        ..options(16.0)
    };
    let scene = build(&device, mesh, options);
    let hit = scene.intersect(&down(3.3, 4.4)).expect("a hit");
    assert!((10.0 - hit.t - 3.3).abs() < 1e-3, "{hit:?}");
    let mut x = [0.0];
    scene.geometry(0).primvar(0, hit.primitive, hit.uv, &mut x);
    assert!((x[0] - 3.3).abs() < 1e-2);
}

#[test]
fn displaced_points_are_those_of_the_surface_not_of_its_facets() {
    let device = device();
    // A constant height keeps the normal, on quads and on triangles.
    for mesh in [cube(), fan(5)] {
        let faces = mesh.face_count() as u32;
        let triangles = mesh.face_vertex_counts[0] == 3;
        let displacement: Displacement = Arc::new(|p| 0.3 * p.normal);
        let displaced = SubdivisionOptions {
            displacement: Some(displacement),
            ..options(8.0)
        };
        let scene = build(&device, mesh, displaced);
        let geometry = scene.geometry(0);
        for face in 0..faces {
            for inner in [
                Vec2::new(0.0, 0.3),
                Vec2::new(0.7, 0.2),
                Vec2::new(0.5, 0.9),
            ] {
                let uv = if triangles { face_uv(1, inner) } else { inner };
                let limit = geometry.surface_point(face, uv, 0.0);
                let moved = geometry.displaced_point(face, uv, 0.0);
                let normal = limit.du.cross(limit.dv).normalize();
                assert!((moved.position - limit.position - 0.3 * normal).length() < 1e-5);
                let turned = moved.du.cross(moved.dv).normalize().dot(normal);
                assert!(turned > 0.995, "{face} {uv}: {turned}");
            }
        }
    }
    // A wave on a flat sheet has the wave's slope.
    let displacement: Displacement = Arc::new(|p| 0.2 * (2.0 * p.position.x).sin() * p.normal);
    let displaced = SubdivisionOptions {
        displacement: Some(displacement),
        ..options(16.0)
    };
    let scene = build(&device, sheet(8), displaced);
    for x in [3.1_f32, 3.5, 4.0, 4.77] {
        let hit = scene.intersect(&down(x, 4.4)).expect("a hit");
        let point = scene
            .geometry(0)
            .displaced_point(hit.primitive, hit.uv, 0.0);
        let expected = 0.4 * (2.0 * point.position.x).cos();
        let slope = point.du.z / point.du.x;
        assert!((slope - expected).abs() < 3e-3, "{x}: {slope} {expected}");
    }
}

#[test]
fn a_displacement_that_panics_is_an_error() {
    let device = device();
    let displacement: Displacement = Arc::new(|_| panic!("no texture"));
    let options = SubdivisionOptions {
        displacement: Some(displacement),
        ..options(4.0)
    };
    let built = commit(
        &device,
        Geometry::subdivision(&device, arc(cube()), options).expect("made"),
    );
    assert!(
        built
            .err()
            .expect("an error")
            .to_string()
            .contains("no texture")
    );
}

#[test]
fn moving_surfaces_move() {
    let device = device();
    let mut mesh = cube();
    mesh.points
        .push(mesh.points[0].iter().map(|p| p + Vec3::Z * 2.0).collect());
    let scene = build(&device, mesh, options(8.0));
    let t = |time| {
        scene
            .intersect(&Ray {
                time,
                ..down(0.0, 0.0)
            })
            .expect("a hit")
            .t
    };
    assert!((t(0.0) - t(0.5) - 1.0).abs() < 1e-4);
    let z = |time| {
        scene
            .geometry(0)
            .surface_point(0, Vec2::splat(0.5), time)
            .position
            .z
    };
    assert!((z(0.5) - z(0.0) - 1.0).abs() < 1e-5);
}

fn polygon(n: u32) -> ControlMesh {
    let mut mesh = fan(n);
    mesh.face_vertex_counts = vec![n];
    mesh.face_vertex_indices = (1..=n).collect();
    mesh
}

#[test]
fn polygons_up_to_fifteen_corners() {
    let device = device();
    let scene = build(&device, polygon(15), options(8.0));
    let hit = scene.intersect(&down(0.6, -0.3)).expect("a hit");
    let point = scene.geometry(0).surface_point(0, hit.uv, 0.0);
    assert!(
        (point.position - Vec3::new(0.6, -0.3, 0.0)).length() < 0.02,
        "{hit:?} {point:?}"
    );
    let (corner, inner) = sub_face_of(hit.uv);
    assert!((face_uv(corner, inner) - hit.uv).length() < 1e-6);
    assert!(Geometry::subdivision(&device, arc(polygon(16)), options(1.0)).is_err());
    let fault = Geometry::subdivision(&device, arc(polygon(17)), options(1.0))
        .err()
        .expect("too many");
    assert!(fault.to_string().contains("face 0: 17 corners"), "{fault}");
}

#[test]
fn other_schemes_are_refused() {
    for scheme in [Scheme::Loop, Scheme::None] {
        let mesh = ControlMesh { scheme, ..fan(5) };
        assert!(Geometry::subdivision(&device(), arc(mesh), options(1.0)).is_err());
    }
}

#[test]
fn points_of_large_valence() {
    let device = device();
    for n in [3, 40, 62, 63] {
        let scene = build(&device, fan(n), options(4.0));
        assert!(scene.intersect(&down(0.1, 0.05)).is_some(), "valence {n}");
        assert!(
            scene
                .geometry(0)
                .surface_point(0, face_uv(0, Vec2::ZERO), 0.0)
                .position
                .is_finite()
        );
    }
    // Faces of 4 and 6 corners that share point 0 and one edge each with the next.
    let wheel = |n: u32, corners: u32| {
        let mut mesh = fan(n * (corners - 2));
        mesh.face_vertex_counts = vec![corners; n as usize];
        let rim = n * (corners - 2);
        mesh.face_vertex_indices = (0..n)
            .flat_map(|f| {
                (0..corners).map(move |c| match c {
                    0 => 0,
                    _ => 1 + (f * (corners - 2) + c - 1) % rim,
                })
            })
            .collect();
        mesh
    };
    for (n, corners) in [(63, 4), (31, 6)] {
        let scene = build(&device, wheel(n, corners), options(4.0));
        assert!(scene.intersect(&down(0.1, 0.05)).is_some());
        for face in 0..n {
            let point = scene.geometry(0).surface_point(face, Vec2::splat(0.6), 0.0);
            assert!(point.position.is_finite());
        }
    }
    for (n, corners) in [(64, 4), (32, 6)] {
        let mesh = arc(wheel(n, corners));
        assert!(Geometry::subdivision(&device, mesh, options(4.0)).is_err());
    }
    for n in [64, 65, 200] {
        assert!(Geometry::subdivision(&device, arc(fan(n)), options(4.0)).is_err());
    }
}

#[test]
fn hard_meshes_do_not_crash() {
    let device = device();
    let mut book = sheet(1);
    // Three more pages on one edge.
    book.points[0].extend([
        Vec3::new(0.0, -1.0, 1.0),
        Vec3::new(1.0, -1.0, 1.0),
        Vec3::new(0.0, 0.0, 2.0),
        Vec3::new(1.0, 0.0, 2.0),
    ]);
    book.face_vertex_counts = vec![4; 3];
    book.face_vertex_indices.extend([0, 1, 5, 4, 1, 0, 6, 7]);
    let mut unused = sheet(2);
    unused.points[0].push(Vec3::splat(50.0));
    let twisted = ControlMesh {
        face_vertex_indices: vec![0, 1, 3, 2],
        ..sheet(1)
    };
    let repeated = ControlMesh {
        face_vertex_indices: vec![0, 1, 1, 3],
        ..sheet(1)
    };
    let same = ControlMesh {
        face_vertex_counts: vec![4; 3],
        face_vertex_indices: [0, 1, 3, 2].repeat(3),
        ..sheet(1)
    };
    let point = ControlMesh {
        points: vec![vec![Vec3::ZERO; 4]],
        ..sheet(1)
    };
    let mut bow = sheet(2);
    bow.face_vertex_counts = vec![4; 2];
    bow.face_vertex_indices.drain(4..12);
    let empty = ControlMesh {
        points: vec![vec![Vec3::ZERO]],
        ..ControlMesh::default()
    };
    for (name, mesh) in [
        ("book", book),
        ("unused", unused),
        ("twisted", twisted),
        ("repeated", repeated),
        ("same", same),
        ("point", point),
        ("bow", bow),
        ("empty", empty),
    ] {
        let faces = mesh.face_count() as u32;
        let scene = build(&device, mesh, options(4.0));
        let _ = (scene.intersect(&down(0.5, 0.5)), name);
        for face in 0..faces {
            assert!(
                scene
                    .geometry(0)
                    .surface_point(face, Vec2::splat(0.5), 0.0)
                    .position
                    .is_finite(),
                "{name}"
            );
        }
    }
}
