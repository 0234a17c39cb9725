//! Levels, faces and tiles: from the file, or computed from what is larger, into slots that readers look at without a
//! lock.
//!
//! A slot is empty or holds an [`Entry`]. Two threads that miss at once both load, and what comes first stays: a lock
//! would cost every lookup, this costs a few blocks read twice.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};

use arc_swap::{ArcSwapOption, Guard};

use super::{Level, Shared, Texels, told};
use crate::cache::Evict;
use crate::error::{Error, Result};
use crate::layout::{Block, Bytes, Encoding};
use crate::reduce::{self, Axis, premultiply};
use crate::sample::Pixels;
use crate::types::{MeshType, Res};
use crate::zip::{self, inflate};

/// What a slot gives: it stays there, whatever is evicted meanwhile.
pub(crate) type Held = Guard<Option<Arc<Entry>>>;
type Slot = ArcSwapOption<Entry>;

/// The slots of a face: a row of sizes along u for each size along v, and all of it again premultiplied.
pub(crate) struct Slots {
    res: Res,
    slots: Box<[Slot]>,
}

/// Texels of a face or tile, and whether they were used since the cache last looked.
pub(crate) struct Entry {
    pub(crate) texels: Stored,
    used: AtomicBool,
}

/// How texels are held.
pub(crate) enum Stored {
    /// One for all.
    Constant(Pixels),
    Whole(Pixels),
    Tiled(Tiled),
}

/// A grid of tiles, each loaded for itself.
pub(crate) struct Tiled {
    face: u32,
    res: Res,
    pub(crate) tile_res: Res,
    from: From,
    tiles: Box<[Slot]>,
}

enum From {
    File {
        blocks: Vec<Block>,
        premultiply: bool,
    },
    /// From the same face's texels at `parent`, two of which along `axis` make one.
    Halved {
        parent: Res,
        axis: Axis,
        premultiply: bool,
    },
}

/// Computed reductions of tiles stay tiled above this size in bytes: it is that of the smallest tiles in files.
const SMALL: usize = 1 << 16;

impl Slots {
    fn new(res: Res, alpha: bool) -> Self {
        let sizes = (res.ulog2 as usize + 1) * (res.vlog2 as usize + 1);
        let slots = (0..sizes * if alpha { 2 } else { 1 })
            .map(|_| Slot::empty())
            .collect();
        Self { res, slots }
    }

    #[inline]
    fn index(&self, res: Res, premultiply: bool) -> Option<usize> {
        let within =
            (0..=self.res.ulog2).contains(&res.ulog2) && (0..=self.res.vlog2).contains(&res.vlog2);
        let row = res.vlog2 as usize
            + if premultiply {
                self.res.vlog2 as usize + 1
            } else {
                0
            };
        within.then(|| row * (self.res.ulog2 as usize + 1) + res.ulog2 as usize)
    }
}

impl Entry {
    fn new(texels: Stored) -> Arc<Self> {
        Arc::new(Self {
            texels,
            used: AtomicBool::new(true),
        })
    }

    /// For the cache. Mostly set already: then the line stays shared between cores.
    #[inline]
    pub(crate) fn touch(&self) {
        if !self.used.load(Ordering::Relaxed) {
            self.used.store(true, Ordering::Relaxed);
        }
    }

    fn bytes(&self) -> usize {
        size_of::<Self>()
            + match &self.texels {
                Stored::Constant(pixels) | Stored::Whole(pixels) => pixels.memory(),
                Stored::Tiled(tiled) => {
                    let blocks = match &tiled.from {
                        From::File { blocks, .. } => size_of_val(blocks.as_slice()),
                        From::Halved { .. } => 0,
                    };
                    blocks + size_of_val(&*tiled.tiles)
                }
            }
    }
}

impl Shared {
    #[inline]
    pub(super) fn texels(
        self: &Arc<Self>,
        face: u32,
        res: Res,
        premultiply: bool,
    ) -> Result<Texels<'_>> {
        let premultiply = premultiply && self.header.alpha_channel >= 0;
        if let Some(info) = self.faces.get(face as usize)
            && !info.constant
            && let Some(slots) = self.slots[face as usize].get()
            && let Some(index) = slots.index(res, premultiply)
        {
            let held = slots.slots[index].load();
            if let Some(entry) = &*held {
                entry.touch();
                return Ok(Texels::held(self, res, held));
            }
        }
        self.texels_anew(face, res, premultiply)
            .map_err(|e| e.at_face(face).in_file(&self.path))
    }

    /// What is constant, and what is not loaded.
    #[inline(never)]
    fn texels_anew(self: &Arc<Self>, face: u32, res: Res, premultiply: bool) -> Result<Texels<'_>> {
        self.check_request(face, res)?;
        let info = &self.faces[face as usize];
        if info.constant || (res.ulog2, res.vlog2) == (0, 0) {
            return Ok(Texels::of_constants(
                self,
                res,
                self.constants(premultiply),
                face,
            ));
        }
        let entry = Entry::new(self.load(face, res, premultiply)?);
        let slots = self.slots[face as usize]
            .get_or_init(|| Slots::new(info.res, self.header.alpha_channel >= 0));
        let index = slots
            .index(res, premultiply)
            .expect("the request was checked");
        let held = keep(&slots.slots[index], entry, |bytes| {
            let file = Arc::downgrade(self);
            self.cache
                .note(bytes, Box::new(FaceSlot { file, face, index }));
        });
        Ok(Texels::held(self, res, held))
    }

    fn check_request(&self, face: u32, res: Res) -> Result<()> {
        let Some(info) = self.faces.get(face as usize) else {
            return Err(Error::request(
                format!(
                    "face {face} is asked for, and there are {}",
                    self.header.faces
                ),
                "ask for a face of the file",
            ));
        };
        let (du, dv) = (
            i32::from(info.res.ulog2) - i32::from(res.ulog2),
            i32::from(info.res.vlog2) - i32::from(res.vlog2),
        );
        if du < 0 || dv < 0 || res.ulog2 < 0 || res.vlog2 < 0 {
            return Err(Error::request(
                format!(
                    "2^{} x 2^{} texels are asked for, and the face has 2^{} x 2^{}",
                    res.ulog2, res.vlog2, info.res.ulog2, info.res.vlog2
                ),
                "ask for its size, or less",
            ));
        }
        if self.header.mesh_type == MeshType::Triangle && du != dv {
            return Err(Error::request(
                format!(
                    "2^{} x 2^{} texels of a triangle are asked for",
                    res.ulog2, res.vlog2
                ),
                "triangles are reduced as often along u as along v",
            ));
        }
        Ok(())
    }

    fn load(self: &Arc<Self>, face: u32, res: Res, premultiply: bool) -> Result<Stored> {
        let full = self.faces[face as usize].res;
        match self.block(face, res)? {
            Some(block) => self.read_block(face, block, res, premultiply && res == full),
            None => self.reduce(face, res, premultiply),
        }
    }

    /// Where the file has the texels of a face in that size.
    pub(super) fn block(&self, face: u32, res: Res) -> Result<Option<Block>> {
        let info = &self.faces[face as usize];
        let level = (info.res.ulog2 - res.ulog2) as usize;
        if level != (info.res.vlog2 - res.vlog2) as usize {
            return Ok(None);
        }
        if level == 0 {
            if let Some(edit) = self.edits.faces.get(&face) {
                return Ok(Some(edit.block));
            }
            let blocks = self.blocks(&self.levels[0], 0)?;
            return match blocks.get(face as usize) {
                Some(block) => Ok(Some(*block)),
                None => Err(Error::malformed(format!(
                    "level 0 ends before it, after {} faces",
                    blocks.len()
                ))),
            };
        }
        let rank = self.rank[face as usize];
        match self.levels.get(level) {
            Some(stored) if !info.has_edits && rank < stored.info.faces => {
                Ok(Some(self.blocks(stored, level)?[rank as usize]))
            }
            _ => Ok(None),
        }
    }

    pub(super) fn blocks<'a>(&self, level: &'a Level, index: usize) -> Result<&'a [Block]> {
        if let Some(blocks) = level.blocks.get() {
            return Ok(blocks);
        }
        let stored = u64::from(level.info.header_size);
        let words = self
            .inflated(level.at, stored, 4 * u64::from(level.info.faces))
            .map_err(|e| told(&format!("level {index}"), e))?;
        let (blocks, _) = Block::row(&words, level.at + stored);
        Ok(level.blocks.get_or_init(|| blocks))
    }

    /// The texels of a face or tile as the file has them.
    fn read_block(&self, face: u32, block: Block, res: Res, premultiplied: bool) -> Result<Stored> {
        let data_type = self.header.data_type;
        let channels = usize::from(self.header.channels);
        let stored = u64::from(block.size);
        let finish = |mut pixels: Pixels| {
            if let Some(alpha) = self.header.alpha().filter(|_| premultiplied) {
                premultiply(&mut pixels, channels, alpha);
            }
            pixels
        };
        match block.encoding {
            Encoding::Constant => {
                let pixel = self.header.pixel_bytes();
                if stored != pixel as u64 {
                    return Err(Error::malformed(format!(
                        "a constant block has {stored} bytes, and a texel {pixel}"
                    )));
                }
                let texel = self.source.read(block.at, stored)?;
                Ok(Stored::Constant(finish(Pixels::from_bytes(
                    &texel, data_type,
                ))))
            }
            Encoding::Zip | Encoding::DiffZip => {
                let differences = block.encoding == Encoding::DiffZip;
                if differences && !data_type.is_integer() {
                    return Err(Error::malformed(
                        "a block of floats is said to hold differences, as only integers can",
                    ));
                }
                let size = self.bytes_of(res);
                zip::expandable(stored, size)?;
                self.admit(size)?;
                let planes = inflate(&self.source.read(block.at, stored)?, size)?;
                Ok(Stored::Whole(finish(Pixels::from_planes(
                    &planes,
                    data_type,
                    channels,
                    differences,
                ))))
            }
            Encoding::Tiles => self
                .read_tiles(face, block, res, premultiplied)
                .map(Stored::Tiled),
        }
    }

    fn read_tiles(&self, face: u32, block: Block, res: Res, premultiply: bool) -> Result<Tiled> {
        const HEAD: u64 = 6;
        let stored = u64::from(block.size);
        let head = self.source.read(block.at, HEAD.min(stored))?;
        let mut r = Bytes(&head);
        let tile_res = Res {
            ulog2: r.u8()? as i8,
            vlog2: r.u8()? as i8,
        };
        let zip_size = u64::from(r.u32()?);
        if !(0..=res.ulog2).contains(&tile_res.ulog2) || !(0..=res.vlog2).contains(&tile_res.vlog2)
        {
            return Err(Error::malformed(format!(
                "its tiles have 2^{} x 2^{} texels, and it has 2^{} x 2^{}",
                tile_res.ulog2, tile_res.vlog2, res.ulog2, res.vlog2
            )));
        }
        if zip_size > stored - HEAD {
            return Err(Error::malformed(format!(
                "the list of its tiles takes {zip_size} bytes, and all of it {stored}"
            )));
        }
        let count = tiles_in(res, tile_res);
        let words = self
            .inflated(block.at + HEAD, zip_size, 4 * count)
            .map_err(|e| told(&format!("the list of its {count} tiles"), e))?;
        let (blocks, end) = Block::row(&words, block.at + HEAD + zip_size);
        if end > block.at + stored {
            return Err(Error::malformed(format!(
                "its tiles take {} bytes more than the {stored} of the face",
                end - block.at - stored
            )));
        }
        let from = From::File {
            blocks,
            premultiply,
        };
        Ok(Tiled::new(face, res, tile_res, from))
    }

    /// A reduction that the file has not, from the next larger one.
    fn reduce(self: &Arc<Self>, face: u32, res: Res, premultiply: bool) -> Result<Stored> {
        let full = self.faces[face as usize].res;
        let channels = usize::from(self.header.channels);
        if self.header.mesh_type == MeshType::Triangle {
            let parent = Res {
                ulog2: res.ulog2 + 1,
                vlog2: res.vlog2 + 1,
            };
            let from = self.texels(face, parent, premultiply)?;
            if let Some(texel) = from.constant_texel() {
                return Ok(Stored::Constant(texel));
            }
            let texels = from.whole()?;
            let size = 1 << parent.ulog2;
            return Ok(Stored::Whole(reduce::triangle(&texels, size, channels)));
        }
        let (parent, axis) = parent(full, res);
        let from = self.texels(face, parent, premultiply)?;
        if let Some(texel) = from.constant_texel() {
            return Ok(Stored::Constant(texel));
        }
        if let Some(tile) = from.tile_res()
            && self.bytes_of(res) > SMALL as u64
        {
            let tile_res = match axis {
                Axis::U => Res {
                    ulog2: (tile.ulog2 - 1).max(0),
                    ..tile
                },
                Axis::V => Res {
                    vlog2: (tile.vlog2 - 1).max(0),
                    ..tile
                },
            };
            let from = From::Halved {
                parent,
                axis,
                premultiply,
            };
            return Ok(Stored::Tiled(Tiled::new(face, res, tile_res, from)));
        }
        let texels = from.whole()?;
        let width = 1 << parent.ulog2;
        Ok(Stored::Whole(reduce::halved(
            &texels, width, channels, axis,
        )))
    }

    pub(super) fn tile_res(self: &Arc<Self>, face: u32, res: Res) -> Result<Option<Res>> {
        let find = || {
            self.check_request(face, res)?;
            if self.faces[face as usize].constant || (res.ulog2, res.vlog2) == (0, 0) {
                return Ok(None);
            }
            match self.block(face, res)? {
                Some(block) if block.encoding == Encoding::Tiles => {
                    Ok(self.texels(face, res, false)?.tile_res())
                }
                _ => Ok(None),
            }
        };
        find().map_err(|e: Error| e.at_face(face).in_file(&self.path))
    }

    /// A tile of `entry`, which is tiled.
    #[inline]
    pub(super) fn tile(self: &Arc<Self>, entry: &Arc<Entry>, index: usize) -> Result<Held> {
        let Stored::Tiled(tiled) = &entry.texels else {
            unreachable!("only tiled texels have tiles");
        };
        let held = tiled.tiles[index].load();
        if let Some(tile) = &*held {
            tile.touch();
            return Ok(held);
        }
        let texels = self
            .load_tile(tiled, index)
            .map_err(|e| e.at_face(tiled.face).in_file(&self.path))?;
        Ok(keep(&tiled.tiles[index], Entry::new(texels), |bytes| {
            let table = Arc::downgrade(entry);
            self.cache.note(bytes, Box::new(TileSlot { table, index }));
        }))
    }

    #[inline(never)]
    fn load_tile(self: &Arc<Self>, tiled: &Tiled, index: usize) -> Result<Stored> {
        let size = tiled.tile_res;
        match &tiled.from {
            From::File {
                blocks,
                premultiply,
            } => {
                let block = blocks[index];
                if block.encoding == Encoding::Tiles {
                    return Err(Error::malformed(format!(
                        "its tile {index} is said to be tiled again"
                    )));
                }
                self.read_block(tiled.face, block, size, *premultiply)
                    .map_err(|e| told(&format!("its tile {index}"), e))
            }
            From::Halved {
                parent,
                axis,
                premultiply,
            } => {
                let from = self.texels(tiled.face, *parent, *premultiply)?;
                let across = 1 << (tiled.res.ulog2 - size.ulog2);
                let (mut x, mut y) = (
                    (index % across) << size.ulog2,
                    (index / across) << size.vlog2,
                );
                let (mut width, mut height) = (1 << size.ulog2, 1 << size.vlog2);
                match axis {
                    Axis::U => (x, width) = (2 * x, 2 * width),
                    Axis::V => (y, height) = (2 * y, 2 * height),
                }
                if let Some(texel) = from.constant_rect(x, y, width, height)? {
                    return Ok(Stored::Constant(texel));
                }
                let texels = from.rect(x, y, width, height)?;
                let channels = usize::from(self.header.channels);
                Ok(Stored::Whole(reduce::halved(
                    &texels, width, channels, *axis,
                )))
            }
        }
    }

    /// Bytes of a rectangle of texels: at most 2^40 texels of 2^18 bytes.
    fn bytes_of(&self, res: Res) -> u64 {
        (self.header.pixel_bytes() as u64) << (res.ulog2 as u32 + res.vlog2 as u32)
    }
}

impl Tiled {
    fn new(face: u32, res: Res, tile_res: Res, from: From) -> Self {
        let tiles = (0..tiles_in(res, tile_res))
            .map(|_| Slot::empty())
            .collect();
        Self {
            face,
            res,
            tile_res,
            from,
            tiles,
        }
    }

    /// The width of the grid, in tiles.
    #[inline]
    pub(crate) fn across(&self) -> usize {
        1 << (self.res.ulog2 - self.tile_res.ulog2)
    }
}

fn tiles_in(res: Res, tile: Res) -> u64 {
    1 << (res.ulog2 - tile.ulog2 + res.vlog2 - tile.vlog2) as u32
}

/// What a reduction is computed from, and along which axis: where both are still to be halved equally often the
/// target's size along u decides.
fn parent(full: Res, res: Res) -> (Res, Axis) {
    let (du, dv) = (full.ulog2 - res.ulog2, full.vlog2 - res.vlog2);
    let along_u = if du == dv {
        res.ulog2 % 2 == 1
    } else {
        du > dv
    };
    if along_u {
        let ulog2 = res.ulog2 + 1;
        (Res { ulog2, ..res }, Axis::U)
    } else {
        let vlog2 = res.vlog2 + 1;
        (Res { vlog2, ..res }, Axis::V)
    }
}

/// Puts an entry into an empty slot and has it noted; where another was quicker, takes that one.
fn keep(slot: &Slot, entry: Arc<Entry>, note: impl FnOnce(usize)) -> Held {
    let empty: Option<Arc<Entry>> = None;
    let before = slot.compare_and_swap(&empty, Some(Arc::clone(&entry)));
    if before.is_some() {
        return before;
    }
    note(entry.bytes());
    Guard::from_inner(Some(entry))
}

/// Empties a slot that was not used since the last time.
fn clear(slot: &Slot) -> bool {
    let used = match &*slot.load() {
        Some(entry) => entry.used.swap(false, Ordering::Relaxed),
        None => false,
    };
    if !used {
        slot.store(None);
    }
    !used
}

struct FaceSlot {
    file: Weak<Shared>,
    face: u32,
    index: usize,
}

impl Evict for FaceSlot {
    fn evict(&self) -> bool {
        self.file
            .upgrade()
            .and_then(|file| {
                file.slots[self.face as usize]
                    .get()
                    .map(|slots| clear(&slots.slots[self.index]))
            })
            .unwrap_or(true)
    }
}

struct TileSlot {
    table: Weak<Entry>,
    index: usize,
}

impl Evict for TileSlot {
    fn evict(&self) -> bool {
        match self.table.upgrade().as_deref() {
            Some(Entry {
                texels: Stored::Tiled(tiled),
                ..
            }) => clear(&tiled.tiles[self.index]),
            // The table went, and its tiles with it.
            _ => true,
        }
    }
}
