//! Which faces share an edge, and which a vertex.

use super::Grid;
use crate::error::{Error, Result};
use crate::reader::Reader;

/// An edge as a face has it; also the corner at which it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    pub(super) face: u32,
    pub(super) edge: usize,
}

impl Side {
    pub(super) fn new(face: u32, edge: usize) -> Self {
        Self {
            face,
            edge: edge & 3,
        }
    }

    /// The face's next edge, counter-clockwise; also the corner at which this one ends.
    pub(super) fn next(self) -> Self {
        Self::new(self.face, self.edge + 1)
    }

    fn previous(self) -> Self {
        Self::new(self.face, self.edge + 3)
    }

    /// What the face says is beyond.
    fn named(self, reader: &Reader) -> Option<Self> {
        let next = reader.face(self.face).neighbours[self.edge]?;
        Some(Self::new(next.face, usize::from(next.edge)))
    }
}

/// What is beyond an edge, where both sides say so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Beyond {
    Nothing,
    /// The edge of a face alike.
    Edge(Side),
    /// Of a face: the edges of two sub-faces, in the order along the face's edge.
    Halves([Side; 2]),
    /// Of a sub-face: a half of a face's edge.
    HalfOf(Side, usize),
}

impl Beyond {
    pub(super) fn of(reader: &Reader, side: Side) -> Self {
        let Some(next) = side.named(reader) else {
            return Self::Nothing;
        };
        let is_subface = |side: Side| reader.face(side.face).subface;
        match (is_subface(side), is_subface(next)) {
            (false, true) => halves(reader, side).map_or(Self::Nothing, Self::Halves),
            (true, false) => match halves(reader, next) {
                Some([first, _]) if first == side => Self::HalfOf(next, 0),
                Some([_, second]) if second == side => Self::HalfOf(next, 1),
                _ => Self::Nothing,
            },
            _ if next != side && next.named(reader) == Some(side) => Self::Edge(next),
            _ => Self::Nothing,
        }
    }
}

/// The two sub-faces at an edge of a face: it names the first, which has the second beside it.
fn halves(reader: &Reader, side: Side) -> Option<[Side; 2]> {
    let first = side.named(reader)?;
    let beside = first.previous();
    let across = beside.named(reader)?;
    let second = across.previous();
    let agreed = first.named(reader) == Some(side)
        && second.named(reader) == Some(side)
        && across.named(reader) == Some(beside)
        && first != second
        && reader.face(first.face).subface
        && reader.face(second.face).subface;
    agreed.then_some([first, second])
}

/// A face at a vertex: with a corner, or with the middle of an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    pub(super) face: u32,
    /// The corner; or 4 and the number of the edge.
    at: u8,
}

impl Member {
    /// The one or two texels of the face that touch the vertex.
    pub(super) fn texels(self, grid: &Grid) -> ([[usize; 2]; 2], usize) {
        let at = usize::from(self.at);
        if at < 4 {
            return ([grid.corner(at); 2], 1);
        }
        let middle = grid.length(at - 4) / 2;
        let before = middle.saturating_sub(1);
        ([before, middle].map(|i| grid.along(at - 4, i)), 2)
    }
}

/// The vertices of a mesh.
#[derive(Debug)]
pub(super) struct Vertices {
    /// By face and corner: the vertex.
    of_corner: Vec<u32>,
    /// By vertex: where its members begin, and at last where those of all end.
    starts: Vec<u32>,
    /// By vertex, and of one in the order of the faces.
    members: Vec<Member>,
}

impl Vertices {
    /// Corners that shared edges bring together.
    pub(super) fn new(reader: &Reader) -> Self {
        let faces = reader.face_count();
        let mut sets = Sets::new(4 * faces as usize);
        // Vertices amid an edge of a face: that edge, and a corner there.
        let mut amid = vec![];
        for side in sides(faces) {
            match Beyond::of(reader, side) {
                Beyond::Edge(other) => {
                    sets.join(corner(side), corner(other.next()));
                    sets.join(corner(side.next()), corner(other));
                }
                Beyond::Halves([first, second]) => {
                    sets.join(corner(side), corner(first.next()));
                    sets.join(corner(first), corner(second.next()));
                    sets.join(corner(side.next()), corner(second));
                    amid.push((side, first));
                }
                Beyond::Nothing | Beyond::HalfOf(..) => {}
            }
        }

        let of_corner = sets.numbers();
        let mut members: Vec<(u32, Member)> = sides(faces)
            .map(|side| (side, side, side.edge))
            .chain(
                amid.into_iter()
                    .map(|(side, first)| (first, side, 4 + side.edge)),
            )
            .map(|(at, side, place)| {
                let member = Member {
                    face: side.face,
                    at: place as u8,
                };
                (of_corner[corner(at)], member)
            })
            .collect();
        members.sort_by_key(|(vertex, member)| (*vertex, member.face, member.at));
        let count = members.last().map_or(0, |(vertex, _)| vertex + 1);
        let mut starts = vec![0; count as usize + 1];
        for (vertex, _) in &members {
            starts[*vertex as usize + 1] += 1;
        }
        for vertex in 0..count as usize {
            starts[vertex + 1] += starts[vertex];
        }
        Self {
            of_corner,
            starts,
            members: members.into_iter().map(|(_, member)| member).collect(),
        }
    }

    /// The faces around the vertex at which an edge begins.
    pub(super) fn around(&self, start: Side) -> &[Member] {
        let vertex = self.of_corner[corner(start)] as usize;
        &self.members[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// That they are those of a file with as many faces.
    pub(super) fn check(&self, reader: &Reader) -> Result<()> {
        if self.of_corner.len() == 4 * reader.face_count() as usize {
            return Ok(());
        }
        Err(Error::request(
            format!(
                "a lookup for a file of {} faces is used with one of {}",
                self.of_corner.len() / 4,
                reader.face_count()
            ),
            "use it with the file that it was made for",
        ))
    }
}

fn sides(faces: u32) -> impl Iterator<Item = Side> {
    (0..faces).flat_map(|face| (0..4).map(move |edge| Side { face, edge }))
}

fn corner(start: Side) -> usize {
    4 * start.face as usize + start.edge
}

/// Disjoint sets (Tarjan 1975), with halved paths.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn find(&mut self, mut at: usize) -> usize {
        while self.0[at] as usize != at {
            let parent = self.0[at] as usize;
            self.0[at] = self.0[parent];
            at = self.0[at] as usize;
        }
        at
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    /// Numbers the sets, in the order of their first elements: by element, the number of its set.
    fn numbers(mut self) -> Vec<u32> {
        let mut numbers = vec![0; self.0.len()];
        let mut next = 0;
        for at in 0..numbers.len() {
            // A set's root is its first element.
            let root = self.find(at);
            numbers[at] = if root == at {
                next += 1;
                next - 1
            } else {
                numbers[root]
            };
        }
        numbers
    }
}
