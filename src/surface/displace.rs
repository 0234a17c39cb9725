//! Displacement: by how much, in which direction, and where the values come from.
//!
//! A [`DisplacementMap`] gives values: an image ([`ImageMap`](super::ImageMap)), a [`Function`], a Ptex file. An
//! [`Amount`] scales them; a [`Displacement`] says what they mean. Of the values of a map, scalar displacement takes
//! the first component.

use std::fmt;
use std::sync::Arc;

use super::base::{Texcoord, UvRect};
use super::image_map::HeightImage;
use crate::math::{Bounds3, Vec2, Vec3};

/// How the points of a limit surface move.
#[derive(Debug, Clone, Default)]
pub enum Displacement {
    /// They stay.
    #[default]
    None,
    /// Along the unit limit normal, to the front where the amount is above 0.
    Scalar(Amount),
    /// By a vector.
    Vector(Amount, Space),
}

/// In which frame vectors are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// That of the surface's points.
    Object,
    /// x along the direction in which s grows, y across it to the side where t grows, z along the limit normal; all
    /// three of unit length. A surface without texture coordinates has u and v in their place.
    Tangent,
}

/// Values of a map, times `scale`, plus `bias` in each component; in units of the surface's points.
#[derive(Clone)]
pub struct Amount {
    /// Where the values come from.
    pub map: Arc<dyn DisplacementMap>,
    /// What they are multiplied by.
    pub scale: f32,
    /// What is added then: -0.5 times the scale, where the map's middle stands for no displacement.
    pub bias: f32,
}

impl Amount {
    pub(super) fn of(&self, value: Vec3) -> Vec3 {
        self.scale * value + self.bias
    }

    /// The interval of the amounts over a region, rounded outward, if the map is certain of one.
    pub(super) fn bound(&self, region: &Region) -> Option<Bounds3> {
        let values = self.map.bound(region)?;
        if values.is_empty() {
            return Some(values);
        }
        let (a, b) = (self.of(values.min), self.of(values.max));
        let largest = self.scale * values.min.abs().max(values.max.abs());
        let slack = 2.0 * f32::EPSILON * (largest.abs() + self.bias.abs());
        Some(Bounds3 {
            min: a.min(b) - slack,
            max: a.max(b) + slack,
        })
    }
}

impl fmt::Debug for Amount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Amount")
            .field("scale", &self.scale)
            .field("bias", &self.bias)
            .finish_non_exhaustive()
    }
}

/// A source of displacement values, asked by all threads at once; no lock is held meanwhile.
pub trait DisplacementMap: Send + Sync {
    /// The value at a point. Where it is not a finite number, the point stays and the surface counts it.
    fn value(&self, at: &DisplacementPoint) -> Vec3;

    /// The values at a whole grid of points, if they depend on no more than the grid names: quicker than one by one,
    /// and equal to that. False if there is no such way.
    fn values(&self, _grid: &MapGrid<'_>, _out: &mut Vec<Vec3>) -> bool {
        false
    }

    /// The derivatives of [`value`](Self::value) by the face's parameters; without them the surface takes differences.
    fn slope(&self, _at: &DisplacementPoint, _texcoord: &Texcoord) -> Option<Slope> {
        None
    }

    /// A box around all values in a region, rounding included; `None` if none is certain.
    fn bound(&self, region: &Region) -> Option<Bounds3>;

    /// The image that the first component comes from, if that is all there is to it and its texels can be read as they
    /// are in memory.
    fn image(&self) -> Option<HeightImage> {
        None
    }

    /// Bytes held, beyond the texture itself.
    fn memory(&self) -> usize {
        0
    }
}

/// Derivatives of a value by u and v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// By u.
    pub du: Vec3,
    /// By v.
    pub dv: Vec3,
}

/// Where a displacement is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplacementPoint {
    /// The face, as the base counts them.
    pub face: u32,
    /// Parameters on it.
    pub uv: Vec2,
    /// The motion key.
    pub key: u32,
    /// The limit point.
    pub position: Vec3,
    /// Its unit normal, to the front; zero where there is none.
    pub normal: Vec3,
    /// Texture coordinates; the parameters, if the surface has none.
    pub st: Vec2,
}

/// A grid of points of a face for which values are asked.
#[derive(Debug, Clone, Copy)]
pub struct MapGrid<'a> {
    /// The face.
    pub face: u32,
    /// The columns' parameters.
    pub us: &'a [f32],
    /// The rows' parameters.
    pub vs: &'a [f32],
    /// Texture coordinates of all points, u running faster.
    pub st: &'a [Vec2],
}

/// A part of a face whose values shall be bounded, at all motion keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// The face.
    pub face: u32,
    /// Its part; it may be a line or a point.
    pub rect: UvRect,
    /// A rectangle around the part's texture coordinates; `None` if none is certain.
    pub st: Option<UvRect>,
}

/// A map made of closures.
pub struct Function {
    value: Box<dyn Fn(&DisplacementPoint) -> Vec3 + Send + Sync>,
    bound: Option<Bound>,
}

type Bound = Box<dyn Fn(&Region) -> Bounds3 + Send + Sync>;

impl Function {
    /// A scalar displacement, not bounded.
    pub fn scalar(value: impl Fn(&DisplacementPoint) -> f32 + Send + Sync + 'static) -> Self {
        Self::vector(move |at| Vec3::new(value(at), 0.0, 0.0))
    }

    /// A vector displacement, not bounded.
    pub fn vector(value: impl Fn(&DisplacementPoint) -> Vec3 + Send + Sync + 'static) -> Self {
        Self {
            value: Box::new(value),
            bound: None,
        }
    }

    /// With a box around all values that the function has in a region. It must hold them without fail.
    #[must_use]
    pub fn bounded(mut self, bound: impl Fn(&Region) -> Bounds3 + Send + Sync + 'static) -> Self {
        self.bound = Some(Box::new(bound));
        self
    }
}

impl DisplacementMap for Function {
    fn value(&self, at: &DisplacementPoint) -> Vec3 {
        let value = (self.value)(at);
        debug_assert!(
            !value.is_finite()
                || self.bound.as_ref().is_none_or(|bound| {
                    let (face, rect) = (
                        at.face,
                        UvRect {
                            min: at.uv,
                            max: at.uv,
                        },
                    );
                    let st = Some(UvRect {
                        min: at.st,
                        max: at.st,
                    });
                    let b = bound(&Region { face, rect, st });
                    b.min.cmple(value).all() && value.cmple(b.max).all()
                }),
            "{value} at {at:?} is outside of its bound"
        );
        value
    }

    fn bound(&self, region: &Region) -> Option<Bounds3> {
        self.bound.as_ref().map(|bound| bound(region))
    }
}
