//! Materials as one shape wears them: the primvars that a material reads are looked up once, by name, so that a hit
//! only counts in lists; and an input that reads a primvar which is the same all over the shape needs no look at all.

use std::collections::HashMap;
use std::sync::Arc;

use super::shape::Surface;
use crate::mesh::Interpolation;
use crate::scene::{Binding, Description, Geometry};
use crate::shade::material::Material;
use crate::shade::texture_map::{Primvars, Read};

/// A material on a shape.
pub(super) struct Worn {
    pub(super) material: Arc<Material>,
    /// By the material's reads.
    pub(super) found: Vec<Found>,
}

/// Where a shape has what a material reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    /// The shape's slot, if it has the primvar.
    pub(super) slot: Option<usize>,
    /// Whether the colour of a place comes before it, where a place has one.
    pub(super) is_color: bool,
}

/// All materials as shapes wear them, and the materials that they are made of.
pub(super) struct Wardrobe {
    /// The description's, and behind them the one for faces without any.
    pub(super) materials: Vec<Arc<Material>>,
    pub(super) worn: Vec<Worn>,
}

/// One shape, as it is dressed.
pub(super) struct Wearer<'a> {
    wardrobe: &'a mut Wardrobe,
    geometry: &'a Geometry,
    surface: &'a Surface,
    /// Whether a place of the shape has a colour of its own.
    recoloured: bool,
    /// By material.
    numbers: HashMap<usize, u32>,
    /// Whether any of them lets light through.
    pub(super) transparent: bool,
}

impl Wardrobe {
    pub(super) fn new(materials: Vec<Material>) -> Self {
        Self {
            materials: materials.into_iter().map(Arc::new).collect(),
            worn: Vec::new(),
        }
    }

    /// The number of the material for faces without any.
    pub(super) fn unbound(&self) -> usize {
        self.materials.len() - 1
    }
}

impl<'a> Wearer<'a> {
    pub(super) fn new(
        wardrobe: &'a mut Wardrobe,
        geometry: &'a Geometry,
        surface: &'a Surface,
        places: &[u32],
        description: &Description,
    ) -> Self {
        let has_colour = |&place: &u32| {
            let placement = &description.placements[place as usize];
            placement.display_color.is_some()
        };
        Self {
            wardrobe,
            geometry,
            surface,
            recoloured: places.iter().any(has_colour),
            numbers: HashMap::new(),
            transparent: false,
        }
    }

    /// What the faces wear, by number in the wardrobe: one for each face, or one for all if there is but one.
    pub(super) fn by_face(&mut self, binding: &Binding) -> Vec<u32> {
        let mut worn = vec![self.number(binding.whole)];
        if !binding.subsets.is_empty() {
            worn.resize(self.geometry.face_count(), worn[0]);
            for subset in &binding.subsets {
                let number = self.number(subset.material);
                for &face in &subset.faces {
                    if let Some(worn) = worn.get_mut(face as usize) {
                        *worn = number;
                    }
                }
            }
        }
        worn
    }

    /// The number in the wardrobe of a material of the description on this shape.
    pub(super) fn number(&mut self, material: Option<usize>) -> u32 {
        let m = material.unwrap_or(self.wardrobe.unbound());
        if let Some(&number) = self.numbers.get(&m) {
            return number;
        }
        let material = &self.wardrobe.materials[m];
        let fixed = Fixed {
            geometry: self.geometry,
            reads: material.reads(),
        };
        let constant = material.constant_on(&fixed, |name| self.varies(name));
        let material = constant.map_or_else(|| material.clone(), Arc::new);
        self.transparent |= material.may_be_transparent();
        let found = |read: &Read| Found {
            slot: self.surface.slot(read),
            is_color: read.name == "displayColor" && read.width == 3,
        };
        let found = material.reads().iter().map(found).collect();
        let number = self.wardrobe.worn.len() as u32;
        self.wardrobe.worn.push(Worn { material, found });
        self.numbers.insert(m, number);
        number
    }

    fn varies(&self, name: &str) -> bool {
        let varying = |i| i != Interpolation::Constant;
        name == "displayColor" && self.recoloured
            || (self.geometry.primvar(name)).is_some_and(|p| varying(p.interpolation))
    }
}

/// The primvars of a shape that do not vary.
struct Fixed<'a> {
    geometry: &'a Geometry,
    reads: &'a [Read],
}

impl Primvars for Fixed<'_> {
    fn get(&self, read: usize, out: &mut [f32]) -> bool {
        match self.geometry.primvar(&self.reads[read].name) {
            Some(primvar) if primvar.width as usize >= out.len() => {
                out.copy_from_slice(&primvar.get(0)[..out.len()]);
                true
            }
            _ => false,
        }
    }
}
