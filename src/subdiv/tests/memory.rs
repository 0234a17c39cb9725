//! What surfaces hold: bounded for each face, whatever is sharp.

use super::random::grid;
use super::surface;
use crate::math::Vec3;
use crate::mesh::{ControlMesh, Crease, CreaseMethod, Scheme};

/// Bytes a face of the surface and its points, and how many plans there are.
fn measure(mesh: &ControlMesh) -> (f64, usize) {
    let (surface, _) = surface(mesh);
    let points = surface.points::<f32>(mesh, 0);
    let bytes = surface.memory() + points.memory();
    (
        bytes as f64 / surface.face_count() as f64,
        surface.plan_count(),
    )
}

/// A grid whose every 3 x 3 block has an extraordinary vertex: its middle quad is cut in two, or, with Loop, a
/// diagonal is turned.
fn irregular(scheme: Scheme, n: u32) -> ControlMesh {
    let plain = grid(Scheme::CatmullClark, n, n);
    let mut mesh = ControlMesh {
        scheme,
        points: plain.points.clone(),
        ..ControlMesh::default()
    };
    for (i, range) in (0_u32..).zip(plain.faces()) {
        let quad = &plain.face_vertex_indices[range];
        let middle = i % n % 3 == 1 && i / n % 3 == 1;
        let turn = usize::from(middle);
        let at = |k: usize| quad[(k + turn) % 4];
        if middle || scheme == Scheme::Loop {
            mesh.face_vertex_counts.extend([3, 3]);
            let halves = [at(0), at(1), at(2), at(0), at(2), at(3)];
            mesh.face_vertex_indices.extend(halves);
        } else {
            mesh.face_vertex_counts.push(4);
            mesh.face_vertex_indices.extend(quad);
        }
    }
    mesh
}

#[test]
fn memory_is_linear_in_faces() {
    for scheme in [Scheme::CatmullClark, Scheme::Loop] {
        for (name, make) in [
            ("regular", grid as fn(Scheme, u32, u32) -> ControlMesh),
            ("irregular", |scheme, n, _| irregular(scheme, n)),
        ] {
            let [(small, plans), (large, plans_large)] =
                [60, 180].map(|n| measure(&make(scheme, n, n)));
            println!(
                "{scheme:?}, {name}: {small:.0} bytes a face at 60 x 60, {large:.0} at 180 x 180; {plans} plans"
            );
            assert_eq!(plans, plans_large);
            // What all faces share counts less and less.
            assert!(large < 1.02 * small, "{small} {large}");
        }
    }
}

/// Creases on every third row, the edges of which differ in sharpness by up to `spread`.
fn creased(scheme: Scheme, method: CreaseMethod, sharpness: f32, spread: f32) -> ControlMesh {
    let mut mesh = grid(scheme, 12, 12);
    mesh.crease_method = method;
    for y in (1..12).step_by(3) {
        for x in 0..12 {
            let a = y * 13 + x;
            mesh.creases.push(Crease {
                vertices: [a, a + 1],
                sharpness: sharpness - spread * (a % 7) as f32 / 6.0,
            });
        }
    }
    mesh
}

/// What is stored is bounded by the levels that a crease lasts, not by two to their power.
#[test]
fn sharp_creases_cost_no_more_than_their_levels() {
    for scheme in super::SMOOTH_SCHEMES {
        for (method, spread) in [
            (CreaseMethod::Uniform, 0.0),
            (CreaseMethod::Uniform, 0.2),
            (CreaseMethod::Chaikin, 0.0),
        ] {
            for sharpness in [0.5_f32, 3.5, 9.9] {
                let (bytes, plans) = measure(&creased(scheme, method, sharpness, spread));
                println!(
                    "{scheme:?}, {method:?}, {sharpness} by {spread}: {bytes:.0} bytes a face, {plans} plans"
                );
                assert!(bytes < 12_000.0 * f64::from(sharpness.ceil()), "{bytes}");
            }
        }
    }
}

/// Under Chaikin's rule unequal sharpnesses along a crease mix, and no two of its 2ⁿ pieces are alike. What is stored
/// grows no faster than the levels do, all the same.
#[test]
fn unequal_chaikin_creases_cost_no_more_than_their_levels() {
    for scheme in super::SMOOTH_SCHEMES {
        let bytes =
            |sharpness: f32| measure(&creased(scheme, CreaseMethod::Chaikin, sharpness, 0.2)).0;
        let least = bytes(2.0) / 2.0;
        for sharpness in [3.0_f32, 4.0, 6.0, 8.0, 9.9] {
            let bytes = bytes(sharpness);
            println!("{scheme:?}, unequal Chaikin, {sharpness}: {bytes:.0} bytes a face");
            let levels = f64::from(sharpness.ceil());
            assert!(bytes < 2.0 * least * levels, "{sharpness}: {bytes} {least}");
        }
    }
}

/// A straight crease of one sharpness is a strip: the same few plans for all of it.
#[test]
fn straight_creases_share_plans() {
    let creased = |n: u32| {
        let mut mesh = grid(Scheme::CatmullClark, n, 8);
        for x in 0..n {
            let a = 4 * (n + 1) + x;
            mesh.creases.push(Crease {
                vertices: [a, a + 1],
                sharpness: 9.9,
            });
        }
        for p in &mut mesh.points[0] {
            *p += Vec3::Z * (p.x - p.y).sin();
        }
        measure(&mesh)
    };
    let [(small, plans), (large, plans_large)] = [20, 200].map(creased);
    assert_eq!(plans, plans_large);
    assert!(large < small, "{small} {large}");
}
