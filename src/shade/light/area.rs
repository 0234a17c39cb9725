//! Lights that are surfaces: what they radiate, and how rays meet them.

use std::f32::consts::PI;

use super::picture::Picture;
use super::planar::Planar;
use super::round::{Ellipsoid, Tube};
use super::shaping::Shaping;
use super::{luminance, usable};
use crate::accel::{Hit, Intersector};
use crate::math::{Bounds3, DAffine3, Ray, Vec2, Vec3};
use crate::scene::{self, LightKind};

/// A direction towards a light.
pub(super) struct Sampled {
    pub(super) wi: Vec3,
    pub(super) distance: f32,
    /// Per solid angle.
    pub(super) pdf: f32,
    pub(super) uv: Vec2,
}

/// Where a ray meets a light.
pub(super) struct Met {
    pub(super) t: f32,
    pub(super) uv: Vec2,
    /// Unit, to the side that shines.
    pub(super) normal: Vec3,
}

/// The geometry of a light in the world.
#[derive(Debug, Clone, Copy)]
enum Form {
    Planar(Planar),
    Ellipsoid(Ellipsoid),
    Tube(Tube),
}

/// A light that is a surface.
#[derive(Debug, Clone)]
pub(super) struct AreaLight {
    form: Form,
    /// Without picture and shaping.
    radiance: Vec3,
    picture: Option<Picture>,
    shaping: Option<Shaping>,
    /// Index into the description's lights.
    pub(super) light: usize,
    /// The probability that it is chosen.
    pub(super) pick: f32,
}

impl AreaLight {
    /// `None` if the light has no area, or is none of this sort.
    pub(super) fn new(light: usize, from: &scene::Light, picture: Option<Picture>) -> Option<Self> {
        let world = &from.world_from_light;
        let form = form(&from.kind, world)?;
        let area = form.area();
        if !(area > 0.0 && area.is_finite()) {
            return None;
        }
        let radiance = usable(if from.normalize {
            from.color / area
        } else {
            from.color
        });
        let axis = -world.matrix3.z_axis.normalize().as_vec3();
        Some(Self {
            form,
            radiance,
            picture,
            shaping: from.shaping.as_ref().map(|s| Shaping::new(s, axis)),
            light,
            pick: 0.0,
        })
    }

    fn rectangle(&self) -> Option<&Planar> {
        match &self.form {
            Form::Planar(planar) if !planar.is_round() => Some(planar),
            _ => None,
        }
    }

    /// Roughly its power, as luminance.
    pub(super) fn power(&self) -> f32 {
        let picture = self.picture.as_ref().map_or(Vec3::ONE, Picture::mean);
        let left = self.shaping.as_ref().map_or(1.0, Shaping::left);
        luminance(self.radiance * picture) * self.form.area() * PI * left
    }

    /// A direction from `p` and the radiance from there; the light is not chosen yet.
    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<(Sampled, Vec3)> {
        let sampled = match &self.form {
            Form::Planar(f) => f.sample(p, u),
            Form::Ellipsoid(f) => f.sample(p, u),
            Form::Tube(f) => f.sample(p, u),
        }?;
        let radiance = self.radiance(sampled.uv, sampled.wi);
        Some((sampled, radiance))
    }

    /// The density with which [`sample`](Self::sample) finds `wi` from `p`.
    pub(super) fn pdf(&self, p: Vec3, uv: Vec2, wi: Vec3) -> f32 {
        match &self.form {
            Form::Planar(f) => f.pdf(p, wi),
            Form::Ellipsoid(f) => f.pdf(p, wi),
            Form::Tube(f) => f.pdf(p, uv),
        }
    }

    /// The radiance that comes from the front at `uv` to someone who looks along `wi`.
    pub(super) fn radiance(&self, uv: Vec2, wi: Vec3) -> Vec3 {
        let mut radiance = self.radiance;
        if let Some(picture) = &self.picture {
            // Seen from the front, X points left.
            radiance *= picture.eval(Vec2::new(1.0 - uv.x, uv.y));
        }
        if let Some(shaping) = &self.shaping {
            radiance *= shaping.factor(-wi);
        }
        radiance
    }
}

impl Form {
    fn area(&self) -> f32 {
        match self {
            Self::Planar(f) => f.area(),
            Self::Ellipsoid(f) => f.area(),
            Self::Tube(f) => f.area(),
        }
    }

    fn bounds(&self) -> Bounds3 {
        match self {
            Self::Planar(f) => f.bounds(),
            Self::Ellipsoid(f) => f.bounds(),
            Self::Tube(f) => f.bounds(),
        }
    }
}

fn form(kind: &LightKind, world: &DAffine3) -> Option<Form> {
    let real = |x: f32| (x > 0.0 && x.is_finite()).then_some(f64::from(x));
    Some(match *kind {
        LightKind::Rect { width, height } => {
            let half = [0.5 * real(width)?, 0.5 * real(height)?];
            Form::Planar(Planar::new(false, half, world))
        }
        LightKind::Disk { radius } => Form::Planar(Planar::new(true, [real(radius)?; 2], world)),
        LightKind::Sphere { radius } => Form::Ellipsoid(Ellipsoid::new(real(radius)?, world)),
        LightKind::Cylinder { radius, length } => {
            Form::Tube(Tube::new(real(radius)?, real(length)?, world))
        }
        LightKind::Distant { .. } | LightKind::Dome => return None,
    })
}

/// The area lights as things that rays can meet. Rectangles are triangles, which a tree of triangles meets sooner than
/// a callback; the others are an [`Intersector`] whose hits name the area light as their face. Both sides of a flat
/// light, and the inside of a round one, are met too: they are black.
#[derive(Debug, Clone)]
pub struct LightShapes {
    pub(super) lights: Vec<AreaLight>,
    /// Which of them are rectangles, and which are not.
    rectangles: Vec<u32>,
    others: Vec<u32>,
}

impl LightShapes {
    pub(super) fn new(lights: Vec<AreaLight>) -> Self {
        let (rectangles, others) =
            (0..lights.len() as u32).partition(|&i| lights[i as usize].rectangle().is_some());
        Self {
            lights,
            rectangles,
            others,
        }
    }

    /// Two triangles for each rectangle, and their points in the world. Embree's limits on their count apply.
    pub fn triangles(&self) -> (Vec<[u32; 3]>, Vec<Vec3>) {
        let corners: Vec<Vec3> = (self.rectangles.iter())
            .filter_map(|&light| self.lights[light as usize].rectangle())
            .flat_map(Planar::corners)
            .collect();
        let triangles = (0..corners.len() as u32)
            .step_by(4)
            .flat_map(|c| [[c, c + 1, c + 2], [c, c + 2, c + 3]])
            .collect();
        (triangles, corners)
    }

    /// The hit on an area light where a ray met triangle `triangle` of [`triangles`](Self::triangles) at its
    /// barycentric `uv`.
    pub fn on_triangle(&self, triangle: u32, t: f32, uv: Vec2) -> Hit {
        let light = self.rectangles[triangle as usize / 2];
        let normal = self.lights[light as usize].rectangle().map(Planar::front);
        Hit {
            t,
            face: light,
            uv: if triangle.is_multiple_of(2) {
                Vec2::new(uv.x + uv.y, uv.y)
            } else {
                Vec2::new(uv.x, uv.x + uv.y)
            }
            .min(Vec2::ONE),
            normal: normal.unwrap_or(Vec3::ZERO),
            error: 0.0,
        }
    }
}

impl Intersector for LightShapes {
    fn primitives(&self) -> u32 {
        self.others.len() as u32
    }

    fn bounds(&self, p: u32, _key: u32) -> Bounds3 {
        let b = self.lights[self.others[p as usize] as usize].form.bounds();
        // Outward by some ulps of the position and of the size, which also keeps a flat light's box from being flat.
        let size = b.min.abs().max(b.max.abs()).max_element();
        let pad = Vec3::splat(2e-6 * size.max(b.extent().max_element()));
        Bounds3 {
            min: b.min - pad,
            max: b.max + pad,
        }
    }

    fn intersect(&self, p: u32, ray: &Ray) -> Option<Hit> {
        let light = self.others[p as usize];
        let met = match &self.lights[light as usize].form {
            Form::Planar(f) => f.intersect(ray),
            Form::Ellipsoid(f) => f.intersect(ray),
            Form::Tube(f) => f.intersect(ray),
        }?;
        let reach = ray.origin.abs().max(ray.at(met.t).abs()).max_element();
        Some(Hit {
            t: met.t,
            face: light,
            uv: met.uv,
            normal: met.normal,
            error: 1e-6 * reach,
        })
    }

    fn memory(&self) -> usize {
        self.lights.capacity() * size_of::<AreaLight>()
            + (self.rectangles.capacity() + self.others.capacity()) * size_of::<u32>()
    }
}
