//! Recognising the faces that are polynomial patches, and finding their points in the ring.
//!
//! A corner of a face is regular where the surface is that of an infinite regular grid, or of its border: at a
//! smooth vertex of valence 4 (6 with Loop), on a crease with half as many faces on this side, or at a corner with
//! this face alone. Beyond infinitely sharp edges the patch continues with phantom points: those for which the
//! smooth rules give the sharp ones.

use super::crease::{Rule, is_infinite, is_semi_sharp, is_sharp};
use super::ring::Ring;

/// A point of a patch in terms of the ring's vertices.
pub(super) type Combination = Vec<(u32, f64)>;

/// What a face is, if it need not be split.
#[derive(Debug, Clone)]
pub(super) enum Regular {
    /// One polynomial patch over these points.
    Patch(Vec<Combination>),
    /// A bicubic patch but for one semi-sharp edge of this number and sharpness, which runs straight on both sides:
    /// the surface is smooth along it, and refines across it alone (cf. Nießner, Loop, Greiner, *Efficient
    /// Evaluation of Semi-Smooth Creases in Catmull-Clark Subdivision Surfaces*, 2012).
    Strip {
        /// The sixteen points.
        points: Vec<Combination>,
        /// The sharp edge, 0 to 3.
        edge: usize,
        /// Its sharpness, above 0.
        sharpness: f32,
    },
}

/// What the face of the ring is, if it need not be split.
pub(super) fn recognise(ring: &Ring) -> Option<Regular> {
    let layout = match ring.cage.rules.triangles() {
        true => &BOX_SPLINE,
        false => &BICUBIC,
    };
    if ring.sides() as usize != layout.corners.len() {
        return None;
    }
    if ring.cage.rules.linear {
        let corners = ring
            .cage
            .topology
            .face_vertices(0)
            .iter()
            .map(|&v| vec![(v, 1.0)]);
        return Some(Regular::Patch(corners.collect()));
    }
    let strip = match layout.sides {
        4 => strip_edge(ring),
        _ => None,
    };
    let mut slots: Vec<Option<Combination>> = vec![None; layout.slots];
    for corner in 0..ring.sides() {
        let on_strip = strip.is_some_and(|(edge, _)| {
            corner as usize == edge || corner as usize == (edge + 1) % layout.sides
        });
        place_corner(ring, layout, corner, on_strip, &mut slots)?;
    }
    fill_phantoms(ring, layout, &mut slots);
    let points = slots.into_iter().collect::<Option<Vec<_>>>()?;
    Some(match strip {
        Some((edge, sharpness)) => Regular::Strip {
            points,
            edge,
            sharpness,
        },
        None => Regular::Patch(points),
    })
}

/// The faces around a vertex from one infinitely sharp edge to the next, counterclockwise, around a given one.
#[derive(Debug)]
pub(super) struct Span {
    /// The corners at the vertex.
    pub(super) corners: Vec<u32>,
    /// Which of them is the given one.
    pub(super) at: usize,
    /// Whether they go all the way round with no sharp edge.
    pub(super) closed: bool,
}

impl Span {
    /// The span around `corner`.
    pub(super) fn of(ring: &Ring, corner: u32) -> Self {
        let topology = &ring.cage.topology;
        let ends = |edge: u32| is_infinite(ring.cage.edge_sharpness[edge as usize]);
        let mut corners = vec![corner];
        let mut last = corner;
        while !ends(topology.edge(topology.previous(last))) {
            let Some(left) = topology.turn_left(last) else {
                break;
            };
            if left == corner {
                return Self {
                    corners,
                    at: 0,
                    closed: true,
                };
            }
            corners.push(left);
            last = left;
        }
        let mut before = Vec::new();
        let mut first = corner;
        while !ends(topology.edge(first)) {
            let Some(right) = topology.turn_right(first) else {
                break;
            };
            before.push(right);
            first = right;
        }
        let at = before.len();
        before.reverse();
        before.append(&mut corners);
        Self {
            corners: before,
            at,
            closed: false,
        }
    }

    /// The far ends of the span's edges: one for each face, and one more if it is open.
    pub(super) fn far_ends(&self, ring: &Ring) -> Vec<u32> {
        let topology = &ring.cage.topology;
        let leaving = |&c: &u32| topology.vertex(topology.next(c));
        let mut ends: Vec<u32> = self.corners.iter().map(leaving).collect();
        if !self.closed
            && let Some(&last) = self.corners.last()
        {
            ends.push(topology.vertex(topology.previous(last)));
        }
        ends
    }
}

/// All faces around a corner's vertex, whatever is sharp, if they go all the way round.
pub(super) fn full_span(ring: &Ring, corner: u32) -> Option<Span> {
    let mut corners = vec![corner];
    let mut last = corner;
    loop {
        last = ring.cage.topology.turn_left(last)?;
        if last == corner {
            return Some(Span {
                corners,
                at: 0,
                closed: true,
            });
        }
        corners.push(last);
    }
}

/// Where things are in a patch.
struct Layout {
    sides: usize,
    slots: usize,
    /// The slots of the face's corners.
    corners: &'static [usize],
    /// For each corner the slots around it, counterclockwise, from the one along the face's edge.
    around: &'static [&'static [usize]],
    /// For each corner the slot across the opposite face, if edges do not lead there.
    across: &'static [usize],
    /// For each edge of the face, how slots follow when it is sharp: slot = a + b − c.
    beyond_edge: &'static [&'static [[usize; 4]]],
    /// For each corner between two sharp edges: slot = 2 a − b, likewise.
    beyond_corner: &'static [&'static [[usize; 4]]],
}

/// Numbering as in `basis.rs`.
const BICUBIC: Layout = Layout {
    sides: 4,
    slots: 16,
    corners: &[5, 6, 10, 9],
    around: &[
        &[6, 9, 4, 1],
        &[10, 5, 2, 7],
        &[9, 6, 11, 14],
        &[5, 10, 13, 8],
    ],
    across: &[0, 3, 15, 12],
    beyond_edge: &[
        &[[0, 4, 4, 8], [1, 5, 5, 9], [2, 6, 6, 10], [3, 7, 7, 11]],
        &[
            [3, 2, 2, 1],
            [7, 6, 6, 5],
            [11, 10, 10, 9],
            [15, 14, 14, 13],
        ],
        &[
            [12, 8, 8, 4],
            [13, 9, 9, 5],
            [14, 10, 10, 6],
            [15, 11, 11, 7],
        ],
        &[[0, 1, 1, 2], [4, 5, 5, 6], [8, 9, 9, 10], [12, 13, 13, 14]],
    ],
    beyond_corner: &[&[], &[], &[], &[]],
};

const BOX_SPLINE: Layout = Layout {
    sides: 3,
    slots: 12,
    corners: &[4, 5, 8],
    around: &[
        &[5, 8, 7, 3, 0, 1],
        &[8, 4, 1, 2, 6, 9],
        &[4, 5, 9, 11, 10, 7],
    ],
    across: &[],
    beyond_edge: &[
        &[[1, 4, 5, 8], [0, 3, 4, 7], [2, 5, 6, 9]],
        &[[9, 5, 8, 4], [6, 5, 2, 1], [11, 8, 10, 7]],
        &[[7, 4, 8, 5], [3, 4, 0, 1], [10, 8, 11, 9]],
    ],
    beyond_corner: &[
        &[[3, 4, 4, 5], [0, 4, 4, 8]],
        &[[6, 5, 5, 4], [2, 5, 5, 8]],
        &[[10, 8, 8, 5], [11, 8, 8, 4]],
    ],
};

/// Puts the ring's vertices around a corner into their slots; nothing if the corner is not regular. At the ends of a
/// strip the semi-sharp edges count as smooth.
fn place_corner(
    ring: &Ring,
    layout: &Layout,
    corner: u32,
    on_strip: bool,
    slots: &mut [Option<Combination>],
) -> Option<()> {
    let (cage, topology) = (&ring.cage, &ring.cage.topology);
    let vertex = topology.vertex(corner);
    let around = layout.around[corner as usize];
    let span = Span::of(ring, corner);
    let semi_sharp = topology
        .vertex_edges(vertex)
        .iter()
        .any(|&e| is_semi_sharp(cage.edge_sharpness[e as usize]));
    let sharpness = cage.vertex_sharpness[vertex as usize];
    if (semi_sharp && !on_strip) || is_semi_sharp(sharpness) {
        return None;
    }
    let sides = |&c: &u32| topology.corners(topology.face(c)).len() == layout.sides;
    let regular = span.corners.iter().all(sides)
        && if span.closed {
            !is_sharp(sharpness)
                && span.corners.len() == around.len()
                && topology.vertex_edges(vertex).len() == around.len()
        } else {
            match cage.rule(vertex) {
                Rule::Smooth => false,
                Rule::Crease => span.corners.len() == around.len() / 2,
                Rule::Corner => span.corners.len() == 1,
            }
        };
    if !regular {
        return None;
    }
    slots[layout.corners[corner as usize]] = Some(vec![(vertex, 1.0)]);
    for (j, &end) in span.far_ends(ring).iter().enumerate() {
        let place = (j + around.len() - span.at) % around.len();
        slots[around[place]] = Some(vec![(end, 1.0)]);
    }
    if span.closed
        && let Some(&slot) = layout.across.get(corner as usize)
    {
        let opposite = span.corners[2];
        let across = topology.vertex(topology.next(topology.next(opposite)));
        slots[slot] = Some(vec![(across, 1.0)]);
    }
    Some(())
}

/// The points beyond sharp edges, each by the points on this side.
fn fill_phantoms(ring: &Ring, layout: &Layout, slots: &mut [Option<Combination>]) {
    let edges = ring.cage.topology.face_edges(0);
    let sharp = |i: usize| {
        let edge = edges[i % layout.sides];
        is_infinite(ring.cage.edge_sharpness[edge as usize])
    };
    let mut rules: Vec<[usize; 4]> = Vec::new();
    for i in 0..layout.sides {
        if sharp(i) {
            rules.extend(layout.beyond_edge[i]);
        }
        if sharp(i) && sharp(i + layout.sides - 1) {
            rules.extend(layout.beyond_corner[i]);
        }
        // A triangle may touch a crease with a corner only, between two others: the crease runs along places 2 and 5.
        if layout.sides == 3 && !sharp(i) && !sharp(i + 2) {
            let (own, at) = (layout.corners[i], layout.around[i]);
            rules.extend([[at[3], own, at[2], at[1]], [at[4], own, at[5], at[0]]]);
        }
    }
    // Some follow from others that follow first.
    let mut progress = true;
    while progress {
        progress = false;
        for &[slot, a, b, c] in &rules {
            if slots[slot].is_some() {
                continue;
            }
            if let (Some(a), Some(b), Some(c)) = (&slots[a], &slots[b], &slots[c]) {
                let minus = c.iter().map(|&(i, w)| (i, -w));
                let sum = a.iter().chain(b).copied().chain(minus).collect();
                slots[slot] = Some(sum);
                progress = true;
            }
        }
    }
}

/// The one semi-sharp edge of the face, if its crease runs straight through regular vertices with one sharpness.
fn strip_edge(ring: &Ring) -> Option<(usize, f32)> {
    let (cage, topology) = (&ring.cage, &ring.cage.topology);
    let sharpness = |edge: u32| cage.edge_sharpness[edge as usize];
    let edges = topology.face_edges(0);
    let mut semi_sharp = (0..4).filter(|&i| is_semi_sharp(sharpness(edges[i])));
    let edge = semi_sharp.next().filter(|_| semi_sharp.next().is_none())?;
    let own = sharpness(edges[edge]);
    for corner in [edge, (edge + 1) % 4] {
        let span = Span::of(ring, corner as u32);
        if !span.closed || span.corners.len() != 4 {
            return None;
        }
        let at = |i: usize| sharpness(topology.edge(span.corners[i]));
        // Edge 0 leaves along the face's edge of this corner, edge 1 along the one before.
        let (along, aside) = if corner == edge { (0, 1) } else { (1, 0) };
        let straight = at(along) == own && at(along + 2) == own;
        if !straight || is_sharp(at(aside)) || is_sharp(at(aside + 2)) {
            return None;
        }
    }
    Some((edge, own))
}
