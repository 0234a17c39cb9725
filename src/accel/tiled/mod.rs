//! Shell mapping: geometry that stands over a surface tile by tile, of which bent rays need no copy.
//!
//! After Ogaki, "Nonlinear Ray Tracing for Displacement and Shell Mapping", SIGGRAPH Asia 2023 conference papers, whose
//! prisms and bent rays `nonlinear` has, too. Over a triangle of the surface lies a prism, all points P + w N, in which
//! texture coordinates are linear. A ray is a curve in the space of u, v and w, and passes through tiles there. All of them hold
//! the same triangles, in one tree: nothing is stored for a tile.
//!
//! ```text
//!   world: a ray, straight              u, v, w: the ray, bent                  a tile, and a chord of the ray
//!      \  |N  / |   |                   w ^  .'|     |     |     |               ┌───────┐
//!       \ | .·  |  /                      |.'  |  /\ | /\  | /\  |               │  /\ .·│
//!      ..·\·    | /                       |  /\|'./  |/  \ |/  \ |               │ /.·\  │   boxes as much larger as
//!    ······\____|/_  the surface          | /  | \'. |    \|    \|               │.·   \ │   the ray may be off its chord
//!                                         └────┴───┴'┴─────┴─────> u             └───────┘
//! ```
//!
//! **What is traced.** Faces are cut into quads, as few as the limit surface's curvature allows, and as many on both sides of an edge
//! ([`Shell`](crate::surface::Shell), whose error is [`achieved`](Tiled::achieved)); a quad is two triangles, along its
//! diagonal. Their corners' limit points and unit normals, or the means of these along creases, make the prisms, and texture coordinates are linear over each
//! triangle. The triangles of the tile are flat in u, v and w. [`Tiled::copies`] is the same geometry as triangles of the world, for who
//! traces it otherwise: cut where prisms end, and straight where these are bent.
//!
//! **Chords.** The paper traces the curve through the boxes of the object's tree, four quadratics a box. Here it is cut into
//! chords until it is within a hundredth of a tile of them, which a few coefficients tell, and boxes are widened by as much: they are
//! met as boxes are everywhere else in this program, sixteen at once. The triangles themselves are met by the curve, at the
//! roots of a cubic, in double precision: what is hit does not depend on how it is cut.
//!
//! **Tiles.** What reaches beyond its tile is in the tree again, moved by whole tiles, each time as much as is in the tile.
//! So a tile has all that is seen in it, tiles are met in the order of the ray, and the first hit is the nearest.
//!
//! **Without cracks.** A ray leaves a prism where it enters the next, to the bit, and u and v are the same there unless texture
//! coordinates have a seam. Along creases prisms lean to the mean of the normals. What reaches beyond a border of the surface is
//! cut there.
//!
//! ```text
//!   tree over quads     see `top`                                   10 to 40 bytes a quad
//!     quad              its face, place and first corner            16 bytes
//!     corner            P, N; u and v                               24 bytes, at each motion key; 8 bytes
//!   tile                once: its triangles, in pieces              some 55 bytes each, and 30 bytes
//! ```

mod bent;
mod build;
mod copies;
#[cfg(test)]
mod tests;
mod tile;
mod walk;

use super::Hit;
use super::lattice::Lattice;
use super::moment::Moment;
use super::prism::{HALVES, corners_at, of_half};
use super::simd::Isa;
use super::top::Top;
use super::traversal::{Tree, Trunk};
use crate::math::{DVec2, DVec3, Ray, Vec2, Vec3};
use crate::stats::AchievedError;
use crate::surface::ShellError;
pub use copies::Copies;
use tile::Tile;
use walk::{Met, Walk};

/// What may be rounded, in tiles and in their heights: prisms reach so much farther than what stands in them.
const MARGIN: f64 = 1e-6;

/// A surface of tiles.
pub struct Tiled {
    isa: Isa,
    lattice: Lattice,
    /// The largest coordinate on the lattice.
    reach: f32,
    keys: u32,
    /// The tree over the quads, which are in its order.
    top: Top,
    quads: Vec<Quad>,
    /// Points at w 0 and what leads to those at w 1: face by face, row by row, at each motion key.
    corners: Vec<[Vec3; 2]>,
    /// u and v, likewise.
    uv: Vec<Vec2>,
    tile: Tile,
    shell: ShellError,
}

/// A quad of the surface.
#[derive(Debug, Clone, Copy)]
struct Quad {
    /// The highest bit tells of prisms that may fold.
    face: u32,
    /// Column and row among the face's, and how many of these there are.
    place: [u16; 2],
    size: [u16; 2],
    /// Its first corner; the next one follows it, and the other two a row later.
    corner: u32,
}

impl Quad {
    const FOLDS: u32 = 1 << 31;

    fn face(&self) -> u32 {
        self.face & !Self::FOLDS
    }

    /// Its corners' numbers.
    #[inline(always)]
    fn numbers(&self) -> [usize; 4] {
        let first = self.corner as usize;
        let row = usize::from(self.size[0]) + 1;
        [first, first + 1, first + row, first + row + 1]
    }

    #[inline(always)]
    fn may_fold(&self) -> bool {
        self.face & Self::FOLDS != 0
    }

    /// Where the corners of one of its triangles are on it, in the order of [`HALVES`].
    fn parameters(half: usize) -> [DVec2; 3] {
        HALVES[half].map(|c| DVec2::new(f64::from(c as u32 & 1), f64::from(c as u32 >> 1)))
    }
}

impl Tiled {
    /// How far what stands in prisms is from where it would be over the limit surface itself.
    pub fn achieved(&self) -> AchievedError {
        self.shell.achieved(None)
    }

    /// A quad's corners at a moment.
    #[inline(always)]
    fn corners(&self, quad: &Quad, moment: &Moment) -> [[DVec3; 2]; 4] {
        corners_at(&self.corners, quad.numbers(), self.keys, moment)
    }

    /// u and v at the corners of both triangles of a quad.
    #[inline(always)]
    fn uvs(&self, quad: &Quad) -> [[[f64; 2]; 3]; 2] {
        let [a, b, c, d] = quad.numbers();
        let (a, b, c, d) = (self.uv(a), self.uv(b), self.uv(c), self.uv(d));
        [[a, b, c], [d, c, b]]
    }

    #[inline(always)]
    fn uv(&self, corner: usize) -> [f64; 2] {
        let uv = self.uv[corner];
        [uv.x.into(), uv.y.into()]
    }

    /// The parameters on the face of a place in a quad.
    fn face_uv(&self, quad: &Quad, at: DVec2) -> Vec2 {
        let two = |[u, v]: [u16; 2]| DVec2::new(u.into(), v.into());
        let uv = (two(quad.place) + at) / two(quad.size);
        uv.clamp(DVec2::ZERO, DVec2::ONE).as_vec2()
    }
}

impl Tree for Tiled {
    type Met = Met;
    type Walk<'a, const ANY: bool, const MOVES: bool> = Walk<'a, ANY, MOVES>;

    #[inline(always)]
    fn trunk(&self) -> Trunk<'_> {
        Trunk {
            isa: self.isa,
            keys: self.keys,
            lattice: &self.lattice,
            top: &self.top,
        }
    }

    #[inline(always)]
    fn walk<'a, const ANY: bool, const MOVES: bool>(
        &'a self,
        moment: &'a Moment,
        ray: &Ray,
    ) -> Option<Self::Walk<'a, ANY, MOVES>> {
        Some(Walk::new(self, moment, ray))
    }

    fn hit_on(&self, ray: &Ray, met: &Met) -> Hit {
        let quad = &self.quads[met.quad as usize];
        let moment = Moment::new(self.keys, ray.time);
        let corners = self.corners(quad, &moment);
        let corners = of_half(&corners, met.half);
        let at = corners.map(|&[p, n]| p + met.w * n);
        let (e1, e2) = (at[1] - at[0], at[2] - at[0]);
        let weighted = |of: [DVec3; 3]| (0..3).map(|k| met.weights[k] * of[k]).sum::<DVec3>();
        let n = weighted(corners.map(|&[_, n]| n));

        // The triangle's normal in u, v and w, by the triangle's own coordinates, and what the adjugate makes of it.
        let [a, b, c] = self.tile.corners(self.tile.placed[met.placed as usize]);
        let own = (b - a).cross(c - a);
        let [o, p, q] = self.uvs(quad)[met.half].map(DVec2::from);
        let along = |by: DVec2| own.truncate().dot(by);
        let (x, y, z) = (along(p - o), along(q - o), own.z);
        let area = e1.cross(e2);
        let facing = x * e2.cross(n) + y * n.cross(e1) + z * area;
        let facing = if area.dot(n) < 0.0 { -facing } else { facing };
        let largest = facing.abs().max_element();
        let normal = if largest > 0.0 {
            facing / largest
        } else {
            DVec3::ZERO
        };
        // Measured: from the point that whoever reads `t` computes to the one that was found.
        let gap = ray.at(met.t).as_dvec3() - weighted(at);
        let place = Quad::parameters(met.half);
        let place = (0..3).map(|k| met.weights[k] * place[k]).sum();
        Hit {
            t: met.t,
            face: quad.face(),
            uv: self.face_uv(quad, place),
            normal: normal.as_vec3(),
            error: (gap.length() * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }

    fn bytes(&self) -> usize {
        self.top.memory()
            + size_of_val(self.quads.as_slice())
            + size_of_val(self.corners.as_slice())
            + size_of_val(self.uv.as_slice())
            + self.tile.memory()
    }
}
