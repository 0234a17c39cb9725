//! What holds for all classical schemes, and the triangle schemes' own truths. Doo-Sabin's are in `doo_sabin_tests`.

use std::collections::HashMap;
use std::f32::consts::TAU;
use std::path::Path;

use proptest::prelude::*;

use super::chaikin_page;
use super::classic::{Refined, SchemeKind, refine};
use super::sqrt3;
use crate::math::Vec3;
use crate::mesh::{BoundaryInterpolation, ControlMesh, Corner, Crease, Interpolation, Primvar};
use crate::scene::{LoadOptions, obj};

pub(super) const SCHEMES: [SchemeKind; 3] = [
    SchemeKind::DooSabin,
    SchemeKind::Butterfly,
    SchemeKind::Sqrt3,
];

pub(super) fn mesh(points: Vec<Vec3>, faces: &[Vec<u32>]) -> ControlMesh {
    ControlMesh {
        face_vertex_counts: faces.iter().map(|f| f.len() as u32).collect(),
        face_vertex_indices: faces.concat(),
        points: vec![points],
        ..ControlMesh::default()
    }
}

fn octahedron() -> ControlMesh {
    let points = vec![Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::Z, -Vec3::Z];
    let side = |i: u32| [vec![i, (i + 1) % 4, 4], vec![(i + 1) % 4, i, 5]];
    mesh(points, &(0..4).flat_map(side).collect::<Vec<_>>())
}

/// Two poles and a ring of `n`: poles of valence n, the rest of valence 4.
pub(super) fn bipyramid(n: u32) -> ControlMesh {
    let angle = |i: u32| TAU * i as f32 / n as f32;
    let mut points: Vec<Vec3> = (0..n)
        .map(|i| Vec3::new(angle(i).cos(), angle(i).sin(), 0.0))
        .collect();
    points.extend([Vec3::Z, -Vec3::Z]);
    let side = |i: u32| [vec![i, (i + 1) % n, n], vec![(i + 1) % n, i, n + 1]];
    mesh(points, &(0..n).flat_map(side).collect::<Vec<_>>())
}

/// A torus of 5 x 4 quads or twice as many triangles.
fn torus(triangles: bool) -> ControlMesh {
    let (m, n) = (5, 4);
    let number = |i: u32, j: u32| i % m * n + j % n;
    let mut points = Vec::new();
    let mut faces = Vec::new();
    for i in 0..m {
        for j in 0..n {
            let [a, b] = [(i, m), (j, n)].map(|(i, n)| TAU * i as f32 / n as f32);
            let r = 2.0 + b.cos();
            points.push(Vec3::new(r * a.cos(), r * a.sin(), b.sin()));
            let quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| number(i + x, j + y));
            if triangles {
                faces.push(vec![quad[0], quad[1], quad[2]]);
                faces.push(vec![quad[0], quad[2], quad[3]]);
            } else {
                faces.push(quad.to_vec());
            }
        }
    }
    mesh(points, &faces)
}

/// A regular triangular lattice of n x n points, all inner valences 6, in a plane.
fn lattice(n: u32, height: impl Fn(f32, f32) -> f32) -> ControlMesh {
    let mut points = Vec::new();
    let mut faces = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let (x, y) = (i as f32, j as f32);
            points.push(Vec3::new(x, y, height(x, y)));
            if i + 1 < n && j + 1 < n {
                let v = j * n + i;
                faces.push(vec![v, v + 1, v + n + 1]);
                faces.push(vec![v, v + n + 1, v + n]);
            }
        }
    }
    mesh(points, &faces)
}

fn euler(mesh: &ControlMesh) -> i64 {
    let t = mesh.topology();
    let borders = (0..t.edge_count() as u32)
        .filter(|&e| t.is_border(e))
        .count();
    assert_eq!(borders, 0, "it is closed");
    assert!((0..t.edge_count() as u32).all(|e| t.is_edge_manifold(e)));
    t.vertex_count() as i64 - t.edge_count() as i64 + t.face_count() as i64
}

#[test]
fn closed_meshes_stay_closed() {
    for scheme in SCHEMES {
        for (cage, characteristic) in [
            (octahedron(), 2),
            (bipyramid(3), 2),
            (bipyramid(64), 2),
            (torus(scheme.needs_triangles()), 0),
        ] {
            for level in 0..4 {
                let fine = refine(&cage, scheme, level).expect("valid").mesh;
                assert_eq!(euler(&fine), characteristic, "{scheme:?} {level}");
                assert_eq!(fine.validate(), Ok(()));
            }
        }
    }
}

#[test]
fn symmetric_shapes_stay_symmetric() {
    for scheme in SCHEMES {
        let fine = refine(&octahedron(), scheme, 3).expect("valid").mesh;
        let points = &fine.points[0];
        for p in points {
            for image in [Vec3::new(p.y, p.z, p.x), Vec3::new(-p.y, p.x, p.z), -*p] {
                let found = points.iter().any(|q| q.distance(image) < 1e-5);
                assert!(found, "{scheme:?}: {p} has no image {image}");
            }
        }
    }
}

#[test]
fn butterfly_passes_through_its_points_and_keeps_cubics() {
    let cubic =
        |x: f32, y: f32| 0.1 * (x * x * x - 2.0 * x * y * y + x * y - 3.0 * y * y + x - 2.0);
    let cage = lattice(9, cubic);
    let fine = refine(&cage, SchemeKind::Butterfly, 2).expect("valid").mesh;
    assert_eq!(fine.points[0][..81], cage.points[0][..]);
    let mut inside = 0;
    for p in &fine.points[0] {
        if p.x.min(p.y) >= 3.0 && p.x.max(p.y) <= 5.0 {
            inside += 1;
            assert!((p.z - cubic(p.x, p.y)).abs() < 1e-4, "{p}");
        }
    }
    assert_eq!(inside, 81);
}

#[test]
fn two_steps_of_sqrt3_split_each_triangle_into_nine() {
    let mut cage = lattice(6, |_, _| 0.0);
    // The corners with one face stay by themselves.
    cage.corners = [0, 35]
        .map(|vertex| Corner {
            vertex,
            sharpness: Crease::INFINITE,
        })
        .to_vec();
    let t = cage.topology();
    // Each face has texture coordinates of its own: all edges are seams.
    let map = |f: u32, p: Vec3| {
        let f = f as f32;
        [0.1 * f + p.x, p.y * (f % 7.0) - 0.3 * p.x]
    };
    let corners = (0..t.corner_count() as u32).flat_map(|c| {
        let point = cage.points[0][t.vertex(c) as usize];
        map(t.face(c), point)
    });
    cage.primvars.push(Primvar {
        name: "st".into(),
        interpolation: Interpolation::FaceVarying,
        width: 2,
        values: corners.collect(),
        indices: None,
    });
    let Refined {
        mesh: fine,
        parent_face,
        ..
    } = refine(&cage, SchemeKind::Sqrt3, 2).expect("valid");
    assert_eq!(fine.face_count(), 9 * cage.face_count());
    assert_eq!(
        fine.point_count(),
        t.vertex_count() + 2 * t.edge_count() + t.face_count()
    );
    let st = fine.primvar("st").expect("kept");
    let mut of_parent = vec![0; cage.face_count()];
    for (face, range) in fine.faces().enumerate() {
        let parent = parent_face[face];
        of_parent[parent as usize] += 1;
        let corner = |i: usize| fine.points[0][fine.face_vertex_indices[range.start + i] as usize];
        let area = (corner(1) - corner(0)).cross(corner(2) - corner(0)).z / 2.0;
        assert!((area - 0.5 / 9.0).abs() < 1e-4, "face {face}: {area}");
        for i in 0..3 {
            let p = corner(i);
            // Corners at the border stay, edges cut near one are mirrored: the lattice is kept exactly.
            assert!(((p * 3.0) - (p * 3.0).round()).length() < 1e-4, "{p}");
            let expected = map(parent, p);
            let found = st.get(range.start + i);
            for k in 0..2 {
                assert!(
                    (found[k] - expected[k]).abs() < 1e-3,
                    "face {face}: {found:?}"
                );
            }
        }
    }
    assert!(of_parent.iter().all(|&n| n == 9), "{of_parent:?}");
}

#[test]
fn the_limit_of_sqrt3_is_that_of_every_level() {
    for cage in [
        bipyramid(3),
        bipyramid(5),
        bipyramid(64),
        lattice(4, |x, y| x * x - y * x),
    ] {
        let limit = sqrt3::limit(&cage)[0].clone();
        for level in 1..6 {
            let fine = refine(&cage, SchemeKind::Sqrt3, level).expect("valid").mesh;
            let finer = &sqrt3::limit(&fine)[0];
            for (p, q) in limit.iter().zip(finer) {
                assert!(p.distance(*q) < 1e-4, "level {level}: {p} {q}");
            }
        }
        let deep = refine(&cage, SchemeKind::Sqrt3, 8).expect("valid").mesh;
        for (p, q) in limit.iter().zip(&deep.points[0]) {
            assert!(p.distance(*q) < 1e-2, "{p} {q}");
        }
    }
}

#[test]
fn holes_and_dropped_borders_keep_their_faces() {
    let mut cage = lattice(4, |_, _| 0.0);
    cage.holes = vec![4];
    for (scheme, children) in [(SchemeKind::Butterfly, 16), (SchemeKind::Sqrt3, 9)] {
        let fine = refine(&cage, scheme, 2).expect("valid");
        assert_eq!(fine.mesh.holes.len(), children);
        let inside = |&h: &u32| fine.parent_face[h as usize] == 4;
        assert!(fine.mesh.holes.iter().all(inside));
        // Without an interpolated border only the middle is left: two of eighteen faces.
        let open = ControlMesh {
            boundary: BoundaryInterpolation::None,
            holes: Vec::new(),
            ..cage.clone()
        };
        let fine = refine(&open, scheme, 2).expect("valid").mesh;
        assert_eq!(fine.face_count() - fine.holes.len(), 2 * children);
    }
}

#[test]
fn faults_name_the_face() {
    let quad = mesh(
        vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y],
        &[vec![0, 1, 2], vec![0, 1, 2, 3]],
    );
    for scheme in [SchemeKind::Butterfly, SchemeKind::Sqrt3] {
        let fault = refine(&quad, scheme, 1).expect_err("a quad");
        assert_eq!(fault.face, Some(1));
        assert!(fault.help.is_some() && fault.to_string().contains("4 corners"));
    }
    let twice = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], &[vec![0, 1, 2, 1]]);
    let fault = refine(&twice, SchemeKind::DooSabin, 1).expect_err("a point twice");
    assert_eq!(
        (fault.face, fault.message.as_str()),
        (Some(0), "point 1 is a corner twice")
    );
    for scheme in SCHEMES {
        assert!(refine(&octahedron(), scheme, 40).is_err(), "40 levels");
    }
    let mut tagged = octahedron();
    tagged.corners.push(Corner {
        vertex: 0,
        sharpness: 2.0,
    });
    let fine = refine(&tagged, SchemeKind::Butterfly, 1).expect("valid");
    assert_eq!((fine.ignored_tags, fine.mesh.corners.len()), (1, 0));
}

/// Faces at random over few points: borders, fins, bow ties and faces turned over are likely.
pub(super) fn soup(largest: u32) -> impl Strategy<Value = ControlMesh> {
    let point = [-4.0_f32..4.0, -4.0..4.0, -4.0..4.0].prop_map(Vec3::from_array);
    let points = prop::collection::vec(point, 7..11);
    let face = (3..=largest, any::<u64>());
    let boundary = prop::sample::select(vec![
        BoundaryInterpolation::None,
        BoundaryInterpolation::EdgeOnly,
        BoundaryInterpolation::EdgeAndCorner,
    ]);
    (
        points,
        prop::collection::vec(face, 0..14),
        boundary,
        any::<bool>(),
    )
        .prop_map(|(points, faces, boundary, hole)| {
            let faces: Vec<Vec<u32>> = faces
                .into_iter()
                .map(|(corners, seed)| {
                    let mut seed = seed;
                    let mut left: Vec<u32> = (0..points.len() as u32).collect();
                    (0..corners)
                        .map(|_| {
                            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                            left.swap_remove((seed >> 33) as usize % left.len())
                        })
                        .collect()
                })
                .collect();
            let corners = faces.concat().len();
            let primvar = |name: &str, interpolation, width: u32, elements: usize| Primvar {
                name: name.into(),
                interpolation,
                width,
                values: (0..elements * width as usize)
                    .map(|i| (i % 5) as f32)
                    .collect(),
                indices: None,
            };
            let mut mesh = mesh(points, &faces);
            mesh.points
                .push(mesh.points[0].iter().map(|p| *p + Vec3::ONE).collect());
            mesh.boundary = boundary;
            mesh.holes = (0..u32::from(hole && !faces.is_empty())).collect();
            mesh.primvars = vec![
                primvar("constant", Interpolation::Constant, 3, 1),
                primvar("uniform", Interpolation::Uniform, 1, faces.len()),
                primvar("varying", Interpolation::Varying, 2, mesh.point_count()),
                primvar("vertex", Interpolation::Vertex, 1, mesh.point_count()),
                primvar("st", Interpolation::FaceVarying, 2, corners),
            ];
            mesh
        })
}

fn check(cage: &ControlMesh, scheme: SchemeKind) -> Result<(), TestCaseError> {
    // A map that keeps no lengths and no angles.
    let map =
        |p: Vec3| Vec3::new(p.y - 2.0 * p.x, 0.5 * p.z + p.x, p.z) + Vec3::new(9.0, -7.0, 3.0);
    let mut moved = cage.clone();
    moved.points[1] = cage.points[0].iter().map(|&p| map(p)).collect();
    for level in 0..=3 {
        let fine = refine(&moved, scheme, level).expect("valid");
        prop_assert_eq!(fine.mesh.validate(), Ok(()));
        prop_assert_eq!(fine.parent_face.len(), fine.mesh.face_count());
        let most = cage.face_count();
        prop_assert!(fine.parent_face.iter().all(|&f| (f as usize) < most));
        for (p, q) in fine.mesh.points[0].iter().zip(&fine.mesh.points[1]) {
            prop_assert!(
                map(*p).distance(*q) < 1e-3,
                "level {}: {} {}",
                level,
                map(*p),
                q
            );
        }
        // A point that no face uses is still there.
        let used: Vec<u32> = cage.face_vertex_indices.clone();
        for (v, p) in cage.points[0].iter().enumerate() {
            let found = || fine.mesh.points[0].iter().any(|q| q == p);
            prop_assert!(used.contains(&(v as u32)) || found(), "point {v} is lost");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(150) })]

    #[test]
    fn any_polygons_refine_affinely(cage in soup(6)) {
        check(&cage, SchemeKind::DooSabin)?;
    }

    #[test]
    fn any_triangles_refine_affinely(cage in soup(3)) {
        for scheme in SCHEMES {
            check(&cage, scheme)?;
        }
    }
}

#[test]
fn face_varying_values_without_seams_are_shared() {
    for scheme in SCHEMES {
        let mut cage = torus(scheme.needs_triangles());
        let st: Vec<f32> = cage.points[0].iter().flat_map(|p| [p.x, p.y]).collect();
        cage.primvars = vec![
            Primvar {
                name: "varying".into(),
                interpolation: Interpolation::Varying,
                width: 2,
                values: st.clone(),
                indices: None,
            },
            Primvar {
                name: "st".into(),
                interpolation: Interpolation::FaceVarying,
                width: 2,
                values: st,
                indices: Some(cage.face_vertex_indices.clone()),
            },
        ];
        let fine = refine(&cage, scheme, 3).expect("valid").mesh;
        let (varying, st) = (&fine.primvars[0], &fine.primvars[1]);
        let mut elements = HashMap::new();
        for (c, &v) in fine.face_vertex_indices.iter().enumerate() {
            let (a, b) = (varying.get(v as usize), st.get(c));
            assert!(
                (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-5,
                "{scheme:?}"
            );
            let element = st.indices.as_ref().expect("indexed")[c];
            assert_eq!(*elements.entry(v).or_insert(element), element, "{scheme:?}");
        }
    }
}

#[test]
fn the_scenes_take_every_scheme() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/schemes");
    let scene = obj::load(&folder.join("cage.obj"), &LoadOptions::default()).expect("loads");
    let cage = &scene.shapes[0].mesh;
    for scheme in SCHEMES {
        let fine = refine(cage, scheme, 4).expect("triangles").mesh;
        assert_eq!(fine.validate(), Ok(()));
        // One border, that of the open arm; it has three corners and no point of its own left over.
        let t = fine.topology();
        let borders = (0..t.edge_count() as u32).filter(|&e| t.is_border(e));
        let expected = match scheme {
            SchemeKind::DooSabin | SchemeKind::Butterfly => 3 << 4,
            SchemeKind::Sqrt3 => 3 * 9,
        };
        assert_eq!(borders.count(), expected, "{scheme:?}");
        assert!((0..t.vertex_count() as u32).all(|v| t.is_vertex_manifold(v)));
    }
    let curves = obj::load_polylines(&folder.join("curve.obj")).expect("loads");
    let svg = chaikin_page::draw(&curves, 4).expect("valid");
    assert!(svg.contains("<polygon") && svg.contains("<polyline"));
}
