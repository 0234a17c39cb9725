//! Which images and Ptex files a material reads.

use super::{Description, Input, NormalMap, PreviewSurface, PtexMap, TextureMap};
use crate::math::Vec3;

impl Description {
    /// Whether the shading of any material reads an image: displacement and lights do not count.
    pub fn is_shaded_by(&self, texture: usize) -> bool {
        let surfaces = self.materials.iter().map(|m| &m.surface);
        let mut images = surfaces.flat_map(PreviewSurface::shading_images);
        images.any(|map| map.texture == texture)
    }
}

impl PreviewSurface {
    /// The images that its inputs read, but for its displacement.
    pub fn shading_images(&self) -> Vec<&TextureMap> {
        fn of<T>(input: &Input<T>) -> Option<&TextureMap> {
            match input {
                Input::Texture(map) => Some(map),
                _ => None,
            }
        }
        let mut maps = self.shading_maps(of, of);
        if let Some(NormalMap::Image(map)) = &self.normal {
            maps.push(map);
        }
        maps
    }

    /// The Ptex files that its inputs read.
    pub fn ptex_maps(&self) -> Vec<&PtexMap> {
        fn of<T>(input: &Input<T>) -> Option<&PtexMap> {
            match input {
                Input::Ptex(map) => Some(map),
                _ => None,
            }
        }
        let mut maps = self.shading_maps(of, of);
        maps.extend(of(&self.displacement));
        if let Some(NormalMap::Ptex(map)) = &self.normal {
            maps.push(map);
        }
        maps
    }

    /// What is found in the inputs that colours and numbers of the shading come from.
    fn shading_maps<'a, M>(
        &'a self,
        of_color: fn(&'a Input<Vec3>) -> Option<&'a M>,
        of_number: fn(&'a Input<f32>) -> Option<&'a M>,
    ) -> Vec<&'a M> {
        let colors = [
            &self.diffuse_color,
            &self.emissive_color,
            &self.specular_color,
        ];
        let numbers = [
            &self.metallic,
            &self.roughness,
            &self.clearcoat,
            &self.clearcoat_roughness,
            &self.opacity,
            &self.ior,
        ];
        let colors = colors.into_iter().filter_map(of_color);
        colors
            .chain(numbers.into_iter().filter_map(of_number))
            .collect()
    }
}
