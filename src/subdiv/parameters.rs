//! Parameters of a face, and of the quarters that it is split into.

use super::patch::PatchKind;

/// Parameters within the face; what is not a number becomes 0.
#[inline]
pub(super) fn clamp(kind: PatchKind, u: f64, v: f64) -> [f64; 2] {
    let [u, v] = [u, v].map(unit);
    if kind.is_triangular() && u + v > 1.0 {
        [u / (u + v), 1.0 - u / (u + v)]
    } else {
        [u, v]
    }
}

/// The quarter that (u, v) is in, which become parameters of that quarter; `size` grows likewise.
#[inline]
pub(super) fn quarter(kind: PatchKind, u: &mut f64, v: &mut f64, size: &mut [f64; 2]) -> usize {
    if kind.is_triangular() {
        let child = if *u >= 0.5 {
            1
        } else if *v >= 0.5 {
            2
        } else if *u + *v >= 0.5 {
            3
        } else {
            0
        };
        let turned = if child == 3 { -1.0 } else { 1.0 };
        (*u, *v) = match child {
            0 => (2.0 * *u, 2.0 * *v),
            1 => (2.0 * *u - 1.0, 2.0 * *v),
            2 => (2.0 * *u, 2.0 * *v - 1.0),
            _ => (1.0 - 2.0 * *u, 1.0 - 2.0 * *v),
        };
        for s in size {
            *s *= 2.0 * turned;
        }
        child
    } else {
        let (right, up) = (*u >= 0.5, *v >= 0.5);
        *u = 2.0 * *u - f64::from(u8::from(right));
        *v = 2.0 * *v - f64::from(u8::from(up));
        for s in size {
            *s *= 2.0;
        }
        // Counterclockwise: 0, then 1 to the right, 2 above that, and 3.
        usize::from(right != up) | usize::from(up) << 1
    }
}

/// Parameters closer to a corner than this are at the corner: what lies between is below rounding.
const AT_CORNER: f64 = 1e-14;

/// The corner of the face that (u, v) is, if it is one.
pub(super) fn corner_at(kind: PatchKind, u: f64, v: f64) -> Option<usize> {
    let near = |x: f64, to: f64| (x - to).abs() < AT_CORNER;
    let corners: &[[f64; 2]] = if kind.is_triangular() {
        &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    } else {
        &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    };
    corners
        .iter()
        .position(|&[cu, cv]| near(u, cu) && near(v, cv))
}

/// Derivatives by u and v from those towards the next and the previous corner.
pub(super) fn by_parameters(
    kind: PatchKind,
    corner: usize,
    [next, previous]: [Vec<f64>; 2],
) -> [Vec<f64>; 2] {
    let minus = |a: &[f64]| a.iter().map(|x| -x).collect::<Vec<f64>>();
    let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x - y).collect();
    match (kind.is_triangular(), corner) {
        (_, 0) => [next, previous],
        (true, 1) => [minus(&previous), difference(&next, &previous)],
        (true, _) => [difference(&previous, &next), minus(&next)],
        (false, 1) => [minus(&previous), next],
        (false, 2) => [minus(&next), minus(&previous)],
        (false, _) => [previous, minus(&next)],
    }
}

#[inline]
fn unit(x: f64) -> f64 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}
