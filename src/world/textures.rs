//! A scene's images and Ptex files, loaded; and its materials, which look them up.

use std::sync::Arc;

use glam::Vec4;
use rayon::prelude::*;
use relievo_ptex::{Cache, MeshType, Reader};

use super::build::BuildOptions;
use crate::error::{Fault, Result, Warnings};
use crate::image::{ImageSource, PtexTexture, Texture};
use crate::math::{Area, Vec2, Vec3};
use crate::memory::Budget;
use crate::mesh::{Scheme, ptex_face_count, ptex_kind};
use crate::scene::{
    self, ColorSpace, Description, Input, PreviewSurface, PtexFilter, PtexMap, PtexOptions,
};
use crate::shade::material::Material;
use crate::shade::texture_map::{FaceLookup, Lookup, Lookups};

/// Bytes of Ptex texels that are held at a time, where memory has no budget; of a budget a quarter at most.
const PTEX_CACHE: usize = 1 << 30;

/// What materials and lights look things up in.
pub(super) struct Textures {
    /// The description's, in its order.
    pub(super) images: Vec<Arc<Texture>>,
    /// Likewise.
    pub(super) ptex: Vec<Arc<PtexTexture>>,
    /// The same files as displacement reads them, where one does.
    pub(super) heights: Vec<Option<Arc<PtexTexture>>>,
    cache: Cache,
}

impl Textures {
    /// Reads images whole, and opens Ptex files, each of them once.
    ///
    /// # Errors
    /// What cannot be read, unless the options have a colour instead; images that the budget has no room for.
    pub(super) fn load(
        description: &Description,
        options: &BuildOptions,
        budget: &Budget,
        warnings: &mut Warnings,
    ) -> Result<Self> {
        if let Some(left) = budget.left() {
            // One after the other: what a reader holds for a header should not add up.
            let [mut bytes, mut reading] = [0, 0];
            for (i, texture) in description.textures.iter().enumerate() {
                let levels = description.is_shaded_by(i);
                let [held, more] =
                    Texture::expected_memory(&texture.image, levels, left as u64 / 2);
                bytes += held;
                reading = more.max(reading);
            }
            let at_once = description.textures.len().min(rayon::current_num_threads());
            budget.ask(bytes + reading * at_once as u64, "the scene's textures")?;
        }
        let images = load_images(description, options, warnings)?;
        let quarter = budget.limit().map_or(usize::MAX, |limit| limit / 4);
        let cache = Cache::new(PTEX_CACHE.min(quarter));
        let mut ptex = Vec::new();
        let mut heights = Vec::new();
        let mut readers: Vec<(&ImageSource, Result<Reader, Fault>)> = Vec::new();
        for (i, source) in description.ptex.iter().enumerate() {
            // However it is read, a file is open once, and its texels are held once.
            let known = readers
                .iter()
                .position(|(image, _)| **image == source.image);
            let number = known.unwrap_or_else(|| {
                readers.push((&source.image, PtexTexture::open(&source.image, &cache)));
                readers.len() - 1
            });
            let reader = &readers[number].1;
            let mut open = |how: &PtexOptions| {
                let constant = |value| Arc::new(PtexTexture::constant(value));
                let texture = (reader.clone()).and_then(|reader| PtexTexture::new(reader, how));
                texture.map_or_else(
                    |fault| missing(fault, &source.prim, options, warnings).map(constant),
                    |texture| Ok(Arc::new(texture)),
                )
            };
            let displaces = (description.materials.iter())
                .any(|m| matches!(&m.surface.displacement, Input::Ptex(map) if map.file == i));
            heights.push(if displaces {
                Some(open(&PtexOptions {
                    filter: PtexFilter::Consistent,
                    color_space: ColorSpace::Raw,
                    ..source.options
                })?)
            } else {
                None
            });
            ptex.push(if options.clay.is_some() {
                Arc::new(PtexTexture::constant(Vec4::ONE))
            } else {
                open(&PtexOptions {
                    filter: options.ptex_filter.unwrap_or(source.options.filter),
                    ..source.options
                })?
            });
        }
        Ok(Self {
            images,
            ptex,
            heights,
            cache,
        })
    }

    /// Bytes held now.
    pub(super) fn memory(&self) -> usize {
        self.cache.held() + self.images.iter().map(|t| t.memory()).sum::<usize>()
    }

    /// Bytes that texels of Ptex files may come to take beside those that are held now.
    pub(super) fn room(&self) -> usize {
        let is_read = |texture: &Arc<PtexTexture>| texture.reader().is_some();
        if self.files().any(is_read) {
            self.cache.budget().saturating_sub(self.cache.held())
        } else {
            0
        }
    }

    /// All Ptex files, as materials and as displacement read them.
    pub(super) fn files(&self) -> impl Iterator<Item = &Arc<PtexTexture>> {
        self.ptex.iter().chain(self.heights.iter().flatten())
    }

    /// All materials, and the number of the one for faces without any.
    pub(super) fn materials(
        &self,
        description: &Description,
        options: &BuildOptions,
    ) -> (Vec<Material>, usize) {
        let face_lookup = |t: &Arc<PtexTexture>| t.clone() as Arc<dyn FaceLookup>;
        let lookups = Lookups {
            images: (self.images.iter())
                .map(|t| t.clone() as Arc<dyn Lookup>)
                .collect(),
            ptex: self.ptex.iter().map(face_lookup).collect(),
            heights: (self.heights.iter().zip(&self.ptex))
                .map(|(height, color)| face_lookup(height.as_ref().unwrap_or(color)))
                .collect(),
        };
        let mut materials: Vec<Material> = description
            .materials
            .iter()
            .map(|m| {
                let material = Material::new(m, &lookups);
                match options.clay {
                    Some(albedo) => Material::clay(Vec3::splat(albedo), Some(&material)),
                    None => material,
                }
            })
            .collect();
        let unbound = materials.len();
        materials.push(options.clay.map_or_else(Material::display_color, |albedo| {
            Material::clay(Vec3::splat(albedo), None)
        }));
        (materials, unbound)
    }

    /// Whether a shape has the faces that the Ptex files of a material are for.
    ///
    /// # Errors
    /// If it has not.
    pub(super) fn check_faces(
        &self,
        geometry: &scene::Geometry,
        material: &scene::Material,
        options: &BuildOptions,
    ) -> Result<(), Fault> {
        let surface = &material.surface;
        let maps = if options.clay.is_some() {
            displacement_map(surface).into_iter().collect()
        } else {
            surface.ptex_maps()
        };
        for map in maps {
            let files = [self.ptex.get(map.file), self.heights[map.file].as_ref()];
            let Some(reader) = files.into_iter().flatten().find_map(|t| t.reader()) else {
                continue;
            };
            let fault = |message: String| {
                Fault::new(format!(
                    "{message} {} that {} reads",
                    reader.path().display(),
                    material.path
                ))
                .advise("bind a material without it, or a Ptex file that was made for this mesh")
            };
            let mesh = match geometry {
                scene::Geometry::Mesh(mesh) if mesh.scheme != Scheme::None => mesh,
                _ => {
                    return Err(fault(
                        "it is no subdivision surface, which alone has faces for".to_owned(),
                    ));
                }
            };
            let (faces, kind) = (ptex_face_count(mesh), ptex_kind(mesh));
            if (faces, kind) != (reader.face_count(), reader.mesh_type()) {
                let name = |kind| match kind {
                    MeshType::Triangle => "triangles",
                    MeshType::Quad => "quads",
                };
                return Err(fault(format!(
                    "its {faces} Ptex faces, {}, are not the {} {} of",
                    name(kind),
                    reader.face_count(),
                    name(reader.mesh_type()),
                )));
            }
        }
        Ok(())
    }
}

fn displacement_map(surface: &PreviewSurface) -> Option<&PtexMap> {
    match &surface.displacement {
        Input::Ptex(map) => Some(map),
        _ => None,
    }
}

impl Lookup for Texture {
    fn eval(&self, st: Vec2, area: &Area) -> Vec4 {
        self.filtered(st, area)
    }
}

impl FaceLookup for PtexTexture {
    fn eval(&self, face: u32, uv: Vec2, area: &Area) -> Vec4 {
        Self::eval(self, face, uv, area)
    }
}

/// The colour in place of a texture that cannot be read, or what is wrong with it.
fn missing(
    fault: Fault,
    prim: &str,
    options: &BuildOptions,
    warnings: &mut Warnings,
) -> Result<Vec4> {
    if fault.for_want_of_memory {
        return Err(fault.at_prim(prim).into());
    }
    if let Some(colour) = options.missing_textures {
        warnings.add(format!("missing texture {fault}"), || {
            format!("{prim}: {fault}")
        });
        return Ok(colour);
    }
    let mut fault = fault.at_prim(prim);
    let go_on = "render with --missing-textures magenta";
    fault.help = Some(match fault.help {
        Some(help) => format!("{}, or {go_on}", help.trim_end_matches('.')),
        None => format!("repair the path, or {go_on}"),
    });
    Err(fault.into())
}

fn load_images(
    description: &Description,
    options: &BuildOptions,
    warnings: &mut Warnings,
) -> Result<Vec<Arc<Texture>>> {
    // Clay asks only for displacement; the others are not worth their time.
    let loaded: Vec<_> = description
        .textures
        .par_iter()
        .enumerate()
        .map(|(i, source)| {
            if options.clay.is_some() && !serves_clay(description, i) {
                return Ok(Texture::constant(Vec4::ONE));
            }
            // What else reads images looks them up one texel wide.
            let levels = options.clay.is_none() && description.is_shaded_by(i);
            let wrap = [source.wrap_s, source.wrap_t];
            Texture::load_by_coordinates(&source.image, wrap, source.color_space, levels)
        })
        .collect();
    loaded
        .into_iter()
        .zip(&description.textures)
        .map(|(texture, source)| {
            let texture = texture.or_else(|fault| {
                missing(fault, &source.prim, options, warnings).map(Texture::constant)
            })?;
            Ok(Arc::new(texture))
        })
        .collect()
}

fn serves_clay(description: &Description, texture: usize) -> bool {
    description
        .lights
        .iter()
        .any(|l| l.texture.as_ref().is_some_and(|t| t.texture == texture))
        || description.materials.iter().any(
            |m| matches!(&m.surface.displacement, Input::Texture(map) if map.texture == texture),
        )
}
