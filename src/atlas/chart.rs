//! A chart: faces that are glued along the edges between them, and whether that makes a disk.

use super::cage::{Cage, NONE};
use crate::math::DVec2;

/// Faces that are glued to a disk, or a face by itself.
#[derive(Debug, Clone)]
pub(super) struct Disk {
    /// The faces, ascending.
    pub(super) faces: Vec<u32>,
    /// Where the corners of each face start in `nodes`.
    starts: Vec<u32>,
    /// The node of each corner: corners of one vertex are one node where the faces between them are glued. A vertex at
    /// which the chart meets itself is a node each time.
    nodes: Vec<u32>,
    /// The vertex of each node.
    pub(super) vertices: Vec<u32>,
    /// The nodes along the border, in the order of the faces' corners.
    pub(super) border: Vec<u32>,
}

/// A chart in the plane.
#[derive(Debug, Clone)]
pub(super) struct Flat {
    pub(super) disk: Disk,
    /// By node; the area is that of the faces in the cage.
    pub(super) places: Vec<DVec2>,
    /// Whether it is a face without a shape that could be kept, drawn as a regular polygon.
    pub(super) stands_in: bool,
}

impl Disk {
    /// Glues faces, which must be connected; none if that makes no disk. `room` holds [`NONE`] for each corner of the
    /// cage, before and after.
    pub(super) fn new(cage: &Cage, faces: &[u32], room: &mut [u32]) -> Option<Self> {
        let topology = &cage.topology;
        let mut corners = Vec::new();
        let mut starts = Vec::with_capacity(faces.len() + 1);
        for &face in faces {
            starts.push(corners.len() as u32);
            corners.extend(topology.corners(face));
        }
        starts.push(corners.len() as u32);
        for (local, &corner) in (0..).zip(&corners) {
            room[corner as usize] = local;
        }
        let within = |corner: u32| {
            let mate = cage.mates[corner as usize];
            (mate != NONE && room[mate as usize] != NONE).then_some(mate)
        };
        let at = |corner: u32| room[corner as usize] as usize;

        let mut classes: Vec<u32> = (0..corners.len() as u32).collect();
        let mut glued = 0;
        for &corner in &corners {
            let Some(mate) = within(corner).filter(|&mate| mate > corner) else {
                continue;
            };
            glued += 1;
            join(&mut classes, at(corner), at(topology.next(mate)));
            join(&mut classes, at(topology.next(corner)), at(mate));
        }
        let mut vertices = Vec::new();
        let mut nodes = vec![NONE; corners.len()];
        for (local, &corner) in corners.iter().enumerate() {
            // The lowest of a class comes first.
            let class = root(&mut classes, local);
            if class == local {
                nodes[local] = vertices.len() as u32;
                vertices.push(topology.vertex(corner));
            } else {
                nodes[local] = nodes[class];
            }
        }

        let mut border = Vec::new();
        if let Some(&first) = corners.iter().find(|&&c| within(c).is_none()) {
            let mut corner = first;
            loop {
                border.push(nodes[at(corner)]);
                corner = topology.next(corner);
                while let Some(mate) = within(corner) {
                    corner = topology.next(mate);
                }
                if corner == first {
                    break;
                }
            }
        }
        let edges = corners.len() - glued;
        let whole = border.len() == corners.len() - 2 * glued;
        let is_disk = whole && !border.is_empty() && vertices.len() + faces.len() == edges + 1;
        for &corner in &corners {
            room[corner as usize] = NONE;
        }
        is_disk.then(|| Self {
            faces: faces.to_vec(),
            starts,
            nodes,
            vertices,
            border,
        })
    }

    /// A face whose corners are not glued to each other, whatever vertices they are at.
    pub(super) fn of_face(cage: &Cage, face: u32) -> Self {
        let vertices = cage.topology.face_vertices(face).to_vec();
        let nodes: Vec<u32> = (0..vertices.len() as u32).collect();
        Self {
            faces: vec![face],
            starts: vec![0, vertices.len() as u32],
            border: nodes.clone(),
            nodes,
            vertices,
        }
    }

    /// The nodes of the corners of each face.
    pub(super) fn face_nodes(&self) -> impl Iterator<Item = (u32, &[u32])> {
        let ranges = self.starts.windows(2);
        self.faces.iter().zip(ranges).map(|(&face, range)| {
            let nodes = &self.nodes[range[0] as usize..range[1] as usize];
            (face, nodes)
        })
    }
}

impl Flat {
    /// A regular polygon for a face, in the order of its corners: as large as the face, or as long around where it has
    /// no area.
    pub(super) fn standing_in(cage: &Cage, face: u32, left_handed: bool) -> Self {
        let disk = Disk::of_face(cage, face);
        let n = disk.vertices.len() as f64;
        let around: f64 = cage.topology.corners(face).map(|c| cage.length(c)).sum();
        let turn = std::f64::consts::TAU / n;
        let area = 0.5 * n * turn.sin();
        let own = cage.area(face);
        let radius = if own > 0.0 {
            (own / area).sqrt()
        } else {
            around / (2.0 * n * (0.5 * turn).sin())
        };
        // Any size will do for a point: it is drawn as large as it must be.
        let radius = radius.max(1e-9);
        let turn = if left_handed { -turn } else { turn };
        let places = (0..disk.vertices.len())
            .map(|i| radius * DVec2::from_angle(i as f64 * turn))
            .collect();
        Self {
            disk,
            places,
            stands_in: true,
        }
    }
}

/// The lowest of a class.
pub(super) fn root(classes: &mut [u32], mut at: usize) -> usize {
    while classes[at] as usize != at {
        classes[at] = classes[classes[at] as usize];
        at = classes[at] as usize;
    }
    at
}

/// Makes the classes of two members one.
pub(super) fn join(classes: &mut [u32], a: usize, b: usize) {
    let (a, b) = (root(classes, a), root(classes, b));
    let (low, high) = (a.min(b), a.max(b));
    classes[high] = low as u32;
}
