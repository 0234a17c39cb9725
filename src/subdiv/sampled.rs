//! One sample of a limit surface in full: position, derivatives and normal, as far as each is defined.
//!
//! Derivatives have no length at an extraordinary vertex, and normals none where tangents degenerate. What stands here
//! leaves out what is not defined, so that it can be compared with another evaluator's values.

use super::limit::{Field, LimitSurface};
use super::patch::LimitPoint;

/// A limit point with what is defined there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Where.
    pub position: [f64; 3],
    /// By u and v of the Ptex face; nothing at an extraordinary vertex.
    pub derivatives: Option<[[f64; 3]; 2]>,
    /// The unit normal; nothing where the tangents degenerate.
    pub normal: Option<[f64; 3]>,
}

impl LimitSurface {
    /// The sample at (u, v) of a Ptex face; nothing if that is a hole. `field` has three components.
    ///
    /// `isolation` names the level of refinement, 6 and more, at which extraordinary vertices take their masks, as
    /// OpenSubdiv does; without it they are exact. See [`isolate`](Self::isolate).
    pub fn sample(
        &self,
        field: &Field<f64>,
        face: u32,
        [u, v]: [f64; 2],
        isolation: Option<u32>,
    ) -> Option<Sample> {
        if self.is_hole(face) {
            return None;
        }
        let three = |p: &[f64]| [p[0], p[1], p[2]];
        let isolated = isolation.and_then(|level| self.isolate(field, face, u, v, level));
        let (point, has_lengths) = match isolated {
            Some(corner) => {
                let [du, dv] = &corner.tangents;
                let point = LimitPoint {
                    position: three(&corner.position),
                    du: three(du),
                    dv: three(dv),
                    ..LimitPoint::default()
                };
                (point, corner.has_lengths)
            }
            None => (
                self.evaluate(field, face, u, v),
                !self.is_extraordinary(face, u, v),
            ),
        };
        Some(Sample {
            position: point.position,
            derivatives: has_lengths.then_some([point.du, point.dv]),
            normal: point.normal(u, v),
        })
    }

    /// The value of a field of any width at (u, v) of a Ptex face, likewise.
    pub fn sample_value(
        &self,
        field: &Field<f64>,
        face: u32,
        [u, v]: [f64; 2],
        isolation: Option<u32>,
    ) -> Option<Vec<f64>> {
        if self.is_hole(face) {
            return None;
        }
        let isolated = isolation.and_then(|level| self.isolate(field, face, u, v, level));
        Some(match isolated {
            Some(corner) => corner.position,
            None => {
                let mut value = vec![0.0; field.width()];
                self.interpolate(field, face, u, v, &mut value);
                value
            }
        })
    }
}
