//! `relievo render`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Args, ValueEnum};
use relievo::integrate::PathOptions;
use relievo::math::Vec4;
use relievo::render::{
    AOVS, Aov, Output, PixelType, Progress, ProgressStyle, RenderOptions, render,
};
use relievo::scene::{LoadOptions, MissingLayers, Purpose};
use relievo::shade::filter::{Filter, FilterKind};
use relievo::surface::{Dicing, MOST_SEGMENTS};
use relievo::world::BuildOptions;
use relievo::{Error, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use super::method::MethodArgument;

/// Render a scene to a picture.
///
/// A bare OBJ, or a USD file without camera or light, is framed whole and lit by a white dome.
#[derive(Debug, Args)]
pub(crate) struct Render {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    /// Picture: .exr, or .png for looking only [default: the scene's product, else its name with .exr]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a PNG for looking as well.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,

    /// Camera, by path or name [default: the render settings' one, else the first]
    #[arg(long, value_name = "PRIM", help_heading = "View")]
    camera: Option<String>,
    /// Pixels [default: the render settings', else 960 540]
    #[arg(long, num_args = 2, value_names = ["W", "H"], help_heading = "View")]
    res: Option<Vec<u32>>,
    /// Multiply the resolution.
    #[arg(
        long,
        default_value_t = 1.0,
        allow_negative_numbers = true,
        help_heading = "View"
    )]
    scale: f32,
    /// Frame to render [default: the file's start frame]
    #[arg(long, help_heading = "View", allow_negative_numbers = true)]
    frame: Option<f64>,
    /// Purposes to show beside the default one, with commas between [default: the render settings', else
    /// render]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "View")]
    purpose: Option<Vec<PurposeArgument>>,
    /// Render settings prim to use [default: the one that the file names]
    #[arg(long, value_name = "PRIM", help_heading = "View")]
    settings: Option<String>,

    /// Samples in each pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = "Quality")]
    spp: u32,
    /// The most scatterings of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = "Quality")]
    max_bounces: u32,
    /// Pixel filter.
    #[arg(long, value_enum, default_value_t = FilterArgument::BlackmanHarris, help_heading = "Quality")]
    filter: FilterArgument,
    /// How surfaces are traced.
    #[arg(long, value_enum, default_value_t = MethodArgument::default(), help_heading = "Quality")]
    method: MethodArgument,
    /// Length of a micro-edge in pixels, on the displaced surface.
    #[arg(
        long,
        default_value_t = 1.0,
        allow_negative_numbers = true,
        help_heading = "Quality"
    )]
    dicing_rate: f32,
    /// The most micro-edges that an edge is cut into, 1 to 4096: what keeps an edge that comes close to the camera from
    /// taking all memory.
    #[arg(
        long,
        default_value_t = 128,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_SEGMENTS)),
        help_heading = "Quality"
    )]
    max_segments: u32,
    /// Chooses the random numbers: another seed, another noise.
    #[arg(long, default_value_t = 0, help_heading = "Quality")]
    seed: u32,
    /// Leave out motion blur.
    #[arg(long, help_heading = "Quality")]
    no_motion_blur: bool,
    /// Leave out depth of field.
    #[arg(long, help_heading = "Quality")]
    no_depth_of_field: bool,

    /// Make everything Lambert with this albedo; displacement stays.
    #[arg(long, value_name = "ALBEDO", num_args = 0..=1, default_missing_value = "0.5", help_heading = "Scene")]
    clay: Option<f32>,
    /// What to do about textures that cannot be read.
    #[arg(long, value_enum, default_value_t = MissingTextures::Error, help_heading = "Scene")]
    missing_textures: MissingTextures,

    /// What to do about layers and prims that the scene refers to and that are not there.
    #[arg(long, value_enum, default_value_t = MissingLayersArgument::Error, help_heading = "Scene")]
    missing_layers: MissingLayersArgument,

    /// Planes beside the beauty, with commas between.
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "Picture")]
    aov: Vec<AovArgument>,
    /// Type of the colour channels.
    #[arg(long, value_enum, default_value_t = TypeArgument::Half, help_heading = "Picture")]
    pixel_type: TypeArgument,
    /// Tiles of this size instead of scanlines.
    #[arg(long, value_name = "SIZE", value_parser = clap::value_parser!(u32).range(16..=4096), help_heading = "Picture")]
    tile: Option<u32>,
    /// One EXR part for each plane.
    #[arg(long, help_heading = "Picture")]
    multi_part: bool,

    /// Threads: 0 all, -1 all but one.
    #[arg(
        short,
        long,
        default_value_t = 0,
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(i32).range(..=MAX_THREADS),
        help_heading = "Machine"
    )]
    threads: i32,
    /// Memory for geometry and film: 800M, 12G.
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    memory_budget: Option<usize>,
    /// Form of the progress reports.
    #[arg(long, value_enum, default_value_t = ProgressArgument::Auto, help_heading = "Machine")]
    progress: ProgressArgument,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PurposeArgument {
    /// No other.
    Default,
    /// For final pictures.
    Render,
    /// Stand-ins.
    Proxy,
    /// Helpers that artists see.
    Guide,
}

impl PurposeArgument {
    fn purpose(self) -> Option<Purpose> {
        match self {
            Self::Default => None,
            Self::Render => Some(Purpose::Render),
            Self::Proxy => Some(Purpose::Proxy),
            Self::Guide => Some(Purpose::Guide),
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FilterArgument {
    /// Each sample counts for its own pixel.
    Box,
    /// Three pixels wide: smooth edges, little ringing.
    BlackmanHarris,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MissingTextures {
    /// Stop.
    Error,
    /// Go on with magenta in their place.
    Magenta,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MissingLayersArgument {
    /// Stop.
    Error,
    /// Go on without them.
    Skip,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TypeArgument {
    Half,
    Float,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ProgressArgument {
    /// A bar on a terminal, plain lines elsewhere.
    Auto,
    Plain,
    /// One JSON object a line.
    Json,
    None,
}

/// A plane by its name.
#[derive(Debug, Clone, Copy)]
struct AovArgument(Aov);

impl ValueEnum for AovArgument {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [AovArgument; AOVS.len()] = {
            let mut all = [AovArgument(Aov::Beauty); AOVS.len()];
            let mut i = 0;
            while i < AOVS.len() {
                all[i] = AovArgument(AOVS[i].1);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        AOVS.iter()
            .find(|(_, aov)| *aov == self.0)
            .map(|(name, _)| clap::builder::PossibleValue::new(*name))
    }
}

/// More than any machine has: so many can still be started, and the work is done.
const MAX_THREADS: i64 = 1024;

fn bytes(text: &str) -> std::result::Result<usize, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit: u64 = match text[digits.len()..]
        .to_ascii_uppercase()
        .trim_end_matches('B')
    {
        "" => 1,
        "K" => 1 << 10,
        "M" => 1 << 20,
        "G" => 1 << 30,
        other => return Err(format!("unit {other} is not K, M or G")),
    };
    let number: f64 = digits.parse().map_err(|e| format!("{digits}: {e}"))?;
    if !(number.is_finite() && number > 0.0) {
        return Err(format!("{number} is no amount of memory"));
    }
    Ok((number * unit as f64) as usize)
}

impl Render {
    /// Whether all that is said shall be JSON.
    pub(crate) fn reports_json(&self) -> bool {
        matches!(self.progress, ProgressArgument::Json)
    }

    pub(crate) fn run(self, quiet: bool) -> Result<()> {
        let positive = |value: f32, name: &str| {
            if value.is_finite() && value > 0.0 {
                Ok(value)
            } else {
                Err(Error::usage(
                    format!("--{name} {value}"),
                    format!("--{name} takes a number above 0"),
                ))
            }
        };
        positive(self.scale, "scale")?;
        positive(self.dicing_rate, "dicing-rate")?;
        if let Some(frame) = self.frame
            && !frame.is_finite()
        {
            return Err(Error::usage(
                format!("--frame {frame}"),
                "--frame takes a number",
            ));
        }
        if let Some(albedo) = self.clay
            && !(0.0..=1.0).contains(&albedo)
        {
            return Err(Error::usage(
                format!("--clay {albedo}"),
                "an albedo lies between 0 and 1",
            ));
        }
        let interrupt = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // A second Ctrl-C waits for nothing, not for the libraries' own clean-up either: threads still use them.
            flag::register_conditional_shutdown(signal, 130, interrupt.clone())
                .and_then(|_| flag::register(signal, interrupt.clone()))
                .map_err(|e| Error::failed(format!("cannot listen for Ctrl-C: {e}")))?;
        }

        let style = match (quiet, self.progress) {
            (true, _) | (_, ProgressArgument::None) => ProgressStyle::Quiet,
            (_, ProgressArgument::Auto) => ProgressStyle::Auto,
            (_, ProgressArgument::Plain) => ProgressStyle::Plain,
            (_, ProgressArgument::Json) => ProgressStyle::Json,
        };
        let progress = Progress::new(style);
        let stats = render(&self.options(), &progress, &interrupt)?;
        tracing::info!(
            "{} rays, {:.2} Mrays/s, {:.1} s",
            stats.rays.total(),
            stats.mrays_per_second,
            stats.stages.iter().map(|s| s.seconds).sum::<f64>()
        );
        Ok(())
    }

    fn options(self) -> RenderOptions {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        let purposes = |p: Vec<PurposeArgument>| p.into_iter().filter_map(PurposeArgument::purpose);
        RenderOptions {
            output: Output {
                from_scene: self.output.is_none(),
                picture: self.output.unwrap_or_else(|| {
                    PathBuf::from(self.scene.file_stem().unwrap_or_default()).with_extension("exr")
                }),
                png: self.png,
                stats: self.stats,
                aovs: self.aov.iter().map(|a| a.0).collect(),
                pixel_type: match self.pixel_type {
                    TypeArgument::Half => PixelType::Half,
                    TypeArgument::Float => PixelType::Float,
                },
                tile: self.tile,
                multi_part: self.multi_part,
            },
            resolution: self.res.map(|r| [r[0], r[1]]),
            scale: self.scale,
            spp: self.spp,
            path: PathOptions {
                max_bounces: self.max_bounces,
                ..PathOptions::default()
            },
            filter: match self.filter {
                FilterArgument::Box => Filter::new(FilterKind::Box),
                FilterArgument::BlackmanHarris => Filter::new(FilterKind::BlackmanHarris),
            },
            seed: self.seed,
            threads: match self.threads {
                n if n >= 0 => n as usize,
                n => all.saturating_sub(n.unsigned_abs() as usize).max(1),
            },
            memory_budget: self.memory_budget,
            load: LoadOptions {
                frame: self.frame,
                camera: self.camera.clone(),
                motion_blur: !self.no_motion_blur,
                purposes: self.purpose.map(|p| purposes(p).collect()),
                settings: self.settings,
                missing_layers: match self.missing_layers {
                    MissingLayersArgument::Error => MissingLayers::Error,
                    MissingLayersArgument::Skip => MissingLayers::Skip,
                },
            },
            camera: self.camera,
            depth_of_field: !self.no_depth_of_field,
            build: BuildOptions {
                method: self.method.0,
                dicing: Dicing {
                    rate: self.dicing_rate,
                    max_segments: self.max_segments,
                    ..Dicing::default()
                },
                clay: self.clay,
                missing_textures: (self.missing_textures == MissingTextures::Magenta)
                    .then_some(Vec4::new(1.0, 0.0, 1.0, 1.0)),
                default_dome: 1.0,
            },
            scene: self.scene,
        }
    }
}
