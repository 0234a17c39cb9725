//! Embree behind a safe face: devices, geometries, scenes, and single rays through them.
//!
//! This module and the `-sys` crates hold all unsafe code. It knows control meshes,
//! [`Diced`](crate::surface::Diced) surfaces and the [`Intersector`](crate::accel::Intersector) trait; materials, lights
//! and files it does not know.
//!
//! A [`Device`] makes [`Geometry`]s, a [`SceneBuilder`] takes them and commits to a [`Scene`], which then
//! answers rays from any number of threads.

mod control;
mod device;
mod diced;
mod filter;
mod geometry;
mod panics;
mod scene;
mod subdivision;
#[cfg(test)]
mod tests;
mod user_geometry;

pub(crate) use control::check_limits;
pub use device::{Device, DeviceOptions};
pub use diced::{diced_grid_uv, diced_triangle_uv};
pub use filter::Filter;
pub use geometry::{Geometry, Grid, SurfacePoint};
pub(crate) use panics::caught;
pub use scene::{Scene, SceneBuilder, SceneHit, SceneOptions};
pub use subdivision::{
    Displacement, DisplacementPoint, Rates, SubdivisionOptions, face_uv, sub_face_of,
};
