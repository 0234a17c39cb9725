//! Subdivision: from the control mesh to the surface that it stands for.
//!
//! [`LimitSurface`] gives any face's limit point and derivatives, alone; [`refine`](uniform::refine) makes a finer
//! mesh. Both take their masks from `schemes`, one file a scheme, their sharpness from `crease`, and both work on a
//! `Cage`, which is a mesh's topology with its sharpness at one level. [`schemes::classic`] has the textbooks' schemes
//! that refine in ways of their own, [`schemes::chaikin`] curves. Geometry in, geometry out: nothing here reads a file
//! or knows Embree. What comes in has passed [`crate::mesh::ControlMesh::validate`], so that nothing fails but the
//! classical schemes, which do not take every mesh.

mod basis;
mod cage;
mod corner_limit;
mod crease;
mod descent;
mod limit;
mod parameters;
mod patch;
mod plan;
mod refine;
mod regular;
mod ring;
mod sampled;
pub mod schemes;
mod stencils;
mod step;
#[cfg(test)]
mod tests;
mod uniform;

pub use limit::{BezierLeaf, Field, Isolated, LimitSurface};
pub use patch::{FirstOrder, LimitPoint, Real};
pub use sampled::Sample;
pub use uniform::{Refined, refine};
