//! A plain tree over the micro-triangles of a diced surface: the slow, clear twin that other methods are compared with.
//!
//! It traces exactly the micro-triangles of a [`Diced`] surface, which lie off the displaced limit surface by what the
//! dicing rates leave; [`Hit::error`] is how far the hit lies from its triangle's plane. It stores for each triangle
//! four bytes, and boxes at each motion key for each node; per ray it computes everything else. The tree halves the
//! triangles at the median of their centres along the longest side of these, which needs no tuning. Vertices and boxes
//! move linearly between keys; rounding is the same for both, so that a box between keys still holds its vertices.

use std::sync::Arc;

use rayon::prelude::*;

use super::moment::Moment;
use super::triangle::{Sheared, TriangleHit};
use super::{Hit, Intersector};
use crate::error::{Error, Result};
use crate::math::{Bounds3, Ray, Vec2, Vec3};
use crate::memory::{filled, room_for};
use crate::surface::Diced;

/// The tree. It is one primitive: Embree has nothing to sort.
pub struct Tessellated {
    diced: Arc<Diced>,
    /// The root first, the left child next to its parent.
    nodes: Vec<Node>,
    /// Boxes of each node, key by key.
    bounds: Vec<Bounds3>,
    /// Triangles in the order of the leaves.
    triangles: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// The first triangle of a leaf, or the right child.
    first: u32,
    /// How many triangles a leaf has; 0 for inner nodes.
    count: u32,
}

/// Triangles whose boxes are collected at once.
const BATCH: u64 = 1 << 20;

/// The most triangles in a leaf.
const LEAF: usize = 4;

/// Each level halves the triangles, of which there are fewer than 2^32.
const DEEPEST: usize = 40;

impl Tessellated {
    /// Over all triangles that have an area at some motion key.
    ///
    /// # Panics
    /// If there are 2^31 triangles or more: dice more coarsely, or use a method that compresses. If there is no memory.
    pub fn build(diced: Arc<Diced>) -> Self {
        Self::watched(diced, &|_| true).expect("nobody ends it, and there is memory")
    }

    /// The same; `go_on` is told how far it is, 0..1, and ends it by false.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if ended, [`Error::Memory`] if the system has no more.
    ///
    /// # Panics
    /// If there are 2^31 triangles or more.
    pub fn watched(diced: Arc<Diced>, go_on: &dyn Fn(f64) -> bool) -> Result<Self> {
        assert!(
            diced.triangles() < 1 << 31,
            "{} micro-triangles are too many for the plain tree",
            diced.triangles()
        );
        let keys = diced.positions().len();
        let with_area = |triangle: u64| {
            let corners = diced.corners(triangle);
            let has_area = |key: &Vec<Vec3>| {
                let [a, b, c] = corners.map(|v| key[v as usize]);
                a != b && b != c && c != a
            };
            diced.positions().iter().any(has_area).then(|| {
                let all = Bounds3::of(
                    diced
                        .positions()
                        .iter()
                        .flat_map(|key| corners.map(|v| key[v as usize])),
                );
                (triangle as u32, all.centre())
            })
        };
        // A batch at a time: what threads collect exists twice for a moment.
        let all = diced.triangles();
        let mut boxes: Vec<(u32, Vec3)> = room_for(all as usize, "boxes of micro-triangles")?;
        for first in (0..all).step_by(BATCH as usize) {
            let batch = first..all.min(first + BATCH);
            boxes.par_extend(batch.into_par_iter().filter_map(with_area));
            if !go_on(first as f64 / all as f64) {
                return Err(Error::Interrupted);
            }
        }
        let mut nodes = room_for(boxes.len(), "nodes")?;
        if !boxes.is_empty() {
            split(&mut boxes, 0, &mut nodes);
        }
        nodes.shrink_to_fit();
        let mut triangles: Vec<u32> = room_for(boxes.len(), "numbers of micro-triangles")?;
        triangles.extend(boxes.iter().map(|(triangle, _)| triangle));
        drop(boxes);
        let mut tree = Self {
            bounds: filled(nodes.len() * keys, Bounds3::EMPTY, "boxes of nodes")?,
            diced,
            nodes,
            triangles,
        };
        tree.refit();
        Ok(tree)
    }

    /// The surface that is traced.
    pub fn diced(&self) -> &Arc<Diced> {
        &self.diced
    }

    /// Boxes from the leaves up: children follow their parents.
    fn refit(&mut self) {
        let keys = self.keys() as usize;
        for i in (0..self.nodes.len()).rev() {
            let Node { first, count } = self.nodes[i];
            for key in 0..keys {
                let positions = &self.diced.positions()[key];
                self.bounds[i * keys + key] = if count > 0 {
                    let leaf = &self.triangles[first as usize..(first + count) as usize];
                    Bounds3::of(
                        leaf.iter()
                            .flat_map(|&triangle| self.diced.corners(u64::from(triangle)))
                            .map(|v| positions[v as usize]),
                    )
                } else {
                    let child = |i: usize| self.bounds[i * keys + key];
                    child(i + 1).union(child(first as usize))
                };
            }
        }
    }

    /// Meets triangles in the order of the nodes; `accept` takes each hit nearer than the last one, and says whether
    /// to go on.
    fn traverse(&self, ray: &Ray, mut accept: impl FnMut(u32, TriangleHit) -> bool) {
        let sheared = Sheared::new(ray);
        let moment = Moment::new(self.keys(), ray.time);
        let mut t_max = ray.t_max;
        let enters = |node: u32, t_max: f32| {
            sheared.enters(&self.node_bounds(node, &moment), ray.t_min, t_max)
        };
        let mut stack = [(0_u32, 0.0_f32); DEEPEST];
        let mut waiting = 0;
        let mut next = (!self.nodes.is_empty())
            .then(|| enters(0, t_max))
            .flatten()
            .map(|_| 0);
        loop {
            let Some(index) = next.take() else {
                // The nearest of those that were put aside, unless a hit lies before it.
                loop {
                    if waiting == 0 {
                        return;
                    }
                    waiting -= 1;
                    let (node, near) = stack[waiting];
                    if near <= t_max {
                        next = Some(node);
                        break;
                    }
                }
                continue;
            };
            let Node { first, count } = self.nodes[index as usize];
            if count > 0 {
                for &triangle in &self.triangles[first as usize..(first + count) as usize] {
                    let corners = self.corners(triangle, &moment);
                    if let Some(hit) = sheared.triangle(corners, ray.t_min, t_max) {
                        t_max = hit.t;
                        if !accept(triangle, hit) {
                            return;
                        }
                    }
                }
                continue;
            }
            let (left, right) = (index + 1, first);
            match (enters(left, t_max), enters(right, t_max)) {
                (Some(a), Some(b)) => {
                    let (near, far) = if a <= b {
                        (left, (right, b))
                    } else {
                        (right, (left, a))
                    };
                    stack[waiting] = far;
                    waiting += 1;
                    next = Some(near);
                }
                (Some(_), None) => next = Some(left),
                (None, Some(_)) => next = Some(right),
                (None, None) => {}
            }
        }
    }

    fn node_bounds(&self, node: u32, moment: &Moment) -> Bounds3 {
        let keys = self.keys() as usize;
        let at = |key: usize| self.bounds[node as usize * keys + key];
        let (a, b) = (at(moment.from), at(moment.to));
        Bounds3 {
            min: moment.between(a.min, b.min),
            max: moment.between(a.max, b.max),
        }
    }

    fn corners(&self, triangle: u32, moment: &Moment) -> [Vec3; 3] {
        let positions = self.diced.positions();
        self.diced.corners(u64::from(triangle)).map(|v| {
            let at = |key: usize| positions[key][v as usize];
            moment.between(at(moment.from), at(moment.to))
        })
    }

    fn hit(&self, ray: &Ray, triangle: u32, met: TriangleHit) -> Hit {
        let moment = Moment::new(self.keys(), ray.time);
        let [a, b, c] = self.corners(triangle, &moment).map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a);
        let normal = if self.diced.left_handed() {
            -normal
        } else {
            normal
        };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let distance = normal
            .normalize_or_zero()
            .dot(ray.at(met.t).as_dvec3() - a)
            .abs();
        let (face, uv) = self
            .diced
            .face_uv(u64::from(triangle), Vec2::new(met.u, met.v));
        Hit {
            t: met.t,
            face,
            uv,
            normal: normal.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }
}

impl Intersector for Tessellated {
    fn primitives(&self) -> u32 {
        1
    }

    fn keys(&self) -> u32 {
        self.diced.positions().len() as u32
    }

    fn bounds(&self, _p: u32, key: u32) -> Bounds3 {
        self.bounds
            .get(key as usize)
            .copied()
            .unwrap_or(Bounds3::EMPTY)
    }

    fn intersect(&self, _p: u32, ray: &Ray) -> Option<Hit> {
        let mut nearest = None;
        self.traverse(ray, |triangle, hit| {
            nearest = Some((triangle, hit));
            true
        });
        nearest.map(|(triangle, hit)| self.hit(ray, triangle, hit))
    }

    fn occluded(&self, _p: u32, ray: &Ray) -> bool {
        let mut met = false;
        self.traverse(ray, |_, _| {
            met = true;
            false
        });
        met
    }

    fn memory(&self) -> usize {
        self.diced.memory()
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.bounds.as_slice())
            + size_of_val(self.triangles.as_slice())
    }
}

/// Sorts triangles, given by number and centre, into leaves, and adds the nodes above them. `first` is the place of
/// the first of them.
fn split(triangles: &mut [(u32, Vec3)], first: usize, nodes: &mut Vec<Node>) {
    let node = nodes.len();
    if triangles.len() <= LEAF {
        nodes.push(Node {
            first: first as u32,
            count: triangles.len() as u32,
        });
        return;
    }
    nodes.push(Node { first: 0, count: 0 });
    let axis = Bounds3::of(triangles.iter().map(|t| t.1))
        .extent()
        .max_position();
    let middle = triangles.len() / 2;
    // Ties by number, so that the tree is one and the same each time.
    triangles.select_nth_unstable_by(middle, |a, b| {
        a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0))
    });
    let (left, right) = triangles.split_at_mut(middle);
    split(left, first, nodes);
    nodes[node].first = nodes.len() as u32;
    split(right, first + middle, nodes);
}
