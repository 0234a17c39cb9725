//! What is kept of a surface beside its micro-vertices: the lattice, how faces are diced, and the tree over patches.

use bytemuck::{Pod, Zeroable};
use mapped::Items;

use super::block::{CELLS, SIDE};
use super::patch::{FAN, Fan, Patch, SPAN};
use super::traverse::Met;
use crate::accel::Hit;
use crate::accel::lattice::Lattice;
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::math::{Bounds3, DVec3, Ray, Vec2};
use crate::surface::FaceGrid;

/// A surface's patches without what is in them.
pub(in crate::accel) struct Skeleton {
    pub(in crate::accel) isa: Isa,
    pub(in crate::accel) lattice: Lattice,
    /// The largest coordinate on the lattice.
    pub(in crate::accel) reach: f32,
    pub(in crate::accel) keys: u32,
    pub(in crate::accel) left_handed: bool,
    /// Those that are not holes.
    pub(in crate::accel) faces: Items<Face>,
    /// The tree over the patches, which are in its order.
    pub(in crate::accel) top: Top,
    pub(in crate::accel) patches: Items<Patch>,
}

/// How a face is diced.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::accel) struct Face {
    pub(super) face: u32,
    pub(super) size: [u16; 2],
    pub(super) segments: [u16; 4],
}

impl Face {
    pub(in crate::accel) fn new(grid: &FaceGrid) -> Self {
        Self {
            face: grid.face,
            size: grid.size,
            segments: grid.segments,
        }
    }

    /// Its grid, as the first one of a surface.
    #[inline(always)]
    pub(in crate::accel) fn grid(&self) -> FaceGrid {
        FaceGrid {
            face: self.face,
            size: self.size,
            segments: self.segments,
            first_vertex: 0,
            first_triangle: 0,
        }
    }
}

impl Skeleton {
    #[inline(always)]
    pub(in crate::accel) fn fan(&self, patch: &Patch) -> Fan {
        patch.fan(self.faces[patch.face as usize].size)
    }

    #[inline(always)]
    pub(in crate::accel) fn has_node(&self, fan: &Fan) -> bool {
        self.keys > 1 || !fan.is_single()
    }

    /// Bytes held.
    pub(in crate::accel) fn memory(&self) -> usize {
        self.top.memory() + size_of_val(&*self.faces) + size_of_val(&*self.patches)
    }

    /// Around everything at a motion key.
    pub(in crate::accel) fn bounds(&self, key: u32) -> Bounds3 {
        self.lattice.bounds(&self.top.extent(key as usize))
    }

    /// What a ray met: a triangle with these corners on the lattice.
    #[inline(always)]
    pub(super) fn hit(&self, ray: &Ray, met: &Met, [a, b, c]: [DVec3; 3]) -> Hit {
        let patch = &self.patches[met.patch as usize];
        let normal = (b - a).cross(c - a);
        let normal = if self.left_handed { -normal } else { normal };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let point = self.lattice.on_lattice(ray.at(met.hit.t));
        let distance = normal.dot(point - a).abs() / normal.length().max(f64::MIN_POSITIVE);
        let distance = distance * self.lattice.step();
        let face = &self.faces[patch.face as usize];
        let grid = face.grid();
        let at = |patch: u16, block: usize, cell: usize| {
            (SPAN * usize::from(patch) + CELLS * block + cell) as u16
        };
        let column = at(patch.column, met.block % FAN, met.cell % SIDE);
        let row = at(patch.row, met.block / FAN, met.cell / SIDE);
        let weights = Vec2::new(met.hit.u, met.hit.v);
        Hit {
            t: met.hit.t,
            face: face.face,
            uv: grid.cell_uv((column, row), met.second, weights),
            normal: normal.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }
}
