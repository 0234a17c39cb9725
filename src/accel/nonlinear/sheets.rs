//! The quads of a surface: how many a face has, and the lines through their corners.

use rayon::prelude::*;

use crate::accel::prism::{Corners, Lifted};
use crate::math::{DVec3, Vec3};
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// How far lines over micro-vertices may pass by the displaced limit points of their parameters, in micro-edges, before
/// faces are cut into more quads.
const MOST_ASIDE: f64 = 2.5;

/// Of the places that are looked at, so many may lie farther off.
const OUTLIERS: f64 = 0.05;

/// How far without displacement, in diagonals of the object: it matters where micro-edges are long.
const MOST_BASE_ASIDE: f64 = 2e-3;

/// Of the places that are looked at, so many may lie farther off than that.
const BASE_OUTLIERS: f64 = 0.01;

/// A surface and what it is made of.
pub(super) struct Sheets<'a> {
    pub(super) displaced: &'a Surface,
    pub(super) base: Lifted,
}

/// The most micro-quads along a side of a quad: curves in single precision must tell places on them.
const MOST_MICRO_QUADS: u32 = 256;

/// The fewest micro-triangles of a quad on average, where there are more quads than a few.
const LEAST_TRIANGLES: u64 = 500;
const FEW_QUADS: u64 = 16384;

impl<'a> Sheets<'a> {
    pub(super) fn new(displaced: &'a Surface) -> Self {
        Self {
            displaced,
            base: Lifted::new(displaced),
        }
    }

    /// The corners of quads, where faces are cut into so many along each edge.
    pub(super) fn corners(&self, cuts: u32) -> Vec<Corners> {
        self.base.corners(&Rates::uniform(&self.base.plain, cuts)).1
    }

    /// Into how many quads faces are cut along each edge at least, and from when on into no more: quads of two micro-quads along
    /// a side, and of few micro-triangles each, would take more memory than heights do.
    pub(super) fn least_cuts(&self, rates: &Rates) -> (u32, u32) {
        let base = self.base.plain.base();
        let faces: Vec<u32> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .collect();
        let most = faces.iter().flat_map(|&face| rates.face(face)).max();
        let most = most.unwrap_or(1);
        let quads = (rates.micro_triangles() / LEAST_TRIANGLES).max(FEW_QUADS);
        let mut cuts = 1;
        while most > cuts * MOST_MICRO_QUADS {
            cuts *= 2;
        }
        let mut limit = cuts;
        loop {
            let more = self.more(limit);
            let all = faces.len() as u64 * u64::from(more).pow(2);
            if 2 * more > most || all > quads {
                return (cuts, limit);
            }
            limit = more;
        }
    }

    /// The next number of quads along edges: a quarter more, or twice as many where faces have sides that are but a point,
    /// whose micro-quads are a multiple of it.
    pub(super) fn more(&self, cuts: u32) -> u32 {
        let base = self.base.plain.base();
        let is_pointed = |face: u32| (0..4).any(|k| base.is_collapsed(face, k));
        if (0..base.faces()).any(is_pointed) {
            2 * cuts
        } else {
            cuts + cuts.div_ceil(4)
        }
    }

    /// Whether micro-vertices would lie too far beside their places, were faces cut into so many quads along each edge.
    pub(super) fn bends(&self, rates: &Rates, cuts: u32) -> bool {
        // Two cells are a quad.
        let (grids, points) = (self.base).corners(&Rates::uniform(&self.base.plain, 2 * cuts));
        let shared: Vec<SharedSamples> = (0..points.len() as u32)
            .map(|key| {
                SharedSamples::new(
                    self.displaced,
                    &Rates::uniform(self.displaced, 2 * cuts),
                    key,
                )
            })
            .collect();
        let most_base = MOST_BASE_ASIDE * f64::from(self.base.far);
        let counts: Vec<[u64; 3]> = grids
            .par_iter()
            .map_init(Scratch::default, |scratch, grid| {
                let size = rates
                    .face(grid.face)
                    .map(|n| f64::from(n) / f64::from(cuts));
                let [columns, rows] = grid.vertices();
                let first = grid.first_vertex as usize;
                let mut moved = vec![Vec3::ZERO; (columns * rows) as usize];
                let mut count = [0; 3];
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
                            let aside = middle.aside(target, here.n);
                            let base = middle.aside(here.p, here.n);
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
                            count[2] += u64::from(base > most_base);
                        }
                    }
                }
                count
            })
            .collect();
        let [all, off, far] = counts
            .iter()
            .fold([0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
        far as f64 > BASE_OUTLIERS * all as f64 || off as f64 > OUTLIERS * all as f64
    }
}

/// A corner, or a place between corners: points of its line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub(super) p: DVec3,
    pub(super) n: DVec3,
}

impl Corner {
    pub(super) fn of([p, n]: &[Vec3; 2]) -> Self {
        Self {
            p: p.as_dvec3(),
            n: n.as_dvec3(),
        }
    }

    pub(super) fn lerp(&self, to: &Self, x: f64) -> Self {
        Self {
            p: self.p + x * (to.p - self.p),
            n: self.n + x * (to.n - self.n),
        }
    }

    /// Where a quad has x and y of the way from its first corner.
    pub(super) fn within([a, b, c, d]: &[Self; 4], x: f64, y: f64) -> Self {
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

    pub(super) fn at(&self, height: f64) -> DVec3 {
        self.p + height * self.n
    }

    /// Its height at a point, or where it meets the plane there, and how far off that is.
    pub(super) fn placed(&self, point: DVec3, normal: DVec3) -> (f32, f64) {
        let height = self.height(point, normal).unwrap_or(0.0) as f32;
        (height, self.at(height.into()).distance(point))
    }

    /// How far from `target` that is.
    fn aside(&self, target: DVec3, normal: DVec3) -> f64 {
        let height = self.height(target, normal);
        height.map_or(0.0, |height| self.at(height).distance(target))
    }

    /// Where its line meets the plane through `target` across `normal`; where it hardly does, its point next to that.
    pub(super) fn height(&self, target: DVec3, normal: DVec3) -> Option<f64> {
        let (way, across) = (target - self.p, self.n.dot(normal));
        let height = if across > 0.1 * self.n.length() * normal.length() {
            way.dot(normal) / across
        } else {
            way.dot(self.n) / self.n.length_squared()
        };
        height.is_finite().then_some(height)
    }
}
