//! One ray through the trees: the body that each instruction set gets compiled.

use super::Dbvh;
use super::block::{Block, Quad, Single};
use super::face::{FAN, Face, Patch, Span};
use super::heights::{Reader, ends};
use super::woven::{Net, Woven};
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::quads::Sheared;
use crate::accel::simd::{Body, LANES, Lanes};
use crate::accel::triangle::TriangleHit;
use crate::accel::waiting::{Place, Stack, Waiting};
use crate::math::Ray;

/// Where a ray met a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Met {
    pub(super) hit: TriangleHit,
    pub(super) patch: u32,
    /// Column and row of the block's first micro-vertex in the quad.
    pub(super) first: [usize; 2],
    /// The micro-quad in the block, whose rows are [`SIDE`](crate::accel::quads::SIDE) apart, and whether it is its second
    /// triangle.
    pub(super) cell: usize,
    pub(super) second: bool,
}

impl Dbvh {
    /// The nearest triangle, or `ANY` one.
    #[inline]
    pub(super) fn trace<const ANY: bool>(&self, ray: &Ray) -> Option<Met> {
        if self.corners.len() == 1 {
            self.isa.run(Trace::<ANY, false> { tree: self, ray })
        } else {
            self.isa.run(Trace::<ANY, true> { tree: self, ray })
        }
    }
}

struct Trace<'a, const ANY: bool, const MOVES: bool> {
    tree: &'a Dbvh,
    ray: &'a Ray,
}

impl<const ANY: bool, const MOVES: bool> Body for Trace<'_, ANY, MOVES> {
    type Output = Option<Met>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<Met> {
        let Self { tree, ray } = self;
        let root = tree.top.root()?;
        let moment = Moment::new(tree.corners.len() as u32, ray.time);
        // Replaced before it is looked at: the root leads to a patch.
        let patch = tree.patches.first()?;
        let face = tree.faces.first()?;
        let mut walk = Walk::<MOVES> {
            tree,
            reader: tree.heights.reader(),
            number: 0,
            patch,
            face,
            span: face.span(patch),
            quad: Quad {
                p: [[0.0; 4]; 3],
                n: [[0.0; 4]; 3],
            },
            moment: &moment,
            world: *ray,
            ray: LatticeRay::new(&tree.lattice, ray, tree.reach),
        };
        let mut nearest = None;
        let mut near = [0.0; LANES];
        let mut stack = Stack::default();
        let mut next = Some(Waiting::child(0.0, root));
        while let Some(at) = next {
            next = match at.place() {
                Place::Node(node) => {
                    let hits = walk.children(lanes, node, &mut near);
                    let node = tree.top.node(node, moment.from);
                    stack.add(hits, |c| Waiting::child(near[c], node.child(c)))
                }
                Place::Patch(number) => {
                    walk.enter(number);
                    // Before all other patches.
                    if walk.span.is_single() {
                        Some(Waiting::part(at.near(), 0))
                    } else {
                        let hits = walk.blocks(lanes, &mut near);
                        stack.add(hits, |c| Waiting::part(near[c], c))
                    }
                }
                Place::Part(block) => {
                    if let Some(met) = walk.block(lanes, block) {
                        nearest = Some(met);
                        if ANY {
                            return nearest;
                        }
                        walk.world.t_max = met.hit.t;
                        walk.ray.end(met.hit.t);
                    }
                    None
                }
            };
            if next.is_none() {
                next = stack.next(walk.ray.t_max);
            }
        }
        nearest
    }
}

struct Walk<'a, const MOVES: bool> {
    tree: &'a Dbvh,
    reader: Reader<'a>,
    /// The patch at hand.
    number: u32,
    patch: &'a Patch,
    face: &'a Face,
    span: Span,
    /// Its quad in the plane across the ray.
    quad: Quad,
    moment: &'a Moment,
    /// The ray as it was given, and on the lattice; both end at the nearest hit so far.
    world: Ray,
    ray: LatticeRay,
}

/// A vector of the lattice in the ray's axes, sheared so that the ray runs along the third.
#[inline(always)]
fn shear(ray: &LatticeRay, v: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = ray.k.map(|k| v[k]);
    [x - ray.s[0] * z, y - ray.s[1] * z, z]
}

/// A point of it.
#[inline(always)]
fn shear_point(ray: &LatticeRay, p: [f32; 3]) -> [f32; 3] {
    shear(ray, [0, 1, 2].map(|k| p[k] - ray.origin[k]))
}

impl<const MOVES: bool> Walk<'_, MOVES> {
    #[inline(always)]
    fn enter(&mut self, number: u32) {
        let tree = self.tree;
        self.number = number;
        self.patch = &tree.patches[number as usize];
        self.face = &tree.faces[self.patch.face as usize];
        self.span = self.face.span(self.patch);
        if self.face.is_woven() {
            return;
        }
        let corners = tree.corners_at(self.face.corners(self.patch.quad), self.moment);
        for (c, corner) in corners.iter().enumerate() {
            let p = shear_point(&self.ray, corner.p);
            let n = shear(&self.ray, corner.n);
            for k in 0..3 {
                self.quad.p[k][c] = p[k];
                self.quad.n[k][c] = n[k];
            }
        }
    }

    /// The children of a node over patches that the ray meets, as bits, and where it enters each.
    #[inline(always)]
    fn children<L: Lanes>(&self, lanes: L, number: u32, entries: &mut [f32; LANES]) -> u32 {
        let at = |key| self.tree.top.node(number, key);
        let node = at(self.moment.from);
        let met = if MOVES {
            let to = at(self.moment.to);
            (node.boxes).met_on_the_way(&to.boxes, self.moment, lanes, &self.ray, entries)
        } else {
            node.boxes.met(lanes, &self.ray, entries)
        };
        met & ((1 << node.children()) - 1)
    }

    /// The same for the blocks of the patch.
    #[inline(always)]
    fn blocks<L: Lanes>(&self, lanes: L, entries: &mut [f32; LANES]) -> u32 {
        let ranges = &self.tree.ranges[self.patch.ranges as usize];
        let heights = self.tree.heights.ranges(lanes, ranges);
        let rounding = self.rounding();
        let mut slack = lanes.floats(rounding);
        if self.face.has_kept {
            let border = self.border();
            let kept = lanes.floats(rounding + 2.0 * self.face.slack);
            slack = lanes.select(border, kept, slack);
        }
        let mut near = lanes.floats(self.ray.t_min);
        let mut far = lanes.floats(self.ray.t_max);
        let parts = Parts::new(lanes, self.face, &self.span, &self.quad, heights);
        let inverse = self.ray.inverse[self.ray.k[2]];
        parts.meet(lanes, slack, inverse, &mut near, &mut far);
        lanes.store(near, entries);
        lanes.less_equal(near, far) & self.span.there()
    }

    /// A block's heights, and how far its vertices may be from where these put them.
    #[inline(always)]
    fn bound(&self, block: usize, span: &Span) -> Option<[f32; 3]> {
        let codes = if self.span.is_single() {
            ends(self.patch.ranges)
        } else {
            self.tree.ranges[self.patch.ranges as usize].get(block)
        };
        let [middle, half] = self.tree.heights.range(codes);
        let kept = if self.face.has_kept && self.face.is_border(self.patch.quad, span) {
            2.0 * self.face.slack
        } else {
            0.0
        };
        Some([middle, half, self.rounding() + kept])
    }

    /// Some forty roundings of what shearing may have doubled.
    #[inline(always)]
    fn rounding(&self) -> f32 {
        4.0 * self.ray.slack[3]
    }

    /// The children that touch the face's border, as bits.
    #[inline(always)]
    fn border(&self) -> u32 {
        let (face, span, fan) = (self.face, &self.span, self.span.fan());
        let at_first = |k: usize| self.patch.quad[k] == 0 && span.first[k] == 0;
        let at_last = |k: usize| {
            self.patch.quad[k] + 1 == face.quads[k]
                && span.first[k] + span.cells[k] == usize::from(face.cells[k])
        };
        let mut bits = 0;
        if at_first(0) {
            bits |= 0x1111;
        }
        if at_last(0) {
            bits |= 0x1111 << (fan[0] - 1);
        }
        if at_first(1) {
            bits |= 0xf;
        }
        if at_last(1) {
            bits |= 0xf << (FAN * (fan[1] - 1));
        }
        bits
    }

    /// The nearest triangle of a block.
    #[inline(always)]
    fn block<L: Lanes>(&self, lanes: L, block: usize) -> Option<Met> {
        let span = if self.span.is_single() {
            self.span
        } else {
            self.span.child(block)
        };
        let bound = self.bound(block, &span);
        let block = Block::new(self.tree, self.patch, &span);
        let mut sheared = Sheared::default();
        let shear = |p| shear_point(&self.ray, p);
        let of = (&self.reader, &block);
        let (tree, moment) = (self.tree, self.moment);
        let quads = if self.face.is_woven() {
            let net = Net::new(tree, self.face, self.patch, moment);
            let mut sheet = Woven::new(lanes, self.face, self.patch, &net);
            sheet.shear(lanes, &self.ray);
            tree.vertices(lanes, of, (&sheet, bound), moment, shear, &mut sheared)
        } else {
            let sheet = Single::new(lanes, tree, self.patch, &block, &self.quad);
            tree.vertices(lanes, of, (&sheet, bound), moment, shear, &mut sheared)
        };
        if quads == 0 {
            return None;
        }
        let interval = [self.world.t_min, self.world.t_max];
        let met = sheared.nearest_of(lanes, quads, span.cells[1], self.ray.s[2], interval)?;
        Some(Met {
            hit: met.hit,
            patch: self.number,
            first: span.first,
            cell: met.cell,
            second: met.second,
        })
    }
}

const COLUMN: [i32; LANES] = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3];
const ROW: [i32; LANES] = [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3];

/// Boxes around what the children of a span show with heights from middle - half to middle + half: their centres along
/// three axes, then half of their sizes. With a coordinate c(u,v) = c0 + cu u + cv v + cuv u v of P, and likewise of N,
/// G = P + h N at the middle (u,v) of a child of size 2 ru, 2 rv reaches over
///
/// ```text
///   |Gu + Guv v| ru + |Gv + Guv u| rv + |Guv| ru rv + r (|N| + |Nu + Nuv v| ru + |Nv + Nuv u| rv + |Nuv| ru rv)
/// ```
#[inline(always)]
pub(super) fn shadows<L: Lanes>(
    lanes: L,
    face: &Face,
    span: &Span,
    quad: &Quad,
    [middle, half]: [L::Floats; 2],
) -> [L::Floats; 6] {
    let at = Middles::new(lanes, face, span);
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

/// What a span's children show, as parallelepipeds: `c + x a + y b + z n` with x, y in -1..1 and z in -half..half, but for
/// what `off` adds along each axis.
struct Parts<L: Lanes> {
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
    fn new(
        lanes: L,
        face: &Face,
        span: &Span,
        quad: &Quad,
        [middle, half]: [L::Floats; 2],
    ) -> Self {
        let at = Middles::new(lanes, face, span);
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

    /// Narrows the interval of a ray along the third axis, where `t` is z times `inverse`, to what is within the
    /// parallelepipeds, and `slack` more along each axis.
    #[inline(always)]
    fn meet(
        &self,
        lanes: L,
        slack: L::Floats,
        inverse: f32,
        near: &mut L::Floats,
        far: &mut L::Floats,
    ) {
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
            let middle = lanes.mul(dot(lanes, across, &self.c), scale);
            let reach = lanes.mul(wide, lanes.abs(scale));
            // What is no number decides nothing.
            *near = lanes.max(lanes.sub(middle, reach), *near);
            *far = lanes.min(lanes.add(middle, reach), *far);
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

/// The middles of a span's children, and half of their sizes, as parameters of the quad.
struct Middles<L: Lanes> {
    u: L::Floats,
    v: L::Floats,
    ru: L::Floats,
    rv: L::Floats,
    ruv: L::Floats,
}

impl<L: Lanes> Middles<L> {
    #[inline(always)]
    fn new(lanes: L, face: &Face, span: &Span) -> Self {
        let (u, ru) = Self::along(lanes, face, span, 0, &COLUMN);
        let (v, rv) = Self::along(lanes, face, span, 1, &ROW);
        let ruv = lanes.mul(ru, rv);
        Self { u, v, ru, rv, ruv }
    }

    #[inline(always)]
    fn along(
        lanes: L,
        face: &Face,
        span: &Span,
        k: usize,
        number: &[i32; LANES],
    ) -> (L::Floats, L::Floats) {
        let number = lanes.load_ints(number);
        let next = lanes.add_ints(number, lanes.ints(1));
        // As `cut`.
        let scale = lanes.ints((span.cells[k] * 65536_usize.div_ceil(span.fan()[k])) as i32);
        let from = lanes.shift_right::<16>(lanes.mul_ints(number, scale));
        let to = lanes.shift_right::<16>(lanes.mul_ints(next, scale));
        let (from, to) = (lanes.to_floats(from), lanes.to_floats(to));
        let share = face.share[k];
        let half = lanes.floats(0.5 * share);
        let at = lanes.mul(lanes.add(from, to), half);
        (
            lanes.add(at, lanes.floats(span.first[k] as f32 * share)),
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
