//! UsdUVTexture and its twin for Ptex: where a texture lies on a surface and which of its numbers count.

use std::f32::consts::PI;
use std::sync::Arc;

use crate::math::{Affine2, Area, Vec2, Vec3, Vec4};
use crate::scene::{self, Channels, Transform2d};

/// Something that has a colour at every texture coordinate.
pub trait Lookup: Send + Sync {
    /// The four channels, linear, of an area around `st`; t = 0 is the bottom row. Never less than a texel.
    fn eval(&self, st: Vec2, area: &Area) -> Vec4;
}

/// Something that has a colour at every point of every face.
pub trait FaceLookup: Send + Sync {
    /// The four channels, linear, of an area around a point of a Ptex face. Never less than a texel.
    fn eval(&self, face: u32, uv: Vec2, area: &Area) -> Vec4;
}

/// What a scene's materials look things up in.
#[derive(Clone, Default)]
pub struct Lookups {
    /// The scene's textures, in its order.
    pub images: Vec<Arc<dyn Lookup>>,
    /// The scene's Ptex files, in its order.
    pub ptex: Vec<Arc<dyn FaceLookup>>,
    /// The same, as displacement reads them: consistently, and not decoded.
    pub heights: Vec<Arc<dyn FaceLookup>>,
}

/// A primvar that a material reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Read {
    /// Its name.
    pub name: String,
    /// How many of its components, the first ones.
    pub width: usize,
}

/// What a material reads, at one point of a surface.
pub trait Primvars {
    /// Fills `out`, as long as the width that is read, with the primvar that stands at `read` in the material's
    /// [`reads`](super::material::Material::reads). False, with `out` as it was, if there is none of that name or if
    /// it has fewer components.
    fn get(&self, read: usize, out: &mut [f32]) -> bool;

    /// As [`get`](Self::get) with two numbers: texture coordinates, and what a lookup there is to cover.
    fn coordinates(&self, read: usize) -> Option<(Vec2, Area)> {
        let mut st = [0.0; 2];
        self.get(read, &mut st).then(|| (st.into(), Area::POINT))
    }

    /// The Ptex face, and the point on it; none if the surface has no such faces.
    fn ptex(&self) -> Option<(u32, Vec2)> {
        None
    }

    /// What a lookup is to cover around the point of the Ptex face.
    fn ptex_area(&self) -> Area {
        Area::POINT
    }
}

/// The number of a primvar among the reads, which it joins if it is new.
pub(super) fn number(reads: &mut Vec<Read>, name: &str, width: usize) -> usize {
    let is_same = |read: &Read| read.name == name && read.width == width;
    reads.iter().position(is_same).unwrap_or_else(|| {
        reads.push(Read {
            name: name.to_owned(),
            width,
        });
        reads.len() - 1
    })
}

/// Texture coordinates moved as UsdTransform2d says: scale, rotate, translate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StTransform {
    x: Vec2,
    y: Vec2,
    translation: Vec2,
}

impl StTransform {
    /// From its parts.
    pub fn new(transform: &Transform2d) -> Self {
        let (sin, cos) = (transform.rotation * PI / 180.0).sin_cos();
        Self {
            x: transform.scale.x * Vec2::new(cos, sin),
            y: transform.scale.y * Vec2::new(-sin, cos),
            translation: transform.translation,
        }
    }

    /// The same as a matrix.
    pub fn affine(&self) -> Affine2 {
        Affine2::from_cols(self.x, self.y, self.translation)
    }

    /// Where `st` goes.
    #[inline]
    pub fn apply(&self, st: Vec2) -> Vec2 {
        st.x * self.x + st.y * self.y + self.translation
    }

    /// What an area around any point becomes.
    #[inline]
    pub fn apply_to_area(&self, area: &Area) -> Area {
        area.mapped([self.x, self.y])
    }
}

/// A texture on a surface: what several [`Output`]s may share.
#[derive(Clone)]
pub(super) enum Placed {
    /// By texture coordinates.
    Image {
        /// Missing: outputs take their fallback.
        image: Option<Arc<dyn Lookup>>,
        /// Of the texture coordinates, among the material's reads.
        read: usize,
        transform: StTransform,
        texture: usize,
    },
    /// By face.
    Ptex {
        /// Missing: outputs take their fallback.
        lookup: Option<Arc<dyn FaceLookup>>,
        file: usize,
        is_height: bool,
    },
}

impl Placed {
    pub(super) fn image(map: &scene::TextureMap, lookups: &Lookups, reads: &mut Vec<Read>) -> Self {
        Self::Image {
            image: lookups.images.get(map.texture).cloned(),
            read: number(reads, &map.primvar, 2),
            transform: StTransform::new(&map.transform),
            texture: map.texture,
        }
    }

    /// `is_height` says that it moves the surface.
    pub(super) fn ptex(map: &scene::PtexMap, lookups: &Lookups, is_height: bool) -> Self {
        let lookups = if is_height {
            &lookups.heights
        } else {
            &lookups.ptex
        };
        Self::Ptex {
            lookup: lookups.get(map.file).cloned(),
            file: map.file,
            is_height,
        }
    }

    /// Whether it gives the same texels everywhere.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (
                Self::Image {
                    read,
                    transform,
                    texture,
                    ..
                },
                Self::Image {
                    read: other_read,
                    transform: other_transform,
                    texture: other_texture,
                    ..
                },
            ) => (read, transform, texture) == (other_read, other_transform, other_texture),
            (
                Self::Ptex {
                    file, is_height, ..
                },
                Self::Ptex {
                    file: other_file,
                    is_height: other_is_height,
                    ..
                },
            ) => (file, is_height) == (other_file, other_is_height),
            _ => false,
        }
    }

    /// What it reads, if it has an image.
    pub(super) fn read(&self) -> Option<usize> {
        match self {
            Self::Image { image, read, .. } => image.is_some().then_some(*read),
            Self::Ptex { .. } => None,
        }
    }

    /// The texel; `None` without image or texture coordinates, or without faces. `sharp` covers no more than a texel.
    pub(super) fn eval(&self, primvars: &dyn Primvars, sharp: bool) -> Option<Vec4> {
        match self {
            Self::Image {
                image,
                read,
                transform,
                ..
            } => {
                let image = image.as_deref()?;
                if sharp {
                    let mut st = [0.0; 2];
                    let known = primvars.get(*read, &mut st);
                    return known.then(|| image.eval(transform.apply(st.into()), &Area::POINT));
                }
                let (st, area) = primvars.coordinates(*read)?;
                Some(image.eval(transform.apply(st), &transform.apply_to_area(&area)))
            }
            Self::Ptex { lookup, .. } => {
                let (face, uv) = primvars.ptex()?;
                let area = if sharp {
                    Area::POINT
                } else {
                    primvars.ptex_area()
                };
                Some(lookup.as_deref()?.eval(face, uv, &area))
            }
        }
    }
}

/// What an input takes of a texel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Output {
    channels: Channels,
    scale: Vec4,
    bias: Vec4,
    fallback: Vec4,
}

impl Output {
    pub(super) fn image(map: &scene::TextureMap) -> Self {
        Self {
            channels: map.channels,
            scale: map.scale,
            bias: map.bias,
            fallback: map.fallback,
        }
    }

    pub(super) fn ptex(map: &scene::PtexMap) -> Self {
        Self {
            channels: map.channels,
            scale: map.scale,
            bias: map.bias,
            fallback: map.fallback,
        }
    }

    /// Three numbers, equal ones for a single channel. Scale and bias do not apply to the fallback.
    #[inline]
    pub(super) fn of(&self, texel: Option<Vec4>) -> Vec3 {
        let v = texel.map_or(self.fallback, |texel| texel * self.scale + self.bias);
        match self.channels {
            Channels::Rgb => v.truncate(),
            Channels::R => Vec3::splat(v.x),
            Channels::G => Vec3::splat(v.y),
            Channels::B => Vec3::splat(v.z),
            Channels::A => Vec3::splat(v.w),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_then_rotation_then_translation() {
        let transform = StTransform::new(&Transform2d {
            scale: Vec2::new(2.0, 3.0),
            rotation: 90.0,
            translation: Vec2::new(10.0, 20.0),
        });
        // (1, 1) -> (2, 3) -> counterclockwise (-3, 2) -> (7, 22).
        let moved = transform.apply(Vec2::ONE);
        assert!((moved - Vec2::new(7.0, 22.0)).length() < 1e-5, "{moved}");
    }
}
