//! Points of a subdivision surface by the grid: from the Bezier forms of the polynomial patches that a face consists
//! of. What is left around extraordinary vertices, and with Loop, is evaluated point by point.

use std::ops::Range;

use super::Bicubic;
use super::base::{LimitGrid, UvRect};
use super::subdivision::Subdivision;
use crate::math::Vec2;
use crate::subdiv::{Field, LimitSurface};

/// The side of the smallest parts of a face that are looked up as patches: as small as the plans of faces have any.
const LEAST_LEAF: f32 = 1.0 / 32.0;

impl Subdivision {
    /// Points, and first derivatives with `SLOPES`, at all pairs of parameters, in any order; u running faster.
    ///
    /// Which patch a point comes from depends on the point alone: it has the same bits in any grid.
    pub(super) fn grid<const SLOPES: bool>(
        &self,
        of: (&LimitSurface, &Field<f32>),
        face: u32,
        [us, vs]: [&[f32]; 2],
        out: &mut LimitGrid,
    ) {
        let (limit, field) = of;
        let whole = UvRect::UNIT;
        if let Some(patch) = self.patch_of(limit, field, face, &whole) {
            patch.grid::<SLOPES>(us, vs, out);
            return;
        }
        out.resize(us.len() * vs.len());
        let orders = [us, vs].map(|all| {
            let mut order: Vec<usize> = (0..all.len()).collect();
            order.sort_by(|&a, &b| all[a].total_cmp(&all[b]));
            order
        });
        let [us, vs] = &[0, 1].map(|axis| {
            let (all, order) = ([us, vs][axis], &orders[axis]);
            order.iter().map(|&i| all[i]).collect::<Vec<f32>>()
        });
        let mut leaf = Leaf::default();
        let mut waiting = vec![(whole, [0..us.len(), 0..vs.len()])];
        while let Some((rect, [columns, rows])) = waiting.pop() {
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            if let Some(patch) = self.patch_of(limit, field, face, &rect) {
                let there = [&us[columns.clone()], &vs[rows.clone()]];
                leaf.evaluate::<SLOPES>(&patch, &rect, there);
                let places = [&orders[0][columns], &orders[1][rows]];
                leaf.copy::<SLOPES>(&rect, places, us.len(), out);
            } else if limit.is_triangular() || rect.max.x - rect.min.x <= LEAST_LEAF {
                for (row, column) in rows.flat_map(|r| columns.clone().map(move |c| (r, c))) {
                    let uv = Vec2::new(us[column], vs[row]);
                    let point = self.first_order_of(limit, field, face, uv);
                    out.set(us.len() * orders[1][row] + orders[0][column], &point);
                }
            } else {
                let middle = 0.5 * (rect.min + rect.max);
                let halves = |all: &[f32], range: &Range<usize>, middle: f32| {
                    let before = all[range.clone()].partition_point(|&x| x < middle);
                    let cut = range.start + before;
                    [range.start..cut, cut..range.end]
                };
                let columns = halves(us, &columns, middle.x);
                let rows = halves(vs, &rows, middle.y);
                for (i, quarter) in rect.quarters().into_iter().enumerate() {
                    waiting.push((quarter, [columns[i % 2].clone(), rows[i / 2].clone()]));
                }
            }
        }
    }
}

/// The part of a grid that lies in one patch.
#[derive(Default)]
struct Leaf {
    inner: [Vec<f32>; 2],
    grid: LimitGrid,
}

impl Leaf {
    /// Of the patch over a square part of a face, at parameters of the face.
    fn evaluate<const SLOPES: bool>(&mut self, patch: &Bicubic, rect: &UvRect, all: [&[f32]; 2]) {
        let per_face = 1.0 / (rect.max.x - rect.min.x);
        let ends = all.into_iter().zip(rect.min.to_array());
        for (inner, (all, min)) in self.inner.iter_mut().zip(ends) {
            inner.clear();
            inner.extend(all.iter().map(|x| (x - min) * per_face));
        }
        let [us, vs] = &self.inner;
        patch.grid::<SLOPES>(us, vs, &mut self.grid);
    }

    /// Copies it to columns and rows of a grid whose rows are `stride` long.
    fn copy<const SLOPES: bool>(
        &self,
        rect: &UvRect,
        [columns, rows]: [&[usize]; 2],
        stride: usize,
        out: &mut LimitGrid,
    ) {
        let per_face = 1.0 / (rect.max.x - rect.min.x);
        let (of, count) = (&self.grid, columns.len());
        for (from, row) in rows.iter().enumerate() {
            let from = count * from..count * (from + 1);
            let to = stride * row..stride * (row + 1);
            for axis in 0..3 {
                let copy = |out: &mut [Vec<f32>; 3], of: &[Vec<f32>; 3], scale: f32| {
                    let (out, of) = (&mut out[axis][to.clone()], &of[axis][from.clone()]);
                    for (&column, of) in columns.iter().zip(of) {
                        out[column] = scale * of;
                    }
                };
                copy(&mut out.position, &of.position, 1.0);
                if SLOPES {
                    copy(&mut out.du, &of.du, per_face);
                    copy(&mut out.dv, &of.dv, per_face);
                }
            }
        }
    }
}
