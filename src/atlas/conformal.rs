//! Least squares conformal maps, after Lévy, Petitjean, Ray and Maillot: "Least Squares Conformal Maps for Automatic
//! Texture Atlas Generation" (SIGGRAPH 2002), section 2.
//!
//! A map of a triangle's plane to another one is conformal where it fulfils the Cauchy-Riemann equations. For a triangle
//! with corners z1, z2, z3 in its own plane, mapped to U1, U2, U3, all of them complex numbers, they say that
//! (z3 - z2) U1 + (z1 - z3) U2 + (z2 - z1) U3 = 0. The squares of what these sums are, each over twice the triangle's
//! area, are least for the map that is taken; two nodes stay where they are put, which fixes turn, size and place.
//! The two are far from each other on the border, at the distance that they have in space.
//!
//! The normal equations are Hermitian and solved by conjugate gradients, begun with the chart's projection to a plane.
//! Departures from the paper: polygons count too, quads by the four triangles of both their diagonals at half the
//! weight; and unknowns are complex, which halves the system.

use super::cage::{Cage, conj};
use super::chart::Disk;
use crate::math::{DVec2, DVec3};

/// The residual is brought down to this part of the right side.
const TOLERANCE: f64 = 1e-12;

/// Where the nodes of a chart go in the plane; none if nothing comes of it.
pub(super) fn flatten(cage: &Cage, disk: &Disk) -> Option<Vec<DVec2>> {
    let point = |node: u32| cage.points[disk.vertices[node as usize] as usize];
    let pins = far_apart(disk, point)?;
    let distance = point(pins[0]).distance(point(pins[1]));
    let mut places = projected(cage, disk, pins.map(point));
    places[pins[0] as usize] = DVec2::ZERO;
    places[pins[1] as usize] = DVec2::new(distance, 0.0);
    let free: Vec<bool> = (0..places.len() as u32)
        .map(|n| !pins.contains(&n))
        .collect();
    Normal::new(cage, disk).solve(&free, &mut places);
    places.iter().all(|p| p.is_finite()).then_some(places)
}

/// Two nodes of the border that are far from each other.
fn far_apart(disk: &Disk, point: impl Fn(u32) -> DVec3) -> Option<[u32; 2]> {
    let farthest = |from: u32| {
        let mut found = (0.0, from);
        for &node in &disk.border {
            let distance = point(node).distance_squared(point(from));
            if distance > found.0 {
                found = (distance, node);
            }
        }
        found.1
    };
    let mut pair = [disk.border[0]; 2];
    for _ in 0..3 {
        pair = [pair[1], farthest(pair[1])];
    }
    (pair[0] != pair[1]).then(|| [pair[0].min(pair[1]), pair[0].max(pair[1])])
}

/// The nodes in the plane across the mean normal, the pins along x.
fn projected(cage: &Cage, disk: &Disk, [from, to]: [DVec3; 2]) -> Vec<DVec2> {
    let normal: DVec3 = (disk.faces.iter())
        .map(|&face| cage.area(face) * cage.normals[face as usize])
        .sum();
    let x = (to - from).normalize();
    let y = normal
        .cross(x)
        .try_normalize()
        .unwrap_or_else(|| x.any_orthonormal_vector());
    let vertices = disk.vertices.iter();
    vertices
        .map(|&v| {
            let p = cage.points[v as usize] - from;
            DVec2::new(p.dot(x), p.dot(y))
        })
        .collect()
}

/// The matrix of the normal equations, row by row.
struct Normal {
    starts: Vec<usize>,
    entries: Vec<(u32, DVec2)>,
}

impl Normal {
    fn new(cage: &Cage, disk: &Disk) -> Self {
        let mut all: Vec<(u32, u32, DVec2)> = Vec::new();
        for (face, nodes) in disk.face_nodes() {
            for triangle in cage.triangles(face).iter().filter(|t| t.weight > 0.0) {
                let [a, b, c] = triangle.flat;
                let sides = [c - b, a - c, b - a];
                let scale = 0.5 * triangle.weight / triangle.area();
                for (&i, &w) in triangle.corners.iter().zip(&sides) {
                    for (&j, &v) in triangle.corners.iter().zip(&sides) {
                        let (i, j) = (nodes[i as usize], nodes[j as usize]);
                        all.push((i, j, scale * conj(w).rotate(v)));
                    }
                }
            }
        }
        // Stable: sums are taken in one order.
        all.sort_by_key(|&(i, j, _)| (i, j));
        let mut starts = vec![0];
        let mut entries: Vec<(u32, DVec2)> = Vec::new();
        for entry in all.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (row, column, _) = entry[0];
            while starts.len() <= row as usize {
                starts.push(entries.len());
            }
            entries.push((column, entry.iter().map(|e| e.2).sum()));
        }
        starts.resize(disk.vertices.len() + 1, entries.len());
        Self { starts, entries }
    }

    fn row(&self, row: usize) -> &[(u32, DVec2)] {
        &self.entries[self.starts[row]..self.starts[row + 1]]
    }

    fn times(&self, x: &[DVec2], free: &[bool], out: &mut [DVec2]) {
        for (row, out) in out.iter_mut().enumerate() {
            *out = match free[row] {
                true => {
                    let entries = self.row(row).iter();
                    entries.map(|&(j, a)| a.rotate(x[j as usize])).sum()
                }
                false => DVec2::ZERO,
            };
        }
    }

    /// Moves the free places by conjugate gradients, each unknown in units of its own diagonal.
    fn solve(&self, free: &[bool], places: &mut [DVec2]) {
        let n = places.len();
        let diagonal: Vec<f64> = (0..n)
            .map(|row| {
                let own = self.row(row).iter().find(|e| e.0 as usize == row);
                own.map_or(1.0, |e| e.1.x).max(f64::MIN_POSITIVE)
            })
            .collect();
        let dot = |a: &[DVec2], b: &[DVec2]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let mut image = vec![DVec2::ZERO; n];
        // What the pins alone ask for: the size of the right side.
        let pinned: Vec<DVec2> = (places.iter().zip(free))
            .map(|(&p, &free)| if free { DVec2::ZERO } else { p })
            .collect();
        self.times(&pinned, free, &mut image);
        let goal = TOLERANCE
            * TOLERANCE
            * image
                .iter()
                .zip(&diagonal)
                .map(|(r, d)| r.length_squared() / d)
                .sum::<f64>();
        self.times(places, free, &mut image);
        let mut rest: Vec<DVec2> = image.iter().map(|&r| -r).collect();
        let scaled = |rest: &[DVec2]| -> Vec<DVec2> {
            rest.iter().zip(&diagonal).map(|(&r, &d)| r / d).collect()
        };
        let mut toward = scaled(&rest);
        let mut size = dot(&rest, &toward);
        for _ in 0..10 * n + 100 {
            if size.is_nan() || size <= goal {
                break;
            }
            self.times(&toward, free, &mut image);
            let step = size / dot(&toward, &image);
            for i in 0..n {
                places[i] += step * toward[i];
                rest[i] -= step * image[i];
            }
            let next = scaled(&rest);
            let larger = dot(&rest, &next);
            let keep = larger / size;
            size = larger;
            for (toward, next) in toward.iter_mut().zip(next) {
                *toward = next + keep * *toward;
            }
        }
    }
}
