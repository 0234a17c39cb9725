//! `relievo bake`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relievo::atlas::{AtlasOptions, atlas};
use relievo::bake::{self, Baked, Cage, Dense, Flat, Layout, Options, Report, Run, Sizes, What};
use relievo::image::{check_destination, write_whole};
use relievo::mesh::ControlMesh;
use relievo::scene::obj;
use relievo::surface::Space;
use relievo::trace::{Device, DeviceOptions};
use relievo::{Error, Result};
use relievo_ptex::{DataType, ErrorKind, MAX_LOG2, Writer};

use super::eval::load_cage;
use super::keep_inputs;
use super::machine::{Machine, interrupt};
use super::scheme::{BoundaryName, SchemeName};
use super::subdivide::obj_text;
use super::words::{above_zero, log2};

/// Bake a dense mesh into displacement over a cage's limit surface.
///
/// From the middle of each texel the dense mesh is looked for along the limit normal, in front and behind; the nearest
/// point that faces as the cage does gives the displacement (Lee, Moreton and Hoppe 2000), in the meshes' own units.
/// Texels that meet nothing are filled from around. What is printed tells how many these are, and how far a render of
/// the result will be from the dense mesh.
#[derive(Debug, Args)]
pub(crate) struct Bake {
    /// Dense mesh: an OBJ file of polygons.
    dense: PathBuf,
    /// Cage: an OBJ file, with OpenSubdiv's tags.
    cage: PathBuf,
    /// What to write: a Ptex file (.ptx) of the cage's faces, or an image (.exr) by its texture coordinates.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The cage's scheme [default: the first word of its name, else catmark].
    #[arg(long, value_enum)]
    scheme: Option<SchemeName>,
    /// What happens at the cage's border [default: as its tags say].
    #[arg(long, value_enum)]
    boundary: Option<BoundaryName>,
    /// How far from the limit surface to look [default: a tenth of the diagonal of the dense mesh's box].
    #[arg(long, value_name = "DISTANCE", value_parser = distance)]
    reach: Option<f64>,
    /// Take what is nearest whichever way it faces: for dense meshes whose faces are not turned alike.
    #[arg(long)]
    two_sided: bool,
    /// Texels for each edge of the dense mesh along u and v, at least; each face gets a power of two [default: 1].
    #[arg(long, value_name = "N", value_parser = above_zero, conflicts_with = "texels")]
    rate: Option<f64>,
    /// Texels along u and v of all faces, or pixels along the sides of an image: a power of two.
    #[arg(long, value_name = "N", value_parser = power_of_two)]
    texels: Option<i8>,
    /// Rings of pixels of an image that are filled beyond the borders of islands.
    #[arg(long, value_name = "N", default_value_t = 16)]
    dilation: u32,
    /// Bake vectors, in the space of the meshes or in that of the tangents of texture coordinates and the normal: to where
    /// both meshes have the same texture coordinates. Keeps overhangs.
    #[arg(long, value_enum, value_name = "SPACE", conflicts_with = "two_sided")]
    vector: Option<SpaceName>,
    /// First move the cage's points so that its limit surface fits the dense mesh, and write that cage: an OBJ file. What
    /// is baked is for that one.
    #[arg(long, value_name = "FILE")]
    fit: Option<PathBuf>,
    /// Give the cage texture coordinates for the image by an automatic atlas, in place of those that it has, and write that
    /// cage: an OBJ file.
    #[arg(long, value_name = "FILE", conflicts_with = "vector")]
    atlas: Option<PathBuf>,
    /// Type of the texels.
    #[arg(long = "type", value_enum, value_name = "TYPE", default_value_t = TypeName::F32)]
    data_type: TypeName,
    /// Print one JSON object instead of lines.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    machine: Machine,
}

/// The space of vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SpaceName {
    /// That of the meshes' points.
    Object,
    /// x along the direction in which s grows, y across it to where t grows, z along the limit normal.
    Tangent,
}

/// In which type texels are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TypeName {
    /// Half floats.
    #[value(alias = "half")]
    F16,
    /// Single floats.
    #[value(alias = "float")]
    F32,
}

impl From<TypeName> for DataType {
    fn from(name: TypeName) -> Self {
        match name {
            TypeName::F16 => Self::F16,
            TypeName::F32 => Self::F32,
        }
    }
}

/// Rays reach no farther.
fn distance(word: &str) -> Result<f64, String> {
    const MOST: f64 = 1e18;
    let number = above_zero(word).ok().filter(|n| *n <= MOST);
    number.ok_or_else(|| format!("a number above 0, up to {MOST:e}"))
}

/// The logarithm.
fn power_of_two(word: &str) -> Result<i8, String> {
    log2(word).ok_or_else(|| format!("a power of two, up to {}", 1 << MAX_LOG2))
}

impl Bake {
    /// Whether all that is said shall be JSON.
    pub(crate) fn reports_json(&self) -> bool {
        self.machine.reports_json()
    }

    pub(crate) fn run(self, quiet: bool) -> Result<()> {
        let is_image = ends_in(&self.output, "exr");
        if !is_image && !ends_in(&self.output, "ptx") {
            return Err(Error::usage(
                format!("{}: such a file cannot be written", self.output.display()),
                "give the output a name that ends in .ptx or .exr",
            ));
        }
        let outputs = self.cages().chain([&self.output]);
        keep_inputs(&[&self.dense, &self.cage], outputs)?;
        check_destination(&self.output)?;
        if self.atlas.is_some() && !is_image {
            return Err(Error::usage(
                "--atlas lays out an image, and a Ptex file needs none",
                "leave it out, or bake to .exr",
            ));
        }
        for path in self.cages() {
            if !ends_in(path, "obj") {
                return Err(Error::usage(
                    format!("{}: such a cage cannot be written", path.display()),
                    "give --fit and --atlas names that end in .obj",
                ));
            }
            check_destination(path)?;
        }
        let interrupt = interrupt()?;
        let progress = self.machine.progress(quiet);
        let run = Run {
            progress: &progress,
            interrupt: &interrupt,
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.machine.threads())
            .build()
            .map_err(|e| Error::failed(format!("cannot start threads: {e}")))?;
        let device = Device::new(&DeviceOptions {
            threads: pool.current_num_threads(),
            memory_budget: self.machine.memory_budget.into(),
            ..DeviceOptions::default()
        })?;
        let result = pool.install(|| self.bake(&device, run));
        progress.finish();
        let report = result?;
        if self.json {
            let text = serde_json::to_string(&report)
                .map_err(|e| Error::failed(format!("the report cannot be written as JSON: {e}")))?;
            return super::print(format!("{text}\n").as_bytes());
        }
        super::print(text(&report).as_bytes())
    }

    fn bake(&self, device: &Device, run: Run<'_>) -> Result<Report> {
        run.progress.stage("load", 3);
        let mut mesh = self.load_cage()?;
        let mut cage = Cage::new(&mesh, &self.cage)?;
        let layout = match ends_in(&self.output, "exr") || self.vector.is_some() {
            true => Some(Layout::new(&mesh, &self.cage)?),
            false => None,
        };
        run.progress.by(1);
        let polygons = load_cage(&self.dense)?;
        run.progress.by(1);
        let go_on = |_| run.goes_on();
        let dense = Dense::new(&polygons, &self.dense, device, &go_on)?;
        let flat = match self.vector {
            Some(_) => Some(Flat::new(&polygons, &self.dense, device)?),
            None => None,
        };
        let options = Options {
            reach: self.reach,
            two_sided: self.two_sided,
            sizes: match self.texels {
                Some(log2) => Sizes::Log2(log2),
                None => Sizes::PerEdge(self.rate.unwrap_or(1.0)),
            },
            data_type: self.data_type.into(),
            dilation: self.dilation,
        };
        let mut fitted = None;
        if self.fit.is_some() {
            let (moved, fit) = bake::fit(&mesh, &cage, &dense, &options, run)?;
            mesh = moved;
            cage = Cage::new(&mesh, &self.cage)?;
            fitted = Some(fit);
        }
        let what = match (&layout, &flat, self.vector) {
            (Some(layout), Some(flat), Some(space)) => What::Vectors {
                layout,
                flat,
                space: match space {
                    SpaceName::Object => Space::Object,
                    SpaceName::Tangent => Space::Tangent,
                },
            },
            _ => What::Heights,
        };
        let image = layout.as_ref().filter(|_| ends_in(&self.output, "exr"));
        let report = self.write_baked(&cage, image, &dense, what, &options, run)?;
        for path in self.cages() {
            write_cage(path, &mesh)?;
        }
        Ok(Report {
            fit: fitted,
            ..report
        })
    }

    fn write_baked(
        &self,
        cage: &Cage,
        layout: Option<&Layout>,
        dense: &Dense,
        what: What<'_>,
        options: &Options,
        run: Run<'_>,
    ) -> Result<Report> {
        if let Some(layout) = layout {
            let output = &self.output;
            let baked = bake::to_exr(cage, layout, dense, what, options, output, run);
            let (report, warnings) = baked?;
            run.progress.warn(&warnings);
            return Ok(report);
        }
        let Baked {
            writer,
            report,
            warnings,
        } = bake::to_ptex(cage, dense, what, options, run)?;
        run.progress.warn(&warnings);
        self.write(&writer)?;
        Ok(report)
    }

    /// Where the cage that is baked for is to be written.
    fn cages(&self) -> impl Iterator<Item = &PathBuf> {
        self.fit.iter().chain(&self.atlas)
    }

    fn load_cage(&self) -> Result<ControlMesh> {
        let mut mesh = load_cage(&self.cage)?;
        if let Some(scheme) = self.scheme {
            scheme.apply(&mut mesh);
        }
        if let Some(boundary) = self.boundary {
            boundary.apply(&mut mesh);
        }
        if self.atlas.is_some() {
            let usual = AtlasOptions::default();
            let options = AtlasOptions {
                resolution: self.texels.map_or(usual.resolution, |log2| 1 << log2),
                ..usual
            };
            let atlas = atlas(&mesh, &options).map_err(|fault| fault.in_file(&self.cage))?;
            atlas.put_on(&mut mesh);
        }
        Ok(mesh)
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

/// Writes a cage that was changed.
fn write_cage(path: &Path, mesh: &ControlMesh) -> Result<()> {
    let text = obj_text(mesh);
    write_whole(path, |temporary| {
        std::fs::write(temporary, &text)
            .map_err(|e| Error::failed(format!("{}: {e}", path.display())))
    })?;
    let read = obj::parse(text.as_bytes(), path)?;
    let first = read.shapes.first().and_then(|shape| shape.geometry.mesh());
    if first.is_some_and(|read| read.scheme != mesh.scheme || read.left_handed != mesh.left_handed)
    {
        tracing::warn!(
            "{}: an OBJ file's scheme and handedness are told by its name, and this one tells others than the cage's: \
             name it as the cage is named, or give --scheme where it is read",
            path.display()
        );
    }
    Ok(())
}

fn ends_in(path: &Path, ending: &str) -> bool {
    let own = path.extension().unwrap_or_default();
    own.eq_ignore_ascii_case(ending)
}

fn text(report: &Report) -> String {
    let Report {
        texels,
        missed,
        faced_away,
        residual,
        ..
    } = report;
    let fit = report.fit.map_or_else(String::new, |fit| {
        format!(
            "{:>12.6} rms, {:.6} at most: height before the cage was fitted\n\
             {:>12.6} rms, {:.6} at most: after {} rounds\n",
            fit.rms_before, fit.largest_before, fit.rms_after, fit.largest_after, fit.rounds
        )
    });
    fit + &format!(
        "{:>12} faces of the cage\n{:>12} triangles of the dense mesh, looked for within {:.6}\n\
         {texels:>12} texels, {missed} of them missed ({faced_away} met only what faces away)\n\
         {:>12.6} to {:.6}: displacement\n{:>12.6} at most from texel to texel\n\
         {:>12.6} rms, {:.6} at most: distance to the dense mesh between texels ({} places, {} missed)\n",
        report.cage_faces,
        report.dense_triangles,
        report.reach,
        report.least,
        report.greatest,
        report.step,
        residual.rms,
        residual.largest,
        residual.places,
        residual.missed,
    )
}
