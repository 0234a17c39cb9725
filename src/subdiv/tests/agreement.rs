//! The limit surface of random meshes against the second evaluator.

use std::collections::HashMap;

use proptest::prelude::*;

use super::random::{DECAYED, Dice, dice, random};
use super::second::{Kind, Level};
use super::{size, surface};
use crate::math::DVec3;
use crate::mesh::{ControlMesh, Scheme};

/// Levels whose vertices are compared.
const COMPARED: u32 = 2;

fn agrees(mesh: &ControlMesh) -> Result<(), TestCaseError> {
    let (surface, points) = surface(mesh);
    let mut level = Level::of(mesh);
    for _ in 0..COMPARED {
        level = level.refined();
    }
    let places = level.clone();
    for _ in COMPARED..DECAYED {
        level = level.refined();
    }
    prop_assert!(!level.decays());
    let meets = level.neighbours();
    let size = size(mesh);
    let mut darts = HashMap::new();
    for face in &places.faces {
        for corner in &face.corners {
            let (ptex, [u, v]) = (corner.ptex, corner.uv);
            prop_assert_eq!(surface.is_hole(ptex), face.hole, "Ptex face {}", ptex);
            if face.hole {
                continue;
            }
            let kind = level.kind_of(&meets, corner.vertex);
            let expected = match kind {
                Kind::Dart if mesh.scheme != Scheme::Bilinear => *darts
                    .entry(corner.vertex)
                    .or_insert_with(|| level.limit_by_refinement(corner.vertex)),
                _ => level.limit(&meets, corner.vertex),
            };
            let found = surface.evaluate(&points, ptex, u, v);
            let off = DVec3::from(found.position).distance(expected);
            prop_assert!(
                off <= 1e-12 * size,
                "Ptex face {ptex} ({u}, {v}), {kind:?}: off by {:.2e}",
                off / size
            );
            if kind == Kind::Smooth
                && mesh.scheme != Scheme::Bilinear
                && let Some(normal) = level.normal(&meets, corner.vertex)
            {
                let across = DVec3::from(found.du).cross(DVec3::from(found.dv));
                let scale = DVec3::from(found.du).length() * DVec3::from(found.dv).length();
                // Folded or pinched random cages have no normal worth comparing.
                if across.length() > 1e-3 * scale {
                    let off = across.normalize().distance(normal);
                    prop_assert!(
                        off < 1e-8,
                        "normal at Ptex face {ptex} ({u}, {v}): off by {off:.2e}"
                    );
                }
            }
        }
    }
    Ok(())
}

fn check(scheme: Scheme, dice: &Dice) -> Result<(), TestCaseError> {
    agrees(&random(scheme, dice))
}

proptest! {
    #![proptest_config(super::cases(96))]

    #[test]
    fn catmull_clark_agrees_with_a_second_evaluator(dice in dice()) {
        check(Scheme::CatmullClark, &dice)?;
    }

    #[test]
    fn loop_agrees_with_a_second_evaluator(dice in dice()) {
        check(Scheme::Loop, &dice)?;
    }
}

proptest! {
    #![proptest_config(super::cases(16))]

    #[test]
    fn bilinear_agrees_with_a_second_evaluator(dice in dice()) {
        check(Scheme::Bilinear, &dice)?;
    }
}

#[test]
fn any_valence_agrees_with_a_second_evaluator() {
    for scheme in super::SMOOTH_SCHEMES {
        for n in [3, 5, 7, 12, 31, 64] {
            let mesh = super::random::wheel(scheme, n);
            agrees(&mesh).unwrap_or_else(|e| panic!("{scheme:?}, valence {n}: {e}"));
        }
    }
}
