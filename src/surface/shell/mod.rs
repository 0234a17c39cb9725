//! A limit surface as few quads with a normal at each corner, for methods that keep no micro-geometry.
//!
//! ```text
//!   N3 \          / N2     P(u,v), N(u,v) and st(u,v) are bilinear between a quad's corners; N is not normalised.
//!       P3------P2         The surface that such methods trace is
//!       |        |
//!       P0------P1           S(u,v) = P(u,v) + h(st(u,v)) N(u,v)
//!   N0 /          \ N1
//! ```
//!
//! Linear normals are Ogaki's ("Nonlinear Ray Tracing for Displacement and Shell Mapping", SIGGRAPH Asia 2023): what is
//! between two heights is the map of a box that is affine in u, in v and in h each, so that the eight corners of a part
//! of it bound it exactly. Unlike there the quads are those of a subdivided surface's limit, cut as finely as it is
//! curved, and as what is displaced by the heights asks for. How far they are from the limit surface is
//! [measured](Shell::achieved).
//!
//! Each face is cut as it needs it. Where neighbours have as many quads along their edge, they have the same corners of
//! the same bits there; where not, it is for whoever traces them to close the gap. At the pole of a sphere all corners of
//! a row are in one place, each with its own parameters. Where the faces at an edge differ in more than roundings,
//! by their normals at a crease or by texture coordinates at a seam, it is [torn](Torn): each keeps its own, and who
//! displaces must join them.

mod error;
mod join;

use rayon::prelude::*;

use super::base::LimitGrid;
use super::dice::FaceGrid;
use super::evaluate::{Surface, unit_normal};
use super::rates::Rates;
use crate::math::{Bounds3, Vec2, Vec3};
use crate::stats::{AchievedError, Spread};
use error::{Asked, Measured, Probe};
use join::{Joined, Own};

/// How far the quads, and what heights make of them, may be from the limit surface and what heights make of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShellTolerance {
    /// Distance in diagonals of the surface's bounds, above 0: for all heights between those below.
    pub distance: f32,
    /// Angle between the normals at the ends of a quad's side, radians, above 0, whatever the heights: between them a
    /// linear normal is too short by an eighth of the angle's square.
    pub angle: f32,
    /// The least and the greatest height, in units of the surface's points.
    pub heights: [f32; 2],
}

impl Default for ShellTolerance {
    /// A tenth of a pixel in a picture of a thousand, without heights.
    fn default() -> Self {
        Self {
            distance: 1e-4,
            angle: 0.5,
            heights: [0.0; 2],
        }
    }
}

/// How far the quads are from the limit surface: what was found in the middles of quads and of their sides, and what was
/// asked for. Lengths are in units of the surface's points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShellError {
    /// Between a quad and the limit surface along its normal, at most.
    pub distance: f32,
    /// The same once both are displaced by any of the heights.
    pub displaced: f32,
    /// The root of its mean square.
    pub rms: f32,
    /// Along the surface, between its point and that of the quad with the same parameters, at most.
    pub shift: f32,
    /// Between the normals there, radians, at most.
    pub angle: f32,
    /// How far any of the heights would move what it displaces if linear normals were made unit ones, at most.
    pub lengthened: f32,
    /// The root of its mean square.
    pub rms_lengthened: f32,
    /// The distance that was asked for.
    pub asked: f32,
    /// The diagonal of the box around the limit surface.
    pub diagonal: f32,
    /// How many points it was measured at.
    pub places: u64,
}

impl ShellError {
    /// How far what is displaced on the quads is from the displaced limit surface, with the pixels that a unit covers at the
    /// closest view, where these are known.
    pub fn achieved(&self, pixels_per_unit: Option<f32>) -> AchievedError {
        let diagonal = f64::from(self.diagonal.max(f32::MIN_POSITIVE));
        AchievedError {
            max_diagonals: f64::from(self.displaced) / diagonal,
            rms_diagonals: f64::from(self.rms) / diagonal,
            max_pixels: pixels_per_unit.map(|p| f64::from(p * self.displaced)),
            linear_normals: Some(Spread {
                max_diagonals: f64::from(self.lengthened) / diagonal,
                rms_diagonals: f64::from(self.rms_lengthened) / diagonal,
            }),
            vertices: self.places,
        }
    }
}

/// What the faces around an edge or a vertex do not agree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Torn {
    /// Their normals differ: a crease.
    pub normals: bool,
    /// Their texture coordinates differ: a seam. So they do everywhere if the surface has none.
    pub texcoords: bool,
}

/// A corner of quads at a motion key.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShellPoint {
    /// The limit point.
    pub position: Vec3,
    /// Its normal to the front, of unit length; zero where there is none.
    pub normal: Vec3,
}

/// A limit surface cut into quads.
pub struct Shell {
    grids: Vec<FaceGrid>,
    /// By motion key, grid by grid.
    points: Vec<Vec<ShellPoint>>,
    st: Vec<Vec2>,
    edges: Vec<Torn>,
    vertices: Vec<Torn>,
    has_texcoords: bool,
    achieved: ShellError,
}

impl Shell {
    /// Cuts the limit surface that `surface` displaces, on all threads; the same bytes for any number of them. No face is
    /// cut more finely than at the rates given. `fitting` may take more quads along u or v than are needed: it is told how
    /// many are, and the rate.
    pub fn new(
        surface: &Surface,
        rates: &Rates,
        tolerance: &ShellTolerance,
        fitting: impl Fn(u32, u32) -> u32 + Sync,
    ) -> Self {
        let flat = surface.undisplaced();
        let keys = flat.base().keys();
        let diagonal = bounds(&flat).extent().length();
        let asked = Asked {
            distance: tolerance.distance * diagonal,
            angle: tolerance.angle,
            heights: tolerance.heights,
        };
        let sizes: Vec<[u16; 2]> = (0..flat.base().faces())
            .into_par_iter()
            .map_init(Probe::default, |probe, face| {
                let most = rates.face(face);
                let needs = probe.needs(&flat, face, most, &asked);
                [0, 1].map(|k| fitting(needs[k], most[k]).clamp(1, needs[k].max(most[k])) as u16)
            })
            .collect();
        let mut grids = Vec::new();
        let (mut first_vertex, mut first_triangle) = (0, 0);
        for (face, &size) in (0..).zip(&sizes) {
            if flat.base().is_hole(face) {
                continue;
            }
            let [nu, nv] = size;
            let grid = FaceGrid {
                face,
                size,
                segments: [nu, nv, nu, nv],
                first_vertex,
                first_triangle,
            };
            first_vertex += grid.vertices().iter().product::<u64>();
            first_triangle += grid.triangles();
            grids.push(grid);
        }
        let mut joined = Joined::new(&flat, &sizes);
        joined.join(&flat);
        let made: Vec<(Vec<Own>, Measured)> = grids
            .par_iter()
            .map(|grid| {
                let own = joined.grid(&flat, grid);
                let measured = Measured::new(&flat, grid, &own, &asked);
                (own, measured)
            })
            .collect();
        let mut all = Measured::default();
        for (_, measured) in &made {
            all.add(measured);
        }
        let [rms, rms_lengthened] =
            (all.squares).map(|squares| (squares / all.error.places.max(1) as f64).sqrt() as f32);
        let achieved = ShellError {
            rms,
            rms_lengthened,
            asked: asked.distance,
            diagonal,
            ..all.error
        };
        let own = || made.iter().flat_map(|(own, _)| own);
        let points = (0..keys as usize)
            .map(|key| own().map(|own| own.points[key]).collect())
            .collect();
        Self {
            st: own().map(|own| own.st).collect(),
            points,
            grids,
            edges: joined.torn_edges,
            vertices: joined.torn_vertices,
            has_texcoords: flat.has_texcoords(),
            achieved,
        }
    }

    /// How each face that is not a hole is cut, in the order of the faces; vertices are counted through all of them.
    pub fn grids(&self) -> &[FaceGrid] {
        &self.grids
    }

    /// How many quads there are.
    pub fn quads(&self) -> usize {
        let of_grid = |grid: &FaceGrid| grid.size.map(usize::from).iter().product::<usize>();
        self.grids.iter().map(of_grid).sum()
    }

    /// How many motion keys it has.
    pub fn keys(&self) -> u32 {
        self.points.len() as u32
    }

    /// The corners of all quads at a motion key, by [`FaceGrid::vertex`].
    pub fn points(&self, key: u32) -> &[ShellPoint] {
        &self.points[key as usize]
    }

    /// Their texture coordinates; the face's parameters, if the surface has none.
    pub fn st(&self) -> &[Vec2] {
        &self.st
    }

    /// Whether the surface has texture coordinates.
    pub fn has_texcoords(&self) -> bool {
        self.has_texcoords
    }

    /// The numbers of the corners of the quad in column `i` of row `j`: at (0,0), (1,0), (0,1), (1,1) of it.
    pub fn corners(grid: &FaceGrid, i: u16, j: u16) -> [usize; 4] {
        [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|(i, j)| grid.vertex(i, j) as usize)
    }

    /// The face's parameters of a point of the quad in column `i` of row `j`.
    pub fn face_uv(grid: &FaceGrid, i: u16, j: u16, uv: Vec2) -> Vec2 {
        let [a, b, c, d] =
            [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)].map(|(i, j)| grid.vertex_uv(i, j));
        (a.lerp(b, uv.x))
            .lerp(c.lerp(d, uv.x), uv.y)
            .clamp(Vec2::ZERO, Vec2::ONE)
    }

    /// What the faces at an edge differ in, anywhere along it, by the base's number of the edge.
    pub fn torn_edge(&self, edge: u32) -> Torn {
        self.edges[edge as usize]
    }

    /// The same of a vertex.
    pub fn torn_vertex(&self, vertex: u32) -> Torn {
        self.vertices[vertex as usize]
    }

    /// How far the quads are from the limit surface.
    pub fn achieved(&self) -> ShellError {
        self.achieved
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        let points: usize = self.points.iter().map(|p| size_of_val(p.as_slice())).sum();
        points
            + size_of_val(self.st.as_slice())
            + size_of_val(self.grids.as_slice())
            + size_of_val(self.edges.as_slice())
            + size_of_val(self.vertices.as_slice())
    }
}

/// A box around the limit points of corners and middles of faces, at all motion keys.
fn bounds(flat: &Surface) -> Bounds3 {
    const AT: [f32; 3] = [0.0, 0.5, 1.0];
    let base = flat.base();
    let faces: Vec<u32> = (0..base.faces()).filter(|&f| !base.is_hole(f)).collect();
    let of_face = |grid: &mut LimitGrid, &face: &u32| {
        (0..base.keys()).fold(Bounds3::EMPTY, |all, key| {
            base.evaluate_grid(face, &AT, &AT, key, grid);
            (0..grid.len()).fold(all, |all, i| all.including(grid.position(i)))
        })
    };
    (faces.par_iter())
        .map_init(LimitGrid::default, of_face)
        .reduce(|| Bounds3::EMPTY, Bounds3::union)
}

/// The unit normal to the front of a point with these derivatives; zero where there is none.
fn normal(flat: &Surface, face: u32, uv: Vec2, key: u32, [du, dv]: [Vec3; 2]) -> Vec3 {
    let cross = du.as_dvec3().cross(dv.as_dvec3());
    let size = du.as_dvec3().length_squared() * dv.as_dvec3().length_squared();
    if cross.length_squared() > 1e-8 * size {
        return (f64::from(flat.front) * cross.normalize()).as_vec3();
    }
    unit_normal(&flat.base().evaluate(face, uv, key), uv, flat.front).unwrap_or(Vec3::ZERO)
}
