//! The camera of the scene, or one that shows all of it.

use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DAffine3, DVec3, Vec2, Vec3};
use crate::scene::{Camera, Description, Projection};

/// The camera by its path or last name, the settings' one, the first one; else one that frames the scene, and true.
pub(super) fn camera(description: &Description, asked: Option<&str>) -> Result<(Camera, bool)> {
    let named = |name: &str| {
        description
            .cameras
            .iter()
            .find(|c| c.path == name)
            .or_else(|| {
                description
                    .cameras
                    .iter()
                    .find(|c| c.path.rsplit('/').next() == Some(name))
            })
    };
    if let Some(name) = asked {
        return named(name)
            .map(|c| (c.clone(), false))
            .ok_or_else(|| missing(description, name));
    }
    let settings = description.settings.camera.as_deref();
    if let Some(name) = settings {
        return named(name)
            .map(|c| (c.clone(), false))
            .ok_or_else(|| missing(description, name));
    }
    match description.cameras.first() {
        Some(first) => Ok((first.clone(), false)),
        None => Ok((around(description)?, true)),
    }
}

fn missing(description: &Description, name: &str) -> Error {
    let there: Vec<&str> = description
        .cameras
        .iter()
        .map(|c| c.path.as_str())
        .collect();
    let fault = Fault::new(format!("there is no camera {name}"));
    let fault = match description.files.first() {
        Some(file) => fault.in_file(file),
        None => fault,
    };
    let help = if there.is_empty() {
        "the scene has no camera at all; without --camera it is framed whole".to_owned()
    } else {
        format!("the scene has {}", there.join(", "))
    };
    fault.advise(help).into()
}

/// A camera a little above and to the side, as one would look at a thing on a table.
fn around(description: &Description) -> Result<Camera> {
    let mut bounds = Bounds3::EMPTY;
    for placement in &description.placements {
        let corners = description.shapes[placement.shape].geometry.used_bounds();
        for key in &placement.world_from_object {
            bounds = bounds.union(corners.transformed(&glam::Affine3A::from_mat3_translation(
                key.matrix3.as_mat3(),
                key.translation.as_vec3(),
            )));
        }
    }
    if bounds.is_empty() {
        let fault = Fault::new("there is nothing to see: no mesh, and no camera");
        return Err(match description.files.first() {
            Some(file) => fault.in_file(file).into(),
            None => fault.into(),
        });
    }
    let up = if description.up == Vec3::Z {
        DVec3::Z
    } else {
        DVec3::Y
    };
    let front = if description.up == Vec3::Z {
        DVec3::NEG_Y
    } else {
        DVec3::Z
    };
    let side = up.cross(front);
    let view = (front + 0.55 * side + 0.4 * up).normalize();
    let radius = f64::from(0.5 * bounds.extent().length()).max(1e-6);
    // A 50 mm lens on 36 x 24 mm film; the sphere around everything touches the picture's border.
    let (focal_length, aperture) = (50.0, Vec2::new(36.0, 24.0));
    let distance = 1.02 * radius / (0.5 * f64::from(aperture.y) / focal_length).atan().sin();
    let target = bounds.centre().as_dvec3();
    let z = view;
    let x = up.cross(z).normalize();
    let y = z.cross(x);
    let world_from_camera =
        DAffine3::from_mat3_translation(glam::DMat3::from_cols(x, y, z), target + distance * view);
    Ok(Camera {
        path: "framed".into(),
        world_from_camera: vec![world_from_camera],
        projection: Projection::Perspective,
        focal_length: focal_length as f32,
        aperture,
        aperture_offset: Vec2::ZERO,
        clipping_range: Vec2::new((distance * 1e-4) as f32, f32::INFINITY),
        f_stop: 0.0,
        focus_distance: 0.0,
        shutter: [0.0, 0.0],
        exposure: 0.0,
    })
}
