//! Quads in the order of the tree over them.

use rayon::prelude::*;

use super::{Leaf, Nonlinear};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::prism::may_fold;
use crate::accel::top::Top;
use crate::math::{Bounds3, DVec3, Vec3};

impl Nonlinear {
    /// Builds the tree over the quads, and puts them in its order. A motion key has `each` corners.
    pub(super) fn arrange(&mut self, each: usize) {
        let row = self.cuts as usize + 1;
        let hull = |quad: &Leaf, key: usize| {
            let first = self.corner(quad);
            let corner = |next: usize| &self.corners[key * each + first + next];
            let lines = [0, 1, row, row + 1].map(corner);
            let heights = [quad.low, quad.high];
            lines
                .into_iter()
                .flat_map(move |[p, n]| heights.map(|h| p.as_dvec3() + f64::from(h) * n.as_dvec3()))
        };
        let keys = self.keys as usize;
        let all = self
            .quads
            .iter()
            .flat_map(|quad| (0..keys).flat_map(move |key| hull(quad, key)));
        let bounds = all.fold(Bounds3::EMPTY, |b, p| b.including(p.as_vec3()));
        let lattice = Lattice::around(&bounds, 0.0);
        let on_lattice = |p: DVec3| (p - lattice.anchor.as_dvec3()) / lattice.step();
        let extents: Vec<Vec<Extent>> = (0..keys)
            .map(|key| {
                let quads = self.quads.par_iter();
                quads
                    .map(|quad| {
                        let points: Vec<DVec3> = hull(quad, key).map(on_lattice).collect();
                        Extent::around(&points)
                    })
                    .collect()
            })
            .collect();
        let all = extents
            .iter()
            .flatten()
            .copied()
            .fold(Extent::EMPTY, Extent::union);
        let largest = |k: usize| all.min[k].abs().max(all.max[k].abs());
        let reach = if all.is_empty() {
            0
        } else {
            (0..3).map(largest).max().unwrap_or(0)
        };
        let (top, order) = Top::new(extents);
        let corner = |[p, n]: [Vec3; 2]| [p.as_dvec3(), n.as_dvec3()];
        let folds = |quad: &Leaf| {
            let first = self.corner(quad);
            let [a, b, c, d] = [0, 1, row, row + 1].map(|k| corner(self.corners[first + k]));
            let heights = [f64::from(quad.low) - 1.0, f64::from(quad.high) + 1.0];
            // Between motion keys any may.
            keys > 1 || may_fold([a, b, c], heights) || may_fold([d, c, b], heights)
        };
        self.quads = order
            .into_par_iter()
            .map(|number| {
                let quad = self.quads[number as usize];
                let folds = if folds(&quad) { Leaf::FOLDS } else { 0 };
                Leaf {
                    face: quad.of() | folds,
                    ..quad
                }
            })
            .collect();
        (self.lattice, self.reach, self.top) = (lattice, reach as f32, top);
    }
}
