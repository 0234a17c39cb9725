//! Random control meshes: n-gons, borders, any valence, creases, corners and holes.

use std::f32::consts::TAU;

use proptest::prelude::*;

use crate::math::Vec3;
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, CreaseMethod, Interpolation, Primvar,
    Scheme, TriangleRule,
};

/// A mesh of these faces.
pub(super) fn mesh(scheme: Scheme, points: Vec<Vec3>, faces: &[Vec<u32>]) -> ControlMesh {
    ControlMesh {
        scheme,
        face_vertex_counts: faces.iter().map(|f| f.len() as u32).collect(),
        face_vertex_indices: faces.concat(),
        points: vec![points],
        ..ControlMesh::default()
    }
}

/// Points (x, y, 0) of an m x n grid of quads, or of twice as many triangles.
pub(super) fn grid(scheme: Scheme, m: u32, n: u32) -> ControlMesh {
    let points = (0..=n).flat_map(|y| (0..=m).map(move |x| Vec3::new(x as f32, y as f32, 0.0)));
    let mut faces = Vec::new();
    for y in 0..n {
        for x in 0..m {
            let a = y * (m + 1) + x;
            let quad = [a, a + 1, a + m + 2, a + m + 1];
            if scheme == Scheme::Loop {
                faces.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| quad[i]).to_vec()));
            } else {
                faces.push(quad.to_vec());
            }
        }
    }
    mesh(scheme, points.collect(), &faces)
}

/// A cube of side 2 about the origin.
pub(super) fn cube(scheme: Scheme) -> ControlMesh {
    let points = (0..8).map(|i| {
        let side = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        Vec3::new(side(0), side(1), side(2))
    });
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let faces: Vec<Vec<u32>> = match scheme {
        Scheme::Loop => quads
            .iter()
            .flat_map(|q| [vec![q[0], q[1], q[2]], vec![q[0], q[2], q[3]]])
            .collect(),
        _ => quads.iter().map(|q| q.to_vec()).collect(),
    };
    mesh(scheme, points.collect(), &faces)
}

/// A vertex with `n` faces around it, wavy.
pub(super) fn wheel(scheme: Scheme, n: u32) -> ControlMesh {
    let at = |i: u32, r: f32| {
        let angle = TAU * i as f32 / (2 * n) as f32;
        Vec3::new(r * angle.cos(), r * angle.sin(), 0.2 * (3.0 * angle).sin())
    };
    let mut points = vec![Vec3::new(0.0, 0.0, 0.5)];
    points.extend((0..2 * n).map(|i| at(i, if i % 2 == 0 { 1.0 } else { 1.3 })));
    points.extend((0..2 * n).map(|i| at(i, 2.0)));
    let mut faces = Vec::new();
    for i in 0..n {
        let [a, b, c] = [2 * i, 2 * i + 1, (2 * i + 2) % (2 * n)].map(|k| k + 1);
        let out = 2 * n;
        let quads = [
            [0, a, b, c],
            [a, a + out, b + out, b],
            [b, b + out, c + out, c],
        ];
        if scheme == Scheme::Loop {
            faces.push(vec![0, a, c]);
            faces.push(vec![a, b, c]);
            for q in &quads[1..] {
                faces.extend([vec![q[0], q[1], q[2]], vec![q[0], q[2], q[3]]]);
            }
        } else {
            faces.extend(quads.map(|q| q.to_vec()));
        }
    }
    mesh(scheme, points, &faces)
}

/// What is done to a mesh, as raw numbers.
#[derive(Clone)]
pub(super) struct Dice {
    base: u8,
    size: [u32; 2],
    faces: Vec<u8>,
    shifts: Vec<[i8; 3]>,
    edges: Vec<u8>,
    corners: Vec<u8>,
    rules: [u8; 3],
}

impl std::fmt::Debug for Dice {
    /// On one line, and the mesh's faces and tags rather than the numbers themselves.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for scheme in [Scheme::CatmullClark, Scheme::Loop] {
            let mesh = random(scheme, self);
            let faces = mesh.faces().map(|r| &mesh.face_vertex_indices[r]);
            let sharp = |c: &Crease| (c.vertices, c.sharpness);
            write!(
                f,
                "{scheme:?}: faces {:?}, creases {:?}, corners {:?}, holes {:?}, {:?}, {:?}; ",
                faces.collect::<Vec<_>>(),
                mesh.creases.iter().map(sharp).collect::<Vec<_>>(),
                mesh.corners
                    .iter()
                    .map(|c| (c.vertex, c.sharpness))
                    .collect::<Vec<_>>(),
                mesh.holes,
                mesh.boundary,
                mesh.crease_method,
            )?;
        }
        Ok(())
    }
}

pub(super) fn dice() -> impl Strategy<Value = Dice> {
    (
        0_u8..4,
        (2_u32..4, 2_u32..4),
        proptest::collection::vec(any::<u8>(), 32),
        proptest::collection::vec(any::<[i8; 3]>(), 64),
        proptest::collection::vec(any::<u8>(), 64),
        proptest::collection::vec(any::<u8>(), 16),
        any::<[u8; 3]>(),
    )
        .prop_map(
            |(base, (m, n), faces, shifts, edges, corners, rules)| Dice {
                base,
                size: [m, n],
                faces,
                shifts,
                edges,
                corners,
                rules,
            },
        )
}

/// Sharpnesses to choose from; they have all decayed after four levels.
const SHARPNESSES: [f32; 10] = [10.0, 0.3, 0.8, 1.0, 1.4, 2.0, 2.7, 3.1, 12.0, 0.05];

/// Levels after which nothing decays any more.
pub(super) const DECAYED: u32 = 4;

/// The mesh that the dice make, by one scheme; some face-varying values are on it.
pub(super) fn random(scheme: Scheme, dice: &Dice) -> ControlMesh {
    let [m, n] = dice.size;
    let base = match dice.base {
        0 => cube(Scheme::CatmullClark),
        1 => wheel(Scheme::CatmullClark, m + n + u32::from(dice.rules[2] % 4)),
        _ => grid(Scheme::CatmullClark, m, n),
    };
    let mut faces: Vec<Vec<u32>> = Vec::new();
    let mut points = base.points[0].clone();
    let roll = |i: usize| dice.faces[i % dice.faces.len()];
    for (i, range) in base.faces().enumerate() {
        let quad = &base.face_vertex_indices[range];
        let halves = |k: usize| {
            let at = |i: usize| quad[(k + i) % 4];
            [vec![at(0), at(1), at(2)], vec![at(0), at(2), at(3)]]
        };
        match (roll(i) % 16, scheme) {
            (0, _) => {}
            (1, _) => {
                let middle = points.len() as u32;
                points.push(quad.iter().map(|&v| points[v as usize]).sum::<Vec3>() / 4.0);
                faces.extend((0..4).map(|k| vec![quad[k], quad[(k + 1) % 4], middle]));
            }
            (k, Scheme::Loop) => faces.extend(halves(usize::from(k))),
            (k @ 2..=3, _) => faces.extend(halves(usize::from(k))),
            (4, _) => {
                // A pentagon and a triangle: a vertex in the middle of a diagonal.
                let middle = points.len() as u32;
                let [a, c] = [points[quad[0] as usize], points[quad[2] as usize]];
                points.push(a.lerp(c, 0.4));
                faces.push(vec![quad[0], quad[1], quad[2], middle]);
                faces.push(vec![quad[0], middle, quad[2], quad[3]]);
            }
            _ => faces.push(quad.to_vec()),
        }
    }
    if scheme != Scheme::Loop {
        merge_some(&mut faces, &dice.faces);
    }
    if faces.is_empty() {
        faces.push(vec![0, 1, 2]);
    }
    for (i, point) in points.iter_mut().enumerate() {
        let [x, y, z] = dice.shifts[i % dice.shifts.len()].map(|x| f32::from(x) / 400.0);
        *point += Vec3::new(x, y, z);
    }
    let mut mesh = mesh(scheme, points, &faces);
    sharpen(&mut mesh, dice);
    let corners = mesh.face_vertex_indices.len();
    mesh.primvars.push(Primvar {
        name: "st".to_owned(),
        interpolation: Interpolation::FaceVarying,
        width: 2,
        values: (0..2 * corners)
            .map(|i| {
                let vertex = mesh.face_vertex_indices[i / 2] as usize;
                mesh.points[0][vertex].to_array()[i % 2]
            })
            .collect(),
        // Corners share their vertex' element, but for a few seams.
        indices: Some(seams(&mesh, dice)),
    });
    mesh.validate().expect("a valid mesh");
    mesh
}

fn seams(mesh: &ControlMesh, dice: &Dice) -> Vec<u32> {
    let mut first: Vec<Option<u32>> = vec![None; mesh.point_count()];
    let mut cut: Vec<Option<u32>> = vec![None; mesh.point_count()];
    let mut indices = Vec::new();
    for (f, range) in mesh.faces().enumerate() {
        let apart = dice.faces[(f + 7) % dice.faces.len()].is_multiple_of(4);
        for corner in range {
            let vertex = mesh.face_vertex_indices[corner] as usize;
            let side = if apart { &mut cut } else { &mut first };
            indices.push(*side[vertex].get_or_insert(corner as u32));
        }
    }
    indices
}

/// Makes one face of a few pairs of neighbours that share one edge.
fn merge_some(faces: &mut Vec<Vec<u32>>, rolls: &[u8]) {
    for &roll in rolls.iter().take(2).filter(|r| r.is_multiple_of(3)) {
        let a = usize::from(roll) % faces.len().max(1);
        let Some(face) = faces.get(a).cloned() else {
            return;
        };
        let n = face.len();
        let neighbour = (0..n).find_map(|i| {
            let (v, w) = (face[i], face[(i + 1) % n]);
            let b = faces.iter().position(|f| {
                (0..f.len()).any(|j| f[j] == w && f[(j + 1) % f.len()] == v)
                    && f.iter().filter(|x| face.contains(x)).count() == 2
            })?;
            Some((b, i, v))
        });
        if let Some((b, i, v)) = neighbour {
            let other = faces[b].clone();
            let start = other.iter().position(|&x| x == v).unwrap_or(0);
            let mut merged: Vec<u32> = (0..n).map(|k| face[(i + 1 + k) % n]).collect();
            merged.extend((1..other.len() - 1).map(|k| other[(start + k) % other.len()]));
            faces[a] = merged;
            faces.remove(b);
        }
    }
}

fn sharpen(mesh: &mut ControlMesh, dice: &Dice) {
    let topology = mesh.topology();
    for edge in 0..topology.edge_count() {
        let roll = dice.edges[edge % dice.edges.len()];
        if roll.is_multiple_of(5) {
            mesh.creases.push(Crease {
                vertices: topology.edge_vertices(edge as u32),
                sharpness: SHARPNESSES[usize::from(roll / 5) % SHARPNESSES.len()],
            });
        }
    }
    for (vertex, &roll) in (0_u32..).zip(&dice.corners) {
        if roll.is_multiple_of(12) && (vertex as usize) < mesh.point_count() {
            mesh.corners.push(Corner {
                vertex,
                sharpness: SHARPNESSES[usize::from(roll / 12) % SHARPNESSES.len()],
            });
        }
    }
    let faces = mesh.face_count() as u32;
    if dice.corners[0].is_multiple_of(3) {
        mesh.holes.push(u32::from(dice.corners[1]) % faces);
    }
    mesh.boundary = match dice.rules[0] % 4 {
        0 => BoundaryInterpolation::None,
        1 => BoundaryInterpolation::EdgeOnly,
        _ => BoundaryInterpolation::EdgeAndCorner,
    };
    if dice.rules[1].is_multiple_of(3) {
        mesh.crease_method = CreaseMethod::Chaikin;
    }
    if dice.rules[1].is_multiple_of(4) {
        mesh.triangle_rule = TriangleRule::Smooth;
    }
}
