//! Displaced surfaces against differences, their bounds against samples, their dicing against itself.

mod bounding;
mod cages;
mod dicing;
mod displacing;
pub(crate) mod leaks;
mod patches;
pub(crate) mod shapes;
mod shell;

use std::sync::Arc;

use super::*;
use crate::image::Wrap;
use crate::math::{Vec2, Vec3};
use shapes::{Patches, noise};

pub(crate) fn amount(map: impl DisplacementMap + 'static, scale: f32) -> Amount {
    Amount {
        map: Arc::new(map),
        scale,
        bias: 0.0,
    }
}

/// Waves that no axis is aligned with.
pub(crate) fn waves(at: &DisplacementPoint) -> f32 {
    let p = at.position;
    (5.0 * p.x + 3.0 * p.y).sin() * (4.0 * p.z - 2.0 * p.x).cos()
}

/// Every kind of displacement, `scale` deep.
pub(crate) fn displacements(scale: f32) -> Vec<(&'static str, Displacement)> {
    let function = |at: &DisplacementPoint| Vec3::new(waves(at), at.uv.x, -0.5 * at.uv.y);
    let image = |names: &str, channels: Channels| {
        let texture = noise([37, 23], names, Wrap::Repeat, 5);
        amount(ImageMap::new(texture, channels), scale)
    };
    let waves_bounded = Function::scalar(waves).bounded(|_| crate::math::Bounds3 {
        min: Vec3::new(-1.0, 0.0, 0.0),
        max: Vec3::new(1.0, 0.0, 0.0),
    });
    vec![
        ("none", Displacement::None),
        ("waves", Displacement::Scalar(amount(waves_bounded, scale))),
        (
            "heights",
            Displacement::Scalar(Amount {
                bias: 0.3 * scale,
                ..image("Y", Channels::Scalar)
            }),
        ),
        (
            "object function",
            Displacement::Vector(
                amount(
                    Function::vector(function).bounded(|_| crate::math::Bounds3 {
                        min: Vec3::new(-1.0, 0.0, -0.5),
                        max: Vec3::new(1.0, 1.0, 0.0),
                    }),
                    scale,
                ),
                Space::Object,
            ),
        ),
        (
            "object image",
            Displacement::Vector(image("RGB", Channels::Vector), Space::Object),
        ),
        (
            "tangent image",
            Displacement::Vector(image("RGB", Channels::Vector), Space::Tangent),
        ),
    ]
}

pub(crate) fn surface(base: Patches, displacement: Displacement) -> Surface {
    Surface::new(Arc::new(base), displacement)
}

/// How many random samples a test takes: `usual`, times the number in the environment's `RELIEVO_EFFORT`.
pub(crate) fn effort(usual: usize) -> usize {
    let factor = std::env::var("RELIEVO_EFFORT").ok();
    usual * factor.and_then(|f| f.parse().ok()).unwrap_or(1)
}

/// Rates that differ from edge to edge, 1 to 9.
pub(crate) fn mixed(surface: &Surface) -> Rates {
    Rates::by_edge(surface, |edge| 1 + (edge * 7 + edge / 3) % 9)
}

/// Closed surfaces of mixed orientations, with creases, seams and poles.
pub(crate) fn closed() -> Vec<(&'static str, Patches)> {
    vec![
        ("cube", Patches::cube()),
        ("turned cube", Patches::cube().turned()),
        ("sphere", Patches::sphere(2)),
        ("turned sphere", Patches::sphere(3).turned()),
        ("torus", Patches::torus(5, 4)),
        ("turned torus", Patches::torus(4, 3).turned()),
        ("globe", Patches::globe(5)),
        (
            "opaque sphere",
            Patches {
                opaque: true,
                ..Patches::sphere(2)
            },
        ),
    ]
}

#[test]
fn a_patch_agrees_with_itself() {
    let base = Patches::torus(5, 4);
    let us = [0.0, 0.2, 0.7, 1.0];
    let vs = [1.0, 0.4, 0.0];
    let mut grid = LimitGrid::default();
    for face in 0..base.faces() {
        base.evaluate_grid(face, &us, &vs, 0, &mut grid);
        for (i, uv) in vs
            .iter()
            .flat_map(|&v| us.map(|u| Vec2::new(u, v)))
            .enumerate()
        {
            let p = base.evaluate(face, uv, 0);
            let [du, dv] = grid.derivatives(i);
            assert!((grid.position(i) - p.position).length() < 1e-6);
            assert!((du - p.du).length() < 1e-5 && (dv - p.dv).length() < 1e-5);
            // Second derivatives against differences of the first.
            let h = 1e-2;
            let near = |d: Vec2| base.evaluate(face, uv + d, 0);
            let [duu, duv] =
                [Vec2::X, Vec2::Y].map(|d| (near(h * d).du - near(-h * d).du) / (2.0 * h));
            let dvv = (near(h * Vec2::Y).dv - near(-h * Vec2::Y).dv) / (2.0 * h);
            for (a, b) in [(duu, p.duu), (duv, p.duv), (dvv, p.dvv)] {
                assert!((a - b).length() < 5e-3, "{a} {b}");
            }
        }
        let rect = UvRect {
            min: Vec2::new(0.2, 0.5),
            max: Vec2::new(0.6, 0.9),
        };
        let part = base.bezier(face, &rect, 0).expect("a patch");
        let uv = Vec2::new(0.25, 0.75);
        let whole = base.evaluate(face, rect.min + uv * (rect.max - rect.min), 0);
        assert!((part.evaluate(uv).position - whole.position).length() < 1e-6);
    }
}
