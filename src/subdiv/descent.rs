//! What follows from repeating steps while evaluating: points, and the patch or the limit that they end in.

use super::crease;
use super::patch::{self, LimitPoint, PatchKind, Real};
use super::stencils::Stencils;
use crate::math::DVec4;

/// What repeated steps led to.
pub(super) enum Found {
    Patch {
        points: Vec<f64>,
        width: usize,
        u: f64,
        v: f64,
        size: [f64; 2],
    },
    Corner {
        position: Vec<f64>,
        tangents: [Vec<f64>; 2],
    },
}

impl Found {
    pub(super) fn finish<T: Real>(&self, kind: PatchKind, outer: [f64; 2]) -> LimitPoint<T> {
        let three = |p: &[f64]| [p[0], p[1], p[2]].map(T::of);
        match self {
            Self::Patch {
                points, u, v, size, ..
            } => {
                let lanes = |i: usize| {
                    let p = &points[3 * i..];
                    DVec4::new(p[0], p[1], p[2], 0.0)
                };
                let scale = [0, 1].map(|i| size[i] * outer[i]);
                let point = patch::second_order(kind, lanes, [*u, *v], scale);
                let convert = |p: [f64; 3]| p.map(T::of);
                LimitPoint {
                    position: convert(point.position),
                    du: convert(point.du),
                    dv: convert(point.dv),
                    duu: convert(point.duu),
                    duv: convert(point.duv),
                    dvv: convert(point.dvv),
                }
            }
            Self::Corner { position, tangents } => LimitPoint {
                position: three(position),
                du: three(&tangents[0]),
                dv: three(&tangents[1]),
                ..LimitPoint::default()
            },
        }
    }

    pub(super) fn value(&self, kind: PatchKind, out: &mut [f64]) {
        match self {
            Self::Patch {
                points,
                width,
                u,
                v,
                ..
            } => {
                let weights = kind.weights(*u, *v);
                for (point, &w) in points.chunks_exact(*width).zip(&weights) {
                    for (out, &x) in out.iter_mut().zip(point) {
                        *out += w * x;
                    }
                }
            }
            Self::Corner { position, .. } => out.copy_from_slice(position),
        }
    }
}

/// Halves a strip across its crease until (u, v) lies in a smooth patch, as plans do beforehand.
pub(super) fn descend_strip(
    points: &mut [f64],
    width: usize,
    edge: usize,
    mut sharpness: f32,
    uv: [f64; 2],
    mut size: [f64; 2],
) -> Found {
    let axis = usize::from(edge == 0 || edge == 2);
    let turned = edge == 0 || edge == 3;
    let mut t = if turned { 1.0 - uv[axis] } else { uv[axis] };
    let place = |line: usize, along: usize| match edge {
        0 => 4 * (3 - line) + along,
        1 => 4 * along + line,
        2 => 4 * line + along,
        _ => 4 * along + 3 - line,
    };
    while crease::is_sharp(sharpness) {
        let smooth = 1.0 - f64::from(sharpness.min(1.0));
        let near = t >= 0.5;
        for along in 0..4 {
            for k in 0..width {
                let at = |line: usize| place(line, along) * width + k;
                let [a, b, c, d] = [0, 1, 2, 3].map(|line| points[at(line)]);
                let (ab, bc, cd) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + d));
                let b2 = 0.125 * (a + c) + 0.75 * b;
                let c2 = 0.125 * smooth * (b + d) + (1.0 - 0.25 * smooth) * c;
                let lines = if near {
                    [b2, bc, c2, cd]
                } else {
                    [ab, b2, bc, c2]
                };
                for (line, x) in lines.into_iter().enumerate() {
                    points[at(line)] = x;
                }
            }
        }
        t = 2.0 * t - f64::from(u8::from(near));
        size[axis] *= 2.0;
        sharpness = if near {
            (sharpness - 1.0).max(0.0)
        } else {
            0.0
        };
    }
    let mut uv = uv;
    uv[axis] = if turned { 1.0 - t } else { t };
    Found::Patch {
        points: points.to_vec(),
        width,
        u: uv[0],
        v: uv[1],
        size,
    }
}

/// The points of a list.
pub(super) fn pick(points: &[f64], width: usize, list: &[u32]) -> Vec<f64> {
    list.iter()
        .flat_map(|&i| &points[i as usize * width..][..width])
        .copied()
        .collect()
}

/// The weighted sum of points.
pub(super) fn weigh(row: &[f64], points: &[f64], width: usize) -> Vec<f64> {
    let mut sum = vec![0.0; width];
    for (&weight, point) in row.iter().zip(points.chunks_exact(width)) {
        for (sum, &x) in sum.iter_mut().zip(point) {
            *sum += weight * x;
        }
    }
    sum
}

/// Appends the points that `rows` make of `points`, and of each other.
pub(super) fn run(rows: &Stencils, width: usize, points: &mut Vec<f64>) {
    for row in rows.rows() {
        let start = points.len();
        points.resize(start + width, 0.0);
        let (before, new) = points.split_at_mut(start);
        for &(point, weight) in row {
            let value = &before[point as usize * width..][..width];
            for (new, &x) in new.iter_mut().zip(value) {
                *new += weight * x;
            }
        }
    }
}
