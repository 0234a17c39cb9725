//! Polygons into triangles: convex ones as a fan, concave ones by ear clipping in their best-fit plane.

use std::ops::Range;

use earcut::Earcut;

use super::ControlMesh;
use crate::math::DVec3;

/// The triangles of a mesh, in the order of its faces; a face of n corners has n − 2.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Triangles {
    /// Three corners each: positions in `face_vertex_indices`, counterclockwise seen from the front.
    pub corners: Vec<[u32; 3]>,
    /// The face that each triangle is part of.
    pub faces: Vec<u32>,
}

/// Triangulates a valid mesh by its points at the first motion key. Holes have no triangles.
///
/// Quads become 0-1-2 and 0-2-3 unless only the other diagonal lies inside; faces without area become fans.
pub fn triangulate(mesh: &ControlMesh) -> Triangles {
    let mut hole = vec![false; mesh.face_count()];
    for &f in &mesh.holes {
        hole[f as usize] = true;
    }
    let mut triangles = Triangles::default();
    let mut earcut = Earcut::new();
    let mut local = Vec::new();
    for (f, range) in mesh.faces().enumerate().filter(|&(f, _)| !hole[f]) {
        local.clear();
        polygon(mesh, range.clone(), &mut earcut, &mut local);
        for &[a, b, c] in &local {
            let [b, c] = if mesh.left_handed { [c, b] } else { [b, c] };
            triangles
                .corners
                .push([a, b, c].map(|i| range.start as u32 + i));
            triangles.faces.push(f as u32);
        }
    }
    triangles
}

/// Adds the triangles of one face, corners numbered from 0.
fn polygon(
    mesh: &ControlMesh,
    range: Range<usize>,
    earcut: &mut Earcut<f64>,
    out: &mut Vec<[u32; 3]>,
) {
    let n = range.len() as u32;
    let fan = |out: &mut Vec<[u32; 3]>| out.extend((2..n).map(|i| [0, i - 1, i]));
    if n == 3 {
        return fan(out);
    }
    let Some(first) = mesh.points.first() else {
        return fan(out);
    };
    let corner = |i: u32| {
        let point = mesh.face_vertex_indices[range.start + (i % n) as usize];
        first[point as usize].as_dvec3()
    };
    // Newell's normal, around the first corner so that large coordinates do not cancel.
    let origin = corner(0);
    let normal: DVec3 = (0..n)
        .map(|i| (corner(i) - origin).cross(corner(i + 1) - origin))
        .sum();
    let Some(normal) = normal.try_normalize() else {
        return fan(out);
    };
    let area = |[a, b, c]: [u32; 3]| {
        (corner(b) - corner(a))
            .cross(corner(c) - corner(a))
            .dot(normal)
    };

    if (2..n).all(|i| area([0, i - 1, i]) >= 0.0) && (0..n).all(|i| area([i, i + 1, i + 2]) >= 0.0)
    {
        return fan(out);
    }
    if n == 4 {
        let other = [[1, 2, 3], [1, 3, 0]];
        if [[0, 1, 2], [0, 2, 3]].iter().all(|&t| area(t) >= 0.0) {
            return fan(out);
        }
        if other.iter().all(|&t| area(t) >= 0.0) {
            return out.extend(other);
        }
        return fan(out);
    }

    let (u, v) = normal.any_orthonormal_pair();
    let flat = (0..n).map(|i| {
        let p = corner(i) - origin;
        [p.dot(u), p.dot(v)]
    });
    let mut ears: Vec<u32> = Vec::new();
    earcut.earcut(flat, &[], &mut ears);
    let start = out.len();
    out.extend(ears.chunks_exact(3).map(|t| [t[0], t[1], t[2]]));
    // Earcut has a winding of its own.
    if out[start..].iter().map(|&t| area(t)).sum::<f64>() < 0.0 {
        out[start..].iter_mut().for_each(|t| t.swap(1, 2));
    }
    if !restore_dropped(n, start, out) {
        out.truncate(start);
        fan(out);
    }
}

/// Ear clipping leaves out corners on a straight line: splits the triangle at each of them, so that the neighbours'
/// edges still meet. False if the triangles do not make up the whole face.
fn restore_dropped(n: u32, start: usize, out: &mut Vec<[u32; 3]>) -> bool {
    let mut used = vec![false; n as usize];
    for &i in out[start..].iter().flatten() {
        used[i as usize] = true;
    }
    for k in 0..n {
        if used[k as usize] {
            continue;
        }
        let step = |from: u32, by: u32| {
            (1..n)
                .map(|d| (from + d * by) % n)
                .find(|&i| used[i as usize])
        };
        let (Some(before), Some(after)) = (step(k, n - 1), step(k, 1)) else {
            return false;
        };
        let found = out[start..].iter().enumerate().find_map(|(t, triangle)| {
            let side = (0..3).find(|&s| triangle[s] == before && triangle[(s + 1) % 3] == after)?;
            Some((start + t, triangle[(side + 2) % 3]))
        });
        let Some((t, apex)) = found else {
            return false;
        };
        out[t] = [before, k, apex];
        out.push([k, after, apex]);
        used[k as usize] = true;
    }
    out.len() - start == n as usize - 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn face(points: &[(f32, f32)]) -> ControlMesh {
        ControlMesh {
            face_vertex_counts: vec![points.len() as u32],
            face_vertex_indices: (0..points.len() as u32).collect(),
            points: vec![points.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect()],
            ..ControlMesh::default()
        }
    }

    fn areas(mesh: &ControlMesh) -> Vec<f32> {
        let p = &mesh.points[0];
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| p[mesh.face_vertex_indices[i as usize] as usize]);
            (b - a).cross(c - a).z / 2.0
        };
        triangulate(mesh).corners.iter().map(area).collect()
    }

    #[test]
    fn a_concave_polygon_is_covered_once() {
        let l = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.)];
        for shift in 0..l.len() {
            let mut points = l;
            points.rotate_left(shift);
            let areas = areas(&face(&points));
            assert_eq!(areas.len(), 4);
            assert!(areas.iter().all(|&a| a >= 0.0), "{areas:?}");
            assert!((areas.iter().sum::<f32>() - 3.0).abs() < 1e-6);
        }
    }

    #[test]
    fn corners_on_a_line_are_kept() {
        let l = [
            (0., 0.),
            (1., 0.),
            (2., 0.),
            (2., 1.),
            (1., 1.),
            (1., 2.),
            (0., 2.),
            (0., 1.),
        ];
        let areas = areas(&face(&l));
        assert_eq!(areas.len(), 6);
        assert!((areas.iter().sum::<f32>() - 3.0).abs() < 1e-6);
    }

    #[test]
    fn a_concave_quad_takes_the_inner_diagonal() {
        let mesh = face(&[(0., 0.), (1., 0.2), (2., 0.), (1., 2.)]);
        assert_eq!(triangulate(&mesh).corners, [[1, 2, 3], [1, 3, 0]]);
    }

    #[test]
    fn no_area_gives_a_fan_and_left_handed_turns() {
        let mut mesh = face(&[(0., 0.); 5]);
        mesh.left_handed = true;
        assert_eq!(
            triangulate(&mesh).corners,
            [[0, 2, 1], [0, 3, 2], [0, 4, 3]]
        );
        mesh.holes.push(0);
        assert_eq!(triangulate(&mesh), Triangles::default());
    }
}
