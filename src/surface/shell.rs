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
//! curved and no finer; displacement does not matter. How far the quads are from the limit surface is
//! [measured](Shell::achieved).
//!
//! Faces are cut as in dicing ([`Rates`], [`FaceGrid`]): neighbours have the same corners of the same bits along their
//! edge, and some quads there have two corners in one place. At the pole of a sphere all corners of a row are in one
//! place, each with its own parameters. Where the faces at an edge differ in more than roundings,
//! by their normals at a crease or by texture coordinates at a seam, it is [torn](Torn): each keeps its own, and who
//! displaces must join them.

use rayon::prelude::*;

use super::base::{LimitGrid, Texcoord, TexcoordGrid, edge_uv};
use super::dice::{Diced, FaceGrid, snapped};
use super::evaluate::{Surface, unit_normal};
use super::rates::Rates;
use crate::math::{Bounds3, Vec2, Vec3};

/// How far the quads may be from the limit surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShellTolerance {
    /// Distance in diagonals of the surface's bounds, above 0.
    pub distance: f32,
    /// Angle between the normals at the ends of a quad's side, radians, above 0. Between them a linear normal is too
    /// short by an eighth of the angle's square.
    pub angle: f32,
}

impl Default for ShellTolerance {
    /// A tenth of a pixel in a picture of a thousand; and heights true to a fourth of a percent.
    fn default() -> Self {
        Self {
            distance: 1e-4,
            angle: 0.15,
        }
    }
}

/// How far the quads are from the limit surface: the most that was found in the middles of quads and of their sides.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShellError {
    /// Between a quad and the limit surface along its normal, in units of the surface's points.
    pub distance: f32,
    /// Along the surface, between its point and that of the quad with the same parameters, in the same units.
    pub shift: f32,
    /// Between the normals there, radians.
    pub angle: f32,
    /// The distance that was asked for, in units of the surface's points.
    pub asked: f32,
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

/// The most quads along a face's side.
const MOST: u32 = 64;

/// How much it counts that a quad's parameters shift the displacement along the surface.
const SHIFT: f32 = 0.1;

/// Points along a side of the grid that tells how curved a face is.
const PROBES: usize = 9;

/// Cosine of the angle below which two faces' normals at one point are one, but for roundings: a milliradian.
const SAME_NORMAL: f32 = 1.0 - 5e-7;

/// Texture coordinates that differ by less than this are one, but for roundings: a fiftieth of a texel in 2000.
const SAME_TEXCOORD: f32 = 1e-5;

/// What a face has at a point, by its own evaluation; normals by motion key.
#[derive(Debug, Clone, PartialEq, Default)]
struct Own {
    normals: Vec<Vec3>,
    st: Vec2,
}

impl Own {
    /// Takes another's bits for what is the same but for roundings; what differs.
    fn join(&mut self, other: &Self) -> Torn {
        let same = |(a, b): (&Vec3, &Vec3)| a == b || a.dot(*b) >= SAME_NORMAL;
        let normals = self.normals.iter().zip(&other.normals).all(same);
        if normals {
            self.normals.clone_from(&other.normals);
        }
        let size = self.st.abs().max_element().max(1.0);
        let texcoords = (self.st - other.st).abs().max_element() <= SAME_TEXCOORD * size;
        if texcoords {
            self.st = other.st;
        }
        Torn {
            normals: !normals,
            texcoords: !texcoords,
        }
    }
}

impl Torn {
    fn or(self, other: Self) -> Self {
        Self {
            normals: self.normals || other.normals,
            texcoords: self.texcoords || other.texcoords,
        }
    }
}

impl Shell {
    /// Cuts the limit surface that `surface` displaces, on all threads; the same bytes for any number of them.
    pub fn new(surface: &Surface, tolerance: &ShellTolerance) -> Self {
        let flat = surface.undisplaced();
        let keys = flat.base().keys();
        let diagonal = bounds(&flat).extent().length();
        let asked = tolerance.distance * diagonal;
        let needs: Vec<[u32; 2]> = (0..flat.base().faces())
            .into_par_iter()
            .map_init(Probe::default, |probe, face| {
                probe.needs(&flat, face, asked, tolerance.angle)
            })
            .collect();
        let rates = Rates::by_face(&flat, &needs);
        let diced = Diced::new(&flat, &rates);
        let mut joined = Joined::new(&flat, &rates);
        joined.join(&flat);

        let mut grids = diced.grids().to_vec();
        for grid in &mut grids {
            // An edge that is but a point has as many corners there as the other side, with the parameters of each.
            for k in (0..4).filter(|&k| flat.base().is_collapsed(grid.face, k)) {
                grid.segments[k as usize] = grid.size[(k % 2) as usize];
            }
        }
        let made: Vec<(Vec<Own>, ShellError)> = grids
            .par_iter()
            .map(|grid| {
                let own = joined.grid(&flat, grid);
                let error = error(&flat, grid, &diced, &own);
                (own, error)
            })
            .collect();
        let achieved = made.iter().fold(
            ShellError {
                asked,
                ..ShellError::default()
            },
            |a, (_, b)| ShellError {
                distance: a.distance.max(b.distance),
                shift: a.shift.max(b.shift),
                angle: a.angle.max(b.angle),
                asked,
            },
        );
        let own = || made.iter().flat_map(|(own, _)| own);
        let points = (0..keys as usize)
            .map(|key| {
                let positions = &diced.positions()[key];
                let points = positions.iter().zip(own());
                let point = |(&position, own): (&Vec3, &Own)| ShellPoint {
                    position,
                    normal: own.normals[key],
                };
                points.map(point).collect()
            })
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

    /// How many quads there are, those with two corners in one place included.
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

/// A few points of a face that tell how curved it is.
#[derive(Default)]
struct Probe {
    limit: LimitGrid,
    normals: Vec<Vec3>,
    texcoords: TexcoordGrid,
}

impl Probe {
    /// How many quads a face needs along u and v, powers of two.
    fn needs(&mut self, flat: &Surface, face: u32, distance: f32, angle: f32) -> [u32; 2] {
        let base = flat.base();
        if base.is_hole(face) {
            return [1; 2];
        }
        let at: [f32; PROBES] = std::array::from_fn(|i| i as f32 / (PROBES - 1) as f32);
        let mut needs = [1_u32; 2];
        for key in 0..base.keys() {
            base.evaluate_grid(face, &at, &at, key, &mut self.limit);
            self.normals.clear();
            self.normals.extend((0..self.limit.len()).map(|i| {
                let uv = Vec2::new(at[i % PROBES], at[i / PROBES]);
                normal(flat, face, uv, key, self.limit.derivatives(i))
            }));
            if !(flat.has_texcoords()
                && base.texcoord_grid(face, &at, &at, true, &mut self.texcoords))
            {
                self.texcoords.clear();
            }
            for (axis, need) in needs.iter_mut().enumerate() {
                *need = self.need(axis, distance, angle).max(*need);
            }
        }
        needs
    }

    /// Of 1, 2 and 4 quads along an axis the first that is good enough; beyond, from how the errors of 4 shrink.
    fn need(&self, axis: usize, distance: f32, angle: f32) -> u32 {
        let mut needed = 1.0_f32;
        for quads in [1, 2, 4] {
            let (off, turned) = self.errors(axis, (PROBES - 1) / quads);
            // Distances shrink by the square, angles as they are.
            let factor = (off / distance).sqrt().max(turned / angle);
            if factor <= 1.0 || !factor.is_finite() {
                return quads as u32;
            }
            needed = quads as f32 * factor;
        }
        (needed.ceil().min(MOST as f32) as u32).next_power_of_two()
    }

    /// The largest distance from chords that are so many steps long, and the largest angle between the normals at
    /// their ends. What is off along the surface, by its parameters or texture coordinates, shifts the displacement and
    /// counts to a tenth.
    fn errors(&self, axis: usize, stride: usize) -> (f32, f32) {
        let (mut off, mut angle) = (0.0_f32, 0.0_f32);
        for line in 0..PROBES {
            let point = |i: usize| {
                if axis == 0 {
                    line * PROBES + i
                } else {
                    i * PROBES + line
                }
            };
            for start in (0..PROBES - 1).step_by(stride) {
                let [a, m, b] = [start, start + stride / 2, start + stride].map(point);
                let position = |i: usize| self.limit.position(i);
                let chord = position(m) - 0.5 * (position(a) + position(b));
                let across = chord.dot(self.normals[m]).abs();
                off = off.max(across).max(SHIFT * chord.length());
                angle = angle.max(self.normals[a].angle_between(self.normals[b]));
                if let [_, ..] = self.texcoords.st[..] {
                    let st = |i: usize| self.texcoords.st[i];
                    let shift = st(m).distance(0.5 * (st(a) + st(b)));
                    let (along, length) =
                        (st(a).distance(st(b)), position(a).distance(position(b)));
                    if along > 0.0 {
                        off = off.max(SHIFT * shift * length / along);
                    }
                }
            }
        }
        (off, angle)
    }
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

/// What faces have along their edges, and what they share of it.
struct Joined {
    /// By edge and side, in the order of the adjacency: at the edge's samples, both ends included, in its own
    /// direction.
    edges: Vec<Vec<Vec<Own>>>,
    torn_edges: Vec<Torn>,
    torn_vertices: Vec<Torn>,
}

impl Joined {
    /// Each face's own.
    fn new(flat: &Surface, rates: &Rates) -> Self {
        let of_edge = |edge: u32| {
            let segments = rates.edge(edge);
            let sides = flat.adjacency.edge(edge);
            let of_side = |side: super::adjacency::Side| {
                let sample = |s: u32| {
                    let t = s as f32 / segments as f32;
                    let uv = edge_uv(side.k, if side.reversed { 1.0 - t } else { t });
                    own(flat, side.face, uv)
                };
                (0..=segments).map(sample).collect()
            };
            sides.map(of_side).collect()
        };
        let count = flat.adjacency.edge_count();
        Self {
            edges: (0..count).into_par_iter().map(of_edge).collect(),
            torn_edges: vec![Torn::default(); count as usize],
            torn_vertices: vec![Torn::default(); flat.adjacency.vertex_count() as usize],
        }
    }

    /// Gives all sides the same bits where they agree.
    fn join(&mut self, flat: &Surface) {
        // Within edges: the first side's.
        for sides in &mut self.edges {
            let Some((first, others)) = sides.split_first_mut() else {
                continue;
            };
            let inner = 1..first.len() - 1;
            for other in others {
                for s in inner.clone() {
                    let _ = other[s].join(&first[s]);
                }
            }
        }
        // At vertices: of those that agree, the first one's.
        for vertex in 0..flat.adjacency.vertex_count() {
            let mut kinds: Vec<Own> = Vec::new();
            let mut torn = Torn::default();
            for corner in flat.adjacency.vertex(vertex) {
                for (k, at_end) in [(corner.k, false), ((corner.k + 3) % 4, true)] {
                    let used = flat.base().edge(corner.face, k);
                    let same =
                        |side: super::adjacency::Side| side.face == corner.face && side.k == k;
                    let Some(side) = flat.adjacency.edge(used.edge).position(same) else {
                        continue;
                    };
                    let samples = &mut self.edges[used.edge as usize][side];
                    let s = if at_end == used.reversed {
                        0
                    } else {
                        samples.len() - 1
                    };
                    let mut differs = Torn::default();
                    let mut known = false;
                    for kind in &kinds {
                        let torn = samples[s].join(kind);
                        known |= torn == Torn::default();
                        differs = differs.or(torn);
                        if known {
                            break;
                        }
                    }
                    torn = torn.or(differs);
                    if !known {
                        kinds.push(samples[s].clone());
                    }
                }
            }
            self.torn_vertices[vertex as usize] = torn;
        }
        for (sides, torn) in self.edges.iter().zip(&mut self.torn_edges) {
            let Some((first, others)) = sides.split_first() else {
                continue;
            };
            for (a, b) in others.iter().flat_map(|other| first.iter().zip(other)) {
                *torn = torn.or(Torn {
                    normals: a.normals != b.normals,
                    texcoords: a.st != b.st,
                });
            }
        }
    }

    /// What a face has at all vertices of its grid.
    fn grid(&self, flat: &Surface, grid: &FaceGrid) -> Vec<Own> {
        let [nu, nv] = grid.size;
        let mut all = Vec::with_capacity((usize::from(nu) + 1) * (usize::from(nv) + 1));
        for (i, j) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))) {
            let on_edges = [
                (j == 0).then_some((0, i, nu)),
                (i == nu).then_some((1, j, nv)),
                (j == nv).then_some((2, nu - i, nu)),
                (i == 0).then_some((3, nv - j, nv)),
            ];
            let is_line = |(k, ..): &(u32, u16, u16)| !flat.base().is_collapsed(grid.face, *k);
            let along = on_edges.into_iter().flatten().find(is_line);
            all.push(match along {
                None => own(flat, grid.face, grid.vertex_uv(i, j)),
                Some((k, x, n)) => {
                    let used = flat.base().edge(grid.face, k);
                    let same = |side: super::adjacency::Side| side.face == grid.face && side.k == k;
                    let side = flat.adjacency.edge(used.edge).position(same).unwrap_or(0);
                    let samples = &self.edges[used.edge as usize][side];
                    let s = usize::from(snapped(x, n, grid.segments[k as usize]));
                    let s = if used.reversed {
                        samples.len() - 1 - s
                    } else {
                        s
                    };
                    samples[s].clone()
                }
            });
        }
        all
    }
}

fn own(flat: &Surface, face: u32, uv: Vec2) -> Own {
    let of_key = |key: u32| {
        let limit = flat.base().first_order(face, uv, key);
        normal(flat, face, uv, key, [limit.du, limit.dv])
    };
    let texcoord = if flat.has_texcoords() {
        flat.texcoord(face, uv)
    } else {
        Texcoord::of_parameters(uv)
    };
    Own {
        normals: (0..flat.base().keys()).map(of_key).collect(),
        st: texcoord.st,
    }
}

/// How far the quads of a face are from it: in their middles, and in those of two of their sides.
fn error(flat: &Surface, grid: &FaceGrid, diced: &Diced, own: &[Own]) -> ShellError {
    let mut error = ShellError::default();
    let [nu, nv] = grid.size;
    for (i, j) in (0..nv).flat_map(|j| (0..nu).map(move |i| (i, j))) {
        let corners = Shell::corners(grid, i, j);
        for uv in [Vec2::splat(0.5), Vec2::new(0.5, 0.0), Vec2::new(0.0, 0.5)] {
            let at = Shell::face_uv(grid, i, j, uv);
            for key in 0..flat.base().keys() {
                let limit = flat.base().first_order(grid.face, at, key);
                let mix = |[a, b, c, d]: [Vec3; 4]| (a.lerp(b, uv.x)).lerp(c.lerp(d, uv.x), uv.y);
                let position = mix(corners.map(|c| diced.positions()[key as usize][c]));
                let first = grid.first_vertex as usize;
                let linear = mix(corners.map(|c| own[c - first].normals[key as usize]));
                let exact = normal(flat, grid.face, at, key, [limit.du, limit.dv]);
                let off = position - limit.position;
                let across = off.dot(exact).abs();
                error.distance = error.distance.max(across);
                error.shift = error
                    .shift
                    .max((off.length_squared() - across * across).max(0.0).sqrt());
                if linear != Vec3::ZERO && exact != Vec3::ZERO {
                    error.angle = error.angle.max(linear.angle_between(exact));
                }
            }
        }
    }
    error
}
