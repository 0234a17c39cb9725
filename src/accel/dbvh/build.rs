//! Building: quads, what edges keep, and ranges of heights. Nothing is diced.

use mapped::Large;
use rayon::prelude::*;

use super::block::{Block, Quad};
use super::edges::{self, Plan};
use super::face::{Corner, Face, Patch};
use super::heights::{Heights, Ranges, Source};
use super::part::Part;
use super::shadows::shadows;
use super::source::{displaced, heights, look_up, range, source};
use super::{Dbvh, DbvhOptions};
use crate::accel::lattice::{Extent, Lattice, REACH};
use crate::accel::moment::Moment;
use crate::accel::simd::{Body, Isa, LANES, Lanes};
use crate::accel::top::Top;
use crate::error::{Error, Result};
use crate::math::{Bounds3, Vec3};
use crate::surface::{Amount, Displacement, FaceGrid, Rates, Shell, ShellTolerance, Surface, Torn};

/// What boxes are larger by on all sides, steps of the lattice: a few roundings of its largest coordinates.
const MARGIN: f32 = 16.0;

/// Whether faces that differ so compute different points.
fn matters(amount: Option<&Amount>, source: &Source, torn: Torn) -> bool {
    amount.is_some()
        && match source {
            Source::Flat(_) => torn.normals,
            Source::Image(_) => torn.normals || torn.texcoords,
            Source::Kept(_) => true,
        }
}

impl Dbvh {
    /// Builds it. `go_on` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Usage`] of a displacement by vectors.
    pub fn build(
        surface: &Surface,
        rates: &Rates,
        options: &DbvhOptions,
        go_on: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let amount = match surface.displacement() {
            Displacement::None => None,
            Displacement::Scalar(amount) => Some(amount),
            Displacement::Vector(..) => {
                return Err(Error::usage(
                    "dbvh traces displacement along normals, not by vectors",
                    "take another method, such as compact",
                ));
            }
        };
        let base = surface.base();
        let mut source = source(surface, amount);
        let heights = match (options.heights, amount) {
            (Some(heights), _) => heights,
            (None, None) => [0.0; 2],
            (None, Some(amount)) => heights(surface, amount, &source),
        };
        let tolerance = ShellTolerance {
            heights,
            ..options.tolerance
        };
        let shell = Shell::new(surface, rates, &tolerance, Face::fitting);
        let mut faces: Vec<Face> = (shell.grids().iter())
            .map(|grid| diced(surface, rates, grid))
            .collect();
        if !go_on(0.1) {
            return Err(Error::Interrupted);
        }
        if let (Source::Kept(_), Some(amount)) = (&source, amount) {
            source = Source::Kept(look_up(&shell, &mut faces, amount));
        }
        let matters = |torn| matters(amount, &source, torn);
        let plan = Plan::new(base, rates, &shell, matters, &mut faces);
        let range = range(&source);
        let displaced = displaced(amount, range);
        let built_for = [heights[0].min(displaced[0]), heights[1].max(displaced[1])];
        let lattice = lattice(&shell, built_for[0].abs().max(built_for[1].abs()));
        let corners = (0..shell.keys())
            .map(|key| corners(&shell, key, &lattice))
            .collect();
        let mut tree = Self {
            isa: Isa::best(),
            reach: 0.0,
            left_handed: base.left_handed(),
            st: match &source {
                Source::Image(image) => shell.st().iter().map(|&st| image.place(st)).collect(),
                _ => shell.st().to_vec(),
            },
            heights: Heights {
                source,
                scale: 0.0,
                bias: 0.0,
                code: [0.0, 1.0],
            },
            built_for,
            highest: 0.0,
            lattice,
            faces,
            corners,
            plan,
            kept: Vec::new(),
            top: Top::default(),
            patches: Vec::new(),
            ranges: Large::default(),
            shell: shell.achieved(),
            pixels_per_unit: rates.pixels_per_unit(),
        };
        drop(shell);
        tree.set(amount, range);
        tree.find_flat();
        tree.patch(&|done| go_on(0.2 + 0.8 * done))?;
        Ok(tree)
    }

    /// Takes the scale and the bias of what displaces, with the range of its values, and what follows from them for edges.
    pub(super) fn set(&mut self, amount: Option<&Amount>, range: [f32; 2]) {
        let step = self.lattice.step;
        self.heights.scale = amount.map_or(0.0, |amount| amount.scale / step);
        self.heights.bias = amount.map_or(0.0, |amount| amount.bias / step);
        self.heights.encode(range);
        let [low, high] = range.map(|value| value * self.heights.scale);
        let built_for = self.built_for.map(|height| height / step);
        let all = [low, high, self.heights.bias, built_for[0], built_for[1]];
        self.highest = all.into_iter().map(f32::abs).fold(0.0, f32::max);
        self.kept = self.keep(amount);
        self.measure_slack();
    }

    /// How far kept points are from the vertices that they replace.
    fn measure_slack(&mut self) {
        let this: &Self = self;
        let of_face = |face: usize| {
            let face_of = &this.faces[face];
            if !face_of.has_kept {
                return 0.0;
            }
            let [columns, rows] = face_of.micro_vertices();
            let along_u = (0..columns).flat_map(|i| [[i, 0], [i, rows - 1]]);
            let along_v = (0..rows).flat_map(|j| [[0, j], [columns - 1, j]]);
            let mut most = 0.0_f32;
            for at in along_u.chain(along_v) {
                let kept = face_of.kept(at);
                if kept == super::face::NONE {
                    continue;
                }
                let [(qi, i), (qj, j)] = [0, 1].map(|k| {
                    let n = usize::from(face_of.cells[k]);
                    let quad = (at[k] / n).min(usize::from(face_of.quads[k]) - 1);
                    (quad as u16, at[k] - quad * n)
                });
                for key in 0..this.keys() as usize {
                    let moment = at_key(key);
                    let own = this.own_vertex(face, [qi, qj], [i, j], &moment);
                    let point = this.kept_point(kept, &moment);
                    most = most.max(Vec3::from(own).distance(Vec3::from(point)));
                }
            }
            most * (1.0 + 1e-5) + MARGIN
        };
        let slacks: Vec<f32> = (0..self.faces.len()).into_par_iter().map(of_face).collect();
        for (face, slack) in self.faces.iter_mut().zip(slacks) {
            face.slack = slack;
        }
    }

    /// Notes which faces are flat, for all heights that it is built for.
    fn find_flat(&mut self) {
        let highest = self.highest;
        let corners = &self.corners;
        self.faces.par_iter_mut().for_each(|face| {
            let [columns, rows] = face.quads;
            let (mut bent, mut finest) = (0.0_f32, f32::MAX);
            for quad in (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j])) {
                for corners in corners {
                    let [a, b, c, d] = face.corners(quad).map(|c| &corners[c]);
                    let p = [a, b, c, d].map(|corner| Vec3::from(corner.p));
                    let n = [a, b, c, d].map(|corner| Vec3::from(corner.n));
                    let twist = |[a, b, c, d]: [Vec3; 4]| (d - c) - (b - a);
                    let turned = (n[1] - n[0]).abs() + (n[2] - n[0]).abs() + twist(n).abs();
                    let off = 0.25 * twist(p).abs() + highest * turned;
                    bent = bent.max(off.max_element());
                    for (k, along) in [p[1] - p[0], p[2] - p[0]].into_iter().enumerate() {
                        finest = finest.min(along.length() / f32::from(face.cells[k]));
                    }
                }
            }
            // Next to nothing of a micro-quad.
            face.is_flat = 32.0 * bent <= finest;
            face.bent = bent;
        });
    }

    /// Cuts quads into patches, and puts these into a tree.
    fn patch(&mut self, go_on: &dyn Fn(f64) -> bool) -> Result<()> {
        let mut patches = Vec::new();
        for (number, face) in (0..).zip(&self.faces) {
            let [columns, rows] = face.quads;
            let pieces = face.pieces().map(|n| n as u16);
            let [across, down] = face.group.map(usize::from);
            let quads = (0..rows)
                .step_by(down)
                .flat_map(|j| (0..columns).step_by(across).map(move |i| [i, j]));
            for quad in quads {
                for piece in (0..pieces[1]).flat_map(|j| (0..pieces[0]).map(move |i| [i, j])) {
                    patches.push(Patch {
                        face: number,
                        quad,
                        piece,
                        ranges: 0,
                    });
                }
            }
        }
        self.patches = patches;
        self.look_at(go_on)?;
        let extents = self.extents();
        let (top, mut order) = Top::new(extents);
        // In the order of the leaves; in place, since there may be very many.
        put_in_order(&mut self.patches, &mut order);
        if self.ranges.len() <= self.patches.len() {
            // And so what they keep, where that is alike.
            order.clear();
            for patch in &mut self.patches {
                if self.faces[patch.face as usize].levels > 0 {
                    let place = order.len() as u32;
                    order.push(std::mem::replace(&mut patch.ranges, place));
                }
            }
            put_in_order(&mut self.ranges, &mut order);
        }
        self.top = top;
        Ok(())
    }

    /// The heights of a patch's largest parts.
    pub(super) fn ranges_of(&self, patch: &Patch) -> Ranges {
        if self.faces[patch.face as usize].levels == 0 {
            Ranges::new(&[patch.ranges; LANES], 1)
        } else {
            self.ranges[patch.ranges as usize]
        }
    }

    /// Boxes around all patches by motion key. Notes how far they reach.
    pub(super) fn extents(&mut self) -> Vec<Vec<Extent>> {
        let this: &Self = self;
        let extents: Vec<Vec<Extent>> = (0..self.corners.len())
            .map(|key| {
                let of_patch = |patch: &Patch| this.extent(patch, key);
                this.patches.par_iter().map(of_patch).collect()
            })
            .collect();
        let all = extents.iter().flatten().copied();
        let all = all.fold(Extent::EMPTY, Extent::union);
        self.reach = if all.is_empty() {
            0.0
        } else {
            let largest = (0..3).map(|k| all.min[k].abs().max(all.max[k].abs()));
            largest.max().unwrap_or(0) as f32
        };
        extents
    }

    /// A box around a patch.
    fn extent(&self, patch: &Patch, key: usize) -> Extent {
        let face = &self.faces[patch.face as usize];
        let ranges = self.ranges_of(patch);
        let root = face.root(patch);
        let part = (root.level > 0).then_some(root);
        let (there, is_border) = match &part {
            Some(part) => (face.there(part), face.on_border(patch, part) != 0),
            None => {
                let block = Block::new(self, patch, &face.span(patch, root.at));
                (1, block.is_border())
            }
        };
        let kept = if face.has_kept && is_border {
            face.slack
        } else {
            0.0
        };
        let mut extent = Extent::EMPTY;
        let [columns, rows] = face.count(patch.quad).map(|n| n as u16);
        for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
            let quad = [patch.quad[0] + i, patch.quad[1] + j];
            let boxes = self.isa.run(BoxesOf {
                tree: self,
                face,
                quad,
                part,
                ranges: &ranges,
                key,
            });
            for c in (0..LANES).filter(|c| there >> c & 1 == 1) {
                let reach = |k: usize| boxes[3 + k][c] + kept + MARGIN;
                // All that there is lies within half of the lattice, and some roundings.
                const MOST: f32 = (REACH / 2 + (REACH >> 8)) as f32;
                let end = |k: usize, sign: f32| (boxes[k][c] + sign * reach(k)).clamp(-MOST, MOST);
                extent = extent
                    .including([0, 1, 2].map(|k| end(k, -1.0).floor() as i32))
                    .including([0, 1, 2].map(|k| end(k, 1.0).ceil() as i32));
            }
        }
        extent
    }
}

/// Puts what is numbered `order[i]` in place `i`. The numbers are used up.
fn put_in_order<T>(all: &mut [T], order: &mut [u32]) {
    for start in 0..order.len() {
        let mut place = start;
        loop {
            let from = std::mem::replace(&mut order[place], place as u32) as usize;
            if from == start || from == place {
                break;
            }
            all.swap(place, from);
            place = from;
        }
    }
}

/// The moment of a motion key.
pub(super) fn at_key(key: usize) -> Moment {
    Moment {
        from: key,
        to: key,
        weights: [1.0, 0.0],
    }
}

/// How many micro-quads a face's quads have: what its rates come to, rounded.
fn diced(surface: &Surface, rates: &Rates, grid: &FaceGrid) -> Face {
    let within = rates.face(grid.face);
    let cells = [0, 1].map(|k| Face::cells(u32::from(grid.size[k]), within[k]));
    edges::face(surface.base(), grid, cells)
}

/// Around the shell with everything that heights may add.
fn lattice(shell: &Shell, highest: f32) -> Lattice {
    let points = (0..shell.keys()).flat_map(|key| shell.points(key));
    let bounds = Bounds3::of(points.map(|point| point.position));
    let bounds = if bounds.is_empty() {
        bounds
    } else {
        Bounds3 {
            min: bounds.min - highest,
            max: bounds.max + highest,
        }
    };
    Lattice::around(&bounds, 0.0)
}

fn corners(shell: &Shell, key: u32, lattice: &Lattice) -> Vec<Corner> {
    let corner = |point: &crate::surface::ShellPoint| Corner {
        p: ((point.position - lattice.anchor) * (1.0 / lattice.step)).to_array(),
        n: point.normal.to_array(),
    };
    shell.points(key).iter().map(corner).collect()
}

/// Boxes around a part's children, or around a whole quad, at a motion key: centres and half of their sizes.
struct BoxesOf<'a> {
    tree: &'a Dbvh,
    face: &'a Face,
    quad: [u16; 2],
    part: Option<Part>,
    ranges: &'a Ranges,
    key: usize,
}

impl Body for BoxesOf<'_> {
    type Output = [[f32; LANES]; 6];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [[f32; LANES]; 6] {
        let Self { tree, face, .. } = self;
        let quad = Quad::new(tree.corners_at(face.corners(self.quad), &at_key(self.key)));
        let heights = tree.heights.ranges(lanes, self.ranges);
        let boxes = shadows(lanes, (face, self.part.as_ref()), &quad, heights);
        let mut out = [[0.0; LANES]; 6];
        for (out, of) in out.iter_mut().zip(boxes) {
            lanes.store(of, out);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::put_in_order;
    use crate::surface::tests::shapes::Random;

    #[test]
    fn all_come_to_their_places() {
        let mut random = Random(4);
        for count in 0..40_usize {
            let mut order: Vec<u32> = (0..count as u32).collect();
            order.sort_by_cached_key(|_| (1e6 * random.next()) as u32);
            let wanted = order.clone();
            let mut all: Vec<u32> = (0..count as u32).collect();
            put_in_order(&mut all, &mut order);
            assert_eq!(all, wanted);
        }
    }
}
