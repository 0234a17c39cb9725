//! Dicing: a surface cut into grids of micro-vertices without cracks.
//!
//! Each face that is not a hole becomes one grid, as fine along u as its finest edge in that direction, and likewise
//! along v. Vertices on a border whose edge has fewer segments than the grid are snapped onto the edge's own shared
//! samples: border vertex x of n goes to sample floor((2 x + 1) c / (2 n)) of the edge's c segments (Benthin, Woop,
//! Nießner, Selgrad, Wald, "Efficient Ray Tracing of Subdivision Surfaces using Tessellation Caching", 2015). Both
//! faces thus show the same polyline of the same bits along their edge, and some triangles there have two corners in
//! one place. Unlike the paper both take the samples from one owner instead of evaluating them alike.
//!
//! ```text
//!   c --- d      A cell of a grid is two triangles: 0 is (a, b, c), 1 is (d, c, b).
//!   | 1 / |      Corner a is the one of least u and v; u grows to b, v to c.
//!   | / 0 |
//!   a --- b
//! ```

use std::ops::RangeInclusive;
use std::sync::Arc;

use rayon::prelude::*;

use super::base::{UvRect, edge_uv};
use super::evaluate::Surface;
use super::rates::Rates;
use super::shared::{Scratch, SharedSamples, split};
use crate::error::{Error, Result};
use crate::math::{Vec2, Vec3};
use crate::memory::filled;

/// Points of a face that are evaluated at once, about: each takes some ten times its own size meanwhile.
const POINTS_AT_ONCE: usize = 1 << 16;

/// A face's part of a [`Diced`] surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaceGrid {
    /// The face of the base.
    pub face: u32,
    /// Cells along u and v, at least 1.
    pub size: [u16; 2],
    /// The segments of its four edges, each at most those of the grid beside it.
    pub segments: [u16; 4],
    /// The first of its vertices, which follow one another row by row, u running faster.
    pub first_vertex: u64,
    /// The first of its triangles: cell by cell, row by row, two a cell.
    pub first_triangle: u64,
}

/// A surface cut into micro-triangles.
#[derive(Debug, Clone)]
pub struct Diced {
    /// By motion key, evenly over the shutter.
    positions: Arc<Vec<Vec<Vec3>>>,
    grids: Arc<Grids>,
    left_handed: bool,
}

/// The grids of a [`Diced`] surface without its micro-vertices: all that is needed to go from a triangle to the face.
#[derive(Debug, Clone)]
pub struct Grids(Vec<FaceGrid>);

impl FaceGrid {
    /// The grid of a face that is not a hole, as the first one of a surface.
    pub fn new(surface: &Surface, rates: &Rates, face: u32) -> Self {
        let edge = |k: u32| rates.edge(surface.base().edge(face, k).edge) as u16;
        Self {
            face,
            size: rates.face(face).map(|n| n as u16),
            segments: [0, 1, 2, 3].map(edge),
            first_vertex: 0,
            first_triangle: 0,
        }
    }

    /// Vertices along u and v.
    pub fn vertices(&self) -> [u64; 2] {
        self.size.map(|n| u64::from(n) + 1)
    }

    /// The number of the vertex in column `i` of row `j`.
    pub fn vertex(&self, i: u16, j: u16) -> u64 {
        self.first_vertex + u64::from(j) * self.vertices()[0] + u64::from(i)
    }

    /// The face's parameters of the vertex in column `i` of row `j`, where it was snapped to.
    #[inline]
    pub fn vertex_uv(&self, i: u16, j: u16) -> Vec2 {
        let [nu, nv] = self.size;
        if (1..nu).contains(&i) && (1..nv).contains(&j) {
            Vec2::new(f32::from(i) / f32::from(nu), f32::from(j) / f32::from(nv))
        } else {
            self.border_uv(i, j)
        }
    }

    fn border_uv(&self, i: u16, j: u16) -> Vec2 {
        let [nu, nv] = self.size;
        let along = |k: u32, x: u16, n: u16| {
            let segments = self.segments[k as usize];
            edge_uv(k, f32::from(snapped(x, n, segments)) / f32::from(segments))
        };
        match (i, j) {
            (i, 0) => along(0, i, nu),
            (i, j) if j == nv => along(2, nu - i, nu),
            (0, j) => along(3, nv - j, nv),
            (_, j) => along(1, j, nv),
        }
    }

    /// Column and row of the three corners of the grid's triangle `triangle`, counted within the grid. They run
    /// counterclockwise in the face's parameters.
    pub fn corners(&self, triangle: u64) -> [(u16, u16); 3] {
        let ((i, j), second) = self.cell(triangle);
        cell_corners(i, j, second)
    }

    /// The column and row of a triangle's cell, and whether it is the second one there.
    fn cell(&self, triangle: u64) -> ((u16, u16), bool) {
        let cell = triangle / 2;
        let columns = u64::from(self.size[0]);
        let place = ((cell % columns) as u16, (cell / columns) as u16);
        (place, triangle % 2 == 1)
    }

    /// How many triangles it has.
    pub fn triangles(&self) -> u64 {
        2 * u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

/// Where border vertex `x` of `n` goes on an edge of `c` segments, `c <= n`: monotone, 0 to 0 and `n` to `c`.
fn snapped(x: u16, n: u16, c: u16) -> u16 {
    let (x, n, c) = (u32::from(x), u32::from(n), u32::from(c));
    ((2 * x + 1) * c / (2 * n)) as u16
}

/// Faces that are diced before progress is told of.
const BATCH: usize = 512;

impl Diced {
    /// Dices all faces, on all threads. The bytes are the same for any number of threads.
    pub fn new(surface: &Surface, rates: &Rates) -> Self {
        Self::watched(surface, rates, &|_| true).expect("nobody ends it, and there is memory")
    }

    /// The same; `go_on` is told how far it is, 0..1, and ends it by false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if ended, [`Error::Memory`] if the system has no room for the micro-vertices.
    pub fn watched(surface: &Surface, rates: &Rates, go_on: &dyn Fn(f64) -> bool) -> Result<Self> {
        let base = surface.base();
        let mut grids = Vec::new();
        let mut starts = vec![0];
        let (mut first_vertex, mut first_triangle) = (0, 0);
        for face in (0..base.faces()).filter(|&face| !base.is_hole(face)) {
            let grid = FaceGrid {
                first_vertex,
                first_triangle,
                ..FaceGrid::new(surface, rates, face)
            };
            let [columns, rows] = grid.vertices();
            first_vertex += columns * rows;
            first_triangle += grid.triangles();
            starts.push(first_vertex as usize);
            grids.push(grid);
        }
        let all = grids.len() * base.keys() as usize;
        let mut done = 0;
        let positions = (0..base.keys())
            .map(|key| {
                let mut positions = filled(first_vertex as usize, Vec3::ZERO, "micro-vertices")?;
                let shared = SharedSamples::new(surface, rates, key);
                let mut faces: Vec<_> = grids.iter().zip(split(&mut positions, &starts)).collect();
                for batch in faces.chunks_mut(BATCH) {
                    batch.par_iter_mut().with_min_len(4).for_each_init(
                        Scratch::default,
                        |scratch, (grid, out)| {
                            surface.dice_face(grid, key, &shared, scratch, out);
                        },
                    );
                    done += batch.len();
                    if !go_on(done as f64 / all as f64) {
                        return Err(Error::Interrupted);
                    }
                }
                Ok(positions)
            })
            .collect::<Result<Vec<_>>>()?;
        Ok(Self {
            positions: Arc::new(positions),
            grids: Arc::new(Grids(grids)),
            left_handed: base.left_handed(),
        })
    }

    /// The micro-vertices at each motion key. A vertex on an edge is there once for each of its faces, with one value.
    pub fn positions(&self) -> &Arc<Vec<Vec<Vec3>>> {
        &self.positions
    }

    /// The grids, in the order of their faces.
    pub fn grids(&self) -> &[FaceGrid] {
        &self.grids.0
    }

    /// The same for whoever needs no vertices.
    pub fn shared_grids(&self) -> &Arc<Grids> {
        &self.grids
    }

    /// Whether the triangles run clockwise seen from the front.
    pub fn left_handed(&self) -> bool {
        self.left_handed
    }

    /// How many micro-triangles there are, those without area included.
    pub fn triangles(&self) -> u64 {
        self.grids.triangles()
    }

    /// The grid that holds a triangle, and the triangle's number in it.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn locate(&self, triangle: u64) -> (&FaceGrid, u64) {
        self.grids.locate(triangle)
    }

    /// The numbers of a triangle's vertices.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn corners(&self, triangle: u64) -> [u64; 3] {
        let (grid, within) = self.locate(triangle);
        grid.corners(within).map(|(i, j)| grid.vertex(i, j))
    }

    /// As [`Grids::face_uv`].
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn face_uv(&self, triangle: u64, uv: Vec2) -> (u32, Vec2) {
        self.grids.face_uv(triangle, uv)
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        let positions: usize = self
            .positions
            .iter()
            .map(|p| size_of_val(p.as_slice()))
            .sum();
        positions + self.grids.memory()
    }
}

impl Grids {
    /// The grid of this number.
    ///
    /// # Panics
    /// If there is none.
    pub fn get(&self, number: u32) -> &FaceGrid {
        &self.0[number as usize]
    }

    /// The grid of a face, unless that is a hole.
    pub fn of_face(&self, face: u32) -> Option<&FaceGrid> {
        let number = self.0.binary_search_by_key(&face, |grid| grid.face).ok()?;
        self.0.get(number)
    }

    /// How many micro-triangles there are, those without area included.
    pub fn triangles(&self) -> u64 {
        self.0
            .last()
            .map_or(0, |grid| grid.first_triangle + grid.triangles())
    }

    /// The grid that holds a triangle, and the triangle's number in it.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn locate(&self, triangle: u64) -> (&FaceGrid, u64) {
        let next = self
            .0
            .partition_point(|grid| grid.first_triangle <= triangle);
        let grid = &self.0[next - 1];
        (grid, triangle - grid.first_triangle)
    }

    /// The face and the parameters on it of the point of a triangle with barycentric weights `u` of its second and `v`
    /// of its third corner.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn face_uv(&self, triangle: u64, uv: Vec2) -> (u32, Vec2) {
        let (grid, within) = self.locate(triangle);
        (grid.face, grid.triangle_uv(within, uv))
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

impl FaceGrid {
    /// The face's parameters of a point of the grid's triangle `triangle`, by its barycentric weights.
    pub fn triangle_uv(&self, triangle: u64, uv: Vec2) -> Vec2 {
        let (cell, second) = self.cell(triangle);
        self.cell_uv(cell, second, uv)
    }

    /// The same for the first or the second triangle of the quad in column `i` of row `j`.
    #[inline]
    pub fn cell_uv(&self, (i, j): (u16, u16), second: bool, uv: Vec2) -> Vec2 {
        let [nu, nv] = self.size;
        if self.segments != [nu, nv, nu, nv] {
            let [a, b, c] = cell_corners(i, j, second).map(|(i, j)| self.vertex_uv(i, j));
            let at = (1.0 - uv.x - uv.y) * a + uv.x * b + uv.y * c;
            return at.clamp(Vec2::ZERO, Vec2::ONE);
        }
        // The second triangle runs back from the far corner.
        let within = if second { 1.0 - uv } else { uv };
        let at = Vec2::new(f32::from(i), f32::from(j)) + within;
        (at / Vec2::new(f32::from(nu), f32::from(nv))).clamp(Vec2::ZERO, Vec2::ONE)
    }

    /// The triangle at the face's parameters and its barycentric weights there; none where borders are snapped to other
    /// rates.
    pub fn triangle_at(&self, uv: Vec2) -> Option<(u64, Vec2)> {
        let [nu, nv] = self.size;
        (self.segments == [nu, nv, nu, nv]).then(|| self.cell_triangle(uv))
    }

    /// Parameters of the corners of the triangle at the face's parameters, and the barycentric weights there. Where
    /// borders are snapped to other rates, it may be one beside it.
    pub fn facet(&self, uv: Vec2) -> ([Vec2; 3], Vec2) {
        let (triangle, weights) = self.cell_triangle(uv);
        let corners = self.corners(triangle);
        (corners.map(|(i, j)| self.vertex_uv(i, j)), weights)
    }

    /// The triangle of the even grid, and its weights.
    fn cell_triangle(&self, uv: Vec2) -> (u64, Vec2) {
        let [nu, nv] = self.size;
        let at = uv * Vec2::new(f32::from(nu), f32::from(nv));
        let (i, j) = ((at.x as u16).min(nu - 1), (at.y as u16).min(nv - 1));
        let within = at - Vec2::new(f32::from(i), f32::from(j));
        let first = 2 * (u64::from(j) * u64::from(nu) + u64::from(i));
        if within.x + within.y <= 1.0 {
            (first, within)
        } else {
            (first + 1, 1.0 - within)
        }
    }

    /// The face's parameters of the point whose parameters over the whole grid, as if nothing were snapped, are `uv`.
    pub fn grid_uv(&self, uv: Vec2) -> Vec2 {
        let uv = uv.clamp(Vec2::ZERO, Vec2::ONE);
        let [nu, nv] = self.size;
        let at = uv * Vec2::new(f32::from(nu), f32::from(nv));
        let (i, j) = ((at.x as u16).min(nu - 1), (at.y as u16).min(nv - 1));
        let inside = |i: u16, n: u16| 0 < i && i + 1 < n;
        if self.segments == [nu, nv, nu, nv] || inside(i, nu) && inside(j, nv) {
            return uv;
        }
        let (triangle, weights) = self.cell_triangle(uv);
        self.triangle_uv(triangle, weights)
    }
}

/// The corners of the first or the second triangle of a quad.
#[inline]
fn cell_corners(i: u16, j: u16, second: bool) -> [(u16, u16); 3] {
    let [a, b, c, d] = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
    if second { [d, c, b] } else { [a, b, c] }
}

impl Surface {
    /// Dices one face into `out`, which has room for the grid's vertices, row by row. The rates behind `shared` are
    /// those that gave the grid its size.
    ///
    /// # Panics
    /// If `out` has not as many vertices as the grid.
    pub fn dice_face(
        &self,
        grid: &FaceGrid,
        key: u32,
        shared: &SharedSamples,
        scratch: &mut Scratch,
        out: &mut [Vec3],
    ) {
        let [columns, rows] = grid.vertices().map(|n| n as usize);
        assert_eq!(out.len(), columns * rows, "{grid:?}");
        let at_once = (POINTS_AT_ONCE / columns).max(1);
        let firsts = (0..rows).step_by(at_once);
        for (first, out) in firsts.zip(out.chunks_mut(at_once * columns)) {
            let last = first + out.len() / columns - 1;
            self.dice_rows(grid, first as u16..=last as u16, key, shared, scratch, out);
        }
    }

    /// Dices some rows of a face's vertices, as [`dice_face`](Self::dice_face) does with all of them.
    ///
    /// # Panics
    /// If the grid has not these rows, or `out` has not as many vertices as they.
    pub fn dice_rows(
        &self,
        grid: &FaceGrid,
        rows: RangeInclusive<u16>,
        key: u32,
        shared: &SharedSamples,
        scratch: &mut Scratch,
        out: &mut [Vec3],
    ) {
        let columns = 0..=grid.size[0];
        self.dice_part(grid, [columns, rows], key, shared, scratch, out);
    }

    /// Dices some columns and rows of a face's vertices, to the same bits as [`dice_face`](Self::dice_face). What
    /// `shared` does not hold is evaluated.
    ///
    /// # Panics
    /// If the grid has not these columns and rows, or `out` has not as many vertices as they.
    pub fn dice_part(
        &self,
        grid: &FaceGrid,
        [columns, rows]: [RangeInclusive<u16>; 2],
        key: u32,
        shared: &SharedSamples,
        scratch: &mut Scratch,
        out: &mut [Vec3],
    ) {
        let [nu, nv] = grid.size;
        let (left, right) = (*columns.start(), *columns.end());
        let (first, last) = (*rows.start(), *rows.end());
        let stride = usize::from(right - left) + 1;
        assert!(
            last <= nv && right <= nu,
            "columns {columns:?}, rows {rows:?} of {grid:?}"
        );
        assert_eq!(
            out.len(),
            stride * (usize::from(last - first) + 1),
            "{grid:?}"
        );

        // Within the face.
        let across = left.max(1)..(right + 1).min(nu);
        let inner = first.max(1)..(last + 1).min(nv);
        scratch.us.clear();
        scratch
            .us
            .extend(across.clone().map(|i| f32::from(i) / f32::from(nu)));
        scratch.vs.clear();
        scratch
            .vs
            .extend(inner.clone().map(|j| f32::from(j) / f32::from(nv)));
        if !inner.is_empty() && !across.is_empty() {
            let start =
                stride * usize::from(inner.start - first) + usize::from(across.start - left);
            self.displaced_grid(grid.face, key, scratch, stride, &mut out[start..]);
        }

        // Along its edges, each from its first corner to the one before its last.
        for k in 0..4_u32 {
            // The vertices along the edge that are in the part.
            let (there, xs) = match k {
                0 => (first == 0, left..(right + 1).min(nu)),
                1 => (right == nu, first..(last + 1).min(nv)),
                2 => (last == nv, nu - right..(nu + 1 - left).min(nu)),
                _ => (left == 0, nv - last..(nv + 1 - first).min(nv)),
            };
            if !there || xs.is_empty() {
                continue;
            }
            let used = self.base().edge(grid.face, k);
            let n = if k % 2 == 0 { nu } else { nv };
            let segments = grid.segments[k as usize];
            // The samples within the edge that they are snapped to, in its own direction.
            let own = |sample: u16| {
                if used.reversed {
                    segments - sample
                } else {
                    sample
                }
            };
            let ends = [xs.start, xs.end - 1].map(|x| own(snapped(x, n, segments)));
            let from = ends[0].min(ends[1]).clamp(1, segments);
            let to = ends[0].max(ends[1]).min(segments - 1).max(from - 1);
            let mut evaluated = std::mem::take(&mut scratch.line);
            let samples = if shared.holds_edges() {
                &shared.edge(used.edge)[usize::from(from - 1)..usize::from(to)]
            } else {
                evaluated.clear();
                evaluated.resize(usize::from(to + 1 - from), Vec3::ZERO);
                let (segments, from) = (segments.into(), from.into());
                self.edge_part(used.edge, segments, from, key, scratch, &mut evaluated);
                &evaluated
            };
            let corner = |k: u32| shared.vertex(self.base().vertex(grid.face, k));
            for x in xs {
                let (column, row) = match k {
                    0 => (x, 0),
                    1 => (nu, x),
                    2 => (nu - x, nv),
                    _ => (0, nv - x),
                };
                let sample = snapped(x, n, segments);
                let point = if sample == 0 {
                    corner(k)
                } else if sample == segments {
                    corner((k + 1) % 4)
                } else {
                    samples[usize::from(own(sample) - from)]
                };
                out[stride * usize::from(row - first) + usize::from(column - left)] = point;
            }
            scratch.line = evaluated;
        }
        debug_assert!(
            self.bounds(grid.face, &UvRect::UNIT, key)
                .is_none_or(|bounds| out.iter().all(|&p| bounds.including(p) == bounds)),
            "face {} leaves its bounds",
            grid.face
        );
    }
}
