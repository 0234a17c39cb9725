//! What this layer asks of a limit surface.
//!
//! A surface is a set of faces, each a unit square: Ptex faces of subdivision surfaces (a quad is one, an n-gon is n;
//! a Loop triangle is handed out as three), Bezier pieces of NURBS patches.
//!
//! ```text
//!        edge 2
//!   3 ----<---- 2      Corners are (0,0), (1,0), (1,1), (0,1); edge k runs from corner k to the next one.
//!   |           |      u grows from corner 0 to corner 1,
//! edge 3      edge 1   v from corner 0 to corner 3.
//!   |           |
//!   0 ---->---- 1
//!        edge 0
//! ```

use super::Bicubic;
use crate::math::{Bounds3, Vec2, Vec3};

/// A limit surface, asked by all threads at once.
///
/// Edges and vertices have numbers that all faces share, dense from 0. More than two faces may share an edge, and
/// the faces around an edge or vertex may have different normals there.
pub trait Base: Send + Sync {
    /// How many faces there are, holes included.
    fn faces(&self) -> u32;

    /// How many motion keys it has, evenly over the shutter; 1 if nothing moves.
    fn keys(&self) -> u32 {
        1
    }

    /// Whether the face is not seen.
    fn is_hole(&self, _face: u32) -> bool {
        false
    }

    /// Whether parts of faces are cut away: those that [`is_kept`](Self::is_kept) says no to.
    fn is_trimmed(&self) -> bool {
        false
    }

    /// Whether a point of a face is part of the surface. Asked at hits, where the surface is trimmed.
    fn is_kept(&self, _face: u32, _uv: Vec2) -> bool {
        true
    }

    /// Whether `du × dv` points to the back.
    fn left_handed(&self) -> bool {
        false
    }

    /// The shared number of the face's edge `k`, 0 to 3.
    fn edge(&self, face: u32, k: u32) -> EdgeUse;

    /// The shared number of the face's corner `k`, 0 to 3.
    fn vertex(&self, face: u32, k: u32) -> u32;

    /// Whether edge `k` is but a point, as at the pole of a sphere. Its two ends are then the same vertex.
    fn is_collapsed(&self, _face: u32, _k: u32) -> bool {
        false
    }

    /// The limit point at `uv` in 0..1, at a motion key.
    fn evaluate(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint;

    /// The same without second derivatives, which are left 0. Override where that is faster.
    fn first_order(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint {
        self.evaluate(face, uv, key)
    }

    /// Points and first derivatives at all pairs of `us` and `vs`, u running faster. The parameters lie in 0..1 in any
    /// order; `out` is made to fit. Override with a kernel that shares work between the points: dicing lives on it.
    fn evaluate_grid(&self, face: u32, us: &[f32], vs: &[f32], key: u32, out: &mut LimitGrid) {
        out.resize(us.len() * vs.len());
        let uvs = vs
            .iter()
            .flat_map(|&v| us.iter().map(move |&u| Vec2::new(u, v)));
        for (i, uv) in uvs.enumerate() {
            out.set(i, &self.evaluate(face, uv, key));
        }
    }

    /// A box around all that the evaluation gives in a rectangle of the face, its rounding included. The rectangle may
    /// be a line or a point.
    fn hull(&self, face: u32, rect: &UvRect, key: u32) -> Bounds3;

    /// The rectangle's surface as a bicubic Bezier patch over the unit square, if it is one polynomial: row by row,
    /// u running faster. Exact up to a few roundings of its largest coordinate. Without it bounds are looser.
    fn bezier(&self, _face: u32, _rect: &UvRect, _key: u32) -> Option<Bicubic> {
        None
    }

    /// The texture coordinates `st` with their derivatives, if the surface has them.
    fn texcoord(&self, _face: u32, _uv: Vec2) -> Option<Texcoord> {
        None
    }

    /// The texture coordinates at all pairs of `us` and `vs`, as for [`evaluate_grid`](Self::evaluate_grid), and if
    /// asked for their first derivatives. False if the surface has none.
    fn texcoord_grid(
        &self,
        face: u32,
        us: &[f32],
        vs: &[f32],
        slopes: bool,
        out: &mut TexcoordGrid,
    ) -> bool {
        out.clear();
        for &v in vs {
            for &u in us {
                match self.texcoord(face, Vec2::new(u, v)) {
                    Some(texcoord) => out.push(&texcoord, slopes),
                    None => return false,
                }
            }
        }
        true
    }

    /// A rectangle of `st` that holds all texture coordinates of a rectangle of the face, rounding included.
    fn texcoord_hull(&self, _face: u32, _rect: &UvRect) -> Option<UvRect> {
        None
    }

    /// Bytes held, beyond the control mesh.
    fn memory(&self) -> usize;
}

/// A limit surface with the values that its file gives it: what shading asks of it. Primvars have numbers, their
/// slots.
pub trait Carrier: Base {
    /// The file's face that a face is a part of.
    fn parent(&self, face: u32) -> u32;

    /// The Ptex face that a point of a face is on, and the parameters there; none if there are no such faces.
    fn ptex(&self, _face: u32, _uv: Vec2) -> Option<(u32, Vec2)> {
        None
    }

    /// The derivatives of the parameters on the Ptex face by those of the face.
    fn ptex_slopes(&self, _face: u32, _uv: Vec2) -> [Vec2; 2] {
        [Vec2::X, Vec2::Y]
    }

    /// The slot of the primvar of this name, if the surface carries one of at least `width` components.
    fn slot(&self, name: &str, width: usize) -> Option<usize>;

    /// Whether the primvar of a slot is what [`Base::texcoord`] gives.
    fn is_texcoord(&self, slot: usize) -> bool;

    /// The first components of a primvar, as many as `out` is long and at most as many as it has.
    ///
    /// # Panics
    /// If there is no such slot, or it has fewer components.
    fn primvar(&self, slot: usize, face: u32, uv: Vec2, out: &mut [f32]);

    /// Two components of a primvar with their derivatives; nothing if it has fewer, or is the same all over a face.
    fn primvar_slopes(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord>;

    /// The same; second derivatives may be missing.
    fn primvar_first_slopes(&self, slot: usize, face: u32, uv: Vec2) -> Option<Texcoord> {
        self.primvar_slopes(slot, face, uv)
    }
}

/// One side of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EdgeUse {
    /// The number that all faces at the edge share.
    pub edge: u32,
    /// Whether the edge's own direction runs from the face's corner `k + 1` to its corner `k`.
    pub reversed: bool,
}

/// The parameters at `t` (0..1) of the way along edge `k` of a face, from corner `k` on.
pub fn edge_uv(k: u32, t: f32) -> Vec2 {
    match k {
        0 => Vec2::new(t, 0.0),
        1 => Vec2::new(1.0, t),
        2 => Vec2::new(1.0 - t, 1.0),
        _ => Vec2::new(0.0, 1.0 - t),
    }
}

/// A point of a limit surface with its derivatives by the face's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LimitPoint {
    /// The point.
    pub position: Vec3,
    /// First derivative by u.
    pub du: Vec3,
    /// First derivative by v.
    pub dv: Vec3,
    /// Second derivative by u twice.
    pub duu: Vec3,
    /// Second derivative by u and v.
    pub duv: Vec3,
    /// Second derivative by v twice.
    pub dvv: Vec3,
}

/// Texture coordinates with their derivatives by the face's parameters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Texcoord {
    /// The coordinates.
    pub st: Vec2,
    /// First derivative by u.
    pub du: Vec2,
    /// First derivative by v.
    pub dv: Vec2,
    /// Second derivative by u twice.
    pub duu: Vec2,
    /// Second derivative by u and v.
    pub duv: Vec2,
    /// Second derivative by v twice.
    pub dvv: Vec2,
}

impl Texcoord {
    /// What stands in for the texture coordinates of a surface that has none: the parameters.
    pub(super) fn of_parameters(uv: Vec2) -> Self {
        Self {
            st: uv,
            du: Vec2::X,
            dv: Vec2::Y,
            ..Self::default()
        }
    }
}

/// Texture coordinates at points of a face.
#[derive(Debug, Clone, Default)]
pub struct TexcoordGrid {
    /// The coordinates.
    pub st: Vec<Vec2>,
    /// First derivatives by u, where they were asked for; else none.
    pub du: Vec<Vec2>,
    /// First derivatives by v, likewise.
    pub dv: Vec<Vec2>,
    /// Room to evaluate them in.
    pub room: LimitGrid,
}

impl TexcoordGrid {
    /// Leaves no points.
    pub fn clear(&mut self) {
        self.st.clear();
        self.du.clear();
        self.dv.clear();
    }

    /// Adds a point, with its first derivatives if there are to be `slopes`.
    pub fn push(&mut self, texcoord: &Texcoord, slopes: bool) {
        self.st.push(texcoord.st);
        if slopes {
            self.du.push(texcoord.du);
            self.dv.push(texcoord.dv);
        }
    }
}

/// Limit points of a face with first derivatives, coordinate by coordinate so that loops over them vectorise.
#[derive(Debug, Clone, Default)]
pub struct LimitGrid {
    /// The x, y and z of the points.
    pub position: [Vec<f32>; 3],
    /// Of the derivatives by u.
    pub du: [Vec<f32>; 3],
    /// Of the derivatives by v.
    pub dv: [Vec<f32>; 3],
    /// Room for a kernel's weights.
    pub weights: Vec<f32>,
}

impl LimitGrid {
    /// Makes room for `count` points; what they hold is not specified.
    pub fn resize(&mut self, count: usize) {
        for values in [&mut self.position, &mut self.du, &mut self.dv] {
            for axis in values {
                axis.resize(count, 0.0);
            }
        }
    }

    /// How many points it has.
    pub fn len(&self) -> usize {
        self.position[0].len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Stores point `i`.
    pub fn set(&mut self, i: usize, point: &LimitPoint) {
        for axis in 0..3 {
            self.position[axis][i] = point.position[axis];
            self.du[axis][i] = point.du[axis];
            self.dv[axis][i] = point.dv[axis];
        }
    }

    /// The position of point `i`.
    pub fn position(&self, i: usize) -> Vec3 {
        let [x, y, z] = &self.position;
        Vec3::new(x[i], y[i], z[i])
    }

    /// The derivatives of point `i` by u and v.
    pub fn derivatives(&self, i: usize) -> [Vec3; 2] {
        [&self.du, &self.dv].map(|[x, y, z]| Vec3::new(x[i], y[i], z[i]))
    }
}

/// A rectangle of parameters; it may be a line or a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UvRect {
    /// Lower corner.
    pub min: Vec2,
    /// Upper corner.
    pub max: Vec2,
}

impl UvRect {
    /// A whole face.
    pub const UNIT: Self = Self {
        min: Vec2::ZERO,
        max: Vec2::ONE,
    };

    /// Its four quarters.
    pub fn quarters(&self) -> [Self; 4] {
        let middle = 0.5 * (self.min + self.max);
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let pick = |high: i32, min: f32, middle: f32, max: f32| {
                if high == 1 {
                    (middle, max)
                } else {
                    (min, middle)
                }
            };
            let (u0, u1) = pick(i, self.min.x, middle.x, self.max.x);
            let (v0, v1) = pick(j, self.min.y, middle.y, self.max.y);
            Self {
                min: Vec2::new(u0, v0),
                max: Vec2::new(u1, v1),
            }
        })
    }
}
