//! What a ray may meet of a part: its children, sixteen at once, with all heights that each of them has.

use super::block::Quad;
use super::face::Face;
use super::part::{FAN, Part};
use crate::accel::simd::{LANES, Lanes};
use crate::math::Vec3;

const COLUMN: [i32; LANES] = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3];
const ROW: [i32; LANES] = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3];

/// Boxes around what the children of a part, or a whole quad in the first lane, show with heights from middle - half to
/// middle + half: their centres along three axes, then half of their sizes. With a coordinate c(u,v) = c0 + cu u + cv v +
/// cuv u v of P, and likewise of N, G = P + h N at the middle (u,v) of a child of size 2 ru, 2 rv reaches over
///
/// ```text
///   |Gu + Guv v| ru + |Gv + Guv u| rv + |Guv| ru rv + r (|N| + |Nu + Nuv v| ru + |Nv + Nuv u| rv + |Nuv| ru rv)
/// ```
#[inline(always)]
pub(super) fn shadows<L: Lanes>(
    lanes: L,
    (face, part): (&Face, Option<&Part>),
    quad: &Quad,
    [middle, half]: [L::Floats; 2],
) -> [L::Floats; 6] {
    let at = match part {
        Some(part) => Middles::new(lanes, face, part),
        None => Middles::whole(lanes),
    };
    let mut out = [lanes.floats(0.0); 6];
    for k in 0..3 {
        let p = Slopes::new(lanes, &at, &quad.p[k]);
        let n = Slopes::new(lanes, &at, &quad.n[k]);
        let thick = lanes.add(lanes.abs(n.value), n.reach(lanes, &at));
        let g = Slopes {
            value: lanes.add(p.value, lanes.mul(middle, n.value)),
            du: lanes.add(p.du, lanes.mul(middle, n.du)),
            dv: lanes.add(p.dv, lanes.mul(middle, n.dv)),
            twist: lanes.add(p.twist, lanes.mul(middle, n.twist)),
        };
        out[k] = g.value;
        out[3 + k] = lanes.add(g.reach(lanes, &at), lanes.mul(half, thick));
    }
    out
}

/// What a part's children show, as parallelepipeds: `c + x a + y b + z n` with x, y in -1..1 and z in -half..half, but for
/// what `off` adds along each axis.
pub(super) struct Parts<L: Lanes> {
    c: [L::Floats; 3],
    a: [L::Floats; 3],
    b: [L::Floats; 3],
    n: [L::Floats; 3],
    off: [L::Floats; 3],
    half: L::Floats,
}

impl<L: Lanes> Parts<L> {
    /// With heights from middle - half to middle + half.
    #[inline(always)]
    pub(super) fn new(
        lanes: L,
        (face, part): (&Face, &Part),
        quad: &Quad,
        [middle, half]: [L::Floats; 2],
    ) -> Self {
        let at = Middles::new(lanes, face, part);
        let zero = [lanes.floats(0.0); 3];
        let mut parts = Self {
            c: zero,
            a: zero,
            b: zero,
            n: zero,
            off: zero,
            half,
        };
        for k in 0..3 {
            let p = Slopes::new(lanes, &at, &quad.p[k]);
            let n = Slopes::new(lanes, &at, &quad.n[k]);
            parts.c[k] = lanes.add(p.value, lanes.mul(middle, n.value));
            let du = lanes.add(p.du, lanes.mul(middle, n.du));
            let dv = lanes.add(p.dv, lanes.mul(middle, n.dv));
            let twist = lanes.add(p.twist, lanes.mul(middle, n.twist));
            parts.a[k] = lanes.mul(du, at.ru);
            parts.b[k] = lanes.mul(dv, at.rv);
            parts.n[k] = n.value;
            let bent = lanes.mul(lanes.abs(twist), at.ruv);
            parts.off[k] = lanes.add(bent, lanes.mul(half, n.reach(lanes, &at)));
        }
        parts
    }

    /// Narrows the interval of a ray along the third axis, from `z` on, where `t` is z times `inverse`, to what is within the
    /// parallelepipeds, and `slack` more along each axis.
    #[inline(always)]
    pub(super) fn meet(
        &self,
        lanes: L,
        slack: L::Floats,
        [z, inverse]: [f32; 2],
        [near, far]: [&mut L::Floats; 2],
    ) {
        let c = [self.c[0], self.c[1], lanes.sub(self.c[2], lanes.floats(z))];
        let off = [
            lanes.add(self.off[0], slack),
            lanes.add(self.off[1], slack),
            lanes.add(self.off[2], slack),
        ];
        let across_a = cross(lanes, &self.b, &self.n);
        let across_b = cross(lanes, &self.n, &self.a);
        let across_n = cross(lanes, &self.a, &self.b);
        let volume = lanes.abs(dot(lanes, &self.n, &across_n));
        let thick = lanes.mul(volume, self.half);
        for (across, wide) in [(&across_a, volume), (&across_b, volume), (&across_n, thick)] {
            // |across . (p - c)| <= wide, at p = (0, 0, z). Where a ray runs along two planes, or there are none, it is
            // taken to cross them very far away: 1 more in width, less than the area of a micro-quad on the lattice,
            // makes up for that.
            const ALONG: f32 = 1e-12;
            let size = [
                lanes.abs(across[0]),
                lanes.abs(across[1]),
                lanes.abs(across[2]),
            ];
            let wide = lanes.add(lanes.add(wide, lanes.floats(1.0)), dot(lanes, &size, &off));
            let is_along = lanes.less(size[2], lanes.floats(ALONG));
            let z = lanes.select(is_along, lanes.floats(ALONG), across[2]);
            let scale = lanes.div(lanes.floats(inverse), z);
            let middle = lanes.mul(dot(lanes, across, &c), scale);
            let reach = lanes.mul(wide, lanes.abs(scale));
            // What is no number decides nothing.
            *near = lanes.max(lanes.sub(middle, reach), *near);
            *far = lanes.min(lanes.add(middle, reach), *far);
        }
    }
}

/// A ray in the space of a flat quad: u and v from its middle on, and heights, each of which goes evenly with `t`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Straight {
    /// Where it is for a `t` of zero, counted from the quad's middle.
    at: [f32; 3],
    /// One by how fast it goes.
    inverse: [f32; 3],
    /// How much a step along all axes changes each.
    per_step: [f32; 3],
}

impl Straight {
    /// Of a ray along the third axis, from `z` on, where `t` is z times `inverse`. None where the quad is too narrow a
    /// rhomb to be looked at so.
    #[inline(always)]
    pub(super) fn new(quad: &Quad, z: f32, inverse: f32) -> Option<Self> {
        let mut c = Vec3::ZERO;
        let [mut a, mut b, mut n] = [Vec3::ZERO; 3];
        for k in 0..3 {
            let [p00, p10, p01, p11] = quad.p[k];
            a[k] = 0.5 * ((p10 - p00) + (p11 - p01));
            b[k] = 0.5 * ((p01 - p00) + (p11 - p10));
            c[k] = 0.25 * ((p00 + p10) + (p01 + p11));
            n[k] = 0.25 * quad.n[k].iter().sum::<f32>();
        }
        c.z -= z;
        let across = [b.cross(n), n.cross(a), a.cross(b)];
        let volume = n.dot(across[2]);
        const NARROW: f32 = 0.1;
        let widest = a.length_squared() * b.length_squared();
        // Not so if it is no number.
        let is_wide = volume * volume > NARROW * NARROW * widest;
        if !is_wide {
            return None;
        }
        let mut straight = Self::default();
        for (k, across) in across.into_iter().enumerate() {
            let by = across / volume;
            straight.at[k] = -by.dot(c);
            // So little that it makes no difference on all of the lattice.
            const LEAST: f32 = 1e-20;
            let speed = if by.z.abs() < LEAST { LEAST } else { by.z };
            straight.inverse[k] = inverse / speed;
            straight.per_step[k] = by.abs().element_sum();
        }
        Some(straight)
    }

    /// Narrows the interval of the ray to where it is within a part's children, and `slack` more along each axis.
    #[inline(always)]
    pub(super) fn meet<L: Lanes>(
        &self,
        lanes: L,
        (face, part): (&Face, &Part),
        [middle, half]: [L::Floats; 2],
        slack: L::Floats,
        [near, far]: [&mut L::Floats; 2],
    ) {
        for k in 0..3 {
            let more = lanes.mul(slack, lanes.floats(self.per_step[k]));
            let [low, high] = if k < 2 {
                let number = if k == 0 { &COLUMN } else { &ROW };
                let [from, to] = micro_quads(lanes, face, part, k, number);
                let share = lanes.floats(face.share[k]);
                let middle = lanes.floats(0.5);
                [
                    lanes.sub(lanes.mul(from, share), middle),
                    lanes.sub(lanes.mul(to, share), middle),
                ]
            } else {
                [lanes.sub(middle, half), lanes.add(middle, half)]
            };
            let at = lanes.floats(self.at[k]);
            let inverse = lanes.floats(self.inverse[k]);
            let low = lanes.mul(lanes.sub(lanes.sub(low, more), at), inverse);
            let high = lanes.mul(lanes.sub(lanes.add(high, more), at), inverse);
            *near = lanes.max(lanes.min(low, high), *near);
            *far = lanes.min(lanes.max(low, high), *far);
        }
    }
}

#[inline(always)]
fn cross<L: Lanes>(lanes: L, a: &[L::Floats; 3], b: &[L::Floats; 3]) -> [L::Floats; 3] {
    [
        lanes.sub(lanes.mul(a[1], b[2]), lanes.mul(a[2], b[1])),
        lanes.sub(lanes.mul(a[2], b[0]), lanes.mul(a[0], b[2])),
        lanes.sub(lanes.mul(a[0], b[1]), lanes.mul(a[1], b[0])),
    ]
}

#[inline(always)]
fn dot<L: Lanes>(lanes: L, a: &[L::Floats; 3], b: &[L::Floats; 3]) -> L::Floats {
    let xy = lanes.add(lanes.mul(a[0], b[0]), lanes.mul(a[1], b[1]));
    lanes.add(xy, lanes.mul(a[2], b[2]))
}

/// The micro-quads before each of a part's children along an axis, and those before the next one.
#[inline(always)]
fn micro_quads<L: Lanes>(
    lanes: L,
    face: &Face,
    part: &Part,
    k: usize,
    number: &[i32; LANES],
) -> [L::Floats; 2] {
    let number = lanes.load_ints(number);
    let number = lanes.add_ints(number, lanes.ints((FAN * part.at[k]) as i32));
    let next = lanes.add_ints(number, lanes.ints(1));
    let step = lanes.ints(face.step(part, k) as i32);
    let from = lanes.shift_right::<16>(lanes.mul_ints(number, step));
    let to = lanes.shift_right::<16>(lanes.mul_ints(next, step));
    // The last one ends where the quad does.
    let cells = lanes.floats(f32::from(face.cells[k]));
    [lanes.to_floats(from), lanes.min(lanes.to_floats(to), cells)]
}

/// The middles of a part's children, and half of their sizes, as parameters of the quad.
struct Middles<L: Lanes> {
    u: L::Floats,
    v: L::Floats,
    ru: L::Floats,
    rv: L::Floats,
    ruv: L::Floats,
}

impl<L: Lanes> Middles<L> {
    #[inline(always)]
    fn new(lanes: L, face: &Face, part: &Part) -> Self {
        let (u, ru) = Self::along(lanes, face, part, 0, &COLUMN);
        let (v, rv) = Self::along(lanes, face, part, 1, &ROW);
        let ruv = lanes.mul(ru, rv);
        Self { u, v, ru, rv, ruv }
    }

    /// Of a quad, everywhere.
    #[inline(always)]
    fn whole(lanes: L) -> Self {
        let half = lanes.floats(0.5);
        Self {
            u: half,
            v: half,
            ru: half,
            rv: half,
            ruv: lanes.floats(0.25),
        }
    }

    #[inline(always)]
    fn along(
        lanes: L,
        face: &Face,
        part: &Part,
        k: usize,
        number: &[i32; LANES],
    ) -> (L::Floats, L::Floats) {
        let [from, to] = micro_quads(lanes, face, part, k, number);
        let half = lanes.floats(0.5 * face.share[k]);
        (
            lanes.mul(lanes.add(from, to), half),
            lanes.mul(lanes.sub(to, from), half),
        )
    }
}

/// A coordinate at the middles, with its slopes there.
struct Slopes<L: Lanes> {
    value: L::Floats,
    du: L::Floats,
    dv: L::Floats,
    twist: L::Floats,
}

impl<L: Lanes> Slopes<L> {
    #[inline(always)]
    fn new(lanes: L, at: &Middles<L>, [a, b, c, d]: &[f32; 4]) -> Self {
        let twist = lanes.floats((d - c) - (b - a));
        let along = lanes.floats(b - a);
        let dv = lanes.add(lanes.floats(c - a), lanes.mul(twist, at.u));
        let value = lanes.add(lanes.floats(*a), lanes.mul(along, at.u));
        Self {
            value: lanes.add(value, lanes.mul(dv, at.v)),
            du: lanes.add(along, lanes.mul(twist, at.v)),
            dv,
            twist,
        }
    }

    /// How far it goes from the middle within a child.
    #[inline(always)]
    fn reach(&self, lanes: L, at: &Middles<L>) -> L::Floats {
        let along_u = lanes.mul(lanes.abs(self.du), at.ru);
        let along_v = lanes.mul(lanes.abs(self.dv), at.rv);
        let both = lanes.mul(lanes.abs(self.twist), at.ruv);
        lanes.add(lanes.add(along_u, along_v), both)
    }
}
