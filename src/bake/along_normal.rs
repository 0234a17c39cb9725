//! The dense mesh along a normal of the limit surface, after the idea of Lee, Moreton and Hoppe, *Displaced Subdivision
//! Surfaces*, SIGGRAPH 2000: the line through a limit point along its normal is intersected with the detailed surface,
//! before and behind, and the signed distance to it is the displacement.
//!
//! Ours: places are the middles of texels. Of several points that the line meets, the nearest one counts that faces the
//! same way; which way the dense mesh faces as a whole is found out first. The line ends at a reach, so that where
//! nothing belongs to a place, what happens to lie on the far side of the model does not count. Where nothing is met the
//! displacement stays open, to be filled from around.
//!
//! Embree's rays are in single precision. They tell which triangle is met, and the distance is that of the triangle's
//! plane in double precision, kept within the triangle.

use super::dense::Dense;
use crate::math::{DVec3, Ray};

/// A limit point and the unit normal through it, to the front.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) point: DVec3,
    pub(super) normal: DVec3,
}

/// Which triangles a line meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Facing {
    /// All.
    Any,
    /// Those whose front is where the normal points to.
    Same,
    /// Those whose back is.
    Opposite,
}

impl Facing {
    fn admits(self, cosine: f64) -> bool {
        match self {
            Self::Any => true,
            Self::Same => cosine > 0.0,
            Self::Opposite => cosine < 0.0,
        }
    }
}

/// Where a line meets the dense mesh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// How far from the limit point along the normal; below 0 behind the surface.
    pub(super) height: f64,
    /// The cross product of two sides of the triangle that is met: as long as its area twice.
    pub(super) across: DVec3,
}

/// How far before the limit point rays begin, as a part of the reach: what lies in the surface itself is met too.
const BEFORE: f64 = 1e-4;
/// Layers that face away and are gone through before a line gives up.
const MOST_LAYERS: usize = 1000;

/// What lies nearest along a line, before or behind, within `reach`; otherwise whether it met what `facing` does not
/// admit.
pub(super) fn closest(dense: &Dense, line: &Line, reach: f64, facing: Facing) -> Result<Hit, bool> {
    let (before, behind) = (
        first(dense, line, 1.0, reach, facing),
        first(dense, line, -1.0, reach, facing),
    );
    match (before, behind) {
        (Ok(before), Ok(behind)) => Ok(if behind.height.abs() < before.height.abs() {
            behind
        } else {
            before
        }),
        (Ok(hit), Err(_)) | (Err(_), Ok(hit)) => Ok(hit),
        (Err(before), Err(behind)) => Err(before || behind),
    }
}

/// The first that is met on one side, to which `sign` points.
fn first(dense: &Dense, line: &Line, sign: f64, reach: f64, facing: Facing) -> Result<Hit, bool> {
    let direction = sign * line.normal;
    let before = BEFORE * reach;
    let mut ray = Ray {
        origin: (line.point - before * direction).as_vec3(),
        direction: direction.as_vec3(),
        t_min: 0.0,
        t_max: (reach + before) as f32,
        time: 0.0,
    };
    let mut faced_away = false;
    for _ in 0..MOST_LAYERS {
        let Some(hit) = dense.meet(&ray) else {
            break;
        };
        let [a, b, c] = dense.triangle(hit.primitive);
        let across = (b - a).cross(c - a);
        if facing.admits(across.dot(line.normal)) {
            let rough = sign * (f64::from(hit.t) - before);
            let height = height([a, b, c], across, line, rough);
            return Ok(Hit { height, across });
        }
        faced_away = true;
        ray.t_min = hit.t.next_up();
    }
    Err(faced_away)
}

/// The height at which a line meets a triangle, known roughly.
fn height(triangle: [DVec3; 3], across: DVec3, line: &Line, rough: f64) -> f64 {
    let heights = triangle.map(|p| (p - line.point).dot(line.normal));
    let exact = across.dot(triangle[0] - line.point) / across.dot(line.normal);
    let height = if exact.is_finite() { exact } else { rough };
    // What is met lies in the triangle: a plane that the line grazes says little.
    let low = heights.into_iter().fold(f64::INFINITY, f64::min);
    let high = heights.into_iter().fold(f64::NEG_INFINITY, f64::max);
    height.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_those_of_the_plane_and_stay_in_the_triangle() {
        let line = Line {
            point: DVec3::new(0.25, 0.25, 1.0),
            normal: DVec3::Z,
        };
        let tilted = [DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0), DVec3::Y];
        let across = (tilted[1] - tilted[0]).cross(tilted[2] - tilted[0]);
        assert_eq!(height(tilted, across, &line, 0.0), -0.75);
        let upright = [DVec3::ZERO, DVec3::Z, DVec3::Y];
        let across = DVec3::X;
        assert_eq!(height(upright, across, &line, -0.5), -0.5);
        assert_eq!(height(upright, across, &line, 7.0), 0.0);
    }
}
