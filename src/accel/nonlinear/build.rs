//! Building: quads are chosen, faces diced three times, heights found and rounded.
//!
//! A face is diced as it is displaced, as it is without displacement, and moved along its normals by the object's size: the
//! difference of the last two is the limit surface's normal, and where faces share micro-vertices it is one for all of them,
//! the mean of theirs, as their displacement is. Heights on edges are found in the edge's own direction, by the same
//! operations for each face. Beside the result all heights exist in single precision for a while, and a face of
//! micro-vertices a thread.

use rayon::prelude::*;

use super::field::{LEAST_LOG, MOST_LOG, Ranges, Size, ranges};
use super::meet::{Lines, MIDDLES, NEAR, Shifts, rounded, shift};
use super::sheets::{Corner, Corners, Sheets};
use super::{Collapsed, Face, Leaf, Nonlinear, weights};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec2, DVec3, Vec3};
use crate::stats::AchievedError;
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
        let (cuts, corners) = sheets.quads(rates);
        Builder::new(&sheets, rates, cuts, corners).run(progress)
    }
}

struct Builder<'a> {
    sheets: &'a Sheets<'a>,
    cuts: u32,
    corners: Vec<Corners>,
    /// Grids of quads, and of micro-quads.
    quads: Vec<FaceGrid>,
    grids: Vec<FaceGrid>,
    rates: Rates,
    /// Heights on edges are multiples of this many steps.
    unit: u32,
    /// By motion key.
    shared: Vec<[SharedSamples; 3]>,
    lines: Lines<'a>,
}

/// The height of a line at a point, or where it meets the plane there, and how far off that is.
fn placed(line: &Corner, point: DVec3, normal: DVec3) -> (f32, f64) {
    let height = line.height(point, normal).unwrap_or(0.0) as f32;
    (height, line.at(height.into()).distance(point))
}

/// A face's heights at a motion key, and how far from the displaced points they leave micro-vertices.
struct Field {
    heights: Vec<f32>,
    /// By quad.
    shifts: Vec<Shifts>,
    largest: f64,
    squares: f64,
}

impl<'a> Builder<'a> {
    fn new(sheets: &'a Sheets<'a>, rates: &Rates, cuts: u32, corners: Vec<Corners>) -> Self {
        let surface = sheets.displaced;
        let base = surface.base();
        let log = |n: u32| {
            let log = (f64::from(n) / f64::from(cuts)).log2().round();
            log.clamp(LEAST_LOG.into(), MOST_LOG.into()) as u32
        };
        // Edges are as coarse as the coarsest face there.
        // Over a triangle that fills its quad the two go together.
        let is_pointed = |face: u32| (0..4).any(|k| base.is_collapsed(face, k));
        let logs = |face: u32| {
            let [u, v] = rates.face(face).map(log);
            if is_pointed(face) {
                [u.max(v); 2]
            } else {
                [u, v]
            }
        };
        let faces = || (0..base.faces()).filter(|&face| !base.is_hole(face));
        let sides = || {
            faces()
                .flat_map(|face| (0..4).map(move |k| (base.edge(face, k).edge as usize, face, k)))
        };
        let edges = sides().map(|(edge, ..)| edge + 1).max().unwrap_or(0);
        let mut least = vec![u32::from(MOST_LOG); edges];
        for (edge, face, k) in sides() {
            least[edge] = least[edge].min(logs(face)[k as usize % 2]);
        }
        let ratio = sides()
            .map(|(edge, face, k)| logs(face)[k as usize % 2] - least[edge])
            .max();
        let rates = Rates::new(
            surface,
            |edge| cuts << least.get(edge as usize).copied().unwrap_or(0),
            |face| logs(face).map(|log| cuts << log),
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
            [surface, &sheets.plain, &sheets.lifted].map(|s| SharedSamples::new(s, &rates, key))
        });
        let shared = shared.collect();
        Self {
            sheets,
            cuts,
            corners,
            quads,
            grids,
            rates,
            unit: 1 << ratio.unwrap_or(0),
            shared,
            lines: Lines::new(sheets),
        }
    }

    fn run(self, progress: &dyn Fn(f64) -> bool) -> Result<Nonlinear> {
        let mut fields: Vec<Vec<Field>> = Vec::with_capacity(self.grids.len());
        for batch in (0..self.grids.len()).collect::<Vec<_>>().chunks(BATCH) {
            if !progress(batch[0] as f64 / self.grids.len() as f64) {
                return Err(Error::Interrupted);
            }
            fields.par_extend(batch.par_iter().with_min_len(4).map_init(
                || (Scratch::default(), [Vec::new(), Vec::new(), Vec::new()]),
                |(scratch, points), &number| {
                    let keys = 0..self.shared.len();
                    keys.map(|key| self.field(number, key, scratch, points))
                        .collect()
                },
            ));
        }
        if !progress(1.0) {
            return Err(Error::Interrupted);
        }
        self.joined(&fields)
    }

    /// The heights of a face.
    fn field(
        &self,
        number: usize,
        key: usize,
        scratch: &mut Scratch,
        points: &mut [Vec<Vec3>; 3],
    ) -> Field {
        let grid = &self.grids[number];
        let [columns, rows] = grid.vertices().map(|n| n as usize);
        let surfaces = [
            self.sheets.displaced,
            &self.sheets.plain,
            &self.sheets.lifted,
        ];
        for ((points, surface), shared) in points.iter_mut().zip(surfaces).zip(&self.shared[key]) {
            points.resize(columns * rows, Vec3::ZERO);
            surface.dice_face(grid, key as u32, shared, scratch, points);
        }
        let [displaced, plain, lifted] = points;
        let coarse = &self.quads[number];
        let corner = |i: usize, j: usize| {
            Corner::of(&self.corners[key][coarse.vertex(i as u16, j as u16) as usize])
        };
        let [mu, mv] = grid.size.map(|n| usize::from(n) / self.cuts as usize);
        let mut field = Field {
            heights: vec![f32::NAN; columns * rows],
            shifts: vec![Shifts::default(); (self.cuts * self.cuts) as usize],
            largest: 0.0,
            squares: 0.0,
        };
        let step = DVec2::new(1.0 / f64::from(grid.size[0]), 1.0 / f64::from(grid.size[1]));
        let face = self.face(number, grid);
        let target = |at: usize| displaced[at].as_dvec3();
        let normal = |at: usize| lifted[at].as_dvec3() - plain[at].as_dvec3();
        // The means of displacement, by quad.
        let mean = |bi: usize, bj: usize| {
            let mut sum = 0.0;
            for (i, j) in [(1, 1), (1, 3), (2, 2), (3, 1), (3, 3)] {
                let at = (bj * mv + j * mv / 4) * columns + bi * mu + i * mu / 4;
                let n = normal(at);
                let h = (target(at) - plain[at].as_dvec3()).dot(n) / n.length();
                sum += if h.is_finite() { 0.2 * h } else { 0.0 };
            }
            sum
        };
        for (bj, bi) in
            (0..self.cuts as usize).flat_map(|j| (0..self.cuts as usize).map(move |i| (j, i)))
        {
            let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| corner(bi + i, bj + j));
            let collapsed = face.collapsed(self.cuts, [bi as u16, bj as u16]);
            let shifts = &mut field.shifts[bj * self.cuts as usize + bi];
            if collapsed == Collapsed::None {
                let height = mean(bi, bj);
                for (kept, [x, y]) in shifts.iter_mut().zip(MIDDLES) {
                    let line = Corner::within(&corners, x, y);
                    let at = DVec2::new(bi as f64 + x, bj as f64 + y) / f64::from(self.cuts);
                    let by = self.lines.shift(grid.face, key as u32, &line, at, height);
                    *kept = rounded(f64::from(self.cuts) * by);
                }
            }
            for y in usize::from(bj == 0)..mv {
                for x in usize::from(bi == 0)..mu {
                    let at = (bj * mv + y) * columns + bi * mu + x;
                    let part = [x as f64 / mu as f64, y as f64 / mv as f64];
                    let line = Corner::within(&corners, part[0], part[1]);
                    let off;
                    if collapsed == Collapsed::None {
                        let (mut height, aside) = placed(&line, target(at), normal(at));
                        // The next ones are there, as it is inside of the face.
                        let by_step = [at + 1, at + columns]
                            .map(|next| plain[next].as_dvec3() - plain[at].as_dvec3());
                        let edge = by_step[0].length().min(by_step[1].length());
                        let by = shift(shifts, weights(part));
                        let by = DVec2::new(by[0] * mu as f64, by[1] * mv as f64);
                        let mut missed = line.at(height.into()) - target(at);
                        if aside > NEAR * edge {
                            let here = DVec2::new((bi * mu + x) as f64, (bj * mv + y) as f64);
                            let start = (here + by) * step;
                            let (lines, key) = (&self.lines, key as u32);
                            if let Some(found) = lines.meet(grid.face, key, &line, start, step) {
                                (height, _) = placed(&line, found.point, found.normal);
                                let moved = found.uv / step - here;
                                missed = moved.x * by_step[0] + moved.y * by_step[1];
                            }
                        }
                        field.heights[at] = height;
                        off = (missed - by.x * by_step[0] - by.y * by_step[1]).length();
                    } else {
                        // Between the micro-vertices next to its place along the row, or the column.
                        let [u, v] = collapsed.stretched(part);
                        let (u, v) = (u * mu as f64, v * mv as f64);
                        let (i, j) = (u as usize, v as usize);
                        let first = (bj * mv + j) * columns + bi * mu + i;
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
                        (field.heights[at], off) = placed(&line, point, normal);
                    }
                    field.largest = field.largest.max(off);
                    field.squares += off * off;
                }
            }
        }
        // Along edges, in their own directions.
        for k in 0..4_u32 {
            let used = self.sheets.displaced.base().edge(grid.face, k);
            let samples = self.rates.edge(used.edge) as usize;
            let n = usize::from(grid.size[k as usize % 2]);
            let cuts = self.cuts as usize;
            let place = |size: [usize; 2], x: usize| match k {
                0 => (x, 0),
                1 => (size[0], x),
                2 => (size[0] - x, size[1]),
                _ => (0, size[1] - x),
            };
            for sample in 0..=samples {
                let along = if used.reversed {
                    samples - sample
                } else {
                    sample
                };
                // Edges that are but a point have a single segment.
                let at = along * cuts;
                let (segment, part) = (at / samples, (at % samples) as f64 / samples as f64);
                let end = |x: usize| {
                    let x = if used.reversed { cuts - x } else { x };
                    let (i, j) = place([cuts; 2], x);
                    corner(i, j)
                };
                let here = if part == 0.0 {
                    end(segment)
                } else {
                    end(segment).lerp(&end(segment + 1), part)
                };
                let (i, j) = place(grid.size.map(usize::from), sample * (n / samples));
                let at = j * columns + i;
                let (height, aside) = placed(&here, target(at), normal(at));
                field.heights[at] = height;
                let long = |p: Corner, q: Corner| p.p.distance(q.p) * cuts as f64 / samples as f64;
                if part > 0.0 && aside > NEAR * long(end(segment), end(segment + 1)) {
                    let (along, step) = (along as f64 / samples as f64, 1.0 / samples as f64);
                    let lines = &self.lines;
                    let found = lines.meet_on_edge(used.edge, key as u32, &here, along, step);
                    if let Some(found) = found {
                        (field.heights[at], _) = placed(&here, found.point, found.normal);
                    }
                }
            }
        }
        field
    }

    /// A face, whose heights and ranges begin nowhere yet.
    fn face(&self, number: usize, grid: &FaceGrid) -> Face {
        let base = self.sheets.plain.base();
        let side = |k: u8| u8::from(base.is_collapsed(grid.face, k.into())) << k;
        let quads = |n: u16| u32::from(n) / self.cuts;
        Face {
            face: grid.face,
            corner: self.quads[number].first_vertex as u32,
            heights: 0,
            ranges: 0,
            size: Size(grid.size.map(|n| quads(n).trailing_zeros() as u8)),
            collapsed: side(0) | side(1) | side(2) | side(3),
        }
    }

    fn joined(self, fields: &[Vec<Field>]) -> Result<Nonlinear> {
        let all = || fields.iter().flatten();
        let (low, high) = all()
            .flat_map(|field| &field.heights)
            .filter(|h| !h.is_nan())
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &h| {
                (a.min(h), b.max(h))
            });
        let (low, range) = if low <= high {
            (f64::from(low), f64::from(high) - f64::from(low))
        } else {
            (0.0, 0.0)
        };
        let unit = f64::from(self.unit);
        let step = range.max(1e-7 * f64::from(self.sheets.far)) / (f64::from(u16::MAX) - unit);
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
            .map(|number| self.made(number, &fields[number], low, step))
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
        let longest = faces
            .iter()
            .map(|face: &Face| face.heights(self.cuts)[0])
            .max();
        heights.extend(std::iter::repeat_n(0, 4 * longest.unwrap_or(0) + 8));
        if shifts.iter().all(|shifts| *shifts == Shifts::default()) {
            shifts = Vec::new();
        }
        let mut new = Nonlinear {
            isa: Isa::best(),
            lattice: Lattice::around(&Bounds3::EMPTY, 0.0),
            reach: 0.0,
            keys: keys as u32,
            left_handed: self.sheets.plain.base().left_handed(),
            cuts: self.cuts,
            top: Top::default(),
            quads,
            faces,
            corners,
            heights,
            shifts,
            ranges: all_ranges,
            achieved: self.achieved(fields, step),
        };
        new.arrange(each);
        Ok(new)
    }

    /// A face with its quads.
    fn made(&self, number: usize, fields: &[Field], low: f64, step: f64) -> Made {
        let grid = &self.grids[number];
        let mut face = self.face(number, grid);
        let mut steps: Vec<Vec<u16>> = fields
            .iter()
            .map(|field| self.steps(grid, &field.heights, low, step))
            .collect();
        let first = steps.first().and_then(|steps| steps.first()).copied();
        let is_flat = |&first: &u16| steps.iter().flatten().all(|&h| h == first);
        if let Some(height) = first.filter(is_flat) {
            // What is all alike need not be fine.
            face.size = Size([LEAST_LOG; 2]);
            let [_, in_face] = face.heights(self.cuts);
            steps.fill(vec![height; in_face]);
        }
        let cuts = self.cuts as usize;
        let [mu, mv] = face.size.quads();
        let [stride, _] = face.heights(self.cuts);
        let mut quads = Vec::with_capacity(cuts * cuts);
        let mut all_ranges = Vec::with_capacity(cuts * cuts * steps.len() * face.size.ranges());
        for (bj, bi) in (0..cuts).flat_map(|j| (0..cuts).map(move |i| (j, i))) {
            let first = bj * mv * stride + bi * mu;
            let place = [bi as u16, bj as u16];
            let collapsed = face.collapsed(self.cuts, place);
            let (mut least, mut most) = (u16::MAX, 0);
            for steps in &mut steps {
                let heights = &mut steps[first..];
                collapsed.fold(mu, stride, heights);
                for row in heights.chunks(stride).take(mv + 1) {
                    for &h in &row[..=mu] {
                        (least, most) = (least.min(h), most.max(h));
                    }
                }
                ranges(face.size, heights, stride, &mut all_ranges);
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
            heights: steps.concat(),
            ranges: all_ranges,
        }
    }

    /// A face's heights in steps above the least one.
    fn steps(&self, grid: &FaceGrid, heights: &[f32], low: f64, step: f64) -> Vec<u16> {
        let rounded = |h: f32, unit: f64| {
            let steps = ((f64::from(h) - low) / (step * unit)).round() * unit;
            if steps > 0.0 { steps as u16 } else { 0 }
        };
        let mut steps: Vec<u16> = heights.iter().map(|&h| rounded(h, 1.0)).collect();
        let [nu, nv] = grid.size.map(usize::from);
        let columns = nu + 1;
        for k in 0..4_u32 {
            let edge = self.sheets.displaced.base().edge(grid.face, k).edge;
            let samples = self.rates.edge(edge) as usize;
            let n = [nu, nv][k as usize % 2];
            let place = |x: usize| match k {
                0 => x,
                1 => x * columns + nu,
                2 => nv * columns + x,
                _ => x * columns,
            };
            let ratio = n / samples;
            for sample in 0..=samples {
                let at = place(sample * ratio);
                steps[at] = rounded(heights[at], f64::from(self.unit));
            }
            // Between the samples what the coarser side has there.
            for x in (0..n).filter(|x| x % ratio != 0) {
                let first = x / ratio * ratio;
                let [a, b] = [first, first + ratio].map(|x| i64::from(steps[place(x)]));
                let (x, ratio) = ((x - first) as i64, ratio as i64);
                steps[place(first + x as usize)] = (a + (b - a) * x / ratio) as u16;
            }
        }
        steps
    }

    /// How far micro-vertices are off, rounding of heights included.
    fn achieved(&self, fields: &[Vec<Field>], step: f64) -> AchievedError {
        let all = || fields.iter().flatten();
        let count: u64 = all().map(|field| field.heights.len() as u64).sum();
        let largest = all().fold(0.0, |m: f64, field| m.max(field.largest)) + 0.5 * step;
        let squares: f64 = all().map(|field| field.squares).sum();
        let diagonal = f64::from(self.sheets.far);
        AchievedError {
            max_diagonals: largest / diagonal,
            rms_diagonals: (squares / count.max(1) as f64).sqrt() / diagonal,
            max_pixels: None,
            vertices: count,
        }
    }
}

/// A face with its quads.
struct Made {
    face: Face,
    quads: Vec<Leaf>,
    heights: Vec<u16>,
    ranges: Vec<Ranges>,
}

impl Nonlinear {
    /// Builds the tree over the quads, and puts them in its order. A motion key has `each` corners.
    pub(super) fn arrange(&mut self, each: usize) {
        let row = self.cuts as usize + 1;
        let hull = |quad: &Leaf, key: usize| {
            let [i, j] = quad.place.map(usize::from);
            let first = self.faces[quad.face as usize].corner as usize + j * row + i;
            let corner = |next: usize| &self.corners[key * each + first + next];
            let lines = [0, 1, row, row + 1].map(corner);
            let heights = [quad.low, quad.high];
            lines
                .into_iter()
                .flat_map(move |[p, n]| heights.map(|h| p.as_dvec3() + f64::from(h) * n.as_dvec3()))
        };
        let keys = self.keys as usize;
        let all = self
            .quads
            .iter()
            .flat_map(|quad| (0..keys).flat_map(move |key| hull(quad, key)));
        let bounds = all.fold(Bounds3::EMPTY, |b, p| b.including(p.as_vec3()));
        let lattice = Lattice::around(&bounds, 0.0);
        let on_lattice = |p: DVec3| (p - lattice.anchor.as_dvec3()) / lattice.step();
        let extents: Vec<Vec<Extent>> = (0..keys)
            .map(|key| {
                let quads = self.quads.par_iter();
                quads
                    .map(|quad| {
                        let points: Vec<DVec3> = hull(quad, key).map(on_lattice).collect();
                        Extent::around(&points)
                    })
                    .collect()
            })
            .collect();
        let all = extents
            .iter()
            .flatten()
            .copied()
            .fold(Extent::EMPTY, Extent::union);
        let largest = |k: usize| all.min[k].abs().max(all.max[k].abs());
        let reach = if all.is_empty() {
            0
        } else {
            (0..3).map(largest).max().unwrap_or(0)
        };
        let (top, order) = Top::new(&extents);
        self.quads = order
            .into_iter()
            .map(|number| self.quads[number as usize])
            .collect();
        (self.lattice, self.reach, self.top) = (lattice, reach as f32, top);
    }
}
