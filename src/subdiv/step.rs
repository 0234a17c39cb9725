//! The ways in which irregular faces split, each worked out once however many faces share it.
//!
//! A face that is not a polynomial patch is refined with its ring. Of its children some are patches, the others are
//! irregular again: at an extraordinary vertex the same step over and over (the self-similarity that Stam,
//! *Exact Evaluation of Catmull-Clark Subdivision Surfaces at Arbitrary Parameter Values*, 1998, diagonalises),
//! next to a semi-sharp crease a few different ones until the sharpness has decayed. Unlike Stam we keep the step
//! itself and repeat it: that serves creases, any valence, and any number of extraordinary vertices alike.
//!
//! Under Chaikin's rule unequal sharpnesses along a crease mix, and no two of its pieces are alike: each of the 2ⁿ
//! pieces of an edge would be a step of its own. After [`UNEQUAL_SPLITS`] such a piece is kept as its ring, and split
//! where it is evaluated: a path to one place has as many splits as the crease lasts levels.
//!
//! Exactly at an extraordinary vertex the limit comes from masks.

use std::collections::HashMap;

use super::corner_limit::{CornerLimit, CornerMask, corner_limits, corner_masks};
use super::crease::is_semi_sharp;
use super::refine::{Source, split, stencils};
use super::regular::{Combination, Regular, recognise};
use super::ring::Ring;
use super::stencils::Stencils;
use crate::mesh::CreaseMethod;

/// Splits of a mesh's face that are worked out beforehand where its pieces are all different. Three serve the creases
/// of moderate sharpness; deeper pieces are slow to evaluate, but each level stored costs twice what the last does.
const UNEQUAL_SPLITS: u32 = 3;

/// One split of a face. Its points are numbered: first the ring's vertices, then the new ones, in order of `rows`.
#[derive(Debug)]
pub(super) struct Step {
    /// How many vertices the ring has.
    pub(super) ring: u32,
    /// Each new point in terms of points before it.
    pub(super) rows: Stencils,
    /// The face's children: four, or one for each corner of a face that is not a quad.
    pub(super) children: Vec<Shape>,
    /// For each corner of the face the exact limit, where it is an extraordinary vertex that this step repeats.
    pub(super) limits: Vec<Option<CornerLimit>>,
    /// For each corner what it is taken for where refinement stops.
    pub(super) masks: Vec<Option<CornerMask>>,
    /// The ring, where the split is put off until it is evaluated: all but its size is empty then.
    put_off: Option<Box<Ring>>,
}

/// What a face is: a patch, or something to be split.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    /// A polynomial patch over these points.
    Patch(Vec<u32>),
    /// See [`Regular::Strip`].
    Strip {
        points: Vec<u32>,
        edge: usize,
        sharpness: f32,
    },
    /// To be split, with this ring.
    Split { step: u32, ring: Vec<u32> },
}

/// All steps of a surface, by the key of their ring.
#[derive(Debug, Default)]
pub(super) struct Steps {
    numbers: HashMap<Vec<u32>, u32>,
    steps: Vec<Step>,
}

impl Steps {
    /// A step by its number.
    pub(super) fn get(&self, number: u32) -> &Step {
        &self.steps[number as usize]
    }

    /// What a face is that was split `splits` times to give this ring. `points` are the numbers of the ring's
    /// vertices; `combine` makes a new point.
    pub(super) fn shape(
        &mut self,
        ring: &Ring,
        splits: u32,
        points: &[u32],
        combine: &mut dyn FnMut(Combination) -> u32,
    ) -> Shape {
        let mut number = |combination: Combination| match combination.as_slice() {
            &[(vertex, 1.0)] => points[vertex as usize],
            terms => combine(
                terms
                    .iter()
                    .map(|&(i, w)| (points[i as usize], w))
                    .collect(),
            ),
        };
        match recognise(ring) {
            Some(Regular::Patch(slots)) => Shape::Patch(slots.into_iter().map(number).collect()),
            Some(Regular::Strip {
                points,
                edge,
                sharpness,
            }) => Shape::Strip {
                points: points.into_iter().map(&mut number).collect(),
                edge,
                sharpness,
            },
            None => Shape::Split {
                step: self.number(ring, splits),
                ring: points.to_vec(),
            },
        }
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        let shape = |shape: &Shape| match shape {
            Shape::Patch(points) | Shape::Strip { points, .. } => 4 * points.len(),
            Shape::Split { ring, .. } => 4 * ring.len(),
        };
        let step = |step: &Step| {
            size_of::<Step>()
                + step.rows.memory()
                + step.children.iter().map(shape).sum::<usize>()
                + step
                    .limits
                    .iter()
                    .flatten()
                    .chain(step.masks.iter().flatten().map(|mask| &mask.limit))
                    .map(CornerLimit::memory)
                    .sum::<usize>()
                + step.put_off.iter().map(|ring| ring.memory()).sum::<usize>()
        };
        self.steps.iter().map(step).sum::<usize>()
            + self.numbers.keys().map(|key| 4 * key.len()).sum::<usize>()
    }

    fn number(&mut self, ring: &Ring, splits: u32) -> u32 {
        let key = ring.key();
        if let Some(&number) = self.numbers.get(&key) {
            return number;
        }
        if splits >= UNEQUAL_SPLITS && mixes(ring) {
            self.steps.push(Step {
                put_off: Some(Box::new(ring.clone())),
                ..Step::empty(ring)
            });
            return self.steps.len() as u32 - 1;
        }
        // Known before its children are looked at: one of them may be this very step.
        let number = self.steps.len() as u32;
        self.numbers.insert(key, number);
        self.steps.push(Step::empty(ring));
        let mut step = self.split(ring, splits);
        step.limits = corner_limits(ring, number, &step);
        step.masks = corner_masks(ring);
        self.steps[number as usize] = step;
        number
    }

    fn split(&mut self, ring: &Ring, splits: u32) -> Step {
        let topology = &ring.cage.topology;
        let own = |vertex: u32| vertex < ring.own;
        let all = stencils(&ring.cage, &|source| match source {
            Source::Vertex(vertex) => own(vertex),
            Source::Face => true,
            Source::Edge(edge) => topology.edge_vertices(edge).iter().any(|&v| own(v)),
        });
        let size = ring.vertices.len() as u32;
        let mut rows = Stencils::with_capacity(all.len());
        let mut number = vec![None; all.len()];
        for (number, row) in number.iter_mut().zip(all.rows()) {
            if !row.is_empty() {
                *number = Some(size + rows.len() as u32);
                push(&mut rows, row);
            }
        }
        let finer = split(&ring.cage);
        let children = if ring.cage.rules.triangles() {
            4
        } else {
            ring.sides()
        };
        let children = (0..children)
            .map(|child| {
                let child = Ring::of(&finer, child);
                let points: Vec<u32> = child
                    .vertices
                    .iter()
                    .map(|&v| number[v as usize].expect("a child's ring follows from its parent's"))
                    .collect();
                self.shape(&child, splits + 1, &points, &mut |combination| {
                    push(&mut rows, &combination);
                    size + rows.len() as u32 - 1
                })
            })
            .collect();
        Step {
            rows,
            children,
            ..Step::empty(ring)
        }
    }
}

impl Step {
    fn empty(ring: &Ring) -> Self {
        Self {
            ring: ring.vertices.len() as u32,
            rows: Stencils::with_capacity(0),
            children: Vec::new(),
            limits: Vec::new(),
            masks: Vec::new(),
            put_off: None,
        }
    }
}

/// A way down a surface's steps, on which those that were put off are split.
pub(super) struct Descent<'a> {
    known: &'a Steps,
    /// The last that was put off, and what follows from it.
    fresh: Option<Steps>,
    number: u32,
}

impl<'a> Descent<'a> {
    /// From this step on.
    pub(super) fn new(known: &'a Steps, number: u32) -> Self {
        Self {
            known,
            fresh: None,
            number,
        }
    }

    /// The step it is at.
    pub(super) fn step(&mut self) -> &Step {
        if let Some(ring) = &self.steps().get(self.number).put_off {
            let mut fresh = Steps::default();
            self.number = fresh.number(ring, UNEQUAL_SPLITS - 1);
            self.fresh = Some(fresh);
        }
        self.steps().get(self.number)
    }

    /// Goes to a step that a child of the last one is.
    pub(super) fn enter(&mut self, number: u32) {
        self.number = number;
    }

    fn steps(&self) -> &Steps {
        self.fresh.as_ref().unwrap_or(self.known)
    }
}

/// Whether sharpnesses at the ring's face are unequal and even out from level to level.
fn mixes(ring: &Ring) -> bool {
    let mut semi_sharp = ring
        .cage
        .edge_sharpness
        .iter()
        .filter(|&&s| is_semi_sharp(s));
    ring.cage.rules.crease_method == CreaseMethod::Chaikin
        && semi_sharp
            .next()
            .is_some_and(|first| semi_sharp.any(|s| s != first))
}

fn push(rows: &mut Stencils, terms: &[(u32, f64)]) {
    for &(point, weight) in terms {
        rows.add(point, weight);
    }
    rows.end_row();
}
