//! Where a surface's heights come from, how far they reach, and those that are asked for once.

use rayon::prelude::*;

use super::block::bilinear;
use super::face::Face;
use super::heights::Source;
use crate::math::{Vec2, Vec3};
use crate::surface::{Amount, DisplacementPoint, Region, Shell, Surface, UvRect};

/// Where heights come from. What is kept of them is not yet there.
pub(super) fn source(surface: &Surface, amount: Option<&Amount>) -> Source {
    let Some(amount) = amount else {
        return Source::Flat(0.0);
    };
    if let Some(image) = amount.map.image() {
        return Source::Image(image);
    }
    let value = |face: u32| {
        let bound = amount.map.bound(&Region {
            face,
            rect: UvRect::UNIT,
            st: None,
        })?;
        (bound.min.x == bound.max.x).then_some(bound.min.x)
    };
    let base = surface.base();
    let mut faces = (0..base.faces())
        .filter(|&face| !base.is_hole(face))
        .map(value);
    let first = faces.next().flatten();
    match first {
        Some(value) if faces.all(|other| other == first) => Source::Flat(value),
        _ => Source::Kept(Vec::new()),
    }
}

/// The least and the greatest height that a surface has, or about that where the map has no bounds.
pub(super) fn heights(surface: &Surface, amount: &Amount, source: &Source) -> [f32; 2] {
    if !matches!(source, Source::Kept(_)) {
        return displaced(Some(amount), range(source));
    }
    let base = surface.base();
    let of_face = |face: u32| {
        let bound = amount.map.bound(&Region {
            face,
            rect: UvRect::UNIT,
            st: None,
        });
        let bound = bound.map(|bound| displaced(Some(amount), [bound.min.x, bound.max.x]));
        if let Some(bound) = bound.filter(|bound| bound.iter().all(|height| height.is_finite())) {
            return bound;
        }
        // How far it is moved here and there.
        const AT: [f32; 4] = [0.125, 0.375, 0.625, 0.875];
        let places = AT.into_iter().flat_map(|v| AT.map(|u| Vec2::new(u, v)));
        let far = places.map(|uv| {
            let limit = base.first_order(face, uv, 0).position;
            surface.evaluate(face, uv, 0).position.distance(limit)
        });
        let far = far.fold(0.0, f32::max);
        [-far, far]
    };
    let union = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    (0..base.faces())
        .into_par_iter()
        .filter(|&face| !base.is_hole(face))
        .map(of_face)
        .reduce(|| [0.0; 2], union)
}

/// The least and the greatest height that values of this range make.
pub(super) fn displaced(amount: Option<&Amount>, range: [f32; 2]) -> [f32; 2] {
    let [a, b] = range.map(|value| amount.map_or(0.0, |a| a.scale * value + a.bias));
    [a.min(b), a.max(b)]
}

/// The least and the greatest value.
pub(super) fn range(source: &Source) -> [f32; 2] {
    match source {
        Source::Flat(value) => [*value; 2],
        Source::Image(image) => image.range(None),
        Source::Kept(keys) => {
            let all = keys.iter().flatten();
            let range = all.fold([f32::MAX, f32::MIN], |[low, high], v| {
                [low.min(*v), high.max(*v)]
            });
            if range[0] <= range[1] {
                range
            } else {
                [0.0; 2]
            }
        }
    }
}

/// Asks for the values of all micro-vertices, by motion key, and notes in the faces where they are.
pub(super) fn look_up(shell: &Shell, faces: &mut [Face], amount: &Amount) -> Vec<Vec<f32>> {
    let mut count = 0;
    for face in &mut *faces {
        face.first_height = count as u64;
        count += face.micro_vertices().iter().product::<usize>();
    }
    let nothing = if amount.scale == 0.0 {
        0.0
    } else {
        -amount.bias / amount.scale
    };
    let of_key = |key: u32| {
        let of_face = |face: &Face| {
            let [columns, rows] = face.micro_vertices();
            let value = |(i, j): (usize, usize)| {
                let [(qi, i), (qj, j)] = [(i, 0), (j, 1)].map(|(at, k)| {
                    let n = usize::from(face.cells[k]);
                    let quad = (at / n).min(usize::from(face.quads[k]) - 1);
                    (quad as u16, at - quad * n)
                });
                let corners = face.corners([qi, qj]);
                let mix = |of: [f32; 4]| bilinear(face, [i, j], of);
                let points = corners.map(|c| shell.points(key)[c]);
                let st = corners.map(|c| shell.st()[c]);
                let vector = |of: [Vec3; 4]| Vec3::from([0, 1, 2].map(|k| mix(of.map(|p| p[k]))));
                let at = DisplacementPoint {
                    face: face.face,
                    uv: face.uv([qi, qj], [i, j]),
                    key,
                    position: vector(points.map(|p| p.position)),
                    normal: vector(points.map(|p| p.normal)).normalize_or_zero(),
                    st: Vec2::new(mix(st.map(|st| st.x)), mix(st.map(|st| st.y))),
                };
                let value = amount.map.value(&at).x;
                if (amount.scale * value + amount.bias).is_finite() {
                    value
                } else {
                    nothing
                }
            };
            let all = (0..rows).flat_map(move |j| (0..columns).map(move |i| (i, j)));
            all.map(value).collect::<Vec<f32>>()
        };
        faces.par_iter().flat_map_iter(of_face).collect()
    };
    (0..shell.keys()).map(of_key).collect()
}
