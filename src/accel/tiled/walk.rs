//! One ray through the tree over quads, their prisms, the tiles in them and what these hold: the body that each instruction
//! set gets compiled.

use arrayvec::ArrayVec;

use super::Tiled;
use super::bent::{Bent, Chord, beyond_root};
use super::tile::{Placed, Straight, Tile};
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::prism::{Parts, Sheared, Span, cross, of_half};
use crate::accel::simd::{LANES, Lanes};
use crate::accel::traversal::{Found, Visitor, Way, visit};
use crate::accel::waiting::{Stack, Waiting};
use crate::math::{DVec3, Ray, Vec3, first_cubic_root};

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

pub(in crate::accel) struct Walk<'a, const ANY: bool, const MOVES: bool> {
    of: &'a Tiled,
    moment: &'a Moment,
    sheared: Sheared,
    /// What is asked about; it ends at the nearest hit so far.
    t: [f64; 2],
    /// On the lattice; it ends there, too.
    ray: LatticeRay,
}

impl<const ANY: bool, const MOVES: bool> Visitor<MOVES> for Walk<'_, ANY, MOVES> {
    type Met = Met;

    #[inline(always)]
    fn way(&self) -> Way<'_> {
        Way {
            top: &self.of.top,
            moment: self.moment,
            ray: &self.ray,
        }
    }

    #[inline(always)]
    fn patch<L: Lanes>(
        &mut self,
        lanes: L,
        patch: u32,
        _near: f32,
        _stack: &mut Stack,
    ) -> Found<Met> {
        let met = self.quad(lanes, patch);
        if let Some(met) = &met {
            self.ray.end(met.t);
        }
        met.into()
    }
}

/// A part of a ray in a prism, and the chord that it is near.
struct Passage<'a> {
    /// The prism: a quad, and which of its triangles.
    quad: u32,
    half: usize,
    span: &'a Span,
    part: &'a Bent,
    chord: Chord,
    /// The chord across its way, wherever it starts, and by how much boxes are larger on the tile's lattice.
    straight: Straight,
    wider: [f32; 3],
}

/// The way through a tile, whose number is `tile`, from one place of a chord to another.
struct InTile<'a> {
    of: &'a Tile,
    passage: &'a Passage<'a>,
    tile: [f64; 2],
    /// Where the chord's part in the tile begins, in the tile, and how far along the chord that is.
    origin: Vec3,
    enter: f64,
    /// What is asked about, of the ray's own t.
    t: [f64; 2],
    ray: LatticeRay,
}

/// Chords are cut while the ray may be farther off than this part of a tile's side or of its height.
const NEAR: f64 = 1.0 / 128.0;

/// How often a span is halved at most.
const MOST_HALVINGS: usize = 8;

/// Beyond the edge of a triangle, relative to its size: so much is rounding.
const ROUNDING: f64 = 1e-9;

impl<'a, const ANY: bool, const MOVES: bool> Walk<'a, ANY, MOVES> {
    /// A ray at the root.
    #[inline(always)]
    pub(super) fn new(of: &'a Tiled, moment: &'a Moment, ray: &Ray) -> Self {
        Self {
            of,
            moment,
            sheared: Sheared::new(ray),
            t: [ray.t_min.into(), ray.t_max.into()],
            ray: LatticeRay::new(&of.lattice, ray, of.reach),
        }
    }

    /// The nearest hit in the prisms over a quad.
    #[inline(always)]
    fn quad<L: Lanes>(&mut self, lanes: L, number: u32) -> Option<Met> {
        let quad = self.of.quads[number as usize];
        let corners = self.of.corners(&quad, self.moment);
        let heights = [-super::MARGIN, 1.0 + super::MARGIN];
        let mut parts = Parts::new([self.t[0] as f32, self.t[1] as f32]);
        let poles = cross(
            lanes,
            &mut parts,
            &self.sheared,
            &corners,
            heights,
            quad.may_fold(),
        );
        if parts.all.is_empty() {
            return None;
        }
        let uvs = self.of.uvs(&quad);
        let mut nearest = None;
        while let Some(&(span, half)) = parts.next(self.t[1] as f32) {
            let bent = Bent::new(&span, of_half(&poles, half), &uvs[half]);
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
        (quad, half): (u32, usize),
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
            let off = DVec3::from(chord.off);
            let passage = Passage {
                quad,
                half,
                span,
                part: &part,
                straight: Straight::new(DVec3::from(chord.along).as_vec3(), off.as_vec3()),
                wider: (off / self.of.tile.lattice.step()).as_vec3().to_array(),
                chord,
            };
            let met = self.chord(lanes, &passage);
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
    fn chord<L: Lanes>(&mut self, lanes: L, passage: &Passage<'_>) -> Option<Met> {
        let chord = &passage.chord;
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
                        if let Some(met) = self.tile(lanes, passage, tile, [enter, leave]) {
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
        passage: &Passage<'_>,
        number: [f64; 2],
        [enter, leave]: [f64; 2],
    ) -> Option<Met> {
        let tile = &self.of.tile;
        let (from, along) = (
            DVec3::from(passage.chord.from),
            DVec3::from(passage.chord.along),
        );
        let [i, j] = number;
        let origin = (from + enter * along - DVec3::new(i, j, 0.0)).as_vec3();
        let ray = Ray {
            t_max: (leave - enter) as f32,
            ..Ray::new(origin, along.as_vec3(), 0.0)
        };
        let mut in_tile = InTile {
            of: tile,
            passage,
            tile: number,
            origin,
            enter,
            t: self.t,
            ray: LatticeRay::new(&tile.lattice, &ray, tile.reach),
        };
        in_tile.ray.widen(passage.wider);
        in_tile.ray.end(ray.t_max.min(in_tile.place(self.t[1])));
        let met = visit::<L, _, ANY, false>(lanes, tile.top.root()?, &mut in_tile);
        self.t = in_tile.t;
        met
    }
}

impl Visitor<false> for InTile<'_> {
    type Met = Met;

    #[inline(always)]
    fn way(&self) -> Way<'_> {
        Way {
            top: &self.of.top,
            moment: &Moment::STILL,
            ray: &self.ray,
        }
    }

    #[inline(always)]
    fn node<L: Lanes>(&mut self, lanes: L, node: u32, stack: &mut Stack) -> Option<Waiting> {
        let node = self.of.top.node(node, 0);
        let mut near = [0.0; LANES];
        let met = node.boxes.met(lanes, &self.ray, &mut near) & ((1 << node.children()) - 1);
        let met = (self.of).passed(lanes, node, met, &self.passage.straight, self.origin);
        stack.add(met, |c| Waiting::child(near[c], node.child(c)))
    }

    #[inline(always)]
    fn patch<L: Lanes>(
        &mut self,
        _lanes: L,
        patch: u32,
        _near: f32,
        _stack: &mut Stack,
    ) -> Found<Met> {
        let Some((t, s)) = self.triangle(self.of.placed[patch as usize]) else {
            return Found::Next(None);
        };
        self.t[1] = t;
        self.ray.end(self.place(t));
        let (weights, w) = weights(self.passage.span, s);
        Found::Met(Met {
            t: t as f32,
            quad: self.passage.quad,
            half: self.passage.half,
            weights,
            w,
            placed: patch,
        })
    }
}

impl InTile<'_> {
    /// How far along the chord the ray is at its own t, from where this begins.
    #[inline(always)]
    fn place(&self, t: f64) -> f32 {
        let [from, to] = self.passage.chord.t;
        ((t - from) / (to - from) - self.enter) as f32
    }

    /// Where a part of a ray first meets a triangle within the interval: its own t, and how far on the way through the prism
    /// that is.
    #[inline(always)]
    fn triangle(&self, placed: Placed) -> Option<(f64, f64)> {
        let (part, [i, j]) = (self.passage.part, self.tile);
        let [a, b, c] = self.of.corners(placed);
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
