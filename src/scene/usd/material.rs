//! UsdShade: which material covers a prim, and UsdPreviewSurface.

use openusd::sdf;
use openusd::tf::Token;
use openusd::usd::{Attribute, Prim};
use openusd_schemas::shade::MaterialBindingAPI;

use super::value;
use super::walk::{Inherited, Reader, has};
use crate::math::{Vec3, Vec4};
use crate::scene::{Channels, Input, Material, NormalMap, PreviewSurface, PtexMap, TextureMap};

/// Connections are followed this far.
const MAX_HOPS: usize = 64;

/// A bound material, which need not be one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bound {
    pub(super) target: sdf::Path,
    /// Stronger than what is bound below.
    pub(super) strong: bool,
}

/// Where a value comes from.
pub(super) enum Source {
    /// An attribute's own value.
    Own(Attribute),
    /// An output of a shader.
    Shader(Prim, String),
}

/// What an input may hold.
pub(super) trait Channel: Copy {
    /// From the numbers of a value.
    fn from_value(value: sdf::Value) -> Option<Self>;
    /// From one number, for an output of one channel.
    const SCALAR: bool;
}

impl Channel for f32 {
    fn from_value(value: sdf::Value) -> Option<Self> {
        value::number(&value).map(|v| v as f32)
    }
    const SCALAR: bool = true;
}

impl Channel for Vec3 {
    fn from_value(value: sdf::Value) -> Option<Self> {
        value::vec3(value)
    }
    const SCALAR: bool = false;
}

impl Reader {
    /// Takes over the bindings at a prim.
    pub(super) fn inherit_bindings(&mut self, prim: &Prim, names: &[Token], out: &mut Inherited) {
        if !names.iter().any(|n| n.starts_with("material:binding")) {
            return;
        }
        if names
            .iter()
            .any(|n| n.starts_with("material:binding:collection:"))
        {
            out.collections = true;
        }
        for (name, slot) in [
            ("material:binding", &mut out.all),
            ("material:binding:full", &mut out.full),
        ] {
            if !has(names, name) || slot.as_ref().is_some_and(|b| b.strong) {
                continue;
            }
            let relationship = prim.relationship(name);
            if let Some(target) = self.targets(prim, name).into_iter().next() {
                let strength = relationship
                    .get_metadata::<sdf::Value>("bindMaterialAs")
                    .ok()
                    .flatten()
                    .and_then(value::word);
                *slot = Some(Bound {
                    target,
                    strong: strength.as_deref() == Some("strongerThanDescendants"),
                });
            }
        }
    }

    /// The binding that wins: for the full purpose, else for all purposes.
    pub(super) fn resolve_binding(&self, prim: &Prim, inherited: &Inherited) -> Option<Bound> {
        if !inherited.collections {
            return inherited.full.clone().or_else(|| inherited.all.clone());
        }
        let target = MaterialBindingAPI::from_prim_unchecked(prim.clone())
            .compute_bound_material("full")
            .ok()
            .flatten()?;
        Some(Bound {
            target,
            strong: false,
        })
    }

    /// The number of a bound material; `None`, with a warning, if it is not there or not one that is known.
    pub(super) fn material(&mut self, user: &Prim, target: &sdf::Path) -> Option<usize> {
        let prim = self.stage.prim(target.clone()).ok();
        let key = prim
            .as_ref()
            .and_then(|p| p.prim_in_prototype().ok().flatten())
            .map_or_else(
                || target.as_str().to_owned(),
                |p| p.path().as_str().to_owned(),
            );
        if let Some(known) = self.material_of.get(&key) {
            return *known;
        }
        let prim =
            prim.filter(|p| self.type_name(p) == "Material" && p.is_active().unwrap_or(false));
        let index = match prim {
            Some(prim) => self.preview_surface(&prim).map(|surface| {
                self.materials.push(Material {
                    path: key.clone(),
                    surface,
                });
                self.materials.len() - 1
            }),
            None => {
                self.warn("missing material", || {
                    format!(
                        "{}: the bound material {key} is not there",
                        user.path().as_str()
                    )
                });
                None
            }
        };
        self.material_of.insert(key, index);
        index
    }

    /// Follows the connections of an attribute to a shader's output, or to the attribute that has the value.
    pub(super) fn follow(&self, attribute: Attribute) -> Source {
        let mut at = attribute;
        for _ in 0..MAX_HOPS {
            let Some(target) = at.connections().ok().and_then(|c| c.into_iter().next()) else {
                break;
            };
            let Ok(next) = self.stage.attribute(target) else {
                break;
            };
            let prim = next.prim();
            if !prim.is_valid().unwrap_or(false) {
                break;
            }
            if let Some(output) = next.name().strip_prefix("outputs:")
                && self.type_name(&prim) == "Shader"
            {
                let output = output.to_owned();
                return Source::Shader(prim, output);
            }
            at = next;
        }
        Source::Own(at)
    }

    /// The shader that a terminal of a material leads to, if it is a UsdPreviewSurface.
    fn terminal(&mut self, material: &Prim, name: &str) -> Option<Prim> {
        match self.follow(material.attribute(name)) {
            Source::Shader(shader, _) => {
                let id = self.word(&shader, "info:id").unwrap_or_default();
                if id == "UsdPreviewSurface" {
                    return Some(shader);
                }
                self.warn(&format!("unsupported shader {id}"), || {
                    format!(
                        "{}: {name} leads to the shader {id:?}, of which relievo knows UsdPreviewSurface only",
                        material.path().as_str()
                    )
                });
                None
            }
            Source::Own(_) => None,
        }
    }

    fn preview_surface(&mut self, material: &Prim) -> Option<PreviewSurface> {
        let surface = self.terminal(material, "outputs:surface");
        if surface.is_none() {
            let names = self.authored(material);
            let other = names
                .iter()
                .find(|n| n.starts_with("outputs:") && n.ends_with(":surface"));
            if let Some(other) = other {
                self.warn("material without preview surface", || {
                    format!(
                        "{}: {other} is not honoured, and there is no outputs:surface that is",
                        material.path().as_str()
                    )
                });
            }
        }
        let displacement = self.terminal(material, "outputs:displacement");
        let mut out = PreviewSurface::default();
        if let Some(s) = &surface {
            out.diffuse_color = self.input(s, "diffuseColor", Vec3::splat(0.18));
            out.emissive_color = self.input(s, "emissiveColor", Vec3::ZERO);
            out.specular_color = self.input(s, "specularColor", Vec3::ZERO);
            out.metallic = self.input(s, "metallic", 0.0);
            out.roughness = self.input(s, "roughness", 0.5);
            out.clearcoat = self.input(s, "clearcoat", 0.0);
            out.clearcoat_roughness = self.input(s, "clearcoatRoughness", 0.01);
            out.opacity = self.input(s, "opacity", 1.0);
            out.ior = self.input(s, "ior", 1.5);
            out.occlusion = self.input(s, "occlusion", 1.0);
            out.use_specular_workflow =
                self.plain(s, "useSpecularWorkflow").unwrap_or(0.0_f32) != 0.0;
            out.opacity_threshold = self.plain(s, "opacityThreshold").unwrap_or(0.0);
            out.normal = match self.input(s, "normal", Vec3::Z) {
                Input::Texture(map) => Some(NormalMap::Image(map)),
                Input::Ptex(map) => Some(NormalMap::Ptex(map)),
                _ => None,
            };
        }
        if let Some(d) = &displacement {
            out.displacement = self.input(d, "displacement", 0.0);
        }
        (surface.is_some() || displacement.is_some()).then_some(out)
    }

    /// The value of an input that must not vary over the surface.
    pub(super) fn plain<T: Channel>(&mut self, shader: &Prim, name: &str) -> Option<T> {
        match self.follow(shader.attribute(format!("inputs:{name}"))) {
            Source::Own(attribute) => self.own(&attribute),
            Source::Shader(source, _) => {
                self.warn("varying input", || {
                    format!(
                        "{}.{name}: must be one value, but leads to {}",
                        shader.path().as_str(),
                        source.path().as_str()
                    )
                });
                None
            }
        }
    }

    /// An attribute's own value.
    fn own<T: Channel>(&self, attribute: &Attribute) -> Option<T> {
        self.value(&attribute.prim(), attribute.name())
            .and_then(T::from_value)
    }

    /// The word that an input has, through connections.
    pub(super) fn plain_word(&self, shader: &Prim, name: &str) -> Option<String> {
        match self.follow(shader.attribute(format!("inputs:{name}"))) {
            Source::Own(attribute) => self.word(&attribute.prim(), attribute.name()),
            Source::Shader(..) => None,
        }
    }

    /// An input of a surface.
    fn input<T: Channel>(&mut self, shader: &Prim, name: &str, default: T) -> Input<T> {
        let (source, output) = match self.follow(shader.attribute(format!("inputs:{name}"))) {
            Source::Own(attribute) => {
                return Input::Value(self.own(&attribute).unwrap_or(default));
            }
            Source::Shader(source, output) => (source, output),
        };
        let id = self.word(&source, "info:id").unwrap_or_default();
        if id == "UsdUVTexture" {
            if let Some(map) = self.texture_map(&source, &output, T::SCALAR) {
                return Input::Texture(map);
            }
            return Input::Value(self.without_image(&source, &output, default));
        }
        if id == "RelievoPtexTexture" {
            return match self.ptex_file(&source) {
                Some(file) => Input::Ptex(self.ptex_map(&source, &output, file, T::SCALAR)),
                None => Input::Value(self.without_image(&source, &output, default)),
            };
        }
        if id.starts_with("UsdPrimvarReader_float")
            || id == "UsdPrimvarReader_vector"
            || id == "UsdPrimvarReader_normal"
        {
            let fallback = match self.follow(source.attribute("inputs:fallback")) {
                Source::Own(attribute) => self.own(&attribute),
                Source::Shader(..) => None,
            };
            if let Some(varname) = self
                .plain_word(&source, "varname")
                .filter(|n| !n.is_empty())
            {
                return Input::Primvar {
                    name: varname,
                    fallback: fallback.unwrap_or(default),
                };
            }
        }
        self.warn(&format!("unsupported shader {id}"), || {
            format!(
                "{}.{name}: the shader {id:?} at {} is not known",
                shader.path().as_str(),
                source.path().as_str()
            )
        });
        Input::Value(
            self.own(&shader.attribute(format!("inputs:{name}")))
                .unwrap_or(default),
        )
    }

    /// What an output of a texture is without an image: its fallback.
    fn without_image<T: Channel>(&self, texture: &Prim, output: &str, default: T) -> T {
        let fallback = self.fallback(texture);
        let scalar = match output {
            "g" => fallback.y,
            "b" => fallback.z,
            "a" => fallback.w,
            _ => fallback.x,
        };
        let value = if T::SCALAR || output != "rgb" {
            sdf::Value::Float(scalar)
        } else {
            let [x, y, z] = fallback.truncate().to_array();
            sdf::Value::Vec3f([x, y, z].into())
        };
        T::from_value(value)
            .or_else(|| T::from_value(sdf::Value::Vec3f([scalar; 3].into())))
            .unwrap_or(default)
    }

    /// What a texture is without an image.
    pub(super) fn fallback(&self, texture: &Prim) -> Vec4 {
        let none = Vec4::new(0.0, 0.0, 0.0, 1.0);
        self.four(texture, "fallback").unwrap_or(none)
    }

    /// A UsdUVTexture with the nodes before it.
    fn texture_map(&mut self, shader: &Prim, output: &str, scalar: bool) -> Option<TextureMap> {
        let texture = self.uv_texture(shader)?;
        let (primvar, transform) = self.coordinates(shader);
        Some(TextureMap {
            texture,
            primvar,
            transform,
            channels: channels(output, scalar),
            scale: self.four(shader, "scale").unwrap_or(Vec4::ONE),
            bias: self.four(shader, "bias").unwrap_or(Vec4::ZERO),
            fallback: self.fallback(shader),
        })
    }

    /// What an input takes of a RelievoPtexTexture.
    fn ptex_map(&self, shader: &Prim, output: &str, file: usize, scalar: bool) -> PtexMap {
        PtexMap {
            file,
            channels: channels(output, scalar),
            scale: self.four(shader, "scale").unwrap_or(Vec4::ONE),
            bias: self.four(shader, "bias").unwrap_or(Vec4::ZERO),
            fallback: self.fallback(shader),
        }
    }

    /// The four numbers of an input that must not vary.
    fn four(&self, shader: &Prim, name: &str) -> Option<Vec4> {
        match self.follow(shader.attribute(format!("inputs:{name}"))) {
            Source::Own(attribute) => self
                .value(&attribute.prim(), attribute.name())
                .and_then(value::vec4),
            Source::Shader(..) => None,
        }
    }
}

/// What an input takes of a texture's output.
fn channels(output: &str, scalar: bool) -> Channels {
    match (output, scalar) {
        ("r", _) => Channels::R,
        ("g", _) => Channels::G,
        ("b", _) => Channels::B,
        ("a", _) => Channels::A,
        (_, true) => Channels::R,
        (_, false) => Channels::Rgb,
    }
}
