//! Subdivision: from the control mesh towards the surface that it stands for.
//!
//! [`schemes`] holds one file a scheme, each with its masks as published. Geometry in, geometry out: nothing here
//! reads a file, knows Embree or fails; what comes in has passed [`crate::mesh::ControlMesh::validate`].

pub mod schemes;
