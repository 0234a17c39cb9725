//! Reading: one open file, used by all threads at once.
//!
//! Opening reads what is small: headers, face info, constant texels, edits. Levels, faces and tiles are read when they
//! are first asked for, and kept as long as the [`Cache`] has room. Looking up what is there takes no lock.
//!
//! What a file says of its sizes is believed only as far as its own size can justify: a zlib stream expands to 1032
//! times its length at most, and tables take up to seven times the bytes that they are made from. Beyond the cache's
//! budget a file can so make us take 8192 times its size, and no more.

mod edits;
mod load;
mod sections;
mod texels;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use crate::cache::Cache;
use crate::error::{Error, ErrorKind, Result};
use crate::layout::{
    Block, ExtHeader, FACE, HEADER, Header, LEVEL, LevelInfo, MAX_LOG2, StoredFace,
};
use crate::meta::{Meta, read_large};
use crate::reduce::premultiply;
use crate::sample::Pixels;
use crate::source::Source;
use crate::types::{BorderMode, DataType, EdgeFilter, FaceInfo, MeshType, Res};
use crate::zip::{self, inflate};

use load::Slots;
use sections::Sections;
pub use texels::Texels;

/// An open Ptex file. Clones are the same file.
#[derive(Clone)]
pub struct Reader(Arc<Shared>);

struct Shared {
    path: PathBuf,
    source: Source,
    cache: Cache,
    header: Header,
    ext: ExtHeader,
    sections: Sections,
    faces: Vec<FaceInfo>,
    /// A face's place in the levels from 1 on.
    rank: Vec<u32>,
    levels: Vec<Level>,
    edits: edits::Edits,
    constants: Constants,
    /// The same premultiplied, in files with alpha.
    premultiplied: OnceLock<Constants>,
    /// By face: what is loaded of it.
    slots: Box<[OnceLock<Slots>]>,
    meta: OnceLock<Meta>,
}

/// A texel for every face.
struct Constants {
    pixels: Pixels,
    channels: usize,
}

/// A level's place, and its blocks once they were needed.
struct Level {
    info: LevelInfo,
    at: u64,
    blocks: OnceLock<Vec<Block>>,
}

impl Reader {
    /// Opens a file. Its texels share the budget of `cache`.
    ///
    /// # Errors
    /// If the file cannot be read, or its headers, face info, constant texels or edits are not as the format says.
    pub fn open(path: impl AsRef<Path>, cache: &Cache) -> Result<Self> {
        let path = path.as_ref();
        Source::open(path)
            .and_then(|source| Shared::new(source, path, cache))
            .map_err(|e| e.in_file(path))
            .map(|shared| Self(Arc::new(shared)))
    }

    /// Reads a file's bytes from memory. `name` is what errors call it.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn from_bytes(bytes: Vec<u8>, name: impl AsRef<Path>, cache: &Cache) -> Result<Self> {
        let path = name.as_ref();
        Shared::new(Source::memory(bytes), path, cache)
            .map_err(|e| e.in_file(path))
            .map(|shared| Self(Arc::new(shared)))
    }

    /// The file's path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// The header, as it is stored.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.0.header
    }

    /// The extended header; zeros where the file has none.
    #[must_use]
    pub fn ext_header(&self) -> &ExtHeader {
        &self.0.ext
    }

    /// Which faces the mesh has.
    #[must_use]
    pub fn mesh_type(&self) -> MeshType {
        self.0.header.mesh_type
    }

    /// In which type texels are stored.
    #[must_use]
    pub fn data_type(&self) -> DataType {
        self.0.header.data_type
    }

    /// Channels of a texel, at least 1.
    #[must_use]
    pub fn channels(&self) -> usize {
        usize::from(self.0.header.channels)
    }

    /// The channel that is alpha.
    #[must_use]
    pub fn alpha_channel(&self) -> Option<usize> {
        self.0.header.alpha()
    }

    /// What lies beyond edges without a neighbour, along u and along v.
    #[must_use]
    pub fn border_modes(&self) -> (BorderMode, BorderMode) {
        (self.0.ext.u_border, self.0.ext.v_border)
    }

    /// What crossing an edge does to a texel.
    #[must_use]
    pub fn edge_filter(&self) -> EdgeFilter {
        self.0.ext.edge_filter
    }

    /// Faces.
    #[must_use]
    pub fn face_count(&self) -> u32 {
        self.0.header.faces
    }

    /// A face's size, neighbours and flags. A neighbour that the file has not is none.
    ///
    /// # Panics
    /// If there is no such face.
    #[must_use]
    pub fn face(&self, face: u32) -> &FaceInfo {
        &self.0.faces[face as usize]
    }

    /// The levels of data: the full size, and the stored reductions.
    pub fn levels(&self) -> impl Iterator<Item = LevelInfo> {
        self.0.levels.iter().map(|level| level.info)
    }

    /// The faces in the order in which the levels from 1 on hold them.
    #[must_use]
    pub fn reduction_order(&self) -> Vec<u32> {
        let mut order = vec![0; self.0.rank.len()];
        for (face, rank) in (0..).zip(&self.0.rank) {
            order[*rank as usize] = face;
        }
        order
    }

    /// Whether incremental edits follow the file's first version.
    #[must_use]
    pub fn has_edits(&self) -> bool {
        self.0.edits.count > 0
    }

    /// The faces as the file has them, edits applied, neighbours unchecked.
    ///
    /// # Errors
    /// If the face info can be read no more.
    pub fn stored_faces(&self) -> Result<Vec<StoredFace>> {
        let read = || {
            let mut faces = self.0.read_faces()?;
            for (face, edit) in &self.0.edits.faces {
                faces[*face as usize] = edit.info;
            }
            Ok(faces)
        };
        read().map_err(|e: Error| e.in_file(&self.0.path))
    }

    /// The meta data, read when first asked for.
    ///
    /// # Errors
    /// If it is not as the format says.
    pub fn meta(&self) -> Result<&Meta> {
        if let Some(meta) = self.0.meta.get() {
            return Ok(meta);
        }
        let meta = self.0.read_meta().map_err(|e| e.in_file(&self.0.path))?;
        Ok(self.0.meta.get_or_init(|| meta))
    }

    /// The texels of a face at its full size or at any reduction. Of triangles there are only those that halve u and v
    /// as often. Premultiplied are the full size, the constant texels, and what is computed from them; stored
    /// reductions are so in any case.
    ///
    /// # Errors
    /// If there is no such face or reduction, or the face's data are not as the format says.
    #[inline]
    pub fn texels(&self, face: u32, res: Res, premultiply: bool) -> Result<Texels<'_>> {
        self.0.texels(face, res, premultiply)
    }

    pub(crate) fn sections(&self) -> &Sections {
        &self.0.sections
    }

    /// Where the last edit ends.
    pub(crate) fn edits_end(&self) -> u64 {
        self.0.edits.end
    }

    /// Whether an edit replaced the face.
    pub(crate) fn is_edited(&self, face: u32) -> bool {
        self.0.edits.faces.contains_key(&face)
    }

    /// Whether the file has the face in that size.
    pub(crate) fn is_stored(&self, face: u32, res: Res) -> Result<bool> {
        Ok(self.0.block(face, res)?.is_some())
    }

    /// Bytes that the file has of a face's full size.
    pub(crate) fn block_bytes(&self, face: u32) -> Result<Option<u32>> {
        let block = self.0.block(face, self.face(face).res)?;
        Ok(block.map(|block| block.size))
    }

    /// Where the blocks of a level end, and where the level does.
    pub(crate) fn level_end(&self, index: usize) -> Result<(u64, u64)> {
        let level = &self.0.levels[index];
        let start = level.at + u64::from(level.info.header_size);
        let blocks = self.0.blocks(level, index)?;
        let end = blocks.last().map_or(start, |b| b.at + u64::from(b.size));
        Ok((end, level.at + level.info.size))
    }

    pub(crate) fn source(&self) -> &Source {
        &self.0.source
    }

    /// The log2 size of tiles that the file has for a face's reduction, where that reduction is stored.
    ///
    /// # Errors
    /// As [`Reader::texels`].
    pub fn tile_res(&self, face: u32, res: Res) -> Result<Option<Res>> {
        self.0.tile_res(face, res)
    }
}

impl fmt::Debug for Reader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader")
            .field("path", &self.0.path)
            .field("header", &self.0.header)
            .finish_non_exhaustive()
    }
}

impl Shared {
    fn new(source: Source, path: &Path, cache: &Cache) -> Result<Self> {
        if source.len() < HEADER as u64 {
            return Err(Error::malformed(format!(
                "is no Ptex file: it has {} bytes, and the header alone has {HEADER}",
                source.len()
            )));
        }
        let header = Header::parse(&source.read(0, HEADER as u64)?)?;
        let ext = source.read(HEADER as u64, u64::from(header.ext_header_size))?;
        let ext = ExtHeader::parse(&ext)?;
        let sections = Sections::new(&header, &ext, &source)?;
        let channels = usize::from(header.channels);

        let mut this = Self {
            path: path.to_owned(),
            cache: cache.clone(),
            sections,
            faces: Vec::new(),
            rank: Vec::new(),
            levels: Vec::new(),
            edits: edits::Edits::default(),
            constants: Constants {
                pixels: Pixels::U8(Vec::new()),
                channels,
            },
            premultiplied: OnceLock::new(),
            slots: Box::default(),
            meta: OnceLock::new(),
            source,
            header,
            ext,
        };
        let mut faces = this.read_faces()?;
        this.rank = ranks(&faces);
        this.levels = this.read_levels()?;
        let mut constants = this.read_constants()?;
        this.edits = edits::Edits::read(&this.source, &this.header, sections.edits)?;
        let pixel = this.header.pixel_bytes();
        for (face, edit) in &this.edits.faces {
            faces[*face as usize] = edit.info;
            let at = *face as usize * pixel;
            constants[at..at + pixel].copy_from_slice(&edit.constant);
        }
        this.constants.pixels = Pixels::from_bytes(&constants, this.header.data_type);
        for (face, info) in (0..).zip(&faces) {
            this.check_size(info).map_err(|e| e.at_face(face))?;
        }
        let count = this.header.faces;
        this.faces = faces.iter().map(|face| face.info(count)).collect();
        this.slots = (0..count).map(|_| OnceLock::new()).collect();
        Ok(this)
    }

    fn read_faces(&self) -> Result<Vec<StoredFace>> {
        let size = u64::from(self.header.faces) * FACE as u64;
        let stored = u64::from(self.header.face_info_size);
        let bytes = self
            .inflated(self.sections.face_info, stored, size)
            .map_err(|e| told("face info", e))?;
        bytes.chunks_exact(FACE).map(StoredFace::parse).collect()
    }

    fn read_constants(&self) -> Result<Vec<u8>> {
        let size = u64::from(self.header.faces) * self.header.pixel_bytes() as u64;
        let stored = u64::from(self.header.constant_data_size);
        self.inflated(self.sections.constants, stored, size)
            .map_err(|e| told("constant data", e))
    }

    fn read_levels(&self) -> Result<Vec<Level>> {
        let count = usize::from(self.header.levels);
        let bytes = self
            .source
            .read(self.sections.level_info, (count * LEVEL) as u64)?;
        let mut at = self.sections.levels;
        let mut levels = Vec::with_capacity(count);
        for (i, bytes) in bytes.chunks_exact(LEVEL).enumerate() {
            let info = LevelInfo::parse(bytes)?;
            let wrong = |what: String| Err(Error::malformed(format!("level {i} {what}")));
            if info.faces > self.header.faces {
                return wrong(format!(
                    "has {} faces, and the file has {}",
                    info.faces, self.header.faces
                ));
            }
            // The sum cannot pass the end of the file's levels, and so cannot overflow.
            if info.size > self.sections.meta - at {
                return wrong(format!(
                    "takes {} bytes at {at}, and the levels end at {}",
                    info.size, self.sections.meta
                ));
            }
            if u64::from(info.header_size) > info.size {
                return wrong(format!(
                    "takes {} bytes, and its header {}",
                    info.size, info.header_size
                ));
            }
            levels.push(Level {
                info,
                at,
                blocks: OnceLock::new(),
            });
            at += info.size;
        }
        Ok(levels)
    }

    fn read_meta(&self) -> Result<Meta> {
        let Header {
            meta_zip_size,
            meta_size,
            ..
        } = self.header;
        let mut meta = Meta::default();
        let part = |e| told("meta data", e);
        if meta_size > 0 {
            let bytes = self
                .inflated(
                    self.sections.meta,
                    u64::from(meta_zip_size),
                    u64::from(meta_size),
                )
                .map_err(part)?;
            meta.read(&bytes).map_err(part)?;
        }
        if self.ext.large_meta_size > 0 {
            let stored = u64::from(self.ext.large_meta_zip_size);
            let size = u64::from(self.ext.large_meta_size);
            let bytes = self
                .inflated(self.sections.large_meta, stored, size)
                .map_err(part)?;
            let mut at = self.sections.large_meta_data;
            let end = at + self.ext.large_meta_data_size;
            for entry in read_large(&bytes).map_err(part)? {
                let stored = u64::from(entry.zip_size);
                if stored > end - at {
                    return Err(Error::malformed(format!(
                        "meta data {:?} reaches past the end of its section at {end}",
                        entry.key
                    )));
                }
                let data = self
                    .inflated(at, stored, u64::from(entry.size))
                    .and_then(|data| crate::meta::MetaValue::parse(&entry.key, entry.tag, &data))
                    .map_err(part)?;
                meta.set(entry.key, data);
                at += stored;
            }
        }
        for edit in &self.edits.meta {
            let bytes = self
                .inflated(edit.at, u64::from(edit.stored), u64::from(edit.size))
                .map_err(part)?;
            meta.read(&bytes).map_err(part)?;
        }
        Ok(meta)
    }

    /// A zlib stream of the file. What it cannot hold, and what is too large altogether, is refused unread.
    fn inflated(&self, at: u64, stored: u64, size: u64) -> Result<Vec<u8>> {
        zip::expandable(stored, size)?;
        inflate(&self.source.read(at, stored)?, size)
    }

    /// What is allocated at once is at most the cache's budget or 1032 times the file's size, whichever is more.
    fn admit(&self, bytes: u64) -> Result<()> {
        let most = self
            .source
            .len()
            .saturating_mul(zip::MOST)
            .max(self.cache.budget() as u64);
        if bytes > most {
            return Err(Error::new(
                ErrorKind::Memory,
                format!("its texels take {bytes} bytes at once, and {most} is the most"),
                "open the file with a cache of a larger budget",
            ));
        }
        Ok(())
    }

    fn check_size(&self, face: &StoredFace) -> Result<()> {
        let Res { ulog2, vlog2 } = face.res;
        let sensible = 0..=MAX_LOG2;
        if !sensible.contains(&ulog2) || !sensible.contains(&vlog2) {
            return Err(Error::malformed(format!(
                "has 2^{ulog2} x 2^{vlog2} texels; exponents from 0 to {MAX_LOG2} can be"
            )));
        }
        if self.header.mesh_type == MeshType::Triangle && ulog2 != vlog2 {
            return Err(Error::malformed(format!(
                "has 2^{ulog2} x 2^{vlog2} texels; a triangle's must be as many both ways"
            )));
        }
        Ok(())
    }

    /// The constant texels of all faces.
    fn constants(&self, premultiplied: bool) -> &Constants {
        match self.header.alpha() {
            Some(alpha) if premultiplied => self.premultiplied.get_or_init(|| {
                let channels = self.constants.channels;
                let mut pixels = self.constants.pixels.clone();
                premultiply(&mut pixels, channels, alpha);
                Constants { pixels, channels }
            }),
            _ => &self.constants,
        }
    }
}

/// Each face's place in the levels from 1 on: those whose smaller side is largest come first, constant ones as if it
/// were 2 texels, and else in their order.
pub(crate) fn ranks(faces: &[StoredFace]) -> Vec<u32> {
    let key = |face: &StoredFace| {
        std::cmp::Reverse(match face.flags & crate::layout::CONSTANT {
            0 => face.res.ulog2.min(face.res.vlog2),
            _ => 1,
        })
    };
    let mut order: Vec<u32> = (0..faces.len() as u32).collect();
    order.sort_by_key(|face| key(&faces[*face as usize]));
    let mut ranks = vec![0; order.len()];
    for (rank, face) in (0..).zip(order) {
        ranks[face as usize] = rank;
    }
    ranks
}

fn told(part: &str, e: Error) -> Error {
    match e.kind() {
        ErrorKind::Malformed => Error::malformed(format!("{part}: {}", e.message())),
        _ => e,
    }
}
