//! The same geometry as triangles of the world: what others trace, and what is compared with.

use rayon::prelude::*;

use super::tile::{Half, clipped};
use super::{Quad, Tiled};
use crate::accel::prism::HALVES;
use crate::error::{Error, Result};
use crate::math::{DVec2, DVec3, Vec2, Vec3};

/// Copies of what tiles hold, one for each tile, cut where prisms end.
pub struct Copies {
    /// At each motion key.
    pub positions: Vec<Vec<Vec3>>,
    /// Corners, counterclockwise seen from the front of what the tile holds.
    pub triangles: Vec<[u32; 3]>,
    /// The face of the surface below each triangle.
    pub faces: Vec<u32>,
    /// The parameters on it, by vertex.
    pub uvs: Vec<Vec2>,
}

/// Quads between two questions whether to go on.
const TOGETHER: usize = 64;

/// The copies over a quad.
#[derive(Default)]
struct Part {
    positions: Vec<Vec<Vec3>>,
    triangles: Vec<[u32; 3]>,
    uvs: Vec<Vec2>,
}

impl Copies {
    /// The face, and the parameters on it, of a point of a triangle, which has these weights of its second and third corner.
    pub fn face_uv(&self, triangle: u32, at: Vec2) -> (u32, Vec2) {
        let triangle = triangle as usize;
        let [a, b, c] = self.triangles[triangle].map(|v| self.uvs[v as usize]);
        let uv = a + at.x * (b - a) + at.y * (c - a);
        (self.faces[triangle], uv)
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        let positions = self.positions.iter().map(|p| size_of_val(p.as_slice()));
        positions.sum::<usize>()
            + size_of_val(self.triangles.as_slice())
            + size_of_val(self.faces.as_slice())
            + size_of_val(self.uvs.as_slice())
    }
}

impl Tiled {
    /// All of them. `go_on` is told how far it is, 0 to 1, and ends it by false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if ended, [`Error::Memory`] if there are more vertices or triangles than 32 bits count.
    pub fn copies(&self, go_on: &dyn Fn(f64) -> bool) -> Result<Copies> {
        let mut parts: Vec<Part> = Vec::with_capacity(self.quads.len());
        for quads in self.quads.chunks(TOGETHER) {
            if !go_on(parts.len() as f64 / self.quads.len() as f64) {
                return Err(Error::Interrupted);
            }
            parts.par_extend(quads.par_iter().map(|quad| self.part(quad)));
        }
        let vertices: usize = parts.iter().map(|part| part.uvs.len()).sum();
        let count: usize = parts.iter().map(|part| part.triangles.len()).sum();
        if vertices.max(count) >= u32::MAX as usize {
            return Err(Error::Memory {
                message: format!(
                    "{count} triangles over {vertices} vertices in all tiles of one object, where 32 bits count to {}",
                    u32::MAX
                ),
                help: Some("Trace it by another method, which makes no copies.".into()),
            });
        }
        let mut copies = Copies {
            positions: vec![Vec::with_capacity(vertices); self.keys as usize],
            triangles: Vec::with_capacity(count),
            faces: Vec::with_capacity(count),
            uvs: Vec::with_capacity(vertices),
        };
        for (quad, part) in self.quads.iter().zip(parts) {
            let first = copies.uvs.len() as u32;
            for (all, own) in copies.positions.iter_mut().zip(part.positions) {
                all.extend(own);
            }
            let moved = part.triangles.iter().map(|t| t.map(|v| first + v));
            copies.triangles.extend(moved);
            copies.faces.resize(copies.triangles.len(), quad.face());
            copies.uvs.extend(part.uvs);
        }
        Ok(copies)
    }

    fn part(&self, quad: &Quad) -> Part {
        let keys = self.keys as usize;
        let mut part = Part {
            positions: vec![Vec::new(); keys],
            ..Part::default()
        };
        for half in 0..2 {
            self.over(quad, half, &mut part);
        }
        part
    }

    /// Adds the copies over one of a quad's triangles.
    fn over(&self, quad: &Quad, half: usize, part: &mut Part) {
        let [o, p, q] = self.uvs(quad)[half].map(DVec2::from);
        let area = (p - o).perp_dot(q - o);
        if area == 0.0 {
            return;
        }
        // The weight of the corner opposite of a side, by u and v.
        let weight = |a: DVec2, b: DVec2| -> Half {
            let normal = (b - a).perp() / area;
            Half::new(normal.x, normal.y, 0.0, -normal.dot(a))
        };
        let over = Over {
            of: self,
            quad,
            half,
            weights: [weight(p, q), weight(q, o), weight(o, p)],
        };
        let is_turned = over.is_turned(area);
        let tiles = &self.tile.tiles;
        let points: Vec<DVec3> = tiles.points().iter().map(|p| p.as_dvec3()).collect();
        let used = || {
            tiles
                .triangles()
                .iter()
                .flatten()
                .map(|&i| points[i as usize])
        };
        let least = used().fold(DVec3::INFINITY, DVec3::min).truncate();
        let most = used().fold(DVec3::NEG_INFINITY, DVec3::max).truncate();
        let (low, high) = (o.min(p).min(q), o.max(p).max(q));
        let (first, last) = ((low - most).ceil(), (high - least).floor());
        // Vertices of the tile at hand that have a number.
        let mut numbers = vec![u32::MAX; points.len()];
        for j in first.y as i64..=last.y as i64 {
            for i in first.x as i64..=last.x as i64 {
                let by = DVec3::new(i as f64, j as f64, 0.0);
                numbers.fill(u32::MAX);
                for triangle in tiles.triangles() {
                    let corners = triangle.map(|i| points[i as usize] + by);
                    let mut add = |[a, b, c]: [u32; 3]| {
                        (part.triangles).push(if is_turned { [a, c, b] } else { [a, b, c] });
                    };
                    if corners.iter().all(|p| over.has(p)) {
                        add([0, 1, 2].map(|k| {
                            let number = &mut numbers[triangle[k] as usize];
                            if *number == u32::MAX {
                                *number =
                                    over.emit(&corners[k], &mut part.positions, &mut part.uvs);
                            }
                            *number
                        }));
                        continue;
                    }
                    let polygon: Vec<u32> = clipped(&corners, &over.weights)
                        .iter()
                        .map(|p| over.emit(p, &mut part.positions, &mut part.uvs))
                        .collect();
                    for k in 2..polygon.len() {
                        add([polygon[0], polygon[k - 1], polygon[k]]);
                    }
                }
            }
        }
    }
}

/// One of a quad's triangles, and what stands over it.
struct Over<'a> {
    of: &'a Tiled,
    quad: &'a Quad,
    half: usize,
    /// Of its corners, by u and v.
    weights: [Half; 3],
}

impl Over<'_> {
    fn weights(&self, p: &DVec3) -> [f64; 3] {
        self.weights.map(|half| p.extend(1.0).dot(half))
    }

    fn has(&self, p: &DVec3) -> bool {
        self.weights(p).iter().all(|&w| w >= 0.0)
    }

    /// A corner at a motion key.
    fn corner(&self, k: usize, key: usize) -> [DVec3; 2] {
        let all = self.of.corners.len() / self.of.keys as usize;
        let number = self.quad.numbers()[HALVES[self.half][k]];
        let corner = self.of.corners[number + key * all];
        corner.map(|x| x.as_dvec3())
    }

    /// Whether what is counterclockwise in a tile is clockwise here. `area` is the triangle's in u and v, of either sign.
    fn is_turned(&self, area: f64) -> bool {
        let [a, b, c] = [0, 1, 2].map(|k| self.corner(k, 0));
        let at = |[p, n]: [DVec3; 2]| p + 0.5 * n;
        let normal = (at(b) - at(a)).cross(at(c) - at(a));
        normal.dot(a[1] + b[1] + c[1]) * area < 0.0
    }

    /// Adds a vertex; its number.
    fn emit(&self, p: &DVec3, positions: &mut [Vec<Vec3>], uvs: &mut Vec<Vec2>) -> u32 {
        let weights = self.weights(p);
        for (key, positions) in positions.iter_mut().enumerate() {
            let corner = |k: usize| {
                let [at, n] = self.corner(k, key);
                at + p.z * n
            };
            let position: DVec3 = (0..3).map(|k| weights[k] * corner(k)).sum();
            positions.push(position.as_vec3());
        }
        let parameters = Quad::parameters(self.half);
        let at: DVec2 = (0..3).map(|k| weights[k] * parameters[k]).sum();
        uvs.push(self.of.face_uv(self.quad, at));
        uvs.len() as u32 - 1
    }
}
