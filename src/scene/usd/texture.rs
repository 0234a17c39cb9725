//! UsdUVTexture and RelievoPtexTexture, the nodes before them, and where their images are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use openusd::ar;
use openusd::sdf::AssetPath;
use openusd::usd::{Attribute, Prim};
use openusd::usdz::Archive;

use super::material::Source;
use super::value;
use super::walk::Reader;
use crate::image::{ColorSpace, ImageSource, Wrap};
use crate::math::Vec2;
use crate::scene::{PtexFilter, PtexOptions, PtexSource, TextureSource, Transform2d};

/// A package in a package in …: this deep.
const MAX_PACKAGES: usize = 8;

impl Reader {
    /// The image of a UsdUVTexture.
    pub(super) fn uv_texture(&mut self, shader: &Prim) -> Option<usize> {
        let Source::Own(file) = self.follow(shader.attribute("inputs:file")) else {
            return None;
        };
        let wrap = ["wrapS", "wrapT"].map(|name| {
            match self.plain_word(shader, name).as_deref() {
                Some("clamp") => Wrap::Clamp,
                Some("repeat") => Wrap::Repeat,
                Some("mirror") => Wrap::Mirror,
                // The specification: as the image's metadata say, black where they do not. They never do.
                _ => Wrap::Black,
            }
        });
        let space = match self.plain_word(shader, "sourceColorSpace").as_deref() {
            Some("raw") => ColorSpace::Raw,
            Some("sRGB") => ColorSpace::Srgb,
            _ => ColorSpace::Auto,
        };
        self.texture(shader, &file, wrap, space)
    }

    /// The number of the image that an attribute names, with how it is to be read.
    pub(super) fn texture(
        &mut self,
        prim: &Prim,
        file: &Attribute,
        [wrap_s, wrap_t]: [Wrap; 2],
        space: ColorSpace,
    ) -> Option<usize> {
        let asset = self
            .value(&file.prim(), file.name())
            .and_then(value::asset)
            .filter(|a| !a.asset_path().is_empty())?;
        let color_space = match self
            .metadata(&file.prim(), file.name(), "colorSpace")
            .and_then(value::word)
            .as_deref()
        {
            Some("lin_ap1_scene" | "acescg" | "ACEScg" | "lin_ap1") => ColorSpace::AcesCg,
            Some("raw" | "data" | "Raw") if space == ColorSpace::Auto => ColorSpace::Raw,
            Some("srgb_rec709_scene" | "sRGB" | "srgb_texture") if space == ColorSpace::Auto => {
                ColorSpace::Srgb
            }
            _ => space,
        };
        let image = self.image(prim, file, &asset)?;
        let same = |t: &TextureSource| {
            t.image == image
                && t.wrap_s == wrap_s
                && t.wrap_t == wrap_t
                && t.color_space == color_space
        };
        if let Some(index) = self.textures.iter().position(same) {
            return Some(index);
        }
        self.textures.push(TextureSource {
            image,
            prim: prim.path().as_str().to_owned(),
            wrap_s,
            wrap_t,
            color_space,
        });
        Some(self.textures.len() - 1)
    }

    /// The number of the Ptex file of a RelievoPtexTexture.
    pub(super) fn ptex_file(&mut self, shader: &Prim) -> Option<usize> {
        let Source::Own(file) = self.follow(shader.attribute("inputs:file")) else {
            return None;
        };
        let asset = self
            .value(&file.prim(), file.name())
            .and_then(value::asset)
            .filter(|a| !a.asset_path().is_empty())?;
        let image = self.image(shader, &file, &asset)?;
        let options = PtexOptions {
            filter: self.ptex_filter(shader),
            first_channel: self.plain::<f32>(shader, "firstChannel").unwrap_or(0.0) as usize,
            color_space: match self.plain_word(shader, "sourceColorSpace").as_deref() {
                Some("raw") => ColorSpace::Raw,
                Some("sRGB") => ColorSpace::Srgb,
                _ => ColorSpace::Auto,
            },
        };
        let same = |p: &PtexSource| p.image == image && p.options == options;
        if let Some(index) = self.ptex.iter().position(same) {
            return Some(index);
        }
        self.ptex.push(PtexSource {
            image,
            prim: shader.path().as_str().to_owned(),
            options,
        });
        Some(self.ptex.len() - 1)
    }

    /// How a RelievoPtexTexture is to be looked up.
    fn ptex_filter(&mut self, shader: &Prim) -> PtexFilter {
        let name = self.plain_word(shader, "filter");
        let mut filter = match name.as_deref().map(PtexFilter::named) {
            None => PtexFilter::default(),
            Some(Ok(filter)) => filter,
            Some(Err(fault)) => {
                self.warn("unknown Ptex filter", || {
                    let advice = fault.help.unwrap_or_default();
                    format!("{}: {}: {advice}", shader.path().as_str(), fault.message)
                });
                PtexFilter::default()
            }
        };
        if let PtexFilter::Kernel(kernel) = &mut filter {
            let mut set = |name: &str, to: &mut f32| {
                if let Some(value) = self.plain(shader, name) {
                    *to = value;
                }
            };
            set("sharpness", &mut kernel.sharpness);
            set("width", &mut kernel.width);
            set("blur", &mut kernel.blur);
        }
        filter
    }

    /// Where an asset is: a file, or an entry of a package.
    fn image(&mut self, prim: &Prim, file: &Attribute, asset: &AssetPath) -> Option<ImageSource> {
        let resolved = asset
            .resolved_path()
            .filter(|p| !p.is_empty())
            .map_or_else(|| anchored(self, file, asset.asset_path()), str::to_owned);
        let Some((package, inner)) = ar::split_package_relative_path_outer(&resolved) else {
            let path = PathBuf::from(resolved);
            return Some(ImageSource::File(
                std::path::absolute(&path).unwrap_or(path),
            ));
        };
        let path = PathBuf::from(&package);
        let known = self.textures.iter().find_map(|t| match &t.image {
            ImageSource::Packed { package, tiles } if *package == path => tiles
                .iter()
                .any(|(tile, name, _)| *name == tile_name(&inner, *tile))
                .then(|| t.image.clone()),
            _ => None,
        });
        if known.is_some() {
            return known;
        }
        match unpack(&path, &inner) {
            Ok(tiles) => Some(ImageSource::Packed {
                package: path,
                tiles,
            }),
            Err(e) => {
                self.warn("missing texture", || {
                    format!("{}: {inner} in {package}: {e}", prim.path().as_str())
                });
                None
            }
        }
    }

    /// The primvar that holds the coordinates of a texture, and how they are moved.
    pub(super) fn coordinates(&mut self, shader: &Prim) -> (String, Transform2d) {
        let mut transform = Transform2d::default();
        let mut at = shader.attribute("inputs:st");
        for hop in 0..2 {
            let Source::Shader(node, _) = self.follow(at) else {
                break;
            };
            let id = self.word(&node, "info:id").unwrap_or_default();
            match id.as_str() {
                "UsdPrimvarReader_float2" => {
                    let name = self.plain_word(&node, "varname").filter(|n| !n.is_empty());
                    return (name.unwrap_or_else(|| "st".into()), transform);
                }
                "UsdTransform2d" if hop == 0 => {
                    let two = |reader: &Self, name: &str, default: Vec2| {
                        match reader.follow(node.attribute(format!("inputs:{name}"))) {
                            Source::Own(a) => {
                                reader.value(&a.prim(), a.name()).and_then(value::vec2)
                            }
                            Source::Shader(..) => None,
                        }
                        .unwrap_or(default)
                    };
                    transform = Transform2d {
                        scale: two(self, "scale", Vec2::ONE),
                        rotation: self.plain(&node, "rotation").unwrap_or(0.0),
                        translation: two(self, "translation", Vec2::ZERO),
                    };
                    at = node.attribute("inputs:in");
                }
                _ => {
                    self.warn(&format!("unsupported shader {id}"), || {
                        format!(
                            "{}.st: the shader {id:?} is not known; the primvar st is taken",
                            shader.path().as_str()
                        )
                    });
                    return ("st".into(), transform);
                }
            }
        }
        self.warn("texture without coordinates", || {
            format!(
                "{}: st leads to no primvar reader; the primvar st is taken",
                shader.path().as_str()
            )
        });
        ("st".into(), transform)
    }
}

/// A tile's number, its entry's name and bytes.
type Tile = (u32, String, Arc<[u8]>);

/// The name of a tile's entry.
fn tile_name(name: &str, tile: u32) -> String {
    name.replace("<UDIM>", &tile.to_string())
}

/// The bytes of an entry of a package, or of all tiles of it.
fn unpack(package: &Path, inner: &str) -> Result<Vec<Tile>, String> {
    let mut archive = Archive::open(package).map_err(|e| e.to_string())?;
    let mut inner = inner.to_owned();
    for _ in 0..MAX_PACKAGES {
        let Some((nested, rest)) = ar::split_package_relative_path_outer(&inner) else {
            break;
        };
        let bytes = archive.entry(&nested).map_err(|e| e.to_string())?;
        archive = Archive::from_bytes(bytes.to_vec()).map_err(|e| e.to_string())?;
        inner = rest;
    }
    if !inner.contains("<UDIM>") {
        let bytes = archive.entry(&inner).map_err(|e| e.to_string())?;
        return Ok(vec![(0, inner, Arc::from(&bytes[..]))]);
    }
    let mut tiles = Vec::new();
    for tile in 1001..=1999 {
        let name = tile_name(&inner, tile);
        if archive.contains(&name) {
            let bytes = archive.entry(&name).map_err(|e| e.to_string())?;
            tiles.push((tile, name, Arc::from(&bytes[..])));
        }
    }
    if tiles.is_empty() {
        return Err("the package has no such tile".into());
    }
    Ok(tiles)
}

/// A path that the resolver does not find (a missing file, or one for every tile), seen from the layer that
/// names it.
fn anchored(reader: &Reader, file: &Attribute, asset: &str) -> String {
    let layer = file
        .property_stack()
        .ok()
        .and_then(|stack| stack.into_iter().next())
        .map(|site| site.layer);
    let Some(layer) = layer else {
        let folder = reader.file.parent().unwrap_or(Path::new("."));
        return folder.join(asset).to_string_lossy().into_owned();
    };
    // A package itself stands for the first layer in it.
    let first = layer
        .to_ascii_lowercase()
        .ends_with(".usdz")
        .then(|| Archive::open(&layer).ok()?.first_layer_name())
        .flatten()
        .map(|first| (layer.clone(), first));
    let packed = first.or_else(|| ar::split_package_relative_path_outer(&layer));
    if let Some((package, inner)) = packed {
        let folder = inner.rsplit_once('/').map_or("", |(folder, _)| folder);
        let mut parts: Vec<&str> = folder.split('/').filter(|p| !p.is_empty()).collect();
        for part in asset.split('/') {
            match part {
                "." | "" => {}
                ".." => {
                    parts.pop();
                }
                part => parts.push(part),
            }
        }
        return ar::join_package_relative_path(&package, &parts.join("/"));
    }
    let folder = Path::new(&layer).parent().unwrap_or(Path::new("."));
    folder.join(asset).to_string_lossy().into_owned()
}
