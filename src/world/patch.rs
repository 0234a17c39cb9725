//! NURBS patches: where they are not what they say, and where they stand.

use crate::error::Warnings;
use crate::math::Affine3A;
use crate::mesh::{NurbsForm, NurbsPatch};
use crate::surface::Patch;

/// Gaps in parts of the domain that are told: between a trim curve and the next.
const TOLD_GAP: f64 = 1e-6;

/// Tells where the patch is not what it says.
pub(super) fn notice(patch: &NurbsPatch, surface: &Patch, path: &str, warnings: &mut Warnings) {
    for (axis, direction, name) in [(0, &patch.u, "uForm"), (1, &patch.v, "vForm")] {
        let form = match direction.form {
            NurbsForm::Open => continue,
            NurbsForm::Closed => "closed",
            NurbsForm::Periodic => "periodic",
        };
        if !surface.pieces().is_closed(axis) {
            warnings.add("patch that does not close", || {
                format!(
                    "{path}: {name} is {form}, but the patch's ends do not meet; they are left as they are"
                )
            });
        }
    }
    if surface.trim().gap() > TOLD_GAP {
        warnings.add("open trim loop", || {
            format!(
                "{path}: a trim curve does not begin where the one before ends; a straight line closes the gap"
            )
        });
    }
}

/// The patch with its points in another space.
pub(super) fn in_space(patch: &NurbsPatch, world_from_object: &Affine3A) -> NurbsPatch {
    let mut patch = patch.clone();
    for point in patch.points.iter_mut().flatten() {
        *point = world_from_object.transform_point3(*point);
    }
    // A mirror image turns the surface round.
    if world_from_object.matrix3.determinant() < 0.0 {
        patch.left_handed = !patch.left_handed;
    }
    patch
}
