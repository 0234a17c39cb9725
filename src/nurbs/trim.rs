//! Trim curves: which part of the parameter plane is kept.
//!
//! A point is kept if the loops together wind around it an odd number of times, that is if a ray from it crosses them
//! an odd number of times. The curves are cut into rational Bezier pieces; whatever is decided of a piece is decided by
//! its convex hull, cutting it in two (de Casteljau) where the hull does not decide. A piece wholly to the right of
//! a point crosses the ray to the right an odd number of times exactly if it ends on the other side of the ray's line than
//! it begins. Whether an end lies below the line is one comparison of one number that both pieces at this end share,
//! so no crossing is lost or counted twice between pieces, also where the ray hits ends, corners or tangents.
//! The idea is that of Bezier clipping (Nishita, Sederberg, Kakimoto 1990, section 4), with halving in place of
//! clipping: slower by a factor and with nothing to go wrong.

use super::basis;
use crate::mesh::{MAX_ORDER, NurbsPatch, TrimCurve};

/// The kept part of a patch's parameter plane.
#[derive(Debug, Clone, Default)]
pub struct Trim {
    /// Pieces of each loop in order; each ends, to the bit, where the next one begins.
    loops: Vec<Vec<Piece>>,
    /// Hulls smaller than this are taken for the straight line between the piece's ends.
    smallest: [f64; 2],
    /// The widest gap between a curve and the next, in parts of the domain.
    gap: f64,
}

/// A rational Bezier curve by its homogeneous points.
type Piece = Vec<[f64; 3]>;

/// What is kept of a rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cover {
    /// All of it, for certain.
    Inside,
    /// Nothing of it, for certain.
    Outside,
    /// A curve crosses it, or comes too close to tell.
    Crossed,
}

/// Halvings after which a piece is taken for straight: doubles have no more.
const MOST_HALVINGS: u32 = 60;

impl Trim {
    /// The trim of a valid patch. Where a curve does not end where the next one begins, a straight piece leads there.
    pub fn new(patch: &NurbsPatch) -> Self {
        let extent = [&patch.u, &patch.v].map(|d| {
            let [low, high] = d.domain();
            high - low
        });
        let mut gap: f64 = 0.0;
        let loops = patch
            .trims
            .iter()
            .map(|curves| {
                let mut pieces: Vec<Piece> = Vec::new();
                for curve in curves {
                    link(&mut pieces, bezier(curve), extent, &mut gap);
                }
                if let Some(first) = pieces.first().cloned() {
                    link(&mut pieces, vec![first], extent, &mut gap);
                    pieces.pop();
                }
                pieces
            })
            .collect();
        Self {
            loops,
            smallest: extent.map(|e| 1e-13 * e),
            gap,
        }
    }

    /// Whether there are no loops: then everything is kept.
    pub fn is_empty(&self) -> bool {
        self.loops.is_empty()
    }

    /// The widest gap between the end of a curve and the beginning of the next, in parts of the patch's domain.
    pub fn gap(&self) -> f64 {
        self.gap
    }

    /// Whether the point is kept. Points within 1e-13 of the domain from a curve may be told either way.
    pub fn is_inside(&self, point: [f64; 2]) -> bool {
        self.loops.is_empty()
            || self
                .loops
                .iter()
                .flatten()
                .filter(|piece| self.crosses(piece, point, MOST_HALVINGS))
                .count()
                % 2
                == 1
    }

    /// What is kept of the rectangle from `low` to `high`.
    pub fn cover(&self, low: [f64; 2], high: [f64; 2]) -> Cover {
        let touched = self
            .loops
            .iter()
            .flatten()
            .any(|piece| self.touches(piece, low, high, MOST_HALVINGS));
        if touched {
            Cover::Crossed
        } else if self.is_inside([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]) {
            Cover::Inside
        } else {
            Cover::Outside
        }
    }

    /// Whether the piece crosses the ray from `point` towards larger u an odd number of times.
    fn crosses(&self, piece: &[[f64; 3]], point: [f64; 2], halvings: u32) -> bool {
        let [u, v] = point;
        let (low, high) = hull(piece);
        if low[1] > v || high[1] <= v || high[0] <= u {
            return false;
        }
        let (start, end) = (place(piece[0]), place(piece[piece.len() - 1]));
        let changes_side = (start[1] <= v) != (end[1] <= v);
        if low[0] > u {
            return changes_side;
        }
        let small = (0..2).all(|a| high[a] - low[a] <= self.smallest[a]);
        if piece.len() == 2 || small || halvings == 0 {
            let t = (v - start[1]) / (end[1] - start[1]);
            return changes_side && start[0] + t * (end[0] - start[0]) > u;
        }
        let [a, b] = halves(piece);
        self.crosses(&a, point, halvings - 1) != self.crosses(&b, point, halvings - 1)
    }

    /// Whether the piece comes into a rectangle, or closer than rounding can tell.
    fn touches(&self, piece: &[[f64; 3]], low: [f64; 2], high: [f64; 2], halvings: u32) -> bool {
        let (from, to) = hull(piece);
        let margin = self.smallest;
        if (0..2).any(|a| from[a] > high[a] + margin[a] || to[a] < low[a] - margin[a]) {
            return false;
        }
        let within = |p: [f64; 2]| (0..2).all(|a| low[a] <= p[a] && p[a] <= high[a]);
        let small = (0..2).all(|a| to[a] - from[a] <= margin[a].max(1e-3 * (high[a] - low[a])));
        if small
            || halvings == 0
            || within(place(piece[0]))
            || within(place(piece[piece.len() - 1]))
        {
            return true;
        }
        let [a, b] = halves(piece);
        self.touches(&a, low, high, halvings - 1) || self.touches(&b, low, high, halvings - 1)
    }
}

/// A curve's Bezier pieces. Consecutive ones share their end to the bit unless the curve breaks there.
fn bezier(curve: &TrimCurve) -> Vec<Piece> {
    let degree = curve.order - 1;
    let mut before: Option<(usize, [f64; 3])> = None;
    let mut pieces = Vec::new();
    for (span, part) in curve.spans() {
        let mut piece: Piece = (0..=degree)
            .map(|k| {
                let mut arguments = [part[0]; MAX_ORDER];
                arguments[..k].fill(part[1]);
                let mut weights = [0.0; MAX_ORDER];
                basis::polar(
                    &curve.knots,
                    curve.order,
                    span,
                    &arguments[..degree],
                    &mut weights,
                );
                let mut sum = [0.0; 3];
                for (point, weight) in curve.points[span - degree..]
                    .iter()
                    .zip(&weights[..=degree])
                {
                    for (s, x) in sum.iter_mut().zip(point) {
                        *s += x * weight;
                    }
                }
                sum
            })
            .collect();
        if let Some((_, end)) = before.filter(|(b, _)| span - b <= degree) {
            piece[0] = end;
        }
        before = Some((span, piece[degree]));
        pieces.push(piece);
    }
    pieces
}

/// Adds pieces to a loop, with a straight one in front where they do not begin at its end to the bit.
fn link(pieces: &mut Vec<Piece>, added: Vec<Piece>, extent: [f64; 2], gap: &mut f64) {
    for piece in added {
        if let Some(end) = pieces.last().map(|p| p[p.len() - 1]) {
            let (a, b) = (place(end), place(piece[0]));
            if a != b {
                let apart = |axis: usize| (a[axis] - b[axis]).abs() / extent[axis];
                *gap = gap.max(apart(0)).max(apart(1));
                pieces.push(vec![end, piece[0]]);
            }
        }
        pieces.push(piece);
    }
}

fn place([u, v, w]: [f64; 3]) -> [f64; 2] {
    [u / w, v / w]
}

/// The box around a piece's points, which holds the piece: weights are above 0.
fn hull(piece: &[[f64; 3]]) -> ([f64; 2], [f64; 2]) {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for p in piece.iter().map(|&p| place(p)) {
        for a in 0..2 {
            low[a] = low[a].min(p[a]);
            high[a] = high[a].max(p[a]);
        }
    }
    (low, high)
}

/// Cuts a piece in the middle of its parameter.
fn halves(piece: &[[f64; 3]]) -> [Piece; 2] {
    let mut left = Vec::with_capacity(piece.len());
    let mut right = piece.to_vec();
    for n in (0..piece.len()).rev() {
        left.push(right[0]);
        for k in 0..n {
            let next = right[k + 1];
            for (x, y) in right[k].iter_mut().zip(next) {
                *x = 0.5 * (*x + y);
            }
        }
    }
    [left, right]
}
