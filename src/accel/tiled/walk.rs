//! One ray through the tree over quads, their prisms, the tiles in them and what these hold: the body that each instruction
//! set gets compiled.

use arrayvec::ArrayVec;

use super::Tiled;
use super::bent::{Bent, Chord, beyond_root};
use super::tile::{Placed, Straight};
use crate::accel::Hit;
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::prism::{Parts, Sheared, Side, Span, find};
use crate::accel::simd::{Isa, LANES, Lanes};
use crate::accel::traversal::Traversal;
use crate::accel::waiting::{Place, Stack, Waiting};
use crate::math::{DVec3, Ray, first_cubic_root};

/// Where a ray met a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::accel) struct Met {
    pub(super) t: f32,
    pub(super) quad: u32,
    /// Which of the quad's triangles it is over, and the weights of that one's corners.
    pub(super) half: usize,
    pub(super) weights: [f64; 3],
    pub(super) w: f64,
    /// By its place in the tile's tree.
    pub(super) placed: u32,
}

impl Traversal for &Tiled {
    type Met = Met;

    #[inline(always)]
    fn isa(&self) -> Isa {
        self.isa
    }

    #[inline(always)]
    fn moves(&self) -> bool {
        self.keys > 1
    }

    #[inline(always)]
    fn hit<L: Lanes, const MOVES: bool>(&mut self, _lanes: L, ray: &Ray, met: &Met) -> Hit {
        self.hit_on(ray, met)
    }

    #[inline(always)]
    fn meet<L: Lanes, const ANY: bool, const MOVES: bool>(
        &mut self,
        lanes: L,
        ray: &Ray,
    ) -> Option<Met> {
        let of = *self;
        let root = of.top.root()?;
        let moment = Moment::new(of.keys, ray.time);
        let mut walk = Walk::<ANY> {
            of,
            moment: &moment,
            sheared: Sheared::new(ray),
            t: [ray.t_min.into(), ray.t_max.into()],
        };
        let mut on_lattice = LatticeRay::new(&of.lattice, ray, of.reach);
        let mut nearest = None;
        let mut stack = Stack::default();
        let mut next = Some(Waiting::child(0.0, root));
        while let Some(at) = next {
            next = match at.place() {
                Place::Node(node) => {
                    let (moment, ray) = (walk.moment, &on_lattice);
                    (of.top).enter::<L, MOVES>(lanes, node, moment, ray, &mut stack)
                }
                Place::Patch(number) => {
                    if let Some(met) = walk.quad(lanes, number) {
                        nearest = Some(met);
                        if ANY {
                            return nearest;
                        }
                        on_lattice.end(met.t);
                    }
                    None
                }
                Place::Part(_) => None,
            };
            if next.is_none() {
                next = stack.next(on_lattice.t_max);
            }
        }
        nearest
    }
}

struct Walk<'a, const ANY: bool> {
    of: &'a Tiled,
    moment: &'a Moment,
    sheared: Sheared,
    /// What is asked about; it ends at the nearest hit so far.
    t: [f64; 2],
}

/// Chords are cut while the ray may be farther off than this part of a tile's side or of its height.
const NEAR: f64 = 1.0 / 128.0;

/// How often a span is halved at most.
const MOST_HALVINGS: usize = 8;

/// Beyond the edge of a triangle, relative to its size: so much is rounding.
const ROUNDING: f64 = 1e-9;

impl<const ANY: bool> Walk<'_, ANY> {
    /// The nearest hit in the prisms over a quad.
    #[inline(always)]
    fn quad<L: Lanes>(&mut self, lanes: L, number: u32) -> Option<Met> {
        let quad = self.of.quads[number as usize];
        let corners = self.of.corners(&quad, self.moment);
        let a = &self.sheared.pole(corners[0]);
        let b = &self.sheared.pole(corners[1]);
        let c = &self.sheared.pole(corners[2]);
        let d = &self.sheared.pole(corners[3]);
        let heights = [-super::MARGIN, 1.0 + super::MARGIN];
        let diagonal = Side::new(b, c, heights);
        let halves = [[a, b, c], [d, c, b]];
        let sides = [
            [diagonal, Side::new(c, a, heights), Side::new(a, b, heights)],
            [
                diagonal.reversed(),
                Side::new(b, d, heights),
                Side::new(d, c, heights),
            ],
        ];
        let mut parts = Parts::new([self.t[0] as f32, self.t[1] as f32]);
        for half in 0..2 {
            let which = (half, quad.may_fold());
            find(&mut parts, halves[half], sides[half], heights, which);
        }
        if parts.all.is_empty() {
            return None;
        }
        let uvs = self.of.uvs(&quad);
        let mut nearest = None;
        while let Some(&(span, half)) = parts.next(self.t[1] as f32) {
            let bent = Bent::new(&span, halves[half], &uvs[half]);
            let met = self.bent(lanes, bent, (number, half), &span);
            if met.is_some() {
                nearest = met;
                if ANY {
                    break;
                }
            }
        }
        nearest
    }

    /// The nearest hit on a ray in a prism, by its chords.
    #[inline(always)]
    fn bent<L: Lanes>(
        &mut self,
        lanes: L,
        bent: Bent,
        which: (u32, usize),
        span: &Span,
    ) -> Option<Met> {
        let mut waiting: ArrayVec<(Bent, usize), { MOST_HALVINGS + 1 }> = ArrayVec::new();
        waiting.push((bent, 0));
        let mut nearest = None;
        while let Some((part, halvings)) = waiting.pop() {
            let [begin, end] = part.times();
            let is_asked = begin < end && end >= self.t[0] && begin <= self.t[1];
            if !is_asked {
                continue;
            }
            let chord = part.chord();
            let is_near = match &chord {
                Some(chord) => chord.off[0].max(chord.off[1]).max(chord.off[2]) <= NEAR,
                None => false,
            };
            if !is_near && halvings < MOST_HALVINGS {
                let [first, second] = part.halves();
                waiting.push((second, halvings + 1));
                waiting.push((first, halvings + 1));
                continue;
            }
            let Some(chord) = chord.filter(Chord::is_sound) else {
                continue;
            };
            let met = self.chord(lanes, &part, &chord, which, span);
            if met.is_some() {
                nearest = met;
                if ANY {
                    break;
                }
            }
        }
        nearest
    }

    /// The tiles that a chord passes, in its order: column by column along the axis on which it goes farthest, and in
    /// each the tiles across.
    #[inline(always)]
    fn chord<L: Lanes>(
        &mut self,
        lanes: L,
        part: &Bent,
        chord: &Chord,
        which: (u32, usize),
        span: &Span,
    ) -> Option<Met> {
        let major = usize::from(chord.along[1].abs() > chord.along[0].abs());
        let minor = 1 - major;
        let per_t = 1.0 / (chord.t[1] - chord.t[0]);
        let begin = ((self.t[0] - chord.t[0]) * per_t).max(0.0);
        let end = ((self.t[1] - chord.t[0]) * per_t).min(1.0);
        let columns = Steps::new(chord, major, [begin, end]);
        let mut nearest = None;
        let mut column = columns.first;
        loop {
            let [enter, leave] = columns.passed(column, [begin, end]);
            if chord.t[0] + enter * (chord.t[1] - chord.t[0]) > self.t[1] {
                break;
            }
            if enter <= leave {
                let rows = Steps::new(chord, minor, [enter, leave]);
                let mut row = rows.first;
                loop {
                    let [enter, leave] = rows.passed(row, [enter, leave]);
                    if enter <= leave {
                        let mut tile = [column, row];
                        if major == 1 {
                            tile = [row, column];
                        }
                        let passed = (tile, [enter, leave]);
                        if let Some(met) = self.tile(lanes, part, chord, passed, which, span) {
                            nearest = Some(met);
                            if ANY {
                                return nearest;
                            }
                        }
                    }
                    if row == rows.last {
                        break;
                    }
                    row += rows.step;
                }
            }
            if column == columns.last {
                break;
            }
            column += columns.step;
        }
        nearest
    }

    /// The nearest hit in a tile, on its part of a chord.
    #[inline(always)]
    fn tile<L: Lanes>(
        &mut self,
        lanes: L,
        part: &Bent,
        chord: &Chord,
        ([i, j], [enter, leave]): ([f64; 2], [f64; 2]),
        (quad, half): (u32, usize),
        span: &Span,
    ) -> Option<Met> {
        let tile = &self.of.tile;
        let root = tile.top.root()?;
        let (from, along) = (DVec3::from(chord.from), DVec3::from(chord.along));
        let ray = Ray {
            origin: (from + enter * along - DVec3::new(i, j, 0.0)).as_vec3(),
            direction: along.as_vec3(),
            t_min: 0.0,
            t_max: (leave - enter) as f32,
            time: 0.0,
        };
        let duration = chord.t[1] - chord.t[0];
        let mut on_lattice = LatticeRay::new(&tile.lattice, &ray, tile.reach);
        let off = DVec3::from(chord.off);
        on_lattice.widen((off / tile.lattice.step()).as_vec3().to_array());
        let straight = Straight::new(ray.origin, ray.direction, off.as_vec3());
        let ends_at = |t: f64| ((t - chord.t[0]) / duration - enter) as f32;
        on_lattice.end(ray.t_max.min(ends_at(self.t[1])));
        let mut nearest = None;
        let mut stack = Stack::default();
        let mut next = Some(Waiting::child(0.0, root));
        while let Some(at) = next {
            next = match at.place() {
                Place::Node(node) => {
                    let node = tile.top.node(node, 0);
                    let mut near = [0.0; LANES];
                    let met = node.boxes.met(lanes, &on_lattice, &mut near);
                    let met = met & ((1 << node.children()) - 1);
                    let met = tile.passed(lanes, node, met, &straight);
                    stack.add(met, |c| Waiting::child(near[c], node.child(c)))
                }
                Place::Patch(number) => {
                    let placed = tile.placed[number as usize];
                    if let Some((t, s)) = self.triangle(part, placed, [i, j]) {
                        self.t[1] = t;
                        let (weights, w) = weights(span, s);
                        nearest = Some(Met {
                            t: t as f32,
                            quad,
                            half,
                            weights,
                            w,
                            placed: number,
                        });
                        if ANY {
                            return nearest;
                        }
                        on_lattice.end(ends_at(t));
                    }
                    None
                }
                Place::Part(_) => None,
            };
            if next.is_none() {
                next = stack.next(on_lattice.t_max);
            }
        }
        nearest
    }

    /// Where a part of a ray first meets a triangle within the interval: its own t, and how far on the way through the prism
    /// that is.
    #[inline(always)]
    fn triangle(&self, part: &Bent, placed: Placed, [i, j]: [f64; 2]) -> Option<(f64, f64)> {
        let [a, b, c] = self.of.tile.corners(placed);
        let by = DVec3::new(i, j, 0.0);
        let (a, b, c) = (a + by, b + by, c + by);
        let (ab, ac) = (b - a, c - a);
        let n = ab.cross(ac);
        let off = n.dot(a);
        // How far above the triangle's plane, times the denominator.
        let mut above = [0.0; 4];
        let [u, v, w] = &part.uvw;
        for m in 0..4 {
            above[m] = n.x * u[m] + n.y * v[m] + (n.z * w[m] - off * part.d[m]);
        }
        let mut begin = 0.0;
        for _ in 0..3 {
            let root = first_cubic_root(above)?;
            let x = begin + root * (1.0 - begin);
            let (p, t) = part.at(x);
            let p = DVec3::from(p) - a;
            // Weights of b and c times the square of twice the area.
            let area = n.length_squared();
            let (wb, wc) = (n.dot(p.cross(ac)), n.dot(ab.cross(p)));
            let least = -ROUNDING * area;
            let inside = wb >= least && wc >= least && wb + wc <= area - least;
            // As whoever asks will see it.
            let t = f64::from(t as f32);
            if inside && t > self.t[0] && t < self.t[1] {
                let [from, to] = part.s;
                return Some((t, from + x * (to - from)));
            }
            above = beyond_root(&above, root);
            begin = x;
        }
        None
    }
}

/// The weights of a triangle's corners, and the height, so far on the way through its prism.
#[inline(always)]
fn weights(span: &Span, s: f64) -> ([f64; 3], f64) {
    let r = 1.0 - s;
    let mut weights = [0.0; 3];
    let mut sum = 0.0;
    let [from, middle, to] = &span.weights;
    for k in 0..3 {
        weights[k] = r * (r * from[k] + 2.0 * s * middle[k]) + s * s * to[k];
        sum += weights[k];
    }
    for weight in &mut weights {
        *weight /= sum;
    }
    let [from, to] = span.heights;
    (weights, from + s * (to - from))
}

/// The tiles that a chord passes along an axis.
struct Steps {
    first: f64,
    last: f64,
    step: f64,
    from: f64,
    per_along: f64,
    off: f64,
}

impl Steps {
    /// Between two places of the chord.
    #[inline(always)]
    fn new(chord: &Chord, axis: usize, [begin, end]: [f64; 2]) -> Self {
        let (from, along, off) = (chord.from[axis], chord.along[axis], chord.off[axis]);
        let off = off + super::MARGIN;
        let step = if along < 0.0 { -1.0 } else { 1.0 };
        Self {
            first: (from + begin * along - step * off).floor(),
            last: (from + end * along + step * off).floor(),
            step,
            from,
            // Also where it is a zero of either sign.
            per_along: step / along.abs(),
            off,
        }
    }

    /// From where to where on the chord a tile may be passed.
    #[inline(always)]
    fn passed(&self, tile: f64, [begin, end]: [f64; 2]) -> [f64; 2] {
        if self.first == self.last {
            return [begin, end];
        }
        let (low, high) = (tile - self.off, tile + 1.0 + self.off);
        let (mut enter, mut leave) = (low, high);
        if self.step < 0.0 {
            (enter, leave) = (high, low);
        }
        [
            ((enter - self.from) * self.per_along).max(begin),
            ((leave - self.from) * self.per_along).min(end),
        ]
    }
}
