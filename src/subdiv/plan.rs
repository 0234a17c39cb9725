//! How to evaluate a face: a tree over its parameters whose leaves are polynomial patches, and a program for the
//! patches' points. Faces in equal surroundings share one plan (Brainerd et al., *Efficient GPU Rendering of
//! Subdivision Surfaces using Adaptive Quadtrees*, 2016).
//!
//! Points are numbered: first the vertices of the face's ring, then those that the program makes, each a weighted sum
//! of points before it.

use super::stencils::Stencils;
use super::step::{Shape, Steps};

/// The plan of a face.
#[derive(Debug)]
pub(super) struct Plan {
    /// How many vertices the ring has.
    pub(super) ring: u32,
    /// How often the mesh's face was split to give this one: once if it is several Ptex faces.
    pub(super) level: u32,
    /// The points that each face with this plan has of its own.
    pub(super) program: Stencils,
    /// Node 0 is the face.
    pub(super) nodes: Vec<Node>,
    /// The points of patches and of unfinished splits.
    pub(super) points: Vec<u32>,
}

/// A part of a face.
#[derive(Debug, Clone, Copy)]
pub(super) enum Node {
    /// Four quarters.
    Quarters([u32; 4]),
    /// Two halves, cut parallel to this edge: far from it and near to it.
    Halves { edge: usize, halves: [u32; 2] },
    /// A polynomial patch; its points start here.
    Patch(u32),
    /// To be split further while it is evaluated; the points of its ring start here.
    Split { step: u32, points: u32 },
}

/// Splits that a plan writes out. Deeper ones, within 2⁻ⁿ of an extraordinary vertex, are made while evaluating:
/// slower, but each level stored costs some thirty points at each such vertex.
pub(super) const STORED_SPLITS: u32 = 5;

impl Plan {
    /// The plan of a face of this shape, over a ring of so many vertices and the points that `program` makes.
    pub(super) fn new(steps: &Steps, ring: u32, program: Stencils, shape: &Shape) -> Self {
        let mut plan = Self {
            ring,
            level: 0,
            program,
            nodes: Vec::new(),
            points: Vec::new(),
        };
        plan.add(steps, shape, STORED_SPLITS);
        plan
    }

    /// The plan of one child of a face that is split into other than four.
    pub(super) fn of_child(steps: &Steps, step: u32, child: usize) -> Self {
        let split = steps.get(step);
        let mut plan = Self {
            ring: split.ring,
            level: 1,
            program: Stencils::with_capacity(0),
            nodes: Vec::new(),
            points: Vec::new(),
        };
        let ring: Vec<u32> = (0..split.ring).collect();
        let shape = Made::new(&ring, split.rows.len()).shape(
            &split.rows,
            &split.children[child],
            &mut plan,
        );
        plan.add(steps, &shape, STORED_SPLITS);
        plan
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        size_of::<Self>()
            + self.program.memory()
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.points.as_slice())
    }

    fn add(&mut self, steps: &Steps, shape: &Shape, splits: u32) -> u32 {
        let node = self.nodes.len() as u32;
        self.nodes.push(Node::Patch(0));
        self.nodes[node as usize] = match shape {
            Shape::Patch(points) => self.patch(points),
            Shape::Strip {
                points,
                edge,
                sharpness,
            } => self.strip(points, *edge, *sharpness),
            Shape::Split { step, ring } => {
                let split = steps.get(*step);
                if splits == 0 || split.children.len() != 4 {
                    let points = self.list(ring);
                    Node::Split {
                        step: *step,
                        points,
                    }
                } else {
                    let mut made = Made::new(ring, split.rows.len());
                    let mut quarters = [0; 4];
                    for (quarter, child) in quarters.iter_mut().zip(&split.children) {
                        let shape = made.shape(&split.rows, child, self);
                        *quarter = self.add(steps, &shape, splits - 1);
                    }
                    Node::Quarters(quarters)
                }
            }
        };
        node
    }

    fn list(&mut self, points: &[u32]) -> u32 {
        let start = self.points.len() as u32;
        self.points.extend(points);
        start
    }

    fn patch(&mut self, points: &[u32]) -> Node {
        Node::Patch(self.list(points))
    }

    fn make(&mut self, terms: &[(u32, f64)]) -> u32 {
        for &(point, weight) in terms {
            self.program.add(point, weight);
        }
        self.program.end_row();
        self.ring + self.program.len() as u32 - 1
    }

    /// Refines a strip across its crease: a smooth half, and one whose sharpness is less by one.
    fn strip(&mut self, points: &[u32], edge: usize, sharpness: f32) -> Node {
        // Place of point `along` of line `line`; line 2 is the crease, line 3 beyond it.
        let place = |line: usize, along: usize| match edge {
            0 => 4 * (3 - line) + along,
            1 => 4 * along + line,
            2 => 4 * line + along,
            _ => 4 * along + 3 - line,
        };
        let smooth = 1.0 - f64::from(sharpness.min(1.0));
        let mut far = vec![0; 16];
        let mut near = vec![0; 16];
        for i in 0..4 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|line| points[place(line, i)]);
            let ab = self.make(&[(a, 0.5), (b, 0.5)]);
            let bc = self.make(&[(b, 0.5), (c, 0.5)]);
            let cd = self.make(&[(c, 0.5), (d, 0.5)]);
            let b = self.make(&[(a, 0.125), (b, 0.75), (c, 0.125)]);
            let c = self.make(&[
                (points[place(1, i)], 0.125 * smooth),
                (c, 1.0 - 0.25 * smooth),
                (d, 0.125 * smooth),
            ]);
            for (line, point) in [ab, b, bc, c].into_iter().enumerate() {
                far[place(line, i)] = point;
            }
            for (line, point) in [b, bc, c, cd].into_iter().enumerate() {
                near[place(line, i)] = point;
            }
        }
        let halves = [&far, &near].map(|_| {
            self.nodes.push(Node::Patch(0));
            self.nodes.len() as u32 - 1
        });
        self.nodes[halves[0] as usize] = self.patch(&far);
        self.nodes[halves[1] as usize] = if sharpness > 1.0 {
            self.strip(&near, edge, sharpness - 1.0)
        } else {
            self.patch(&near)
        };
        Node::Halves { edge, halves }
    }
}

/// The points of one split within a plan, made as they are asked for.
struct Made {
    ring: usize,
    numbers: Vec<Option<u32>>,
}

impl Made {
    fn new(ring: &[u32], rows: usize) -> Self {
        let mut numbers: Vec<Option<u32>> = ring.iter().map(|&p| Some(p)).collect();
        numbers.resize(ring.len() + rows, None);
        Self {
            ring: ring.len(),
            numbers,
        }
    }

    fn number(&mut self, rows: &Stencils, point: u32, plan: &mut Plan) -> u32 {
        if let Some(number) = self.numbers[point as usize] {
            return number;
        }
        let terms: Vec<(u32, f64)> = rows
            .row(point as usize - self.ring)
            .iter()
            .map(|&(p, w)| (self.number(rows, p, plan), w))
            .collect();
        let number = plan.make(&terms);
        self.numbers[point as usize] = Some(number);
        number
    }

    fn shape(&mut self, rows: &Stencils, shape: &Shape, plan: &mut Plan) -> Shape {
        let mut all = |points: &[u32]| {
            points
                .iter()
                .map(|&p| self.number(rows, p, plan))
                .collect::<Vec<u32>>()
        };
        match shape {
            Shape::Patch(points) => Shape::Patch(all(points)),
            Shape::Strip {
                points,
                edge,
                sharpness,
            } => Shape::Strip {
                points: all(points),
                edge: *edge,
                sharpness: *sharpness,
            },
            Shape::Split { step, ring } => Shape::Split {
                step: *step,
                ring: all(ring),
            },
        }
    }
}
