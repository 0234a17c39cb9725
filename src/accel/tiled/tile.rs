//! What a tile holds, in a tree: triangles where they stand in it, and those of the tiles beside it that reach into it.

use std::sync::Arc;

use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::{LANES, Lanes};
use crate::accel::top::{Top, TopNode};
use crate::math::{Bounds3, DVec3, DVec4, Vec3};
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
    /// The corners of what is placed, coordinate by coordinate, after and before as many zeros as lanes may reach beyond.
    corners: [[Vec<f32>; 3]; 3],
    pub(super) tiles: Arc<Tiles>,
}

/// A triangle that is seen in a tile, moved there by whole tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) triangle: u32,
    shift: [i16; 2],
}

/// Tiles that a triangle may reach beyond its own.
const MOST_SHIFT: f32 = 8.0;

/// Boxes are no longer, in tiles or their heights.
const LONGEST: f64 = 1.0 / 16.0;

/// No coordinate of a triangle that a ray meets is farther from the ray's, and sheared.
const REACH: f32 = 4.0 * MOST_SHIFT;

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
                    let within = clipped(&corners, &SQUARE);
                    if within.len() < 3 {
                        continue;
                    }
                    for piece in pieces(&within) {
                        let on_lattice: Vec<DVec3> = piece
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
        }
        let reach = (0.5 / lattice.step) + 1.0;
        let (top, order) = Top::new(vec![extents]);
        let placed: Vec<Placed> = order.iter().map(|&i| placed[i as usize]).collect();
        let corners = [0, 1, 2].map(|corner| {
            [0, 1, 2].map(|axis| {
                let of = |placed: &Placed| corners_of(tiles, *placed)[corner][axis] as f32;
                let zeros = || std::iter::repeat_n(0.0, LANES);
                zeros()
                    .chain(placed.iter().map(of))
                    .chain(zeros())
                    .collect()
            })
        });
        Self {
            lattice,
            reach,
            top,
            placed,
            corners,
            tiles: tiles.clone(),
        }
    }

    /// Of the children of a node that are triangles, those that a ray may meet that is no farther off the straight one from
    /// `origin` than that says, and all others that are given, as bits.
    #[inline(always)]
    pub(super) fn passed<L: Lanes>(
        &self,
        lanes: L,
        node: &TopNode,
        met: u32,
        ray: &Straight,
        origin: Vec3,
    ) -> u32 {
        let (patches, first) = node.patches();
        if met & patches == 0 {
            return met;
        }
        let first = (first + LANES as i64) as usize;
        let mut x = [lanes.floats(0.0); 3];
        let mut y = x;
        let [kx, ky, kz] = ray.k;
        for corner in 0..3 {
            let of = &self.corners[corner];
            let z = coordinate(lanes, &of[kz], first, origin[kz]);
            let from_x = coordinate(lanes, &of[kx], first, origin[kx]);
            let from_y = coordinate(lanes, &of[ky], first, origin[ky]);
            x[corner] = lanes.sub(from_x, lanes.mul(z, lanes.floats(ray.shear[0])));
            y[corner] = lanes.sub(from_y, lanes.mul(z, lanes.floats(ray.shear[1])));
        }
        let (off_x, off_y) = (lanes.floats(ray.off[0]), lanes.floats(ray.off[1]));
        let zero = lanes.floats(0.0);
        // Coordinates are rounded a few times, and so are products of them.
        let mut size = zero;
        for corner in 0..3 {
            let own = lanes.add(lanes.abs(x[corner]), lanes.abs(y[corner]));
            size = lanes.max(size, own);
        }
        let few = lanes.floats(8.0 * f32::EPSILON);
        let rounding = lanes.mul(lanes.mul(few, size), lanes.add(size, lanes.floats(REACH)));
        let (mut before, mut after) = (0, 0);
        for corner in 0..3 {
            let next = if corner == 2 { 0 } else { corner + 1 };
            let value = lanes.sub(lanes.mul(x[corner], y[next]), lanes.mul(y[corner], x[next]));
            // By how much it may be another where the ray is elsewhere.
            let by_x = lanes.mul(off_x, lanes.abs(lanes.sub(y[next], y[corner])));
            let by_y = lanes.mul(off_y, lanes.abs(lanes.sub(x[next], x[corner])));
            let slack = lanes.add(lanes.add(by_x, by_y), rounding);
            before |= lanes.less(lanes.add(value, slack), zero);
            after |= lanes.less(zero, lanes.sub(value, slack));
        }
        met & !(patches & before & after)
    }

    /// The corners of what is placed, in the coordinates of the tile.
    #[inline(always)]
    pub(super) fn corners(&self, placed: Placed) -> [DVec3; 3] {
        corners_of(&self.tiles, placed)
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.top.memory() + size_of_val(self.placed.as_slice()) + self.tiles.memory()
    }
}

/// A polygon cut across its longest axis, where that is long: boxes around pieces of slanting slivers hold less of nothing.
fn pieces(polygon: &[DVec3]) -> Vec<Vec<DVec3>> {
    let low = polygon.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = polygon
        .iter()
        .copied()
        .fold(DVec3::NEG_INFINITY, DVec3::max);
    let extent = high - low;
    let axis = extent.max_position();
    let count = (extent[axis] / LONGEST).ceil().max(1.0);
    let at = |k: f64| low[axis] + extent[axis] * k / count;
    let unit = DVec3::AXES[axis];
    let piece = |k: usize| {
        let (from, to) = (at(k as f64), at(k as f64 + 1.0));
        clipped(polygon, &[unit.extend(-from), (-unit).extend(to)])
    };
    (0..count as usize).map(piece).collect()
}

/// The way of a straight ray, which is a point in a plane: the third of its axes is the one along which it runs most, and the
/// others are sheared along it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Straight {
    k: [usize; 3],
    shear: [f32; 2],
    /// How far from it the ray itself may be in that plane.
    off: [f32; 2],
}

impl Straight {
    /// Along `direction`, with `off` axis by axis.
    #[inline(always)]
    pub(super) fn new(direction: Vec3, off: Vec3) -> Self {
        let size = direction.abs();
        let mut k = [1, 2, 0];
        if size.y > size[k[2]] {
            k = [2, 0, 1];
        }
        if size.z > size[k[2]] {
            k = [0, 1, 2];
        }
        let [x, y, z] = k;
        let shear = [direction[x] / direction[z], direction[y] / direction[z]];
        Self {
            k,
            shear,
            off: [
                off[x] + shear[0].abs() * off[z],
                off[y] + shear[1].abs() * off[z],
            ],
        }
    }
}

#[inline(always)]
fn coordinate<L: Lanes>(lanes: L, of: &[f32], first: usize, origin: f32) -> L::Floats {
    let mut values = [0.0; LANES];
    values.copy_from_slice(&of[first..first + LANES]);
    lanes.sub(lanes.load(&values), lanes.floats(origin))
}

#[inline(always)]
fn corners_of(tiles: &Tiles, placed: Placed) -> [DVec3; 3] {
    let [a, b, c] = tiles.triangles()[placed.triangle as usize];
    let points = tiles.points();
    let shift = DVec3::new(placed.shift[0].into(), placed.shift[1].into(), 0.0);
    [
        points[a as usize].as_dvec3() + shift,
        points[b as usize].as_dvec3() + shift,
        points[c as usize].as_dvec3() + shift,
    ]
}

/// A half of space: where a point, with 1 for a fourth coordinate, times this is not below 0.
pub(super) type Half = DVec4;

/// The halves of which 0..1 in u and v are what is common.
const SQUARE: [Half; 4] = [
    DVec4::new(1.0, 0.0, 0.0, 0.0),
    DVec4::new(-1.0, 0.0, 0.0, 1.0),
    DVec4::new(0.0, 1.0, 0.0, 0.0),
    DVec4::new(0.0, -1.0, 0.0, 1.0),
];

/// The part of a convex polygon that is in all of some halves (Sutherland and Hodgman, "Reentrant Polygon Clipping", 1974).
pub(super) fn clipped(polygon: &[DVec3], halves: &[Half]) -> Vec<DVec3> {
    let mut polygon = polygon.to_vec();
    for half in halves {
        let side = |p: &DVec3| p.extend(1.0).dot(*half);
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
