//! Embree's subdivision and ours are one surface, but where Embree's rules are others: where, and by which rule, is
//! what the README's table of known differences says.
//!
//! Points at equal parameters are compared, ours in double precision. What Embree does was read in its source
//! (`kernels/subdiv` of 3.13 and 4.3: `half_edge.h`, `catmullclark_ring.h`, `catmullclark_patch.h`) and is shown here on
//! small cages, one for each rule.

use std::sync::Arc;

use relievo::math::{Vec2, Vec3};
use relievo::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, CreaseMethod, Topology, TriangleRule,
};
use relievo::scene::{LoadOptions, obj};
use relievo::subdiv::{Field, LimitSurface};
use relievo::trace::{
    Device, DeviceOptions, Geometry, Rates, Scene, SceneBuilder, SceneOptions, SubdivisionOptions,
    face_uv,
};

use crate::common::shared;

/// Farther apart than this part of the cage's box, points differ.
const SAME: f32 = 1e-3;

/// Samples along each side of a Ptex face, its border included.
const SAMPLES: u16 = 13;

/// A cage by both.
struct Both {
    mesh: ControlMesh,
    limit: LimitSurface,
    points: Field<f64>,
    embree: Scene,
}

impl Both {
    /// Nothing if Embree refuses the cage.
    fn new(device: &Device, mesh: ControlMesh) -> Option<Self> {
        Self::against(device, mesh.clone(), mesh)
    }

    /// One cage by us, another by Embree; of the same faces, holes aside.
    fn against(device: &Device, mesh: ControlMesh, embrees: ControlMesh) -> Option<Self> {
        let options = SubdivisionOptions {
            rates: Rates::Uniform(2.0),
            displacement: None,
            primvars: Vec::new(),
        };
        let geometry = Geometry::subdivision(device, Arc::new(embrees), options).ok()?;
        let mut scene = SceneBuilder::new(device, SceneOptions::default()).expect("a scene");
        scene.attach(geometry);
        let limit = LimitSurface::new(&mesh);
        Some(Self {
            points: limit.points(&mesh, 0),
            limit,
            embree: scene.commit(&|_| true).expect("a scene"),
            mesh,
        })
    }

    /// Points of a face at equal parameters: ours, and Embree's.
    fn pairs(&self, face: u32) -> impl Iterator<Item = [Vec3; 2]> {
        let ptex = self.limit.ptex_faces(face);
        let is_quad = ptex.len() == 1;
        // At a corner of the parameters the next quad's may be meant: rounding decides.
        let along = |i: u16| (f32::from(i) / f32::from(SAMPLES - 1)).clamp(1e-4, 1.0 - 1e-4);
        let all = (0..SAMPLES).flat_map(|j| (0..SAMPLES).map(move |i| (i, j)));
        (0..).zip(ptex).flat_map(move |(corner, ptex)| {
            all.clone().map(move |(i, j)| {
                let uv = Vec2::new(along(i), along(j));
                let theirs = if is_quad { uv } else { face_uv(corner, uv) };
                [self.ours(ptex, uv), self.embrees(face, theirs)]
            })
        })
    }

    /// How far points of a face are apart, at most, in diagonals of the box.
    fn difference(&self, face: u32) -> f32 {
        let diagonal = self.mesh.bounds().extent().length();
        self.pairs(face).fold(0.0, |most, [ours, embrees]| {
            let difference = ours.distance(embrees) / diagonal;
            if difference.is_nan() {
                f32::INFINITY
            } else {
                difference.max(most)
            }
        })
    }

    fn ours(&self, ptex: u32, uv: Vec2) -> Vec3 {
        let [u, v] = uv.to_array().map(f64::from);
        let p = self.limit.evaluate(&self.points, ptex, u, v).position;
        Vec3::from(p.map(|x| x as f32))
    }

    fn embrees(&self, face: u32, uv: Vec2) -> Vec3 {
        self.embree
            .geometry(0)
            .surface_point(face, uv, 0.0)
            .position
    }

    fn faces(&self) -> impl Iterator<Item = u32> {
        let faces = 0..self.mesh.face_count() as u32;
        faces.filter(|face| !self.mesh.holes.contains(face))
    }

    fn worst(&self) -> f32 {
        self.faces()
            .map(|face| self.difference(face))
            .fold(0.0, f32::max)
    }
}

fn device() -> Device {
    Device::new(&DeviceOptions::default()).expect("a device")
}

#[test]
fn every_cage_agrees_but_at_what_the_readme_names() {
    let Some(shared) = shared("every_cage_agrees_but_at_what_the_readme_names") else {
        return;
    };
    let folder = shared.join("assets/opensubdiv");
    let device = device();
    let (mut compared, mut wrong) = (0, Vec::new());
    let mut cages: Vec<_> = std::fs::read_dir(&folder)
        .expect("a folder of cages")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with("catmark_") && name.ends_with(".obj")
        })
        .collect();
    cages.sort();
    for path in &cages {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let scene = obj::load(path, &LoadOptions::default()).expect("a cage");
        let mesh = scene.shapes[0].geometry.mesh().expect("a mesh");
        let Some(both) = Both::new(&device, ControlMesh::clone(mesh)) else {
            println!("{name}: refused by Embree");
            continue;
        };
        compared += 1;
        let topology = both.mesh.topology();
        let (mut agrees, mut causes) = (0.0_f32, Vec::new());
        for face in both.faces() {
            let difference = both.difference(face);
            if difference <= SAME {
                agrees = agrees.max(difference);
                continue;
            }
            match cause(&both.mesh, &topology, face) {
                Some(cause) => {
                    let known = causes.iter().position(|&(c, _)| c == cause);
                    let known = known.unwrap_or_else(|| {
                        causes.push((cause, 0.0_f32));
                        causes.len() - 1
                    });
                    causes[known].1 = causes[known].1.max(difference);
                }
                None => wrong.push(format!("{name}: face {face} differs by {difference:.1e}")),
            }
        }
        let causes: Vec<String> = causes
            .iter()
            .map(|(cause, difference)| format!("{difference:.1e} by {cause}"))
            .collect();
        println!("{name}: equal to {agrees:.1e}; {}", causes.join(", "));
    }
    assert!(compared > 40, "{compared} of {} cages", cages.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Which of Embree's own rules changes a face: one of those in the README's table, by what its corners touch.
fn cause(mesh: &ControlMesh, topology: &Topology, face: u32) -> Option<&'static str> {
    let corners = topology.face_vertices(face);
    let at = |v: &u32| topology.vertex_corners(*v).iter();
    let sides = |corner: &u32| topology.corners(topology.face(*corner)).len();
    if mesh.triangle_rule == TriangleRule::Smooth
        && corners.iter().flat_map(at).any(|corner| sides(corner) == 3)
    {
        return Some("smooth triangles");
    }
    let with_others = corners.iter().flat_map(at).any(|corner| sides(corner) != 4);
    corners
        .iter()
        .find_map(|&v| cause_at(mesh, topology, v, with_others))
}

/// `with_others` says that not all faces around the face's corners are quads.
fn cause_at(
    mesh: &ControlMesh,
    topology: &Topology,
    vertex: u32,
    with_others: bool,
) -> Option<&'static str> {
    let edges = topology.vertex_edges(vertex);
    let faces: Vec<u32> = topology
        .vertex_corners(vertex)
        .iter()
        .map(|&c| topology.face(c))
        .collect();
    let is_border = edges.iter().any(|&e| topology.is_border(e));
    if faces.iter().any(|face| mesh.holes.contains(face)) {
        return Some("hole");
    }
    if edges.iter().any(|&e| !topology.is_edge_manifold(e)) {
        return Some("edge that is not manifold");
    }
    if !is_border && faces.len() == 2 {
        return Some("inner point of two faces");
    }
    if is_border && faces.len() == 1 && mesh.boundary != BoundaryInterpolation::EdgeAndCorner {
        return Some("smooth corner");
    }
    let sharpness = |edge: u32| {
        let ends = topology.edge_vertices(edge);
        let tagged = mesh
            .creases
            .iter()
            .filter(|crease| crease.vertices == ends || crease.vertices == [ends[1], ends[0]]);
        match topology.is_border(edge) {
            true => Crease::INFINITE,
            false => tagged.fold(0.0, |s, crease| crease.sharpness.max(s)),
        }
    };
    let is_semi_sharp = |s: f32| s > 0.0 && s < Crease::INFINITE;
    let sharp: Vec<f32> = edges
        .iter()
        .map(|&e| sharpness(e))
        .filter(|&s| s > 0.0)
        .collect();
    let tagged = mesh
        .corners
        .iter()
        .any(|c| c.vertex == vertex && is_semi_sharp(c.sharpness));
    if tagged && !sharp.is_empty() {
        return Some("semi-sharp corner on a crease");
    }
    let is_semi = sharp.iter().copied().any(is_semi_sharp);
    match sharp[..] {
        [a, b] if a != b => Some("two creases of different sharpness"),
        [a, _] if a < 1.0 && with_others => Some("blended crease beside faces that are no quads"),
        [_, _, _, ..] if is_semi => Some("three creases, one of them semi-sharp"),
        _ => None,
    }
}

/// A cube from -1 to 1: face 0 below, 5 above; points 0 to 3 below, 4 to 7 above, counterclockwise.
fn cube() -> ControlMesh {
    let at = |z: f32| {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(x, y, z))
    };
    quads(
        &[
            [3, 2, 1, 0],
            [0, 1, 5, 4],
            [1, 2, 6, 5],
            [2, 3, 7, 6],
            [3, 0, 4, 7],
            [4, 5, 6, 7],
        ],
        at(-1.0).into_iter().chain(at(1.0)).collect(),
    )
}

/// The same with two triangles for its top.
fn cut_cube() -> ControlMesh {
    let mut mesh = cube();
    mesh.face_vertex_indices.truncate(20);
    mesh.face_vertex_indices.extend([4, 5, 6, 4, 6, 7]);
    mesh.face_vertex_counts = vec![4, 4, 4, 4, 4, 3, 3];
    mesh
}

fn quads(faces: &[[u32; 4]], points: Vec<Vec3>) -> ControlMesh {
    ControlMesh {
        face_vertex_counts: vec![4; faces.len()],
        face_vertex_indices: faces.concat(),
        points: vec![points],
        ..ControlMesh::default()
    }
}

fn crease(a: u32, b: u32, sharpness: f32) -> Crease {
    Crease {
        vertices: [a, b],
        sharpness,
    }
}

#[test]
fn to_embree_holes_are_no_faces() {
    let device = device();
    let holed = ControlMesh {
        holes: vec![5],
        ..cube()
    };
    let mut open = cube();
    open.face_vertex_counts.pop();
    open.face_vertex_indices.truncate(20);
    let same = Both::new(&device, holed.clone()).expect("taken");
    let as_embree = Both::against(&device, open, holed).expect("taken");
    assert!(same.worst() > 0.05, "{}", same.worst());
    assert!(as_embree.worst() < 1e-5, "{}", as_embree.worst());
}

#[test]
fn embree_averages_the_sharpness_of_two_creases() {
    let device = device();
    let uniform = ControlMesh {
        creases: vec![
            crease(4, 5, 2.0),
            crease(5, 6, 3.0),
            crease(6, 7, 2.0),
            crease(7, 4, 3.0),
        ],
        ..cube()
    };
    let chaikin = ControlMesh {
        crease_method: CreaseMethod::Chaikin,
        ..uniform.clone()
    };
    let same = Both::new(&device, uniform.clone()).expect("taken");
    let as_embree = Both::against(&device, chaikin, uniform).expect("taken");
    assert!(same.worst() > 1e-3, "{}", same.worst());
    assert!(as_embree.worst() < 1e-5, "{}", as_embree.worst());
}

/// Beside an infinite crease the other's average is infinite too: the point stays on a crease for ever.
#[test]
fn embree_makes_a_crease_beside_an_infinite_one_infinite() {
    let mesh = ControlMesh {
        creases: vec![crease(4, 5, Crease::INFINITE), crease(5, 6, 1.0)],
        ..cube()
    };
    let p = mesh.points[0].clone();
    let on_crease = (p[4] + 4.0 * p[5] + p[6]) / 6.0;
    let both = Both::new(&device(), mesh).expect("taken");
    // Point 5 is the second corner of the top.
    let [ours, embrees] =
        [both.ours(5, Vec2::X), both.embrees(5, Vec2::X)].map(|p| p.distance(on_crease));
    assert!(ours > 0.05 && embrees < 1e-3, "{ours} {embrees}");
}

/// The first to end leaves two alike, which no average changes: whatever differs is from where three meet.
#[test]
fn embree_averages_no_sharpness_where_three_creases_meet() {
    let device = device();
    let uniform = ControlMesh {
        creases: vec![crease(5, 1, 2.0), crease(5, 4, 4.0), crease(5, 6, 4.0)],
        ..cube()
    };
    let chaikin = ControlMesh {
        crease_method: CreaseMethod::Chaikin,
        ..uniform.clone()
    };
    let same = Both::new(&device, chaikin.clone()).expect("taken");
    let as_embree = Both::against(&device, uniform, chaikin).expect("taken");
    assert!(same.worst() > SAME, "{}", same.worst());
    assert!(as_embree.worst() < 1e-5, "{}", as_embree.worst());
}

/// The largest step of ours and of Embree's surface when a sharpness goes from none to nearly none.
fn jumps(without: ControlMesh, with: ControlMesh) -> [f32; 2] {
    let device = device();
    let [a, b] = [without, with].map(|mesh| Both::new(&device, mesh).expect("taken"));
    let pairs = a.faces().flat_map(|face| a.pairs(face).zip(b.pairs(face)));
    pairs.fold([0.0; 2], |most, (a, b)| {
        [0, 1].map(|i| a[i].distance(b[i]).max(most[i]))
    })
}

#[test]
fn embree_does_not_blend_the_corner_that_three_creases_make() {
    let without = ControlMesh {
        creases: vec![
            crease(5, 4, Crease::INFINITE),
            crease(5, 6, Crease::INFINITE),
        ],
        ..cube()
    };
    let mut with = without.clone();
    with.creases.push(crease(5, 1, 1e-3));
    let [ours, embrees] = jumps(without, with);
    assert!(ours < 2e-3 && embrees > 0.1, "{ours} {embrees}");
}

#[test]
fn embree_blends_a_corner_on_a_crease_as_if_it_had_none() {
    let without = ControlMesh {
        creases: vec![
            crease(5, 4, Crease::INFINITE),
            crease(5, 6, Crease::INFINITE),
        ],
        ..cube()
    };
    let with = ControlMesh {
        corners: vec![Corner {
            vertex: 5,
            sharpness: 1e-3,
        }],
        ..without.clone()
    };
    let [ours, embrees] = jumps(without, with);
    assert!(ours < 2e-3 && embrees > 0.05, "{ours} {embrees}");
}

#[test]
fn embree_blends_creases_beside_triangles_the_wrong_way_round() {
    let without = cut_cube();
    let with = ControlMesh {
        creases: [(4, 5), (5, 6), (6, 7), (7, 4)]
            .map(|(a, b)| crease(a, b, 1e-3))
            .to_vec(),
        ..without.clone()
    };
    let [ours, embrees] = jumps(without, with);
    assert!(ours < 2e-3 && embrees > 0.1, "{ours} {embrees}");
}

#[test]
fn to_embree_smooth_triangles_are_any_faces() {
    let device = device();
    let mesh = cut_cube();
    let smooth = ControlMesh {
        triangle_rule: TriangleRule::Smooth,
        ..mesh.clone()
    };
    let same = Both::new(&device, smooth.clone()).expect("taken");
    let as_embree = Both::against(&device, mesh, smooth).expect("taken");
    assert!(same.worst() > SAME, "{}", same.worst());
    assert!(as_embree.worst() < 1e-5, "{}", as_embree.worst());
}

const LINE: [Vec3; 3] = [
    Vec3::new(0.0, 0.0, -1.0),
    Vec3::ZERO,
    Vec3::new(0.5, 0.0, 1.0),
];

/// Three strips of two quads each that share a bent line.
fn strips() -> ControlMesh {
    let beside = [Vec3::X, Vec3::Y, -Vec3::X].map(|aside| LINE.map(|p| p + aside));
    let points = LINE.into_iter().chain(beside.concat()).collect();
    let faces: Vec<[u32; 4]> = [3, 6, 9]
        .into_iter()
        .flat_map(|b| [[0, 1, b + 1, b], [1, 2, b + 2, b + 1]])
        .collect();
    quads(&faces, points)
}

#[test]
fn embree_pins_the_points_of_an_edge_of_three_faces() {
    let both = Both::new(&device(), strips()).expect("taken");
    // The second corner of each first quad is the line's middle.
    let at = Vec2::X;
    for face in [0, 2, 4] {
        let crease = (LINE[0] + 4.0 * LINE[1] + LINE[2]) / 6.0;
        assert!(both.ours(face, at).distance(crease) < 1e-6);
        assert!(both.embrees(face, at).distance(LINE[1]) < 1e-4);
    }
}

/// The edge between the two quads of a strip follows one of three faces in the first quad.
#[test]
fn embree_sharpens_the_edge_after_one_of_three_faces() {
    let both = Both::new(&device(), strips()).expect("taken");
    let sides = [(2, Vec2::new(1.0, 0.25)), (3, Vec2::new(0.0, 0.25))];
    let ours = sides.map(|(face, uv)| {
        let [u, v] = uv.to_array().map(f64::from);
        let p = both.limit.evaluate(&both.points, face, u, v);
        [p.du, p.dv].map(|d| Vec3::from(d.map(|x| x as f32)))
    });
    let embrees = sides.map(|(face, uv)| {
        let p = both.embree.geometry(0).surface_point(face, uv, 0.0);
        [p.du, p.dv]
    });
    let [ours, embrees] = [ours, embrees].map(|sides| {
        let [a, b] = sides.map(|[du, dv]| du.cross(dv));
        a.angle_between(b).to_degrees()
    });
    assert!(ours < 0.1 && embrees > 3.0, "{ours} {embrees}");
}

/// A sheet of 3 by 3 quads of which the middle one is wound the other way; `apart` with points of its own.
fn sheet_with_a_turned_face(apart: bool) -> ControlMesh {
    let grid = (0..16).map(|i| {
        let (x, y) = ((i % 4) as f32, (i / 4) as f32);
        Vec3::new(x, y, (x * y * 1.7).sin())
    });
    let mut points: Vec<Vec3> = grid.collect();
    let mut faces: Vec<[u32; 4]> = [0, 1, 2, 4, 5, 6, 8, 9, 10]
        .map(|i| [i, i + 1, i + 5, i + 4])
        .to_vec();
    faces[4].reverse();
    if apart {
        points.extend(faces[4].map(|v| points[v as usize]));
        faces[4] = [16, 17, 18, 19];
    }
    quads(&faces, points)
}

#[test]
fn to_embree_faces_that_run_an_edge_the_same_way_are_not_joined() {
    let device = device();
    let [joined, apart] = [false, true].map(sheet_with_a_turned_face);
    let same = Both::new(&device, joined.clone()).expect("taken");
    let as_embree = Both::against(&device, apart, joined).expect("taken");
    assert!(same.worst() > 10.0 * SAME, "{}", same.worst());
    // Around the gap three faces meet: there Embree's patches are but close to the limit.
    assert!(as_embree.worst() < 2e-4, "{}", as_embree.worst());
}

/// A cube with one more point amid its top, joined to two of the corners: its mirror image by the plane x = -y is itself.
#[test]
fn embree_takes_an_inner_point_of_two_faces_for_a_borders_corner() {
    let mut mesh = cube();
    mesh.points[0].push(Vec3::new(0.0, 0.0, 1.4));
    mesh.face_vertex_indices.truncate(20);
    mesh.face_vertex_indices.extend([4, 5, 6, 8, 4, 8, 6, 7]);
    mesh.face_vertex_counts.push(4);
    let both = Both::new(&device(), mesh).expect("taken");
    let (uv, mirrored) = (Vec2::new(0.4, 0.95), Vec2::new(0.05, 0.6));
    let asymmetry = |p: Vec3, q: Vec3| p.distance(Vec3::new(-q.y, -q.x, q.z));
    let ours = asymmetry(both.ours(5, uv), both.ours(5, mirrored));
    let embrees = asymmetry(both.embrees(5, uv), both.embrees(5, mirrored));
    assert!(ours < 1e-6 && embrees > 0.05, "{ours} {embrees}");
}

/// A face alone with a smooth corner of the border is no polynomial: each level of refinement adds pieces.
#[test]
fn embree_takes_a_smooth_corner_for_one_polynomial() {
    let mesh = ControlMesh {
        boundary: BoundaryInterpolation::EdgeOnly,
        ..quads(
            &[[0, 1, 2, 3]],
            vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.5), Vec3::Y],
        )
    };
    let both = Both::new(&device(), mesh).expect("taken");
    // The fourth difference of a cubic is 0.
    let fourth = |at: &dyn Fn(Vec2) -> Vec3| {
        let p = [0.0, 0.25, 0.5, 0.75, 1.0].map(|u| at(Vec2::new(u, 0.25)));
        (p[0] - 4.0 * p[1] + 6.0 * p[2] - 4.0 * p[3] + p[4]).length()
    };
    let ours = fourth(&|uv| both.ours(0, uv));
    let embrees = fourth(&|uv| both.embrees(0, uv));
    assert!(ours > 1e-3 && embrees < 1e-5, "{ours} {embrees}");
    assert!(both.worst() > SAME, "{}", both.worst());
}
