//! `relievo ptex convert`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use relievo::convert::{
    FromImage, Resized, Resolution, Sizes, atlas, picture_of_face, ptex_from_image,
};
use relievo::error::Fault;
use relievo::image::{ColorSpace, ImageSource, Texture, Wrap, check_destination};
use relievo::mesh::ControlMesh;
use relievo::{Error, Result};
use relievo_ptex::{Cache, DataType, ErrorKind, MAX_LOG2, Reader, Writer};

use crate::cli::cage::{Wanted, load_mesh};
use crate::cli::words::{self, above_zero};

/// Make Ptex files from images, images from Ptex files, and Ptex files in other sizes and types.
///
/// An image becomes a Ptex file by way of a cage with texture coordinates (--mesh). A Ptex file becomes a picture of one
/// face (--face) or of all, the largest first, or another Ptex file. Row 0 of a face's texels is on top in pictures.
///
/// Bytes with three colours and more are encoded by the sRGB curve, in images and in Ptex files; all else is linear,
/// OpenEXR too. Numbers are decoded and encoded so that they mean the same, unless --raw is given. Alpha is not
/// multiplied in.
#[derive(Debug, Args)]
pub(crate) struct Convert {
    /// Ptex file (.ptx, .ptex), or an image; `<UDIM>` in its name stands for a tile's number.
    input: PathBuf,
    /// What to write: .ptx, .exr or .png.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Type of the texels [default: the input's; floats for images of more than 8 bits that have no halves].
    #[arg(long = "type", value_enum, value_name = "TYPE")]
    data_type: Option<TypeName>,
    /// Leave numbers as they are: neither decode nor encode bytes of colours.
    #[arg(long)]
    raw: bool,

    /// Cage that has the image's texture coordinates: a subdivision surface in .usd, .usda, .usdc, .usdz or .obj.
    #[arg(long, value_name = "FILE", help_heading = "Images to Ptex")]
    mesh: Option<PathBuf>,
    /// The cage in a file of several [default: the only one].
    #[arg(
        long,
        value_name = "PATH",
        requires = "mesh",
        help_heading = "Images to Ptex"
    )]
    prim: Option<String>,
    /// The cage's texture coordinates [default: st].
    #[arg(
        long,
        value_name = "NAME",
        requires = "mesh",
        help_heading = "Images to Ptex"
    )]
    primvar: Option<String>,
    /// Texels along u and v of each face, as a power of two: 5 for 32 [default: what a face covers of the image].
    #[arg(long, value_name = "LOG2", value_parser = log2(), requires = "mesh", help_heading = "Images to Ptex")]
    res: Option<i8>,
    /// Texels for a unit of length on the surface, at least.
    #[arg(
        long,
        value_name = "N",
        requires = "mesh",
        conflicts_with = "res",
        value_parser = above_zero,
        help_heading = "Images to Ptex"
    )]
    texels_per_unit: Option<f64>,
    /// What lies beyond the image's border [default: repeat].
    #[arg(long, value_enum, requires = "mesh", help_heading = "Images to Ptex")]
    wrap: Option<WrapName>,

    /// Picture of this face alone.
    #[arg(long, value_name = "N", help_heading = "From Ptex files")]
    face: Option<u32>,
    /// Change the number of texels along u and v: 1/2, 1/4, 2, 4 and so on; one is left at least.
    #[arg(long, value_parser = scale, conflicts_with_all = ["mesh", "max_res"], help_heading = "From Ptex files")]
    scale: Option<i8>,
    /// Let no face have more texels along u or v than this power of two.
    #[arg(long, value_name = "LOG2", value_parser = log2(), conflicts_with = "mesh", help_heading = "From Ptex files")]
    max_res: Option<i8>,
}

/// In which type texels are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TypeName {
    /// Bytes.
    U8,
    /// 16-bit integers.
    U16,
    /// Half floats.
    F16,
    /// Single floats.
    F32,
}

/// What lies beyond an image's border.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum WrapName {
    /// Black, and transparent.
    Black,
    /// The border's texels.
    Clamp,
    /// The image again.
    Repeat,
    /// The image mirrored.
    Mirror,
}

/// What is written, by the ending of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Ptex,
    OpenExr,
    Png,
}

fn log2() -> clap::builder::RangedI64ValueParser<i8> {
    clap::value_parser!(i8).range(0..=i64::from(MAX_LOG2))
}

/// The logarithm of a factor.
fn scale(word: &str) -> Result<i8, String> {
    let found = match word.strip_prefix("1/") {
        Some(part) => words::log2(part).map(|log2| -log2),
        None => words::log2(word),
    };
    found.ok_or_else(|| {
        format!(
            "a power of two or one divided by it, up to {}",
            1 << MAX_LOG2
        )
    })
}

impl Convert {
    pub(crate) fn run(self) -> Result<()> {
        let kind = kind_of(&self.output).ok_or_else(|| {
            Error::usage(
                format!("{}: such a file cannot be written", self.output.display()),
                "give the output a name that ends in .ptx, .exr or .png",
            )
        })?;
        match (&self.mesh, kind_of(&self.input) == Some(Kind::Ptex)) {
            (None, true) => self.of_ptex(kind),
            (Some(mesh), false) => self.image_to_ptex(mesh, kind),
            (None, false) => Err(Error::usage(
                format!(
                    "{} is not named like a Ptex file, and no cage is given to make one of an image",
                    self.input.display()
                ),
                "give a Ptex file (.ptx, .ptex), or the cage that has the image's texture coordinates by --mesh",
            )),
            (Some(_), true) => Err(Error::usage(
                format!("{}: a Ptex file needs no --mesh", self.input.display()),
                "leave --mesh out, or give an image",
            )),
        }
    }

    fn image_to_ptex(&self, mesh: &Path, kind: Kind) -> Result<()> {
        if kind != Kind::Ptex {
            return Err(Error::usage(
                format!("{}: --mesh makes Ptex files", self.output.display()),
                "give the output a name that ends in .ptx",
            ));
        }
        if self.face.is_some() {
            return Err(Error::usage(
                "--face is for pictures of Ptex files",
                "leave it out",
            ));
        }
        check_destination(&self.output)?;
        let options = FromImage {
            primvar: self.primvar.clone().unwrap_or_else(|| "st".to_owned()),
            sizes: match (self.res, self.texels_per_unit) {
                (Some(log2), _) => Sizes::Log2(log2),
                (None, Some(density)) => Sizes::PerUnit(density),
                (None, None) => Sizes::OfImage,
            },
            data_type: self.data_type.map(DataType::from),
            raw: self.raw,
        };
        let (cage, prim) = load_cage(mesh, self.prim.as_deref(), &options.primvar)?;
        let wrap = self.wrap.map_or(Wrap::Repeat, Wrap::from);
        let space = match self.raw {
            true => ColorSpace::Raw,
            false => ColorSpace::Auto,
        };
        let image = Texture::load(&ImageSource::File(self.input.clone()), [wrap; 2], space)
            .map_err(|fault| {
                fault.advise(
                    "check the path, and that the file is a whole image that OpenImageIO reads",
                )
            })?;
        let place = |fault: Fault| fault.at_prim(prim.as_str()).in_file(mesh);
        let (writer, warnings) = ptex_from_image(&image, &cage, &options).map_err(place)?;
        for warning in warnings.iter() {
            tracing::warn!(
                "{}: {prim}: {} ({} faces)",
                mesh.display(),
                warning.message,
                warning.count
            );
        }
        self.write(&writer)
    }

    fn of_ptex(&self, kind: Kind) -> Result<()> {
        if kind == Kind::Ptex && self.face.is_some() {
            return Err(Error::usage(
                "--face is for pictures, and a Ptex file has all faces",
                "leave it out, or give the output a name that ends in .exr or .png",
            ));
        }
        if kind != Kind::Ptex && self.data_type.is_some() {
            return Err(Error::usage(
                "--type is for Ptex files",
                "leave it out, or give the output a name that ends in .ptx",
            ));
        }
        check_destination(&self.output)?;
        let reader = Reader::open(&self.input, &Cache::default())?;
        let resolution = match (self.scale, self.max_res) {
            (Some(more), _) => Resolution::Scale(more),
            (None, Some(most)) => Resolution::Most(most),
            (None, None) => Resolution::Same,
        };
        let faces = Resized::new(&reader, resolution);
        let place = |fault: Fault| fault.in_file(&self.input);
        if kind == Kind::Ptex {
            let data_type = self.data_type.map(DataType::from);
            return self.write(&faces.ptex(data_type, self.raw).map_err(place)?);
        }
        let raster = match self.face {
            Some(face) if face >= reader.face_count() => {
                return Err(Error::usage(
                    format!(
                        "--face {face}: {} has {} faces",
                        self.input.display(),
                        reader.face_count()
                    ),
                    "count faces from 0",
                ));
            }
            Some(face) => picture_of_face(&faces, face),
            None => atlas(&faces),
        };
        let raster = raster.map_err(place)?;
        let written = match kind {
            Kind::Png => raster.write_png(&self.output, self.raw),
            _ => raster.write_exr(&self.output, self.raw),
        };
        written.map_err(|error| match error {
            Error::Input(fault) => place(*fault).into(),
            error => error,
        })
    }

    fn write(&self, writer: &Writer) -> Result<()> {
        writer.write(&self.output).map_err(|e| match e.kind() {
            ErrorKind::Io => Error::Failed {
                message: format!("cannot write {}: {}", self.output.display(), e.message()),
                help: Some(e.help().to_owned()),
            },
            _ => e.into(),
        })
    }
}

fn kind_of(path: &Path) -> Option<Kind> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    match ending.as_str() {
        "ptx" | "ptex" => Some(Kind::Ptex),
        "exr" => Some(Kind::OpenExr),
        "png" => Some(Kind::Png),
        _ => None,
    }
}

/// The subdivision surface of a file, or the one with that path; and its path.
fn load_cage(file: &Path, prim: Option<&str>, primvar: &str) -> Result<(Arc<ControlMesh>, String)> {
    let shape = load_mesh(file, prim, Wanted::Subdivision)?;
    if let Some(unusable) = (shape.unusable_primvars.iter()).find(|u| u.name == primvar) {
        let fault = unusable.fault.clone().at_prim(shape.path.as_str());
        return Err(fault.in_file(file).into());
    }
    let mesh = shape.geometry.mesh().expect("it is a mesh");
    Ok((mesh.clone(), shape.path))
}

impl From<TypeName> for DataType {
    fn from(name: TypeName) -> Self {
        match name {
            TypeName::U8 => Self::U8,
            TypeName::U16 => Self::U16,
            TypeName::F16 => Self::F16,
            TypeName::F32 => Self::F32,
        }
    }
}

impl From<WrapName> for Wrap {
    fn from(name: WrapName) -> Self {
        match name {
            WrapName::Black => Self::Black,
            WrapName::Clamp => Self::Clamp,
            WrapName::Repeat => Self::Repeat,
            WrapName::Mirror => Self::Mirror,
        }
    }
}
