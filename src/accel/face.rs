//! Faces as trees over patches know them.

use bytemuck::{Pod, Zeroable};

use crate::surface::{FaceGrid, MOST_SEGMENTS, Surface};

/// How a face is diced.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Face {
    pub(super) face: u32,
    pub(super) size: [u16; 2],
    pub(super) segments: [u16; 4],
}

impl Face {
    pub(super) fn new(grid: &FaceGrid) -> Self {
        Self {
            face: grid.face,
            size: grid.size,
            segments: grid.segments,
        }
    }

    /// Its grid, as the first one of a surface.
    #[inline(always)]
    pub(super) fn grid(&self) -> FaceGrid {
        FaceGrid {
            face: self.face,
            size: self.size,
            segments: self.segments,
            first_vertex: 0,
            first_triangle: 0,
        }
    }

    /// Whether a surface has it, at rates that can be.
    pub(super) fn is_of(&self, surface: &Surface) -> bool {
        let base = surface.base();
        let most = MOST_SEGMENTS as u16;
        let [nu, nv] = self.size;
        let beside = [nu, nv, nu, nv];
        let rates = self.segments.iter().zip(beside);
        self.face < base.faces()
            && self.size.iter().all(|n| (1..=most).contains(n))
            && rates
                .into_iter()
                .all(|(&n, beside)| (1..=beside).contains(&n))
    }
}
