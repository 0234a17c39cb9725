//! Materials of an OBJ: which face has which, and `Kd` and `map_Kd` of its libraries. Nothing else is honoured.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use super::super::{
    Binding, Channels, ColorSpace, Description, ImageSource, Input, Material, PreviewSurface,
    Subset, TextureMap, TextureSource, Transform2d, Wrap,
};
use crate::error::Warnings;
use crate::math::{Vec3, Vec4};

/// Names of materials, who has them, and what the libraries say.
#[derive(Default)]
pub(super) struct Materials {
    names: Vec<String>,
    by_name: HashMap<String, u32>,
    current: Option<u32>,
    of_face: Vec<Option<u32>>,
    libraries: Vec<PathBuf>,
    known: HashMap<String, tobj::Material>,
}

impl Materials {
    /// Faces from here on have this material.
    pub(super) fn select(&mut self, name: &str) {
        let number = self.names.len() as u32;
        let number = *self.by_name.entry(name.to_owned()).or_insert(number);
        if number as usize == self.names.len() {
            self.names.push(name.to_owned());
        }
        self.current = Some(number);
    }

    /// Notes one more face.
    pub(super) fn face(&mut self) {
        self.of_face.push(self.current);
    }

    /// Reads a library.
    pub(super) fn library(&mut self, path: PathBuf, bytes: &[u8], warnings: &mut Warnings) {
        // tobj 4.0 panics on a colour with fewer than three numbers.
        let read = catch_unwind(AssertUnwindSafe(|| tobj::load_mtl_buf(&mut &*bytes)));
        match read {
            Ok(Ok((materials, _))) => {
                self.known
                    .extend(materials.into_iter().map(|m| (m.name.clone(), m)));
            }
            _ => warnings.add("obj-material-library", || {
                format!(
                    "{}: not a material library that can be read",
                    path.display()
                )
            }),
        }
        self.libraries.push(path);
    }

    /// Adds materials and textures to the description.
    pub(super) fn finish(self, obj: &Path, description: &mut Description) -> Binding {
        let folder = obj.parent().unwrap_or(Path::new(""));
        for name in &self.names {
            if !self.known.contains_key(name) {
                description.warnings.add("obj-material", || {
                    format!("the material {name} is in no library that could be read")
                });
            }
            let surface = self
                .known
                .get(name)
                .map(|m| surface(m, name, folder, description))
                .unwrap_or_default();
            description.materials.push(Material {
                path: format!("/{name}"),
                surface,
            });
        }
        description.files.extend(self.libraries);

        let first = self.of_face.first().copied().flatten();
        if self.of_face.iter().all(|&m| m == first) {
            return Binding {
                whole: first.map(|m| m as usize),
                subsets: Vec::new(),
            };
        }
        let mut subsets: Vec<Subset> = (0..self.names.len())
            .map(|material| Subset {
                faces: Vec::new(),
                material: Some(material),
            })
            .collect();
        for (face, material) in (0..).zip(self.of_face) {
            if let Some(material) = material {
                subsets[material as usize].faces.push(face);
            }
        }
        subsets.retain(|s| !s.faces.is_empty());
        Binding {
            whole: None,
            subsets,
        }
    }
}

fn surface(
    material: &tobj::Material,
    name: &str,
    folder: &Path,
    description: &mut Description,
) -> PreviewSurface {
    let color = material
        .diffuse
        .map(Vec3::from)
        .filter(|c| c.is_finite())
        .map(|c| c.max(Vec3::ZERO));
    let Some(image) = &material.diffuse_texture else {
        let default = PreviewSurface::default();
        return PreviewSurface {
            diffuse_color: color.map_or(default.diffuse_color.clone(), Input::Value),
            ..default
        };
    };
    // Options such as -s come before the name.
    let image = match image.starts_with('-') {
        true => image.split_whitespace().last().unwrap_or_default(),
        false => image,
    };
    description.textures.push(TextureSource {
        image: ImageSource::File(folder.join(image.replace('\\', "/"))),
        prim: format!("/{name}"),
        wrap_s: Wrap::Repeat,
        wrap_t: Wrap::Repeat,
        color_space: ColorSpace::Auto,
    });
    // Kd multiplies the image; exporters that write black mean the image alone.
    let scale = color.filter(|c| *c != Vec3::ZERO).unwrap_or(Vec3::ONE);
    let map = TextureMap {
        texture: description.textures.len() - 1,
        primvar: "st".into(),
        transform: Transform2d::default(),
        channels: Channels::Rgb,
        scale: scale.extend(1.0),
        bias: Vec4::ZERO,
        fallback: scale.extend(1.0),
    };
    PreviewSurface {
        diffuse_color: Input::Texture(map),
        ..PreviewSurface::default()
    }
}
