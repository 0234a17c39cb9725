//! Which faces become one chart: parts are cut in two until each can be flattened, then neighbours are joined again
//! where that still can be.
//!
//! Section 3 of the paper (see [`conformal`](super::conformal)) grows charts from seeds far from features and merges
//! them. Cages have few faces and a feature at most of their edges; so what decides here is the map itself. A part whose
//! map is not one to one, or stretches too much, or that is no disk, is cut between the two faces in it that are
//! farthest apart. Both grow at the same speed, slower across sharp edges: seams come to lie there. Then two charts
//! that share much of their border become one, those that share most first, if the map of both together is good.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

use super::cage::{Cage, NONE};
use super::chart::{Disk, Flat};
use super::check::is_good;
use super::conformal::flatten;

/// How much farther it is across an edge where faces are at right angles, or that is sharp in the limit.
const ACROSS: f64 = 8.0;
/// The part of the shorter border that two charts share at least to be joined.
const SHARED: f64 = 0.1;

/// Cuts a cage into charts.
pub(super) struct Cutter<'a> {
    cage: &'a Cage,
    most: f64,
    left_handed: bool,
    /// By corner, for gluing.
    room: Vec<u32>,
    /// By face: the part that it is in.
    part: Vec<u32>,
    parts: u32,
}

impl<'a> Cutter<'a> {
    /// For charts in which lengths become at most `most` times as long or as short.
    pub(super) fn new(cage: &'a Cage, most: f64, left_handed: bool) -> Self {
        Self {
            cage,
            most,
            left_handed,
            room: vec![NONE; cage.topology.corner_count()],
            part: vec![NONE; cage.topology.face_count()],
            parts: 0,
        }
    }

    /// All faces in charts, by their first faces.
    pub(super) fn charts(&mut self) -> Vec<Flat> {
        let mut charts = Vec::new();
        for faces in self.components() {
            charts.extend(self.cut(faces));
        }
        let mut charts = self.join(charts);
        charts.sort_by_key(|chart| chart.disk.faces[0]);
        charts
    }

    /// The charts of connected faces.
    fn cut(&mut self, faces: Vec<u32>) -> Vec<Flat> {
        let mut charts = Vec::new();
        let mut left = vec![faces];
        while let Some(faces) = left.pop() {
            match self.flatten(&faces) {
                Some(chart) => charts.push(chart),
                None => match faces[..] {
                    [face] => charts.push(self.standing_in(face)),
                    _ => left.extend(self.halves(&faces)),
                },
            }
        }
        charts
    }

    /// The charts of the two halves of one that is not good after all.
    pub(super) fn cut_further(&mut self, chart: &Flat) -> Vec<Flat> {
        match chart.disk.faces[..] {
            [face] => vec![self.standing_in(face)],
            _ => {
                let halves = self.halves(&chart.disk.faces);
                halves.into_iter().flat_map(|half| self.cut(half)).collect()
            }
        }
    }

    fn standing_in(&self, face: u32) -> Flat {
        Flat::standing_in(self.cage, face, self.left_handed)
    }

    /// A good map of faces, if they have one.
    fn flatten(&mut self, faces: &[u32]) -> Option<Flat> {
        let cage = self.cage;
        if faces.iter().any(|&face| !cage.usable[face as usize]) {
            return None;
        }
        let disk = Disk::new(cage, faces, &mut self.room)?;
        let mut places = flatten(cage, &disk)?;
        let (mut before, mut after) = (0.0, 0.0);
        for (face, nodes) in disk.face_nodes() {
            for triangle in cage.triangles(face).iter().filter(|t| t.weight > 0.0) {
                let to = triangle.corners.map(|i| places[nodes[i as usize] as usize]);
                let [a, b, c] = to;
                before += triangle.weight * triangle.area();
                after += 0.5 * triangle.weight * (b - a).perp_dot(c - a);
            }
        }
        // Turned over.
        if after.is_nan() || after <= 0.0 {
            return None;
        }
        let scale = (before / after).sqrt();
        places.iter_mut().for_each(|p| *p *= scale);
        is_good(cage, &disk, &places, self.most).then_some(Flat {
            disk,
            places,
            stands_in: false,
        })
    }

    /// Faces that hang together, each part ascending.
    fn components(&mut self) -> Vec<Vec<u32>> {
        let faces = self.part.len() as u32;
        let all = self.parts;
        self.parts += 1;
        self.part.fill(all);
        let mut components = Vec::new();
        for first in 0..faces {
            if self.part[first as usize] != all {
                continue;
            }
            let own = self.parts;
            self.parts += 1;
            let mut component = vec![first];
            self.part[first as usize] = own;
            let mut next = 0;
            while next < component.len() {
                for corner in self.cage.topology.corners(component[next]) {
                    if let Some(other) = self.beyond(corner, all) {
                        self.part[other as usize] = own;
                        component.push(other);
                    }
                }
                next += 1;
            }
            component.sort_unstable();
            components.push(component);
        }
        components
    }

    /// The face across the edge that leaves a corner, if it is in a part.
    fn beyond(&self, corner: u32, part: u32) -> Option<u32> {
        let mate = self.cage.mates[corner as usize];
        if mate == NONE {
            return None;
        }
        let face = self.cage.topology.face(mate);
        (self.part[face as usize] == part).then_some(face)
    }

    /// Cuts connected faces between the two that are farthest apart.
    fn halves(&mut self, faces: &[u32]) -> [Vec<u32>; 2] {
        let part = self.parts;
        self.parts += 1;
        for &face in faces {
            self.part[face as usize] = part;
        }
        let (from_first, _) = self.grow(faces, &faces[..1], part);
        let a = farthest(faces, &from_first);
        let (from_a, _) = self.grow(faces, &[a], part);
        let b = farthest(faces, &from_a);
        let (_, nearest) = self.grow(faces, &[a, b], part);
        let half = |side: u32| {
            let own = faces.iter().zip(&nearest);
            own.filter(|(_, near)| **near == side)
                .map(|(&f, _)| f)
                .collect()
        };
        [half(0), half(1)]
    }

    /// How far each of some faces is from the nearest seed, and which seed that is.
    fn grow(&self, faces: &[u32], seeds: &[u32], part: u32) -> (Vec<f64>, Vec<u32>) {
        let index = |face: u32| faces.binary_search(&face).expect("a face of the part");
        let mut distance = vec![f64::INFINITY; faces.len()];
        let mut nearest = vec![NONE; faces.len()];
        let mut open = BinaryHeap::new();
        for (number, &seed) in (0..).zip(seeds) {
            if distance[index(seed)] > 0.0 {
                distance[index(seed)] = 0.0;
                nearest[index(seed)] = number;
                // Of numbers that are not negative, bits have the order of the numbers.
                open.push(Reverse((0_u64, seed)));
            }
        }
        while let Some(Reverse((bits, face))) = open.pop() {
            let (here, at) = (f64::from_bits(bits), index(face));
            if here > distance[at] {
                continue;
            }
            for corner in self.cage.topology.corners(face) {
                let Some(other) = self.beyond(corner, part) else {
                    continue;
                };
                let there = here + self.step(corner, other);
                let to = index(other);
                if there < distance[to] {
                    distance[to] = there;
                    nearest[to] = nearest[at];
                    open.push(Reverse((there.to_bits(), other)));
                }
            }
        }
        (distance, nearest)
    }

    /// How far it is across the edge that leaves a corner.
    fn step(&self, corner: u32, other: u32) -> f64 {
        let cage = self.cage;
        let topology = &cage.topology;
        let face = topology.face(corner);
        let ends =
            [corner, topology.next(corner)].map(|c| cage.points[topology.vertex(c) as usize]);
        let middle = 0.5 * (ends[0] + ends[1]);
        let way = [face, other].map(|f| cage.middles[f as usize].distance(middle));
        let bend = 1.0 - cage.normals[face as usize].dot(cage.normals[other as usize]);
        let sharp = cage.sharp[topology.edge(corner) as usize];
        (way[0] + way[1]) * (1.0 + ACROSS * bend.max(sharp))
    }

    /// Joins charts where one map of both is good.
    fn join(&mut self, charts: Vec<Flat>) -> Vec<Flat> {
        let mut charts: Vec<Option<Flat>> = charts.into_iter().map(Some).collect();
        let mut refused: BTreeSet<[usize; 2]> = BTreeSet::new();
        loop {
            let mut joined = false;
            let mut touched = vec![false; charts.len()];
            for pair in self.pairs(&charts) {
                if pair.iter().any(|&chart| touched[chart]) || refused.contains(&pair) {
                    continue;
                }
                let of = |chart: usize| charts[chart].iter().flat_map(|c| &c.disk.faces);
                let mut faces: Vec<u32> = of(pair[0]).chain(of(pair[1])).copied().collect();
                faces.sort_unstable();
                match self.flatten(&faces) {
                    Some(both) => {
                        charts.push(Some(both));
                        for chart in pair {
                            charts[chart] = None;
                            touched[chart] = true;
                        }
                        joined = true;
                    }
                    None => {
                        refused.insert(pair);
                    }
                }
            }
            if !joined {
                return charts.into_iter().flatten().collect();
            }
        }
    }

    /// Charts side by side that share much of their border, those that share most first.
    fn pairs(&mut self, charts: &[Option<Flat>]) -> Vec<[usize; 2]> {
        let cage = self.cage;
        for (number, chart) in (0..).zip(charts) {
            for &face in chart.iter().flat_map(|c| &c.disk.faces) {
                self.part[face as usize] = number;
            }
        }
        let mut around = vec![0.0; charts.len()];
        let mut shared: BTreeMap<[usize; 2], f64> = BTreeMap::new();
        for corner in 0..cage.topology.corner_count() as u32 {
            let own = self.part[cage.topology.face(corner) as usize];
            let mate = cage.mates[corner as usize];
            let other = match mate {
                NONE => NONE,
                mate => self.part[cage.topology.face(mate) as usize],
            };
            if other == own {
                continue;
            }
            let length = cage.length(corner);
            around[own as usize] += length;
            if other != NONE && own < other {
                *shared.entry([own as usize, other as usize]).or_default() += length;
            }
        }
        let share = |(pair, length): ([usize; 2], f64)| {
            let share = length / around[pair[0]].min(around[pair[1]]);
            (share >= SHARED).then_some((share, pair))
        };
        let mut pairs: Vec<_> = shared.into_iter().filter_map(share).collect();
        // Stable: equal ones stay in the order of their charts.
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        pairs.into_iter().map(|(_, pair)| pair).collect()
    }
}

/// The face of the greatest finite distance, the first of equal ones; not the first face, if there is another.
fn farthest(faces: &[u32], distance: &[f64]) -> u32 {
    let mut found = (-1.0, faces[0]);
    for (&face, &distance) in faces.iter().zip(distance) {
        if distance.is_finite() && distance > found.0 {
            found = (distance, face);
        }
    }
    found.1
}
