//! What is kept of a surface beside its micro-vertices: the lattice, how faces are diced, and the tree over patches.

use mapped::Items;

use super::block::{CELLS, SIDE};
use super::patch::{FAN, Fan, Patch, SPAN};
use super::traverse::Met;
use crate::accel::Hit;
use crate::accel::face::Face;
use crate::accel::lattice::Lattice;
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::math::{Bounds3, Ray, Vec2, Vec3};

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

impl Skeleton {
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

    /// What a ray met.
    #[inline(always)]
    pub(super) fn hit(&self, ray: &Ray, met: &Met) -> Hit {
        let [a, b, c] = met.corners.map(|p| Vec3::from(p).as_dvec3());
        let patch = &self.patches[met.patch as usize];
        let normal = (b - a).cross(c - a);
        let normal = if self.left_handed { -normal } else { normal };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let point = self.lattice.on_lattice(ray.at(met.hit.t));
        let distance = normal.dot(point - a).abs() / normal.length().max(f64::MIN_POSITIVE);
        let distance = distance * self.lattice.step();
        let face = &self.faces[patch.face as usize];
        let grid = face.grid();
        let at = |patch: u8, block: usize, cell: usize| {
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
