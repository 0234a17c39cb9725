//! Limit surfaces against a second evaluator, closed forms and what must hold for any mesh.

mod agreement;
mod closed_forms;
mod hard_cases;
mod invariants;
mod memory;
mod random;
mod second;

use super::{Field, LimitSurface};
use crate::math::DVec3;
use crate::mesh::{ControlMesh, Scheme};

const SMOOTH_SCHEMES: [Scheme; 2] = [Scheme::CatmullClark, Scheme::Loop];

/// The surface and its points.
fn surface(mesh: &ControlMesh) -> (LimitSurface, Field<f64>) {
    let surface = LimitSurface::new(mesh);
    let points = surface.points(mesh, 0);
    (surface, points)
}

fn position(surface: &LimitSurface, points: &Field<f64>, face: u32, [u, v]: [f64; 2]) -> DVec3 {
    DVec3::from(surface.evaluate(points, face, u, v).position)
}

/// The Ptex faces that are part of the surface.
fn faces(surface: &LimitSurface) -> impl Iterator<Item = u32> + '_ {
    (0..surface.face_count() as u32).filter(|&f| !surface.is_hole(f))
}

/// Some parameters within a face, the same each time.
fn places(surface: &LimitSurface, count: usize) -> Vec<[f64; 2]> {
    // Fractions of multiples of the plastic number's powers are spread evenly.
    let place = |i: usize| [0.754_877_67, 0.569_840_29].map(|a| (0.137 + a * i as f64).fract());
    let fold = |[u, v]: [f64; 2]| match surface.is_triangular() && u + v > 1.0 {
        true => [1.0 - u, 1.0 - v],
        false => [u, v],
    };
    (0..count).map(|i| fold(place(i))).collect()
}

/// The corners of the parameters' domain.
fn corners(surface: &LimitSurface) -> &'static [[f64; 2]] {
    if surface.is_triangular() {
        &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    } else {
        &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    }
}

fn size(mesh: &ControlMesh) -> f64 {
    let bounds = mesh.bounds();
    f64::from((bounds.max - bounds.min).length())
}

/// Cases of a random test. Failures are not written into the sources.
fn cases(count: u32) -> proptest::test_runner::Config {
    proptest::test_runner::Config {
        failure_persistence: None,
        ..proptest::test_runner::Config::with_cases(count)
    }
}
