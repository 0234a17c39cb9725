//! Meshes that are not nice: tangled, degenerate, in pieces, very sharp. Nothing panics, hangs or is not finite, and
//! each piece is what it would be alone.

use super::random::{cube, grid, mesh, wheel};
use super::{SMOOTH_SCHEMES, corners, faces, places, position, surface};
use crate::math::{DVec3, Vec3};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, CreaseMethod, Interpolation, Primvar,
    Scheme,
};
use crate::subdiv::refine;

const BOUNDARIES: [BoundaryInterpolation; 3] = [
    BoundaryInterpolation::None,
    BoundaryInterpolation::EdgeOnly,
    BoundaryInterpolation::EdgeAndCorner,
];

/// Evaluates everywhere; refines twice.
#[track_caller]
fn is_finite(mesh: &ControlMesh) {
    mesh.validate().expect("a valid mesh");
    let (surface, points) = surface(mesh);
    for face in faces(&surface) {
        let near = corners(&surface).iter().map(|&[u, v]| {
            let t = 1e-9;
            [u + t * (0.3 - u), v + t * (0.3 - v)]
        });
        for [u, v] in places(&surface, 10)
            .into_iter()
            .chain(corners(&surface).iter().copied())
            .chain(near)
        {
            let p = surface.evaluate(&points, face, u, v);
            let all = [p.position, p.du, p.dv, p.duu, p.duv, p.dvv].concat();
            assert!(
                all.iter().all(|x| x.is_finite()),
                "face {face} at ({u}, {v}): {p:?}"
            );
        }
    }
    let refined = refine(mesh, 2).mesh;
    refined.validate().expect("refinement keeps meshes valid");
}

#[test]
fn tangled_and_degenerate_meshes_are_evaluated() {
    let square = |x: f32| {
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[a, b]| Vec3::new(a + x, b, 0.3 * a * b))
    };
    let mut points = Vec::new();
    points.extend(square(0.0));
    points.extend(square(2.0));
    points.push(Vec3::new(0.5, 0.5, 1.0));
    let cages: [(&str, Vec<Vec<u32>>); 9] = [
        (
            "three faces at an edge",
            vec![vec![0, 1, 2, 3], vec![1, 0, 4, 5], vec![0, 1, 6, 7]],
        ),
        (
            "two fans at a vertex",
            vec![vec![0, 1, 2, 3], vec![2, 4, 5, 6]],
        ),
        (
            "neighbours that disagree on the front",
            vec![vec![0, 1, 2, 3], vec![1, 2, 5, 6]],
        ),
        (
            "two sides of one face",
            vec![vec![0, 1, 2, 3], vec![3, 2, 1, 0]],
        ),
        ("a face twice", vec![vec![0, 1, 2, 3], vec![0, 1, 2, 3]]),
        (
            "a repeated corner",
            vec![vec![0, 1, 1, 3], vec![1, 4, 5, 3]],
        ),
        (
            "a corner that comes back",
            vec![vec![0, 1, 2, 1, 3], vec![1, 4, 5]],
        ),
        ("one vertex only", vec![vec![0, 0, 0, 0], vec![1, 2, 3, 4]]),
        ("a bow tie", vec![vec![0, 1, 2, 0, 4], vec![0, 2, 5, 6]]),
    ];
    for (name, faces) in cages {
        for boundary in BOUNDARIES {
            let mut quads = mesh(Scheme::CatmullClark, points.clone(), &faces);
            quads.boundary = boundary;
            println!("{name}, {boundary:?}");
            is_finite(&quads);
            quads.scheme = Scheme::Bilinear;
            is_finite(&quads);
            // Fans of triangles.
            let triangles: Vec<Vec<u32>> = faces
                .iter()
                .flat_map(|f| f[1..].windows(2).map(|w| vec![f[0], w[0], w[1]]))
                .collect();
            let mut triangles = mesh(Scheme::Loop, points.clone(), &triangles);
            triangles.boundary = boundary;
            is_finite(&triangles);
        }
    }
}

#[test]
fn collapsed_cages_are_evaluated() {
    for scheme in SMOOTH_SCHEMES {
        let mut flat = cube(scheme);
        flat.points[0].fill(Vec3::ONE);
        is_finite(&flat);
        let (surface, points) = surface(&flat);
        let p = surface.evaluate(&points, 0, 0.3, 0.3);
        assert!(DVec3::from(p.position).distance(DVec3::ONE) < 1e-15);
        assert_eq!(p.normal(0.3, 0.3), None);
    }
}

#[test]
fn pieces_are_what_they_are_alone() {
    for scheme in SMOOTH_SCHEMES {
        let (a, b) = (cube(scheme), wheel(scheme, 5));
        let mut both = a.clone();
        // A point that no face uses, between the two.
        both.points[0].push(Vec3::splat(1e6));
        let start = both.point_count() as u32;
        both.points[0].extend(&b.points[0]);
        both.face_vertex_counts.extend(&b.face_vertex_counts);
        both.face_vertex_indices
            .extend(b.face_vertex_indices.iter().map(|v| v + start));
        is_finite(&both);
        let ((of_a, points_a), (of_b, points_b)) = (surface(&a), surface(&b));
        let (of_both, points) = surface(&both);
        for face in faces(&of_both) {
            for uv in places(&of_both, 10) {
                let expected = match face.checked_sub(of_a.face_count() as u32) {
                    Some(face) => position(&of_b, &points_b, face, uv),
                    None => position(&of_a, &points_a, face, uv),
                };
                assert_eq!(position(&of_both, &points, face, uv), expected);
            }
        }
    }
}

#[test]
fn mixed_sharpness_settles() {
    for scheme in SMOOTH_SCHEMES {
        for crease_method in [CreaseMethod::Uniform, CreaseMethod::Chaikin] {
            let mut mesh = cube(scheme);
            mesh.crease_method = crease_method;
            let topology = mesh.topology();
            for edge in 0..topology.edge_count() as u32 {
                mesh.creases.push(Crease {
                    vertices: topology.edge_vertices(edge),
                    sharpness: [9.9, 0.001, 5.5, 10.0, 9.999, 3.0, 0.0][edge as usize % 7],
                });
            }
            mesh.corners.push(Corner {
                vertex: 3,
                sharpness: 9.9,
            });
            mesh.corners.push(Corner {
                vertex: 5,
                sharpness: 0.4,
            });
            is_finite(&mesh);
        }
    }
}

/// Sharpness 9.999 rounds the crease off within 2⁻¹⁰ of it, and 0.001 is nearly none.
#[test]
fn sharpness_is_continuous() {
    for scheme in SMOOTH_SCHEMES {
        let creased = |sharpness: f32| {
            let mut mesh = grid(scheme, 4, 4);
            for (i, p) in mesh.points[0].iter_mut().enumerate() {
                p.z = (i as f32).sin();
            }
            for x in 0..4 {
                mesh.creases.push(Crease {
                    vertices: [10 + x, 11 + x],
                    sharpness,
                });
            }
            mesh
        };
        for (a, b, bound) in [(9.999, 10.0, 5e-4), (0.0, 0.001, 1e-3), (1.999, 2.0, 1e-3)] {
            let (sa, pa) = surface(&creased(a));
            let (sb, pb) = surface(&creased(b));
            let most = faces(&sa)
                .flat_map(|f| places(&sa, 20).into_iter().map(move |uv| (f, uv)))
                .map(|(f, uv)| position(&sa, &pa, f, uv).distance(position(&sb, &pb, f, uv)))
                .fold(0.0, f64::max);
            assert!(most < bound, "{scheme:?}, {a} and {b}: {most}");
        }
    }
}

/// Single precision differs by rounding only.
#[test]
fn single_precision_is_close() {
    for scheme in SMOOTH_SCHEMES {
        for n in [3, 5, 16, 64] {
            let mesh = wheel(scheme, n);
            let (surface, double) = surface(&mesh);
            let single = surface.points::<f32>(&mesh, 0);
            for face in faces(&surface) {
                for [u, v] in places(&surface, 20) {
                    let a = surface.evaluate(&double, face, u, v);
                    let b = surface.evaluate(&single, face, u, v);
                    let off =
                        DVec3::from(a.position).distance(DVec3::from(b.position.map(f64::from)));
                    assert!(off < 2e-6, "{scheme:?}, valence {n}: {off}");
                }
            }
        }
    }
}

/// No face uses some points, or any.
#[test]
fn points_without_faces_keep_their_place() {
    for faces in [vec![], vec![vec![0_u32, 1, 2, 3]]] {
        let points = vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y, Vec3::splat(9.0)];
        let mut cage = mesh(Scheme::CatmullClark, points, &faces);
        let corners = faces.concat().len();
        cage.primvars.push(Primvar {
            name: "st".into(),
            interpolation: Interpolation::FaceVarying,
            width: 1,
            values: vec![1.0; 5],
            indices: Some(vec![4; corners]),
        });
        is_finite(&cage);
        assert_eq!(refine(&cage, 2).mesh.points[0][4], Vec3::splat(9.0));
    }
}
