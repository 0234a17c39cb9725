//! The film as files: EXR with planes and metadata, PNG for looking.

use std::path::{Path, PathBuf};

use super::RenderOptions;
use crate::error::{Error, Result};
use crate::film::Film;
use crate::image::{
    Attribute, Channel, ChannelFormat, Compression, Part, Picture, check_destination, write_exr,
    write_png,
};
use crate::math::Vec4;
use crate::memory::{SMALL_PIECES, is_there, none_left};
use crate::shade::camera::Camera;
use crate::stats::Stats;

/// What is written, and where.
#[derive(Debug, Clone, Default)]
pub struct Output {
    /// The picture: `.exr`, or `.png` for looking only.
    pub picture: PathBuf,
    /// Whether the file name of the scene's render product goes before [`Output::picture`].
    pub from_scene: bool,
    /// A PNG beside it.
    pub png: Option<PathBuf>,
    /// Statistics as JSON.
    pub stats: Option<PathBuf>,
    /// Planes beside the beauty.
    pub aovs: Vec<Aov>,
    /// Of beauty, albedo and normal; depth and position are always float, ids always integers.
    pub pixel_type: PixelType,
    /// Tile size; scanlines if none.
    pub tile: Option<u32>,
    /// One EXR part for each plane instead of one with all channels.
    pub multi_part: bool,
}

/// The type of a colour channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelType {
    /// 16 bits.
    #[default]
    Half,
    /// 32 bits.
    Float,
}

/// A plane of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Aov {
    /// Radiance and coverage: `R G B A`.
    Beauty,
    /// Reflectance of the first surface: `albedo.R G B`.
    Albedo,
    /// World-space shading normal of the first surface: `N.X Y Z`.
    Normal,
    /// Distance along the camera's axis: `Z`; infinity where there is nothing.
    Depth,
    /// World-space position of the first surface: `P.X Y Z`.
    Position,
    /// Face of the control mesh: `faceId`; 4294967295 where there is nothing.
    FaceId,
    /// Number of the placement from 1: `objectId`; 0 where there is nothing.
    ObjectId,
}

/// All planes with their names on the command line.
pub const AOVS: [(&str, Aov); 7] = [
    ("beauty", Aov::Beauty),
    ("albedo", Aov::Albedo),
    ("normal", Aov::Normal),
    ("depth", Aov::Depth),
    ("position", Aov::Position),
    ("face-id", Aov::FaceId),
    ("object-id", Aov::ObjectId),
];

/// What the picture's metadata tell.
pub(super) struct Record<'a> {
    pub(super) stats: &'a Stats,
    pub(super) camera: &'a Camera,
    /// Of the whole picture, of which the film may be a part.
    pub(super) resolution: [u32; 2],
    pub(super) options: &'a RenderOptions,
}

impl Output {
    /// Whether it can be written, asked before hours are spent.
    ///
    /// # Errors
    /// [`Error::Usage`] for a file name that ends in neither `.exr` nor `.png`, [`Error::Failed`] for a folder
    /// that does not exist.
    pub(super) fn check(&self) -> Result<()> {
        match ending(&self.picture).as_str() {
            "exr" | "png" => {}
            other => {
                return Err(Error::usage(
                    format!(
                        "{}: a picture that ends in \"{other}\" is not known",
                        self.picture.display()
                    ),
                    "relievo writes .exr, and .png for looking",
                ));
            }
        }
        for path in [Some(&self.picture), self.png.as_ref(), self.stats.as_ref()]
            .into_iter()
            .flatten()
        {
            check_destination(path)?;
        }
        Ok(())
    }

    /// Bytes that writing it takes, at most: all planes as floats, twice, as libraries convert them.
    pub(super) fn bytes(&self, [width, height]: [u32; 2]) -> usize {
        let of_png = 24;
        let planes = std::iter::once(&Aov::Beauty).chain(&self.aovs);
        let of_exr: usize = planes
            .map(|plane| 8 * channels(*plane, ChannelFormat::Float).len())
            .sum();
        width as usize * height as usize * of_exr.max(of_png)
    }

    /// Writes it.
    ///
    /// # Errors
    /// If it cannot be written: [`Error::Memory`] if there is little memory left then, for libraries do not tell.
    pub(super) fn write(&self, film: &Film, record: &Record<'_>) -> Result<()> {
        /// What they may ask for at once: their threads have stacks and heaps of their own.
        const AT_ONCE: usize = 2 * SMALL_PIECES;
        self.pictures(film, record).map_err(|error| match error {
            Error::Failed { .. } if !is_there(AT_ONCE) => none_left(error),
            other => other,
        })
    }

    fn pictures(&self, film: &Film, record: &Record<'_>) -> Result<()> {
        if ending(&self.picture) == "exr" {
            write_exr(&self.picture, &self.exr(film, record))?;
        } else {
            png(&self.picture, film)?;
        }
        if let Some(path) = &self.png {
            png(path, film)?;
        }
        Ok(())
    }

    fn exr(&self, film: &Film, record: &Record<'_>) -> Picture {
        let mut planes = vec![Aov::Beauty];
        planes.extend(self.aovs.iter().filter(|a| **a != Aov::Beauty));
        let parts = if self.multi_part {
            planes
                .iter()
                .map(|plane| self.part(std::slice::from_ref(plane), film))
                .collect()
        } else {
            vec![self.part(&planes, film)]
        };
        Picture {
            width: film.size[0],
            height: film.size[1],
            display_window: (
                record.resolution[0],
                record.resolution[1],
                film.origin[0] as i32,
                film.origin[1] as i32,
            ),
            parts,
            metadata: metadata(record),
            tile: self.tile,
            compression: Compression::Zip,
        }
    }

    fn part(&self, planes: &[Aov], film: &Film) -> Part {
        let color = match self.pixel_type {
            PixelType::Half => ChannelFormat::Half,
            PixelType::Float => ChannelFormat::Float,
        };
        let channels: Vec<Channel> = planes
            .iter()
            .flat_map(|plane| channels(*plane, color))
            .collect();
        let width = channels.len();
        let mut pixels = vec![0.0; width * film.size[0] as usize * film.size[1] as usize];
        film.for_each(|i, pixel| {
            let mut out = pixels[i * width..][..width].iter_mut();
            let mut put = |values: &[f32]| {
                for value in values {
                    if let Some(slot) = out.next() {
                        *slot = *value;
                    }
                }
            };
            let first = pixel.first();
            for plane in planes {
                match plane {
                    Aov::Beauty => {
                        put(&pixel.radiance().to_array());
                        put(&[pixel.alpha()]);
                    }
                    Aov::Albedo => put(&pixel.albedo().to_array()),
                    Aov::Normal => put(&pixel.normal().to_array()),
                    Aov::Depth => put(&[pixel.depth().unwrap_or(f32::INFINITY)]),
                    Aov::Position => put(&first.map_or([0.0; 3], |f| f.position.to_array())),
                    Aov::FaceId => put(&[f32::from_bits(first.map_or(u32::MAX, |f| f.face))]),
                    Aov::ObjectId => put(&[f32::from_bits(first.map_or(0, |f| f.object))]),
                }
            }
        });
        let name = match planes {
            [one] => AOVS
                .iter()
                .find(|(_, a)| a == one)
                .map_or("", |(name, _)| name),
            _ => "rgba",
        };
        Part {
            name: name.to_owned(),
            channels,
            pixels,
        }
    }
}

fn channels(plane: Aov, color: ChannelFormat) -> Vec<Channel> {
    let (names, format): (&[&str], _) = match plane {
        Aov::Beauty => (&["R", "G", "B", "A"], color),
        Aov::Albedo => (&["albedo.R", "albedo.G", "albedo.B"], color),
        Aov::Normal => (&["N.X", "N.Y", "N.Z"], color),
        Aov::Depth => (&["Z"], ChannelFormat::Float),
        Aov::Position => (&["P.X", "P.Y", "P.Z"], ChannelFormat::Float),
        Aov::FaceId => (&["faceId"], ChannelFormat::Uint),
        Aov::ObjectId => (&["objectId"], ChannelFormat::Uint),
    };
    names
        .iter()
        .map(|&name| Channel {
            name: name.to_owned(),
            format,
        })
        .collect()
}

fn metadata(record: &Record<'_>) -> Vec<(String, Attribute)> {
    let Record {
        stats,
        camera,
        options,
        ..
    } = record;
    let versions = &stats.versions;
    let text = |s: &str| Attribute::Text(s.to_owned());
    vec![
        (
            "Software".into(),
            Attribute::Text(format!(
                "relievo {} (Embree {}, OpenImageIO {})",
                versions.relievo, versions.embree, versions.openimageio
            )),
        ),
        (
            "worldtocamera".into(),
            Attribute::Matrix(camera.world_to_camera()),
        ),
        (
            "worldtoNDC".into(),
            Attribute::Matrix(camera.world_to_ndc()),
        ),
        ("relievo:scene".into(), text(&stats.scene)),
        ("relievo:sceneHash".into(), text(&stats.scene_hash)),
        (
            "relievo:samplesPerPixel".into(),
            Attribute::Int(stats.samples_per_pixel as i32),
        ),
        ("relievo:seed".into(), Attribute::Int(options.seed as i32)),
        (
            "relievo:maxBounces".into(),
            Attribute::Int(options.path.max_bounces as i32),
        ),
        (
            "relievo:renderTimeSeconds".into(),
            Attribute::Float(stats.seconds("render") as f32),
        ),
        ("oiio:ColorSpace".into(), text("lin_rec709")),
    ]
}

fn png(path: &Path, film: &Film) -> Result<()> {
    let mut rgba = vec![Vec4::ZERO; film.size[0] as usize * film.size[1] as usize];
    film.for_each(|i, pixel| rgba[i] = pixel.radiance().extend(1.0));
    write_png(path, film.size[0], film.size[1], &rgba)
}

fn ending(path: &Path) -> String {
    path.extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
        .to_ascii_lowercase()
}
