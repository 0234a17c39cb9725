//! Meshes for tests: from polygons to faces, sub-faces and neighbours, with texels that a function gives.

use std::collections::HashMap;

use relievo_ptex::{Cache, DataType, FaceInfo, Format, MeshType, Neighbour, Reader, Res, Writer};

/// A mesh of polygons as a file has it.
pub(crate) struct Mesh {
    pub(crate) faces: Vec<FaceInfo>,
    /// By face and corner: what point that is. Corners with the same are the same vertex.
    pub(crate) points: Vec<[Point; 4]>,
}

/// Vertices of the mesh, and what sub-faces add.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Point {
    Vertex(u32),
    /// Amid an edge, the lower vertex first.
    Middle(u32, u32),
    /// Amid a polygon.
    Centre(u32),
}

impl Mesh {
    /// Polygons list their vertices counter-clockwise; those that are not quads become a sub-face for each corner.
    /// Sizes come from `res`, by face.
    pub(crate) fn new(polygons: &[Vec<u32>], mut res: impl FnMut(u32) -> Res) -> Self {
        let firsts: Vec<u32> = polygons
            .iter()
            .scan(0, |next, polygon| {
                let first = *next;
                *next += if polygon.len() == 4 {
                    1
                } else {
                    polygon.len() as u32
                };
                Some(first)
            })
            .collect();
        // By vertices of an edge: the polygon that has it in this direction, and which of its edges it is.
        let edges: HashMap<(u32, u32), (usize, usize)> = polygons
            .iter()
            .enumerate()
            .flat_map(|(p, polygon)| {
                (0..polygon.len())
                    .map(move |k| ((polygon[k], polygon[(k + 1) % polygon.len()]), (p, k)))
            })
            .collect();
        let is_quad = |p: usize| polygons[p].len() == 4;
        // What is beyond edge `k` of a polygon: all of it, or what is near the vertex where the edge begins or ends.
        let beyond = |p: usize, k: usize, near_begin: bool| -> Option<Neighbour> {
            let polygon = &polygons[p];
            let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            let &(q, j) = edges.get(&(b, a))?;
            if is_quad(q) {
                return Some(Neighbour {
                    face: firsts[q],
                    edge: j as u8,
                });
            }
            // Over there the edge begins where it ends here.
            let (corner, edge) = if near_begin {
                ((j + 1) % polygons[q].len(), 3)
            } else {
                (j, 0)
            };
            Some(Neighbour {
                face: firsts[q] + corner as u32,
                edge,
            })
        };
        let mut mesh = Self {
            faces: vec![],
            points: vec![],
        };
        for (p, polygon) in polygons.iter().enumerate() {
            let n = polygon.len();
            if is_quad(p) {
                let neighbours = std::array::from_fn(|k| beyond(p, k, true));
                mesh.push(neighbours, false, &mut res);
                mesh.points
                    .push(std::array::from_fn(|k| Point::Vertex(polygon[k])));
                continue;
            }
            for k in 0..n {
                let (next, before) = ((k + 1) % n, (k + n - 1) % n);
                let sibling = |k: usize, edge| {
                    Some(Neighbour {
                        face: firsts[p] + k as u32,
                        edge,
                    })
                };
                let neighbours = [
                    beyond(p, k, true),
                    sibling(next, 2),
                    sibling(before, 1),
                    beyond(p, before, false),
                ];
                mesh.push(neighbours, true, &mut res);
                let middle = |a: u32, b: u32| Point::Middle(a.min(b), a.max(b));
                mesh.points.push([
                    Point::Vertex(polygon[k]),
                    middle(polygon[k], polygon[next]),
                    Point::Centre(p as u32),
                    middle(polygon[before], polygon[k]),
                ]);
            }
        }
        mesh
    }

    fn push(
        &mut self,
        neighbours: [Option<Neighbour>; 4],
        subface: bool,
        res: &mut impl FnMut(u32) -> Res,
    ) {
        self.faces.push(FaceInfo {
            res: res(self.faces.len() as u32),
            neighbours,
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface,
        });
    }

    /// A file of floats, with texels by face, place of the texel's middle in the face, and channel.
    pub(crate) fn reader(
        &self,
        channels: usize,
        texel: impl FnMut(u32, [f32; 2], usize) -> f32,
    ) -> Reader {
        read(
            Format::new(MeshType::Quad, DataType::F32, channels),
            &self.faces,
            texel,
        )
    }
}

/// A file of these faces, in memory. Texels of integer types are parts of one.
pub(crate) fn read(
    format: Format,
    faces: &[FaceInfo],
    mut texel: impl FnMut(u32, [f32; 2], usize) -> f32,
) -> Reader {
    let mut writer = Writer::new(format.clone(), faces.len() as u32).unwrap();
    for (face, info) in (0..).zip(faces) {
        let size = [1 << info.res.ulog2, 1 << info.res.vlog2];
        let mut bytes = vec![];
        for y in 0..size[1] {
            for x in 0..size[0] {
                for channel in 0..format.channels {
                    let at = [(x, size[0]), (y, size[1])].map(|(i, n)| (i as f32 + 0.5) / n as f32);
                    let value = texel(face, at, channel);
                    match format.data_type {
                        DataType::F32 => bytes.extend(value.to_le_bytes()),
                        DataType::U16 => bytes.extend(((value * 65535.0) as u16).to_le_bytes()),
                        DataType::U8 => bytes.push((value * 255.0) as u8),
                        DataType::F16 => unreachable!("no test uses halves"),
                    }
                }
            }
        }
        writer.face(face, info, &bytes).unwrap();
    }
    Reader::from_bytes(writer.bytes().unwrap(), "test.ptx", &Cache::default()).unwrap()
}

/// Numbers that look random, for texels: 0 to 1.
pub(crate) fn noise(seed: u32, face: u32, at: [f32; 2], channel: usize) -> f32 {
    let mut x = seed ^ face.wrapping_mul(0x9e37_79b9) ^ (channel as u32).wrapping_mul(0x85eb_ca6b);
    for bits in at.map(f32::to_bits) {
        x = (x ^ bits).wrapping_mul(0x7feb_352d);
        x ^= x >> 15;
        x = x.wrapping_mul(0x846c_a68b);
        x ^= x >> 16;
    }
    (x >> 8) as f32 / (1 << 24) as f32
}

/// Meshes that have about everything: closed and open, valence 3 to 9, polygons that are not quads next to each other
/// and to quads.
pub(crate) fn polygons(which: u32) -> Vec<Vec<u32>> {
    match which % 5 {
        // A cube.
        0 => vec![
            vec![0, 3, 2, 1],
            vec![4, 5, 6, 7],
            vec![0, 1, 5, 4],
            vec![1, 2, 6, 5],
            vec![2, 3, 7, 6],
            vec![3, 0, 4, 7],
        ],
        // A pyramid of quads and triangles around a vertex of many faces, cut from a disc.
        1 => (0..9)
            .map(|i| vec![0, 1 + 2 * i, 2 + 2 * i, 1 + 2 * ((i + 1) % 9)])
            .collect(),
        // A tetrahedron: sub-faces only.
        2 => vec![vec![0, 1, 2], vec![0, 2, 3], vec![0, 3, 1], vec![1, 3, 2]],
        // A prism with a pentagon at either end.
        3 => {
            let mut all = vec![(0..5).rev().collect(), (5..10).collect()];
            all.extend((0..5).map(|i| vec![i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i]));
            all
        }
        // An open plane with triangles and a hexagon.
        _ => vec![
            vec![0, 1, 5, 4],
            vec![1, 2, 5],
            vec![2, 6, 5],
            vec![2, 3, 7, 6],
            vec![4, 5, 9, 8],
            vec![5, 6, 7, 11, 10, 9],
        ],
    }
}

/// The same with each polygon begun at another of its vertices.
pub(crate) fn rotated(mut polygons: Vec<Vec<u32>>, seed: u32) -> Vec<Vec<u32>> {
    for (i, polygon) in (0..).zip(&mut polygons) {
        let n = polygon.len();
        polygon.rotate_left((noise(seed, i, [0.5, 0.25], 0) * n as f32) as usize % n);
    }
    polygons
}
