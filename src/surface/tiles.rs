//! Geometry over a surface, tile by tile of its texture coordinates.

use super::base::Base;
use crate::math::{DVec3, Vec2, Vec3};

/// What stands over a surface and is seen in its place. Its coordinates: u and v, of which each whole number begins a tile,
/// and w, which is 0 at the lowest place of it and 1 at the highest.
#[derive(Debug, Clone, PartialEq)]
pub struct Tiles {
    points: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    heights: [f32; 2],
    repeats: Vec2,
}

/// The least height of a tile, in units of its z, or of how far from 0 that is.
const THINNEST: f32 = 1.0 / 1024.0;

impl Tiles {
    /// Of points whose x and y run from 0 to 1 over a tile, and whose z is `height` units of the surface's points above it
    /// for each 1; finite all of them. Triangles name points, and are left out where they have no area; `repeats` is how many
    /// tiles there are for a unit of s and of t. Traced is what reaches up to 8 tiles beyond 0..1.
    pub fn new(
        mut points: Vec<Vec3>,
        mut triangles: Vec<[u32; 3]>,
        repeats: Vec2,
        height: f32,
    ) -> Self {
        let used = || triangles.iter().flatten().map(|&i| points[i as usize].z);
        let low = used().fold(f32::INFINITY, f32::min);
        let high = used().fold(f32::NEG_INFINITY, f32::max);
        let [low, high] = if low.is_finite() {
            // What is flat needs some room: prisms have a volume.
            [low, high.max(low + THINNEST * low.abs().max(1.0))]
        } else {
            [0.0, 1.0]
        };
        for point in &mut points {
            point.z = (point.z - low) / (high - low);
        }
        triangles.retain(|triangle| {
            let [a, b, c] = triangle.map(|i| points[i as usize].as_dvec3());
            (b - a).cross(c - a) != DVec3::ZERO
        });
        Self {
            points,
            triangles,
            heights: [low, high].map(|z| height * z),
            repeats,
        }
    }

    /// The points: u, v, w.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The triangles of a tile.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// How high above the surface a w of 0 and one of 1 are, in units of the surface's points.
    pub fn heights(&self) -> [f32; 2] {
        self.heights
    }

    /// How many tiles there are for a unit of s and of t.
    pub fn repeats(&self) -> Vec2 {
        self.repeats
    }

    /// How many triangles stand over a surface, by the area that its faces' corners have in texture coordinates.
    pub fn count_over(&self, base: &dyn Base) -> u64 {
        const CORNERS: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        /// So that it can be multiplied by some bytes each.
        const MOST: f64 = (1_u64 << 48) as f64;
        let tiles = |face: u32| {
            let st = CORNERS.map(|uv| base.texcoord(face, uv).map_or(uv, |t| t.st));
            let [a, b, c, d] = st.map(|st| (st * self.repeats).as_dvec2());
            0.5 * ((b - a).perp_dot(d - a).abs() + (b - c).perp_dot(d - c).abs())
        };
        let faces = (0..base.faces()).filter(|&face| !base.is_hole(face));
        let all = faces.map(tiles).sum::<f64>() * self.triangles.len() as f64;
        all.min(MOST) as u64
    }

    /// How many vertices copies of so many of its triangles have, if they share what they share here.
    pub fn vertices_of(&self, triangles: u64) -> u64 {
        let each = self.points.len() as f64 / self.triangles.len().max(1) as f64;
        (triangles as f64 * each.min(3.0)) as u64
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        size_of_val(self.points.as_slice()) + size_of_val(self.triangles.as_slice())
    }
}
