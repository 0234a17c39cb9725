//! What a picture of a scene will take, told by `relievo info` before anything is built.

use super::{DEFAULT_RESOLUTION, framing};
use crate::error::Result;
use crate::film::Film;
use crate::memory::Budget;
use crate::scene::{AspectRatioConform, Description};
use crate::shade::camera::{Camera, CameraOptions};
use crate::world::{BuildOptions, Foreseen, foresee};

/// Bytes and counts: see [`Method::need`](crate::world::Method::need) for how good they are.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// The picture's size that it holds for.
    pub resolution: [u32; 2],
    /// Surfaces.
    pub foreseen: Foreseen,
    /// Control meshes with their primvars: exact.
    pub control_meshes: u64,
    /// The picture while it is rendered: exact.
    pub film: u64,
}

/// Estimates what rendering takes by the camera of this name, or that the scene names first.
///
/// # Errors
/// Where there is nothing to see, or no such camera; and as for [`foresee`].
pub fn estimate(
    description: &Description,
    (name, resolution): (Option<&str>, [u32; 2]),
    options: &BuildOptions,
    budget: &Budget,
) -> Result<Estimate> {
    let camera = camera_named(description, name, resolution)?;
    let film = Film::bytes(resolution);
    let options = BuildOptions {
        held_beside: film,
        ..options.clone()
    };
    let meshes = description
        .shapes
        .iter()
        .map(|s| s.geometry.memory() as u64);
    Ok(Estimate {
        resolution,
        foreseen: foresee(description, &camera, &options, budget)?,
        control_meshes: meshes.sum(),
        film: film as u64,
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
/// Where there is nothing to see, or the scene's settings name a camera that does not exist.
pub fn camera(description: &Description, resolution: [u32; 2]) -> Result<Camera> {
    camera_named(description, None, resolution)
}

fn camera_named(
    description: &Description,
    name: Option<&str>,
    resolution: [u32; 2],
) -> Result<Camera> {
    let (camera, _) = framing::camera(description, name)?;
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
