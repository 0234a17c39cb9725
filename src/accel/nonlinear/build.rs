//! Building: quads are chosen, faces diced three times, heights found and rounded.
//!
//! A face is diced as it is displaced, as it is without displacement, and moved along its normals by the object's size: the
//! difference of the last two is the limit surface's normal, and where faces share micro-vertices it is one for all of them,
//! the mean of theirs, as their displacement is. Heights on edges are found first, each once, at the edge's own samples.
//! Beside the result all heights exist in single precision for a while, and a face of micro-vertices a thread.

use rayon::prelude::*;

use super::edges::{Edges, between};
use super::field::{Ranges, Size, ranges};
use super::meet::{Lines, NEAR, Shifts, shift};
use super::sheets::{Corner, Sheets};
use super::{Collapsed, Face, Leaf, Nonlinear, piece, weights};
use crate::accel::lattice::Lattice;
use crate::accel::prism::Corners;
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec2, DVec3, Vec3};
use crate::stats::{AchievedError, Distances};
use crate::surface::{Displacement, FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// Faces that are in work at once.
const BATCH: usize = 512;

impl Nonlinear {
    /// Builds prisms and heights. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Input`] for displacement by vectors, [`Error::Interrupted`] if stopped, [`Error::Memory`] beyond 2^32 heights.
    pub fn build(surface: &Surface, rates: &Rates, progress: &dyn Fn(f64) -> bool) -> Result<Self> {
        if matches!(surface.displacement(), Displacement::Vector(..)) {
            return Err(Fault::new(
                "displaced by vectors, and the method nonlinear traces displacement along normals only",
            )
            .advise("Use another method: --method compact or embree-grid.")
            .into());
        }
        let sheets = Sheets::new(surface);
        let lines = Lines::new(&sheets);
        let (mut cuts, limit) = sheets.least_cuts(rates);
        while cuts < limit && sheets.bends(rates, cuts) {
            cuts = sheets.more(cuts);
        }
        let mut corners = sheets.corners(cuts);
        while cuts < limit && lines.bend(cuts, &corners) {
            cuts = sheets.more(cuts);
            corners = sheets.corners(cuts);
        }
        Builder::new(&sheets, lines, rates, cuts, corners).run(progress)
    }
}

struct Builder<'a> {
    sheets: &'a Sheets<'a>,
    cuts: u32,
    corners: Vec<Corners>,
    /// Grids of quads, and of micro-quads.
    quads: Vec<FaceGrid>,
    grids: Vec<FaceGrid>,
    /// By motion key.
    shared: Vec<[SharedSamples; 3]>,
    lines: Lines<'a>,
}

/// A face's heights at a motion key.
struct Field {
    heights: Vec<f32>,
    /// By quad.
    shifts: Vec<Shifts>,
    /// How far from the displaced points they leave micro-vertices.
    off: Distances,
    /// How far unit normals would move these.
    lengthened: Distances,
}

impl<'a> Builder<'a> {
    fn new(
        sheets: &'a Sheets<'a>,
        lines: Lines<'a>,
        rates: &Rates,
        cuts: u32,
        corners: Vec<Corners>,
    ) -> Self {
        let surface = sheets.displaced;
        let base = surface.base();
        let faces = || (0..base.faces()).filter(|&face| !base.is_hole(face));
        let is_pointed = |face: u32| (0..4).any(|k| base.is_collapsed(face, k));
        let rates = Rates::new(
            surface,
            |edge| rates.edge(edge),
            |face| {
                let [u, v] = rates.face(face);
                if is_pointed(face) {
                    // Over a triangle that fills its quad the two go together.
                    [u.max(v).next_multiple_of(cuts); 2]
                } else {
                    [u, v]
                }
            },
        );
        let coarse = Rates::uniform(surface, cuts);
        let grids = faces()
            .map(|face| FaceGrid::new(surface, &rates, face))
            .collect();
        let mut first_vertex = 0;
        let quads = faces().map(|face| {
            let grid = FaceGrid {
                first_vertex,
                ..FaceGrid::new(surface, &coarse, face)
            };
            let [columns, rows] = grid.vertices();
            first_vertex += columns * rows;
            grid
        });
        let quads = quads.collect();
        let shared = (0..base.keys()).map(|key| {
            [surface, &sheets.base.plain, &sheets.base.lifted]
                .map(|s| SharedSamples::new(s, &rates, key))
        });
        let shared = shared.collect();
        Self {
            sheets,
            cuts,
            corners,
            quads,
            grids,
            shared,
            lines,
        }
    }

    fn run(self, progress: &dyn Fn(f64) -> bool) -> Result<Nonlinear> {
        let edges = self.edges();
        let mut fields: Vec<Vec<Field>> = Vec::with_capacity(self.grids.len());
        for batch in (0..self.grids.len()).collect::<Vec<_>>().chunks(BATCH) {
            if !progress(batch[0] as f64 / self.grids.len() as f64) {
                return Err(Error::Interrupted);
            }
            fields.par_extend(batch.par_iter().with_min_len(4).map_init(
                || (Scratch::default(), [Vec::new(), Vec::new(), Vec::new()]),
                |(scratch, points), &number| {
                    let keys = 0..self.shared.len();
                    keys.map(|key| self.field(number, key, &edges, scratch, points))
                        .collect()
                },
            ));
        }
        if !progress(1.0) {
            return Err(Error::Interrupted);
        }
        self.joined(&fields, &edges)
    }

    /// The heights along all edges that faces have, by motion key, each at its samples and in its own direction.
    fn edges(&self) -> Vec<Vec<Vec<f32>>> {
        let numbers: Vec<usize> = {
            let mut numbers = vec![0; self.sheets.base.plain.base().faces() as usize];
            for (number, grid) in self.grids.iter().enumerate() {
                numbers[grid.face as usize] = number;
            }
            numbers
        };
        let edges = 0..self.lines.edges();
        edges
            .into_par_iter()
            .map(|edge| {
                let Some((face, k, reversed)) = self.lines.side(edge) else {
                    return Vec::new();
                };
                let coarse = &self.quads[numbers[face as usize]];
                (0..self.shared.len())
                    .map(|key| self.edge((edge, face, k, reversed), coarse, key))
                    .collect()
            })
            .collect()
    }

    fn edge(
        &self,
        (edge, face, k, reversed): (u32, u32, u32, bool),
        coarse: &FaceGrid,
        key: usize,
    ) -> Vec<f32> {
        let surfaces = [
            self.sheets.displaced,
            &self.sheets.base.plain,
            &self.sheets.base.lifted,
        ];
        let [displaced, plain, lifted] = [0, 1, 2].map(|s| {
            let walk = self.shared[key][s].walk(surfaces[s], face, k);
            let mut points: Vec<DVec3> = walk.map(|p| p.as_dvec3()).collect();
            if reversed {
                points.reverse();
            }
            points
        });
        let cuts = self.cuts as usize;
        let end = |x: usize| {
            let x = if reversed { cuts - x } else { x };
            let (i, j) = match k {
                0 => (x, 0),
                1 => (cuts, x),
                2 => (cuts - x, cuts),
                _ => (0, cuts - x),
            };
            Corner::of(&self.corners[key][coarse.vertex(i as u16, j as u16) as usize])
        };
        let samples = displaced.len() - 1;
        (0..=samples)
            .map(|sample| {
                let at = sample * cuts;
                let (segment, part) = (at / samples, (at % samples) as f64 / samples as f64);
                let from = end(segment);
                let normal = lifted[sample] - plain[sample];
                if part == 0.0 {
                    return from.placed(displaced[sample], normal).0;
                }
                let to = end(segment + 1);
                let here = from.lerp(&to, part);
                let (height, aside) = here.placed(displaced[sample], normal);
                let micro = from.p.distance(to.p) * cuts as f64 / samples as f64;
                if aside <= NEAR * micro {
                    return height;
                }
                let (along, step) = (sample as f64 / samples as f64, 1.0 / samples as f64);
                let found = self
                    .lines
                    .meet_on_edge(edge, key as u32, &here, along, step);
                found.map_or(height, |found| here.placed(found.point, found.normal).0)
            })
            .collect()
    }

    /// The heights of a face.
    fn field(
        &self,
        number: usize,
        key: usize,
        edges: &[Vec<Vec<f32>>],
        scratch: &mut Scratch,
        points: &mut [Vec<Vec3>; 3],
    ) -> Field {
        let grid = &self.grids[number];
        let [columns, rows] = grid.vertices().map(|n| n as usize);
        let surfaces = [
            self.sheets.displaced,
            &self.sheets.base.plain,
            &self.sheets.base.lifted,
        ];
        for ((points, surface), shared) in points.iter_mut().zip(surfaces).zip(&self.shared[key]) {
            points.resize(columns * rows, Vec3::ZERO);
            surface.dice_face(grid, key as u32, shared, scratch, points);
        }
        let [displaced, plain, lifted] = points;
        let cuts = self.cuts as usize;
        let [nu, nv] = grid.size.map(usize::from);
        // Micro-quads of a quad.
        let [mu, mv] = [nu, nv].map(|n| n as f64 / cuts as f64);
        let mut field = Field {
            heights: vec![f32::NAN; columns * rows],
            shifts: vec![Shifts::default(); cuts * cuts],
            off: Distances::default(),
            lengthened: Distances::default(),
        };
        let step = DVec2::new(1.0 / nu as f64, 1.0 / nv as f64);
        let face = self.face(number, grid);
        let target = |at: usize| displaced[at].as_dvec3();
        let normal = |at: usize| lifted[at].as_dvec3() - plain[at].as_dvec3();
        // The means of displacement, by quad.
        let mean = |bi: usize, bj: usize| {
            let mut sum = 0.0;
            for (i, j) in [(1, 1), (1, 3), (2, 2), (3, 1), (3, 3)] {
                let place = |b: usize, x: usize, n: usize| (4 * b + x) * n / (4 * cuts);
                let at = place(bj, j, nv) * columns + place(bi, i, nu);
                let n = normal(at);
                let h = (target(at) - plain[at].as_dvec3()).dot(n) / n.length();
                sum += if h.is_finite() { 0.2 * h } else { 0.0 };
            }
            sum
        };
        let is_whole = |bi: usize, bj: usize| {
            face.collapsed(self.cuts, [bi as u16, bj as u16]) == Collapsed::None
        };
        for (bj, bi) in (0..cuts).flat_map(|j| (0..cuts).map(move |i| (j, i))) {
            if is_whole(bi, bj) {
                let corners = self.quad_corners(number, key, [bi, bj]);
                let at = DVec2::new(bi as f64, bj as f64);
                let lines = &self.lines;
                field.shifts[bj * cuts + bi] = lines.shifts(
                    (grid.face, key as u32),
                    &corners,
                    (at, cuts as f64),
                    mean(bi, bj),
                );
            }
        }
        // The quad that a column or row is in, and where.
        let place = |i: usize, n: usize| (i * cuts / n, (i * cuts % n) as f64 / n as f64);
        for j in 1..nv {
            let (bj, y) = place(j, nv);
            for i in 1..nu {
                let (bi, x) = place(i, nu);
                let at = j * columns + i;
                let part = [x, y];
                let line = Corner::within(&self.quad_corners(number, key, [bi, bj]), x, y);
                let off;
                if is_whole(bi, bj) {
                    let (mut height, aside) = line.placed(target(at), normal(at));
                    // The next ones are there, as it is inside of the face.
                    let by_step = [at + 1, at + columns]
                        .map(|next| plain[next].as_dvec3() - plain[at].as_dvec3());
                    let edge = by_step[0].length().min(by_step[1].length());
                    let by = shift(&field.shifts[bj * cuts + bi], weights(part));
                    let by = DVec2::new(by[0] * mu, by[1] * mv);
                    let mut missed = line.at(height.into()) - target(at);
                    if aside > NEAR * edge {
                        let here = DVec2::new(i as f64, j as f64);
                        let start = (here + by) * step;
                        let (lines, key) = (&self.lines, key as u32);
                        if let Some(found) = lines.meet(grid.face, key, &line, start, step) {
                            (height, _) = line.placed(found.point, found.normal);
                            let moved = found.uv / step - here;
                            missed = moved.x * by_step[0] + moved.y * by_step[1];
                        }
                    }
                    field.heights[at] = height;
                    off = (missed - by.x * by_step[0] - by.y * by_step[1]).length();
                } else {
                    // Between the micro-vertices next to its place along the row, or the column.
                    let collapsed = face.collapsed(self.cuts, [bi as u16, bj as u16]);
                    let [u, v] = collapsed.stretched(part);
                    let (u, v) = ((bi as f64 + u) * mu, (bj as f64 + v) * mv);
                    let (i, j) = (u as usize, v as usize);
                    let first = j * columns + i;
                    let (next, part) = if u > i as f64 {
                        (first + 1, u - i as f64)
                    } else if v > j as f64 {
                        (first + columns, v - j as f64)
                    } else {
                        (first, 0.0)
                    };
                    let between = |a: DVec3, b: DVec3| a + part * (b - a);
                    let point = between(target(first), target(next));
                    let normal = between(normal(first), normal(next));
                    (field.heights[at], off) = line.placed(point, normal);
                }
                field.off.include(off);
                let lengthened = f64::from(field.heights[at]) * (1.0 - line.n.length());
                field.lengthened.include(lengthened.abs());
            }
        }
        // On edges what is between their samples.
        for (k, used) in face.edges.iter().enumerate() {
            let heights = &edges[used.edge as usize][key];
            let (n, samples) = ([nu, nv][k % 2], heights.len() - 1);
            for x in 0..=n {
                let along = if used.reversed { n - x } else { x };
                let sample = (along * samples) as f64 / n as f64;
                let (i, j) = match k {
                    0 => (x, 0),
                    1 => (nu, x),
                    2 => (nu - x, nv),
                    _ => (0, nv - x),
                };
                let height = between(sample, samples, |i| heights[i].into());
                field.heights[j * columns + i] = height as f32;
            }
        }
        field
    }

    /// The corners of a quad.
    fn quad_corners(&self, number: usize, key: usize, [bi, bj]: [usize; 2]) -> [Corner; 4] {
        let coarse = &self.quads[number];
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| {
            let at = coarse.vertex((bi + i) as u16, (bj + j) as u16);
            Corner::of(&self.corners[key][at as usize])
        })
    }

    /// A face, whose heights and ranges begin nowhere yet.
    fn face(&self, number: usize, grid: &FaceGrid) -> Face {
        let base = self.sheets.base.plain.base();
        let side = |k: u8| u8::from(base.is_collapsed(grid.face, k.into())) << k;
        Face {
            face: grid.face,
            corner: self.quads[number].first_vertex as u32,
            heights: 0,
            ranges: 0,
            size: Size(grid.size),
            collapsed: side(0) | side(1) | side(2) | side(3),
            edges: [0, 1, 2, 3].map(|k| base.edge(grid.face, k)),
        }
    }

    fn joined(self, fields: &[Vec<Field>], edges: &[Vec<Vec<f32>>]) -> Result<Nonlinear> {
        let all = || fields.iter().flatten();
        let (low, high) = all()
            .flat_map(|field| &field.heights)
            .chain(edges.iter().flatten().flatten())
            .filter(|h| !h.is_nan())
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &h| {
                (a.min(h), b.max(h))
            });
        let (low, range) = if low <= high {
            (f64::from(low), f64::from(high) - f64::from(low))
        } else {
            (0.0, 0.0)
        };
        let step = range.max(1e-7 * f64::from(self.sheets.base.far)) / (f64::from(u16::MAX) - 1.0);
        let mut rounded = Edges::default();
        for keys in edges {
            let keys = keys.iter().map(|heights| steps(heights, low, step));
            rounded.push(&keys.collect::<Vec<_>>());
        }
        let edges = rounded;
        let keys = self.shared.len();
        let corners: Vec<[Vec3; 2]> = (self.corners.iter().flatten())
            .map(|[p, n]| {
                let foot = p.as_dvec3() + low * n.as_dvec3();
                [foot.as_vec3(), (step * n.as_dvec3()).as_vec3()]
            })
            .collect();
        let each = corners.len() / keys.max(1);

        let made: Vec<Made> = (0..self.grids.len())
            .into_par_iter()
            .map(|number| self.made(number, &fields[number], &edges, [low, step]))
            .collect();
        let mut quads = Vec::with_capacity(made.iter().map(|made| made.quads.len()).sum());
        let mut faces = Vec::with_capacity(made.len());
        let mut shifts: Vec<Shifts> = Vec::with_capacity(quads.capacity() * keys);
        let mut heights = Vec::with_capacity(made.iter().map(|made| made.heights.len()).sum());
        let mut all_ranges: Vec<Ranges> =
            Vec::with_capacity(made.iter().map(|made| made.ranges.len()).sum());
        for made in made {
            if u32::try_from(heights.len() + made.heights.len()).is_err() {
                return Err(Error::Memory {
                    message: "one object takes more than 8 GB of heights".into(),
                    help: Some(
                        "Raise the dicing rate, or lower the most segments of an edge.".into(),
                    ),
                });
            }
            faces.push(Face {
                heights: heights.len() as u32,
                ranges: all_ranges.len() as u32,
                ..made.face
            });
            quads.extend(made.quads);
            for quad in 0..(self.cuts * self.cuts) as usize {
                let keys = fields[faces.len() - 1].iter();
                shifts.extend(keys.map(|field| field.shifts[quad]));
            }
            heights.extend(made.heights);
            all_ranges.extend(made.ranges);
        }

        // A node's rows of four may reach beyond a small quad, and so beyond the last height.
        let longest = faces.iter().map(|face: &Face| face.heights()[0]).max();
        heights.extend(std::iter::repeat_n(0, 4 * longest.unwrap_or(0) + 8));
        if shifts.iter().all(|shifts| *shifts == Shifts::default()) {
            shifts = Vec::new();
        }
        let mut new = Nonlinear {
            isa: Isa::best(),
            lattice: Lattice::around(&Bounds3::EMPTY, 0.0),
            reach: 0.0,
            keys: keys as u32,
            left_handed: self.sheets.base.plain.base().left_handed(),
            cuts: self.cuts,
            top: Top::default(),
            quads,
            faces,
            corners,
            heights,
            shifts,
            ranges: all_ranges,
            edges,
            achieved: self.achieved(fields, step),
        };
        new.arrange(each);
        Ok(new)
    }

    /// A face with its quads.
    fn made(&self, number: usize, fields: &[Field], edges: &Edges, [low, step]: [f64; 2]) -> Made {
        let mut face = self.face(number, &self.grids[number]);
        let mut heights: Vec<Vec<u16>> = fields
            .iter()
            .map(|field| steps(&field.heights, low, step))
            .collect();
        let first = heights.first().and_then(|key| key.first()).copied();
        let is_flat = |&first: &u16| heights.iter().flatten().all(|&h| h == first);
        if let Some(height) = first.filter(is_flat) {
            // What is all alike need not be fine.
            let n = if face.collapsed == 0 { 1 } else { self.cuts };
            face.size = Size([n as u16; 2]);
            let [_, in_face] = face.heights();
            heights.fill(vec![height; in_face]);
        }
        let cuts = self.cuts as usize;
        let [nu, nv] = face.size.quads();
        let [stride, _] = face.heights();
        let mut quads = Vec::with_capacity(cuts * cuts);
        let mut all_ranges = Vec::with_capacity(heights.len() * face.size.ranges());
        for (bj, bi) in (0..cuts).flat_map(|j| (0..cuts).map(move |i| (j, i))) {
            let collapsed = face.collapsed(self.cuts, [bi as u16, bj as u16]);
            if collapsed != Collapsed::None {
                let (mu, mv) = (nu / cuts, nv / cuts);
                for heights in &mut heights {
                    collapsed.fold(mu, stride, &mut heights[bj * mv * stride + bi * mu..]);
                }
            }
        }
        for heights in &heights {
            ranges(face.size, heights, &mut all_ranges);
        }
        for (bj, bi) in (0..cuts).flat_map(|j| (0..cuts).map(move |i| (j, i))) {
            let place = [bi as u16, bj as u16];
            let ([left, right], _) = piece(face.size.0[0], self.cuts, place[0]);
            let ([bottom, top], _) = piece(face.size.0[1], self.cuts, place[1]);
            let (mut least, mut most) = (u16::MAX, 0);
            for (key, heights) in heights.iter().enumerate() {
                for row in heights
                    .chunks(stride)
                    .take(top as usize + 2)
                    .skip(bottom as usize)
                {
                    for &h in &row[left as usize..right as usize + 2] {
                        (least, most) = (least.min(h), most.max(h));
                    }
                }
                // Walls, too.
                let sides = [bj == 0, bi + 1 == cuts, bj + 1 == cuts, bi == 0];
                for k in (0..4).filter(|&k| sides[k]) {
                    let along = [bi, bj][k % 2] as f64;
                    let mut ends = [along, along + 1.0].map(|x| x / cuts as f64);
                    if face.edges[k].reversed == (k < 2) {
                        ends = [1.0 - ends[1], 1.0 - ends[0]];
                    }
                    let [low, high] = edges.range(face.edges[k].edge, key, ends);
                    (least, most) = (least.min(low), most.max(high));
                }
            }
            quads.push(Leaf {
                face: number as u32,
                place,
                low: least,
                high: most,
            });
        }
        Made {
            face,
            quads,
            heights: heights.concat(),
            ranges: all_ranges,
        }
    }

    /// How far micro-vertices are off, rounding of heights included.
    fn achieved(&self, fields: &[Vec<Field>], step: f64) -> AchievedError {
        let together = |of: fn(&Field) -> Distances| {
            let all = fields.iter().flatten().map(of);
            let all = all.fold(Distances::default(), Distances::and);
            all.spread(self.sheets.base.far.into())
        };
        let off = together(|field| field.off);
        let micro_vertices = fields.iter().flatten().map(|f| f.heights.len() as u64);
        AchievedError {
            max_diagonals: off.max_diagonals + 0.5 * step / f64::from(self.sheets.base.far),
            rms_diagonals: off.rms_diagonals,
            max_pixels: None,
            linear_normals: Some(together(|field| field.lengthened)),
            vertices: micro_vertices.sum(),
        }
    }
}

/// Heights in steps above the least one.
fn steps(heights: &[f32], low: f64, step: f64) -> Vec<u16> {
    let rounded = |&h: &f32| {
        let steps = ((f64::from(h) - low) / step).round();
        if steps > 0.0 { steps as u16 } else { 0 }
    };
    heights.iter().map(rounded).collect()
}

/// A face with its quads.
struct Made {
    face: Face,
    quads: Vec<Leaf>,
    heights: Vec<u16>,
    ranges: Vec<Ranges>,
}
