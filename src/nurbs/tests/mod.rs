//! Shapes whose equations are known, and what must hold for any surface.

mod any;
mod shapes;
mod trims;

use std::f64::consts::FRAC_1_SQRT_2;

use super::{BezierFaces, NurbsSurface};
use crate::mesh::{NurbsDirection, NurbsPatch};

pub(crate) fn direction(order: usize, knots: &[f64]) -> NurbsDirection {
    NurbsDirection {
        order,
        count: knots.len() - order,
        knots: knots.to_vec(),
        ..NurbsDirection::default()
    }
}

/// Four quarters of a circle as quadratic arcs, counterclockwise from +x: corners of the square and weights.
const CIRCLE: [([f32; 2], f64); 9] = [
    ([1.0, 0.0], 1.0),
    ([1.0, 1.0], FRAC_1_SQRT_2),
    ([0.0, 1.0], 1.0),
    ([-1.0, 1.0], FRAC_1_SQRT_2),
    ([-1.0, 0.0], 1.0),
    ([-1.0, -1.0], FRAC_1_SQRT_2),
    ([0.0, -1.0], 1.0),
    ([1.0, -1.0], FRAC_1_SQRT_2),
    ([1.0, 0.0], 1.0),
];
const CIRCLE_KNOTS: [f64; 12] = [0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0];

fn surface(patch: &NurbsPatch) -> NurbsSurface {
    NurbsSurface::new(patch).expect("a valid patch")
}

fn faces(patch: &NurbsPatch) -> BezierFaces {
    BezierFaces::new(&surface(patch)).expect("few points")
}

fn grid(n: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..=n).flat_map(move |j| (0..=n).map(move |i| [i as f64 / n as f64, j as f64 / n as f64]))
}
