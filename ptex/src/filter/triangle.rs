//! The filter of triangle meshes: a Gaussian over an ellipse.
//!
//! Burley and Lacewell 2008, section 5.3, after Heckbert's elliptical weighted average (1989): the two vectors of a
//! lookup span an ellipse, which is brought into Cartesian coordinates, kept from becoming smaller than a texel or too
//! lean, and brought back. In a face it is bounded by barycentric coordinates: what has one below zero is past an edge
//! and goes on in the face beyond, where the coordinates have other names and the ellipse other coefficients.
//!
//! A face's square of texels holds its triangles twice: the even ones stand like the face, the odd ones upside down.
//! Odd ones are treated as even ones of the face mirrored at its hypotenuse.

use super::kernel::level;
use super::{Filter, Target};
use crate::error::Result;
use crate::types::Res;

/// How far the Gaussian reaches, in radii of the ellipse that the lookup spans.
const REACH: f64 = 3.5;
/// Longest to shortest axis, squared, is less than 225; as the bound on the coefficients that follows from it.
const LEAN: f64 = 226.0 / 224.0;
/// Pieces of one lookup. The widest ellipse reaches one face's size to all sides.
const MAX_STEPS: u32 = 1000;
/// Lookups are not wider, so that squares stay numbers.
const WIDEST: f64 = 1e6;

/// `a U² + b U V + c V²`, with U and V in units of the face.
#[derive(Clone, Copy)]
struct Ellipse {
    a: f64,
    b: f64,
    c: f64,
}

/// An ellipse around a point, in barycentric coordinates u, v, w of one face, and the part of it that is still to be
/// added.
#[derive(Clone, Copy)]
struct Piece {
    ellipse: Ellipse,
    centre: [f64; 3],
    low: [f64; 3],
    high: [f64; 3],
}

/// Adds what is around (`u`, `v`) and returns its weight.
pub(super) fn eval(
    filter: &Filter,
    target: &mut Target,
    face: u32,
    [u, v]: [f32; 2],
    w: [f32; 4],
) -> Result<f32> {
    let info = target.reader.face(face);
    if info.constant_neighbourhood {
        return target.constant(face);
    }
    let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
    let (ellipse, log2) = spanned(filter, w, info.res.ulog2);
    let centre = [u, v, 1.0].map(f64::from);
    let centre = [centre[0], centre[1], 1.0 - centre[0] - centre[1]];
    let Ellipse { a, b, c } = ellipse;
    // The square root of a coefficient is how far the ellipse reaches along the other axis.
    let extent = [c, a, a - b + c].map(|e| e.max(0.0).sqrt().min(1.0));
    let piece = Piece {
        ellipse,
        centre,
        low: std::array::from_fn(|i| centre[i] - extent[i]),
        high: std::array::from_fn(|i| centre[i] + extent[i]),
    };
    let mut lookup = Lookup {
        target,
        log2,
        weight: 0.0,
        steps: 0,
    };
    lookup.lay(piece, face)?;
    let weight = lookup.weight as f32;
    if weight > 0.0 {
        Ok(weight)
    } else {
        // No texel's middle was near: the one that the point is in.
        target.out.fill(0.0);
        target.point(face, u, v)
    }
}

/// The ellipse that a lookup spans on a face of 2^`log2` columns, and the reduction to read.
fn spanned(filter: &Filter, w: [f32; 4], log2: i8) -> (Ellipse, i8) {
    let [u1, v1, u2, v2] = w.map(|x| f64::from(x).clamp(-WIDEST, WIDEST));
    let scale = (f64::from(filter.width).powi(2) / 4.0).min(WIDEST);
    let a = (v1 * v1 + v2 * v2) * scale;
    let b = -2.0 * (u1 * v1 + u2 * v2) * scale;
    let c = (u1 * u1 + u2 * u2) * scale;

    // To Cartesian coordinates, where lengths mean something.
    let half_root_3 = 0.75_f64.sqrt();
    let (mut ca, cb, mut cc) = (0.75 * a, half_root_3 * (b - a), 0.25 * a - 0.5 * b + c);
    let spread = ((ca - cc).powi(2) + cb * cb).sqrt();
    let blur = f64::from(filter.blur).clamp(-WIDEST, WIDEST).powi(2) / 4.0;
    let lean = 0.5 * (LEAN * spread - (ca + cc));
    let texel = (0.5 / f64::from(1_u32 << log2)).powi(2);
    let more = blur.max(lean).max(texel);
    ca += more;
    cc += more;
    let minor = (2.0 * (ca * cc - 0.25 * cb * cb) / (ca + cc + spread)).sqrt();

    let a = ca / 0.75;
    let b = cb / half_root_3 + a;
    let c = cc - 0.25 * a + 0.5 * b;
    let [a, b, c] = [a, b, c].map(|x| x * REACH * REACH);
    (Ellipse { a, b, c }, level((2.0 * minor) as f32).max(0))
}

impl Piece {
    /// What is past an edge, as the face beyond sees it. `z` is the coordinate that vanishes on the edge here, `to_z`
    /// the one that does so there.
    fn beyond(&self, z: usize, to_z: usize) -> Self {
        let mut piece = *self;
        for d in 0..3 {
            let (from, to) = ((z + d) % 3, (to_z + d) % 3);
            let one = if d == 0 { 0.0 } else { 1.0 };
            let high = if d == 0 { 0.0 } else { self.high[from] };
            piece.centre[to] = one - self.centre[from];
            piece.low[to] = one - high;
            piece.high[to] = one - self.low[from];
        }
        let Ellipse { a, b, c } = self.ellipse;
        let (a, b, c) = match (to_z + 3 - z) % 3 {
            1 => (c, 2.0 * c - b, a + c - b),
            2 => (a + c - b, 2.0 * a - b, a),
            _ => (a, b, c),
        };
        piece.ellipse = Ellipse { a, b, c };
        piece
    }

    /// The same in the face mirrored at its hypotenuse, where odd texels are even ones.
    fn mirrored(&self) -> Self {
        let mirror = |x: [f64; 3]| [1.0 - x[1], 1.0 - x[0], -x[2]];
        Self {
            ellipse: Ellipse {
                a: self.ellipse.c,
                b: self.ellipse.b,
                c: self.ellipse.a,
            },
            centre: mirror(self.centre),
            low: mirror(self.high),
            high: mirror(self.low),
        }
    }
}

/// A lookup under way.
struct Lookup<'a, 't> {
    target: &'a mut Target<'t>,
    log2: i8,
    weight: f64,
    steps: u32,
}

impl Lookup<'_, '_> {
    /// Adds a piece's texels of a face, and on over others what is past the face's edges.
    fn lay(&mut self, mut piece: Piece, face: u32) -> Result<()> {
        /// The coordinate that vanishes on an edge.
        const VANISHES: [usize; 3] = [1, 2, 0];
        self.steps += 1;
        if self.steps > MAX_STEPS {
            return Ok(());
        }
        let info = self.target.reader.face(face);
        for edge in [2, 0, 1] {
            let z = VANISHES[edge];
            let next = info.neighbours[edge].filter(|next| next.edge < 3);
            if let (true, Some(next)) = (piece.low[z] < 0.0, next) {
                self.lay(piece.beyond(z, VANISHES[usize::from(next.edge)]), next.face)?;
                piece.low[z] = 0.0;
            }
        }
        self.add(piece, face)
    }

    /// Adds the texels of one face.
    fn add(&mut self, mut piece: Piece, face: u32) -> Result<()> {
        let reader = self.target.reader;
        let log2 = self.log2.min(reader.face(face).res.ulog2);
        piece.low = piece.low.map(|x| x.max(0.0));
        let [u, v, w] = piece.low;
        let room = [1.0 - v - w, 1.0 - w - u, 1.0 - u - v];
        for (high, room) in piece.high.iter_mut().zip(room) {
            *high = high.min(room);
        }
        let res = Res {
            ulog2: log2,
            vlog2: log2,
        };
        let texels = reader.texels(face, res, self.target.premultiply)?;
        let (first, out) = (self.target.first_channel, &mut *self.target.out);
        for piece in [piece, piece.mirrored()] {
            self.weight += visit(&piece, 1 << log2, |x, y, weight| {
                texels.add(x, y, weight, first, out)
            })?;
        }
        Ok(())
    }
}

/// Calls `add` with the column, the row and the weight of all texels of a face, `n` on a side, that a piece covers, as
/// if they were even. Returns the sum of the weights.
fn visit(
    piece: &Piece,
    n: i32,
    mut add: impl FnMut(usize, usize, f32) -> Result<()>,
) -> Result<f64> {
    let size = f64::from(n);
    let ([u1, v1, w1], [u2, v2, w2]) = (piece.low, piece.high);
    let from = |x: f64| (x * size - 1.0 / 3.0).ceil() as i32;
    let Ellipse { a, b, c } = piece.ellipse;
    let within = 1.0 / (size * size * (a * c - 0.25 * b * b));
    let mut sum = 0.0;
    for y in from(v1).max(0)..from(v2).min(n) {
        let first = from(u1).max(n - y - from(w2)).max(0);
        let end = from(u2).min(n - y - from(w1)).min(n);
        let dv = f64::from(y) + 1.0 / 3.0 - piece.centre[1] * size;
        for x in first..end {
            let du = f64::from(x) + 1.0 / 3.0 - piece.centre[0] * size;
            let q = (a * du * du + b * du * dv + c * dv * dv) * within;
            if q < 1.0 {
                let weight = (-0.5 * REACH * REACH * q).exp() / (size * size);
                sum += weight;
                add(x as usize, y as usize, weight as f32)?;
            }
        }
    }
    Ok(sum)
}
