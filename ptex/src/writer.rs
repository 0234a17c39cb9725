//! Writing: whole files, laid out as other readers of Ptex expect them.

pub(crate) mod face;
pub(crate) mod neighbourhood;

use std::borrow::Cow;
use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};
use crate::layout::{
    BARRIER, EXT_HEADER, ExtHeader, HEADER, Header, LEVEL, LevelInfo, MAX_LOG2, StoredFace,
};
use crate::meta::{self, Meta, MetaValue};
use crate::reader::{Reader, ranks};
use crate::temporary::write_whole;
use crate::types::{BorderMode, DataType, EdgeFilter, FaceInfo, MeshType, Res};
use crate::zip::deflate;
use face::Effort;
pub use face::EncodedFace;
use neighbourhood::constant_neighbourhoods;

/// What all faces of a file have in common.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Format {
    /// Which faces the mesh has.
    pub mesh_type: MeshType,
    /// In which type texels are stored.
    pub data_type: DataType,
    /// Channels of a texel, 1 to 65535.
    pub channels: usize,
    /// The channel that is alpha.
    pub alpha_channel: Option<usize>,
    /// Beyond edges 1 and 3 without a neighbour.
    pub u_border: BorderMode,
    /// Beyond edges 0 and 2 without a neighbour.
    pub v_border: BorderMode,
    /// What crossing an edge does to a texel.
    pub edge_filter: EdgeFilter,
    /// Whether to store reductions, which take a third more room and make wide filters quick.
    pub reductions: bool,
}

impl Format {
    /// Without alpha, borders clamped, with reductions.
    #[must_use]
    pub fn new(mesh_type: MeshType, data_type: DataType, channels: usize) -> Self {
        Self {
            mesh_type,
            data_type,
            channels,
            alpha_channel: None,
            u_border: BorderMode::Clamp,
            v_border: BorderMode::Clamp,
            edge_filter: EdgeFilter::None,
            reductions: true,
        }
    }

    /// That of a file.
    #[must_use]
    pub fn of(reader: &Reader) -> Self {
        let (u_border, v_border) = reader.border_modes();
        Self {
            alpha_channel: reader.alpha_channel(),
            u_border,
            v_border,
            edge_filter: reader.edge_filter(),
            reductions: reader.header().levels > 1,
            ..Self::new(reader.mesh_type(), reader.data_type(), reader.channels())
        }
    }

    /// Bytes of a texel.
    #[must_use]
    pub fn pixel_bytes(&self) -> usize {
        self.channels * self.data_type.bytes()
    }

    /// Makes a face ready to be stored: constant if all texels are equal, with reductions else. `texels` are all
    /// texels in the file's type, little endian, row 0 first, the channels of a texel side by side, not
    /// premultiplied; or a single one that stands for all.
    ///
    /// # Errors
    /// If the number of texels is another, or no face can have that size.
    pub fn encode(&self, res: Res, texels: &[u8]) -> Result<EncodedFace> {
        self.check_texels(res, texels)?;
        EncodedFace::new(self, res, texels, Effort::Full)
    }

    pub(crate) fn encode_edit(&self, res: Res, texels: &[u8]) -> Result<EncodedFace> {
        self.check_texels(res, texels)?;
        EncodedFace::new(self, res, texels, Effort::Quick)
    }

    fn check(&self) -> Result<()> {
        let Self {
            channels,
            alpha_channel,
            ..
        } = *self;
        if !(1..=usize::from(u16::MAX)).contains(&channels) {
            return Err(Error::request(
                format!("{channels} channels cannot be stored"),
                "have at least one channel, and at most 65535",
            ));
        }
        if let Some(alpha) = alpha_channel.filter(|alpha| *alpha >= channels) {
            return Err(Error::request(
                format!("channel {alpha} is to be alpha, and there are {channels}"),
                "name a channel that there is",
            ));
        }
        Ok(())
    }

    fn check_texels(&self, res: Res, texels: &[u8]) -> Result<()> {
        self.check()?;
        let Res { ulog2, vlog2 } = res;
        let sensible = 0..=MAX_LOG2;
        if !sensible.contains(&ulog2) || !sensible.contains(&vlog2) {
            return Err(Error::request(
                format!("2^{ulog2} x 2^{vlog2} texels cannot be stored"),
                format!("use exponents from 0 to {MAX_LOG2}"),
            ));
        }
        if self.mesh_type == MeshType::Triangle && ulog2 != vlog2 {
            return Err(Error::request(
                format!("2^{ulog2} x 2^{vlog2} texels cannot be those of a triangle"),
                "give triangles as many texels along u as along v",
            ));
        }
        let pixel = self.pixel_bytes();
        let all = (pixel as u64) << (ulog2 + vlog2) as u32;
        if texels.len() as u64 != all && texels.len() != pixel {
            return Err(Error::request(
                format!(
                    "{} bytes are given for 2^{ulog2} x 2^{vlog2} texels of {pixel} bytes",
                    texels.len()
                ),
                format!("give {all} bytes, or {pixel} if all texels are equal"),
            ));
        }
        Ok(())
    }
}

/// A file in the making. It is held in memory as it will be stored.
#[derive(Clone, Debug)]
pub struct Writer {
    format: Format,
    faces: Vec<Option<(FaceInfo, EncodedFace)>>,
    meta: Meta,
}

impl Writer {
    /// A file of `faces` faces. Those that it is never given will be black, of one texel, without neighbours.
    ///
    /// # Errors
    /// If there can be no such file.
    pub fn new(format: Format, faces: u32) -> Result<Self> {
        format.check()?;
        if i32::try_from(faces).is_err() {
            return Err(Error::request(
                format!("{faces} faces cannot be stored"),
                "have fewer than 2^31",
            ));
        }
        Ok(Self {
            format,
            faces: vec![None; faces as usize],
            meta: Meta::default(),
        })
    }

    /// A copy of a file, its edits applied.
    ///
    /// # Errors
    /// If the file cannot be read whole.
    pub fn copy_of(reader: &Reader) -> Result<Self> {
        let mut this = Self::new(Format::of(reader), reader.face_count())?;
        let mut bytes = Vec::new();
        for face in 0..reader.face_count() {
            let info = reader.face(face);
            let texels = reader.texels(face, info.res, false)?;
            let (width, height) = match texels.constant() {
                true => (1, 1),
                false => (1 << info.res.ulog2, 1 << info.res.vlog2),
            };
            bytes.clear();
            texels.copy(0, 0, width, height, &mut bytes)?;
            this.face(face, info, &bytes)?;
        }
        this.meta = reader.meta()?.clone();
        Ok(this)
    }

    /// What all faces have in common.
    #[must_use]
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// Gives a face its texels, as [`Format::encode`] wants them, and its neighbours. Of `info` the size, the
    /// neighbours and [`FaceInfo::subface`] count; the other flags are found out.
    ///
    /// # Errors
    /// If there is no such face or neighbour, and as [`Format::encode`].
    pub fn face(&mut self, face: u32, info: &FaceInfo, texels: &[u8]) -> Result<()> {
        let encoded = self
            .format
            .encode(info.res, texels)
            .map_err(|e| e.at_face(face))?;
        self.encoded_face(face, info, encoded)
    }

    /// The same with what [`Format::encode`] made of the texels.
    ///
    /// # Errors
    /// If there is no such face or neighbour, or the size is another.
    pub fn encoded_face(&mut self, face: u32, info: &FaceInfo, encoded: EncodedFace) -> Result<()> {
        let count = self.faces.len();
        check_neighbours(info, self.format.mesh_type, count).map_err(|e| e.at_face(face))?;
        if encoded.res != info.res {
            return Err(
                Error::request("is given texels of another size", "encode it in its size")
                    .at_face(face),
            );
        }
        let Some(slot) = self.faces.get_mut(face as usize) else {
            return Err(Error::request(
                format!("face {face} is given, and there are {count}"),
                "give faces of the file",
            ));
        };
        *slot = Some((*info, encoded));
        Ok(())
    }

    /// Adds meta data, or replaces what has that name.
    ///
    /// # Errors
    /// If the name cannot be stored: it has to have 1 to 254 bytes, none of them 0.
    pub fn set_meta(&mut self, key: &str, value: MetaValue) -> Result<()> {
        check_key(key)?;
        self.meta.set(key, value);
        Ok(())
    }

    /// Writes the file: under another name first, so that it appears whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written there.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let parts = self.parts().map_err(|e| e.in_file(path))?;
        write_whole(path, |out| {
            parts.iter().try_for_each(|part| out.write_all(part))
        })
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// If something is too large for the format.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        Ok(self.parts()?.concat())
    }

    /// The file in pieces, in order.
    fn parts(&self) -> Result<Vec<Cow<'_, [u8]>>> {
        let format = &self.format;
        let faces = self.infos();
        let mut constants = Vec::with_capacity(faces.len() * format.pixel_bytes());
        for face in &self.faces {
            match face {
                Some((_, encoded)) => constants.extend(&encoded.texel),
                None => constants.resize(constants.len() + format.pixel_bytes(), 0),
            }
        }
        let stored: Vec<StoredFace> = faces.iter().map(StoredFace::from).collect();
        let face_info: Vec<u8> = stored.iter().flat_map(StoredFace::bytes).collect();
        let (face_info, constants) = (deflate(&face_info), deflate(&constants));

        let mut levels = Vec::new();
        let mut data = Vec::new();
        for level in self.levels(&stored) {
            let words: Vec<u8> = level
                .iter()
                .flat_map(|block| block.map_or(0, |b| b.word).to_le_bytes())
                .collect();
            let words = deflate(&words);
            let blocks = level.iter().flatten();
            let size = blocks.clone().map(|b| b.bytes.len() as u64).sum::<u64>();
            levels.push(LevelInfo {
                size: words.len() as u64 + size,
                header_size: small(words.len(), "level header")?,
                faces: level.len() as u32,
            });
            data.push(Cow::Owned(words));
            data.extend(blocks.map(|b| Cow::Borrowed(b.bytes.as_slice())));
        }

        let meta = MetaParts::new(&self.meta)?;
        let large: u64 = meta.large_data.iter().map(|d| d.len() as u64).sum();
        let level_data: u64 = levels.iter().map(|l| l.size).sum();
        let mut ext = ExtHeader {
            u_border: format.u_border,
            v_border: format.v_border,
            edge_filter: format.edge_filter,
            large_meta_zip_size: small(meta.large.0.len(), "meta data")?,
            large_meta_size: small(meta.large.1, "meta data")?,
            large_meta_data_size: large,
            edit_size: 0,
            edit_position: 0,
        };
        let header = Header {
            version: 1,
            mesh_type: format.mesh_type,
            data_type: format.data_type,
            alpha_channel: format.alpha_channel.map_or(-1, |alpha| alpha as i32),
            channels: format.channels as u16,
            levels: levels.len() as u16,
            faces: faces.len() as u32,
            ext_header_size: EXT_HEADER as u32,
            face_info_size: small(face_info.len(), "face info")?,
            constant_data_size: small(constants.len(), "constant data")?,
            level_info_size: (levels.len() * LEVEL) as u32,
            minor_version: 4,
            level_data_size: level_data,
            meta_zip_size: small(meta.small.0.len(), "meta data")?,
            meta_size: small(meta.small.1, "meta data")?,
        };
        // Edits will begin where the file ends.
        ext.edit_position = (HEADER + EXT_HEADER) as u64
            + (face_info.len() + constants.len() + levels.len() * LEVEL) as u64
            + level_data
            + meta.small.0.len() as u64
            + BARRIER
            + meta.large.0.len() as u64
            + large;
        let head = [header.bytes(), ext.bytes(), face_info, constants];
        let level_info = levels.iter().map(LevelInfo::bytes);
        let tail = [meta.small.0, vec![0; BARRIER as usize], meta.large.0];
        let mut parts: Vec<_> = head.into_iter().chain(level_info).map(Cow::Owned).collect();
        parts.extend(data);
        parts.extend(tail.into_iter().chain(meta.large_data).map(Cow::Owned));
        Ok(parts)
    }

    /// The faces with their flags.
    fn infos(&self) -> Vec<FaceInfo> {
        let mut faces: Vec<FaceInfo> = self
            .faces
            .iter()
            .map(|face| match face {
                Some((info, encoded)) => FaceInfo {
                    constant: encoded.constant(),
                    has_edits: false,
                    constant_neighbourhood: false,
                    ..*info
                },
                None => FaceInfo {
                    res: Res { ulog2: 0, vlog2: 0 },
                    neighbours: [None; 4],
                    constant: true,
                    has_edits: false,
                    constant_neighbourhood: false,
                    subface: false,
                },
            })
            .collect();
        let zero = vec![0; self.format.pixel_bytes()];
        let texel = |face: usize| match &self.faces[face] {
            Some((_, encoded)) => &encoded.texel,
            None => &zero,
        };
        let flags = constant_neighbourhoods(
            &faces,
            self.format.mesh_type,
            (self.format.u_border, self.format.v_border),
            |a, b| texel(a) == texel(b),
        );
        for (face, flag) in faces.iter_mut().zip(flags) {
            face.constant_neighbourhood = flag;
        }
        faces
    }

    /// The blocks of each level: of all faces in the first, of those that have one in the others.
    fn levels(&self, stored: &[StoredFace]) -> Vec<Vec<Option<&face::EncodedBlock>>> {
        let block = |face: usize, level: usize| {
            let (_, encoded) = self.faces[face].as_ref()?;
            encoded.levels.get(level)
        };
        let mut order: Vec<usize> = vec![0; stored.len()];
        for (face, rank) in ranks(stored).into_iter().enumerate() {
            order[rank as usize] = face;
        }
        let mut levels = vec![(0..stored.len()).map(|face| block(face, 0)).collect()];
        loop {
            let blocks: Vec<_> = order
                .iter()
                .map_while(|face| block(*face, levels.len()).map(Some))
                .collect();
            if blocks.is_empty() {
                return levels;
            }
            levels.push(blocks);
        }
    }
}

/// A size that is stored in 32 bits.
fn small(size: usize, what: &str) -> Result<u32> {
    u32::try_from(size).map_err(|_| {
        Error::request(
            format!("the {what} takes {size} bytes, and 2^32 - 1 can be stored"),
            "have less of it",
        )
    })
}

pub(crate) fn check_neighbours(info: &FaceInfo, mesh_type: MeshType, count: usize) -> Result<()> {
    let edges = match mesh_type {
        MeshType::Triangle => 3,
        MeshType::Quad => 4,
    };
    for (edge, neighbour) in info.neighbours.iter().enumerate() {
        let Some(neighbour) = neighbour else { continue };
        let wrong = if edge >= edges {
            format!("has a neighbour at edge {edge}, and {edges} edges")
        } else if usize::from(neighbour.edge) >= edges {
            format!(
                "has edge {} of a face as a neighbour, and faces have {edges} edges",
                neighbour.edge
            )
        } else if neighbour.face as usize >= count {
            format!(
                "has face {} as a neighbour, and there are {count}",
                neighbour.face
            )
        } else {
            continue;
        };
        return Err(Error::request(
            wrong,
            "give it neighbours that there are, or none",
        ));
    }
    Ok(())
}

pub(crate) fn check_key(key: &str) -> Result<()> {
    if key.is_empty() || key.len() > meta::MAX_KEY || key.contains('\0') {
        return Err(Error::request(
            format!("{key:?} cannot be a name of meta data"),
            format!("use 1 to {} bytes, none of them 0", meta::MAX_KEY),
        ));
    }
    Ok(())
}

/// Meta data as they are stored.
struct MetaParts {
    /// Small entries, compressed, and their size before.
    small: (Vec<u8>, usize),
    /// The list of large entries, likewise.
    large: (Vec<u8>, usize),
    large_data: Vec<Vec<u8>>,
}

impl MetaParts {
    fn new(meta: &Meta) -> Result<Self> {
        let (mut entries, mut large, mut large_data) = (Vec::new(), Vec::new(), Vec::new());
        for (key, value) in meta.iter() {
            check_key(key)?;
            let bytes = value.bytes();
            small(bytes.len(), &format!("meta data {key:?}"))?;
            if bytes.len() > meta::LARGE {
                let data = deflate(&bytes);
                meta::write_head(key, value, bytes.len(), &mut large);
                large.extend((data.len() as u32).to_le_bytes());
                large_data.push(data);
            } else {
                meta::write_head(key, value, bytes.len(), &mut entries);
                entries.extend(bytes);
            }
        }
        Ok(Self {
            small: compressed(&entries),
            large: compressed(&large),
            large_data,
        })
    }
}

/// A block and its size before; nothing stays nothing.
pub(crate) fn compressed(bytes: &[u8]) -> (Vec<u8>, usize) {
    match bytes {
        [] => (Vec::new(), 0),
        bytes => (deflate(bytes), bytes.len()),
    }
}
