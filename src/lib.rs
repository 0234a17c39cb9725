//! relievo: a production renderer for subdivision surfaces, Ptex and deep displacement, on Embree and OpenImageIO.
//!
//! A picture's way through the crate, one module a stage: [`scene`] reads a file into a plain
//! [`scene::Description`]; [`mesh`] is the control mesh or NURBS patch in it; [`subdiv`] and [`nurbs`] know the limit
//! surfaces that these stand for; [`surface`] displaces limit surfaces, bounds and dices them; [`accel`] holds ways of
//! our own to meet rays with them; [`trace`] hands surfaces to Embree, where an [`accel::Intersector`] may stand for
//! one; [`shade`] knows camera, lights and materials; [`integrate`]
//! computes the radiance along a ray; [`film`] gathers samples into pixels; [`image`] reads textures and
//! writes pictures; [`store`] keeps what is slow to build in files; [`memory`] is what all of it may take; [`render`] runs these stages in this order. [`compare`] sets ways of tracing against each other,
//! [`convert`] turns images into Ptex files and back, [`atlas`] gives cages the texture coordinates that they lack, [`bake`]
//! finds the displacement that makes a dense mesh of a cage.
#![deny(unsafe_code)]

pub mod accel;
pub mod atlas;
pub mod bake;
pub mod compare;
pub mod convert;
pub mod error;
pub mod film;
pub mod image;
pub mod integrate;
pub mod math;
pub mod memory;
pub mod mesh;
pub mod nurbs;
pub mod render;
pub mod scene;
pub mod shade;
pub mod stats;
pub mod store;
pub mod subdiv;
pub mod surface;
pub mod trace;
pub mod world;

pub use error::{Error, Result};
