//! Where the line over a micro-vertex meets the displaced surface.
//!
//! That is not at the micro-vertex's own parameters: a quad's triangles lack the bends of the limit surface's parametrisation,
//! and its normals those in between. The place is found by Newton's steps; where it is beyond the face's edge, on the face
//! there. On edges all faces ask the same sides in the same order, and so get the same bits.
//!
//! How far parameters are shifted is smooth. What is kept of it are the middles of a quad's sides and of its diagonal, which
//! make a quadratic over each of its triangles.

use rayon::prelude::*;

use super::sheets::{Corner, Sheets};
use super::weights;
use crate::accel::prism::Corners;
use crate::math::{DVec2, DVec3};
use crate::surface::{EdgeUse, Surface, edge_uv};

/// How far parameters are shifted in the middles of a quad's sides and of its diagonal, in 65536ths of the quad: of a and b, of
/// a and c, of b and c, of b and d, of c and d.
pub(super) type Shifts = [[i16; 2]; 5];

/// The middles of [`Shifts`] in the quad.
const MIDDLES: [[f64; 2]; 5] = [[0.5, 0.0], [0.0, 0.5], [0.5, 0.5], [1.0, 0.5], [0.5, 1.0]];

const UNIT: f64 = 1.0 / 65536.0;

/// How near the place of a line is found, in micro-edges.
pub(super) const NEAR: f64 = 0.05;

/// How far it may be from where it was looked for, in micro-edges: what is farther is another part of the surface.
const FARTHEST: f64 = 16.0;

/// How far parameters may be from their quadratics, in diagonals of the object, before faces are cut into more quads; and
/// how many of the quads that are looked at may be farther off.
const MOST_MISSED: f64 = 5e-5;
const MISSED: f64 = 0.01;

/// Quads that are looked at, about, and where.
const MOST_PROBED: usize = 2000;
const PROBES: [[f64; 2]; 6] = [
    [0.25, 0.0],
    [0.0, 0.75],
    [0.3, 0.3],
    [0.7, 0.7],
    [1.0, 0.25],
    [0.75, 1.0],
];

/// The most of Newton's steps.
const STEPS: usize = 6;

/// A place by parameters, rounded as they are kept.
fn rounded(shift: DVec2) -> [i16; 2] {
    // Beyond half a quad it is the nearest that there is.
    (shift / UNIT).round().to_array().map(|x| x as i16)
}

/// The shift at x and y of a quad, whose weights of the corners are given, in quads.
#[inline(always)]
pub(super) fn shift(shifts: &Shifts, weights: [f64; 4]) -> [f64; 2] {
    let [a, b, c, d] = weights;
    let shares = [a * b, a * c, b * c, b * d, c * d];
    let mut sum = [0.0; 2];
    for k in 0..5 {
        sum[0] += shares[k] * f64::from(shifts[k][0]);
        sum[1] += shares[k] * f64::from(shifts[k][1]);
    }
    [4.0 * UNIT * sum[0], 4.0 * UNIT * sum[1]]
}

/// A point of the displaced surface that a line passes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub(super) point: DVec3,
    pub(super) normal: DVec3,
    /// Its parameters, by those of the face that was asked, beyond 0..1 where it is beyond the edge.
    pub(super) uv: DVec2,
}

enum Way {
    Inside(Found),
    /// At these parameters it would be.
    Outside(DVec2),
    Lost,
}

/// The sides of edges, those of holes left out.
pub(super) struct Lines<'a> {
    sheets: &'a Sheets<'a>,
    /// By edge: faces, which of their edges it is, and whether it is reversed there.
    edges: Vec<Vec<(u32, u32, bool)>>,
}

impl<'a> Lines<'a> {
    pub(super) fn new(sheets: &'a Sheets<'a>) -> Self {
        let base = sheets.base.plain.base();
        let mut edges: Vec<Vec<(u32, u32, bool)>> = Vec::new();
        for face in (0..base.faces()).filter(|&face| !base.is_hole(face)) {
            for k in 0..4 {
                let EdgeUse { edge, reversed } = base.edge(face, k);
                if edges.len() <= edge as usize {
                    edges.resize(edge as usize + 1, Vec::new());
                }
                edges[edge as usize].push((face, k, reversed));
            }
        }
        Self { sheets, edges }
    }

    /// How many edges there may be.
    pub(super) fn edges(&self) -> u32 {
        self.edges.len() as u32
    }

    /// The side of an edge that its heights are asked of: face, which of its edges, and whether it is reversed there.
    pub(super) fn side(&self, edge: u32) -> Option<(u32, u32, bool)> {
        self.edges[edge as usize].first().copied()
    }

    /// The shifts of a quad whose first corner is `at`, in quads of which a face has so many along each edge, where displacement
    /// is `height` all over.
    pub(super) fn shifts(
        &self,
        (face, key): (u32, u32),
        corners: &[Corner; 4],
        (at, cuts): (DVec2, f64),
        height: f64,
    ) -> Shifts {
        MIDDLES.map(|[x, y]| {
            let line = Corner::within(corners, x, y);
            let at = (at + DVec2::new(x, y)) / cuts;
            rounded(cuts * self.shift(face, key, &line, at, height))
        })
    }

    /// Whether parameters would be shifted by much else than a quadratic over each triangle, were faces cut into so many quads
    /// along each edge, whose corners are given.
    pub(super) fn bend(&self, cuts: u32, corners: &[Corners]) -> bool {
        let base = self.sheets.base.plain.base();
        let faces: Vec<u32> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .collect();
        let row = cuts as usize + 1;
        let side = cuts as usize;
        let quads = faces.len() * side * side;
        let every = quads.div_ceil(MOST_PROBED).max(1);
        let most = MOST_MISSED * f64::from(self.sheets.base.far);
        let missed = |number: usize, key: usize| {
            let (face, quad) = (number / (side * side), number % (side * side));
            let (i, j) = (quad % side, quad / side);
            let first = face * row * row + j * row + i;
            let corners = [0, 1, row, row + 1].map(|next| Corner::of(&corners[key][first + next]));
            let (at, cuts) = (DVec2::new(i as f64, j as f64), f64::from(cuts));
            let (face, key) = (faces[face], key as u32);
            let shifts = self.shifts((face, key), &corners, (at, cuts), 0.0);
            let [a, b, c, _] = &corners;
            let long = DVec2::new(a.p.distance(b.p), a.p.distance(c.p));
            PROBES.iter().any(|&[x, y]| {
                let line = Corner::within(&corners, x, y);
                let place = (at + DVec2::new(x, y)) / cuts;
                let by = cuts * self.shift(face, key, &line, place, 0.0);
                ((by - DVec2::from(shift(&shifts, weights([x, y])))) * long).length() > most
            })
        };
        let is_whole = |number: usize| {
            let face = faces[number / (side * side)];
            (0..4).all(|k| !base.is_collapsed(face, k))
        };
        let numbers: Vec<usize> = (0..quads).step_by(every).filter(|&n| is_whole(n)).collect();
        let count = |&number: &usize| (0..corners.len()).any(|key| missed(number, key));
        let missed = numbers.par_iter().filter(|number| count(number)).count();
        missed as f64 > MISSED * numbers.len() as f64
    }

    /// Where a line meets the displaced surface; `start` is near, `step` a micro-edge in parameters.
    pub(super) fn meet(
        &self,
        face: u32,
        key: u32,
        line: &Corner,
        start: DVec2,
        step: DVec2,
    ) -> Option<Found> {
        let surface = self.sheets.displaced;
        match met(surface, face, key, line, start, step) {
            Way::Inside(found) => Some(found),
            Way::Lost => None,
            Way::Outside(uv) => {
                let beyond = [-uv.y, uv.x - 1.0, uv.y - 1.0, -uv.x];
                let k = (0..4).fold(0, |a, b| if beyond[b] > beyond[a] { b } else { a });
                let along = [uv.x, uv.y, 1.0 - uv.x, 1.0 - uv.y][k];
                let used = surface.base().edge(face, k as u32);
                let [a, b] = self.edges[used.edge as usize].as_slice() else {
                    return None;
                };
                let (other, k, reversed) = if (a.0, a.1) == (face, k as u32) {
                    *b
                } else {
                    *a
                };
                let along = if reversed == used.reversed {
                    along
                } else {
                    1.0 - along
                };
                match met(surface, other, key, line, on_edge(k, along), step) {
                    Way::Inside(found) => Some(Found { uv, ..found }),
                    _ => None,
                }
            }
        }
    }

    /// The same for a line over an edge, `along` it in its own direction.
    pub(super) fn meet_on_edge(
        &self,
        edge: u32,
        key: u32,
        line: &Corner,
        along: f64,
        step: f64,
    ) -> Option<Found> {
        self.edges[edge as usize]
            .iter()
            .find_map(|&(face, k, reversed)| {
                let along = if reversed { 1.0 - along } else { along };
                let start = on_edge(k, along);
                match met(
                    self.sheets.displaced,
                    face,
                    key,
                    line,
                    start,
                    DVec2::splat(step),
                ) {
                    Way::Inside(found) => Some(found),
                    _ => None,
                }
            })
    }

    /// How far the parameters of lines are shifted where displacement is `height` all over, in faces.
    fn shift(&self, face: u32, key: u32, line: &Corner, at: DVec2, height: f64) -> DVec2 {
        let mut uv = at;
        for _ in 0..3 {
            let within = uv.clamp(DVec2::ZERO, DVec2::ONE);
            let here = self.sheets.base.plain.evaluate(face, within.as_vec2(), key);
            let point = here.position.as_dvec3() + height * here.normal.as_dvec3();
            match newton(point, [here.du, here.dv].map(|d| d.as_dvec3()), line) {
                Some(by) => uv = within + by,
                None => return DVec2::ZERO,
            }
        }
        uv - at
    }
}

fn on_edge(k: u32, along: f64) -> DVec2 {
    edge_uv(k, along as f32).as_dvec2()
}

/// The step of parameters from a point with these derivatives to where a line is.
fn newton(point: DVec3, [du, dv]: [DVec3; 2], line: &Corner) -> Option<DVec2> {
    let (off, n) = (point - line.p, line.n);
    let area = du.cross(dv).dot(n);
    let by = -DVec2::new(off.cross(dv).dot(n), du.cross(off).dot(n)) / area;
    by.is_finite().then_some(by)
}

fn met(surface: &Surface, face: u32, key: u32, line: &Corner, start: DVec2, step: DVec2) -> Way {
    let mut uv = start;
    let mut was_beyond = false;
    let limits = |uv: DVec2| uv.clamp(DVec2::ZERO, DVec2::ONE);
    for _ in 0..STEPS {
        let within = limits(uv);
        let here = surface.evaluate(face, within.as_vec2(), key);
        let point = here.position.as_dvec3();
        let [du, dv] = [here.limit.du, here.limit.dv].map(|d| d.as_dvec3());
        let Some(by) = newton(point, [du, dv], line) else {
            return Way::Lost;
        };
        uv = within + by;
        if by.abs().cmple(NEAR * step).all() {
            let normal = du.cross(dv);
            return Way::Inside(Found { point, normal, uv });
        }
        if (uv - start).abs().cmpgt(FARTHEST * step).any() {
            return Way::Lost;
        }
        let is_beyond = limits(uv) != uv;
        if is_beyond && was_beyond {
            return Way::Outside(uv);
        }
        was_beyond = is_beyond;
    }
    Way::Lost
}
