//! The tree over the patches of an object: up to sixteen children a node, boxes of a byte per plane.
//!
//! One for the whole object, so that a ray comes in once: Embree sees a single primitive. Children are split off by the
//! surface area heuristic (binned, Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", IEEE
//! Symposium on Interactive Ray Tracing 2007), the largest first, until there are sixteen of them. Patches are put
//! in the order of the leaves: a node says where its first child is that is a node, and where its first patch is, and
//! no child needs a pointer.

use bytemuck::{Pod, Zeroable};
use mapped::Items;

use super::boxes::Boxes;
use super::lattice::{Extent, LatticeRay};
use super::moment::Moment;
use super::simd::{LANES, Lanes};
use super::waiting::{Stack, Waiting};

/// The tree.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Top {
    /// Key by key; the root first, and parents before their children.
    nodes: Items<TopNode>,
    /// Nodes of a key.
    count: usize,
}

/// A node's children.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct TopNode {
    pub(super) boxes: Boxes,
    links: Links,
    zero: [u32; 2],
}

/// Where children are: nodes come first, then patches.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Links {
    first_node: u32,
    first_patch: u32,
    nodes: u16,
    children: u16,
}

/// A child.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Child {
    Node(u32),
    /// By its place in the order of the leaves.
    Patch(u32),
}

/// Levels whose children the heuristic splits off. Below, the most numerous child is halved, so that each of the
/// sixteen has less than a quarter.
const FREE_LEVELS: usize = 8;

/// The most levels, for fewer than 2^32 patches.
pub(super) const MOST_LEVELS: usize = FREE_LEVELS + 16;

/// Places to split at, along an axis.
const BINS: usize = 16;

impl Top {
    /// Over the boxes of patches, given key by key. Also the order in which it wants the patches.
    pub(super) fn new(mut patches: Vec<Vec<Extent>>) -> (Self, Vec<u32>) {
        let (first, later) = match patches.split_first() {
            Some((first, later)) => (first.as_slice(), later),
            None => (&[][..], &[][..]),
        };
        let leaf = |(patch, &extent): (usize, &Extent)| Leaf {
            patch: patch as u32,
            extent: later.iter().fold(extent, |all, key| all.union(key[patch])),
        };
        let mut leaves: Vec<Leaf> = first.iter().enumerate().map(leaf).collect();
        if later.is_empty() {
            // Leaves have them all: of very many, no second copy is held.
            patches.clear();
        }
        let mut links = Vec::new();
        if !leaves.is_empty() {
            links.push(Links::default());
            split(&mut leaves, Place::default(), &mut links);
        }
        let count = links.len();
        let nodes = if patches.is_empty() {
            nodes_of_key(&links, |patch| leaves[patch as usize].extent)
        } else {
            let number = |patch: u32| leaves[patch as usize].patch as usize;
            nodes(&links, &patches, number)
        };
        let order = leaves.iter().map(|leaf| leaf.patch).collect();
        let nodes = nodes.into();
        (Self { nodes, count }, order)
    }

    /// Takes other boxes of the same patches, given key by key in the order of the leaves.
    pub(super) fn refit(&mut self, patches: &[Vec<Extent>]) {
        let links: Vec<Links> = self.nodes[..self.count].iter().map(|n| n.links).collect();
        self.nodes = nodes(&links, patches, |patch| patch as usize).into();
    }

    /// Of nodes that came from outside, over so many patches. None if a way through them could leave them, go in
    /// circles, be deeper than [`MOST_LEVELS`], or miss a patch.
    pub(super) fn of_nodes(nodes: Items<TopNode>, keys: usize, patches: usize) -> Option<Self> {
        let count = nodes.len().checked_div(keys)?;
        let (first, _) = nodes.split_at(count);
        let all_alike = nodes.len() == keys * count
            && (0..nodes.len())
                .all(|n| nodes[n].links == first[n % count].links && nodes[n].boxes.is_sound());
        // The traversal needs two bits of each number.
        if !all_alike || nodes.len().max(patches) >= 1 << 30 || (count == 0) != (patches == 0) {
            return None;
        }
        // Each node and each patch is a child once; parents come first.
        let mut levels = vec![0; count];
        let mut found = vec![false; patches];
        if let Some(root) = levels.first_mut() {
            *root = 1;
        }
        for (number, TopNode { links, .. }) in first.iter().enumerate() {
            let children = usize::from(links.children);
            let level = levels[number];
            if level == 0
                || level > MOST_LEVELS
                || !(1..=LANES).contains(&children)
                || links.nodes > links.children
            {
                return None;
            }
            let inner = usize::from(links.nodes);
            let (node, patch) = (links.first_node as usize, links.first_patch as usize);
            if inner > 0 && node <= number {
                return None;
            }
            for below in levels
                .get_mut(node..node + inner)
                .filter(|_| inner > 0)
                .into_iter()
                .flatten()
            {
                if std::mem::replace(below, level + 1) != 0 {
                    return None;
                }
            }
            if inner > 0 && node + inner > count {
                return None;
            }
            if children > inner {
                for found in found.get_mut(patch..patch + children - inner)? {
                    if std::mem::replace(found, true) {
                        return None;
                    }
                }
            }
        }
        found
            .into_iter()
            .all(|found| found)
            .then_some(Self { nodes, count })
    }

    /// All nodes, key by key.
    pub(super) fn nodes(&self) -> &[TopNode] {
        &self.nodes
    }

    /// Where to begin; none if there are no patches.
    #[inline(always)]
    pub(super) fn root(&self) -> Option<Child> {
        let root = self.nodes.first()?;
        // With a single patch there is nothing to choose from.
        Some(match root.links.children {
            1 => root.links.child(0),
            _ => Child::Node(0),
        })
    }

    /// A node at a motion key.
    #[inline(always)]
    pub(super) fn node(&self, number: u32, key: usize) -> &TopNode {
        &self.nodes[number as usize + key * self.count]
    }

    /// Of the children of a node that a ray meets, the nearest; the others wait. `MOVES` is whether there is more than one
    /// motion key.
    #[inline(always)]
    pub(super) fn enter<L: Lanes, const MOVES: bool>(
        &self,
        lanes: L,
        number: u32,
        moment: &Moment,
        ray: &LatticeRay,
        stack: &mut Stack,
    ) -> Option<Waiting> {
        let node = self.node(number, moment.from);
        let mut near = [0.0; LANES];
        let met = if MOVES {
            let later = &self.node(number, moment.to).boxes;
            (node.boxes).met_on_the_way(later, moment, lanes, ray, &mut near)
        } else {
            node.boxes.met(lanes, ray, &mut near)
        };
        let there = (1 << node.children()) - 1;
        stack.add(met & there, |c| Waiting::child(near[c], node.child(c)))
    }

    /// What it encloses at a motion key.
    pub(super) fn extent(&self, key: usize) -> Extent {
        self.nodes
            .get(key * self.count)
            .map_or(Extent::EMPTY, |root| {
                (0..root.children())
                    .map(|c| root.boxes.get(c))
                    .fold(Extent::EMPTY, Extent::union)
            })
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        size_of_val(&*self.nodes)
    }
}

/// Nodes around patches, key by key; `number` says which patch a leaf is.
fn nodes(links: &[Links], patches: &[Vec<Extent>], number: impl Fn(u32) -> usize) -> Vec<TopNode> {
    (patches.iter())
        .flat_map(|key| nodes_of_key(links, |patch| key[number(patch)]))
        .collect()
}

/// Nodes around patches of the given boxes.
fn nodes_of_key(links: &[Links], patch: impl Fn(u32) -> Extent) -> Vec<TopNode> {
    let mut extents = vec![Extent::EMPTY; links.len()];
    let mut nodes = Vec::with_capacity(links.len());
    for (node, &links) in links.iter().enumerate().rev() {
        let mut children = [Extent::EMPTY; LANES];
        for (c, extent) in children.iter_mut().enumerate().take(links.children.into()) {
            *extent = match links.child(c) {
                Child::Node(node) => extents[node as usize],
                Child::Patch(number) => patch(number),
            };
        }
        extents[node] = children.into_iter().fold(Extent::EMPTY, Extent::union);
        nodes.push(TopNode {
            boxes: Boxes::new(&children),
            links,
            zero: [0; 2],
        });
    }
    nodes.reverse();
    nodes
}

impl TopNode {
    #[inline(always)]
    pub(super) fn children(&self) -> usize {
        self.links.children.into()
    }

    #[inline(always)]
    pub(super) fn child(&self, c: usize) -> Child {
        self.links.child(c)
    }

    /// Which children are patches, as bits, and which patch the first child would be if it were one of them: patches are
    /// one after the other.
    #[inline(always)]
    pub(super) fn patches(&self) -> (u32, i64) {
        let (nodes, children) = (self.links.nodes, self.links.children);
        let bits = ((1_u32 << children) - 1) & !((1_u32 << nodes) - 1);
        (bits, i64::from(self.links.first_patch) - i64::from(nodes))
    }
}

impl Links {
    #[inline(always)]
    fn child(&self, c: usize) -> Child {
        match c.checked_sub(self.nodes.into()) {
            None => Child::Node(self.first_node + c as u32),
            Some(c) => Child::Patch(self.first_patch + c as u32),
        }
    }
}

/// A patch that is to be sorted in.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    patch: u32,
    extent: Extent,
}

impl Leaf {
    /// Twice its middle along an axis.
    fn centre(&self, k: usize) -> i64 {
        i64::from(self.extent.min[k]) + i64::from(self.extent.max[k])
    }
}

/// Which node is to be made, of leaves from which on, at which level.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    node: usize,
    first: usize,
    level: usize,
}

/// Sorts leaves into the children of a node, and adds the nodes below it.
fn split(leaves: &mut [Leaf], place: Place, nodes: &mut Vec<Links>) {
    let mut parts = Vec::with_capacity(LANES);
    parts.push(0..leaves.len());
    while parts.len() < LANES {
        let by_count = place.level >= FREE_LEVELS;
        let size = |part: &std::ops::Range<usize>| {
            let of_part = &leaves[part.clone()];
            if by_count {
                part.len() as f64
            } else {
                area(of_part)
            }
        };
        // Of equals, the first.
        let largest = (0..parts.len())
            .filter(|&p| parts[p].len() > 1)
            .map(|p| (size(&parts[p]), p))
            .reduce(|a, b| if b.0 > a.0 { b } else { a });
        let Some((_, p)) = largest else { break };
        let part = parts[p].clone();
        let of_part = &mut leaves[part.clone()];
        let middle = part.start + halve(of_part, by_count);
        parts[p] = part.start..middle;
        parts.insert(p + 1, middle..part.end);
    }
    // Nodes first, so that patches are one after the other.
    let (many, single): (Vec<_>, Vec<_>) = parts.into_iter().partition(|part| part.len() > 1);
    if !single.is_empty() {
        let sorted: Vec<Leaf> = (many.iter().chain(&single))
            .flat_map(|part| leaves[part.clone()].iter().copied())
            .collect();
        leaves.copy_from_slice(&sorted);
    }
    let below = leaves.len() - single.len();
    nodes[place.node] = Links {
        first_node: nodes.len() as u32,
        first_patch: (place.first + below) as u32,
        nodes: many.len() as u16,
        children: (many.len() + single.len()) as u16,
    };
    let first_node = nodes.len();
    nodes.resize(first_node + many.len(), Links::default());
    let mut rest = &mut leaves[..below];
    let (mut first, level) = (place.first, place.level + 1);
    for (n, part) in many.iter().enumerate() {
        let (of_part, after) = rest.split_at_mut(part.len());
        let place = Place {
            node: first_node + n,
            first,
            level,
        };
        split(of_part, place, nodes);
        first += part.len();
        rest = after;
    }
}

/// Puts some leaves before the others. How many, from 1 to all but one.
fn halve(leaves: &mut [Leaf], by_count: bool) -> usize {
    if !by_count && let Some(cut) = Cut::cheapest(leaves) {
        leaves.sort_by_key(|leaf| cut.is_after(leaf));
        return leaves.partition_point(|leaf| !cut.is_after(leaf));
    }
    let [low, high] = centres(leaves);
    let axis = (0..3).max_by_key(|&k| high[k] - low[k]).unwrap_or(0);
    let middle = leaves.len() / 2;
    leaves.select_nth_unstable_by_key(middle, |leaf| (leaf.centre(axis), leaf.patch));
    middle
}

/// A plane between centres.
#[derive(Debug, Clone, Copy)]
struct Cut {
    axis: usize,
    /// The first centre, and how far it is to the last.
    low: i64,
    reach: i64,
    /// The first bin after the plane.
    bin: usize,
}

impl Cut {
    fn bin_of(&self, leaf: &Leaf) -> usize {
        ((leaf.centre(self.axis) - self.low) * BINS as i64 / (self.reach + 1)) as usize
    }

    fn is_after(&self, leaf: &Leaf) -> bool {
        self.bin_of(leaf) >= self.bin
    }

    /// The one where the surface area heuristic is least; none where all centres are the same.
    fn cheapest(leaves: &[Leaf]) -> Option<Self> {
        type Bin = (Extent, usize);
        let join = |a: Bin, b: &Bin| (a.0.union(b.0), a.1 + b.1);
        let cost = |bin: Bin| half_area(&bin.0) * bin.1 as f64;
        let [low, high] = centres(leaves);
        let mut best: Option<(f64, Self)> = None;
        for axis in (0..3).filter(|&k| high[k] > low[k]) {
            let mut cut = Self {
                axis,
                low: low[axis],
                reach: high[axis] - low[axis],
                bin: 0,
            };
            let mut bins = [(Extent::EMPTY, 0); BINS];
            for leaf in leaves {
                let bin = &mut bins[cut.bin_of(leaf)];
                *bin = join(*bin, &(leaf.extent, 1));
            }
            for bin in 1..BINS {
                let before = bins[..bin].iter().fold((Extent::EMPTY, 0), join);
                let after = bins[bin..].iter().fold((Extent::EMPTY, 0), join);
                let all = cost(before) + cost(after);
                // The first bin and the last are never empty: either side has a leaf.
                if best.is_none_or(|best| all < best.0) {
                    cut.bin = bin;
                    best = Some((all, cut));
                }
            }
        }
        best.map(|(_, cut)| cut)
    }
}

/// The least and the greatest centre, axis by axis.
fn centres(leaves: &[Leaf]) -> [[i64; 3]; 2] {
    leaves
        .iter()
        .fold([[i64::MAX; 3], [i64::MIN; 3]], |[low, high], leaf| {
            let pick =
                |a: [i64; 3], f: fn(i64, i64) -> i64| [0, 1, 2].map(|k| f(a[k], leaf.centre(k)));
            [pick(low, i64::min), pick(high, i64::max)]
        })
}

fn area(leaves: &[Leaf]) -> f64 {
    let all = leaves.iter().map(|leaf| leaf.extent);
    half_area(&all.fold(Extent::EMPTY, Extent::union))
}

/// Half of a box's surface.
fn half_area(extent: &Extent) -> f64 {
    if extent.is_empty() {
        return 0.0;
    }
    let [x, y, z] = [0, 1, 2].map(|k| f64::from(extent.max[k]) - f64::from(extent.min[k]));
    x * y + y * z + z * x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::surface::tests::shapes::Random;

    /// All patches below a node, each with the boxes on the way to it; deeper than allowed is a failure.
    fn walk(
        top: &Top,
        child: Child,
        key: usize,
        above: &mut Vec<Extent>,
        met: &mut Vec<(u32, Vec<Extent>)>,
    ) {
        assert!(above.len() <= MOST_LEVELS);
        match child {
            Child::Patch(patch) => met.push((patch, above.clone())),
            Child::Node(number) => {
                let node = top.node(number, key);
                assert!(node.children() >= 2);
                for c in 0..node.children() {
                    above.push(node.boxes.get(c));
                    walk(top, node.child(c), key, above, met);
                    above.pop();
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn every_patch_is_there_once_and_enclosed(
            count in 0_usize..400,
            size in 0_u32..23,
            keys in 1_usize..3,
            gathered in 1_u32..400,
            seed: u64,
        ) {
            let mut random = Random(seed);
            let most = f64::from((1_i32 << size) - 1);
            // Few different corners: many boxes are the same, or flat, or points.
            let corners: Vec<[i32; 3]> = (0..gathered)
                .map(|_| [(); 3].map(|()| (f64::from(random.next() - 0.5) * 2.0 * most) as i32))
                .collect();
            let mut corner = || corners[(random.next() * gathered as f32) as usize % corners.len()];
            let patches: Vec<Vec<Extent>> = (0..keys)
                .map(|_| {
                    let one = |_| Extent::EMPTY.including(corner()).including(corner());
                    (0..count).map(one).collect()
                })
                .collect();
            let (top, order) = Top::new(patches.clone());
            for (key, extents) in patches.iter().enumerate() {
                let mut met = Vec::new();
                if let Some(root) = top.root() {
                    walk(&top, root, key, &mut vec![top.extent(key)], &mut met);
                }
                let mut numbers: Vec<u32> = met.iter().map(|(patch, _)| order[*patch as usize]).collect();
                numbers.sort_unstable();
                prop_assert!(numbers.into_iter().eq(0..count as u32));
                for (patch, above) in met {
                    let content = extents[order[patch as usize] as usize];
                    for around in above {
                        prop_assert_eq!(around, around.union(content));
                    }
                }
            }
        }
    }
}
