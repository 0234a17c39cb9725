//! Materials as one shape wears them: an input that reads a primvar which is the same all over the shape needs no
//! look at each hit.

use std::collections::HashMap;

use crate::mesh::{ControlMesh, Interpolation};
use crate::scene::{self, Description};
use crate::shade::material::Material;
use crate::shade::texture_map::Primvars;

/// Which number each material has on one shape.
pub(super) struct Worn<'a> {
    mesh: &'a ControlMesh,
    /// Whether a place of the shape has a colour of its own.
    recoloured: bool,
    numbers: HashMap<usize, u32>,
    /// Whether any of them lets light through.
    pub(super) transparent: bool,
}

impl<'a> Worn<'a> {
    pub(super) fn new(shape: &'a scene::Shape, places: &[u32], description: &Description) -> Self {
        let has_colour = |&place: &u32| {
            let placement = &description.placements[place as usize];
            placement.display_color.is_some()
        };
        Self {
            mesh: &shape.mesh,
            recoloured: places.iter().any(has_colour),
            numbers: HashMap::new(),
            transparent: false,
        }
    }

    /// The number on this shape of the material `m` of `materials`: its own, or that of a constant one which is
    /// added.
    pub(super) fn number(&mut self, m: usize, materials: &mut Vec<Material>) -> u32 {
        if let Some(&number) = self.numbers.get(&m) {
            return number;
        }
        let mut number = m;
        if let Some(constant) = materials[m].constant_on(self, |name| self.varies(name)) {
            number = materials.len();
            materials.push(constant);
        }
        self.transparent |= materials[number].may_be_transparent();
        self.numbers.insert(m, number as u32);
        number as u32
    }

    fn varies(&self, name: &str) -> bool {
        let varying = |i| i != Interpolation::Constant;
        name == "displayColor" && self.recoloured
            || (self.mesh.primvar(name)).is_some_and(|p| varying(p.interpolation))
    }
}

/// Those that do not vary.
impl Primvars for Worn<'_> {
    fn get(&self, name: &str, out: &mut [f32]) -> bool {
        match self.mesh.primvar(name) {
            Some(primvar) if primvar.width as usize >= out.len() => {
                out.copy_from_slice(&primvar.get(0)[..out.len()]);
                true
            }
            _ => false,
        }
    }
}
