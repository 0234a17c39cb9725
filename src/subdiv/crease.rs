//! Sharpness: what shapes a vertex, how it decays from level to level, and how two rules blend meanwhile.
//!
//! Infinitely sharp creases are those of Hoppe et al., *Piecewise Smooth Surface Reconstruction*, 1994; semi-sharp
//! ones those of DeRose, Kass, Truong, *Subdivision Surfaces in Character Animation*, 1998, section 3: sharp rules
//! for as many levels as the sharpness says, smooth ones from then on. Unlike the paper, and as OpenSubdiv does, a
//! vertex at which several sharpnesses end in one step blends by their mean, and Chaikin's rule takes the mean of
//! all other semi-sharp edges at the vertex, not that of one crease.

use crate::mesh::{Crease, CreaseMethod};

/// Which mask a vertex takes. A dart, where one sharp edge ends, is smooth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    Smooth,
    Crease,
    Corner,
}

/// Whether an edge or vertex is sharp at this level.
pub(super) fn is_sharp(sharpness: f32) -> bool {
    sharpness > 0.0
}

/// Whether it stays sharp at all levels.
pub(super) fn is_infinite(sharpness: f32) -> bool {
    sharpness >= Crease::INFINITE
}

/// Whether it is sharp for a while only.
pub(super) fn is_semi_sharp(sharpness: f32) -> bool {
    is_sharp(sharpness) && !is_infinite(sharpness)
}

/// The sharpness after one level, by the uniform rule.
pub(super) fn decayed(sharpness: f32) -> f32 {
    if is_infinite(sharpness) {
        Crease::INFINITE
    } else {
        left(f64::from(sharpness) - 1.0)
    }
}

/// Less than this is what rounding leaves of 0. Rules change there, and all faces must see it.
const ROUNDING: f64 = 1e-6;

fn left(sharpness: f64) -> f32 {
    if sharpness > ROUNDING {
        sharpness as f32
    } else {
        0.0
    }
}

/// The sharpness of an edge's half next to a vertex whose edges are `around`, this one included.
///
/// Faces see the edges in different orders: sums are in double precision, so that all get the same result.
pub(super) fn child_sharpness(
    method: CreaseMethod,
    sharpness: f32,
    around: impl Iterator<Item = f32>,
) -> f32 {
    if method == CreaseMethod::Uniform || !is_semi_sharp(sharpness) {
        return decayed(sharpness);
    }
    let (sum, count) = around
        .filter(|&s| is_semi_sharp(s))
        .fold((0.0, 0), |(sum, count), s| (sum + f64::from(s), count + 1));
    if count < 2 {
        return decayed(sharpness);
    }
    let own = f64::from(sharpness);
    let others = (sum - own) / f64::from(count - 1);
    left(0.75 * own + 0.25 * others - 1.0)
}

/// The rule of a vertex with this sharpness and number of sharp edges.
pub(super) fn rule(vertex_sharpness: f32, sharp_edges: usize) -> Rule {
    match sharp_edges {
        _ if is_sharp(vertex_sharpness) => Rule::Corner,
        0 | 1 => Rule::Smooth,
        2 => Rule::Crease,
        _ => Rule::Corner,
    }
}

/// How much of the old rule is left in a step that changes a vertex' rule: the mean of what ends in it, at most 1.
///
/// Pairs are (before, after). With Chaikin's rule sharpnesses above 1 may end, and ones below may not.
pub(super) fn share_of_old_rule(
    method: CreaseMethod,
    vertex: (f32, f32),
    edges: impl Iterator<Item = (f32, f32)>,
) -> f64 {
    let vertex = (is_sharp(vertex.0) && !is_sharp(vertex.1)).then_some(vertex.0);
    let edges = edges.filter(|&(before, after)| {
        is_sharp(before)
            && match method {
                CreaseMethod::Uniform => before <= 1.0,
                CreaseMethod::Chaikin => !is_sharp(after),
            }
    });
    let (sum, count) = vertex
        .into_iter()
        .chain(edges.map(|e| e.0))
        .fold((0.0, 0), |(sum, count), s| (sum + f64::from(s), count + 1));
    if count == 0 {
        0.0
    } else {
        (sum / f64::from(count)).min(1.0)
    }
}
