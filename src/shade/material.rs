//! Materials: UsdPreviewSurface's inputs, prepared once and resolved at each hit.
//!
//! `occlusion` is not resolved: it stands for light that a path tracer finds blocked by itself.

use super::bsdf::SurfaceParams;
use super::texture_map::{Lookups, Output, Placed, Primvars, Read, number};
use crate::math::Vec3;
use crate::scene::{self, Input, NormalMap, PreviewSurface, PtexMap, TextureMap};

/// At most this many different texels make a material: it has that many inputs.
const MOST_TEXELS: usize = 11;

/// What a material says at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolved {
    /// How it reflects.
    pub params: SurfaceParams,
    /// Radiance that it emits, at least 0.
    pub emission: Vec3,
    /// 0..1: the part of the light that meets the surface; the rest passes.
    pub opacity: f32,
    /// The normal in tangent space, unit; `None` where no map says otherwise, or where a map says nonsense.
    pub normal: Option<Vec3>,
}

/// What a normal map's tangent space follows: its x and y run as these grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tangents {
    /// Texture coordinates, by the number of the read.
    OfRead(usize),
    /// The parameters of the Ptex face.
    OfFace,
}

/// A material, ready to be asked from any thread.
#[derive(Clone)]
pub struct Material {
    inputs: Inputs,
    texels: Vec<Placed>,
    /// The texel that opacity is, which is looked up no wider than a texel: what is cut out stays cut out wherever it is
    /// seen from, and the colours that a cut-out image hides beside it do not run into it.
    sharp: Option<usize>,
    /// Of its texels and inputs.
    reads: Vec<Read>,
    /// What it resolves to everywhere, if nothing varies.
    constant: Option<Resolved>,
}

#[derive(Clone)]
struct Inputs {
    /// Only the diffuse colour counts.
    lambert: bool,
    specular_workflow: bool,
    opacity_threshold: f32,
    diffuse_color: Source,
    emissive_color: Source,
    specular_color: Source,
    metallic: Source,
    roughness: Source,
    clearcoat: Source,
    clearcoat_roughness: Source,
    opacity: Source,
    ior: Source,
    normal: Option<Source>,
    displacement: Source,
}

#[derive(Clone)]
enum Source {
    Value(Vec3),
    /// Number of the texel, and what to take of it.
    Texel(usize, Output),
    Primvar {
        /// Number of the read.
        read: usize,
        components: usize,
        fallback: Vec3,
    },
}

impl Material {
    /// Prepares a material of a scene, which `lookups` are of. An input whose texture is not among them takes the map's
    /// fallback.
    pub fn new(material: &scene::Material, lookups: &Lookups) -> Self {
        Self::prepared(&material.surface, lookups, false)
    }

    /// A diffuse surface of one colour; with the displacement of another material, to show its shape alone.
    pub fn clay(albedo: Vec3, displacement_of: Option<&Self>) -> Self {
        let mut clay = Self::prepared(&diffuse(Input::Value(albedo)), &Lookups::default(), true);
        if let Some(other) = displacement_of {
            clay.reads.clone_from(&other.reads);
            clay.inputs.displacement = match &other.inputs.displacement {
                Source::Texel(number, output) => {
                    clay.texels.push(other.texels[*number].clone());
                    Source::Texel(0, *output)
                }
                source => source.clone(),
            };
        }
        clay
    }

    /// A diffuse surface coloured by the primvar `displayColor` (18 % grey without it), as opaque as
    /// `displayOpacity` says (wholly, without it).
    pub fn display_color() -> Self {
        let surface = PreviewSurface {
            opacity: Input::Primvar {
                name: "displayOpacity".into(),
                fallback: 1.0,
            },
            ..diffuse(Input::Primvar {
                name: "displayColor".into(),
                fallback: Vec3::splat(0.18),
            })
        };
        Self::prepared(&surface, &Lookups::default(), true)
    }

    fn prepared(surface: &PreviewSurface, lookups: &Lookups, lambert: bool) -> Self {
        let mut sources = Sources {
            lookups,
            texels: Vec::new(),
            reads: Vec::new(),
        };
        let inputs = Inputs {
            lambert,
            specular_workflow: surface.use_specular_workflow,
            opacity_threshold: surface.opacity_threshold,
            diffuse_color: sources.color(&surface.diffuse_color),
            emissive_color: sources.color(&surface.emissive_color),
            specular_color: sources.color(&surface.specular_color),
            metallic: sources.number(&surface.metallic),
            roughness: sources.number(&surface.roughness),
            clearcoat: sources.number(&surface.clearcoat),
            clearcoat_roughness: sources.number(&surface.clearcoat_roughness),
            opacity: sources.number(&surface.opacity),
            ior: sources.number(&surface.ior),
            displacement: sources.height(&surface.displacement),
            normal: surface.normal.as_ref().map(|map| match map {
                NormalMap::Image(map) => sources.texel(map),
                NormalMap::Ptex(map) => sources.face_texel(map),
            }),
        };
        let mut material = Self {
            sharp: match inputs.opacity {
                Source::Texel(number, _) => Some(number),
                Source::Value(_) | Source::Primvar { .. } => None,
            },
            inputs,
            texels: sources.texels,
            reads: sources.reads,
            constant: None,
        };
        if material.shading_sources().all(Source::is_constant) {
            material.constant = Some(material.resolve(&NoPrimvars));
        }
        material
    }

    /// What it says where the surface has these primvars. Every number is brought into its range; what is
    /// not finite counts as 0.
    pub fn resolve(&self, primvars: &dyn Primvars) -> Resolved {
        if let Some(constant) = self.constant {
            return constant;
        }
        let inputs = &self.inputs;
        let mut point = Point {
            primvars,
            material: self,
            seen: [None; MOST_TEXELS],
        };
        let diffuse_color = non_negative(point.get(&inputs.diffuse_color));
        let params = if inputs.lambert {
            SurfaceParams::lambert(diffuse_color)
        } else {
            let specular = inputs.specular_workflow;
            SurfaceParams {
                diffuse_color,
                specular_workflow: specular,
                specular_color: if specular {
                    non_negative(point.get(&inputs.specular_color))
                } else {
                    Vec3::ZERO
                },
                metallic: if specular {
                    0.0
                } else {
                    unit(point.get(&inputs.metallic).x)
                },
                roughness: unit(point.get(&inputs.roughness).x),
                clearcoat: unit(point.get(&inputs.clearcoat).x),
                clearcoat_roughness: unit(point.get(&inputs.clearcoat_roughness).x),
                ior: non_negative(point.get(&inputs.ior)).x,
            }
        };
        Resolved {
            params,
            emission: non_negative(point.get(&inputs.emissive_color)),
            opacity: inputs.cut_out(unit(point.get(&inputs.opacity).x)),
            normal: inputs.normal.as_ref().and_then(|source| {
                let normal = point.get(source);
                // Below the surface is no place for a normal.
                (normal.z > 0.0).then(|| normal.try_normalize()).flatten()
            }),
        }
    }

    /// How far the surface is moved along its normal, scene units in the object's space; what is not finite
    /// counts as 0.
    pub fn displacement(&self, primvars: &dyn Primvars) -> f32 {
        let mut point = Point {
            primvars,
            material: self,
            seen: [None; MOST_TEXELS],
        };
        let x = point.get(&self.inputs.displacement).x;
        if x.is_finite() { x } else { 0.0 }
    }

    /// What it reads: [`Primvars`] count in this. Not all of it is asked for: see [`needs`](Self::needs).
    pub fn reads(&self) -> &[Read] {
        &self.reads
    }

    /// The names of the primvars that [`Self::resolve`] asks for: sorted, each once.
    pub fn needs(&self) -> Vec<&str> {
        self.names(self.shading_sources())
    }

    /// The names of the primvars that [`Self::displacement`] asks for: sorted, each once.
    pub fn displacement_needs(&self) -> Vec<&str> {
        self.names([&self.inputs.displacement].into_iter())
    }

    /// What the normal map's tangent space follows, if there is such a map.
    pub fn tangents(&self) -> Option<Tangents> {
        let Source::Texel(number, _) = self.inputs.normal.as_ref()? else {
            return None;
        };
        match &self.texels[*number] {
            Placed::Ptex { .. } => Some(Tangents::OfFace),
            image => image.read().map(Tangents::OfRead),
        }
    }

    /// Whether any displacement but 0 is possible.
    pub fn is_displaced(&self) -> bool {
        !matches!(self.inputs.displacement, Source::Value(v) if v.x == 0.0 || !v.x.is_finite())
    }

    /// Whether opacity below 1 is possible.
    pub fn may_be_transparent(&self) -> bool {
        match (&self.constant, &self.inputs.opacity) {
            (Some(resolved), _) => resolved.opacity < 1.0,
            (None, Source::Value(v)) => self.inputs.cut_out(unit(v.x)) < 1.0,
            (None, Source::Texel(..) | Source::Primvar { .. }) => true,
        }
    }

    /// The same material for a surface on which it resolves to the same everywhere, because it depends on
    /// nothing but primvars that do not vary there; `primvars` has those. None if it varies, or is constant
    /// already.
    pub fn constant_on(
        &self,
        primvars: &dyn Primvars,
        varies: impl Fn(&str) -> bool,
    ) -> Option<Self> {
        let fixed = |source: &Source| match source {
            Source::Value(_) => true,
            Source::Texel(..) => false,
            Source::Primvar { read, .. } => !varies(&self.reads[*read].name),
        };
        let constant = self.constant.is_none() && self.shading_sources().all(fixed);
        constant.then(|| Self {
            constant: Some(self.resolve(primvars)),
            ..self.clone()
        })
    }

    /// Whether emission is possible.
    pub fn may_emit(&self) -> bool {
        match &self.inputs.emissive_color {
            Source::Value(v) => non_negative(*v) != Vec3::ZERO,
            Source::Texel(..) | Source::Primvar { .. } => true,
        }
    }

    fn shading_sources(&self) -> impl Iterator<Item = &Source> {
        let i = &self.inputs;
        [
            &i.diffuse_color,
            &i.emissive_color,
            &i.specular_color,
            &i.metallic,
            &i.roughness,
            &i.clearcoat,
            &i.clearcoat_roughness,
            &i.opacity,
            &i.ior,
        ]
        .into_iter()
        .chain(&i.normal)
    }

    fn names<'a>(&'a self, sources: impl Iterator<Item = &'a Source>) -> Vec<&'a str> {
        let mut names: Vec<_> = sources
            .filter_map(|source| self.read(source))
            .map(|read| self.reads[read].name.as_str())
            .collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    fn read(&self, source: &Source) -> Option<usize> {
        match source {
            Source::Value(_) => None,
            Source::Texel(number, _) => self.texels[*number].read(),
            Source::Primvar { read, .. } => Some(*read),
        }
    }
}

impl Inputs {
    /// With a threshold, opacity is all or nothing.
    fn cut_out(&self, opacity: f32) -> f32 {
        match self.opacity_threshold > 0.0 {
            true if opacity >= self.opacity_threshold => 1.0,
            true => 0.0,
            false => opacity,
        }
    }
}

impl Source {
    fn is_constant(&self) -> bool {
        matches!(self, Self::Value(_))
    }
}

/// One point, and the texels that were looked up there: inputs that share an image look once.
struct Point<'a> {
    primvars: &'a dyn Primvars,
    material: &'a Material,
    seen: [Option<Option<glam::Vec4>>; MOST_TEXELS],
}

impl Point<'_> {
    fn get(&mut self, source: &Source) -> Vec3 {
        match source {
            Source::Value(v) => *v,
            Source::Texel(number, output) => {
                let Material { texels, sharp, .. } = self.material;
                let sharp = *sharp == Some(*number);
                let texel = *self.seen[*number]
                    .get_or_insert_with(|| texels[*number].eval(self.primvars, sharp));
                output.of(texel)
            }
            Source::Primvar {
                read,
                components,
                fallback,
            } => {
                let mut out = [0.0; 3];
                if !self.primvars.get(*read, &mut out[..*components]) {
                    return *fallback;
                }
                if *components == 1 {
                    Vec3::splat(out[0])
                } else {
                    out.into()
                }
            }
        }
    }
}

struct NoPrimvars;

impl Primvars for NoPrimvars {
    fn get(&self, _: usize, _: &mut [f32]) -> bool {
        false
    }
}

fn diffuse(diffuse_color: Input<Vec3>) -> PreviewSurface {
    PreviewSurface {
        diffuse_color,
        ..PreviewSurface::default()
    }
}

/// Gathers what the inputs of a material look at.
struct Sources<'a> {
    lookups: &'a Lookups,
    texels: Vec<Placed>,
    reads: Vec<Read>,
}

impl Sources<'_> {
    fn color(&mut self, input: &Input<Vec3>) -> Source {
        self.source(input, 3, |color| color)
    }

    fn number(&mut self, input: &Input<f32>) -> Source {
        self.source(input, 1, Vec3::splat)
    }

    fn height(&mut self, input: &Input<f32>) -> Source {
        match input {
            Input::Ptex(map) => {
                let placed = Placed::ptex(map, self.lookups, true);
                self.placed(placed, Output::ptex(map))
            }
            _ => self.number(input),
        }
    }

    fn source<T: Copy>(
        &mut self,
        input: &Input<T>,
        components: usize,
        splat: impl Fn(T) -> Vec3,
    ) -> Source {
        match input {
            Input::Value(value) => Source::Value(splat(*value)),
            Input::Texture(map) => self.texel(map),
            Input::Ptex(map) => self.face_texel(map),
            Input::Primvar { name, fallback } => Source::Primvar {
                read: number(&mut self.reads, name, components),
                components,
                fallback: splat(*fallback),
            },
        }
    }

    fn face_texel(&mut self, map: &PtexMap) -> Source {
        let placed = Placed::ptex(map, self.lookups, false);
        self.placed(placed, Output::ptex(map))
    }

    fn texel(&mut self, map: &TextureMap) -> Source {
        let placed = Placed::image(map, self.lookups, &mut self.reads);
        self.placed(placed, Output::image(map))
    }

    fn placed(&mut self, placed: Placed, output: Output) -> Source {
        let same = self.texels.iter().position(|other| other.is_like(&placed));
        let number = same.unwrap_or_else(|| {
            self.texels.push(placed);
            self.texels.len() - 1
        });
        Source::Texel(number, output)
    }
}

/// 0..1; NaN is 0.
fn unit(x: f32) -> f32 {
    if x.is_finite() && x > 0.0 {
        x.min(1.0)
    } else {
        0.0
    }
}

fn non_negative(v: Vec3) -> Vec3 {
    let one = |x: f32| {
        if x.is_finite() && x > 0.0 { x } else { 0.0 }
    };
    Vec3::new(one(v.x), one(v.y), one(v.z))
}

#[cfg(test)]
#[path = "material_tests.rs"]
mod tests;
