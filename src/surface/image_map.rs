//! Displacement from an image.

use std::sync::Arc;

use super::base::{Texcoord, UvRect};
use super::displace::{DisplacementMap, DisplacementPoint, MapGrid, Region, Slope};
use super::pyramid::Pyramid;
use crate::image::{Texels, Texture};
use crate::math::{Affine2, Bounds3, Vec2, Vec3, Vec4};

/// Which channels of an image are displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// The first one.
    Scalar,
    /// One of the four that a look-up gives, counted from 0.
    Component(u8),
    /// The first three.
    Vector,
}

/// An image whose values displace, bilinearly filtered. Load it with colour space raw: 8-bit texels then count from 0
/// to 1.
#[derive(Debug, Clone)]
pub struct ImageMap {
    texture: Arc<Texture>,
    channels: Channels,
    /// None for alpha, which has no certain bounds.
    pyramid: Option<Arc<Pyramid>>,
    /// Where texture coordinates are looked up.
    moved: Affine2,
}

/// An image whose values are the first components of an [`ImageMap`]'s, by the texel.
#[derive(Debug, Clone)]
pub struct HeightImage {
    texture: Arc<Texture>,
    component: usize,
    pyramid: Option<Arc<Pyramid>>,
    moved: Affine2,
}

impl HeightImage {
    /// Its texels.
    pub fn texels(&self) -> Texels<'_> {
        let texels = self.texture.texels(self.component);
        texels.expect("only such images are made to be this")
    }

    /// Where texture coordinates are looked up.
    pub fn place(&self, st: Vec2) -> Vec2 {
        self.moved.transform_point2(st)
    }

    /// Whether it is the same image, looked up at the same places.
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.texture, &other.texture)
            && self.component == other.component
            && self.is_placed_like(other)
    }

    /// Whether it is looked up at the same places.
    pub fn is_placed_like(&self, other: &Self) -> bool {
        self.moved == other.moved
    }

    /// The least and the greatest value in a rectangle of [places](Self::place); the image's own if none is given.
    pub fn range(&self, places: Option<&UvRect>) -> [f32; 2] {
        let everywhere = UvRect {
            min: Vec2::splat(f32::NEG_INFINITY),
            max: Vec2::splat(f32::INFINITY),
        };
        let places = places.unwrap_or(&everywhere);
        match &self.pyramid {
            Some(pyramid) => {
                let range = pyramid.range(&self.texture, places);
                [range.min[self.component], range.max[self.component]]
            }
            None => [f32::MIN, f32::MAX],
        }
    }
}

impl ImageMap {
    /// Of a texture that materials may share.
    ///
    /// # Panics
    /// If a component is beyond the fourth.
    pub fn new(texture: Arc<Texture>, channels: Channels) -> Self {
        let count = match channels {
            Channels::Scalar => 1,
            Channels::Component(component) => usize::from(component) + 1,
            Channels::Vector => 3,
        };
        assert!(count <= 4, "a look-up gives four components");
        Self {
            pyramid: (count <= 3).then(|| Arc::new(Pyramid::new(&texture, count))),
            texture,
            channels,
            moved: Affine2::IDENTITY,
        }
    }

    /// The same image, with texture coordinates going through `moved` before they are looked up.
    #[must_use]
    pub fn moved(&self, moved: Affine2) -> Self {
        Self {
            moved,
            ..self.clone()
        }
    }

    /// What a look-up means.
    fn of(&self, value: Vec4) -> Vec3 {
        match self.channels {
            Channels::Scalar => Vec3::new(value.x, 0.0, 0.0),
            Channels::Component(component) => Vec3::new(value[usize::from(component)], 0.0, 0.0),
            Channels::Vector => value.truncate(),
        }
    }

    fn place(&self, st: Vec2) -> Vec2 {
        self.moved.transform_point2(st)
    }

    /// A rectangle around all places of a rectangle's texture coordinates.
    fn place_rect(&self, rect: &UvRect) -> UvRect {
        if self.moved == Affine2::IDENTITY {
            return *rect;
        }
        let corners = [
            rect.min,
            rect.max,
            Vec2::new(rect.min.x, rect.max.y),
            Vec2::new(rect.max.x, rect.min.y),
        ]
        .map(|st| self.place(st));
        // Two products and two sums, each rounded.
        let largest = rect.min.abs().max(rect.max.abs());
        let matrix = self.moved.matrix2.abs();
        let slack = 4.0 * f32::EPSILON * (matrix * largest + self.moved.translation.abs());
        let bound =
            |pick: fn(Vec2, Vec2) -> Vec2| corners[1..].iter().fold(corners[0], |a, &b| pick(a, b));
        UvRect {
            min: bound(Vec2::min) - slack,
            max: bound(Vec2::max) + slack,
        }
    }
}

impl DisplacementMap for ImageMap {
    fn value(&self, at: &DisplacementPoint) -> Vec3 {
        self.of(self.texture.eval(self.place(at.st)))
    }

    fn values(&self, grid: &MapGrid<'_>, out: &mut Vec<Vec3>) -> bool {
        let moved: Vec<Vec2>;
        let st = if self.moved == Affine2::IDENTITY {
            grid.st
        } else {
            moved = grid.st.iter().map(|&st| self.place(st)).collect();
            &moved
        };
        let scalar = |x: f32| Vec3::new(x, 0.0, 0.0);
        match self.channels {
            Channels::Scalar | Channels::Component(0) => {
                self.texture.look_up(st, out, |[x]| scalar(x));
            }
            Channels::Component(1) => self.texture.look_up(st, out, |[_, y]| scalar(y)),
            Channels::Component(2) => self.texture.look_up(st, out, |[_, _, z]| scalar(z)),
            Channels::Component(_) => {
                out.clear();
                out.extend(st.iter().map(|&st| self.of(self.texture.eval(st))));
            }
            Channels::Vector => {
                self.texture
                    .look_up(st, out, |xyz: [f32; 3]| Vec3::from(xyz));
            }
        }
        true
    }

    fn slope(&self, at: &DisplacementPoint, texcoord: &Texcoord) -> Option<Slope> {
        let [by_s, by_t] = self
            .texture
            .slope(self.place(at.st))
            .map(|slope| self.of(slope));
        let along = |d: Vec2| {
            let d = self.moved.transform_vector2(d);
            d.x * by_s + d.y * by_t
        };
        Some(Slope {
            du: along(texcoord.du),
            dv: along(texcoord.dv),
        })
    }

    fn bound(&self, region: &Region) -> Option<Bounds3> {
        let range = self
            .pyramid
            .as_ref()?
            .range(&self.texture, &self.place_rect(&region.st?));
        Some(match self.channels {
            Channels::Component(component) => {
                let axis = usize::from(component);
                Bounds3 {
                    min: Vec3::new(range.min[axis], 0.0, 0.0),
                    max: Vec3::new(range.max[axis], 0.0, 0.0),
                }
            }
            Channels::Scalar | Channels::Vector => range,
        })
    }

    fn image(&self) -> Option<HeightImage> {
        let component = match self.channels {
            Channels::Scalar | Channels::Vector => 0,
            Channels::Component(component) => component.into(),
        };
        self.pyramid.as_ref()?;
        self.texture.texels(component)?;
        Some(HeightImage {
            texture: self.texture.clone(),
            component,
            pyramid: self.pyramid.clone(),
            moved: self.moved,
        })
    }

    fn memory(&self) -> usize {
        self.pyramid.as_ref().map_or(0, |pyramid| pyramid.memory())
    }
}
