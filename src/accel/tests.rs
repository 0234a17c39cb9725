//! The plain tree against a loop over all micro-triangles, and against rays that must not escape.

use std::sync::Arc;

use super::*;
use crate::math::{DVec3, Ray};
use crate::surface::tests::leaks::escapes;
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{closed, displacements, effort, mixed, surface};
use crate::surface::{Diced, Rates, Surface};

fn diced(surface: &Surface) -> Arc<Diced> {
    Arc::new(Diced::new(surface, &mixed(surface)))
}

/// Where a ray meets a triangle, in double precision (Möller and Trumbore 1997), and how far inside of it.
pub(crate) fn met_in_double(ray: &Ray, [a, b, c]: [DVec3; 3]) -> Option<(f64, f64)> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = o - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = d.dot(q) / det;
    let t = e2.dot(q) / det;
    let inside = u.min(v).min(1.0 - u - v);
    let met = inside >= 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max);
    met.then_some((t, inside))
}

/// The nearest hit among all micro-triangles, in double precision; and how far inside of its triangle it is.
pub(crate) fn brute_force(diced: &Diced, ray: &Ray) -> Option<(f64, u64, f64)> {
    let keys = diced.positions();
    let last = keys.len() - 1;
    let at = f64::from(ray.time) * last as f64;
    let from = (at as usize).min(last.saturating_sub(1));
    let (to, f) = ((from + 1).min(last), at - from as f64);
    (0..diced.triangles())
        .filter_map(|triangle| {
            let corners = diced.corners(triangle).map(|v| {
                let at = |key: usize| -> DVec3 { keys[key][v as usize].as_dvec3() };
                at(from).lerp(at(to), f)
            });
            let (t, inside) = met_in_double(ray, corners)?;
            Some((t, triangle, inside))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// A ray from somewhere around a surface within a ball of radius 2 to somewhere in it.
pub(crate) fn random_ray(random: &mut Random) -> Ray {
    let origin = 3.0 * random.direction();
    let target = 1.5 * random.next() * random.direction();
    Ray::new(
        origin,
        (target - origin) * (0.1 + random.next()),
        random.next(),
    )
}

#[test]
fn hits_are_those_of_a_loop_over_all_triangles() {
    for (shape, base) in closed() {
        for (kind, displacement) in displacements(0.15) {
            let surface = surface(base.clone().moving(|p| p + 0.3 * Vec3::X), displacement);
            let tree = Tessellated::build(diced(&surface));
            let mut random = Random(3);
            let mut hits = 0;
            for _ in 0..60 {
                let ray = random_ray(&mut random);
                let (expected, got) = (brute_force(tree.diced(), &ray), tree.intersect(0, &ray));
                assert_eq!(tree.occluded(0, &ray), got.is_some(), "{shape} {kind}");
                match (expected, got) {
                    (None, None) => {}
                    (Some((t, triangle, _)), Some(hit)) => {
                        hits += 1;
                        assert!(
                            (t - f64::from(hit.t)).abs() < 1e-4,
                            "{shape} {kind}: {t} {hit:?}"
                        );
                        // On the right face, where the surface is near.
                        let (grid, _) = tree.diced().locate(triangle);
                        if grid.face == hit.face {
                            let here = surface
                                .evaluate(hit.face, hit.uv, 0)
                                .position
                                .lerp(surface.evaluate(hit.face, hit.uv, 1).position, ray.time);
                            assert!(here.distance(ray.at(hit.t)) < 0.5, "{shape} {kind}: {here}");
                        }
                        assert!(hit.error < 1e-5, "{hit:?}");
                        assert!(hit.normal.is_finite());
                    }
                    // Decided by rounding where the ray passes an edge.
                    (Some((_, _, inside)), None) => assert!(inside < 1e-5, "{shape} {kind}"),
                    (None, Some(hit)) => panic!("{shape} {kind}: {hit:?} on nothing"),
                }
            }
            assert!(hits > 10, "{shape} {kind}: {hits}");
        }
    }
}

/// A million rays (times `RELIEVO_EFFORT`) from inside of closed, creased, displaced shapes; none escapes.
#[test]
fn no_ray_escapes() {
    let escaped = escapes(effort(1_000_000), Tessellated::build, |tree, ray| {
        let met = tree.occluded(0, ray);
        assert_eq!(met, tree.intersect(0, ray).is_some());
        met
    });
    println!("{escaped}");
    assert_eq!((escaped.at_vertices, escaped.elsewhere), (0, 0));
}

#[test]
fn an_interval_is_open_and_both_sides_are_hit() {
    let surface = surface(Patches::cube(), displacements(0.0).remove(0).1);
    let tree = Tessellated::build(Arc::new(Diced::new(&surface, &Rates::uniform(&surface, 4))));
    let ray = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z, 0.0);
    let first = tree.intersect(0, &ray).expect("a hit");
    assert_eq!((first.t, first.face), (2.0, 0));
    assert!(first.normal.z > 0.0 && (first.uv - Vec2::new(0.55, 0.6)).length() < 1e-6);
    let beyond = Ray { t_min: 2.0, ..ray };
    assert_eq!(tree.intersect(0, &beyond).expect("the other side").t, 4.0);
    let before = Ray { t_max: 2.0, ..ray };
    assert!(tree.intersect(0, &before).is_none() && !tree.occluded(0, &before));
    assert!(tree.bounds(0, 0).min.distance(-Vec3::ONE) < 1e-6);
    assert!(tree.memory() > tree.diced().memory());
}

#[test]
fn no_faces_are_no_hits() {
    let surface = surface(Patches::empty(), displacements(0.0).remove(0).1);
    let tree = Tessellated::build(Arc::new(Diced::new(&surface, &Rates::uniform(&surface, 1))));
    assert!(
        tree.intersect(0, &Ray::new(Vec3::ZERO, Vec3::X, 0.0))
            .is_none()
    );
    assert!(tree.bounds(0, 0).is_empty());
}
