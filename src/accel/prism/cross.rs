//! The sides of a quad's two prisms, all at once.
//!
//! Five of them, the diagonal being one of both: each is a lane of doubles.

use arrayvec::ArrayVec;

use super::{MOST_SPANS, Parts, Pole, Sheared, Span, of_half, unfold};
use crate::accel::simd::{EIGHT, Lanes};
use crate::math::DVec3;

/// The corners that sides start and end at, a to d: the diagonal, those of the first triangle, those of the second. What is
/// left of the lanes has the diagonal again.
const FROM: [i64; EIGHT] = [1, 2, 0, 1, 3, 1, 1, 1];
const TO: [i64; EIGHT] = [2, 0, 1, 3, 2, 2, 2, 2];

/// The sides opposite a triangle's corners. The second one sees the diagonal from the other side.
const SIDES: [[usize; 3]; 2] = [[0, 1, 2], [0, 3, 4]];
const DIAGONAL: u32 = 1;

/// The same as bits.
const OF_HALF: [u32; 2] = [0b00111, 0b11001];

/// What rises stand behind feet by.
const fn rises(corners: [i64; EIGHT]) -> [i64; EIGHT] {
    let mut rises = corners;
    let mut lane = 0;
    while lane < EIGHT {
        rises[lane] += 4;
        lane += 1;
    }
    rises
}

/// U of the sides, by powers of h.
struct Sides<L: Lanes>([L::Doubles; 3]);

/// A place where a ray may enter or leave.
#[derive(Clone, Copy)]
struct Cut {
    height: f64,
    /// The side that it is on, if it is on one: the corner opposite.
    side: Option<usize>,
}

/// Finds the parts of the ray between two heights in the prisms over a quad; the lines of its corners as the ray sees them.
#[inline(always)]
pub(in crate::accel) fn cross<L: Lanes>(
    lanes: L,
    parts: &mut Parts,
    sheared: &Sheared,
    corners: &[[DVec3; 2]; 4],
    heights: [f64; 2],
    may_fold: bool,
) -> [Pole; 4] {
    let [x, y, t] = sheared.lines(lanes, corners);
    let mut along = [0.0; EIGHT];
    lanes.store_doubles(t, &mut along);
    let pole = |k: usize| Pole {
        foot: along[k],
        rise: along[4 + k],
    };
    let poles = [pole(0), pole(1), pole(2), pole(3)];
    let sides = Sides::new(lanes, [x, y]);
    sides.find(lanes, parts, &poles, heights, may_fold);
    poles
}

impl Sheared {
    /// The lines of a quad's corners: across the ray twice, then `t`; first where they are at height 0, then what a step of
    /// height adds.
    #[inline(always)]
    fn lines<L: Lanes>(&self, lanes: L, corners: &[[DVec3; 2]; 4]) -> [L::Doubles; 3] {
        let mut all = [[0.0; EIGHT]; 3];
        for (k, [p, n]) in corners.iter().enumerate() {
            let p = *p - self.origin;
            for (all, axis) in all.iter_mut().zip(self.axes) {
                all[k] = p[axis];
                all[4 + k] = n[axis];
            }
        }
        let [x, y, z] = &all;
        let z = lanes.load_doubles(z);
        [
            sheared(lanes, x, self.shear[0], z),
            sheared(lanes, y, self.shear[1], z),
            lanes.mul_doubles(z, lanes.doubles(self.per_step)),
        ]
    }
}

#[inline(always)]
fn sheared<L: Lanes>(lanes: L, x: &[f64; EIGHT], shear: f64, z: L::Doubles) -> L::Doubles {
    let by = lanes.mul_doubles(lanes.doubles(shear), z);
    lanes.sub_doubles(lanes.load_doubles(x), by)
}

/// Two coordinates of lanes by their numbers.
#[inline(always)]
fn picked<L: Lanes>(lanes: L, numbers: &[i64; EIGHT], [x, y]: [L::Doubles; 2]) -> [L::Doubles; 2] {
    [
        lanes.pick_doubles(numbers, x),
        lanes.pick_doubles(numbers, y),
    ]
}

#[inline(always)]
fn crossed<L: Lanes>(lanes: L, a: [L::Doubles; 2], b: [L::Doubles; 2]) -> L::Doubles {
    lanes.sub_doubles(lanes.mul_doubles(a[0], b[1]), lanes.mul_doubles(a[1], b[0]))
}

impl<L: Lanes> Sides<L> {
    #[inline(always)]
    fn new(lanes: L, lines: [L::Doubles; 2]) -> Self {
        const FROM_RISE: [i64; EIGHT] = rises(FROM);
        const TO_RISE: [i64; EIGHT] = rises(TO);
        let (i, di) = (
            picked(lanes, &FROM, lines),
            picked(lanes, &FROM_RISE, lines),
        );
        let (j, dj) = (picked(lanes, &TO, lines), picked(lanes, &TO_RISE, lines));
        Self([
            crossed(lanes, i, j),
            lanes.add_doubles(crossed(lanes, i, dj), crossed(lanes, di, j)),
            crossed(lanes, di, dj),
        ])
    }

    /// U at a height.
    #[inline(always)]
    fn at(&self, lanes: L, h: L::Doubles) -> L::Doubles {
        let [a, b, c] = self.0;
        let rest = lanes.add_doubles(b, lanes.mul_doubles(h, c));
        lanes.add_doubles(a, lanes.mul_doubles(h, rest))
    }

    /// The same, one by one.
    #[inline(always)]
    fn values(&self, lanes: L, h: f64) -> [f64; EIGHT] {
        let mut values = [0.0; EIGHT];
        lanes.store_doubles(self.at(lanes, lanes.doubles(h)), &mut values);
        values
    }

    /// The middle Bernstein coefficient between two heights.
    #[inline(always)]
    fn between(&self, lanes: L, [from, to]: [f64; 2]) -> L::Doubles {
        let [a, b, c] = self.0;
        let half = lanes.mul_doubles(lanes.doubles(0.5), b);
        let first = lanes.mul_doubles(half, lanes.doubles(from + to));
        let second =
            lanes.mul_doubles(lanes.mul_doubles(c, lanes.doubles(from)), lanes.doubles(to));
        lanes.add_doubles(lanes.add_doubles(a, first), second)
    }

    /// Finds the parts of the ray between two heights.
    #[inline(always)]
    fn find(
        &self,
        lanes: L,
        parts: &mut Parts,
        poles: &[Pole; 4],
        [low, high]: [f64; 2],
        may_fold: bool,
    ) {
        let zero = lanes.doubles(0.0);
        let bernstein = [
            self.at(lanes, lanes.doubles(low)),
            self.between(lanes, [low, high]),
            self.at(lanes, lanes.doubles(high)),
        ];
        let (mut below, mut above) = ([0; 3], [0; 3]);
        for k in 0..3 {
            below[k] = lanes.less_doubles(bernstein[k], zero);
            above[k] = lanes.less_doubles(zero, bernstein[k]);
        }
        let all_below = below[0] & below[1] & below[2];
        let all_above = above[0] & above[1] & above[2];
        // Where all of U may be above 0, and where all of them may be below.
        let turned = (all_below ^ all_above) & DIAGONAL;
        let possible = [
            [all_below & OF_HALF[0] == 0, all_above & OF_HALF[0] == 0],
            [
                (all_below ^ turned) & OF_HALF[1] == 0,
                (all_above ^ turned) & OF_HALF[1] == 0,
            ],
        ];
        if possible == [[false; 2]; 2] {
            return;
        }
        let mixed = (above[0] ^ above[1]) | (above[1] ^ above[2]);
        let mut roots = [[0.0; EIGHT]; 2];
        let mut there = [0; 2];
        if mixed != 0 {
            let (all, are_real) = self.roots(lanes);
            for k in 0..2 {
                let are_past = lanes.less_doubles(lanes.doubles(low), all[k]);
                let are_before = lanes.less_doubles(all[k], lanes.doubles(high));
                there[k] = mixed & are_real & are_past & are_before;
                lanes.store_doubles(all[k], &mut roots[k]);
            }
        }
        for half in 0..2 {
            if possible[half] == [false; 2] {
                continue;
            }
            let mut cuts: ArrayVec<Cut, { MOST_SPANS + 1 }> = ArrayVec::new();
            let end = |height| Cut { height, side: None };
            cuts.push(end(low));
            for (roots, there) in roots.iter().zip(there) {
                for (k, &lane) in SIDES[half].iter().enumerate() {
                    if there >> lane & 1 == 0 {
                        continue;
                    }
                    let height = roots[lane];
                    let mut at = cuts.len();
                    cuts.push(end(height));
                    while cuts[at - 1].height > height {
                        cuts[at] = cuts[at - 1];
                        at -= 1;
                    }
                    let side = Some(k);
                    cuts[at] = Cut { height, side };
                }
            }
            cuts.push(end(high));
            for pair in cuts.windows(2) {
                let ends = [pair[0], pair[1]];
                let middle = 0.5 * (ends[0].height + ends[1].height);
                let inside = of_triangle(&self.values(lanes, middle), half, 1.0);
                let sign = match inside {
                    [a, b, c] if possible[half][0] && a >= 0.0 && b >= 0.0 && c >= 0.0 => 1.0,
                    [a, b, c] if possible[half][1] && a <= 0.0 && b <= 0.0 && c <= 0.0 => -1.0,
                    _ => continue,
                };
                let corners = of_half(poles, half);
                let Some(span) = self.span(lanes, corners, ends, (half, sign)) else {
                    continue;
                };
                if may_fold {
                    unfold(&span, corners, |part| parts.add(part, half));
                } else {
                    parts.add(span, half);
                }
            }
        }
    }

    /// The heights where U is 0, and a bit for each side that has such: see [`quadratic`](crate::math::quadratic). Where U
    /// is linear, the first one is infinite.
    #[inline(always)]
    fn roots(&self, lanes: L) -> ([L::Doubles; 2], u32) {
        let [c, b, a] = self.0;
        let four = lanes.mul_doubles(lanes.doubles(4.0), a);
        // b b - 4 a c, wrong by two roundings of the result at most.
        let product = lanes.mul_doubles(four, c);
        let error = lanes.mul_sub_doubles(four, c, product);
        let discriminant = lanes.sub_doubles(lanes.mul_sub_doubles(b, b, product), error);
        let root = lanes.with_signs(lanes.root_doubles(discriminant), b);
        let q = lanes.mul_doubles(lanes.doubles(-0.5), lanes.add_doubles(b, root));
        let are_real = !lanes.less_doubles(discriminant, lanes.doubles(0.0));
        ([lanes.div_doubles(q, a), lanes.div_doubles(c, q)], are_real)
    }

    /// The part of the ray from one place to another, in which U has this sign for all three sides.
    #[inline(always)]
    fn span(
        &self,
        lanes: L,
        corners: [&Pole; 3],
        ends: [Cut; 2],
        (half, sign): (usize, f64),
    ) -> Option<Span> {
        let heights = [ends[0].height, ends[1].height];
        let mut middle = [0.0; EIGHT];
        lanes.store_doubles(self.between(lanes, heights), &mut middle);
        // By end, or the middle, and corner.
        let mut weights = [
            of_triangle(&self.values(lanes, heights[0]), half, sign),
            of_triangle(&middle, half, sign),
            of_triangle(&self.values(lanes, heights[1]), half, sign),
        ];
        let mut t = [0.0; 2];
        for (e, end) in ends.iter().enumerate() {
            let weights = &mut weights[2 * e];
            let mut sum = 0.0;
            for (k, u) in weights.iter_mut().enumerate() {
                // Beyond by a rounding, where sides meet.
                *u = if end.side == Some(k) { 0.0 } else { u.max(0.0) };
                sum += *u;
            }
            if sum.is_nan() || sum <= 0.0 {
                return None;
            }
            let mut along = 0.0;
            for (corner, u) in corners.into_iter().zip(weights) {
                along += *u * corner.t(end.height);
            }
            t[e] = along / sum;
        }
        let sides = [ends[0].side, ends[1].side];
        let span = Span {
            heights,
            weights,
            t,
            sides,
        };
        Some(span.onward())
    }
}

/// What a triangle's sides have, as seen from its side, times a sign.
#[inline(always)]
fn of_triangle(values: &[f64; EIGHT], half: usize, sign: f64) -> [f64; 3] {
    let [i, j, k] = SIDES[half];
    let turned = if half == 0 { sign } else { -sign };
    [turned * values[i], sign * values[j], sign * values[k]]
}
