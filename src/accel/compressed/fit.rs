//! Fitting tiles to micro-vertices.
//!
//! The plane of least squares gives u and v; the main direction of what is left gives h, if it is anywhere near the
//! plane's normal. Everything after that is measured in the coordinates as they were rounded: they need not be good
//! ones for slabs to enclose the surface.

use glam::DMat3;

use super::tile::{Axis, FAN, Parts, Tile, WIDEST, cut, leaves};
use crate::accel::lattice::REACH;
use crate::accel::simd::LANES;
use crate::math::DVec3;

/// The finest step of a height: less than an eighth of a lattice step or a part of a quad is not worth telling.
const FINEST_STEP: f64 = 0.125;
const FINEST_PART: f64 = 1.0 / 1024.0;

/// Heights that corners span.
const SPAN: f64 = 253.0;

/// Less than this sine between u and v, or cosine between h and the normal, and coordinates are worth nothing.
const LEAST_ANGLE: f64 = 0.05;
const LEAST_SLANT: f64 = 0.25;

/// Steeper surfaces, by the sine of heights to quads, have no slopes that are worth following.
const LEAST_TURN: f64 = 1e-4;

/// No height is larger: depths could not be told.
const HIGHEST: f64 = 65536.0;

/// The tiles of some quads at all motion keys, and how thick the slab of each leaf is at each, in lattice steps. Vertices
/// are given by key, row by row, on the lattice.
pub(super) fn tiles(keys: &[Vec<DVec3>], quads: [usize; 2]) -> (Vec<Tile>, Vec<f64>) {
    let planes: Vec<Plane> = keys.iter().map(|key| Plane::of(key, quads)).collect();
    let axes = axes(keys, &planes, quads);
    let steps = axes.map(|axis| axis.steps());
    let placed: Vec<Placed> = (keys.iter().zip(&planes))
        .map(|(key, plane)| Placed::new(key, plane, steps, quads))
        .collect();
    let mut depths = vec![[[0.0; 2]; LANES]; keys.len()];
    for (key, depths) in depths.iter_mut().enumerate() {
        for leaf in of_tile(quads) {
            depths[leaf.lane()] = placed[key].depths(&leaf, quads);
        }
    }
    // A plane that turns while its points move is not what blended planes are, at the same points.
    for key in 1..keys.len() {
        for leaf in of_tile(quads) {
            let [a, b] = [&placed[key - 1], &placed[key]];
            let (slopes, later) = (a.slopes(&leaf), b.slopes(&leaf));
            let most = leaf.vertices(quads).map(|v| {
                let moved = (b.at[v] - a.at[v]).abs();
                let turned = [0, 1].map(|k| (later[k] - slopes[k]).abs());
                0.25 * (turned[0] * moved.x + turned[1] * moved.y)
            });
            let most = most.fold(0.0, f64::max);
            for depths in &mut depths[key - 1..=key] {
                for depth in &mut depths[leaf.lane()] {
                    *depth += most;
                }
            }
        }
    }
    let mut thick = Vec::new();
    let tiles = placed.iter().zip(&depths).map(|(placed, depths)| {
        for leaf in of_tile(quads) {
            let [u, v] = placed.slopes(&leaf);
            let up = steps[2] - u * steps[0] - v * steps[1];
            thick.push((depths[leaf.lane()][0] + depths[leaf.lane()][1]) / up.length());
        }
        Tile::new(&Parts {
            origin: placed.origin,
            axes,
            heights: placed.heights,
            depths: depths.map(|depths| depths.map(up)),
            sides: placed.sides(quads),
        })
    });
    (tiles.collect(), thick)
}

/// A little more, in single precision.
fn up(value: f64) -> f32 {
    (value + 1e-6 * value.abs()) as f32
}

/// A leaf of a tile.
#[derive(Clone, Copy)]
struct Leaf {
    i: usize,
    j: usize,
    /// First and last columns of vertices, and rows.
    ends: [[usize; 2]; 2],
}

fn of_tile([nu, nv]: [usize; 2]) -> impl Iterator<Item = Leaf> {
    let ends = |leaf, quads| [cut(leaf, quads), cut(leaf + 1, quads)];
    (0..leaves(nv)).flat_map(move |j| {
        (0..leaves(nu)).map(move |i| Leaf {
            i,
            j,
            ends: [ends(i, nu), ends(j, nv)],
        })
    })
}

impl Leaf {
    fn lane(&self) -> usize {
        FAN * self.j + self.i
    }

    fn vertices(&self, [nu, _]: [usize; 2]) -> impl Iterator<Item = usize> + use<> {
        let [[left, right], [below, above]] = self.ends;
        (below..=above).flat_map(move |y| (left..=right).map(move |x| y * (nu + 1) + x))
    }
}

/// The plane of least squares through vertices.
struct Plane {
    /// Where the first vertex should be.
    first: DVec3,
    du: DVec3,
    dv: DVec3,
}

impl Plane {
    fn of(vertices: &[DVec3], quads: [usize; 2]) -> Self {
        let middle = quads.map(|n| 0.5 * n as f64);
        let (mut sum, mut u, mut v) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for ([x, y], &p) in places(quads).zip(vertices) {
            sum += p;
            u += (x - middle[0]) * p;
            v += (y - middle[1]) * p;
        }
        // Sums of squares of 0..n about their middle are n (n^2 - 1) / 12.
        let [columns, rows] = quads.map(|n| (n + 1) as f64);
        let squares = |n: f64| n * (n * n - 1.0) / 12.0;
        let (du, dv) = (u / (squares(columns) * rows), v / (squares(rows) * columns));
        Self {
            first: sum / (columns * rows) - middle[0] * du - middle[1] * dv,
            du,
            dv,
        }
    }

    fn at(&self, [x, y]: [f64; 2]) -> DVec3 {
        self.first + x * self.du + y * self.dv
    }
}

/// Columns and rows of the vertices of so many quads.
fn places([nu, nv]: [usize; 2]) -> impl Iterator<Item = [f64; 2]> {
    (0..=nv).flat_map(move |y| (0..=nu).map(move |x| [x as f64, y as f64]))
}

/// How u, v and h should grow along the lattice's axes.
fn axes(keys: &[Vec<DVec3>], planes: &[Plane], quads: [usize; 2]) -> [Axis; 3] {
    let mean = |f: fn(&Plane) -> DVec3| planes.iter().map(f).sum::<DVec3>() / planes.len() as f64;
    let (mut du, mut dv) = (mean(|p| p.du), mean(|p| p.dv));
    let (u, v) = (du.length(), dv.length());
    let across = du.cross(dv);
    let is_flat = across.length() > LEAST_ANGLE * u * v && u > 0.0 && v > 0.0;
    let mut up = across.normalize_or(DVec3::Z);
    if is_flat {
        up = displaced(keys, planes, quads, up);
    } else {
        // A line or a point, or so stretched that it is hardly more.
        const LEAST: f64 = 1.0 / 64.0;
        let along = if u > v { du } else { dv };
        let first = along.normalize_or(DVec3::X);
        let second = first.any_orthonormal_vector();
        let long = u.max(v).max(LEAST);
        (du, dv, up) = if u > v {
            (long * first, long * second, first.cross(second))
        } else {
            (long * second, long * first, second.cross(first))
        };
    }
    let rows = DMat3::from_cols(du, dv, up).inverse().transpose();
    // From the lowest corner to the highest, and to the farthest vertex.
    let mut corners = Vec::with_capacity(keys.len());
    let mut farthest = DVec3::ZERO;
    for (key, plane) in keys.iter().zip(planes) {
        for p in key {
            let off = *p - plane.first;
            farthest = farthest.max((rows.transpose() * off).abs());
        }
        let corners_of_key = (0..=FAN).flat_map(|j| (0..=FAN).map(move |i| (i, j)));
        corners.push(corners_of_key.map(|(i, j)| key[corner(i, j, quads)] - plane.first));
    }
    let corners: Vec<Vec<DVec3>> = corners.into_iter().map(Iterator::collect).collect();
    let span = |step: DVec3| {
        let of_key = |corners: &Vec<DVec3>| {
            let heights = corners.iter().map(|p| p.dot(step));
            let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), h| {
                (low.min(h), high.max(h))
            });
            high - low
        };
        corners.iter().map(of_key).fold(0.0, f64::max)
    };
    let finest = FINEST_STEP.max(FINEST_PART * du.length().min(dv.length()));
    let most = |k: usize| (WIDEST / farthest[k]).min(1.0);
    let [u, v] = [0, 1].map(|k| Axis::nearest(rows.col(k) * most(k)));
    let up = rows.col(2);
    let mut scale = 1.0 / (span(up) / SPAN).max(finest).max(farthest.z / HIGHEST);
    let mut height = Axis::nearest(scale * up);
    // Roundings tilt what is flat.
    for _ in 0..8 {
        let too_much = span(height.steps()) / SPAN;
        if too_much <= 1.0 {
            break;
        }
        scale *= 0.98 / too_much;
        height = Axis::nearest(scale * up);
    }
    [u, v, height]
}

/// The vertex where the borders of leaves cross; the last one for those that there are none of.
fn corner(i: usize, j: usize, quads: [usize; 2]) -> usize {
    let at = |leaf: usize, quads| cut(leaf.min(leaves(quads)), quads);
    at(j, quads[1]) * (quads[0] + 1) + at(i, quads[0])
}

/// The direction in which vertices are off their planes, if it is anywhere near the normal; else that.
fn displaced(keys: &[Vec<DVec3>], planes: &[Plane], quads: [usize; 2], normal: DVec3) -> DVec3 {
    let mut squares = DMat3::ZERO;
    for (key, plane) in keys.iter().zip(planes) {
        for (at, p) in places(quads).zip(key) {
            let off = *p - plane.at(at);
            squares += DMat3::from_cols(off * off.x, off * off.y, off * off.z);
        }
    }
    // Where they are off by roundings, these have no direction.
    let count = keys.iter().map(Vec::len).sum::<usize>() as f64;
    let [x, y, z] = [0, 1, 2].map(|k| squares.col(k)[k]);
    if x + y + z < count {
        return normal;
    }
    let mut direction = normal;
    for _ in 0..8 {
        direction = (squares * direction).normalize_or(normal);
    }
    if direction.dot(normal).abs() < LEAST_SLANT {
        normal
    } else {
        direction * direction.dot(normal).signum()
    }
}

/// The height at a corner's place in the plane, which may be beside that of its vertex, by the slopes around.
fn levelled(at: &[DVec3], i: usize, j: usize, quads: [usize; 2]) -> f64 {
    let vertex = |i, j| at[corner(i, j, quads)];
    let p = vertex(i, j);
    let along_u = vertex(i + 1, j) - vertex(i.saturating_sub(1), j);
    let along_v = vertex(i, j + 1) - vertex(i, j.saturating_sub(1));
    let normal = along_u.cross(along_v);
    let place = |n: usize, quads| cut(n.min(leaves(quads)), quads) as f64;
    let (u, v) = (place(i, quads[0]), place(j, quads[1]));
    let off = (normal.x * (p.x - u) + normal.y * (p.y - v)) / normal.z;
    if normal.z > LEAST_TURN * normal.length() && off.is_finite() {
        p.z + off
    } else {
        p.z
    }
}

/// Vertices at a motion key in the coordinates of their tile.
struct Placed {
    origin: [i32; 3],
    at: Vec<DVec3>,
    heights: [[u8; FAN + 1]; FAN + 1],
}

impl Placed {
    fn new(vertices: &[DVec3], plane: &Plane, steps: [DVec3; 3], quads: [usize; 2]) -> Self {
        let coordinates = |p: DVec3, origin: DVec3| {
            let off = p - origin;
            DVec3::from_array(steps.map(|step| step.dot(off)))
        };
        // What is off on average, or below zero, is moved away.
        let mut off = DVec3::ZERO;
        for ([x, y], p) in places(quads).zip(vertices) {
            off += coordinates(*p, plane.first) - DVec3::new(x, y, 0.0);
        }
        off /= vertices.len() as f64;
        off.z = (0..=FAN)
            .flat_map(|j| (0..=FAN).map(move |i| (i, j)))
            .map(|(i, j)| coordinates(vertices[corner(i, j, quads)], plane.first).z)
            .fold(f64::MAX, f64::min)
            - 1.0;
        let back = DMat3::from_cols(steps[0], steps[1], steps[2])
            .transpose()
            .inverse()
            * off;
        let origin = plane.first + if back.is_finite() { back } else { DVec3::ZERO };
        let most = DVec3::splat(f64::from(REACH - 1));
        let origin = origin.round().clamp(-most, most);
        let at: Vec<DVec3> = vertices.iter().map(|p| coordinates(*p, origin)).collect();
        let height = |i, j| levelled(&at, i, j, quads).round().clamp(0.0, 255.0) as u8;
        Self {
            origin: origin.to_array().map(|x| x as i32),
            heights: std::array::from_fn(|j| std::array::from_fn(|i| height(i, j))),
            at,
        }
    }

    /// How much wider leaves are than their quads, at the least u and v and at the most.
    fn sides(&self, quads: [usize; 2]) -> [[[f32; 2]; 2]; LANES] {
        let mut sides = [[[0.0; 2]; 2]; LANES];
        for leaf in of_tile(quads) {
            let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
            for v in leaf.vertices(quads) {
                (low, high) = (low.min(self.at[v]), high.max(self.at[v]));
            }
            let ends = leaf.ends.map(|ends| ends.map(|x| x as f64));
            sides[leaf.lane()] = [
                [0, 1].map(|k| up(ends[k][0] - low[k])),
                [0, 1].map(|k| up(high[k] - ends[k][1])),
            ];
        }
        sides
    }

    /// A leaf's corners: (0, 0), (1, 0), (0, 1) and (1, 1).
    fn corners(&self, &Leaf { i, j, .. }: &Leaf) -> [f64; 4] {
        [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|(i, j)| self.heights[j][i].into())
    }

    /// The slopes of a leaf's plane by u and by v.
    fn slopes(&self, leaf: &Leaf) -> [f64; 2] {
        let [a, b, c, d] = self.corners(leaf);
        let [u, v] = leaf.ends.map(|[first, last]| (last - first) as f64);
        [0.5 * (b - a + d - c) / u, 0.5 * (c - a + d - b) / v]
    }

    /// How far a leaf's vertices are below and above its plane.
    fn depths(&self, leaf: &Leaf, quads: [usize; 2]) -> [f64; 2] {
        let mean = 0.25 * self.corners(leaf).iter().sum::<f64>();
        let slopes = self.slopes(leaf);
        let middle = leaf.ends.map(|[first, last]| 0.5 * (first + last) as f64);
        leaf.vertices(quads)
            .fold([0.0; 2], |[below, above]: [f64; 2], v| {
                let p = self.at[v];
                let plane = mean + slopes[0] * (p.x - middle[0]) + slopes[1] * (p.y - middle[1]);
                [below.max(plane - p.z), above.max(p.z - plane)]
            })
    }
}
