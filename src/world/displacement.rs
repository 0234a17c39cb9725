//! A material's displacement, for surfaces of ours and for Embree's callback.

use std::collections::HashMap;
use std::sync::Arc;

use super::textures::Textures;
use crate::image::{PtexHeights, Texture};
use crate::math::{Bounds3, Vec2, Vec3};
use crate::scene::{self, Input, PtexMap, TextureMap};
use crate::shade::material::Material;
use crate::shade::texture_map::{Primvars, Read, StTransform};
use crate::store::Digest;
use crate::surface::{
    Amount, Carrier, Channels, Displacement, DisplacementMap, DisplacementPoint, Function,
    ImageMap, Region, Subdivision, UvRect,
};
use crate::trace;

/// Images as displacement, each made once for all surfaces that it moves.
pub(super) struct Heights<'a> {
    textures: &'a Textures,
    /// By texture and component.
    maps: HashMap<(usize, u8), ImageMap>,
    /// By texture.
    digests: HashMap<usize, String>,
    /// By Ptex file and component.
    ptex: HashMap<(usize, u8), Arc<PtexHeights>>,
}

/// The name of the primvar whose values are a displacement's texture coordinates, if it reads an image.
pub(super) fn coordinates(height: &Input<f32>) -> Option<&str> {
    match height {
        Input::Texture(map) => Some(&map.primvar),
        Input::Value(_) | Input::Ptex(_) | Input::Primvar { .. } => None,
    }
}

impl<'a> Heights<'a> {
    /// `textures` are the scene's.
    pub(super) fn new(textures: &'a Textures) -> Self {
        Self {
            textures,
            maps: HashMap::new(),
            digests: HashMap::new(),
            ptex: HashMap::new(),
        }
    }

    /// A displacement along the normal by the input of a material. The texture coordinates of `carrier` are those that
    /// [`coordinates`] names, if it has them.
    pub(super) fn displacement(
        &mut self,
        height: &Input<f32>,
        carrier: &Arc<dyn Carrier>,
    ) -> Displacement {
        let (map, scale, bias) = match height {
            Input::Value(value) => (constant(*value), 1.0, 0.0),
            Input::Primvar { name, fallback } => match carrier.slot(name, 1) {
                None => (constant(*fallback), 1.0, 0.0),
                Some(slot) => (by_primvar(slot, carrier.clone()), 1.0, 0.0),
            },
            Input::Texture(map) => {
                let channel = usize::from(component(map.channels));
                let texture = self.textures.images.get(map.texture);
                match (carrier.slot(&map.primvar, 2), texture) {
                    (Some(slot), Some(texture)) => {
                        let image = if carrier.is_texcoord(slot) {
                            self.image(map, texture)
                        } else {
                            image_by_primvar(map, slot, carrier.clone(), texture.clone())
                        };
                        (image, map.scale[channel], map.bias[channel])
                    }
                    _ => (constant(map.fallback[channel]), 1.0, 0.0),
                }
            }
            Input::Ptex(map) => {
                let channel = component(map.channels);
                let by_face = ByFace {
                    heights: self.ptex(map, channel),
                    carrier: carrier.clone(),
                };
                let channel = usize::from(channel);
                (
                    Arc::new(by_face) as Arc<dyn DisplacementMap>,
                    map.scale[channel],
                    map.bias[channel],
                )
            }
        };
        Displacement::Scalar(Amount { map, scale, bias })
    }

    /// The image that a height reads, in a digest; each image is gone through once.
    pub(super) fn digest(&mut self, height: Option<&Input<f32>>) -> Digest {
        let mut digest = Digest::new();
        if let Some(Input::Texture(map)) = height
            && let Some(texture) = self.textures.images.get(map.texture)
        {
            let of_image = self.digests.entry(map.texture).or_insert_with(|| {
                let mut digest = Digest::new();
                texture.add_to(&mut digest);
                digest.finish()
            });
            digest.text(of_image);
        }
        if let Some(Input::Ptex(map)) = height
            && let Some(Some(texture)) = self.textures.heights.get(map.file)
        {
            texture.add_to(&mut digest);
        }
        digest
    }

    /// A channel of a Ptex file.
    fn ptex(&mut self, map: &PtexMap, component: u8) -> Arc<PtexHeights> {
        let texture = self.textures.heights[map.file]
            .as_ref()
            .unwrap_or(&self.textures.ptex[map.file]);
        let new = || Arc::new(PtexHeights::new(texture.clone(), component.into()));
        let known = self.ptex.entry((map.file, component));
        known.or_insert_with(new).clone()
    }

    /// An image at a surface's own texture coordinates.
    fn image(&mut self, map: &TextureMap, texture: &Arc<Texture>) -> Arc<dyn DisplacementMap> {
        let component = component(map.channels);
        let image = self
            .maps
            .entry((map.texture, component))
            .or_insert_with(|| ImageMap::new(texture.clone(), Channels::Component(component)));
        Arc::new(image.moved(StTransform::new(&map.transform).affine()))
    }
}

/// A Ptex file's channel as displacement.
struct ByFace {
    heights: Arc<PtexHeights>,
    carrier: Arc<dyn Carrier>,
}

impl DisplacementMap for ByFace {
    fn value(&self, at: &DisplacementPoint) -> Vec3 {
        let place = self.carrier.ptex(at.face, at.uv);
        let height = place.map_or(0.0, |(face, uv)| self.heights.eval(face, uv));
        Vec3::new(height, 0.0, 0.0)
    }

    fn bound(&self, region: &Region) -> Option<Bounds3> {
        /// Parameters on the Ptex face are rounded to it.
        const ROUNDING: f32 = 2.0 * f32::EPSILON;
        let UvRect { min, max } = region.rect;
        // Faces are Ptex faces or quarters of them: corners go to corners.
        let (face, a) = self.carrier.ptex(region.face, min)?;
        let (_, b) = self.carrier.ptex(region.face, max)?;
        let (low, high) = (a.min(b) - ROUNDING, a.max(b) + ROUNDING);
        let [least, most] = self.heights.range(face, [low.x, high.x], [low.y, high.y])?;
        Some(Bounds3 {
            min: Vec3::new(least, 0.0, 0.0),
            max: Vec3::new(most, 0.0, 0.0),
        })
    }

    fn memory(&self) -> usize {
        self.heights.memory()
    }
}

/// The same height everywhere.
fn constant(height: f32) -> Arc<dyn DisplacementMap> {
    let range = Bounds3::of([Vec3::new(height, 0.0, 0.0)]);
    Arc::new(Function::scalar(move |_| height).bounded(move |_| range))
}

/// The primvar's first component.
fn by_primvar(slot: usize, carrier: Arc<dyn Carrier>) -> Arc<dyn DisplacementMap> {
    Arc::new(Function::scalar(move |at| {
        let mut height = [0.0];
        carrier.primvar(slot, at.face, at.uv, &mut height);
        height[0]
    }))
}

/// An image at coordinates that are not the surface's own: the same all over a face, or the first two of three.
fn image_by_primvar(
    map: &TextureMap,
    slot: usize,
    carrier: Arc<dyn Carrier>,
    texture: Arc<Texture>,
) -> Arc<dyn DisplacementMap> {
    let (transform, channel) = (
        StTransform::new(&map.transform),
        usize::from(component(map.channels)),
    );
    Arc::new(Function::scalar(move |at| {
        let mut st = [0.0; 2];
        carrier.primvar(slot, at.face, at.uv, &mut st);
        texture.eval(transform.apply(Vec2::from(st)))[channel]
    }))
}

fn component(channels: scene::Channels) -> u8 {
    match channels {
        scene::Channels::Rgb | scene::Channels::R => 0,
        scene::Channels::G => 1,
        scene::Channels::B => 2,
        scene::Channels::A => 3,
    }
}

/// The material's displacement along the normal, for Embree; `widths` are the names and widths of the primvars that
/// the geometry carries, by slot.
pub(super) fn by_callback(
    material: Material,
    widths: &[(String, usize)],
    base: &Arc<Subdivision>,
) -> trace::Displacement {
    let base = base.clone();
    let slots: Vec<_> = material
        .reads()
        .iter()
        .map(|read| embree_slot(widths, read))
        .collect();
    Arc::new(move |point| {
        let height = material.displacement(&At {
            point,
            slots: &slots,
            base: &base,
        });
        height * point.normal
    })
}

/// Where a point of Embree's subdivision geometry is on our surface of the same cage, which has no triangles of Loop's.
pub fn of_embree(base: &Subdivision, primitive: u32, uv: Vec2) -> (u32, Vec2) {
    if base.is_quad(primitive) {
        base.of_cage(primitive, None, uv)
    } else {
        let (corner, uv) = trace::sub_face_of(uv);
        base.of_cage(primitive, Some(corner), uv)
    }
}

/// The slot of a primvar among those that a geometry of Embree's carries, by their names and widths.
pub(super) fn embree_slot(widths: &[(String, usize)], read: &Read) -> Option<usize> {
    let fits = |(name, width): &(String, usize)| *name == read.name && *width >= read.width;
    widths.iter().position(fits)
}

struct At<'a> {
    point: &'a trace::DisplacementPoint<'a>,
    /// By the material's reads.
    slots: &'a [Option<usize>],
    /// Our surface of the same cage.
    base: &'a Subdivision,
}

impl Primvars for At<'_> {
    fn get(&self, read: usize, out: &mut [f32]) -> bool {
        self.slots[read]
            .inspect(|&slot| self.point.primvar(slot, out))
            .is_some()
    }

    fn ptex(&self) -> Option<(u32, Vec2)> {
        let (face, uv) = of_embree(self.base, self.point.face, self.point.uv);
        self.base.ptex(face, uv)
    }
}
