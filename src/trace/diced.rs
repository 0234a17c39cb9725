//! Diced surfaces as Embree's triangles and grids, and from a hit back to the face.
//!
//! Both show the very micro-vertices of the [`Diced`] surface, and Embree cuts the cells of a grid as it does. Attach
//! them to a robust scene: only then do rays not slip through between two triangles. Even then Embree decides at edges,
//! not at vertices: of rays that meet a micro-vertex to the bit about one in a thousand slips through, which
//! [`Tessellated`](crate::accel::Tessellated) does not let happen.

use super::device::Device;
use super::geometry::{Geometry, Grid, Handle, Kind};
use crate::accel::Copies;
use crate::error::{Error, Result};
use crate::math::Vec2;
use crate::memory::room_for;
use crate::surface::{Diced, Grids};

impl Geometry {
    /// The micro-triangles, numbered as the diced surface does. For `embree-triangles`.
    ///
    /// # Errors
    /// If there are more than Embree can number, or memory runs out.
    pub fn diced_triangles(device: &Device, diced: &Diced) -> Result<Self> {
        check_counts(diced)?;
        let mut indices = room_for(diced.triangles() as usize, "indices of micro-triangles")?;
        for grid in diced.grids() {
            indices.extend((0..grid.triangles()).map(|triangle| {
                grid.corners(triangle)
                    .map(|(i, j)| grid.vertex(i, j) as u32)
            }));
        }
        let handle = Self::triangle_handle(device, &indices, diced.positions())?;
        Ok(Self::of_diced(handle, diced))
    }

    /// One grid for each face, numbered as the diced surface's. For `embree-grid`.
    ///
    /// # Errors
    /// If there are more vertices than Embree can number, or memory runs out.
    pub fn diced_grids(device: &Device, diced: &Diced) -> Result<Self> {
        check_counts(diced)?;
        let grids: Vec<Grid> = diced
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
        let handle = Self::grid_handle(device, &grids, diced.positions())?;
        Ok(Self::of_diced(handle, diced))
    }

    /// The triangles of all tiles of a surface.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn copies(device: &Device, copies: &Copies) -> Result<Self> {
        let handle = Self::triangle_handle(device, &copies.triangles, &copies.positions)?;
        Ok(Self::from_parts(
            handle,
            Kind::Diced,
            copies.positions.len(),
        ))
    }

    /// Embree has copies of all that it needs: nothing is kept beside it.
    fn of_diced(handle: Handle, diced: &Diced) -> Self {
        let mut geometry = Self::from_parts(handle, Kind::Diced, diced.positions().len());
        geometry.flipped = diced.left_handed();
        geometry
    }
}

/// The face and the parameters on it of a hit's primitive and parameters, on [`Geometry::diced_triangles`].
///
/// # Panics
/// If the hit is on another geometry with more primitives.
pub fn diced_triangle_uv(grids: &Grids, primitive: u32, uv: Vec2) -> (u32, Vec2) {
    grids.face_uv(u64::from(primitive), uv)
}

/// The face and the parameters on it of a hit's primitive and parameters, on [`Geometry::diced_grids`].
///
/// # Panics
/// If the hit is on another geometry with more primitives.
pub fn diced_grid_uv(grids: &Grids, primitive: u32, uv: Vec2) -> (u32, Vec2) {
    let grid = grids.get(primitive);
    (grid.face, grid.grid_uv(uv))
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
