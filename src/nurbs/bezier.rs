//! The surface cut at its knots into rational Bezier pieces: faces on the unit square that know their neighbours.
//!
//! Cutting is Bezier extraction (Borden, Scott, Evans, Hughes 2011, *Isogeometric finite element data structures based
//! on Bézier extraction of NURBS*): Bezier points are fixed weighted sums of control points, one set for a direction.
//! The weights come from the polar form, see [`super::basis`]; spans, ranges that end within a span and knots of any
//! multiplicity need no cases of their own.
//!
//! Which pieces meet is decided by the points, not by what the file says of its form. Two border lines meet where
//! all their Bezier points agree within [`Tolerance`]; then they are made equal to the bit and get one identity. The
//! same goes for the two sides of a knot that is repeated so often that the surface may break there, and for the points
//! of an edge that is shrunk to one place, as at a pole: its two ends become one vertex.

use super::basis::{self, Weights};
use super::surface::{NurbsSurface, SurfacePoint, apply_rows};
use crate::error::Fault;
use crate::math::{Bounds3, DVec3, DVec4, DisjointSets, Vec3};
use crate::mesh::{MAX_ORDER, NurbsDirection};

/// How a face meets an edge of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EdgeUse {
    /// The edge's number; the other face with this number lies across.
    pub edge: u32,
    /// Edges run towards the larger parameter. Whether the face's boundary, counterclockwise, runs the other way.
    pub reversed: bool,
}

/// A NURBS surface as a list of faces, each on the unit square.
///
/// Face `i + j * columns` is piece i along u and j along v. Derivatives are by the face's own parameters.
#[derive(Debug, Clone)]
pub struct BezierFaces {
    axes: [Axis; 2],
    /// Bezier points (w P, w) at each motion key, u fastest.
    points: Vec<Vec<DVec4>>,
    /// Vertices by line along u, then line along v.
    vertices: Vec<u32>,
    vertex_count: u32,
}

/// The pieces along one parameter.
#[derive(Debug, Clone)]
struct Axis {
    order: usize,
    pieces: Vec<Piece>,
    /// Bezier points in a row along it.
    points: usize,
    /// Different lines across it.
    lines: usize,
}

#[derive(Debug, Clone, Copy)]
struct Piece {
    part: [f64; 2],
    /// Its first Bezier point in a row.
    first: usize,
    /// Lines at its two ends.
    lines: [usize; 2],
}

/// How far points may differ and count as one: four roundings of the largest coordinate to single precision, which
/// files hold; but no more than 1e-5 of the surface's size, for those far away from the origin.
struct Tolerance(f64);

/// Bezier points beyond this many are refused; 8 GB would be needed for them.
const MOST_POINTS: usize = 1 << 28;

impl BezierFaces {
    /// Cuts a surface.
    ///
    /// # Errors
    /// A surface with more Bezier points than memory is likely to hold.
    pub fn new(surface: &NurbsSurface) -> Result<Self, Fault> {
        let [(u, rows_u), (v, rows_v)] = [0, 1].map(|a| extract(&surface.directions()[a]));
        if u.points.saturating_mul(v.points) > MOST_POINTS {
            return Err(Fault::new(format!(
                "the patch has {} x {} Bezier points, too many to hold",
                u.points, v.points
            ))
            .advise("split the patch into several, or lower its order"));
        }
        let points = (0..surface.key_count())
            .map(|key| {
                let net = surface.control_points(key);
                let width = surface.directions()[0].count;
                let along_u = apply_rows(net, width, 0, u.order, &rows_u);
                apply_rows(&along_u, u.points, 1, v.order, &rows_v)
            })
            .collect();
        let mut faces = Self {
            axes: [u, v],
            points,
            vertices: Vec::new(),
            vertex_count: 0,
        };
        let tolerance = faces.tolerance();
        faces.join(0, &tolerance);
        faces.join(1, &tolerance);
        faces.number_vertices(&tolerance);
        Ok(faces)
    }

    /// How many faces there are.
    pub fn face_count(&self) -> usize {
        self.axes[0].pieces.len() * self.axes[1].pieces.len()
    }

    /// How many pieces there are along u and along v.
    pub fn pieces(&self) -> [usize; 2] {
        [0, 1].map(|a| self.axes[a].pieces.len())
    }

    /// Bezier points of a face along u and along v.
    pub fn orders(&self) -> [usize; 2] {
        [0, 1].map(|a| self.axes[a].order)
    }

    /// How many motion keys there are.
    pub fn key_count(&self) -> usize {
        self.points.len()
    }

    /// Edges have numbers below this.
    pub fn edge_count(&self) -> usize {
        let [u, v] = &self.axes;
        u.pieces.len() * v.lines + u.lines * v.pieces.len()
    }

    /// Vertices have numbers below this.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count as usize
    }

    /// Whether the surface's two borders across u (`axis` 0) or v (1) are one line.
    pub fn is_closed(&self, axis: usize) -> bool {
        let pieces = &self.axes[axis].pieces;
        pieces[0].lines[0] == pieces[pieces.len() - 1].lines[1]
    }

    /// The part of the surface's own parameters that the face covers: from and to, in u and in v.
    pub fn parameters(&self, face: usize) -> [[f64; 2]; 2] {
        self.of_face(face).map(|piece| piece.part)
    }

    /// The face at the surface's parameters, and where on it. On a border it is the face of the larger parameter.
    pub fn locate(&self, parameters: [f64; 2]) -> (usize, [f64; 2]) {
        let [(i, u), (j, v)] = [0, 1].map(|axis| {
            let pieces = &self.axes[axis].pieces;
            let t = parameters[axis];
            let piece = pieces.partition_point(|p| p.part[0] <= t).max(1) - 1;
            let [low, high] = pieces[piece].part;
            (piece, ((t - low) / (high - low)).clamp(0.0, 1.0))
        });
        (i + j * self.axes[0].pieces.len(), [u, v])
    }

    /// The point at `uv` in the unit square of a face, at the first motion key.
    pub fn evaluate(&self, face: usize, uv: [f64; 2]) -> SurfacePoint {
        self.evaluate_at_key(0, face, uv)
    }

    /// The point at `uv` in the unit square of a face, at a motion key.
    pub fn evaluate_at_key(&self, key: usize, face: usize, uv: [f64; 2]) -> SurfacePoint {
        // Bicubic pieces are what occurs; the scratch space of high orders would cost them as much as the sums.
        if self.axes[0].order.max(self.axes[1].order) <= 4 {
            self.evaluate_in::<4>(key, face, uv)
        } else {
            self.evaluate_in::<MAX_ORDER>(key, face, uv)
        }
    }

    fn evaluate_in<const N: usize>(&self, key: usize, face: usize, uv: [f64; 2]) -> SurfacePoint {
        let [orders_u, orders_v] = [self.axes[0].order, self.axes[1].order];
        let u = basis::bernstein::<N>(orders_u - 1, uv[0]);
        let v = basis::bernstein::<N>(orders_v - 1, uv[1]);
        let [across, along] = self.of_face(face).map(|piece| piece.first);
        let mut sums = [DVec4::ZERO; 6];
        let width = self.axes[0].points;
        let rows = self.points[key].chunks_exact(width).skip(along);
        for (j, points) in rows.take(orders_v).enumerate() {
            let mut row = [DVec4::ZERO; 3];
            for (i, point) in points[across..across + orders_u].iter().enumerate() {
                for (sum, weights) in row.iter_mut().zip(&u) {
                    *sum += *point * weights[i];
                }
            }
            for (sum, [by_u, by_v]) in
                sums.iter_mut()
                    .zip([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]])
            {
                *sum += row[by_u] * v[by_v][j];
            }
        }
        SurfacePoint::from_homogeneous(sums)
    }

    /// The unit normal at the first motion key, along dP/du x dP/dv.
    ///
    /// Where that product vanishes, as at a pole, it is the limit along the straight way to the face's middle: the
    /// product's derivative in that direction. Where that vanishes too, the normal of the first place on that
    /// way that has one, in steps of 2^-20, 2^-19, ... of it. Zero only if there is none at all.
    pub fn normal(&self, face: usize, uv: [f64; 2]) -> DVec3 {
        let size = self.size(face);
        // Products below this are roundings of points that lie `size` apart.
        let enough = |n: &DVec3| n.length() > 1e-12 * size * size;
        let point = self.evaluate(face, uv);
        let normal = point.du.cross(point.dv);
        if enough(&normal) {
            return normal.normalize();
        }
        let [a, b] = uv.map(|t| 0.5 - t);
        let along = (a * point.duu + b * point.duv).cross(point.dv)
            + point.du.cross(a * point.duv + b * point.dvv);
        if enough(&along) {
            return along.normalize();
        }
        (0..=20)
            .map(|k| 2.0_f64.powi(k - 20))
            .map(|t| self.evaluate(face, [uv[0] + t * a, uv[1] + t * b]))
            .map(|p| p.du.cross(p.dv).normalize_or_zero())
            .find(|n| *n != DVec3::ZERO)
            .unwrap_or(DVec3::ZERO)
    }

    /// Edge `k` of a face: 0 at v = 0, 1 at u = 1, 2 at v = 1, 3 at u = 0.
    ///
    /// # Panics
    /// If `k` is above 3.
    pub fn edge(&self, face: usize, k: usize) -> EdgeUse {
        let [u, v] = self.of_face(face);
        let columns = self.axes[0].pieces.len();
        let (i, j) = (face % columns, face / columns);
        let along_u = |line: usize| i * self.axes[1].lines + line;
        let along_v =
            |line: usize| columns * self.axes[1].lines + line * self.axes[1].pieces.len() + j;
        let edge = match k {
            0 => along_u(v.lines[0]),
            1 => along_v(u.lines[1]),
            2 => along_u(v.lines[1]),
            3 => along_v(u.lines[0]),
            _ => panic!("edge {k} of a face with four"),
        };
        EdgeUse {
            edge: edge as u32,
            reversed: k >= 2,
        }
    }

    /// The vertex at a corner of a face: 0 at (0, 0), 1 at (1, 0), 2 at (1, 1), 3 at (0, 1).
    ///
    /// # Panics
    /// If `corner` is above 3.
    pub fn vertex(&self, face: usize, corner: usize) -> u32 {
        let [u, v] = self.of_face(face);
        let [x, y] = [[0, 0], [1, 0], [1, 1], [0, 1]][corner];
        self.vertices[u.lines[x] * self.axes[1].lines + v.lines[y]]
    }

    /// A box that holds the face at a motion key, for certain: around its Bezier points, rounded outward.
    pub fn bounds(&self, key: usize, face: usize) -> Bounds3 {
        let mut bounds = Bounds3::EMPTY;
        for point in self.hull(key, face) {
            // A step of f32 is far more than an f64 sum of the points can stray from their hull by rounding.
            bounds.min = bounds.min.min(step(point, f32::next_down));
            bounds.max = bounds.max.max(step(point, f32::next_up));
        }
        bounds
    }

    /// The Bezier points of a face as places in space, u fastest: its convex hull holds the face.
    pub fn hull(&self, key: usize, face: usize) -> impl Iterator<Item = DVec3> + '_ {
        let [across, along] = self.of_face(face).map(|piece| piece.first);
        let width = self.axes[0].points;
        (along..along + self.axes[1].order).flat_map(move |j| {
            self.points[key][j * width + across..][..self.axes[0].order]
                .iter()
                .map(|p| p.truncate() / p.w)
        })
    }

    /// The homogeneous Bezier points (w P, w) of the part of a face from `low` to `high`, u fastest. The part may be a
    /// line or a point.
    pub fn part(&self, key: usize, face: usize, low: [f64; 2], high: [f64; 2]) -> Vec<DVec4> {
        let [across, along] = self.of_face(face).map(|piece| piece.first);
        let (width, [columns, rows]) = (self.axes[0].points, self.orders());
        let mut out = Vec::with_capacity(columns * rows);
        for row in self.points[key].chunks_exact(width).skip(along).take(rows) {
            let mut line = row[across..across + columns].to_vec();
            restrict(&mut line, low[0], high[0]);
            out.extend(line);
        }
        for column in 0..columns {
            let mut line: Vec<DVec4> = (0..rows).map(|r| out[r * columns + column]).collect();
            restrict(&mut line, low[1], high[1]);
            for (r, point) in line.into_iter().enumerate() {
                out[r * columns + column] = point;
            }
        }
        out
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        self.points
            .iter()
            .map(|points| size_of_val(points.as_slice()))
            .sum::<usize>()
            + size_of_val(self.vertices.as_slice())
    }

    fn of_face(&self, face: usize) -> [&Piece; 2] {
        let [u, v] = &self.axes;
        let columns = u.pieces.len();
        [&u.pieces[face % columns], &v.pieces[face / columns]]
    }

    fn size(&self, face: usize) -> f64 {
        extent(self.hull(0, face)).0
    }

    fn tolerance(&self) -> Tolerance {
        let all = self.points.iter().flatten().map(|p| p.truncate() / p.w);
        let (size, largest) = extent(all);
        Tolerance((4.0 * f64::from(f32::EPSILON) * largest).min(1e-5 * size))
    }

    // Identities.

    /// Joins the borders across `axis`, and the sides of each break, where their points agree.
    fn join(&mut self, axis: usize, tolerance: &Tolerance) {
        let order = self.axes[axis].order;
        for piece in 1..self.axes[axis].pieces.len() {
            let [before, after] = [piece - 1, piece].map(|i| self.axes[axis].pieces[i]);
            let last = before.first + order - 1;
            if last == after.first {
                continue;
            }
            if self.made_equal(axis, last, after.first, tolerance) {
                let pieces = &mut self.axes[axis].pieces;
                pieces[piece].lines[0] = before.lines[1];
            }
        }
        let last = self.axes[axis].points - 1;
        if self.made_equal(axis, 0, last, tolerance) {
            let pieces = &mut self.axes[axis].pieces;
            let (line, end) = (pieces[0].lines[0], pieces.len() - 1);
            pieces[end].lines[1] = line;
        }
        self.axes[axis].renumber_lines();
    }

    /// Copies the points of line `a` across `axis` onto those of line `b`, if they agree.
    fn made_equal(&mut self, axis: usize, a: usize, b: usize, tolerance: &Tolerance) -> bool {
        let width = self.axes[0].points;
        let across = self.axes[1 - axis].points;
        let at = |line: usize, k: usize| match axis {
            0 => k * width + line,
            _ => line * width + k,
        };
        let equal = self.points.iter().all(|points| {
            (0..across).all(|k| tolerance.one_place(points[at(a, k)], points[at(b, k)]))
        });
        if equal {
            for points in &mut self.points {
                for k in 0..across {
                    points[at(b, k)] = points[at(a, k)];
                }
            }
        }
        equal
    }

    /// Numbers the vertices: one for each crossing of lines, and the two ends of a shrunk edge are one.
    fn number_vertices(&mut self, tolerance: &Tolerance) {
        let [lines_u, lines_v] = [self.axes[0].lines, self.axes[1].lines];
        let mut sets = DisjointSets::new(lines_u * lines_v);
        for axis in [0, 1] {
            for (ends, points) in self.edges_along(axis) {
                if self.shrink(&points, tolerance) {
                    let [a, b] = ends;
                    sets.join(a, b);
                }
            }
        }
        // A root has the smallest number of its set, so it is numbered before the others ask for it.
        let mut numbers = vec![0; lines_u * lines_v];
        for v in 0..lines_u * lines_v {
            let r = sets.least(v);
            numbers[v] = if r == v {
                self.vertex_count += 1;
                self.vertex_count - 1
            } else {
                numbers[r]
            };
        }
        self.vertices = numbers;
    }

    /// The edges along `axis` in order: crossings of lines at both ends, and numbers of their Bezier points.
    fn edges_along(&self, axis: usize) -> Vec<([usize; 2], Vec<usize>)> {
        let [own, other] = [&self.axes[axis], &self.axes[1 - axis]];
        let width = self.axes[0].points;
        let mut out = Vec::new();
        let sides = other.pieces.iter().flat_map(|p| {
            [
                (p.lines[0], p.first),
                (p.lines[1], p.first + other.order - 1),
            ]
        });
        for (line, row) in sides {
            for piece in &own.pieces {
                let ends = piece.lines.map(|l| match axis {
                    0 => l * self.axes[1].lines + line,
                    _ => line * self.axes[1].lines + l,
                });
                let point = |k: usize| match axis {
                    0 => row * width + k,
                    _ => k * width + row,
                };
                let points = (piece.first..piece.first + own.order).map(point).collect();
                out.push((ends, points));
            }
        }
        out
    }

    /// Moves the points of an edge to the first of them, if all agree with it.
    fn shrink(&mut self, edge: &[usize], tolerance: &Tolerance) -> bool {
        let place = |p: DVec4| p.truncate() / p.w;
        let one = self.points.iter().all(|points| {
            let first = place(points[edge[0]]);
            edge.iter()
                .all(|&i| tolerance.near(first, place(points[i])))
        });
        if one {
            for points in &mut self.points {
                let first = place(points[edge[0]]);
                for &i in edge {
                    let w = points[i].w;
                    points[i] = (w * first).extend(w);
                }
            }
        }
        one
    }
}

impl Tolerance {
    fn near(&self, a: DVec3, b: DVec3) -> bool {
        a.distance(b) <= self.0
    }

    /// Whether two points and their weights are the same.
    fn one_place(&self, a: DVec4, b: DVec4) -> bool {
        (a.w - b.w).abs() <= 1e-12 * a.w && self.near(a.truncate() / a.w, b.truncate() / b.w)
    }
}

impl Axis {
    /// Makes line numbers consecutive.
    fn renumber_lines(&mut self) {
        let mut used: Vec<usize> = self.pieces.iter().flat_map(|p| p.lines).collect();
        used.sort_unstable();
        used.dedup();
        for line in self.pieces.iter_mut().flat_map(|p| &mut p.lines) {
            *line = used.partition_point(|u| u < line);
        }
        self.lines = used.len();
    }
}

/// The pieces along a direction and, for each Bezier point, the control points that it is a weighted sum of.
fn extract(direction: &NurbsDirection) -> (Axis, Vec<(usize, Weights)>) {
    let (order, degree) = (direction.order, direction.degree());
    let mut rows: Vec<(usize, Weights)> = Vec::new();
    let mut pieces: Vec<Piece> = Vec::new();
    let mut lines = 0;
    let mut before = None;
    for (span, part) in direction.spans() {
        // The knot between two spans occurs as often as their numbers differ; more often than the degree, the
        // surface may break there.
        let joined = before.is_some_and(|b| span - b <= degree);
        before = Some(span);
        if !joined {
            lines += 1;
        }
        let first = if joined { rows.len() - 1 } else { rows.len() };
        for k in usize::from(joined)..order {
            let mut arguments = [part[0]; MAX_ORDER];
            arguments[..k].fill(part[1]);
            let mut weights = [0.0; MAX_ORDER];
            basis::polar(
                &direction.knots,
                order,
                span,
                &arguments[..degree],
                &mut weights,
            );
            rows.push((span - degree, weights));
        }
        lines += 1;
        pieces.push(Piece {
            part,
            first,
            lines: [lines - 2, lines - 1],
        });
    }
    let axis = Axis {
        order,
        pieces,
        points: rows.len(),
        lines,
    };
    (axis, rows)
}

/// The Bezier points of a curve's part from `a` to `b`: cut off behind `b`, then before `a` (de Casteljau).
fn restrict(points: &mut [DVec4], a: f64, b: f64) {
    let last = points.len() - 1;
    if b < 1.0 {
        for n in 1..=last {
            for k in (n..=last).rev() {
                points[k] = points[k - 1].lerp(points[k], b);
            }
        }
    }
    if a > 0.0 {
        let a = (a / b).min(1.0);
        for n in (0..last).rev() {
            for k in 0..=n {
                points[k] = points[k].lerp(points[k + 1], a);
            }
        }
    }
}

/// Diagonal of the box around some points, and the largest coordinate.
fn extent(points: impl Iterator<Item = DVec3>) -> (f64, f64) {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in points {
        (min, max) = (min.min(p), max.max(p));
    }
    ((max - min).length(), min.abs().max(max.abs()).max_element())
}

fn step(p: DVec3, to: fn(f32) -> f32) -> Vec3 {
    Vec3::from(p.as_vec3().to_array().map(to))
}
