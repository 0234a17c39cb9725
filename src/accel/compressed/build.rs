//! Building: bands of a face are diced, boxed and forgotten.
//!
//! A band is some rows of the lowest nodes. Bands are made in parallel, a batch at a time, and joined in order: the
//! bytes are the same for any number of threads, and beside the result only a batch's bands and one band of vertices a
//! thread exist.

use std::collections::HashMap;

use rayon::prelude::*;

use super::frame::Frame;
use super::node::Node;
use super::shape::{FAN, Shape};
use super::{Compressed, CompressedOptions, Face, first_quad, leaves};
use crate::accel::simd::{Isa, LANES};
use crate::error::{Error, Result};
use crate::math::{Bounds3, Vec3};
use crate::surface::{FaceGrid, Rates, Scratch, SharedSamples, Surface};

/// Bands that are in work at once.
const BATCH: usize = 256;

/// Rows of the lowest nodes in a band: the last row of a band's vertices is the first one of the next.
const ROWS: usize = 4;

/// A node, and what it encloses.
type Built = (Node, Bounds3);

/// Where a band lies.
#[derive(Clone, Copy)]
struct Place {
    grid: usize,
    key: u32,
    band: usize,
}

/// A face to be built.
struct Grid {
    grid: FaceGrid,
    frame: Frame,
    leaves: [u16; 2],
}

impl Compressed {
    /// Dices and compresses all faces. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if stopped, [`Error::Memory`] beyond 2^32 nodes.
    pub fn build(
        surface: &Surface,
        rates: &Rates,
        options: &CompressedOptions,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let base = surface.base();
        let shared: Vec<SharedSamples> = (0..base.keys())
            .map(|key| SharedSamples::new(surface, rates, key))
            .collect();
        let faces: Vec<u32> = (0..base.faces())
            .filter(|&face| !base.is_hole(face))
            .collect();
        let grids = faces
            .into_par_iter()
            .with_min_len(64)
            .map(|face| {
                let grid = FaceGrid::new(surface, rates, face);
                Grid {
                    grid,
                    frame: Frame::of_face(surface, &shared, face),
                    leaves: grid.size.map(|quads| leaves(quads, options.leaf_quads)),
                }
            })
            .collect();
        Builder {
            surface,
            shared: &shared,
            grids,
            built: Self {
                isa: Isa::best(),
                keys: base.keys(),
                left_handed: base.left_handed(),
                faces: Vec::new(),
                shapes: Vec::new(),
                nodes: Vec::new(),
            },
            shapes: HashMap::new(),
            pending: Vec::new(),
        }
        .run(progress)
    }
}

struct Builder<'a> {
    surface: &'a Surface,
    shared: &'a [SharedSamples],
    grids: Vec<Grid>,
    built: Compressed,
    /// The number of each shape.
    shapes: HashMap<[u16; 2], u32>,
    /// The lowest nodes of the face at hand.
    pending: Vec<Built>,
}

impl Grid {
    /// Columns and rows of the lowest nodes.
    fn nodes(&self) -> [usize; 2] {
        self.leaves.map(|n| usize::from(n).div_ceil(FAN))
    }

    /// The first quad of a leaf.
    fn quad(&self, axis: usize, leaf: usize) -> usize {
        first_quad(leaf, self.leaves[axis].into(), self.grid.size[axis].into())
    }
}

impl Builder<'_> {
    fn run(mut self, progress: &dyn Fn(f64) -> bool) -> Result<Compressed> {
        let mut places = Vec::with_capacity(BATCH);
        let all = self.grids.len();
        self.built.faces.reserve_exact(all);
        for grid in 0..all {
            let bands = self.grids[grid].nodes()[1].div_ceil(ROWS);
            for key in 0..self.built.keys {
                for band in 0..bands {
                    places.push(Place { grid, key, band });
                    if places.len() == BATCH {
                        self.batch(&places)?;
                        places.clear();
                        if !progress(grid as f64 / all as f64) {
                            return Err(Error::Interrupted);
                        }
                    }
                }
            }
        }
        self.batch(&places)?;
        if !progress(1.0) {
            return Err(Error::Interrupted);
        }
        let mut built = self.built;
        built.nodes.shrink_to_fit();
        Ok(built)
    }

    /// Makes some bands in parallel, and joins them.
    fn batch(&mut self, places: &[Place]) -> Result<()> {
        let this: &Self = self;
        let bands: Vec<Vec<Built>> = places
            .par_iter()
            .map_init(
                || (Scratch::default(), Vec::new()),
                |(scratch, points), place| this.band(*place, scratch, points),
            )
            .collect();
        for (place, band) in places.iter().zip(bands) {
            self.join(*place, band);
        }
        if self.built.nodes.len() <= u32::MAX as usize {
            return Ok(());
        }
        Err(Error::Memory {
            message: "one object takes more than 2^32 nodes of compressed boxes".into(),
            help: Some("Raise the dicing rate, or lower the most segments of an edge.".into()),
        })
    }

    fn band(&self, place: Place, scratch: &mut Scratch, points: &mut Vec<Vec3>) -> Vec<Built> {
        let Grid {
            grid,
            frame,
            leaves,
        } = &self.grids[place.grid];
        let this = &self.grids[place.grid];
        let [columns, rows] = leaves.map(usize::from);
        let first_row = ROWS * FAN * place.band;
        let last_row = (first_row + ROWS * FAN).min(rows);
        let (first, last) = (this.quad(1, first_row), this.quad(1, last_row));
        let stride = usize::from(grid.size[0]) + 1;
        points.clear();
        points.resize(stride * (last - first + 1), Vec3::ZERO);
        self.surface.dice_rows(
            grid,
            first as u16..=last as u16,
            place.key,
            &self.shared[place.key as usize],
            scratch,
            points,
        );
        for p in points.iter_mut() {
            *p = frame.point(*p);
        }
        let leaf = |i: usize, j: usize| {
            let (left, right) = (this.quad(0, i), this.quad(0, i + 1));
            let (below, above) = (this.quad(1, j) - first, this.quad(1, j + 1) - first);
            (below..=above).fold(Bounds3::EMPTY, |all, row| {
                let row = &points[stride * row..][left..=right];
                row.iter().fold(all, |all, &p| all.including(p))
            })
        };
        let mut nodes = Vec::with_capacity(ROWS * columns.div_ceil(FAN));
        for (j, i) in (first_row..last_row)
            .step_by(FAN)
            .flat_map(|j| (0..columns).step_by(FAN).map(move |i| (j, i)))
        {
            let mut children = [Bounds3::EMPTY; LANES];
            for (cj, ci) in (0..FAN.min(rows - j))
                .flat_map(|cj| (0..FAN.min(columns - i)).map(move |ci| (cj, ci)))
            {
                children[FAN * cj + ci] = leaf(i + ci, j + cj);
            }
            nodes.push(built(&children));
        }
        nodes
    }

    /// Adds a band. The last one of a face completes its tree.
    fn join(&mut self, place: Place, band: Vec<Built>) {
        let this = &self.grids[place.grid];
        let tree = &mut self.built;
        let number = *self.shapes.entry(this.leaves).or_insert_with(|| {
            tree.shapes.push(Shape::new(this.leaves, true));
            tree.shapes.len() as u32 - 1
        });
        let shape = tree.shapes[number as usize];
        if place.key == 0 && place.band == 0 {
            tree.faces.push(Face {
                frame: this.frame,
                reach: 0.0,
                face: this.grid.face,
                size: this.grid.size,
                segments: this.grid.segments,
                root: tree.nodes.len() as u32,
                shape: number,
            });
        }
        self.pending.extend(band);
        let [columns, rows] = shape.size(1);
        if self.pending.len() < columns * rows {
            return;
        }
        // From the lowest level up; the root is stored first.
        let first = tree.nodes.len();
        tree.nodes
            .resize(first + shape.nodes(), Node::new(&[Bounds3::EMPTY; LANES]));
        let mut level_below = std::mem::take(&mut self.pending);
        for level in 1..=shape.levels() {
            if level > 1 {
                level_below = above(&shape, level, &level_below);
            }
            let start = first + shape.node(level, 0, 0);
            for (to, (node, _)) in tree.nodes[start..].iter_mut().zip(&level_below) {
                *to = *node;
            }
        }
        let (_, all) = level_below[0];
        let face = tree.faces.last_mut().expect("its first band has added it");
        face.reach = all
            .min
            .abs()
            .max(all.max.abs())
            .max_element()
            .max(face.reach);
    }
}

/// The nodes of a level, over those of the level below.
fn above(shape: &Shape, level: usize, below: &[Built]) -> Vec<Built> {
    let [columns, rows] = shape.size(level);
    let stride = shape.size(level - 1)[0];
    let places = (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i)));
    places
        .map(|(j, i)| {
            let mut children = [Bounds3::EMPTY; LANES];
            let [fan, fans] = shape.fan(level, i, j);
            for (cj, ci) in (0..fans).flat_map(|cj| (0..fan).map(move |ci| (cj, ci))) {
                children[FAN * cj + ci] = below[(FAN * j + cj) * stride + FAN * i + ci].1;
            }
            built(&children)
        })
        .collect()
}

fn built(children: &[Bounds3; LANES]) -> Built {
    let all = children.iter().fold(Bounds3::EMPTY, |a, b| a.union(*b));
    (Node::new(children), all)
}
