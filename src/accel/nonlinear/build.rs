//! Building: quads are chosen, faces diced three times, heights found and rounded.
//!
//! A face is diced as it is displaced, as it is without displacement, and moved along its normals by the object's size: the
//! difference of the last two is the limit surface's normal, and where faces share micro-vertices it is one for all of them,
//! the mean of theirs, as their displacement is. Heights on edges are found in the edge's own direction, by the same
//! operations for each face. Beside the result all heights exist in single precision for a while, and a face of
//! micro-vertices a thread.

use rayon::prelude::*;

use super::field::{LEAST_LOG, MOST_LOG, Ranges, Size, ranges};
use super::sheets::{Corner, Corners, Sheets};
use super::{Collapsed, Nonlinear, Quad};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec3, Vec3};
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
}

/// A face's heights at a motion key, and how far from the displaced points they leave micro-vertices.
struct Field {
    heights: Vec<f32>,
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
            largest: 0.0,
            squares: 0.0,
        };
        let mut keep = |at: usize, place: Corner, target: DVec3, normal: DVec3| {
            let height = place.height(target, normal).unwrap_or(0.0) as f32;
            let off = place.at(height.into()).distance(target);
            field.heights[at] = height;
            field.largest = field.largest.max(off);
            field.squares += off * off;
        };
        let target = |at: usize| displaced[at].as_dvec3();
        let normal = |at: usize| lifted[at].as_dvec3() - plain[at].as_dvec3();
        for (bj, bi) in
            (0..self.cuts as usize).flat_map(|j| (0..self.cuts as usize).map(move |i| (j, i)))
        {
            let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| corner(bi + i, bj + j));
            let collapsed = self.collapsed(grid.face, [bi, bj]);
            for y in usize::from(bj == 0)..mv {
                for x in usize::from(bi == 0)..mu {
                    let at = (bj * mv + y) * columns + bi * mu + x;
                    let part = [x as f64 / mu as f64, y as f64 / mv as f64];
                    let place = Corner::within(&corners, part[0], part[1]);
                    if collapsed == Collapsed::None {
                        keep(at, place, target(at), normal(at));
                        continue;
                    }
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
                    keep(
                        at,
                        place,
                        between(target(first), target(next)),
                        between(normal(first), normal(next)),
                    );
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
                keep(at, here, target(at), normal(at));
            }
        }
        field
    }

    /// The side of a face's quad that is a point.
    fn collapsed(&self, face: u32, [bi, bj]: [usize; 2]) -> Collapsed {
        let base = self.sheets.plain.base();
        let last = self.cuts as usize - 1;
        let sides = [
            (bj == last, 2, Collapsed::Top),
            (bi == last, 1, Collapsed::Right),
            (bj == 0, 0, Collapsed::Bottom),
            (bi == 0, 3, Collapsed::Left),
        ];
        let found = sides
            .into_iter()
            .find(|&(there, k, _)| there && base.is_collapsed(face, k));
        found.map_or(Collapsed::None, |(.., side)| side)
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
        let mut quads = Vec::new();
        let mut heights = Vec::with_capacity(made.iter().map(|made| made.heights.len()).sum());
        let mut all_ranges: Vec<Ranges> = Vec::new();
        for made in made {
            if u32::try_from(heights.len() + made.heights.len()).is_err() {
                return Err(Error::Memory {
                    message: "one object takes more than 8 GB of heights".into(),
                    help: Some(
                        "Raise the dicing rate, or lower the most segments of an edge.".into(),
                    ),
                });
            }
            for mut quad in made.quads {
                quad.heights += heights.len() as u32;
                quad.ranges += all_ranges.len() as u32;
                quads.push(quad);
            }
            heights.extend(made.heights);
            all_ranges.extend(made.ranges);
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
            corners,
            heights,
            ranges: all_ranges,
            achieved: self.achieved(fields, step),
        };
        new.arrange(each);
        Ok(new)
    }

    /// The quads of a face.
    fn made(&self, number: usize, fields: &[Field], low: f64, step: f64) -> Made {
        let grid = &self.grids[number];
        let columns = usize::from(grid.size[0]) + 1;
        let steps: Vec<Vec<u16>> = fields
            .iter()
            .map(|field| self.steps(grid, &field.heights, low, step))
            .collect();
        let cuts = self.cuts as usize;
        let [mu, mv] = grid.size.map(|n| usize::from(n) / cuts);
        let mut made = Made::default();
        for (bj, bi) in (0..cuts).flat_map(|j| (0..cuts).map(move |i| (j, i))) {
            let rows = |key: usize| {
                let first = bj * mv * columns + bi * mu;
                (0..=mv)
                    .map(move |y| first + y * columns..first + y * columns + mu + 1)
                    .map({
                        let steps = &steps[key];
                        move |row| &steps[row]
                    })
            };
            let (mut least, mut most) = (u16::MAX, 0);
            for key in 0..steps.len() {
                for &h in rows(key).flatten() {
                    (least, most) = (least.min(h), most.max(h));
                }
            }
            // What is all alike need not be fine.
            let size = if least == most {
                Size([LEAST_LOG; 2])
            } else {
                Size([mu, mv].map(|n| n.trailing_zeros() as u8))
            };
            let collapsed = self.collapsed(grid.face, [bi, bj]);
            made.quads.push(Quad {
                face: grid.face,
                corner: self.quads[number].vertex(bi as u16, bj as u16) as u32,
                heights: made.heights.len() as u32,
                ranges: made.ranges.len() as u32,
                place: [bi as u16, bj as u16],
                size,
                low: least,
                high: most,
                collapsed,
            });
            for key in 0..steps.len() {
                let first = made.heights.len();
                if least == most {
                    made.heights
                        .extend(std::iter::repeat_n(least, size.heights()));
                } else {
                    rows(key).for_each(|row| made.heights.extend_from_slice(row));
                    collapsed.fold(mu, &mut made.heights[first..]);
                }
                ranges(size, &made.heights[first..], &mut made.ranges);
            }
        }
        made
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

impl Collapsed {
    /// Gives the third side of the triangle with an area the heights of the quad's side that lies there, which the next
    /// quad has as well. `n` micro-quads along each side.
    fn fold(self, n: usize, heights: &mut [u16]) {
        let at = |i: usize, j: usize| j * (n + 1) + i;
        for i in 0..=n {
            let j = n - i;
            let from = match self {
                Self::None => return,
                Self::Top => at(n, j),
                Self::Right => at(i, n),
                Self::Bottom => at(0, j),
                Self::Left => at(i, 0),
            };
            heights[at(i, j)] = heights[from];
        }
    }
}

/// A face's quads; their numbers are counted within the face.
#[derive(Default)]
struct Made {
    quads: Vec<Quad>,
    heights: Vec<u16>,
    ranges: Vec<Ranges>,
}

impl Nonlinear {
    /// Builds the tree over the quads, and puts them in its order. A motion key has `each` corners.
    pub(super) fn arrange(&mut self, each: usize) {
        let row = self.cuts as usize + 1;
        let hull = |quad: &Quad, key: usize| {
            let corner = |next: usize| &self.corners[key * each + quad.corner as usize + next];
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
