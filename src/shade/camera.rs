//! Rays into the scene, as UsdGeomCamera means them.
//!
//! The camera looks along its own -Z with +Y up. Focal length and aperture are tenths of a scene unit. The
//! film is measured in pixels: (0, 0) is the upper left corner of the upper left pixel, y grows downward.
//!
//! Between two motion keys, position is interpolated linearly, rotation along the great arc, and what is left
//! (scale and shear) linearly: a camera on a turning crane stays rigid, which it would not if its matrices
//! were mixed.

mod view;

use crate::error::{Fault, Result};
use crate::math::{Cone, DAffine3, DMat4, DVec3, Ray, Vec2, Vec3, concentric_disk};
use crate::scene::{self, AspectRatioConform, Projection};

use glam::{DMat3, DQuat};

/// Focal length and aperture are counted in tenths of a scene unit.
const TENTH: f64 = 0.1;

/// What a picture asks of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraOptions {
    /// Width and height of the whole picture, pixels.
    pub resolution: [u32; 2],
    /// How the aperture is made to fit the picture.
    pub conform: AspectRatioConform,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
    /// Whether things out of focus are blurred at all.
    pub depth_of_field: bool,
}

/// A camera that makes rays.
#[derive(Debug, Clone)]
pub struct Camera {
    projection: Projection,
    resolution: [u32; 2],
    pixel_aspect: f32,
    motion: Motion,
    /// Lower left and upper right of the film: scene units (orthographic), or at depth 1 (perspective).
    window: [Vec2; 2],
    /// From a pixel's left to its right and from its top to its bottom, likewise.
    per_pixel: Vec2,
    near: f32,
    far: f32,
    /// Radius in scene units, and the depth that is sharp.
    lens: Option<(f32, f32)>,
    /// When the frame itself is, from shutter open (0) to close (1).
    frame_time: f32,
    exposure: f32,
}

impl Camera {
    /// Prepares `camera` for a picture.
    ///
    /// # Errors
    ///
    /// A fault that names the prim, if a length is not a finite number above 0, if the clipping range is
    /// empty, or if a transform is missing, singular or not finite.
    pub fn new(camera: &scene::Camera, options: CameraOptions) -> Result<Self> {
        check(camera, &options).map_err(|fault| fault.at_prim(&camera.path))?;
        let motion =
            Motion::new(&camera.world_from_camera).map_err(|fault| fault.at_prim(&camera.path))?;
        let (aperture, pixel_aspect) = conformed(camera.aperture, &options);
        let scale = match camera.projection {
            Projection::Perspective => 1.0 / camera.focal_length,
            Projection::Orthographic => TENTH as f32,
        };
        let window = [-0.5, 0.5].map(|side| scale * (camera.aperture_offset + side * aperture));
        let blurs = options.depth_of_field
            && camera.projection == Projection::Perspective
            && camera.f_stop > 0.0
            && camera.focus_distance > 0.0;
        let [open, close] = camera.shutter;
        let frame_time = if close > open {
            (-open / (close - open)).clamp(0.0, 1.0) as f32
        } else {
            0.0
        };
        Ok(Self {
            projection: camera.projection,
            resolution: options.resolution,
            pixel_aspect,
            motion,
            window,
            per_pixel: {
                let [width, height] = options.resolution.map(|n| n as f32);
                (window[1] - window[0]) / Vec2::new(width, -height)
            },
            near: camera.clipping_range.x,
            far: camera.clipping_range.y,
            lens: blurs.then(|| {
                let radius = TENTH as f32 * camera.focal_length / (2.0 * camera.f_stop);
                (radius, camera.focus_distance)
            }),
            frame_time,
            exposure: camera.exposure.exp2(),
        })
    }

    /// The ray through the point `film` (pixels, y down), through the point of the lens that `lens` in 0..1
    /// stands for, at `time` in 0..1. Its direction is unit, in world space. The clipping range is a range
    /// of *depth*, along the camera's -Z: `t_min` and `t_max` exceed it by the slant of the ray.
    #[inline]
    pub fn ray(&self, film: Vec2, lens: [f32; 2], time: f32) -> Ray {
        let on_film = self.on_film(film);
        // In camera space with a direction of depth 1, so that t is the depth.
        let (origin, direction, near, far) = match self.projection {
            Projection::Perspective => {
                let (origin, slope) = match self.lens {
                    None => (Vec2::ZERO, on_film),
                    Some((radius, focus)) => {
                        let at = radius * concentric_disk(lens);
                        (at, on_film - at / focus)
                    }
                };
                (
                    origin.extend(0.0),
                    slope.extend(-1.0),
                    self.near.max(0.0),
                    self.far,
                )
            }
            // In parallel the range may begin behind the camera.
            Projection::Orthographic => {
                let start = self.near.min(0.0);
                (
                    on_film.extend(-start),
                    Vec3::NEG_Z,
                    self.near - start,
                    self.far - start,
                )
            }
        };
        let world_from_camera = self.motion.at(time);
        let origin = world_from_camera.transform_point3(origin.as_dvec3());
        let direction = world_from_camera.transform_vector3(direction.as_dvec3());
        let length = direction.length();
        Ray {
            origin: origin.as_vec3(),
            direction: (direction * length.recip()).as_vec3(),
            t_min: near * length as f32,
            t_max: far * length as f32,
            time,
        }
    }

    /// How wide the ray through the point `film` is if it stands for a whole pixel: as the side of a square of the
    /// pixel's solid angle (perspective) or size (orthographic). The lens adds nothing: of what is out of focus, each of
    /// its points sees a picture that is as sharp as any.
    #[inline]
    pub fn cone(&self, film: Vec2) -> Cone {
        let side = (self.per_pixel.x * self.per_pixel.y).abs().sqrt();
        match self.projection {
            Projection::Perspective => {
                // The solid angle goes with the third power of the cosine to the axis.
                let slant = self.on_film(film).length_squared() + 1.0;
                Cone {
                    width: 0.0,
                    spread: side / (slant * slant.sqrt()).sqrt(),
                }
            }
            Projection::Orthographic => {
                let scale = self.motion.at(self.frame_time).matrix3.determinant();
                Cone {
                    width: side * scale.abs().cbrt() as f32,
                    spread: 0.0,
                }
            }
        }
    }

    fn on_film(&self, film: Vec2) -> Vec2 {
        let [low, high] = self.window;
        Vec2::new(low.x, high.y) + film * self.per_pixel
    }

    /// The camera's transform at `time` in 0..1.
    pub fn world_from_camera(&self, time: f32) -> DAffine3 {
        self.motion.at(time)
    }

    /// Its inverse.
    pub fn camera_from_world(&self, time: f32) -> DAffine3 {
        self.motion.at(time).inverse()
    }

    /// How far the world point `p` lies before the camera, along its -Z at `time`; scene units.
    pub fn depth(&self, p: Vec3, time: f32) -> f32 {
        let world_from_camera = self.motion.at(time);
        let forward = world_from_camera
            .transform_vector3(DVec3::NEG_Z)
            .normalize();
        forward.dot(p.as_dvec3() - world_from_camera.translation) as f32
    }

    /// OpenEXR's `worldToCamera` at the frame's own time (shutter open, if the shutter does not span it):
    /// row vectors, row after row; the camera's space is left-handed, +Z forward, as OpenEXR has it.
    pub fn world_to_camera(&self) -> [f32; 16] {
        self.exr_camera_from_world()
            .to_cols_array()
            .map(|x| x as f32)
    }

    /// OpenEXR's `worldToNDC` at the frame's own time: row vectors, row after row; (0, 0) is the upper left
    /// and (1, 1) the lower right corner of the picture; z is of no meaning but grows with the depth.
    pub fn world_to_ndc(&self) -> [f32; 16] {
        let [low, high] = self.window.map(|p| p.as_dvec2());
        let size = high - low;
        // x, y: (p - low) / size, y downward. Columns of a matrix for column vectors.
        let columns = match self.projection {
            // Divided by the depth z.
            Projection::Perspective => [
                [1.0 / size.x, 0.0, 0.0, 0.0],
                [0.0, -1.0 / size.y, 0.0, 0.0],
                [-low.x / size.x, high.y / size.y, 1.0, 1.0],
                [0.0, 0.0, -f64::from(self.near.max(0.0)), 0.0],
            ],
            Projection::Orthographic => [
                [1.0 / size.x, 0.0, 0.0, 0.0],
                [0.0, -1.0 / size.y, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [-low.x / size.x, high.y / size.y, 0.0, 1.0],
            ],
        };
        let ndc_from_camera = DMat4::from_cols_array_2d(&columns);
        (ndc_from_camera * self.exr_camera_from_world())
            .to_cols_array()
            .map(|x| x as f32)
    }

    // A matrix for column vectors, stored column after column, is its transpose for row vectors, stored row
    // after row.
    fn exr_camera_from_world(&self) -> DMat4 {
        DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0))
            * DMat4::from(self.camera_from_world(self.frame_time))
    }

    /// What radiance is multiplied by: 2 to the camera's exposure.
    pub fn exposure(&self) -> f32 {
        self.exposure
    }

    /// Width over height of a pixel, after conforming.
    pub fn pixel_aspect(&self) -> f32 {
        self.pixel_aspect
    }

    /// Width and height of the picture, pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// Whether it moves while the shutter is open.
    pub fn moves(&self) -> bool {
        matches!(self.motion, Motion::Keys(_))
    }

    /// Height and width that a pixel covers: at depth 1 (perspective) or anywhere (orthographic), before the
    /// camera's own scale. The larger one.
    pub fn pixel_footprint(&self) -> f32 {
        let size = self.window[1] - self.window[0];
        (size.x / self.resolution[0] as f32).max(size.y / self.resolution[1] as f32)
    }

    /// Where it is at the frame itself, world space.
    pub fn position(&self) -> Vec3 {
        self.world_from_camera(self.frame_time)
            .translation
            .as_vec3()
    }

    /// Pixels that a scene unit at `p` covers at most, looked at squarely. Finite and above 0.
    pub fn pixels_per_unit(&self, p: Vec3) -> f32 {
        let from_camera = self.camera_from_world(self.frame_time);
        let p = from_camera.transform_point3(p.as_dvec3());
        let distance = match self.projection {
            Projection::Perspective => (p.length() as f32).max(self.near).max(1e-6),
            Projection::Orthographic => 1.0,
        };
        let camera_units = from_camera.matrix3.determinant().abs().cbrt() as f32;
        (camera_units / (self.pixel_footprint() * distance)).clamp(f32::MIN_POSITIVE, 1e18)
    }

    /// How it projects.
    pub fn projection(&self) -> Projection {
        self.projection
    }
}

fn check(camera: &scene::Camera, options: &CameraOptions) -> std::result::Result<(), Fault> {
    let above_zero = |name: &str, value: f32| {
        if value.is_finite() && value > 0.0 {
            Ok(())
        } else {
            Err(Fault::new(format!(
                "{name} is {value}: it must be a finite number above 0"
            )))
        }
    };
    let finite = |name: &str, value: f32| {
        if value.is_finite() {
            Ok(())
        } else {
            Err(Fault::new(format!("{name} is {value}: it must be finite")))
        }
    };
    if camera.projection == Projection::Perspective {
        above_zero("focalLength", camera.focal_length)?;
    }
    above_zero("horizontalAperture", camera.aperture.x)?;
    above_zero("verticalAperture", camera.aperture.y)?;
    above_zero("the pixel aspect ratio", options.pixel_aspect)?;
    finite("horizontalApertureOffset", camera.aperture_offset.x)?;
    finite("verticalApertureOffset", camera.aperture_offset.y)?;
    finite("fStop", camera.f_stop)?;
    finite("focusDistance", camera.focus_distance)?;
    finite("exposure", camera.exposure)?;
    let Vec2 { x: near, y: far } = camera.clipping_range;
    let floor = match camera.projection {
        Projection::Perspective => 0.0,
        Projection::Orthographic => f32::NEG_INFINITY,
    };
    if !(near.is_finite() && far > near.max(floor)) {
        return Err(
            Fault::new(format!("clippingRange ({near}, {far}) holds nothing"))
                .advise("near must be finite and less than far"),
        );
    }
    if options.resolution.contains(&0) {
        let [width, height] = options.resolution;
        return Err(Fault::new(format!(
            "a picture of {width} x {height} pixels"
        )));
    }
    Ok(())
}

/// The aperture that fits the picture, and the shape of its pixels.
fn conformed(aperture: Vec2, options: &CameraOptions) -> (Vec2, f32) {
    let [width, height] = options.resolution.map(|n| n as f32);
    let picture = width * options.pixel_aspect / height;
    let wider = Vec2::new(aperture.y * picture, aperture.y);
    let taller = Vec2::new(aperture.x, aperture.x / picture);
    // Where the film is wider than the picture, expanding means taller and cropping means narrower.
    let film_is_wide = aperture.x > aperture.y * picture;
    let fitted = match options.conform {
        AspectRatioConform::ExpandAperture if film_is_wide => taller,
        AspectRatioConform::ExpandAperture => wider,
        AspectRatioConform::CropAperture if film_is_wide => wider,
        AspectRatioConform::CropAperture => taller,
        AspectRatioConform::AdjustApertureWidth => wider,
        AspectRatioConform::AdjustApertureHeight => taller,
        AspectRatioConform::AdjustPixelAspectRatio => {
            return (aperture, aperture.x / aperture.y * height / width);
        }
    };
    (fitted, options.pixel_aspect)
}

#[derive(Debug, Clone)]
enum Motion {
    Still(DAffine3),
    Keys(Vec<Key>),
}

/// `translation * rotation * rest`; `rest` holds scale, shear and reflection.
#[derive(Debug, Clone, Copy)]
struct Key {
    translation: DVec3,
    rotation: DQuat,
    rest: DMat3,
}

impl Motion {
    fn new(keys: &[DAffine3]) -> std::result::Result<Self, Fault> {
        let Some(&first) = keys.first() else {
            return Err(Fault::new("the camera has no transform"));
        };
        for key in keys {
            let determinant = key.matrix3.determinant();
            if !key.is_finite() || !determinant.is_normal() {
                return Err(Fault::new(
                    "the camera's transform is singular or not finite",
                ));
            }
        }
        if keys.iter().all(|&key| key == first) {
            return Ok(Self::Still(first));
        }
        let mut decomposed: Vec<Key> = keys.iter().map(Key::new).collect();
        // A rotation has two quaternions: the nearer one to the key before.
        for i in 1..decomposed.len() {
            if decomposed[i].rotation.dot(decomposed[i - 1].rotation) < 0.0 {
                decomposed[i].rotation = -decomposed[i].rotation;
            }
        }
        Ok(Self::Keys(decomposed))
    }

    #[inline]
    fn at(&self, time: f32) -> DAffine3 {
        match self {
            Self::Still(transform) => *transform,
            Self::Keys(keys) => between(keys, time),
        }
    }
}

fn between(keys: &[Key], time: f32) -> DAffine3 {
    let at = f64::from(time.clamp(0.0, 1.0)) * (keys.len() - 1) as f64;
    let i = (at as usize).min(keys.len() - 2);
    let (a, b, t) = (&keys[i], &keys[i + 1], at - i as f64);
    DAffine3 {
        matrix3: DMat3::from_quat(a.rotation.slerp(b.rotation, t))
            * (a.rest * (1.0 - t) + b.rest * t),
        translation: a.translation.lerp(b.translation, t),
    }
}

impl Key {
    fn new(transform: &DAffine3) -> Self {
        // Gram and Schmidt, from the viewing axis on: the axis that a shear would turn last.
        let m = transform.matrix3;
        let z = m.z_axis.normalize();
        let y = (m.y_axis - z * z.dot(m.y_axis)).normalize();
        let x = y.cross(z);
        let rotation = DMat3::from_cols(x, y, z);
        Self {
            translation: transform.translation,
            rotation: DQuat::from_mat3(&rotation).normalize(),
            rest: rotation.transpose() * m,
        }
    }
}

#[cfg(test)]
#[path = "camera_tests.rs"]
mod tests;
