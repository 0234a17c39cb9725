//! How many quads a face needs, and how far they are from it.

use super::{Own, Shell, ShellError, normal};
use crate::math::{Vec2, Vec3};
use crate::surface::base::{LimitGrid, TexcoordGrid};
use crate::surface::dice::FaceGrid;
use crate::surface::evaluate::Surface;

/// The most quads along a face's side.
const MOST: u32 = 64;

/// How much it counts that a quad's parameters shift the displacement along the surface.
const SHIFT: f32 = 0.125;

/// Points along a face's side, at least, at which quads are held against the surface: it may be bent both ways.
const PROBES: usize = 8;

/// What is asked for, in units of the surface's points.
pub(super) struct Asked {
    pub(super) distance: f32,
    pub(super) angle: f32,
    pub(super) heights: [f32; 2],
}

/// A point of a surface.
#[derive(Clone, Copy)]
struct At {
    position: Vec3,
    normal: Vec3,
}

/// How far a point of a quad is from the limit surface's of the same parameters.
struct Off {
    distance: f32,
    displaced: f32,
    shift: f32,
    angle: f32,
    lengthened: f32,
}

impl Off {
    fn new(quad: At, exact: At, heights: [f32; 2]) -> Self {
        let off = quad.position - exact.position;
        let turned = quad.normal - exact.normal;
        let known = quad.normal != Vec3::ZERO && exact.normal != Vec3::ZERO;
        let across = |height: f32| {
            let off = if known { off + height * turned } else { off };
            off.dot(exact.normal).abs()
        };
        let distance = across(0.0);
        Self {
            distance,
            displaced: heights.map(across).into_iter().fold(distance, f32::max),
            shift: (off.length_squared() - distance * distance).max(0.0).sqrt(),
            angle: if known {
                quad.normal.angle_between(exact.normal)
            } else {
                0.0
            },
            lengthened: if known {
                let highest = heights.map(f32::abs).into_iter().fold(0.0, f32::max);
                highest * (1.0 - quad.normal.length()).abs()
            } else {
                0.0
            },
        }
    }

    /// In parts of what is asked for.
    fn part(&self, asked: &Asked) -> f32 {
        self.displaced.max(SHIFT * self.shift) / asked.distance
    }
}

/// Twice as many quads along those of u and v that are off by more than asked for, in parts of that: on lines along u, along
/// v, and between. No more than `most`.
fn finer(quads: [u32; 2], most: [u32; 2], [u, v, between]: [f32; 3]) -> [u32; 2] {
    let most = most.map(|most| most.clamp(1, MOST));
    let more = [u > 1.0, v > 1.0];
    let more = if more == [false; 2] && between > 1.0 {
        [u >= v, v >= u]
    } else {
        more
    };
    [0, 1].map(|k| {
        if more[k] {
            (2 * quads[k]).min(most[k])
        } else {
            quads[k]
        }
    })
}

/// Which of [`finer`]'s parts a point counts for, by whether it is within a quad along u and along v.
fn kind(within: [bool; 2]) -> usize {
    match within {
        [true, false] => 0,
        [false, true] => 1,
        _ => 2,
    }
}

/// Points of a face that tell how many quads it needs.
#[derive(Default)]
pub(super) struct Probe {
    limit: LimitGrid,
    normals: Vec<Vec3>,
    texcoords: TexcoordGrid,
}

impl Probe {
    /// How many quads a face needs along u and v: a power of two or three fourths of one, or `most`.
    pub(super) fn needs(
        &mut self,
        flat: &Surface,
        face: u32,
        most: [u32; 2],
        asked: &Asked,
    ) -> [u32; 2] {
        let mut quads = [1; 2];
        if flat.base().is_hole(face) {
            return quads;
        }
        loop {
            let off = self.off(flat, face, quads, asked);
            let more = finer(quads, most, off);
            if more == quads {
                if off.iter().all(|off| *off <= 1.0) {
                    break;
                }
                return quads;
            }
            quads = more;
        }
        for k in 0..2 {
            let mut fewer = quads;
            fewer[k] = (3 * quads[k]).div_ceil(4);
            let good = |off: f32| off <= 1.0;
            if quads[k] >= 4 && self.off(flat, face, fewer, asked).into_iter().all(good) {
                quads = fewer;
            }
        }
        quads
    }

    /// How far so many quads along u and v are off, at all motion keys.
    fn off(&mut self, flat: &Surface, face: u32, quads: [u32; 2], asked: &Asked) -> [f32; 3] {
        let base = flat.base();
        // Of each quad, and of all.
        let steps = quads.map(|n| (PROBES / n as usize).max(2));
        let all = [0, 1].map(|k| steps[k] * quads[k] as usize);
        let [us, vs] = all.map(|n| -> Vec<f32> { (0..=n).map(|i| i as f32 / n as f32).collect() });
        let mut most = [0.0_f32; 3];
        for key in 0..base.keys() {
            base.evaluate_grid(face, &us, &vs, key, &mut self.limit);
            self.normals.clear();
            self.normals.extend((0..self.limit.len()).map(|i| {
                let uv = Vec2::new(us[i % us.len()], vs[i / us.len()]);
                normal(flat, face, uv, key, self.limit.derivatives(i))
            }));
            if !(flat.has_texcoords()
                && base.texcoord_grid(face, &us, &vs, true, &mut self.texcoords))
            {
                self.texcoords.clear();
            }
            for (j, i) in (0..=all[1]).flat_map(|j| (0..=all[0]).map(move |i| (j, i))) {
                let within = [i % steps[0], j % steps[1]];
                if within == [0; 2] {
                    continue;
                }
                let first = [(i, 0), (j, 1)].map(|(at, k)| {
                    let quad = (at / steps[k]).min(quads[k] as usize - 1);
                    quad * steps[k]
                });
                let (off, turned) = self.off_at(us.len(), [i, j], first, steps, asked);
                let kind = &mut most[kind(within.map(|within| within > 0))];
                // Angles are those between a quad's sides.
                *kind = kind.max(off).max(turned);
            }
        }
        most
    }

    /// How far a quad is off at a point, and how far normals turn along the sides that the point is on, both in parts of
    /// what is asked for.
    fn off_at(
        &self,
        columns: usize,
        at: [usize; 2],
        first: [usize; 2],
        steps: [usize; 2],
        asked: &Asked,
    ) -> (f32, f32) {
        let number = |[i, j]: [usize; 2]| j * columns + i;
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]]
            .map(|[i, j]| number([first[0] + i * steps[0], first[1] + j * steps[1]]));
        let [u, v] = [0, 1].map(|k| (at[k] - first[k]) as f32 / steps[k] as f32);
        let mix = |[a, b, c, d]: [Vec3; 4]| a.lerp(b, u).lerp(c.lerp(d, u), v);
        let here = number(at);
        let positions = corners.map(|c| self.limit.position(c));
        let quad = At {
            position: mix(positions),
            normal: mix(corners.map(|c| self.normals[c])),
        };
        let exact = At {
            position: self.limit.position(here),
            normal: self.normals[here],
        };
        let mut off = Off::new(quad, exact, asked.heights);
        if let [_, ..] = self.texcoords.st[..] {
            // As long as it is on the surface.
            let st = corners.map(|c| self.texcoords.st[c]);
            let [a, b, c, d] = st;
            let shift = self.texcoords.st[here].distance(a.lerp(b, u).lerp(c.lerp(d, u), v));
            let (along, length) = (a.distance(d), positions[0].distance(positions[3]));
            if along > 0.0 {
                off.shift = off.shift.max(shift * length / along);
            }
        }
        let turned = |from: usize, to: usize| {
            self.normals[corners[from]].angle_between(self.normals[corners[to]])
        };
        let turned = match [at[0] > first[0], at[1] > first[1]] {
            [true, false] => turned(0, 1),
            [false, true] => turned(0, 2),
            _ => 0.0,
        };
        (off.part(asked), turned / asked.angle)
    }
}

/// How far the quads of a face are from it: in their middles, and in those of their sides.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) error: ShellError,
    /// Of what is displaced, and of what unit normals would change.
    pub(super) squares: [f64; 2],
}

impl Measured {
    pub(super) fn new(flat: &Surface, grid: &FaceGrid, own: &[Own], asked: &Asked) -> Self {
        let mut all = Self::default();
        let [nu, nv] = grid.size;
        let first = grid.first_vertex as usize;
        for (i, j) in (0..nv).flat_map(|j| (0..nu).map(move |i| (i, j))) {
            let corners = Shell::corners(grid, i, j);
            let beyond = [i + 1 == nu, j + 1 == nv];
            let places = [
                Some([0.5, 0.5]),
                Some([0.5, 0.0]),
                Some([0.0, 0.5]),
                beyond[1].then_some([0.5, 1.0]),
                beyond[0].then_some([1.0, 0.5]),
            ];
            for uv in places.into_iter().flatten().map(Vec2::from) {
                let at = Shell::face_uv(grid, i, j, uv);
                for key in 0..flat.base().keys() {
                    let limit = flat.base().first_order(grid.face, at, key);
                    let mix = |[a, b, c, d]: [Vec3; 4]| a.lerp(b, uv.x).lerp(c.lerp(d, uv.x), uv.y);
                    let quad = At {
                        position: mix(corners.map(|c| own[c - first].points[key as usize].position)),
                        normal: mix(corners.map(|c| own[c - first].points[key as usize].normal)),
                    };
                    let exact = At {
                        position: limit.position,
                        normal: normal(flat, grid.face, at, key, [limit.du, limit.dv]),
                    };
                    all.include(&Off::new(quad, exact, asked.heights));
                }
            }
        }
        all
    }

    fn include(&mut self, off: &Off) {
        let error = &mut self.error;
        error.distance = error.distance.max(off.distance);
        error.displaced = error.displaced.max(off.displaced);
        error.shift = error.shift.max(off.shift);
        error.angle = error.angle.max(off.angle);
        error.lengthened = error.lengthened.max(off.lengthened);
        error.places += 1;
        self.squares[0] += f64::from(off.displaced).powi(2);
        self.squares[1] += f64::from(off.lengthened).powi(2);
    }

    /// Takes in those of another face.
    pub(super) fn add(&mut self, other: &Self) {
        let (error, of) = (&mut self.error, &other.error);
        error.distance = error.distance.max(of.distance);
        error.displaced = error.displaced.max(of.displaced);
        error.shift = error.shift.max(of.shift);
        error.angle = error.angle.max(of.angle);
        error.lengthened = error.lengthened.max(of.lengthened);
        error.places += of.places;
        for (squares, more) in self.squares.iter_mut().zip(other.squares) {
            *squares += more;
        }
    }
}
