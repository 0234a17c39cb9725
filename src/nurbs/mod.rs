//! NURBS patches: the questions that `subdiv` answers for control meshes, answered for rational B-splines.
//!
//! A [`NurbsSurface`] is the patch as a function of its own parameters u and v. [`BezierFaces`] is the same surface
//! cut at its knots into rational Bezier pieces, each a face on the unit square that knows its neighbours; this
//! is what later stages work on. A [`Trim`] says which part of the parameter plane is kept. All
//! arithmetic is in f64. What comes in has passed [`crate::mesh::NurbsPatch::validate`].
//!
//! ```text
//!   corner 3 --- edge 2 --- corner 2
//!      |                       |        v
//!    edge 3      face        edge 1     ^
//!      |                       |        |
//!   corner 0 --- edge 0 --- corner 1    +--> u
//! ```

pub mod basis;
mod bezier;
mod surface;
mod trim;

#[cfg(test)]
pub(crate) mod tests;

pub use bezier::{BezierFaces, EdgeUse};
pub use surface::{NurbsSurface, SurfacePoint};
pub use trim::{Cover, Trim};
