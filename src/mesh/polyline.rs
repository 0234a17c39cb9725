//! A polyline: the control mesh of a curve.

use super::ControlMesh;
use crate::error::Fault;
use crate::math::Vec3;

/// Points in their order along a curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Polyline {
    /// The points, at least 2, and 3 if it is closed.
    pub points: Vec<Vec3>,
    /// Whether the last point joins the first one, which is not repeated.
    pub closed: bool,
}

impl Polyline {
    /// How many straight pieces it has.
    pub fn segments(&self) -> usize {
        if self.closed {
            self.points.len()
        } else {
            self.points.len().saturating_sub(1)
        }
    }

    /// Checks what later stages rely on.
    ///
    /// # Errors
    /// Too few points; one that [`ControlMesh::validate`] would refuse too.
    pub fn validate(&self) -> Result<(), Fault> {
        let least = if self.closed { 3 } else { 2 };
        if self.points.len() < least {
            return Err(Fault::new(format!(
                "{} polyline of {} points",
                if self.closed { "a closed" } else { "an open" },
                self.points.len()
            ))
            .advise(format!("it needs {least} at least")));
        }
        ControlMesh {
            points: vec![self.points.clone()],
            ..ControlMesh::default()
        }
        .validate()
    }
}
