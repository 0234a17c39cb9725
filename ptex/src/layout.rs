//! The fixed structures of a file, packed and little endian: header, extended header, face info, level info and the
//! word that tells size and encoding of a block.
//!
//! A file is: header, extended header, face info (zlib), constant data (zlib), level info, the levels (each a zlib
//! header and the faces' blocks), meta data (zlib), 8 zero bytes, headers of large meta data (zlib), their data, edits.

use crate::error::{Error, Result};
use crate::types::{BorderMode, DataType, EdgeFilter, FaceInfo, MeshType, Neighbour, Res};

/// Bytes of [`Header`].
pub(crate) const HEADER: usize = 64;
/// Bytes of [`ExtHeader`] as it is written today.
pub(crate) const EXT_HEADER: usize = 40;
/// Bytes of a [`StoredFace`].
pub(crate) const FACE: usize = 20;
/// Bytes of a [`LevelInfo`].
pub(crate) const LEVEL: usize = 16;
/// The zero bytes between the meta data and what came with later versions.
pub(crate) const BARRIER: u64 = 8;
/// The largest logarithm of a face's columns or rows that is read or written: a million texels on a side.
pub const MAX_LOG2: i8 = 20;

/// The first 64 bytes of a file, checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Of the format: 1.
    pub version: u32,
    /// Which faces the mesh has.
    pub mesh_type: MeshType,
    /// In which type texels are stored.
    pub data_type: DataType,
    /// The channel that is alpha, -1 without.
    pub alpha_channel: i32,
    /// Channels of a texel, at least 1.
    pub channels: u16,
    /// Levels of data: the full size and its stored reductions.
    pub levels: u16,
    /// Faces.
    pub faces: u32,
    /// Bytes of the extended header.
    pub ext_header_size: u32,
    /// Bytes of the face info, compressed.
    pub face_info_size: u32,
    /// Bytes of the constant data, compressed.
    pub constant_data_size: u32,
    /// Bytes of the level info.
    pub level_info_size: u32,
    /// Of the format: 4 today.
    pub minor_version: u32,
    /// Bytes of all levels.
    pub level_data_size: u64,
    /// Bytes of the small meta data, compressed.
    pub meta_zip_size: u32,
    /// The same, expanded.
    pub meta_size: u32,
}

impl Header {
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut r = Bytes(bytes);
        if r.take(4)? != b"Ptex" {
            return Err(Error::malformed(
                "is no Ptex file: it does not begin with the letters Ptex",
            ));
        }
        let version = r.u32()?;
        if version != 1 {
            return Err(Error::malformed(format!(
                "has version {version} of the format, and 1 can be read"
            )));
        }
        let mesh_type = match r.u32()? {
            0 => MeshType::Triangle,
            1 => MeshType::Quad,
            n => {
                return Err(Error::malformed(format!(
                    "has mesh type {n}; 0 and 1 are known"
                )));
            }
        };
        let data_type = match r.u32()? {
            0 => DataType::U8,
            1 => DataType::U16,
            2 => DataType::F16,
            3 => DataType::F32,
            n => {
                return Err(Error::malformed(format!(
                    "has data type {n}; 0 to 3 are known"
                )));
            }
        };
        let header = Self {
            version,
            mesh_type,
            data_type,
            alpha_channel: r.u32()? as i32,
            channels: r.u16()?,
            levels: r.u16()?,
            faces: r.u32()?,
            ext_header_size: r.u32()?,
            face_info_size: r.u32()?,
            constant_data_size: r.u32()?,
            level_info_size: r.u32()?,
            minor_version: r.u32()?,
            level_data_size: r.u64()?,
            meta_zip_size: r.u32()?,
            meta_size: r.u32()?,
        };
        let Header {
            channels,
            alpha_channel: alpha,
            levels,
            ..
        } = header;
        if channels == 0 {
            return Err(Error::malformed("has 0 channels"));
        }
        if alpha < -1 || alpha >= i32::from(channels) {
            return Err(Error::malformed(format!(
                "names channel {alpha} as alpha and has {channels} channels"
            )));
        }
        if u64::from(levels) * LEVEL as u64 > u64::from(header.level_info_size) {
            return Err(Error::malformed(format!(
                "has {levels} levels, and {} bytes of level info where each takes {LEVEL}",
                header.level_info_size
            )));
        }
        if levels == 0 && header.faces > 0 {
            return Err(Error::malformed(format!(
                "has {} faces and no level of data",
                header.faces
            )));
        }
        Ok(header)
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(HEADER);
        out.extend(b"Ptex");
        out.extend(self.version.to_le_bytes());
        out.extend((self.mesh_type as u32).to_le_bytes());
        out.extend((self.data_type as u32).to_le_bytes());
        out.extend(self.alpha_channel.to_le_bytes());
        out.extend(self.channels.to_le_bytes());
        out.extend(self.levels.to_le_bytes());
        for field in [
            self.faces,
            self.ext_header_size,
            self.face_info_size,
            self.constant_data_size,
            self.level_info_size,
            self.minor_version,
        ] {
            out.extend(field.to_le_bytes());
        }
        out.extend(self.level_data_size.to_le_bytes());
        out.extend(self.meta_zip_size.to_le_bytes());
        out.extend(self.meta_size.to_le_bytes());
        out
    }

    /// Bytes of a texel.
    #[must_use]
    pub fn pixel_bytes(&self) -> usize {
        usize::from(self.channels) * self.data_type.bytes()
    }

    /// The channel that is alpha.
    #[must_use]
    pub fn alpha(&self) -> Option<usize> {
        usize::try_from(self.alpha_channel).ok()
    }
}

/// What follows the header in files since 2009, of any size: fields that are not there are zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtHeader {
    /// Beyond edges 1 and 3.
    pub u_border: BorderMode,
    /// Beyond edges 0 and 2.
    pub v_border: BorderMode,
    /// What crossing an edge does to a texel.
    pub edge_filter: EdgeFilter,
    /// Bytes of the large meta data's headers, compressed.
    pub large_meta_zip_size: u32,
    /// The same, expanded.
    pub large_meta_size: u32,
    /// Bytes of the large meta data themselves.
    pub large_meta_data_size: u64,
    /// Bytes of the edits.
    pub edit_size: u64,
    /// Where the edits begin; 0 in old files.
    pub edit_position: u64,
}

impl ExtHeader {
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut whole = [0; EXT_HEADER];
        let known = bytes.len().min(EXT_HEADER);
        whole[..known].copy_from_slice(&bytes[..known]);
        let mut r = Bytes(&whole);
        let u_border = border(r.u16()?)?;
        r.u16()?;
        let v_border = border(r.u16()?)?;
        let edge_filter = match r.u16()? {
            0 => EdgeFilter::None,
            1 => EdgeFilter::TangentVector,
            n => {
                return Err(Error::malformed(format!(
                    "has edge filter mode {n}; 0 and 1 are known"
                )));
            }
        };
        Ok(Self {
            u_border,
            v_border,
            edge_filter,
            large_meta_zip_size: r.u32()?,
            large_meta_size: r.u32()?,
            large_meta_data_size: r.u64()?,
            edit_size: r.u64()?,
            edit_position: r.u64()?,
        })
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(EXT_HEADER);
        out.extend((self.u_border as u16).to_le_bytes());
        out.extend(0_u16.to_le_bytes());
        out.extend((self.v_border as u16).to_le_bytes());
        out.extend((self.edge_filter as u16).to_le_bytes());
        out.extend(self.large_meta_zip_size.to_le_bytes());
        out.extend(self.large_meta_size.to_le_bytes());
        out.extend(self.large_meta_data_size.to_le_bytes());
        out.extend(self.edit_size.to_le_bytes());
        out.extend(self.edit_position.to_le_bytes());
        out
    }
}

fn border(n: u16) -> Result<BorderMode> {
    match n {
        0 => Ok(BorderMode::Clamp),
        1 => Ok(BorderMode::Black),
        2 => Ok(BorderMode::Periodic),
        n => Err(Error::malformed(format!(
            "has border mode {n}; 0 to 2 are known"
        ))),
    }
}

/// A face as the file has it: neighbours may be wrong, and an edge may be named where there is no neighbour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredFace {
    /// The size of its texture.
    pub res: Res,
    /// The neighbours' edges, two bits each, edge 0 lowest.
    pub edges: u8,
    /// 1 constant, 2 has edits, 4 constant neighbourhood, 8 sub-face.
    pub flags: u8,
    /// The neighbours, -1 for none.
    pub faces: [i32; 4],
}

/// [`StoredFace::flags`].
pub(crate) const CONSTANT: u8 = 1;
pub(crate) const HAS_EDITS: u8 = 2;
pub(crate) const CONSTANT_NEIGHBOURHOOD: u8 = 4;
pub(crate) const SUBFACE: u8 = 8;

impl StoredFace {
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut r = Bytes(bytes);
        let [ulog2, vlog2, edges, flags] = [r.u8()?, r.u8()?, r.u8()?, r.u8()?];
        let mut faces = [0; 4];
        for face in &mut faces {
            *face = r.u32()? as i32;
        }
        let res = Res {
            ulog2: ulog2 as i8,
            vlog2: vlog2 as i8,
        };
        Ok(Self {
            res,
            edges,
            flags,
            faces,
        })
    }

    pub(crate) fn bytes(&self) -> [u8; FACE] {
        let mut out = [0; FACE];
        out[0] = self.res.ulog2 as u8;
        out[1] = self.res.vlog2 as u8;
        out[2] = self.edges;
        out[3] = self.flags;
        for (to, face) in out[4..].chunks_exact_mut(4).zip(self.faces) {
            to.copy_from_slice(&face.to_le_bytes());
        }
        out
    }

    /// The edge of the neighbour behind `edge`.
    #[must_use]
    pub fn edge(&self, edge: usize) -> u8 {
        self.edges >> (2 * edge) & 3
    }

    /// For use: a neighbour outside of the file's `count` faces is none.
    pub(crate) fn info(&self, count: u32) -> FaceInfo {
        let neighbours = std::array::from_fn(|edge| {
            let face = u32::try_from(self.faces[edge]).ok()?;
            (face < count).then(|| Neighbour {
                face,
                edge: self.edge(edge),
            })
        });
        FaceInfo {
            res: self.res,
            neighbours,
            constant: self.flags & CONSTANT != 0,
            has_edits: self.flags & HAS_EDITS != 0,
            constant_neighbourhood: self.flags & CONSTANT_NEIGHBOURHOOD != 0,
            subface: self.flags & SUBFACE != 0,
        }
    }
}

impl From<&FaceInfo> for StoredFace {
    fn from(info: &FaceInfo) -> Self {
        let mut stored = Self {
            res: info.res,
            edges: 0,
            flags: 0,
            faces: [-1; 4],
        };
        for (edge, neighbour) in info.neighbours.iter().enumerate() {
            if let Some(neighbour) = neighbour {
                stored.faces[edge] = neighbour.face as i32;
                stored.edges |= (neighbour.edge & 3) << (2 * edge);
            }
        }
        for (set, flag) in [
            (info.constant, CONSTANT),
            (info.has_edits, HAS_EDITS),
            (info.constant_neighbourhood, CONSTANT_NEIGHBOURHOOD),
            (info.subface, SUBFACE),
        ] {
            stored.flags |= if set { flag } else { 0 };
        }
        stored
    }
}

/// One level of data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelInfo {
    /// Bytes of its header and data.
    pub size: u64,
    /// Bytes of its header, compressed.
    pub header_size: u32,
    /// Faces that it holds.
    pub faces: u32,
}

impl LevelInfo {
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut r = Bytes(bytes);
        Ok(Self {
            size: r.u64()?,
            header_size: r.u32()?,
            faces: r.u32()?,
        })
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(LEVEL);
        out.extend(self.size.to_le_bytes());
        out.extend(self.header_size.to_le_bytes());
        out.extend(self.faces.to_le_bytes());
        out
    }
}

/// How a block's bytes are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// One texel.
    Constant,
    /// A zlib stream, channel after channel.
    Zip,
    /// The same of differences between neighbours in the stream.
    DiffZip,
    /// A grid of blocks.
    Tiles,
}

/// The bytes of a face or of a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) at: u64,
    pub(crate) size: u32,
    pub(crate) encoding: Encoding,
}

/// Bits of a block's word that are its size.
const SIZE_BITS: u32 = 30;
/// The largest block.
pub(crate) const MAX_BLOCK: usize = (1 << SIZE_BITS) - 1;

impl Block {
    /// From the word that tells of it.
    pub(crate) fn new(word: u32, at: u64) -> Self {
        let encoding = match word >> SIZE_BITS {
            0 => Encoding::Constant,
            1 => Encoding::Zip,
            2 => Encoding::DiffZip,
            _ => Encoding::Tiles,
        };
        Self {
            at,
            size: word & MAX_BLOCK as u32,
            encoding,
        }
    }

    /// All blocks of a header, one after another from `at` on, and where they end.
    pub(crate) fn row(words: &[u8], mut at: u64) -> (Vec<Self>, u64) {
        let blocks = words
            .chunks_exact(4)
            .map(|word| {
                let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
                let block = Self::new(word, at);
                // Sums of 2^32 blocks of 2^30 bytes, from positions within a file, stay far from 2^64.
                at += u64::from(block.size);
                block
            })
            .collect();
        (blocks, at)
    }
}

/// The word of a block.
pub(crate) fn block_word(size: usize, encoding: Encoding) -> u32 {
    debug_assert!(size <= MAX_BLOCK, "a block of {size} bytes");
    (encoding as u32) << SIZE_BITS | size as u32
}

/// Takes fields from the front; a shortage is an error.
pub(crate) struct Bytes<'a>(pub(crate) &'a [u8]);

impl<'a> Bytes<'a> {
    pub(crate) fn take(&mut self, n: usize) -> Result<&'a [u8]> {
        if n > self.0.len() {
            return Err(Error::malformed(format!(
                "a structure ends {} bytes short",
                n - self.0.len()
            )));
        }
        let (front, rest) = self.0.split_at(n);
        self.0 = rest;
        Ok(front)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    pub(crate) fn u16(&mut self) -> Result<u16> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    pub(crate) fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(crate) fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array()?))
    }
}
