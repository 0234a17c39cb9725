//! Diced surfaces as Embree's triangles and grids, and from a hit back to the face.
//!
//! Both show the very micro-vertices of the [`Diced`] surface, and Embree cuts the cells of a grid as it does. Attach
//! them to a robust scene: only then do rays not slip through between two triangles. Even then Embree decides at edges,
//! not at vertices: of rays that meet a micro-vertex to the bit about one in a thousand slips through, which
//! [`Tessellated`](crate::accel::Tessellated) does not let happen.

use super::device::Device;
use super::geometry::{Geometry, Grid};
use super::scene::SceneHit;
use crate::error::{Error, Result};
use crate::math::Vec2;
use crate::surface::Diced;

impl Geometry {
    /// The micro-triangles, numbered as the diced surface does. For `embree-triangles`.
    ///
    /// # Errors
    /// If there are more than Embree can number, or memory runs out.
    pub fn diced_triangles(device: &Device, diced: &Diced) -> Result<Self> {
        check_counts(diced)?;
        let mut indices = Vec::with_capacity(diced.triangles() as usize);
        for grid in diced.grids() {
            indices.extend((0..grid.triangles()).map(|triangle| {
                grid.corners(triangle)
                    .map(|(i, j)| grid.vertex(i, j) as u32)
            }));
        }
        let mut geometry = Self::triangles(device, indices, diced.positions().clone())?;
        geometry.flipped = diced.left_handed();
        Ok(geometry)
    }

    /// One grid for each face, numbered as the diced surface's. For `embree-grid`.
    ///
    /// # Errors
    /// If there are more vertices than Embree can number, or memory runs out.
    pub fn diced_grids(device: &Device, diced: &Diced) -> Result<Self> {
        check_counts(diced)?;
        let grids = diced
            .grids()
            .iter()
            .map(|grid| {
                let [width, height] = grid.size.map(|n| n + 1);
                Grid {
                    start_vertex: grid.first_vertex as u32,
                    stride: u32::from(width),
                    width,
                    height,
                }
            })
            .collect();
        let mut geometry = Self::grid(device, grids, diced.positions().clone())?;
        geometry.flipped = diced.left_handed();
        Ok(geometry)
    }
}

/// The face and the parameters on it of a hit on [`Geometry::diced_triangles`].
///
/// # Panics
/// If the hit is on another geometry with more primitives.
pub fn diced_triangle_uv(diced: &Diced, hit: &SceneHit) -> (u32, Vec2) {
    diced.face_uv(u64::from(hit.primitive), hit.uv)
}

/// The face and the parameters on it of a hit on [`Geometry::diced_grids`].
///
/// # Panics
/// If the hit is on another geometry with more primitives.
pub fn diced_grid_uv(diced: &Diced, hit: &SceneHit) -> (u32, Vec2) {
    let grid = &diced.grids()[hit.primitive as usize];
    (grid.face, grid.grid_uv(hit.uv))
}

fn check_counts(diced: &Diced) -> Result<()> {
    let vertices = diced.positions().first().map_or(0, Vec::len) as u64;
    let most = u64::from(u32::MAX);
    if vertices <= most && diced.triangles() <= most {
        return Ok(());
    }
    Err(Error::Memory {
        message: format!(
            "{} micro-triangles over {vertices} vertices in one object, where Embree counts to {most}",
            diced.triangles()
        ),
        help: Some("Raise the dicing rate, or lower the most segments of an edge.".into()),
    })
}
