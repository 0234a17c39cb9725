//! A piece of a curve and the lines of a node: where it is over each of the node's children, sixteen at once.

use super::Quad;
use super::curve::{Curve, Piece};
use crate::accel::simd::{LANES, Lanes, Nibbles};

/// A square of a quad's tree, and the part of the curve that is over it.
#[derive(Clone, Copy)]
pub(super) struct Node {
    pub(super) level: u32,
    pub(super) first: [u32; 2],
    pub(super) from: f32,
    pub(super) to: f32,
}

/// What rounding may move heights on the curve and off it, in steps.
const SLACK: f32 = 0.1;

/// Farther than any line of a quad.
const FAR: f32 = 1e6;

/// The lines that a node's children begin and end at, in micro-quads of level 0, u and v in a half each, by which of them
/// falls. The curve is within the node: the outermost it has passed before, and does not reach.
static LINES: [[f32; LANES]; 4] = {
    const GROWS: [f32; 8] = [-FAR, 1.0, 2.0, 3.0, FAR, FAR, FAR, FAR];
    const FALLS: [f32; 8] = [FAR, 3.0, 2.0, 1.0, -FAR, -FAR, -FAR, -FAR];
    let mut lines = [[0.0; LANES]; 4];
    let mut lane = 0;
    while lane < LANES {
        let mut which = 0;
        while which < 4 {
            let falls = if lane < 8 { which & 1 } else { which >> 1 };
            lines[which][lane] = if falls == 1 { FALLS } else { GROWS }[lane % 8];
            which += 1;
        }
        lane += 1;
    }
    lines
};

/// The lines at which the children begin and end, by the order in which the curve passes them.
struct Tables {
    begin: [Nibbles; 2],
    end: [Nibbles; 2],
    /// Children in that order, by which of u and v falls.
    turned: [Nibbles; 4],
}

static TABLES: Tables = {
    let mut tables = [[0; LANES]; 8];
    let mut lane = 0;
    while lane < LANES {
        let c = lane as u8;
        let all = [
            c % 4,
            8 + c / 4,
            c % 4 + 1,
            8 + c / 4 + 1,
            c,
            c ^ 3,
            c ^ 12,
            c ^ 15,
        ];
        let mut table = 0;
        while table < all.len() {
            tables[table][lane] = all[table];
            table += 1;
        }
        lane += 1;
    }
    let [a, b, c, d, e, f, g, h] = tables;
    Tables {
        begin: [Nibbles::new(a), Nibbles::new(b)],
        end: [Nibbles::new(c), Nibbles::new(d)],
        turned: [
            Nibbles::new(e),
            Nibbles::new(f),
            Nibbles::new(g),
            Nibbles::new(h),
        ],
    }
};

/// Half of the lanes each.
#[inline(always)]
fn halves<L: Lanes>(lanes: L, u: f32, v: f32) -> L::Floats {
    lanes.next_row(lanes.floats(u), lanes.floats(v))
}

/// `c + s (b + s a)`.
#[inline(always)]
fn value<L: Lanes>(lanes: L, [c, b, a]: [L::Floats; 3], s: L::Floats) -> L::Floats {
    lanes.mul_add(s, lanes.mul_add(s, a, b), c)
}

/// A piece of a curve, made ready for lines: quadratics less `c` times other ones are zero where it passes the line of
/// u or v of `c`, and grow there.
pub(super) struct Lined<'a, L: Lanes> {
    curve: &'a Curve,
    piece: Piece,
    own: [L::Floats; 3],
    common: [L::Floats; 3],
    lines: L::Floats,
    /// The quad's first micro-quad, which u and v are counted from.
    first: [u32; 2],
    /// Where the face ends.
    sizes: L::Floats,
}

impl<'a, L: Lanes> Lined<'a, L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, curve: &'a Curve, piece: Piece, quad: &Quad) -> Self {
        let sign = |falls: bool| if falls { -1.0 } else { 1.0 };
        let (su, sv) = (sign(piece.falls[0]), sign(piece.falls[1]));
        let [u, v] = &curve.uv;
        let d = &curve.d;
        let own = [
            halves(lanes, su * u[0], sv * v[0]),
            halves(lanes, su * u[1], sv * v[1]),
            halves(lanes, su * u[2], sv * v[2]),
        ];
        let common = [
            halves(lanes, su * d[0], sv * d[0]),
            halves(lanes, su * d[1], sv * d[1]),
            halves(lanes, su * d[2], sv * d[2]),
        ];
        let [nu, nv] = [0, 1].map(|k| (u32::from(quad.size.0[k]) - quad.first[k]) as f32);
        Self {
            curve,
            piece,
            own,
            common,
            lines: lanes.load(&LINES[piece.which()]),
            first: quad.first,
            sizes: halves(lanes, nu, nv),
        }
    }

    /// How far a micro-quad is from the quad's first one, along u or v.
    #[inline(always)]
    pub(super) fn past_first(&self, cell: [u32; 2], axis: usize) -> f32 {
        (cell[axis] as i32 - self.first[axis] as i32) as f32
    }

    /// For the children of a node, in the order of the curve: from where to where it is in each.
    #[inline(always)]
    pub(super) fn children(&self, lanes: L, node: &Node) -> [L::Floats; 2] {
        let side = (1_u32 << (2 * node.level)) as f32;
        let (u, v) = (
            self.past_first(node.first, 0),
            self.past_first(node.first, 1),
        );
        let firsts = halves(lanes, u, v);
        let lines = lanes.mul_add(self.lines, lanes.floats(side), firsts);
        // A curve along the face's border must not count as beyond it.
        let lines = lanes.if_less(lines, self.sizes, lines, lanes.floats(FAR));
        let c = lanes.sub_mul(self.own[0], lines, self.common[0]);
        let b = lanes.sub_mul(self.own[1], lines, self.common[1]);
        let a = lanes.sub_mul(self.own[2], lines, self.common[2]);
        let zero = lanes.floats(0.0);
        let (from, to) = (lanes.floats(node.from), lanes.floats(node.to));
        let discriminant = lanes.sub(
            lanes.mul(b, b),
            lanes.mul(lanes.floats(4.0), lanes.mul(a, c)),
        );
        let root = lanes.sqrt(lanes.max(discriminant, zero));
        // The root where it grows, without a difference of like numbers.
        let numerator = lanes.if_less(
            b,
            zero,
            lanes.sub(root, b),
            lanes.mul(lanes.floats(-2.0), c),
        );
        let denominator = lanes.if_less(b, zero, lanes.add(a, a), lanes.add(b, root));
        let met = lanes.div(numerator, denominator);
        let met = lanes.max(lanes.min(met, to), from);
        let met = lanes.if_less(value(lanes, [c, b, a], to), zero, to, met);
        let met = lanes.if_less(zero, value(lanes, [c, b, a], from), from, met);
        let Tables { begin, end, .. } = &TABLES;
        [
            lanes.max(lanes.pick(&begin[0], met), lanes.pick(&begin[1], met)),
            lanes.min(lanes.pick(&end[0], met), lanes.pick(&end[1], met)),
        ]
    }

    /// Which of them the curve is within the heights of.
    #[inline(always)]
    pub(super) fn within(
        &self,
        lanes: L,
        [begin, end]: [L::Floats; 2],
        [low, high]: [L::Floats; 2],
    ) -> u32 {
        let turned = &TABLES.turned[self.piece.which()];
        let (low, high) = (lanes.pick(turned, low), lanes.pick(turned, high));
        let (h, grows) = (
            lanes.floats(self.curve.height),
            lanes.floats(self.curve.grows),
        );
        let h0 = lanes.mul_add(begin, grows, h);
        let h1 = lanes.mul_add(end, grows, h);
        let slack = lanes.floats(SLACK);
        lanes.less(begin, end)
            & lanes.less_equal(lanes.sub(low, slack), lanes.max(h0, h1))
            & lanes.less_equal(lanes.min(h0, h1), lanes.add(high, slack))
    }

    /// Column and row of the child in a lane.
    #[inline(always)]
    pub(super) fn child(&self, lane: usize) -> [u32; 2] {
        let flip = |x: usize, falls: bool| (if falls { 3 - x } else { x }) as u32;
        [
            flip(lane % 4, self.piece.falls[0]),
            flip(lane / 4, self.piece.falls[1]),
        ]
    }
}
