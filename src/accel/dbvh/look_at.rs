//! The ranges of values in all blocks: what is looked up when heights are new. Nothing of it is kept but codes.

use mapped::Large;
use rayon::prelude::*;

use super::Dbvh;
use super::block::{Block, Quad, Sheet, Single};
use super::build::at_key;
use super::face::Patch;
use super::heights::{Range, Ranges, Reader, Source};
use super::look_up::{expect, range_of_all};
use super::part::Part;
use super::woven::{Net, Woven};
use crate::accel::simd::{Body, LANES, Lanes};
use crate::error::{Error, Result};
use crate::memory::{amount, none_left};

/// Patches, or places for their parts, that are in work at once.
const BATCH: usize = 1 << 12;

/// Parts that a thread takes at once.
const CHUNK: usize = 16;

impl Dbvh {
    /// Looks up what values the blocks of all patches have.
    pub(super) fn look_at(&mut self, go_on: &dyn Fn(f64) -> bool) -> Result<()> {
        // Values as they are, of which codes are made.
        let (scale, bias) = (self.heights.scale, self.heights.bias);
        (self.heights.scale, self.heights.bias) = (1.0, 0.0);
        let mut patches = std::mem::take(&mut self.patches);
        let mut ranges = std::mem::take(&mut self.ranges);
        let this: &Self = self;
        let levels = |patch: &Patch| this.faces[patch.face as usize].levels;
        let inner_parts = |patch: &Patch| this.faces[patch.face as usize].inner_parts(patch);
        if ranges.is_empty() {
            let mut count = 0;
            for patch in &mut patches {
                patch.ranges = count as u32;
                count += inner_parts(patch);
            }
            ranges = Large::zeros(count).map_err(|_| {
                let bytes = count as f64 * size_of::<Ranges>() as f64;
                none_left(format!("ranges of heights take {}", amount(bytes)))
            })?;
        }
        let whole = (patches.len() + ranges.len()) as f64;
        let mut done = 0;
        let mut goes_on = |more: usize| {
            done += more;
            go_on(done as f64 / whole)
        };
        let mut went_on = true;
        // Those that are but a block.
        for batch in patches.chunks_mut(BATCH) {
            batch
                .par_iter_mut()
                .filter(|patch| levels(patch) == 0)
                .for_each(|patch| patch.ranges = this.ranges_in(patch, None)[0]);
            went_on = went_on && goes_on(batch.len());
        }
        // Those with parts, in the order of their places.
        let mut order: Vec<&Patch> = patches.iter().filter(|patch| levels(patch) > 0).collect();
        order.par_sort_unstable_by_key(|patch| patch.ranges);
        let mut order = order.into_iter().peekable();
        let mut free = &mut *ranges;
        while went_on && order.peek().is_some() {
            let mut batch = Vec::new();
            let mut work = 0;
            while work < BATCH
                && let Some(patch) = order.next()
            {
                let (places, others) = std::mem::take(&mut free).split_at_mut(inner_parts(patch));
                work += places.len();
                batch.push((patch, places));
                free = others;
            }
            batch
                .par_iter_mut()
                .for_each(|(patch, places)| this.look_at_parts(patch, places));
            went_on = goes_on(work);
        }
        (self.patches, self.ranges) = (patches, ranges);
        (self.heights.scale, self.heights.bias) = (scale, bias);
        if went_on {
            Ok(())
        } else {
            Err(Error::Interrupted)
        }
    }

    /// The values' ranges in a part's blocks, or in a patch that is but a block.
    fn ranges_in(&self, patch: &Patch, part: Option<Part>) -> [Range; LANES] {
        self.isa.run(RangesOf {
            tree: self,
            patch,
            part,
        })
    }

    /// Notes the values of all parts of a patch in their places.
    fn look_at_parts(&self, patch: &Patch, places: &mut [Ranges]) {
        let face = &self.faces[patch.face as usize];
        let lowest = face.places(patch, 1);
        let look_at = |(place, to): (usize, &mut Ranges)| {
            let part = face.part_in(patch, 1, place);
            *to = Ranges::new(&self.ranges_in(patch, Some(part)), face.there(&part));
        };
        places[lowest]
            .par_iter_mut()
            .with_min_len(CHUNK)
            .enumerate()
            .for_each(look_at);
        for level in 2..=face.levels.into() {
            let of_level = face.places(patch, level);
            for place in 0..of_level.len() {
                let part = face.part_in(patch, level, place);
                let there = face.there(&part);
                let mut ranges = [0; LANES];
                for c in (0..LANES).filter(|c| there >> c & 1 == 1) {
                    let child = part.child(c);
                    let below = &places[face.place(patch, &child)];
                    ranges[c] = below.all(face.there(&child));
                }
                places[of_level.start + place] = Ranges::new(&ranges, there);
            }
        }
    }
}

/// The values' ranges in a part's blocks, or in a patch that is but a block, as codes.
struct RangesOf<'a> {
    tree: &'a Dbvh,
    patch: &'a Patch,
    part: Option<Part>,
}

impl Body for RangesOf<'_> {
    type Output = [Range; LANES];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> [Range; LANES] {
        let Self { tree, patch, part } = self;
        let face = &tree.faces[patch.face as usize];
        let reader = tree.heights.reader();
        let mut out = [0; LANES];
        if face.is_woven() {
            let net = Net::new(tree, face, patch, &at_key(0));
            let sheet = Woven::new(lanes, face, patch, &net);
            let block = Block::new(tree, patch, &face.span(patch, [0; 2]));
            out[0] = code(lanes, tree, &reader, &block, &sheet);
            return out;
        }
        // Where it is does not matter.
        let quad = Quad {
            p: [[0.0; 4]; 3],
            n: [[0.0; 4]; 3],
        };
        let there = match &part {
            Some(part) => face.there(part),
            None => 1,
        };
        // While one block is looked up, what the next one needs is on its way.
        let mut before: Option<(usize, Block<'_>, Single<'_, L>)> = None;
        let mut rest = there;
        while rest != 0 {
            let c = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let at = match &part {
                Some(part) => part.child(c).at,
                None => [0; 2],
            };
            let block = Block::new(tree, patch, &face.span(patch, at));
            let sheet = Single::new(lanes, tree, patch, &block, &quad);
            if let Reader::Image(texels) = &reader {
                expect(lanes, texels, &sheet, block.pairs());
            }
            if let Some((c, block, sheet)) = before.replace((c, block, sheet)) {
                out[c] = code(lanes, tree, &reader, &block, &sheet);
            }
        }
        if let Some((c, block, sheet)) = before {
            out[c] = code(lanes, tree, &reader, &block, &sheet);
        }
        out
    }
}

/// The values' range in a block.
#[inline(always)]
fn code<L: Lanes>(
    lanes: L,
    tree: &Dbvh,
    reader: &Reader<'_>,
    block: &Block<'_>,
    sheet: &impl Sheet<L>,
) -> Range {
    let mut least = lanes.floats(f32::MAX);
    let mut most = lanes.floats(f32::MIN);
    if let Reader::Image(texels) = reader {
        [least, most] = range_of_all(lanes, texels, sheet, block.pairs());
    } else {
        let all = u64::MAX >> (64 - LANES * block.pairs());
        for key in 0..tree.corners.len() {
            let moment = at_key(key);
            let heights = (tree.heights).of_block(lanes, reader, (block, sheet), all, &moment);
            for heights in heights.into_iter().take(block.pairs()) {
                // What is no number decides nothing.
                least = lanes.min(heights, least);
                most = lanes.max(heights, most);
            }
            if !matches!(tree.heights.source, Source::Kept(_)) {
                break;
            }
        }
    }
    let (mut low, mut high) = ([0.0; LANES], [0.0; LANES]);
    lanes.store(least, &mut low);
    lanes.store(most, &mut high);
    let mut range = [f32::MAX, f32::MIN];
    for lane in 0..LANES {
        range = [range[0].min(low[lane]), range[1].max(high[lane])];
    }
    tree.heights.code(range)
}
