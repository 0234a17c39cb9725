//! Ptex files as textures: looked up by a face of the mesh that they were made for, and a point on it.

use std::sync::{Arc, OnceLock};

use glam::Vec4;
use relievo_ptex::{Cache, Consistent, DataType, FaceBounds, Filter, FilterKind, MeshType, Reader};

use super::{ColorSpace, ImageSource, linear_from_srgb};
use crate::error::Fault;
use crate::math::{Area, Vec2};
use crate::store::Digest;

/// How a texture is looked up between its texels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PtexFilter {
    /// Bilinear, and at a shared edge or vertex all faces see the same bits: see [`Consistent`].
    Consistent,
    /// One of the filters that the format defines.
    Kernel(Filter),
}

impl Default for PtexFilter {
    fn default() -> Self {
        Self::Kernel(Filter::new(FilterKind::Bilinear))
    }
}

impl PtexFilter {
    /// The names that [`named`](Self::named) knows.
    pub fn names() -> impl Iterator<Item = &'static str> {
        let kernels = FilterKind::NAMES.into_iter().map(|(name, _)| name);
        std::iter::once("consistent").chain(kernels)
    }

    /// By its name.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn named(name: &str) -> Result<Self, Fault> {
        if name == "consistent" {
            return Ok(Self::Consistent);
        }
        let known = FilterKind::NAMES.into_iter().find(|(n, _)| *n == name);
        known
            .map(|(_, kind)| Self::Kernel(Filter::new(kind)))
            .ok_or_else(|| {
                let names: Vec<_> = Self::names().collect();
                Fault::new(format!("there is no Ptex filter {name:?}"))
                    .advise(format!("use one of {}", names.join(", ")))
            })
    }
}

/// How a file is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PtexOptions {
    /// Between texels.
    pub filter: PtexFilter,
    /// The channel that becomes red. The next two are green and blue; a file with one or two channels from there on
    /// has the first in all three. Alpha is the file's alpha channel, or 1.
    pub first_channel: usize,
    /// How its numbers are meant. [`ColorSpace::Auto`]: bytes of three channels and more are encoded as sRGB.
    pub color_space: ColorSpace,
}

/// A file that is being looked up.
pub struct PtexTexture {
    source: Source,
    /// What went wrong first: data are read when they are first needed.
    fault: OnceLock<Fault>,
}

enum Source {
    Constant(Vec4),
    File(Box<File>),
}

struct File {
    reader: Reader,
    lookup: Lookup,
    first: usize,
    /// Channels that count, from the first one on: 1 or 3.
    colors: usize,
    alpha: Option<usize>,
    srgb: bool,
}

enum Lookup {
    Consistent(Consistent),
    Kernel(Filter),
}

impl PtexTexture {
    /// Opens a file, or an entry of a package, for any number of textures; its texels are read into `cache` when they
    /// are looked up.
    ///
    /// # Errors
    /// If it cannot be read, or is none.
    pub fn open(image: &ImageSource, cache: &Cache) -> Result<Reader, Fault> {
        let reader = match image {
            ImageSource::File(path) => Reader::open(path, cache)?,
            ImageSource::Packed { package, tiles } => {
                let [(_, name, bytes)] = &tiles[..] else {
                    return Err(Fault::new("a Ptex file has no tiles")
                        .in_file(package)
                        .advise("name one file, without <UDIM>"));
                };
                Reader::from_bytes(bytes.to_vec(), package.join(name), cache)?
            }
        };
        Ok(reader)
    }

    /// An opened file, read in a way.
    ///
    /// # Errors
    /// If it has not that channel.
    pub fn new(reader: Reader, options: &PtexOptions) -> Result<Self, Fault> {
        let path = reader.path();
        let (channels, first) = (reader.channels(), options.first_channel);
        if first >= channels {
            return Err(
                Fault::new(format!("there is no channel {first}: it has {channels}"))
                    .in_file(path)
                    .advise("count channels from 0"),
            );
        }
        let alpha = reader.alpha_channel();
        let colors = match (first..channels).filter(|c| Some(*c) != alpha).count() {
            0..=2 => 1,
            _ => 3,
        };
        let srgb = match options.color_space {
            ColorSpace::Srgb => true,
            ColorSpace::Raw | ColorSpace::AcesCg => false,
            ColorSpace::Auto => reader.data_type() == DataType::U8 && colors == 3,
        };
        let lookup = match options.filter {
            // Meshes of triangles have no such lookup; this one is as smooth.
            PtexFilter::Consistent if reader.mesh_type() == MeshType::Triangle => {
                Lookup::Kernel(Filter::new(FilterKind::Bilinear))
            }
            PtexFilter::Consistent => Lookup::Consistent(Consistent::new(&reader, 0, false)?),
            PtexFilter::Kernel(filter) => Lookup::Kernel(filter),
        };
        Ok(Self {
            source: Source::File(Box::new(File {
                reader,
                lookup,
                first,
                colors,
                alpha: alpha.filter(|_| colors == 3),
                srgb,
            })),
            fault: OnceLock::new(),
        })
    }

    /// The same everywhere.
    pub fn constant(value: Vec4) -> Self {
        Self {
            source: Source::Constant(value),
            fault: OnceLock::new(),
        }
    }

    /// The file, unless it is the same everywhere.
    pub fn reader(&self) -> Option<&Reader> {
        match &self.source {
            Source::Constant(_) => None,
            Source::File(file) => Some(&file.reader),
        }
    }

    /// The four channels of an area around a point of a face, linear; no less than a texel, nor than the filter is told
    /// to take. [`Consistent`] covers a texel whatever the area. Zero where the file turns out to be damaged: see
    /// [`fault`](Self::fault).
    pub fn eval(&self, face: u32, uv: Vec2, area: &Area) -> Vec4 {
        match &self.source {
            Source::Constant(value) => *value,
            Source::File(file) => file.eval(face, uv, area).unwrap_or_else(|e| {
                self.fault.get_or_init(|| e.into());
                Vec4::ZERO
            }),
        }
    }

    /// What was wrong with the file at the first lookup that failed: what was made of it is not to be trusted.
    pub fn fault(&self) -> Option<&Fault> {
        self.fault.get()
    }

    /// What lookups of one of the four channels in a face can give before they are decoded; none if that is not known.
    fn bounds(&self, face: u32, component: usize) -> Option<FaceBounds> {
        /// Squares of 4 texels a side: some 0.7 bytes for each texel.
        const FINEST: u8 = 2;
        let Source::File(file) = &self.source else {
            return None;
        };
        let Lookup::Consistent(lookup) = &file.lookup else {
            return None;
        };
        let channel = file.channel(component)?;
        let bounds = lookup.bounds(&file.reader, face, channel, 1, FINEST);
        bounds
            .inspect_err(|e| {
                self.fault.get_or_init(|| e.clone().into());
            })
            .ok()
    }

    /// Adds all texels to a digest.
    pub fn add_to(&self, digest: &mut Digest) {
        match &self.source {
            Source::Constant(value) => digest.numbers(&value.to_array()),
            Source::File(file) => (0..file.reader.face_count()).for_each(|face| {
                let info = *file.reader.face(face);
                digest.text(&format!("{info:?}"));
                let Ok(texels) = file.reader.texels(face, info.res, false) else {
                    // Whoever looks at them is told.
                    return;
                };
                let mut values = vec![0.0; file.reader.channels()];
                for y in 0..1 << info.res.vlog2 {
                    for x in 0..1 << info.res.ulog2 {
                        values.fill(0.0);
                        if texels.add(x, y, 1.0, 0, &mut values).is_ok() {
                            digest.numbers(&values);
                        }
                    }
                }
            }),
        }
    }
}

impl File {
    /// The file's channel that one of the four is; none if it is 1 everywhere.
    fn channel(&self, component: usize) -> Option<usize> {
        match component {
            3 => self.alpha,
            _ if self.colors == 1 => Some(self.first),
            _ => Some(self.first + component),
        }
    }

    fn eval(&self, face: u32, uv: Vec2, area: &Area) -> relievo_ptex::Result<Vec4> {
        let mut found = [0.0, 0.0, 0.0, 1.0];
        // Alpha behind the colours costs no lookup of its own.
        let (together, apart) = match self.alpha {
            Some(channel) if channel == self.first + self.colors => (self.colors + 1, None),
            alpha => (self.colors, alpha),
        };
        self.channels((face, uv, area), self.first, &mut found[..together])?;
        if let Some(channel) = apart {
            self.channels((face, uv, area), channel, &mut found[3..])?;
        }
        let [r, g, b, alpha] = found;
        let mut color = if self.colors == 1 { [r; 3] } else { [r, g, b] };
        if self.srgb {
            color = color.map(linear_from_srgb);
        }
        let [r, g, b] = color;
        Ok(Vec4::new(r, g, b, alpha))
    }

    fn channels(
        &self,
        (face, uv, area): (u32, Vec2, &Area),
        first: usize,
        out: &mut [f32],
    ) -> relievo_ptex::Result<()> {
        match &self.lookup {
            Lookup::Consistent(lookup) => lookup.eval(&self.reader, face, uv.x, uv.y, first, out),
            Lookup::Kernel(filter) => {
                let Area([a, b]) = area;
                let area = [a.x, a.y, b.x, b.y];
                filter.eval(&self.reader, face, uv.x, uv.y, area, first, false, out)
            }
        }
    }
}

/// A texture that moves a surface: one of its channels, looked up so that no face tears from another.
pub struct PtexHeights {
    texture: Arc<PtexTexture>,
    component: usize,
    /// By face, when first asked for.
    bounds: Vec<OnceLock<Option<FaceBounds>>>,
}

impl PtexHeights {
    /// One of the four channels of a texture that was opened with [`PtexFilter::Consistent`] and [`ColorSpace::Raw`].
    pub fn new(texture: Arc<PtexTexture>, component: usize) -> Self {
        let faces = texture.reader().map_or(0, Reader::face_count);
        Self {
            texture,
            component,
            bounds: (0..faces).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The height at a point of a face.
    pub fn eval(&self, face: u32, uv: Vec2) -> f32 {
        self.texture.eval(face, uv, &Area::POINT)[self.component]
    }

    /// The least and the greatest height in a rectangle of a face; none if no bounds are known.
    pub fn range(&self, face: u32, u: [f32; 2], v: [f32; 2]) -> Option<[f32; 2]> {
        let slot = self.bounds.get(face as usize)?;
        let bounds = slot
            .get_or_init(|| self.texture.bounds(face, self.component))
            .as_ref()?;
        Some(bounds.range(u, v, 0))
    }

    /// Bytes of bounds.
    pub fn memory(&self) -> usize {
        let known = self.bounds.iter().filter_map(|b| b.get()?.as_ref());
        size_of_val(self.bounds.as_slice()) + known.map(FaceBounds::memory).sum::<usize>()
    }
}
