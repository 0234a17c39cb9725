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

/// How much of the picture's width or height the scene fills, the longer of the two.
const FILLED: f64 = 0.9;

/// Points that are looked at one by one; scenes of more are framed by the boxes of their meshes.
const MOST_POINTS: usize = 1 << 22;

/// A camera a little above and to the side, as one would look at a thing on a table.
///
/// It stands where the control points just fit into the picture: a surface lies within the hull of its points.
fn around(description: &Description) -> Result<Camera> {
    let mut points = Vec::new();
    for placement in &description.placements {
        let mesh = &description.shapes[placement.shape].mesh;
        for key in &placement.world_from_object {
            let world = |p: Vec3| key.transform_point3(p.as_dvec3());
            if points.len() + mesh.face_vertex_indices.len() * mesh.points.len() <= MOST_POINTS {
                points.extend(mesh.used_points().map(world));
            } else {
                let Bounds3 { min, max } = Bounds3::of(mesh.used_points());
                let corners = [min.x, max.x].into_iter().flat_map(|x| {
                    let sides = [
                        (min.y, min.z),
                        (min.y, max.z),
                        (max.y, min.z),
                        (max.y, max.z),
                    ];
                    sides.map(|(y, z)| Vec3::new(x, y, z))
                });
                points.extend(corners.map(world));
            }
        }
    }
    if points.is_empty() {
        let left_out = description.warnings.iter().next().is_some();
        let fault = Fault::new("there is nothing to see: no mesh that is shown, and no camera").advise(
            if left_out {
                "the warnings say what is not drawn; export it as meshes"
            } else {
                "is it a layer of materials, classes or overs, which another file brings in? or are its meshes hidden, or of another --purpose?"
            },
        );
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
    // A 50 mm lens on 36 x 24 mm film.
    let (focal_length, aperture) = (50.0, Vec2::new(36.0, 24.0));
    let z = view;
    let x = up.cross(z).normalize();
    let y = z.cross(x);
    // Along an axis a point at (a, z) is in the picture of slope s where |a - c| <= s (d - z), with the camera at c
    // and d: of all points, the two that ask most for d on either side decide.
    let fit = |axis: DVec3, slope: f64| {
        let most = |side: f64| {
            let asks = points.iter().map(|p| p.dot(z) + side * p.dot(axis) / slope);
            asks.fold(f64::NEG_INFINITY, f64::max)
        };
        let (right, left) = (most(1.0), most(-1.0));
        (0.5 * slope * (right - left), 0.5 * (right + left))
    };
    let slope = |side: f32| FILLED * 0.5 * f64::from(side) / focal_length;
    let (across, far) = fit(x, slope(aperture.x));
    let (upwards, farther) = fit(y, slope(aperture.y));
    let along = || points.iter().map(|p| p.dot(z));
    let nearest = along().fold(f64::NEG_INFINITY, f64::max);
    let depth = nearest - along().fold(f64::INFINITY, f64::min);
    // What has no size across, a needle seen along its axis, is still stood off from.
    let free = (far.max(farther) - nearest).max(0.1 * depth).max(1e-6);
    let eye = across * x + upwards * y + (nearest + free) * z;
    let world_from_camera = DAffine3::from_mat3_translation(glam::DMat3::from_cols(x, y, z), eye);
    Ok(Camera {
        path: "framed".into(),
        world_from_camera: vec![world_from_camera],
        projection: Projection::Perspective,
        focal_length: focal_length as f32,
        aperture,
        aperture_offset: Vec2::ZERO,
        clipping_range: Vec2::new((1e-4 * free) as f32, f32::INFINITY),
        f_stop: 0.0,
        focus_distance: 0.0,
        shutter: [0.0, 0.0],
        exposure: 0.0,
    })
}
