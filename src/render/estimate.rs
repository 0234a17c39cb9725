//! What a picture of a scene will take, told by `relievo info` before anything is built.

use super::{DEFAULT_RESOLUTION, framing};
use crate::error::Result;
use crate::film::Film;
use crate::scene::{AspectRatioConform, Description};
use crate::shade::camera::{Camera, CameraOptions};
use crate::world::{Dicing, micro_triangles};

/// Bytes that Embree holds for a micro-triangle as a part of a grid, tree included, as `--stats` shows them for
/// `scenes/creature`.
const BYTES_PER_MICRO_TRIANGLE: u64 = 22;

/// Bytes and counts; those of Embree are right to about a factor of two.
#[derive(Debug, Clone, Copy)]
pub struct Estimate {
    /// The picture's size that it holds for.
    pub resolution: [u32; 2],
    /// Triangles after dicing at the default rate.
    pub micro_triangles: u64,
    /// Embree's geometry and trees.
    pub embree: u64,
    /// Control meshes with their primvars: exact.
    pub control_meshes: u64,
    /// The picture while it is rendered: exact.
    pub film: u64,
}

/// Estimates what rendering takes, at the size that the scene asks for and by the camera that it names first.
///
/// # Errors
/// Where there is nothing to see, or the scene's settings name a camera that does not exist.
pub fn estimate(description: &Description) -> Result<Estimate> {
    let resolution = picture_size(description);
    let camera = camera(description, resolution)?;
    let micro_triangles = micro_triangles(description, &camera, &Dicing::default());
    let meshes = description
        .shapes
        .iter()
        .map(|s| s.geometry.memory() as u64);
    Ok(Estimate {
        resolution,
        micro_triangles,
        embree: micro_triangles * BYTES_PER_MICRO_TRIANGLE,
        control_meshes: meshes.sum(),
        film: Film::bytes(resolution) as u64,
    })
}

/// Columns and rows of pixels that the scene asks for, or the usual ones.
pub fn picture_size(description: &Description) -> [u32; 2] {
    description
        .settings
        .resolution
        .unwrap_or(DEFAULT_RESOLUTION)
}

/// The camera that the scene names first, or one that shows all of it.
///
/// # Errors
/// As for [`estimate`].
pub fn camera(description: &Description, resolution: [u32; 2]) -> Result<Camera> {
    let (camera, _) = framing::camera(description, None)?;
    Camera::new(
        &camera,
        CameraOptions {
            resolution,
            conform: AspectRatioConform::ExpandAperture,
            pixel_aspect: 1.0,
            depth_of_field: false,
        },
    )
}
