//! Charles Loop, *Smooth Subdivision Surfaces Based on Triangles*, 1987: each triangle becomes four, and the points
//! are smoothed so that the limit is a quartic box spline away from vertices of valence other than 6.
//!
//! Sharp edges, darts, creases and corners are those of Hoppe et al., *Piecewise Smooth Surface Reconstruction*,
//! 1994, semi-sharp ones those of DeRose, Kass, Truong, *Subdivision Surfaces in Character Animation*, 1998, both
//! with OpenSubdiv's departures: crease points are ½, ½ whatever their ends are (no 3 : 5 at irregular crease
//! vertices), and a vertex whose rule changes within a step blends the two masks with the mean sharpness of what
//! becomes smooth there.
//!
//! ```text
//!          v2                Children 0, 1, 2 keep the corner of that number in its place; child 3 is the
//!         /  \               middle one, turned by half: (e1, e2, e0). In the parent's (u, v) the corners are
//!        / 2  \              v0 = (0, 0), v1 = (1, 0), v2 = (0, 1).
//!      e2 ---- e1
//!      / \ 3  / \            Point i of the parent is point i of the child; the point of edge e follows as
//!     / 0 \  / 1 \           number (points of the parent) + e.
//!   v0 --- e0 --- v1
//! ```

use std::collections::HashMap;
use std::f64::consts::TAU;

use super::edges::{Edges, decayed, is_semi_sharp, next, previous};
use super::stencils::Stencils;
use crate::math::Vec2;
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, CreaseMethod, Interpolation, Primvar,
};

/// A refined mesh, and where its faces come from.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The finer mesh: all motion keys, primvars, tags that still matter.
    pub mesh: ControlMesh,
    /// The face of the coarser mesh that each face lies in.
    pub parent_face: Vec<u32>,
    /// (u, v) of each face's three corners in that face.
    pub uv: Vec<[Vec2; 3]>,
}

/// Refines once. Vertex primvars follow the points; varying and face-varying ones are linear.
///
/// Under [`BoundaryInterpolation::None`] faces at the border become holes: they have no limit.
///
/// # Panics
/// If a face is not a triangle, or if the result had more corners than 32 bits can number (its parent more than
/// 357 million faces).
pub fn refine(mesh: &ControlMesh) -> Refined {
    assert_triangles(mesh);
    let faces = mesh.face_count();
    assert!(
        faces as u64 * 12 <= u64::from(u32::MAX),
        "{faces} triangles cannot be refined within 32 bits"
    );
    let edges = Edges::of(mesh);
    let points = mesh.point_count() as u32;

    // Faces.
    let mut face_vertex_indices = Vec::with_capacity(faces * 12);
    let mut parent_face = Vec::with_capacity(faces * 4);
    for (f, v) in mesh.face_vertex_indices.chunks_exact(3).enumerate() {
        let [e0, e1, e2] = [0, 1, 2].map(|i| points + edges.of_corner[3 * f + i]);
        face_vertex_indices.extend([v[0], e0, e2, e0, v[1], e1, e2, e1, v[2], e1, e2, e0]);
        parent_face.extend([f as u32; 4]);
    }
    let [o, u, v] = [Vec2::ZERO, Vec2::X, Vec2::Y];
    let [e0, e1, e2] = [(o + u) / 2.0, (u + v) / 2.0, (v + o) / 2.0];
    let uv = [[o, e0, e2], [e0, u, e1], [e2, e1, v], [e1, e2, e0]].repeat(faces);

    // Points, and what follows them.
    let follow = step(mesh, &edges);
    let linear = linear(mesh, &edges);
    let primvar = |p: &Primvar| {
        let width = p.width as usize;
        let (values, indices) = match p.interpolation {
            Interpolation::Constant => (p.values.clone(), p.indices.clone()),
            Interpolation::Uniform => {
                let element = |&f: &u32| p.indices.as_ref().map_or(f, |i| i[f as usize]);
                let indices = parent_face.iter().map(element).collect();
                (p.values.clone(), Some(indices))
            }
            Interpolation::Varying => (linear.values(width, |i| p.get(i)), None),
            Interpolation::Vertex => (follow.values(width, |i| p.get(i)), None),
            Interpolation::FaceVarying => {
                let (values, indices) = refine_face_varying(p, mesh.face_vertex_indices.len());
                (values, Some(indices))
            }
        };
        Primvar {
            values,
            indices,
            ..p.clone()
        }
    };

    let mesh = ControlMesh {
        scheme: mesh.scheme,
        face_vertex_counts: vec![3; faces * 4],
        face_vertex_indices,
        points: mesh.points.iter().map(|p| follow.points(p)).collect(),
        creases: child_creases(&edges, points),
        corners: child_corners(mesh),
        holes: child_holes(mesh, &edges),
        boundary: mesh.boundary,
        face_varying: mesh.face_varying,
        triangle_rule: mesh.triangle_rule,
        crease_method: mesh.crease_method,
        left_handed: mesh.left_handed,
        primvars: mesh.primvars.iter().map(primvar).collect(),
        normals: None,
    };
    Refined {
        mesh,
        parent_face,
        uv,
    }
}

/// Refines `levels` times; faces and (u, v) are those of `mesh` itself. No levels give `mesh` again.
///
/// # Panics
/// As for [`refine`].
pub fn refine_levels(mesh: &ControlMesh, levels: u32) -> Refined {
    assert_triangles(mesh);
    let mut all = Refined {
        mesh: mesh.clone(),
        parent_face: (0..mesh.face_count() as u32).collect(),
        uv: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]; mesh.face_count()],
    };
    for _ in 0..levels {
        let mut finer = refine(&all.mesh);
        for (parent, uv) in finer.parent_face.iter_mut().zip(&mut finer.uv) {
            let [o, u, v] = all.uv[*parent as usize];
            *uv = uv.map(|p| o + (u - o) * p.x + (v - o) * p.y);
            *parent = all.parent_face[*parent as usize];
        }
        all = finer;
    }
    all
}

/// `mesh` with its points and vertex primvars carried to the limit surface.
///
/// Sharpness that is left counts as infinite: refine until it has decayed for the exact limit. A dart, where one
/// sharp edge ends, takes the smooth mask as in OpenSubdiv; that is an approximation, better at each level.
///
/// # Panics
/// If a face is not a triangle.
pub fn limit(mesh: &ControlMesh) -> ControlMesh {
    assert_triangles(mesh);
    let edges = Edges::of(mesh);
    let mut stencils = Stencils::with_capacity(mesh.point_count());
    for v in 0..mesh.point_count() as u32 {
        let at = edges.at(v);
        let sharp = |e: u32| edges.sharpness(e) > 0.0;
        match rule(edges.vertex_sharpness[v as usize], at, sharp) {
            Rule::Smooth if at.is_empty() => stencils.add(v, 1.0),
            Rule::Smooth => {
                let n = at.len() as f64;
                let weight = 1.0 / (n + 3.0 / (8.0 * smooth_weight(at.len())));
                stencils.add(v, 1.0 - n * weight);
                for &e in at {
                    stencils.add(edges.far_end(e, v), weight);
                }
            }
            Rule::Crease(ends) => {
                stencils.add(v, 2.0 / 3.0);
                for e in ends {
                    stencils.add(edges.far_end(e, v), 1.0 / 6.0);
                }
            }
            Rule::Corner => stencils.add(v, 1.0),
        }
        stencils.end_row();
    }
    let mut limit = mesh.clone();
    limit.points = mesh.points.iter().map(|p| stencils.points(p)).collect();
    for primvar in &mut limit.primvars {
        if primvar.interpolation == Interpolation::Vertex {
            primvar.values = stencils.values(primvar.width as usize, |i| primvar.get(i));
            primvar.indices = None;
        }
    }
    limit
}

fn assert_triangles(mesh: &ControlMesh) {
    assert!(
        mesh.face_vertex_counts.iter().all(|&n| n == 3),
        "Loop subdivision of faces other than triangles"
    );
}

/// What shapes a vertex; a dart is smooth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rule {
    Smooth,
    /// Along two edges.
    Crease([u32; 2]),
    Corner,
}

fn rule(vertex_sharpness: f32, edges: &[u32], sharp: impl Fn(u32) -> bool) -> Rule {
    if vertex_sharpness > 0.0 {
        return Rule::Corner;
    }
    let mut sharp = edges.iter().copied().filter(|&e| sharp(e));
    match (sharp.next(), sharp.next(), sharp.next()) {
        (Some(a), Some(b), None) => Rule::Crease([a, b]),
        (_, _, Some(_)) => Rule::Corner,
        _ => Rule::Smooth,
    }
}

/// Loop's weight of each of `n` neighbours in a smooth vertex' step: (5/8 − (3/8 + cos(2π/n)/4)²)/n.
fn smooth_weight(n: usize) -> f64 {
    let n = n as f64;
    let half = 0.375 + 0.25 * (TAU / n).cos();
    (0.625 - half * half) / n
}

/// The masks of one step: vertex points, then edge points.
fn step(mesh: &ControlMesh, edges: &Edges) -> Stencils {
    let mut stencils = Stencils::with_capacity(mesh.point_count() + edges.ends.len());
    for v in 0..mesh.point_count() as u32 {
        vertex_mask(mesh, edges, v, &mut stencils);
        stencils.end_row();
    }
    for (e, &[a, b]) in (0..).zip(&edges.ends) {
        // Wholly sharp from 1 on, a blend below.
        let crease = f64::from(edges.sharpness(e).min(1.0));
        let smooth = 1.0 - crease;
        stencils.add(a, 0.375 * smooth + 0.5 * crease);
        stencils.add(b, 0.375 * smooth + 0.5 * crease);
        for &c in edges.corners(e) {
            let opposite = mesh.face_vertex_indices[previous(c) as usize];
            stencils.add(opposite, 0.125 * smooth);
        }
        stencils.end_row();
    }
    stencils
}

fn vertex_mask(mesh: &ControlMesh, edges: &Edges, v: u32, stencils: &mut Stencils) {
    let at = edges.at(v);
    let sharpness = edges.vertex_sharpness[v as usize];
    let child_sharpness = decayed(sharpness);
    let before = rule(sharpness, at, |e| edges.sharpness(e) > 0.0);
    let after = rule(child_sharpness, at, |e| edges.child_sharpness(e, v) > 0.0);

    let mut add = |rule: Rule, share: f64| match rule {
        Rule::Smooth if at.is_empty() => stencils.add(v, share),
        Rule::Smooth => {
            let weight = smooth_weight(at.len());
            stencils.add(v, share * (1.0 - at.len() as f64 * weight));
            for &e in at {
                stencils.add(edges.far_end(e, v), share * weight);
            }
        }
        Rule::Crease(ends) => {
            stencils.add(v, share * 0.75);
            for e in ends {
                stencils.add(edges.far_end(e, v), share * 0.125);
            }
        }
        Rule::Corner => stencils.add(v, share),
    };
    if before == after {
        add(before, 1.0);
        return;
    }

    // The rule changes within this step: blend by what becomes smooth.
    let chaikin = mesh.crease_method == CreaseMethod::Chaikin;
    let ends = |e: u32| {
        let s = edges.sharpness(e);
        is_semi_sharp(s)
            && if chaikin {
                edges.child_sharpness(e, v) <= 0.0
            } else {
                s <= 1.0
            }
    };
    let own = (is_semi_sharp(sharpness) && child_sharpness <= 0.0).then_some(sharpness);
    let edges_ending = at.iter().filter(|&&e| ends(e)).map(|&e| edges.sharpness(e));
    let (sum, count) = own
        .into_iter()
        .chain(edges_ending)
        .fold((0.0, 0.0), |(sum, n), s| (sum + f64::from(s), n + 1.0));
    let share = if count > 0.0 {
        f64::min(sum / count, 1.0)
    } else {
        0.0
    };
    add(before, share);
    add(after, 1.0 - share);
}

/// Points stay, edge points are in the middle.
fn linear(mesh: &ControlMesh, edges: &Edges) -> Stencils {
    let mut stencils = Stencils::with_capacity(mesh.point_count() + edges.ends.len());
    for v in 0..mesh.point_count() as u32 {
        stencils.add(v, 1.0);
        stencils.end_row();
    }
    for &[a, b] in &edges.ends {
        stencils.add(a, 0.5);
        stencils.add(b, 0.5);
        stencils.end_row();
    }
    stencils
}

/// Linear, and continuous wherever it was: elements stay, and each pair of them that an edge joins gets its middle.
fn refine_face_varying(primvar: &Primvar, corners: usize) -> (Vec<f32>, Vec<u32>) {
    let width = primvar.width as usize;
    let element = |c: u32| primvar.indices.as_ref().map_or(c, |i| i[c as usize]);
    let mut values = primvar.values.clone();
    let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
    let mut middle = |c: u32| {
        let (a, b) = (element(c), element(next(c)));
        *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let number = (values.len() / width) as u32;
            for i in 0..width {
                let (x, y) = (
                    values[a as usize * width + i],
                    values[b as usize * width + i],
                );
                values.push(0.5 * x + 0.5 * y);
            }
            number
        })
    };
    let mut indices = Vec::with_capacity(corners * 4);
    for c in (0..corners as u32).step_by(3) {
        let [v0, v1, v2] = [c, c + 1, c + 2].map(element);
        let [e0, e1, e2] = [c, c + 1, c + 2].map(&mut middle);
        indices.extend([v0, e0, e2, e0, v1, e1, e2, e1, v2, e1, e2, e0]);
    }
    (values, indices)
}

fn child_creases(edges: &Edges, points: u32) -> Vec<Crease> {
    let mut creases = Vec::new();
    for e in (0..edges.ends.len() as u32).filter(|&e| edges.authored(e) > 0.0) {
        for v in edges.ends[e as usize] {
            let sharpness = edges.child_sharpness(e, v);
            if sharpness > 0.0 {
                creases.push(Crease {
                    vertices: [v, points + e],
                    sharpness,
                });
            }
        }
    }
    creases
}

fn child_corners(mesh: &ControlMesh) -> Vec<Corner> {
    let decay = |c: &Corner| Corner {
        sharpness: decayed(c.sharpness),
        ..*c
    };
    // Smooth ones stay: of several tags on one vertex the last one counts.
    mesh.corners.iter().map(decay).collect()
}

fn child_holes(mesh: &ControlMesh, edges: &Edges) -> Vec<u32> {
    let mut hole = vec![false; mesh.face_count()];
    for &f in &mesh.holes {
        hole[f as usize] = true;
    }
    if mesh.boundary == BoundaryInterpolation::None {
        for (hole, face) in hole
            .iter_mut()
            .zip(mesh.face_vertex_indices.chunks_exact(3))
        {
            *hole |= face.iter().any(|&v| edges.at_border(v));
        }
    }
    let holes = (0_u32..).zip(hole).filter(|&(_, hole)| hole);
    holes.flat_map(|(f, _)| 4 * f..4 * f + 4).collect()
}
