//! What a tile holds, in a tree: triangles where they stand in it, and those of the tiles beside it that reach into it.

use std::sync::Arc;

use crate::accel::lattice::{Extent, Lattice};
use crate::accel::top::Top;
use crate::math::{Bounds3, DVec3, Vec3};
use crate::surface::Tiles;

/// A tile.
pub(super) struct Tile {
    /// Around the unit cube.
    pub(super) lattice: Lattice,
    /// The largest coordinate on it.
    pub(super) reach: f32,
    /// The tree over what is placed, which is in its order.
    pub(super) top: Top,
    pub(super) placed: Vec<Placed>,
    pub(super) tiles: Arc<Tiles>,
}

/// A triangle that is seen in a tile, moved there by whole tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) triangle: u32,
    shift: [i16; 2],
}

/// Tiles that a triangle may reach beyond its own.
const MOST_SHIFT: f32 = 1000.0;

impl Tile {
    pub(super) fn new(tiles: &Arc<Tiles>) -> Self {
        let unit = Bounds3 {
            min: Vec3::ZERO,
            max: Vec3::ONE,
        };
        let lattice = Lattice::around(&unit, 1.0 / (1 << 20) as f32);
        let mut placed = Vec::new();
        let mut extents = Vec::new();
        for (number, triangle) in tiles.triangles().iter().enumerate() {
            let corners = triangle.map(|i| tiles.points()[i as usize]);
            let [low, high] = [corners[0].min(corners[1]), corners[0].max(corners[1])];
            let [low, high] = [low.min(corners[2]), high.max(corners[2])];
            let cells = |k: usize| {
                let bound = |x: f32| x.clamp(-MOST_SHIFT, MOST_SHIFT);
                let first = bound(low[k].floor());
                first as i16..=bound((high[k].ceil() - 1.0).max(first)) as i16
            };
            for j in cells(1) {
                for i in cells(0) {
                    let cell = DVec3::new(i.into(), j.into(), 0.0);
                    let corners = corners.map(|p| p.as_dvec3() - cell);
                    let within = clipped(&corners, &square());
                    if within.len() < 3 {
                        continue;
                    }
                    let on_lattice: Vec<DVec3> = within
                        .into_iter()
                        .map(|p| (p - lattice.anchor.as_dvec3()) / lattice.step())
                        .collect();
                    extents.push(Extent::around(&on_lattice));
                    placed.push(Placed {
                        triangle: number as u32,
                        shift: [-i, -j],
                    });
                }
            }
        }
        let reach = (0.5 / lattice.step) + 1.0;
        let (top, order) = Top::new(vec![extents]);
        Self {
            lattice,
            reach,
            top,
            placed: order.iter().map(|&i| placed[i as usize]).collect(),
            tiles: tiles.clone(),
        }
    }

    /// The corners of what is placed, in the coordinates of the tile.
    #[inline(always)]
    pub(super) fn corners(&self, placed: Placed) -> [DVec3; 3] {
        let [a, b, c] = self.tiles.triangles()[placed.triangle as usize];
        let points = self.tiles.points();
        let shift = DVec3::new(placed.shift[0].into(), placed.shift[1].into(), 0.0);
        [
            points[a as usize].as_dvec3() + shift,
            points[b as usize].as_dvec3() + shift,
            points[c as usize].as_dvec3() + shift,
        ]
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.top.memory() + size_of_val(self.placed.as_slice()) + self.tiles.memory()
    }
}

/// A half of space over the plane of u and v: where the first two numbers by u and v, plus the third, are not below 0.
pub(super) type Half = [f64; 3];

/// The halves of which 0..1 in u and v are what is common.
fn square() -> [Half; 4] {
    [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 1.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 1.0],
    ]
}

/// The part of a convex polygon that is in all of some halves (Sutherland and Hodgman, "Reentrant Polygon Clipping", 1974).
pub(super) fn clipped(polygon: &[DVec3], halves: &[Half]) -> Vec<DVec3> {
    let mut polygon = polygon.to_vec();
    for [x, y, z] in halves {
        let side = |p: &DVec3| x * p.x + y * p.y + z;
        let mut rest = Vec::with_capacity(polygon.len() + 1);
        for (k, a) in polygon.iter().enumerate() {
            let b = &polygon[(k + 1) % polygon.len()];
            let (from, to) = (side(a), side(b));
            if from >= 0.0 {
                rest.push(*a);
            }
            if (from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0) {
                rest.push(*a + from / (from - to) * (*b - *a));
            }
        }
        polygon = rest;
    }
    polygon
}
