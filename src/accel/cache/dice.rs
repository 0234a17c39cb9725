//! Dicing a patch into what the cache keeps of it.

use std::ops::RangeInclusive;

use segments::Line;

use crate::accel::compact::{Node, PADDING, Patch, SPAN, Skeleton, pack};
use crate::accel::lattice::{Extent, Lattice};
use crate::math::Vec3;
use crate::surface::{FaceGrid, Scratch, SharedSamples, Surface};

/// Lines that a node takes.
pub(super) const LINES_OF_NODE: usize = size_of::<Node>() / size_of::<Line>();

/// Room for a thread to dice in, and what it made last.
#[derive(Default)]
pub(super) struct Room {
    pub(super) work: Work,
    pub(super) lines: Vec<Line>,
}

/// Room to work in.
#[derive(Default)]
pub(super) struct Work {
    scratch: Scratch,
    points: Vec<Vec3>,
    lattice: Vec<[i32; 3]>,
    data: Vec<u8>,
    nodes: Vec<Node>,
}

/// A patch's part of its face.
pub(super) struct Part {
    grid: FaceGrid,
    columns: RangeInclusive<u16>,
    rows: RangeInclusive<u16>,
    has_node: bool,
}

impl Part {
    pub(super) fn new(skeleton: &Skeleton, number: u32) -> Self {
        let patch = &skeleton.patches[number as usize];
        Self {
            has_node: skeleton.has_node(&patch.fan()),
            ..Self::of(skeleton.faces[patch.face as usize].grid(), patch)
        }
    }

    /// The same while there is no skeleton yet.
    pub(super) fn of(grid: FaceGrid, patch: &Patch) -> Self {
        let fan = patch.fan();
        let range = |at: u8, cells: usize| {
            let first = SPAN as u16 * u16::from(at);
            first..=first + cells as u16
        };
        Self {
            columns: range(patch.column, fan.cells[0]),
            rows: range(patch.row, fan.cells[1]),
            has_node: true,
            grid,
        }
    }

    /// Columns and rows of quads.
    fn cells(&self) -> [usize; 2] {
        [&self.columns, &self.rows].map(|range| usize::from(range.end() - range.start()))
    }
}

/// What patches are diced of.
#[derive(Clone, Copy)]
pub(super) struct Dicer<'a> {
    pub(super) surface: &'a Surface,
    /// By motion key.
    pub(super) shared: &'a [SharedSamples],
    pub(super) lattice: Lattice,
}

/// What some vertices enclose, and how far they were moved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub(super) extent: Extent,
    /// Squared distances.
    pub(super) largest: f64,
    pub(super) squares: f64,
    pub(super) vertices: u64,
}

impl Measured {
    pub(super) const NOTHING: Self = Self {
        extent: Extent::EMPTY,
        largest: 0.0,
        squares: 0.0,
        vertices: 0,
    };

    pub(super) fn and(self, other: Self) -> Self {
        Self {
            extent: self.extent.union(other.extent),
            largest: self.largest.max(other.largest),
            squares: self.squares + other.squares,
            vertices: self.vertices + other.vertices,
        }
    }
}

impl Dicer<'_> {
    /// Dices a patch at a motion key, to know what it encloses; none if that is more than the lattice.
    pub(super) fn measure(&self, part: &Part, key: u32, work: &mut Work) -> Option<Measured> {
        if !self.dice(part, key, work) {
            return None;
        }
        let mut measured = Measured::NOTHING;
        for (&p, &to) in work.points.iter().zip(&work.lattice) {
            let off = (self.lattice.position(to) - p.as_dvec3()).length_squared();
            measured = measured.and(Measured {
                extent: Extent::EMPTY.including(to),
                largest: off,
                squares: off,
                vertices: 1,
            });
        }
        Some(measured)
    }

    /// Dices a patch at all motion keys, and packs it.
    pub(super) fn pack(&self, part: &Part, work: &mut Work, lines: &mut Vec<Line>) {
        work.data.clear();
        work.nodes.clear();
        let [columns, rows] = part.cells();
        for key in 0..self.shared.len() {
            self.dice(part, key as u32, work);
            let (node, _) = pack(&work.lattice, columns + 1, [columns, rows], &mut work.data);
            work.nodes.push(node);
        }
        if !part.has_node {
            work.nodes.clear();
        }
        let bytes = work.data.len() + PADDING;
        let first = work.nodes.len() * LINES_OF_NODE;
        lines.clear();
        lines.extend_from_slice(bytemuck::cast_slice(&work.nodes));
        lines.resize(first + bytes.div_ceil(size_of::<Line>()), Line::default());
        let to: &mut [u8] = bytemuck::cast_slice_mut(&mut lines[first..]);
        to[..work.data.len()].copy_from_slice(&work.data);
    }

    /// Dices a patch at a motion key, and rounds it to the lattice. Whether all of it is within reach; what is not, of a
    /// displacement beyond its own bound, is brought there.
    fn dice(&self, part: &Part, key: u32, work: &mut Work) -> bool {
        let [columns, rows] = part.cells();
        work.points.clear();
        work.points.resize((columns + 1) * (rows + 1), Vec3::ZERO);
        let shared = &self.shared[key as usize];
        let ranges = [part.columns.clone(), part.rows.clone()];
        let (scratch, points) = (&mut work.scratch, &mut work.points);
        (self.surface).dice_part(&part.grid, ranges, key, shared, scratch, points);
        let mut all_there = true;
        work.lattice.clear();
        work.lattice.extend(points.iter().map(|&p| {
            self.lattice.nearest(p).unwrap_or_else(|| {
                all_there = false;
                self.lattice.nearest_within(p)
            })
        }));
        all_there
    }
}
