//! Where the points of the classical schemes' refined meshes lie on the limit surface.

use super::classic::{self, Refined, SchemeKind};
use super::doo_sabin_limit::DooSabinSurface;
use super::sqrt3;
use crate::error::Fault;
use crate::mesh::{BoundaryInterpolation, ControlMesh};

/// Refines `levels` times and moves the points to the limit surface, at all motion keys.
///
/// - Butterfly passes through all its points: they stay.
/// - √3 has a mask for each point. Those that an odd level adds next to a border have none ([`sqrt3::limit`]).
/// - A point of Doo-Sabin's goes to the middle of its patch, where the vertex faces around it shrink to. Points of
///   the control mesh have no patches, and borders that shrink have no limit.
///
/// # Errors
/// Those of [`classic::refine`], and a limit that does not exist.
pub fn refine_to_limit(
    mesh: &ControlMesh,
    scheme: SchemeKind,
    levels: u32,
) -> Result<Refined, Fault> {
    let mut refined = classic::refine(mesh, scheme, levels)?;
    match scheme {
        SchemeKind::Butterfly => {}
        SchemeKind::Sqrt3 => {
            let topology = refined.mesh.topology();
            let has_border = (0..topology.edge_count() as u32).any(|e| topology.is_border(e));
            if has_border && !levels.is_multiple_of(2) {
                return Err(no_limit(
                    "√3 points at the border, after an odd number of levels,",
                    "ask for an even number of levels",
                ));
            }
            refined.mesh.points = sqrt3::limit(&refined.mesh);
        }
        SchemeKind::DooSabin => move_to_patches(&mut refined, mesh, levels)?,
    }
    Ok(refined)
}

fn move_to_patches(refined: &mut Refined, mesh: &ControlMesh, levels: u32) -> Result<(), Fault> {
    let Some(before) = levels.checked_sub(1) else {
        return Err(no_limit(
            "points of a control mesh of Doo-Sabin's",
            "ask for one level at least",
        ));
    };
    if mesh.boundary == BoundaryInterpolation::None {
        let topology = mesh.topology();
        if (0..topology.edge_count() as u32).any(|e| topology.is_border(e)) {
            return Err(no_limit(
                "Doo-Sabin borders that shrink",
                "take the boundary rule edgeOnly or edgeAndCorner",
            ));
        }
    }
    let coarser = classic::refine(mesh, SchemeKind::DooSabin, before)?;
    let surface = DooSabinSurface::new(&coarser.mesh)?;
    // A control vertex with two faces makes the surface refine once more.
    if surface.cage().mesh.face_vertex_counts != refined.mesh.face_vertex_counts {
        return Err(no_limit(
            "the first level of a mesh with vertices of two faces",
            "ask for two levels at least",
        ));
    }
    for (key, points) in refined.mesh.points.iter_mut().enumerate() {
        for patch in 0..surface.patch_count() {
            if let Some(sample) = surface.middle(key, patch) {
                points[surface.patch_point(patch) as usize] = sample.position.as_vec3();
            }
        }
    }
    Ok(())
}

fn no_limit(what: &str, help: &str) -> Fault {
    Fault::new(format!("{what} have no limit")).advise(help)
}

#[cfg(test)]
mod tests {
    use super::super::classic_tests::{SCHEMES, bipyramid};
    use super::*;
    use crate::math::Vec3;

    /// Refined further, the points' own traces come to rest where the limit said, or the nearest point does.
    #[test]
    fn deep_refinement_comes_to_the_limit() {
        for scheme in SCHEMES {
            let mesh = bipyramid(5);
            let limit = refine_to_limit(&mesh, scheme, 2).expect("a limit");
            let plain = classic::refine(&mesh, scheme, 2).expect("valid");
            assert_eq!(
                limit.mesh.face_vertex_indices,
                plain.mesh.face_vertex_indices
            );
            let deep = classic::refine(&mesh, scheme, 8).expect("valid").mesh;
            let nearest = |p: Vec3| {
                let distances = deep.points[0].iter().map(|q| p.distance(*q));
                distances.fold(f32::INFINITY, f32::min)
            };
            let far = |points: &[Vec3]| points.iter().map(|p| nearest(*p)).fold(0.0, f32::max);
            // A point of the deep mesh is within its own face's size of the surface.
            assert!(far(&limit.mesh.points[0]) < 0.012, "{scheme:?}");
            if scheme != SchemeKind::Butterfly {
                assert!(far(&plain.mesh.points[0]) > 0.012, "{scheme:?}");
            }
        }
    }

    #[test]
    fn what_has_no_limit_is_a_fault() {
        let closed = bipyramid(5);
        let mut open = bipyramid(5);
        open.face_vertex_counts.pop();
        open.face_vertex_indices.truncate(27);
        let fault = |mesh: &ControlMesh, scheme, levels| {
            refine_to_limit(mesh, scheme, levels)
                .expect_err("no limit")
                .to_string()
        };
        assert!(fault(&closed, SchemeKind::DooSabin, 0).contains("no limit"));
        assert!(fault(&open, SchemeKind::Sqrt3, 1).contains("odd number"));
        assert!(refine_to_limit(&open, SchemeKind::Sqrt3, 2).is_ok());
        assert!(refine_to_limit(&open, SchemeKind::DooSabin, 1).is_ok());
        open.boundary = BoundaryInterpolation::None;
        assert!(fault(&open, SchemeKind::DooSabin, 1).contains("shrink"));
    }
}
