//! Moving a cage's points so that its limit surface lies close to the dense mesh: the smaller displacements are, the
//! better they are along the normal.
//!
//! Lee, Moreton and Hoppe (*Displaced Subdivision Surfaces*, SIGGRAPH 2000) fit the control mesh before they sample
//! displacement. Here this is done by least squares, in rounds: limit points all over the surface are sums of the cage's
//! points with known weights, and each is to come to where the line along its normal meets the dense mesh, as baking will
//! look for it. With closest points as targets, places would slide over the surface; what no line meets has no say.
//!
//! What is minimised over the points' moves is, with weights by area,
//!
//! ```text
//!   sum of |limit point - target|²  +  STIFFNESS · sum over edges of |move - move of the other end|²  +  REST · |move|²
//! ```
//!
//! by conjugate gradients on the normal equations. The second term lets points that few places see go with those
//! around, the third keeps those that none sees.

use rayon::prelude::*;
use serde::Serialize;

use super::along_normal::{self, Facing};
use super::sizes::{middle, probe};
use super::{Cage, Dense, Options, Run, nothing_met};
use crate::error::Result;
use crate::math::{DVec3, Vec3};
use crate::mesh::ControlMesh;
use crate::subdiv::LimitSurface;

/// Places along u, and along v, of each face.
const PLACES: usize = 6;
/// Rounds at most.
const ROUNDS: u32 = 20;
/// A round that lowers what is left by less ends the fit.
const GAIN: f64 = 0.01;
/// Of edges, relative to the mean weight of a point.
const STIFFNESS: f64 = 3e-4;
/// Of points' moves, likewise.
const REST: f64 = 1e-6;
/// Steps of conjugate gradients at most, and by how much they lower the residual.
const STEPS: usize = 500;
const ACCURACY: f64 = 1e-8;

/// What a fit came to. Heights are distances along the normal from the limit surface to the dense mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Fit {
    /// Rounds that were kept.
    pub rounds: u32,
    /// The root of the mean of the squared heights before, over the surface's area.
    pub rms_before: f64,
    /// And after.
    pub rms_after: f64,
    /// The largest height before.
    pub largest_before: f64,
    /// And after.
    pub largest_after: f64,
}

/// Moves the points of `mesh`, of which `cage` is the limit surface.
///
/// # Errors
/// If nothing is met, or if interrupted.
pub fn fit(
    mesh: &ControlMesh,
    cage: &Cage,
    dense: &Dense,
    options: &Options,
    run: Run<'_>,
) -> Result<(ControlMesh, Fit)> {
    let reach = options.reach(dense);
    let facing = match options.two_sided {
        true => Facing::Any,
        false => probe(cage, dense, reach, run)?.facing,
    };
    run.progress.stage("fit", u64::from(ROUNDS));
    let surface = LimitSurface::new(mesh);
    let rows = Rows::new(&surface, cage);
    let edges = edges(mesh);
    let mut best = mesh.clone();
    let (mut now, mut aim) = rows.aim(cage, dense, reach, facing, run)?;
    if now.met == 0 {
        return Err(dense.name(nothing_met(reach, now.faced_away)).into());
    }
    let mut fit = Fit {
        rms_before: now.rms,
        rms_after: now.rms,
        largest_before: now.largest,
        largest_after: now.largest,
        ..Fit::default()
    };
    for _ in 0..ROUNDS {
        let moves = rows.solve(&aim, &edges, mesh.point_count());
        let mut moved = best.clone();
        for (point, step) in moved.points[0].iter_mut().zip(moves) {
            *point = (point.as_dvec3() + step).as_vec3();
        }
        let is_usable = |p: &Vec3| p.is_finite() && p.abs().max_element() < 1e18;
        if !moved.points[0].iter().all(is_usable) {
            break;
        }
        let limit = cage.moved(&moved);
        let (next, next_aim) = rows.aim(&limit, dense, reach, facing, run)?;
        run.progress.by(1);
        // Fewer places that meet something would make less of what is left.
        if next.met < now.met || next.rms >= now.rms {
            break;
        }
        let gain = 1.0 - next.rms / now.rms;
        (best, now, aim) = (moved, next, next_aim);
        fit.rounds += 1;
        (fit.rms_after, fit.largest_after) = (now.rms, now.largest);
        if gain < GAIN {
            break;
        }
    }
    Ok((best, fit))
}

/// The edges of a mesh, as pairs of points.
fn edges(mesh: &ControlMesh) -> Vec<[usize; 2]> {
    let topology = mesh.topology();
    let ends = (0..topology.edge_count() as u32).map(|edge| topology.edge_vertices(edge));
    ends.map(|ends| ends.map(|v| v as usize)).collect()
}

/// Places on a limit surface as sums of the cage's points.
struct Rows {
    /// Ptex face and parameters.
    places: Vec<(u32, [f64; 2])>,
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

/// Where places are to go.
struct Aim {
    /// By place; zero where nothing is met.
    moves: Vec<DVec3>,
    /// Zero likewise.
    weights: Vec<f64>,
}

/// How far places are from the dense mesh.
#[derive(Default)]
struct Now {
    met: u64,
    faced_away: u64,
    rms: f64,
    largest: f64,
}

impl Rows {
    fn new(surface: &LimitSurface, cage: &Cage) -> Self {
        let all: Vec<[f64; 2]> = (0..PLACES * PLACES)
            .map(|i| middle(cage.kind(), [i % PLACES, i / PLACES], [PLACES; 2]))
            .collect();
        let faces: Vec<u32> = (0..cage.faces().len() as u32)
            .filter(|&ptex| !surface.is_hole(ptex))
            .collect();
        let rows: Vec<Vec<Vec<(u32, f64)>>> = faces
            .par_iter()
            .map(|&ptex| surface.weights(ptex, &all))
            .collect();
        let mut this = Self {
            places: Vec::new(),
            starts: vec![0],
            entries: Vec::new(),
        };
        for (ptex, rows) in faces.into_iter().zip(rows) {
            for (uv, row) in all.iter().zip(rows) {
                this.places.push((ptex, *uv));
                this.entries.extend(row);
                this.starts.push(this.entries.len());
            }
        }
        this
    }

    fn row(&self, place: usize) -> &[(u32, f64)] {
        &self.entries[self.starts[place]..self.starts[place + 1]]
    }

    /// Looks from all places of the limit surface as it is now.
    fn aim(
        &self,
        cage: &Cage,
        dense: &Dense,
        reach: f64,
        facing: Facing,
        run: Run<'_>,
    ) -> Result<(Now, Aim)> {
        let found: Vec<(Result<DVec3, bool>, f64)> = self
            .places
            .par_iter()
            .map(|&(ptex, uv)| {
                let line = cage.line(ptex, uv).filter(|_| run.goes_on());
                let Some(line) = line else {
                    return (Err(false), 0.0);
                };
                let hit = along_normal::closest(dense, &line, reach, facing);
                let area = cage.area(ptex, uv);
                (hit.map(|hit| hit.height * line.normal), area)
            })
            .collect();
        run.check()?;
        let mut now = Now::default();
        let (mut squares, mut area) = (0.0, 0.0);
        let mut aim = Aim {
            moves: Vec::with_capacity(found.len()),
            weights: Vec::with_capacity(found.len()),
        };
        for (hit, weight) in found {
            match hit {
                Ok(step) => {
                    now.met += 1;
                    now.largest = now.largest.max(step.length());
                    squares += weight * step.length_squared();
                    area += weight;
                    aim.moves.push(step);
                    aim.weights.push(weight);
                }
                Err(faced_away) => {
                    now.faced_away += u64::from(faced_away);
                    aim.moves.push(DVec3::ZERO);
                    aim.weights.push(0.0);
                }
            }
        }
        now.rms = if area > 0.0 {
            (squares / area).sqrt()
        } else {
            0.0
        };
        Ok((now, aim))
    }

    /// The moves of `points` points.
    fn solve(&self, aim: &Aim, edges: &[[usize; 2]], points: usize) -> Vec<DVec3> {
        let mut diagonal = vec![0.0; points];
        let mut right = vec![DVec3::ZERO; points];
        for (place, (step, weight)) in aim.moves.iter().zip(&aim.weights).enumerate() {
            for &(point, w) in self.row(place) {
                diagonal[point as usize] += weight * w * w;
                right[point as usize] += weight * w * *step;
            }
        }
        let mean = diagonal.iter().sum::<f64>() / points.max(1) as f64;
        let (stiffness, rest) = (STIFFNESS * mean, REST * mean);
        for point in edges.iter().flatten() {
            diagonal[*point] += stiffness;
        }
        diagonal.iter_mut().for_each(|d| *d += rest);
        let times = |x: &[DVec3]| {
            let mut out: Vec<DVec3> = x.iter().map(|x| rest * *x).collect();
            for (place, weight) in aim.weights.iter().enumerate() {
                let row = self.row(place);
                let sum: DVec3 = row.iter().map(|&(point, w)| w * x[point as usize]).sum();
                for &(point, w) in row {
                    out[point as usize] += weight * w * sum;
                }
            }
            for &[a, b] in edges {
                let pull = stiffness * (x[a] - x[b]);
                out[a] += pull;
                out[b] -= pull;
            }
            out
        };
        conjugate_gradients(times, &diagonal, right)
    }
}

/// Solves a symmetric positive definite system in three right-hand sides at once, preconditioned by its diagonal
/// (Hestenes and Stiefel, *Methods of Conjugate Gradients for Solving Linear Systems*, 1952).
fn conjugate_gradients(
    times: impl Fn(&[DVec3]) -> Vec<DVec3>,
    diagonal: &[f64],
    right: Vec<DVec3>,
) -> Vec<DVec3> {
    // Of each coordinate.
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| *a * *b).sum::<DVec3>();
    let scaled = |r: &[DVec3]| -> Vec<DVec3> {
        let scaled = r.iter().zip(diagonal);
        scaled
            .map(|(r, d)| if *d > 0.0 { *r / *d } else { *r })
            .collect()
    };
    let ratio = |a: DVec3, b: DVec3| {
        DVec3::from([0, 1, 2].map(|i| if b[i] > 0.0 { a[i] / b[i] } else { 0.0 }))
    };
    let mut x = vec![DVec3::ZERO; right.len()];
    let mut left = right;
    let mut z = scaled(&left);
    let mut direction = z.clone();
    let mut size = dot(&left, &z);
    let enough = ACCURACY * ACCURACY * size;
    for _ in 0..STEPS {
        if size.cmple(enough).all() {
            break;
        }
        let image = times(&direction);
        let along = ratio(size, dot(&direction, &image));
        for i in 0..x.len() {
            x[i] += along * direction[i];
            left[i] -= along * image[i];
        }
        z = scaled(&left);
        let next = dot(&left, &z);
        let kept = ratio(next, size);
        for (direction, z) in direction.iter_mut().zip(&z) {
            *direction = *z + kept * *direction;
        }
        size = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_of_known_answer_is_solved() {
        let times = |x: &[DVec3]| {
            let n = x.len();
            let mut out: Vec<DVec3> = (0..n).map(|i| (2.5 + i as f64) * x[i]).collect();
            for i in 1..n {
                out[i] -= x[i - 1];
                out[i - 1] -= x[i];
            }
            out
        };
        let wanted: Vec<DVec3> = (0..20)
            .map(|i| DVec3::new(f64::from(i), 1.0, f64::from(i * i % 7)))
            .collect();
        let diagonal: Vec<f64> = (0..20).map(|i| 2.5 + f64::from(i)).collect();
        let found = conjugate_gradients(times, &diagonal, times(&wanted));
        for (found, wanted) in found.iter().zip(&wanted) {
            assert!(found.distance(*wanted) < 1e-6, "{found} {wanted}");
        }
    }
}
