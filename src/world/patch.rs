//! NURBS patches as polygons, fine enough for the camera.
//!
//! Each patch becomes one grid of quads over its parameters, the same number of rows in all pieces side by side, so
//! that pieces meet without cracks. Cells outside of the trim curves are left out; a cell that a curve crosses is cut
//! along a polygon that stays within a tenth of the cell's width and height of the curve, about a tenth of the
//! dicing rate in pixels. Normals are the surface's own.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::dicing::{self, Dicing};
use crate::error::{Fault, Warnings};
use crate::math::{Affine3A, Vec3};
use crate::mesh::{
    ControlMesh, Interpolation, NurbsDirection, NurbsForm, NurbsPatch, Primvar, Scheme,
};
use crate::nurbs::{BezierFaces, NurbsSurface, Region, Trim};
use crate::shade::camera::Camera;
use crate::surface::Places;

/// A patch as polygons.
pub(super) struct Diced {
    /// The polygons, with the patch's primvars; `st` are the parameters over their ranges where the patch has none.
    pub(super) mesh: Arc<ControlMesh>,
    /// The patch's face of each polygon.
    pub(super) faces: Vec<u32>,
}

/// Cells that a patch is cut into at most, unless it has more pieces.
const MOST_CELLS: f64 = 4e6;

/// Gaps in parts of the domain that are told: between a trim curve and the next.
const TOLD_GAP: f64 = 1e-6;

/// Part of a cell by which polygons may stray from trim curves.
const TRIM_TOLERANCE: f64 = 0.1;

impl Diced {
    /// Cuts a patch finely enough for each of the places in which it stands.
    pub(super) fn new(
        patch: &NurbsPatch,
        places: &[Affine3A],
        camera: &Camera,
        dicing: &Dicing,
        path: &str,
        warnings: &mut Warnings,
    ) -> Result<Self, Fault> {
        let surface = NurbsSurface::new(patch)?;
        let faces = BezierFaces::new(&surface)?;
        let trim = Trim::new(patch);
        notice(patch, &faces, &trim, path, warnings);

        let segments = all_segments(patch, &faces, places, camera, dicing);
        let mut grid = Grid::new(&faces, &segments);
        let cells = [0, 1].map(|axis| 0..grid.cells[axis].len());
        if trim.is_empty() {
            grid.fill(cells);
        } else {
            let tolerance = [0, 1].map(|axis| {
                let widths = grid.cells[axis].iter().map(|c| c.part[1] - c.part[0]);
                TRIM_TOLERANCE * widths.fold(f64::INFINITY, f64::min)
            });
            let mut region = Region::new(trim.polygons(tolerance));
            for (axis, cells) in grid.cells.iter().enumerate() {
                let [low, high] = [cells[0].part[0], cells[cells.len() - 1].part[1]];
                let [_, above] = region.cut(axis, low);
                [region, _] = above.cut(axis, high);
            }
            grid.fill_region(&region, cells);
        }
        Ok(grid.into_diced(patch, &surface))
    }

    /// Triangles that a patch will be cut into, trimmed parts included; none if it is no surface.
    pub(super) fn micro_triangles(
        patch: &NurbsPatch,
        places: &[Affine3A],
        camera: &Camera,
        dicing: &Dicing,
    ) -> u64 {
        let faces = NurbsSurface::new(patch).and_then(|surface| BezierFaces::new(&surface));
        let Ok(faces) = faces else {
            return 0;
        };
        let segments = all_segments(patch, &faces, places, camera, dicing);
        let [u, v] = segments.map(|axis| axis.iter().sum::<usize>() as u64);
        2 * u * v
    }
}

/// Cells for each piece in u and in v, coarser where they would be too many.
fn all_segments(
    patch: &NurbsPatch,
    faces: &BezierFaces,
    places: &[Affine3A],
    camera: &Camera,
    dicing: &Dicing,
) -> [Vec<usize>; 2] {
    let places = Places::nearest(camera, &patch.bounds(), places);
    let mut segments = [0, 1].map(|axis| segments(faces, axis, &places, dicing));
    let [u, v] = [0, 1].map(|axis| segments[axis].iter().sum::<usize>() as f64);
    if u * v > MOST_CELLS {
        let coarser = (MOST_CELLS / (u * v)).sqrt();
        for n in segments.iter_mut().flatten() {
            *n = ((*n as f64 * coarser) as usize).max(1);
        }
    }
    segments
}

/// Tells where the patch is not what it says.
fn notice(
    patch: &NurbsPatch,
    faces: &BezierFaces,
    trim: &Trim,
    path: &str,
    warnings: &mut Warnings,
) {
    for (axis, direction, name) in [(0, &patch.u, "uForm"), (1, &patch.v, "vForm")] {
        if direction.form != NurbsForm::Open && !faces.is_closed(axis) {
            warnings.add("patch that does not close", || {
                format!("{path}: {name} is {:?}, but the patch's ends do not meet; they are left as they are", direction.form)
                    .replace("Closed", "closed")
                    .replace("Periodic", "periodic")
            });
        }
    }
    if trim.gap() > TOLD_GAP {
        warnings.add("open trim loop", || {
            format!("{path}: a trim curve does not begin where the one before ends; a straight line closes the gap")
        });
    }
}

/// Cells for each piece along an axis: by the longest row of Bezier points, which is no shorter than the surface.
fn segments(faces: &BezierFaces, axis: usize, places: &Places<'_>, dicing: &Dicing) -> Vec<usize> {
    let pieces = faces.pieces();
    let orders = faces.orders();
    let longest = |face: usize| {
        let hull: Vec<Vec3> = faces.hull(0, face).map(|p| p.as_vec3()).collect();
        let at = |along: usize, across: usize| match axis {
            0 => hull[across * orders[0] + along],
            _ => hull[along * orders[0] + across],
        };
        (0..orders[1 - axis])
            .map(|row| {
                (1..orders[axis])
                    .map(|k| places.pixels(at(k - 1, row), at(k, row)))
                    .sum::<f32>()
            })
            .fold(0.0, f32::max)
    };
    let lengths: Vec<f32> = (0..faces.face_count())
        .into_par_iter()
        .map(longest)
        .collect();
    let mut out = vec![1; pieces[axis]];
    for (face, pixels) in lengths.into_iter().enumerate() {
        let piece = [face % pieces[0], face / pieces[0]][axis];
        out[piece] = out[piece].max(dicing::segments(dicing, pixels) as usize);
    }
    out
}

/// A row or column of cells.
#[derive(Clone, Copy)]
struct Cell {
    piece: usize,
    /// Lines at its two sides. Where the surface breaks, neighbours have lines of their own.
    lines: [usize; 2],
    /// From and to, by the surface's own parameter.
    part: [f64; 2],
}

/// The cells of a patch, and the polygons that are made of them.
struct Grid<'a> {
    faces: &'a BezierFaces,
    cells: [Vec<Cell>; 2],
    /// Vertex at each crossing of lines, once there is one.
    crossings: Vec<Option<u32>>,
    columns: usize,
    /// Vertices that trim curves make, by their parameters and the lines before them.
    others: HashMap<([u64; 2], [usize; 2]), u32>,
    vertices: Vec<Vertex>,
    counts: Vec<u32>,
    indices: Vec<u32>,
    parents: Vec<u32>,
}

/// Where a vertex is: by the surface's parameters, and on a face.
struct Vertex {
    parameters: [f64; 2],
    face: usize,
    uv: [f64; 2],
}

impl<'a> Grid<'a> {
    fn new(faces: &'a BezierFaces, segments: &[Vec<usize>; 2]) -> Self {
        let cells = [0, 1].map(|axis| {
            let mut cells: Vec<Cell> = Vec::new();
            for (piece, &n) in segments[axis].iter().enumerate() {
                let stride = [1, faces.pieces()[0]][axis];
                let [low, high] = faces.parameters(piece * stride)[axis];
                let at = |k: usize| match k {
                    0 => low,
                    k if k == n => high,
                    k => low + (high - low) * (k as f64 / n as f64),
                };
                for k in 0..n {
                    let breaks = k == 0 && piece > 0 && faces.breaks(axis, piece);
                    let line = cells.last().map_or(0, |c| c.lines[1] + usize::from(breaks));
                    cells.push(Cell {
                        piece,
                        lines: [line, line + 1],
                        part: [at(k), at(k + 1)],
                    });
                }
            }
            cells
        });
        let [columns, rows] = [0, 1].map(|a| cells[a].last().map_or(0, |c| c.lines[1] + 1));
        Self {
            faces,
            cells,
            crossings: vec![None; columns * rows],
            columns,
            others: HashMap::new(),
            vertices: Vec::new(),
            counts: Vec::new(),
            indices: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// All cells of a block as quads.
    fn fill(&mut self, [across, along]: [Range<usize>; 2]) {
        for j in along {
            for i in across.clone() {
                let corners = [[0, 0], [1, 0], [1, 1], [0, 1]];
                let polygon = corners.map(|corner| self.crossing([i, j], corner));
                self.polygon([i, j], &polygon);
            }
        }
    }

    /// What a region, which does not reach out of the block, leaves of its cells.
    fn fill_region(&mut self, region: &Region, block: [Range<usize>; 2]) {
        let [low, high] = [0, 1].map(|end| {
            [0, 1].map(|axis| {
                let cells = &self.cells[axis][block[axis].clone()];
                [cells[0].part[0], cells[cells.len() - 1].part[1]][end]
            })
        });
        if region.is_empty() {
            return;
        }
        if region.fills(low, high) {
            return self.fill(block);
        }
        let axis = usize::from(block[1].len() > block[0].len());
        if block[axis].len() == 1 {
            return self.clipped(region, [block[0].start, block[1].start]);
        }
        let middle = block[axis].start + block[axis].len() / 2;
        let [before, after] = region.cut(axis, self.cells[axis][middle].part[0]);
        let [mut first, mut second] = [block.clone(), block];
        first[axis].end = middle;
        second[axis].start = middle;
        self.fill_region(&before, first);
        self.fill_region(&after, second);
    }

    /// The triangles of a part of a cell.
    fn clipped(&mut self, region: &Region, cell: [usize; 2]) {
        let (triangles, places) = region.triangles();
        let numbers: Vec<u32> = places.iter().map(|&p| self.place(cell, p)).collect();
        for triangle in triangles {
            self.polygon(cell, &triangle.map(|k| numbers[k as usize]));
        }
    }

    fn polygon(&mut self, [i, j]: [usize; 2], vertices: &[u32]) {
        self.counts.push(vertices.len() as u32);
        self.indices.extend_from_slice(vertices);
        self.parents.push(self.face([i, j]) as u32);
    }

    fn face(&self, [i, j]: [usize; 2]) -> usize {
        self.cells[0][i].piece + self.cells[1][j].piece * self.faces.pieces()[0]
    }

    /// The vertex at a corner of a cell.
    fn crossing(&mut self, cell: [usize; 2], corner: [usize; 2]) -> u32 {
        let [x, y] = [0, 1].map(|a| self.cells[a][cell[a]].lines[corner[a]]);
        let at = y * self.columns + x;
        if let Some(vertex) = self.crossings[at] {
            return vertex;
        }
        let parameters = [0, 1].map(|a| self.cells[a][cell[a]].part[corner[a]]);
        let vertex = self.vertex(cell, parameters);
        self.crossings[at] = Some(vertex);
        vertex
    }

    /// The vertex at a place in a cell.
    fn place(&mut self, cell: [usize; 2], parameters: [f64; 2]) -> u32 {
        let ends = [0, 1].map(|a| {
            let part = self.cells[a][cell[a]].part;
            (0..2).find(|&end| part[end] == parameters[a])
        });
        if let [Some(x), Some(y)] = ends {
            return self.crossing(cell, [x, y]);
        }
        // Cells share what lies on a line between them; elsewhere the cell's own first line tells them apart.
        let lines = [0, 1].map(|a| self.cells[a][cell[a]].lines[ends[a].unwrap_or(0)]);
        let key = (parameters.map(f64::to_bits), lines);
        if let Some(&vertex) = self.others.get(&key) {
            return vertex;
        }
        let vertex = self.vertex(cell, parameters);
        self.others.insert(key, vertex);
        vertex
    }

    fn vertex(&mut self, cell: [usize; 2], parameters: [f64; 2]) -> u32 {
        let face = self.face(cell);
        let range = self.faces.parameters(face);
        let uv = [0, 1].map(|a| (parameters[a] - range[a][0]) / (range[a][1] - range[a][0]));
        self.vertices.push(Vertex {
            parameters,
            face,
            uv,
        });
        (self.vertices.len() - 1) as u32
    }

    fn into_diced(self, patch: &NurbsPatch, surface: &NurbsSurface) -> Diced {
        let faces = self.faces;
        let points = (0..faces.key_count())
            .map(|key| {
                let point = |v: &Vertex| faces.evaluate_at_key(key, v.face, v.uv).position;
                self.vertices
                    .par_iter()
                    .map(|v| point(v).as_vec3())
                    .collect()
            })
            .collect();
        // Normals are for the first key only; what moves in itself shows its facets, which are small.
        let normals = (faces.key_count() == 1).then(|| {
            let sign = if patch.left_handed { -1.0 } else { 1.0 };
            let normal = |v: &Vertex| (sign * faces.normal(v.face, v.uv)).as_vec3().to_array();
            per_vertex(
                "normals",
                3,
                self.vertices.par_iter().flat_map_iter(normal).collect(),
            )
        });
        let carried = Carried {
            patch,
            surface,
            vertices: &self.vertices,
            parents: &self.parents,
            columns: faces.pieces()[0],
        };
        let mesh = ControlMesh {
            scheme: Scheme::None,
            points,
            normals,
            primvars: carried.primvars(),
            face_vertex_counts: self.counts,
            face_vertex_indices: self.indices,
            left_handed: patch.left_handed,
            ..ControlMesh::default()
        };
        Diced {
            mesh: Arc::new(mesh),
            faces: self.parents,
        }
    }
}

fn per_vertex(name: &str, width: u32, values: Vec<f32>) -> Primvar {
    Primvar {
        name: name.to_owned(),
        interpolation: Interpolation::Vertex,
        width,
        values,
        indices: None,
    }
}

/// What the polygons take over of the patch's primvars.
struct Carried<'a> {
    patch: &'a NurbsPatch,
    surface: &'a NurbsSurface,
    vertices: &'a [Vertex],
    /// The patch's face of each polygon.
    parents: &'a [u32],
    columns: usize,
}

impl Carried<'_> {
    fn primvars(&self) -> Vec<Primvar> {
        let mut out: Vec<Primvar> = self
            .patch
            .primvars
            .iter()
            .map(|primvar| self.primvar(primvar))
            .collect();
        if self.patch.primvar("st").is_none() {
            let [u, v] = [&self.patch.u, &self.patch.v].map(NurbsDirection::domain);
            let st = |vertex: &Vertex| {
                let part = |t: f64, [low, high]: [f64; 2]| ((t - low) / (high - low)) as f32;
                [part(vertex.parameters[0], u), part(vertex.parameters[1], v)]
            };
            let values = self.vertices.iter().flat_map(st).collect();
            out.push(per_vertex("st", 2, values));
        }
        out
    }

    fn primvar(&self, primvar: &Primvar) -> Primvar {
        let segments = self.patch.segments();
        let pieces = [&self.patch.u, &self.patch.v].map(|direction| {
            let first = direction.degree();
            direction
                .spans()
                .map(|(span, _)| span - first)
                .collect::<Vec<_>>()
        });
        let segment = |face: usize| {
            [
                pieces[0][face % self.columns],
                pieces[1][face / self.columns],
            ]
        };
        match primvar.interpolation {
            Interpolation::Constant | Interpolation::FaceVarying => primvar.clone(),
            Interpolation::Uniform => {
                let element = |&face: &u32| {
                    let [i, j] = segment(face as usize);
                    let element = (j * segments[0] + i) as u32;
                    primvar
                        .indices
                        .as_ref()
                        .map_or(element, |all| all[element as usize])
                };
                Primvar {
                    indices: Some(self.parents.iter().map(element).collect()),
                    ..primvar.clone()
                }
            }
            Interpolation::Varying => self.blended(primvar, |vertex| {
                let [i, j] = segment(vertex.face);
                let [u, v] = vertex.uv;
                let corner = |x: usize, y: usize| (j + y) * (segments[0] + 1) + i + x;
                vec![
                    (corner(0, 0), (1.0 - u) * (1.0 - v)),
                    (corner(1, 0), u * (1.0 - v)),
                    (corner(0, 1), (1.0 - u) * v),
                    (corner(1, 1), u * v),
                ]
            }),
            Interpolation::Vertex => {
                self.blended(primvar, |vertex| self.surface.influences(vertex.parameters))
            }
        }
    }

    /// Weighted sums of a primvar's elements at each vertex.
    fn blended(
        &self,
        primvar: &Primvar,
        weights: impl Fn(&Vertex) -> Vec<(usize, f64)> + Sync,
    ) -> Primvar {
        let width = primvar.width as usize;
        let values = |vertex: &Vertex| {
            let mut sum = vec![0.0; width];
            for (element, weight) in weights(vertex) {
                for (s, x) in sum.iter_mut().zip(primvar.get(element)) {
                    *s += weight * f64::from(*x);
                }
            }
            sum.into_iter().map(|x| x as f32)
        };
        let values = self.vertices.par_iter().flat_map_iter(values).collect();
        per_vertex(&primvar.name, primvar.width, values)
    }
}

#[cfg(test)]
#[path = "patch_tests.rs"]
mod tests;
