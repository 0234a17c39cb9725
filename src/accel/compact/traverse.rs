//! One ray through the trees: the body that each instruction set gets compiled.

use super::block::{CELLS, Head, SHEAR_POINT, SIDE, SLOPE_POINT};
use super::patch::{Fan, Node};
use super::skeleton::Skeleton;
use crate::accel::Hit;
use crate::accel::boxes::Boxes;
use crate::accel::lattice::LatticeRay;
use crate::accel::moment::Moment;
use crate::accel::quads::{QuadHit, Sheared};
use crate::accel::simd::{Isa, LANES, Lanes, NARROW};
use crate::accel::traversal::Traversal;
use crate::accel::triangle::TriangleHit;
use crate::accel::waiting::{Place, Stack, Waiting};
use crate::math::Ray;

/// Where a ray met a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::accel) struct Met {
    pub(super) hit: TriangleHit,
    pub(in crate::accel) patch: u32,
    /// The block in the patch.
    pub(super) block: usize,
    /// The quad in the block, whose rows are [`SIDE`] apart, and whether it is its second triangle.
    pub(super) cell: usize,
    pub(super) second: bool,
    /// Its corners on the lattice, if the nearest hit was asked for.
    pub(super) corners: [[f32; 3]; 3],
}

/// A patch's nodes, by motion key, and its blocks.
#[derive(Clone, Copy)]
pub(in crate::accel) struct View<'v> {
    /// None if there is a single block.
    pub(in crate::accel) nodes: &'v [Node],
    pub(in crate::accel) data: &'v [u8],
    /// The byte at which the single block starts.
    pub(in crate::accel) start: usize,
    pub(in crate::accel) fan: Fan,
}

impl View<'_> {
    /// The head of a block at a motion key.
    #[inline(always)]
    pub(in crate::accel) fn head(&self, block: usize, key: usize) -> Head {
        let at = match self.nodes.get(key) {
            Some(node) => node.block(block),
            None => self.start,
        };
        Head::read(self.data, at, self.fan.cells_of(block).map(|n| n + 1))
    }
}

/// Where patches come from.
pub(in crate::accel) trait Patches<'s> {
    /// What is there without entering any.
    fn skeleton(&self) -> &'s Skeleton;
    /// A patch, until the next one is entered.
    fn enter(&mut self, number: u32) -> View<'_>;
}

/// A surface whose patches come from anywhere.
pub(in crate::accel) struct Through<P>(pub(in crate::accel) P);

impl<'s, P: Patches<'s>> Traversal for Through<P> {
    type Met = Met;

    #[inline(always)]
    fn isa(&self) -> Isa {
        self.0.skeleton().isa
    }

    #[inline(always)]
    fn moves(&self) -> bool {
        self.0.skeleton().keys > 1
    }

    #[inline(always)]
    fn hit<L: Lanes, const MOVES: bool>(&mut self, _lanes: L, ray: &Ray, met: &Met) -> Hit {
        self.0.skeleton().hit(ray, met)
    }

    #[inline(always)]
    fn meet<L: Lanes, const ANY: bool, const MOVES: bool>(
        &mut self,
        lanes: L,
        ray: &Ray,
    ) -> Option<Met> {
        let Self(patches) = self;
        let skeleton = patches.skeleton();
        let root = skeleton.top.root()?;
        let moment = Moment::new(skeleton.keys, ray.time);
        let mut walk = Walk::<MOVES> {
            moment: &moment,
            world: *ray,
            ray: LatticeRay::new(&skeleton.lattice, ray, skeleton.reach),
        };
        let mut nearest = None;
        let mut near = [0.0; LANES];
        // Cleared once: what a block leaves in it counts for no other.
        let mut room = Sheared::default();
        let mut stack = Stack::default();
        let mut next = Some(Waiting::child(0.0, root));
        while let Some(at) = next {
            next = match at.place() {
                Place::Node(node) => {
                    let (moment, ray) = (walk.moment, &walk.ray);
                    (skeleton.top).enter::<L, MOVES>(lanes, node, moment, ray, &mut stack)
                }
                Place::Patch(patch) => {
                    let view = patches.enter(patch);
                    let mut part = if view.nodes.is_empty() {
                        Some(Waiting::part(at.near(), 0))
                    } else {
                        let hits = walk.blocks(lanes, &view, &mut near);
                        stack.add(hits, |c| Waiting::part(near[c], c))
                    };
                    // All of its blocks before any other patch.
                    while let Some(Place::Part(block)) = part.map(Waiting::place) {
                        let found = walk.block::<L, ANY>(lanes, &view, block, &mut room);
                        if let Some(found) = found {
                            nearest = Some(Met { patch, ..found });
                            if ANY {
                                return nearest;
                            }
                            walk.world.t_max = found.hit.t;
                            walk.ray.end(found.hit.t);
                        }
                        part = stack.next_part(walk.ray.t_max);
                    }
                    None
                }
                // Met within their patches alone.
                Place::Part(_) => None,
            };
            if next.is_none() {
                next = stack.next(walk.ray.t_max);
            }
        }
        nearest
    }
}

struct Walk<'a, const MOVES: bool> {
    moment: &'a Moment,
    /// The ray as it was given, and on the lattice; both end at the nearest hit so far.
    world: Ray,
    ray: LatticeRay,
}

/// Columns and rows of the lanes of two rows.
const COLUMNS: [i32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7];
const ROWS: [i32; LANES] = [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1];

impl<const MOVES: bool> Walk<'_, MOVES> {
    /// The blocks of a patch that the ray meets, as bits, and where it enters each.
    #[inline(always)]
    fn blocks<L: Lanes>(&self, lanes: L, view: &View<'_>, entries: &mut [f32; LANES]) -> u32 {
        let at = |key: usize| &view.nodes[key].boxes;
        let boxes = [at(self.moment.from), at(self.moment.to)];
        self.met(lanes, boxes, entries) & view.fan.there()
    }

    #[inline(always)]
    fn met<L: Lanes>(&self, lanes: L, [from, to]: [&Boxes; 2], entries: &mut [f32; LANES]) -> u32 {
        if MOVES {
            from.met_on_the_way(to, self.moment, lanes, &self.ray, entries)
        } else {
            from.met(lanes, &self.ray, entries)
        }
    }

    /// The nearest triangle of a block. There is room for its vertices.
    #[inline(always)]
    fn block<L: Lanes, const ANY: bool>(
        &self,
        lanes: L,
        view: &View<'_>,
        block: usize,
        sheared: &mut Sheared,
    ) -> Option<Met> {
        let cells = view.fan.cells_of(block);
        let head = view.head(block, self.moment.from);
        let mut later = head;
        if MOVES {
            later = view.head(block, self.moment.to);
        }
        let heads = [&head, &later];
        self.decode(lanes, view.data, heads, cells, sheared);
        let interval = [self.world.t_min, self.world.t_max];
        let QuadHit { hit, cell, second } =
            sheared.nearest(lanes, cells, self.ray.s[2], interval)?;
        let corners = if ANY {
            [[0.0; 3]; 3]
        } else {
            self.corners(lanes, view.data, heads, cells[0], (cell, second))
        };
        Some(Met {
            hit,
            patch: 0,
            block,
            cell,
            second,
            corners,
        })
    }

    /// The corners of a triangle on the lattice, where they are at the ray's time.
    #[inline(always)]
    fn corners<L: Lanes>(
        &self,
        lanes: L,
        data: &[u8],
        [head, later]: [&Head; 2],
        columns: usize,
        (cell, second): (usize, bool),
    ) -> [[f32; 3]; 3] {
        let (column, row) = (cell % SIDE, cell / SIDE);
        let axes = [0, 1, 2];
        let mut planes = Planes::<L, UNKNOWN>::new(lanes, head, axes, columns, row);
        let mut at = planes.next(lanes, data, [row, row + 1]);
        if MOVES {
            let mut planes = Planes::<L, UNKNOWN>::new(lanes, later, axes, columns, row);
            let to = planes.next(lanes, data, [row, row + 1]);
            at = self.between(lanes, at, to);
        }
        let mut stored = [[0.0; LANES]; 3];
        for (stored, at) in stored.iter_mut().zip(at) {
            lanes.store(at, stored);
        }
        let [x, y, z] = &stored;
        let corner = |c: usize| [x[column + c], y[column + c], z[column + c]];
        if second {
            [corner(SIDE + 1), corner(SIDE), corner(1)]
        } else {
            [corner(0), corner(1), corner(SIDE)]
        }
    }

    /// Between two motion keys, axis by axis.
    #[inline(always)]
    fn between<L: Lanes>(
        &self,
        lanes: L,
        from: [L::Floats; 3],
        to: [L::Floats; 3],
    ) -> [L::Floats; 3] {
        [
            self.moment.between_lanes(lanes, from[0], to[0]),
            self.moment.between_lanes(lanes, from[1], to[1]),
            self.moment.between_lanes(lanes, from[2], to[2]),
        ]
    }

    /// Decodes a block's vertices, and shears them.
    #[inline(always)]
    fn decode<L: Lanes>(
        &self,
        lanes: L,
        data: &[u8],
        heads: [&Head; 2],
        cells: [usize; 2],
        to: &mut Sheared,
    ) {
        // Of each place of the main axis a loop of its own, which knows it; at two motion keys there may be two.
        if MOVES {
            return self.decode_along::<L, UNKNOWN>(lanes, data, heads, cells, to);
        }
        let main = heads[0].main;
        if main == self.ray.k[0] {
            self.decode_along::<L, 0>(lanes, data, heads, cells, to);
        } else if main == self.ray.k[1] {
            self.decode_along::<L, 1>(lanes, data, heads, cells, to);
        } else {
            self.decode_along::<L, 2>(lanes, data, heads, cells, to);
        }
    }

    #[inline(always)]
    fn decode_along<L: Lanes, const MAIN: usize>(
        &self,
        lanes: L,
        data: &[u8],
        [head, later]: [&Head; 2],
        [columns, rows]: [usize; 2],
        to: &mut Sheared,
    ) {
        let LatticeRay { k, origin, s, .. } = self.ray;
        let mut planes = Planes::<L, MAIN>::new(lanes, head, k, columns, 0);
        let mut of_later = planes;
        if MOVES {
            of_later = Planes::new(lanes, later, k, columns, 0);
        }
        let origin = k.map(|k| lanes.floats(origin[k]));
        let [sx, sy] = [lanes.floats(s[0]), lanes.floats(s[1])];
        for pair in 0..rows / 2 + 1 {
            let two = [2 * pair, (2 * pair + 1).min(rows)];
            let mut at = planes.next(lanes, data, two);
            if MOVES {
                let to = of_later.next(lanes, data, two);
                at = self.between(lanes, at, to);
            }
            let x = lanes.sub(at[0], origin[0]);
            let y = lanes.sub(at[1], origin[1]);
            let z = lanes.sub(at[2], origin[2]);
            lanes.store(lanes.sub(x, lanes.mul(sx, z)), &mut to.x[pair]);
            lanes.store(lanes.sub(y, lanes.mul(sy, z)), &mut to.y[pair]);
            lanes.store(z, &mut to.z[pair]);
        }
    }
}

/// Stands for a place of the main axis that is known no sooner than the head.
const UNKNOWN: usize = 3;

/// A block's prediction, two rows at a time, with the axes in the ray's order, among which the main one is at place `MAIN`.
#[derive(Clone, Copy)]
struct Planes<L: Lanes, const MAIN: usize> {
    fields: [Fields; 3],
    /// Whether the rows have all their vertices.
    full: bool,
    /// All bits of the main axis, none of the others: its fields are the heights.
    main: [L::Ints; 3],
    shear: [L::Ints; 3],
    at: [L::Ints; 3],
    /// From two rows to the next two.
    step: [L::Ints; 3],
}

/// An axis's rows: where the first one starts, how far they are apart, and bits of a field.
#[derive(Clone, Copy)]
struct Fields {
    start: usize,
    stride: usize,
    width: u32,
}

impl<L: Lanes, const MAIN: usize> Planes<L, MAIN> {
    #[inline(always)]
    fn new(lanes: L, head: &Head, k: [usize; 3], columns_there: usize, first_row: usize) -> Self {
        let (columns, rows) = (lanes.load_ints(&COLUMNS), lanes.load_ints(&ROWS));
        let rows = lanes.add_ints(rows, lanes.ints(first_row as i32));
        let axes = k.map(|k| head.axes[k]);
        let mut at = [columns; 3];
        for (at, axis) in at.iter_mut().zip(&axes) {
            let u = lanes.mul_ints(columns, lanes.ints(axis.du));
            let v = lanes.mul_ints(rows, lanes.ints(axis.dv));
            let plane = lanes.add_ints(u, v);
            *at = lanes.add_ints(lanes.ints(axis.base << SLOPE_POINT), plane);
        }
        Self {
            fields: k.map(|k| Fields {
                start: head.rows[k],
                stride: head.strides[k],
                width: head.axes[k].width,
            }),
            full: columns_there == CELLS,
            main: k.map(|k| lanes.ints(-i32::from(k == head.main))),
            shear: axes.map(|axis| lanes.ints(axis.shear)),
            at,
            step: axes.map(|axis| lanes.ints(2 * axis.dv)),
        }
    }

    /// The next two rows of vertices, which are the given ones, on the lattice.
    #[inline(always)]
    fn next(&mut self, lanes: L, data: &[u8], rows: [usize; 2]) -> [L::Floats; 3] {
        let fields = [
            self.fields(lanes, data, rows, 0),
            self.fields(lanes, data, rows, 1),
            self.fields(lanes, data, rows, 2),
        ];
        let heights = if MAIN == UNKNOWN {
            let a = lanes.and_ints(fields[0], self.main[0]);
            let b = lanes.and_ints(fields[1], self.main[1]);
            let c = lanes.and_ints(fields[2], self.main[2]);
            lanes.add_ints(lanes.add_ints(a, b), c)
        } else {
            fields[MAIN]
        };
        let mut out = [lanes.floats(0.0); 3];
        for k in 0..3 {
            let plane = lanes.shift_right::<SLOPE_POINT>(self.at[k]);
            self.at[k] = lanes.add_ints(self.at[k], self.step[k]);
            let mut all = lanes.add_ints(plane, fields[k]);
            // The main axis has no shear.
            if k != MAIN {
                let shear = lanes.mul_ints(heights, self.shear[k]);
                all = lanes.add_ints(all, lanes.shift_right::<SHEAR_POINT>(shear));
            }
            out[k] = lanes.to_floats(all);
        }
        out
    }

    #[inline(always)]
    fn fields(&self, lanes: L, data: &[u8], [a, b]: [usize; 2], k: usize) -> L::Ints {
        let Fields {
            start,
            stride,
            width,
        } = self.fields[k];
        // Rows of eight follow each other without a gap.
        if self.full && width <= NARROW {
            return lanes.narrow_fields(data, start + a * stride, width);
        }
        lanes.fields(data, [start + a * stride, start + b * stride], width)
    }
}
