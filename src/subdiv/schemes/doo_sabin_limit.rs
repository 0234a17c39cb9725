//! The limit surface of Doo and Sabin's scheme: position and first derivatives anywhere, without refining it all.
//!
//! After one step of `doo_sabin` each point inside has four faces. Its *patch* reaches to their middles, and
//! a step divides it into the patches of its four children:
//!
//! ```text
//!    v   f3    :    f2         3 x 3 points around p if all four faces have four corners: a biquadratic
//!    ^ .... 3 --- 2 ....       B-spline over the unit square. If f0 has n corners, only the quadrant next to
//!    |      |  p  |            corner 0 is not regular, and within it again only its quadrant next to corner 0.
//!      .... 0 --- 1 ....       Patch c of a control mesh is that of its corner c: corner 0 is next to the
//!        f0    :    f1  > u    control vertex, corner 2 in the middle of the face, u along the edge that leaves.
//! ```
//!
//! Corner 0 itself is the mean of f0's points, in every step. Around it the step is diagonal in the polygon's
//! harmonics: the first shrinks by 1/2, the rest by 1/4. So positions are kept relative to the mean and doubled in
//! each step, which loses no digits however deep (u, v) lies, and converges to the first harmonic alone. From the
//! eigenvector (points of the next ring are three times as far as the middles of the polygon's edges) the derivatives
//! at the corner are sums of two neighbours' first harmonics, and the normal is the normal of that harmonic's ellipse.
//!
//! A border point's patch is a strip: v runs from the border, 0, to the middle of the faces, 1, and the surface is
//! linear in v where the faces have four corners. A corner that stays has a bilinear quarter.

use std::f64::consts::TAU;

use super::classic::{self, Refined, SchemeKind};
use super::doo_sabin::{Fan, fans, weight};
use crate::error::Fault;
use crate::math::DVec3;
use crate::mesh::{BoundaryInterpolation, ControlMesh, Topology};

/// A place of the limit surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Where it is.
    pub position: DVec3,
    /// Derivative along u. At the middle of a face with other than four corners the one-sided derivatives of the
    /// patch: those of other patches there differ.
    pub du: DVec3,
    /// Derivative along v.
    pub dv: DVec3,
    /// Unit normal towards the front; none where the surface has no tangent plane.
    pub normal: Option<DVec3>,
}

/// The limit surface of a control mesh, patch by patch.
#[derive(Debug)]
pub struct DooSabinSurface {
    refined: Refined,
    pub(super) topology: Topology,
    pub(super) patches: Vec<Fan>,
}

impl DooSabinSurface {
    /// The surface of any control mesh.
    ///
    /// Refines once; twice if a vertex inside has two faces, for then one step does not give every point four.
    ///
    /// # Errors
    /// Those of [`classic::refine`].
    pub fn new(mesh: &ControlMesh) -> Result<Self, Fault> {
        let mut level = 1;
        loop {
            let refined = classic::refine(mesh, SchemeKind::DooSabin, level)?;
            let topology = refined.mesh.topology();
            let patches = fans(&topology);
            let is_plain = |f: &Fan| !f.closed || f.corners.len() == 4;
            if patches.iter().all(is_plain) {
                return Ok(Self {
                    refined,
                    topology,
                    patches,
                });
            }
            level += 1;
        }
    }

    /// The refined mesh whose points, with the faces around them, are the patches.
    pub fn cage(&self) -> &Refined {
        &self.refined
    }

    /// How many patches there are: one for each point of the cage that has faces; more for one where fans of faces
    /// touch. In a plain mesh, patch i is that of point i.
    pub fn patch_count(&self) -> usize {
        self.patches.len()
    }

    /// The point of the cage in whose middle a patch lies.
    pub fn patch_point(&self, patch: usize) -> u32 {
        self.topology.vertex(self.patches[patch].corners[0])
    }

    /// The surface at motion key `key`, for (u, v) in the unit square. None where there is no surface: at a border
    /// that is left to shrink.
    ///
    /// # Panics
    /// If there is no such key or patch.
    pub fn evaluate(&self, key: usize, patch: usize, u: f64, v: f64) -> Option<Sample> {
        let mesh = &self.refined.mesh;
        let fan = &self.patches[patch];
        let face = |i: usize| self.polygon(key, fan.corners[i]);
        let sample = match (fan.closed, fan.corners.len()) {
            // Faces of vertices follow all others.
            (true, 4) => {
                let around = (0..4).max_by_key(|&i| self.topology.face(fan.corners[i]))?;
                inner([0, 1, 2, 3].map(|i| face((around + i) % 4)), u, v)
            }
            (false, _) if mesh.boundary == BoundaryInterpolation::None => return None,
            (false, 2) => strip([face(0), face(1)], u, v),
            (false, 1) => quarter(&face(0), u, v),
            _ => return None,
        };
        Some(match mesh.left_handed {
            true => Sample {
                normal: sample.normal.map(|n| -n),
                ..sample
            },
            false => sample,
        })
    }

    /// The surface in the middle of a patch, or of its side or at its corner if the patch's point is on a border.
    /// None where there is no surface.
    ///
    /// # Panics
    /// If there is no such key or patch.
    pub fn middle(&self, key: usize, patch: usize) -> Option<Sample> {
        let fan = &self.patches[patch];
        let [u, v] = match (fan.closed, fan.corners.len()) {
            (true, _) => [0.5, 0.5],
            (false, 1) => [0.0, 0.0],
            (false, _) => [0.5, 0.0],
        };
        self.evaluate(key, patch, u, v)
    }

    /// The points of a corner's face from that corner on.
    fn polygon(&self, key: usize, corner: u32) -> Vec<DVec3> {
        let points = &self.refined.mesh.points[key];
        let mut at = corner;
        let mut polygon = Vec::with_capacity(4);
        loop {
            polygon.push(points[self.topology.vertex(at) as usize].as_dvec3());
            at = self.topology.next(at);
            if at == corner {
                return polygon;
            }
        }
    }
}

impl Sample {
    fn new(position: DVec3, du: DVec3, dv: DVec3) -> Self {
        Self {
            position,
            du,
            dv,
            normal: du.cross(dv).try_normalize(),
        }
    }
}

/// Rows of three points, v upwards.
type Net = [[DVec3; 3]; 3];

/// A polygon's points as seen from the patch's middle: that first, then counterclockwise.
type Polygon = Vec<DVec3>;

/// The patch of a point inside, from its four faces counterclockwise.
fn inner(mut faces: [Polygon; 4], u: f64, v: f64) -> Sample {
    if faces.iter().all(|f| f.len() == 4) {
        return regular(&net(&faces), u, v);
    }
    // Turn the quadrant with (u, v) to the lower left, clockwise by quarters.
    let quarters = match (u >= 0.5, v >= 0.5) {
        (false, false) => 0,
        (true, false) => 1,
        (true, true) => 2,
        (false, true) => 3,
    };
    faces.rotate_left(quarters);
    let (mut s, mut t) = (u, v);
    for _ in 0..quarters {
        (s, t) = (t, 1.0 - s);
    }
    let mut sample = lower_left(faces, s, t);
    for _ in 0..quarters {
        (sample.du, sample.dv) = (-sample.dv, sample.du);
    }
    sample
}

/// The same for s, t up to 1/2.
fn lower_left(faces: [Polygon; 4], s: f64, t: f64) -> Sample {
    let n = faces[0].len();
    let mean = faces[0].iter().sum::<DVec3>() / n as f64;
    if s <= 0.0 && t <= 0.0 && n != 4 {
        return centre(&faces[0], mean);
    }
    // The first step is by polygons, for the face opposite may have any number of corners too.
    let relative =
        |face: Polygon| -> Polygon { face.into_iter().map(|p| 2.0 * (p - mean)).collect() };
    let [ring, right, opposite, above] = faces.map(relative);
    let mut points = [[DVec3::ZERO; 3]; 3];
    points[0][2] = mask(&right, 1);
    points[1][2] = mask(&right, 0);
    points[2][0] = mask(&above, above.len() - 1);
    points[2][1] = mask(&above, 0);
    points[2][2] = mask(&opposite, 0);
    let mut ring = shrink(&ring);
    points[0][0] = ring[2];
    let mut scale = 0.5;
    let mut at = [2.0 * s, 2.0 * t];
    loop {
        points[1][1] = ring[0];
        points[1][0] = ring[1];
        points[0][1] = ring[n - 1];
        if n == 4 {
            return scaled(&regular(&points, at[0], at[1]), mean, scale, 1.0);
        }
        // The children's points, those of the polygon by its own mask. Its next point but one is no part of the
        // other quadrants.
        let mut fine = divide(&points);
        ring = shrink(&ring);
        fine[1][1] = ring[0];
        fine[1][0] = ring[1];
        fine[0][1] = ring[n - 1];
        if at[0] >= 0.5 || at[1] >= 0.5 {
            let (x, y) = (usize::from(at[0] >= 0.5), usize::from(at[1] >= 0.5));
            let quadrant = [0, 1, 2].map(|j| [0, 1, 2].map(|i| fine[y + j][x + i]));
            let sample = regular(&quadrant, 2.0 * at[0] - x as f64, 2.0 * at[1] - y as f64);
            return scaled(&sample, mean, scale, 2.0);
        }
        points = [0, 1, 2].map(|j| [0, 1, 2].map(|i| fine[j][i] * 2.0));
        ring.iter_mut().for_each(|p| *p *= 2.0);
        scale *= 0.5;
        at = at.map(|x| 2.0 * x);
    }
}

/// Undoes the scaling of a sample that was computed relative to `mean`, doubled as often as its parameters were;
/// `faster` is by how much its own parameters run faster than those.
fn scaled(sample: &Sample, mean: DVec3, scale: f64, faster: f64) -> Sample {
    Sample {
        position: mean + sample.position * scale,
        du: sample.du * faster,
        dv: sample.dv * faster,
        normal: sample.normal,
    }
}

/// Where the patches of a polygon meet.
fn centre(polygon: &Polygon, mean: DVec3) -> Sample {
    let n = polygon.len();
    let harmonic = |j: usize| {
        let part = |(i, p): (usize, &DVec3)| {
            *p * (TAU * (i as f64 - j as f64) / n as f64).cos() * (2.0 / n as f64)
        };
        polygon.iter().enumerate().map(part).sum::<DVec3>()
    };
    let sum = |wave: fn(f64) -> f64| {
        let part = |(i, p): (usize, &DVec3)| *p * wave(TAU * i as f64 / n as f64);
        polygon.iter().enumerate().map(part).sum::<DVec3>()
    };
    Sample {
        position: mean,
        du: harmonic(0) + harmonic(n - 1),
        dv: harmonic(0) + harmonic(1),
        normal: sum(f64::cos).cross(sum(f64::sin)).try_normalize(),
    }
}

/// The point that a face gives to its corner `j`.
fn mask(face: &[DVec3], j: usize) -> DVec3 {
    let n = face.len();
    (0..n).map(|i| face[(i + j) % n] * weight(i, n)).sum()
}

/// The next level's polygon inside one.
fn shrink(polygon: &Polygon) -> Polygon {
    (0..polygon.len()).map(|j| mask(polygon, j)).collect()
}

/// The net of a patch whose faces all have four corners.
fn net(faces: &[Polygon; 4]) -> Net {
    let [f0, f1, f2, f3] = faces;
    [
        [f0[2], f1[1], f1[2]],
        [f3[3], f0[0], f2[1]],
        [f3[2], f3[1], f2[2]],
    ]
}

/// The next level's points on a net.
fn divide(net: &Net) -> [[DVec3; 4]; 4] {
    let along = |[a, b, c]: [DVec3; 3]| {
        [
            0.75 * a + 0.25 * b,
            0.25 * a + 0.75 * b,
            0.75 * b + 0.25 * c,
            0.25 * b + 0.75 * c,
        ]
    };
    let rows = net.map(along);
    let columns = [0, 1, 2, 3].map(|i| along([0, 1, 2].map(|j| rows[j][i])));
    [0, 1, 2, 3].map(|j| [0, 1, 2, 3].map(|i| columns[i][j]))
}

/// The biquadratic B-spline over the middle of a net.
fn regular(net: &Net, u: f64, v: f64) -> Sample {
    let (bu, bv) = (basis(u), basis(v));
    let sum = |x: [f64; 3], y: [f64; 3]| {
        let row = |j: usize| net[j][0] * x[0] + net[j][1] * x[1] + net[j][2] * x[2];
        row(0) * y[0] + row(1) * y[1] + row(2) * y[2]
    };
    Sample::new(sum(bu[0], bv[0]), sum(bu[1], bv[0]), sum(bu[0], bv[1]))
}

/// The uniform quadratic B-spline's basis and its derivative.
fn basis(x: f64) -> [[f64; 3]; 2] {
    let y = 1.0 - x;
    [[0.5 * y * y, 0.5 + x * y, 0.5 * x * x], [-y, y - x, x]]
}

/// The patch of a border point, from its two faces counterclockwise; u runs along the border, which has the surface
/// on its left.
fn strip([right, left]: [Polygon; 2], u: f64, v: f64) -> Sample {
    let (b, above) = (right[0], left[1]);
    let (west, east) = (left[left.len() - 1], right[1]);
    if right.len() == 4 && left.len() == 4 {
        return linear([west, b, east], [left[2], above, right[2]], u, v);
    }
    // Points of the next level along the border and beside it.
    let border = [
        0.75 * west + 0.25 * b,
        0.25 * west + 0.75 * b,
        0.75 * b + 0.25 * east,
        0.25 * b + 0.75 * east,
    ];
    let beside = [
        mask(&left, left.len() - 1),
        mask(&left, 0),
        mask(&right, 0),
        mask(&right, 1),
    ];
    let side = usize::from(u >= 0.5);
    let x = 2.0 * u - side as f64;
    if v < 0.25 {
        // The child on the border reaches a quarter as far.
        let three = |row: [DVec3; 4]| [row[side], row[side + 1], row[side + 2]];
        let sample = linear(three(border), three(beside), x, 4.0 * v);
        return Sample {
            du: sample.du * 2.0,
            dv: sample.dv * 4.0,
            ..sample
        };
    }
    // The child inside. A quadratic through 1/4 and 1 with slopes as 1 to 2 is the square of its own parameter, moved.
    let [west, middle] = [beside[side], beside[side + 1]];
    let y = 2.0 * v.sqrt() - 1.0;
    let upper = [mask(&left, 1), mask(&right, right.len() - 1)];
    let faces = if side == 0 {
        [
            vec![middle, west, border[0], border[1]],
            vec![middle, border[1], border[2], beside[2]],
            vec![middle, beside[2], upper[1], upper[0]],
            shrink(&left),
        ]
    } else {
        [
            vec![middle, west, border[1], border[2]],
            vec![middle, border[2], border[3], beside[3]],
            shrink(&right),
            vec![middle, upper[1], upper[0], west],
        ]
    };
    let sample = inner(faces, x, y);
    Sample {
        du: sample.du * 2.0,
        dv: sample.dv / v.sqrt(),
        ..sample
    }
}

/// Between a quadratic curve on the border, and half-way to that of the next points.
fn linear(border: [DVec3; 3], beside: [DVec3; 3], u: f64, v: f64) -> Sample {
    let [value, slope] = basis(u);
    let sum = |p: [DVec3; 3], w: [f64; 3]| p[0] * w[0] + p[1] * w[1] + p[2] * w[2];
    let across = (sum(beside, value) - sum(border, value)) / 2.0;
    Sample::new(
        sum(border, value) + across * v,
        sum(border, slope).lerp(sum(beside, slope), v / 2.0),
        across,
    )
}

/// The quarter of a face next to a corner that stays; u leaves along the border.
fn quarter(face: &Polygon, u: f64, v: f64) -> Sample {
    let [p, along, opposite, across] = [face[0], face[1], face[2], face[face.len() - 1]];
    let (x, y) = (u / 2.0, v / 2.0);
    Sample::new(
        p.lerp(along, x).lerp(across.lerp(opposite, x), y),
        (along - p).lerp(opposite - across, y) / 2.0,
        (across - p).lerp(opposite - along, x) / 2.0,
    )
}
