//! What must hold for any valid surface.

use proptest::prelude::*;

use super::{direction, faces, surface};
use crate::math::{DVec3, Vec3};
use crate::mesh::{NurbsDirection, NurbsPatch};
use crate::nurbs::basis;

/// Knots of any multiplicity, some ranges, points and weights.
fn any_direction() -> impl Strategy<Value = NurbsDirection> {
    (2usize..7, 0usize..6)
        .prop_flat_map(|(order, more)| {
            let steps = proptest::collection::vec(
                prop_oneof![2 => Just(0.0), 3 => 0.01..2.0_f64, 1 => Just(1e-9)],
                2 * order + more,
            );
            (
                Just(order),
                steps,
                0.0..1.0_f64,
                0.0..1.0_f64,
                any::<bool>(),
            )
        })
        .prop_filter_map("an empty domain", |(order, steps, a, b, ranged)| {
            let knots: Vec<f64> = steps
                .iter()
                .scan(-1.0, |t, step| {
                    *t += step;
                    Some(*t)
                })
                .collect();
            let mut direction = direction(order, &knots);
            let [low, high] = direction.domain();
            if ranged {
                let at = |t: f64| low + t * (high - low);
                direction.range = Some([at(a.min(b)), at(a.max(b)).min(high)]);
            }
            let [low, high] = direction.domain();
            (low < high).then_some(direction)
        })
}

fn any_patch() -> impl Strategy<Value = NurbsPatch> {
    (any_direction(), any_direction()).prop_flat_map(|(u, v)| {
        let n = u.count * v.count;
        let coordinate = -3.0..3.0_f32;
        let point = (coordinate.clone(), coordinate.clone(), coordinate)
            .prop_map(|(x, y, z)| Vec3::new(x, y, z));
        (
            proptest::collection::vec(point, n),
            proptest::option::of(proptest::collection::vec(0.05..20.0_f64, n)),
        )
            .prop_map(move |(points, weights)| NurbsPatch {
                u: u.clone(),
                v: v.clone(),
                points: vec![points],
                weights,
                ..NurbsPatch::default()
            })
    })
}

proptest! {
    #[test]
    fn basis_functions_sum_to_one(direction in any_direction(), s in 0.0..=1.0_f64) {
        let [low, high] = direction.domain();
        let t = low + s * (high - low);
        let span = basis::span(&direction.knots, direction.order, t);
        prop_assert!(direction.knots[span] <= t && t <= direction.knots[span + 1]);
        let [value, ..] = basis::functions(&direction.knots, direction.order, span, t);
        prop_assert!(value.iter().all(|w| *w >= 0.0));
        prop_assert!((value.iter().sum::<f64>() - 1.0).abs() < 1e-13);
    }

    #[test]
    fn any_face_lies_in_its_bounds_and_on_the_surface(
        patch in any_patch(),
        s in 0.0..=1.0_f64,
        t in 0.0..=1.0_f64,
    ) {
        prop_assert_eq!(patch.validate(), Ok(()));
        let (surface, faces) = (surface(&patch), faces(&patch));
        for face in 0..faces.face_count() {
            let p = faces.evaluate(face, [s, t]);
            let bounds = faces.bounds(0, face);
            for axis in 0..3 {
                let x = p.position[axis];
                prop_assert!(f64::from(bounds.min[axis]) <= x && x <= f64::from(bounds.max[axis]));
            }
            let [u, v] = faces.parameters(face);
            let at = [u[0] + s * (u[1] - u[0]), v[0] + t * (v[1] - v[0])];
            // Very short spans amplify the rounding of the parameter itself.
            if u[1] - u[0] > 1e-6 && v[1] - v[0] > 1e-6 && s < 0.999 && t < 0.999 {
                let whole = surface.evaluate(0, at);
                prop_assert!(whole.position.distance(p.position) < 1e-5);
                let blended: DVec3 = surface
                    .influences(at)
                    .iter()
                    .map(|(i, w)| patch.points[0][*i].as_dvec3() * *w)
                    .sum();
                prop_assert!(whole.position.distance(blended) < 1e-12);
            }
            let n = faces.normal(face, [s, t]);
            prop_assert!(n == DVec3::ZERO || (n.length() - 1.0).abs() < 1e-12);
            for k in 0..4 {
                prop_assert!((faces.vertex(face, k) as usize) < faces.vertex_count());
                prop_assert!((faces.edge(face, k).edge as usize) < faces.edge_count());
            }
        }
    }

    #[test]
    fn bernstein_agrees_with_the_b_spline_basis(degree in 1usize..12, t in 0.0..=1.0_f64) {
        let knots = [vec![0.0; degree + 1], vec![1.0; degree + 1]].concat();
        let b = basis::bernstein::<16>(degree, t);
        let n = basis::functions(&knots, degree + 1, degree, t);
        for (b, n) in b.iter().zip(&n) {
            for (b, n) in b.iter().zip(n) {
                prop_assert!((b - n).abs() < 1e-11 * (1.0 + n.abs()), "{b} {n}");
            }
        }
    }
}
