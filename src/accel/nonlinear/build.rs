//! Building: quads are chosen, faces diced three times, heights found and rounded.
//!
//! A face is diced as it is displaced, as it is without displacement, and moved along its normals by the object's size: the
//! difference of the last two is the limit surface's normal, and where faces share micro-vertices it is one for all of them,
//! the mean of theirs, as their displacement is. Heights on edges are found in the edge's own direction, by the same
//! operations for each face. Beside the result all heights exist in single precision for a while, and a face of
//! micro-vertices a thread.

use rayon::prelude::*;

use super::field::{LEAST_LOG, MOST_LOG, Ranges, Size, ranges};
use super::{Nonlinear, Quad};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec3, Vec3};
use crate::stats::AchievedError;
use crate::surface::{
    Amount, Diced, Displacement, FaceGrid, Function, Rates, Scratch, SharedSamples, Surface,
};

/// How far micro-vertices may lie beside the displaced limit points of their parameters, in micro-edges, before faces are
/// cut into more quads.
const MOST_ASIDE: f64 = 0.25;

/// Of the places that are looked at, so many may lie farther off.
const OUTLIERS: f64 = 0.01;

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

/// A surface and what it is made of.
struct Sheets<'a> {
    displaced: &'a Surface,
    plain: Surface,
    /// The limit surface moved along its normals by `far`.
    lifted: Surface,
    far: f32,
}

/// Corners of quads at a motion key: points and unit normals.
type Corners = Vec<[Vec3; 2]>;

impl<'a> Sheets<'a> {
    fn new(displaced: &'a Surface) -> Self {
        let plain = displaced.with_displacement(Displacement::None);
        let diced = Diced::new(&plain, &Rates::uniform(&plain, 1));
        let bounds = Bounds3::of(diced.positions().iter().flatten().copied());
        let size = bounds.extent().length();
        let far = if size > 0.0 && size.is_finite() {
            size
        } else {
            1.0
        };
        let up = Function::scalar(|_| 1.0).bounded(|_| Bounds3::of([Vec3::X]));
        let lifted = displaced.with_displacement(Displacement::Scalar(Amount {
            map: std::sync::Arc::new(up),
            scale: far,
            bias: 0.0,
        }));
        Self {
            displaced,
            plain,
            lifted,
            far,
        }
    }

    /// All points with their unit normals, at each motion key.
    fn corners(&self, rates: &Rates) -> (Vec<FaceGrid>, Vec<Corners>) {
        let [plain, lifted] = [&self.plain, &self.lifted].map(|s| Diced::new(s, rates));
        let keys = plain.positions().iter().zip(lifted.positions().iter());
        let corners = keys
            .map(|(low, high)| {
                let pairs = low.iter().zip(high);
                pairs.map(|(&p, &q)| [p, (q - p) / self.far]).collect()
            })
            .collect();
        (plain.grids().to_vec(), corners)
    }

    /// Into how many quads faces are cut along each edge, and the quads' corners.
    fn quads(&self, rates: &Rates) -> (u32, Vec<Corners>) {
        let base = self.plain.base();
        let faces = (0..base.faces()).filter(|&face| !base.is_hole(face));
        let most = faces.flat_map(|face| rates.face(face)).max().unwrap_or(1);
        let mut cuts = 1;
        while most > cuts << MOST_LOG {
            cuts *= 2;
        }
        loop {
            let fine = Rates::uniform(&self.plain, 2 * cuts);
            let (grids, points) = self.corners(&fine);
            // No finer than it takes to have four micro-quads along a side.
            if 4 * cuts >= most || !self.bends(rates, cuts, &grids, &points) {
                let (_, corners) = self.corners(&Rates::uniform(&self.plain, cuts));
                return (cuts, corners);
            }
            cuts *= 2;
        }
    }

    /// Whether micro-vertices would lie too far beside their places, were faces cut into quads that are two of these
    /// grids' cells along a side.
    fn bends(&self, rates: &Rates, cuts: u32, grids: &[FaceGrid], points: &[Corners]) -> bool {
        let shared: Vec<SharedSamples> = (0..points.len() as u32)
            .map(|key| {
                SharedSamples::new(
                    self.displaced,
                    &Rates::uniform(self.displaced, 2 * cuts),
                    key,
                )
            })
            .collect();
        let counts: Vec<[u64; 2]> = grids
            .par_iter()
            .map_init(Scratch::default, |scratch, grid| {
                let size = rates
                    .face(grid.face)
                    .map(|n| f64::from(n) / f64::from(cuts));
                let [columns, rows] = grid.vertices();
                let first = grid.first_vertex as usize;
                let mut moved = vec![Vec3::ZERO; (columns * rows) as usize];
                let mut count = [0, 0];
                for (key, points) in points.iter().enumerate() {
                    self.displaced.dice_face(
                        &FaceGrid {
                            first_vertex: 0,
                            ..*grid
                        },
                        key as u32,
                        &shared[key],
                        scratch,
                        &mut moved,
                    );
                    let columns = columns as usize;
                    let at = |i: usize, j: usize| Corner::of(&points[first + j * columns + i]);
                    for j in 0..rows as usize {
                        for i in 0..columns {
                            if i % 2 == 0 && j % 2 == 0 {
                                continue;
                            }
                            // The ends of the side, or of the diagonal, that it is in the middle of.
                            let [u, v] = [i % 2, j % 2];
                            let (a, b) = (at(i + u, j - v), at(i - u, j + v));
                            let middle = a.lerp(&b, 0.5);
                            let here = at(i, j);
                            let target = moved[j * columns + i].as_dvec3();
                            let Some(height) = middle.height(target, here.n) else {
                                continue;
                            };
                            let aside = middle.at(height).distance(target);
                            // Two cells have the micro-edges of a quad.
                            let long = |p: Corner, q: Corner, n: f64| p.p.distance(q.p) / n;
                            let edges = [
                                (i + 1 < columns && i > 0)
                                    .then(|| long(at(i - 1, j), at(i + 1, j), size[0])),
                                (j + 1 < rows as usize && j > 0)
                                    .then(|| long(at(i, j - 1), at(i, j + 1), size[1])),
                            ];
                            let edge = edges.into_iter().flatten().fold(0.0, f64::max);
                            count[0] += 1;
                            count[1] += u64::from(aside > MOST_ASIDE * edge);
                        }
                    }
                }
                count
            })
            .collect();
        let [all, off] = counts
            .iter()
            .fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
        off as f64 > OUTLIERS * all as f64
    }
}

/// A corner, or a place between corners: points of its line.
#[derive(Debug, Clone, Copy)]
struct Corner {
    p: DVec3,
    n: DVec3,
}

impl Corner {
    fn of([p, n]: &[Vec3; 2]) -> Self {
        Self {
            p: p.as_dvec3(),
            n: n.as_dvec3(),
        }
    }

    fn lerp(&self, to: &Self, x: f64) -> Self {
        Self {
            p: self.p + x * (to.p - self.p),
            n: self.n + x * (to.n - self.n),
        }
    }

    /// Where a quad has x and y of the way from its first corner.
    fn within([a, b, c, d]: &[Self; 4], x: f64, y: f64) -> Self {
        let mixed = |from: &Self, by: [(&Self, f64); 2]| {
            let sum = |pick: fn(&Self) -> DVec3| {
                let [(u, x), (v, y)] = by;
                pick(from) + x * (pick(u) - pick(from)) + y * (pick(v) - pick(from))
            };
            Self {
                p: sum(|c| c.p),
                n: sum(|c| c.n),
            }
        };
        if x + y <= 1.0 {
            mixed(a, [(b, x), (c, y)])
        } else {
            mixed(d, [(c, 1.0 - x), (b, 1.0 - y)])
        }
    }

    fn at(&self, height: f64) -> DVec3 {
        self.p + height * self.n
    }

    /// Where its line meets the plane through `target` across `normal`; where it hardly does, its point next to that.
    fn height(&self, target: DVec3, normal: DVec3) -> Option<f64> {
        let (way, across) = (target - self.p, self.n.dot(normal));
        let height = if across > 0.1 * self.n.length() * normal.length() {
            way.dot(normal) / across
        } else {
            way.dot(self.n) / self.n.length_squared()
        };
        height.is_finite().then_some(height)
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
        let logs = |face: u32| rates.face(face).map(log);
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
        let mut keep = |at: usize, place: Corner| {
            let target = displaced[at].as_dvec3();
            let normal = lifted[at].as_dvec3() - plain[at].as_dvec3();
            let height = place.height(target, normal).unwrap_or(0.0) as f32;
            let off = place.at(height.into()).distance(target);
            field.heights[at] = height;
            field.largest = field.largest.max(off);
            field.squares += off * off;
        };
        for (bj, bi) in
            (0..self.cuts as usize).flat_map(|j| (0..self.cuts as usize).map(move |i| (j, i)))
        {
            let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| corner(bi + i, bj + j));
            for y in usize::from(bj == 0)..mv {
                for x in usize::from(bi == 0)..mu {
                    let at = (bj * mv + y) * columns + bi * mu + x;
                    let place =
                        Corner::within(&corners, x as f64 / mu as f64, y as f64 / mv as f64);
                    keep(at, place);
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
                keep(j * columns + i, here);
            }
        }
        field
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
            made.quads.push(Quad {
                face: grid.face,
                corner: self.quads[number].vertex(bi as u16, bj as u16) as u32,
                heights: made.heights.len() as u32,
                ranges: made.ranges.len() as u32,
                place: [bi as u16, bj as u16],
                size,
                low: least,
                high: most,
            });
            for key in 0..steps.len() {
                let first = made.heights.len();
                if least == most {
                    made.heights
                        .extend(std::iter::repeat_n(least, size.heights()));
                } else {
                    rows(key).for_each(|row| made.heights.extend_from_slice(row));
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
