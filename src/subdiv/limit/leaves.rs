//! The polynomial patches under a part of a Ptex face, for bounds: which points they are sums of, and the one patch
//! where there is but one.
//!
//! All basis functions and masks of Catmull-Clark, Loop and bilinear subdivision are at least 0 and sum to 1. So a
//! patch lies in the hull of its points, and what is split further in the hull of its ring's.

use super::{Field, LimitSurface, Node, Part, PatchKind, Place, Real};

/// A bicubic patch of a face in Bezier form.
#[derive(Debug, Clone)]
pub struct BezierLeaf {
    /// The lower corner of the part of the face that it is.
    pub min: [f64; 2],
    /// The upper corner.
    pub max: [f64; 2],
    /// Control points row by row, u running faster.
    pub points: [[f64; 3]; 16],
}

/// A part of a face: the parameter `t` of it is `origin + size * t` of the face. Middle triangles are turned: their
/// size is below 0.
#[derive(Clone, Copy)]
struct Area {
    origin: [f64; 2],
    size: [f64; 2],
}

impl<T: Real> Field<T> {
    /// The largest magnitude among its numbers.
    pub fn largest(&self) -> f64 {
        let all = self.values.iter();
        all.fold(0.0, |most: f64, x| most.max(x.get().abs()))
    }
}

impl LimitSurface {
    /// Tells all points whose hull holds what [`evaluate`](Self::evaluate) gives for parameters from `min` to `max`,
    /// but for its rounding. Some come more than once. `field` has three components.
    ///
    /// # Panics
    /// If the face is a hole.
    pub fn hull_points<T: Real>(
        &self,
        field: &Field<T>,
        face: u32,
        [min, max]: [[f64; 2]; 2],
        mut tell: impl FnMut([T; 3]),
    ) {
        let plan = self.plan_of(face);
        let mut waiting = vec![(0_u32, Area::WHOLE)];
        while let Some((node, area)) = waiting.pop() {
            let [low, high] = area.bounds();
            if (0..2).any(|i| low[i] > max[i] || high[i] < min[i]) {
                continue;
            }
            let (part, points) = match plan.nodes[node as usize] {
                Node::Quarters(quarters) => {
                    let children = area.quarters(self.is_triangular());
                    waiting.extend(quarters.into_iter().zip(children));
                    continue;
                }
                Node::Halves { edge, halves } => {
                    waiting.extend(halves.into_iter().zip(area.halves(edge)));
                    continue;
                }
                Node::Patch(points) => (Part::Patch, points),
                Node::Split { step, points } => (Part::Split(step), points),
            };
            let place = self.place(face, part, points);
            for &point in &place.points[..self.point_count(&place)] {
                let p = place.value(field, point);
                tell([p[0], p[1], p[2]]);
            }
        }
    }

    /// The bicubic or bilinear patch that parameters from `min` to `max` lie in, if it is one.
    ///
    /// # Panics
    /// If the face is a hole.
    pub fn bezier<T: Real>(
        &self,
        field: &Field<T>,
        face: u32,
        [min, max]: [[f64; 2]; 2],
    ) -> Option<BezierLeaf> {
        if self.is_triangular() {
            return None;
        }
        let plan = self.plan_of(face);
        let mut node = 0;
        let mut area = Area::WHOLE;
        let points = loop {
            let holds = |area: &Area| {
                let [low, high] = area.bounds();
                (0..2).all(|i| low[i] <= min[i] && max[i] <= high[i])
            };
            match plan.nodes[node as usize] {
                Node::Quarters(quarters) => {
                    // The last that holds it: a rectangle on a border belongs to the upper side, as points do.
                    let children = area.quarters(false);
                    let order = [2, 3, 1, 0];
                    let child = order.into_iter().find(|&i| holds(&children[i]))?;
                    (node, area) = (quarters[child], children[child]);
                }
                Node::Halves { edge, halves } => {
                    let children = area.halves(edge);
                    let child = [1, 0].into_iter().find(|&i| holds(&children[i]))?;
                    (node, area) = (halves[child], children[child]);
                }
                Node::Patch(points) => break points,
                Node::Split { .. } => return None,
            }
        };
        let place = self.place(face, Part::Patch, points);
        let point = |i: usize| {
            let p = place.value(field, place.points[i]);
            [p[0].get(), p[1].get(), p[2].get()]
        };
        let [min, max] = area.bounds();
        Some(BezierLeaf {
            min,
            max,
            points: match self.kind {
                PatchKind::Bilinear => from_corners([0, 1, 2, 3].map(point)),
                _ => from_b_spline(std::array::from_fn(point)),
            },
        })
    }

    fn plan_of(&self, face: u32) -> &super::Plan {
        let plan = self.faces[face as usize].plan;
        assert_ne!(plan, super::HOLE, "bounds of a hole");
        &self.plans[plan as usize]
    }

    fn place(&self, face: u32, part: Part, points: u32) -> Place<'_> {
        let plan = self.plan_of(face);
        let face = self.faces[face as usize];
        Place {
            level: 0,
            part,
            points: &plan.points[points as usize..],
            ring: &self.rings[face.ring as usize..][..plan.ring as usize],
            own: self.vertices as u32 + face.own,
            u: 0.0,
            v: 0.0,
            scale: [1.0; 2],
        }
    }

    fn point_count(&self, place: &Place<'_>) -> usize {
        match place.part {
            Part::Patch => self.kind.points(),
            Part::Split(step) => self.steps.get(step).ring as usize,
        }
    }
}

impl Area {
    const WHOLE: Self = Self {
        origin: [0.0; 2],
        size: [1.0; 2],
    };

    fn bounds(&self) -> [[f64; 2]; 2] {
        let ends = [0, 1].map(|i| [self.origin[i], self.origin[i] + self.size[i]]);
        [ends.map(|[a, b]| a.min(b)), ends.map(|[a, b]| a.max(b))]
    }

    fn part(&self, origin: [f64; 2], size: [f64; 2]) -> Self {
        Self {
            origin: [0, 1].map(|i| self.origin[i] + self.size[i] * origin[i]),
            size: [0, 1].map(|i| self.size[i] * size[i]),
        }
    }

    /// In the order in which parameters are sorted into them.
    fn quarters(&self, triangular: bool) -> [Self; 4] {
        let half = [0.5; 2];
        if triangular {
            [
                self.part([0.0, 0.0], half),
                self.part([0.5, 0.0], half),
                self.part([0.0, 0.5], half),
                self.part([0.5, 0.5], [-0.5; 2]),
            ]
        } else {
            [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]].map(|origin| self.part(origin, half))
        }
    }

    /// Far from an edge and near to it.
    fn halves(&self, edge: usize) -> [Self; 2] {
        let low = |i: usize| self.part([0.0; 2], if i == 0 { [0.5, 1.0] } else { [1.0, 0.5] });
        let high = |i: usize| {
            if i == 0 {
                self.part([0.5, 0.0], [0.5, 1.0])
            } else {
                self.part([0.0, 0.5], [1.0, 0.5])
            }
        };
        match edge {
            0 => [high(1), low(1)],
            1 => [low(0), high(0)],
            2 => [low(1), high(1)],
            _ => [high(0), low(0)],
        }
    }
}

/// A uniform bicubic B-spline patch in Bezier form.
fn from_b_spline(p: [[f64; 3]; 16]) -> [[f64; 3]; 16] {
    let line = |[a, b, c, d]: [[f64; 3]; 4]| -> [[f64; 3]; 4] {
        let sum = |weights: [f64; 4]| {
            [0, 1, 2].map(|i| {
                weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i] + weights[3] * d[i]
            })
        };
        [
            sum([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0, 0.0]),
            sum([0.0, 2.0 / 3.0, 1.0 / 3.0, 0.0]),
            sum([0.0, 1.0 / 3.0, 2.0 / 3.0, 0.0]),
            sum([0.0, 1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0]),
        ]
    };
    let rows: [[[f64; 3]; 4]; 4] =
        std::array::from_fn(|r| line(std::array::from_fn(|c| p[4 * r + c])));
    let columns: [[[f64; 3]; 4]; 4] =
        std::array::from_fn(|c| line(std::array::from_fn(|r| rows[r][c])));
    std::array::from_fn(|i| columns[i % 4][i / 4])
}

/// A bilinear patch over corners around the square, raised to degree three.
fn from_corners([a, b, c, d]: [[f64; 3]; 4]) -> [[f64; 3]; 16] {
    std::array::from_fn(|i| {
        let (u, v) = ((i % 4) as f64 / 3.0, (i / 4) as f64 / 3.0);
        [0, 1, 2]
            .map(|k| (1.0 - v) * ((1.0 - u) * a[k] + u * b[k]) + v * ((1.0 - u) * d[k] + u * c[k]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::mesh::ControlMesh;
    use crate::subdiv::parameters::quarter;

    /// A sheet of three by three quads: of its faces one has no border and the others have points of their own.
    fn sheet() -> ControlMesh {
        let corner = |x: u32, y: u32| y * 4 + x;
        ControlMesh {
            face_vertex_counts: vec![4; 9],
            face_vertex_indices: (0..9)
                .flat_map(|i| {
                    let (x, y) = (i % 3, i / 3);
                    [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(dx, dy)| corner(x + dx, y + dy))
                })
                .collect(),
            points: vec![
                (0..16)
                    .map(|i| Vec3::new((i % 4) as f32, (i / 4) as f32, (i * i % 7) as f32))
                    .collect(),
            ],
            ..ControlMesh::default()
        }
    }

    #[test]
    fn leaves_are_the_surface_at_borders_and_extraordinary_vertices() {
        // The same sheet, and one whose middle quad has another within it.
        let mut twisted = sheet();
        let middle: Vec<u32> = twisted.face_vertex_indices.splice(16..20, []).collect();
        let inner: Vec<u32> = (16..20).collect();
        for (i, &corner) in middle.iter().enumerate() {
            let centre = Vec3::new(1.5, 1.5, 2.0);
            let point = twisted.points[0][corner as usize].lerp(centre, 0.5);
            twisted.points[0].push(point);
            let next = (i + 1) % 4;
            let side = [corner, middle[next], inner[next], inner[i]];
            twisted.face_vertex_indices.extend(side);
        }
        twisted.face_vertex_indices.extend(inner);
        twisted.face_vertex_counts = vec![4; 13];

        for mesh in [sheet(), twisted] {
            let surface = LimitSurface::new(&mesh);
            let field = surface.points::<f64>(&mesh, 0);
            let mut patches = 0;
            for face in 0..surface.face_count() as u32 {
                for uv in [[0.01, 0.02], [0.3, 0.9], [0.6, 0.4], [0.97, 0.03]] {
                    let expected = surface.evaluate(&field, face, uv[0], uv[1]).position;
                    let mut low = [f64::INFINITY; 3];
                    let mut high = [f64::NEG_INFINITY; 3];
                    surface.hull_points(&field, face, [uv, uv], |p| {
                        low = [0, 1, 2].map(|i| low[i].min(p[i]));
                        high = [0, 1, 2].map(|i| high[i].max(p[i]));
                    });
                    assert!(
                        (0..3).all(
                            |i| low[i] <= expected[i] + 1e-12 && expected[i] <= high[i] + 1e-12
                        ),
                        "{face} {uv:?}: {expected:?} outside of {low:?} {high:?}"
                    );
                    let Some(leaf) = surface.bezier(&field, face, [uv, uv]) else {
                        continue;
                    };
                    patches += 1;
                    let bernstein = |t: f64| {
                        let s = 1.0 - t;
                        [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
                    };
                    let [bu, bv] = [0, 1]
                        .map(|i| bernstein((uv[i] - leaf.min[i]) / (leaf.max[i] - leaf.min[i])));
                    for axis in 0..3 {
                        let sum: f64 = (0..16)
                            .map(|i| bu[i % 4] * bv[i / 4] * leaf.points[i][axis])
                            .sum();
                        assert!((sum - expected[axis]).abs() < 1e-12, "{face} {uv:?}");
                    }
                }
            }
            assert!(patches >= 20, "{patches} patches");
        }
    }

    #[test]
    fn areas_are_where_parameters_go() {
        for (kind, uv) in [
            (PatchKind::BoxSpline, [0.2, 0.1]),
            (PatchKind::BoxSpline, [0.3, 0.35]),
            (PatchKind::BoxSpline, [0.7, 0.1]),
            (PatchKind::BoxSpline, [0.1, 0.8]),
            (PatchKind::Bicubic, [0.7, 0.1]),
            (PatchKind::Bicubic, [0.1, 0.7]),
            (PatchKind::Bicubic, [0.7, 0.8]),
        ] {
            let mut area = Area::WHOLE;
            let ([mut u, mut v], mut size) = (uv, [1.0; 2]);
            for _ in 0..5 {
                let child = quarter(kind, &mut u, &mut v, &mut size);
                area = area.quarters(kind.is_triangular())[child];
                let back = [0, 1].map(|i| area.origin[i] + area.size[i] * [u, v][i]);
                assert!((0..2).all(|i| (back[i] - uv[i]).abs() < 1e-12), "{uv:?}");
            }
        }
    }
}
