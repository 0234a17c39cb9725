//! `relievo render`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use relievo::error::Fault;
use relievo::image::PtexFilter;
use relievo::integrate::PathOptions;
use relievo::render::{AOVS, Aov, Output, PixelType, RenderOptions, render};
use relievo::shade::filter::{Filter, FilterKind};
use relievo::store::Store;
use relievo::world::{BuildOptions, Choice, Method};
use relievo::{Error, Result};

use super::machine::{Machine, interrupt};
use super::method::{CacheArgument, MethodArgument};
use super::staging::Staging;

/// Render a scene to a picture.
///
/// A bare OBJ, or a USD file without camera or light, is framed whole and lit by a white dome.
#[derive(Debug, Args)]
pub(crate) struct Render {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj; or what `relievo build` made of one: .rlv.
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

    /// Hierarchies that `relievo build` made of the scene, with what it was told.
    #[arg(long, value_name = "STORE")]
    built: Option<PathBuf>,

    #[command(flatten)]
    staging: Staging,

    /// Samples in each pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = "Quality")]
    spp: u32,
    /// The most scatterings of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = "Quality")]
    max_bounces: u32,
    /// Pixel filter.
    #[arg(long, value_enum, default_value_t = FilterArgument::BlackmanHarris, help_heading = "Quality")]
    filter: FilterArgument,
    /// How surfaces are traced [default: embree-grid, or as they were built]
    #[arg(long, value_enum, help_heading = "Quality")]
    method: Option<MethodArgument>,
    #[command(flatten)]
    cache: CacheArgument,
    /// Chooses the random numbers: another seed, another noise.
    #[arg(long, default_value_t = 0, help_heading = "Quality")]
    seed: u32,
    /// How Ptex files are looked up, whatever the scene says: consistent, point, bilinear, box, gaussian, bicubic,
    /// bspline, catmullrom or mitchell. Displacement always is consistently, so that faces meet.
    #[arg(long, value_name = "FILTER", value_parser = ptex_filter, help_heading = "Quality")]
    ptex_filter: Option<PtexFilter>,
    /// How much of what a sample stands for lookups of textures cover, by its width: 0 for no more than a texel.
    #[arg(
        long,
        value_name = "WIDTH",
        default_value_t = 1.0,
        help_heading = "Quality"
    )]
    footprint: f32,
    /// Leave out depth of field.
    #[arg(long, help_heading = "Quality")]
    no_depth_of_field: bool,

    /// Make everything Lambert with this albedo; displacement stays.
    #[arg(long, value_name = "ALBEDO", num_args = 0..=1, default_missing_value = "0.5", help_heading = "Scene")]
    clay: Option<f32>,
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

    #[command(flatten)]
    machine: Machine,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FilterArgument {
    /// Each sample counts for its own pixel.
    Box,
    /// Three pixels wide: smooth edges, little ringing.
    BlackmanHarris,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TypeArgument {
    Half,
    Float,
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

impl Render {
    /// Whether all that is said shall be JSON.
    pub(crate) fn reports_json(&self) -> bool {
        self.machine.reports_json()
    }

    pub(crate) fn run(self, quiet: bool) -> Result<()> {
        self.staging.check()?;
        if let Some(albedo) = self.clay
            && !(0.0..=1.0).contains(&albedo)
        {
            return Err(Error::usage(
                format!("--clay {albedo}"),
                "an albedo lies between 0 and 1",
            ));
        }
        if !(0.0..=100.0).contains(&self.footprint) {
            return Err(Error::usage(
                format!("--footprint {}", self.footprint),
                "a width lies between 0 and 100; 1 is usual",
            ));
        }
        let interrupt = interrupt()?;
        let progress = self.machine.progress(quiet);
        let stats = render(&self.options()?, &progress, &interrupt)?;
        tracing::info!(
            "{} rays, {:.2} Mrays/s, {:.1} s",
            stats.rays.total(),
            stats.mrays_per_second,
            stats.stages.iter().map(|s| s.seconds).sum::<f64>()
        );
        Ok(())
    }

    fn options(mut self) -> Result<RenderOptions> {
        let mut built = self.open()?;
        let method = match &mut built {
            None => self.method.unwrap_or_default().0,
            Some(store) => {
                let scene = if self.built.is_none() {
                    store.scene()
                } else {
                    self.scene
                };
                self.scene = scene;
                let told = serde_json::from_value(store.told().clone()).map_err(|e| {
                    unusable(store, &format!("what it was told makes no sense: {e}"))
                })?;
                store.told_otherwise(self.staging.differing(&told));
                self.staging = self.staging.or(told);
                self.staging.check()?;
                stored_method(store, self.method)?.into()
            }
        };
        let staging = self.staging;
        Ok(RenderOptions {
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
            resolution: staging.resolution(),
            scale: staging.scale(),
            spp: self.spp,
            path: PathOptions {
                max_bounces: self.max_bounces,
                footprint: self.footprint,
                ..PathOptions::default()
            },
            filter: match self.filter {
                FilterArgument::Box => Filter::new(FilterKind::Box),
                FilterArgument::BlackmanHarris => Filter::new(FilterKind::BlackmanHarris),
            },
            seed: self.seed,
            threads: self.machine.threads(),
            memory_budget: self.machine.memory_budget.into(),
            load: staging.load(),
            depth_of_field: !self.no_depth_of_field,
            build: BuildOptions {
                method,
                dicing: staging.dicing(),
                bounce_dicing: staging.bounce_dicing(),
                max_error: staging.max_error.unwrap_or_default(),
                cache_size: self.cache.size(),
                clay: self.clay,
                missing_textures: staging.missing_textures(),
                ptex_filter: self.ptex_filter,
                default_dome: 1.0,
                held_beside: 0,
            },
            built: built.map(Arc::new),
            camera: staging.camera,
            scene: self.scene,
        })
    }

    /// The store that is named, also in place of the scene.
    fn open(&self) -> Result<Option<Store>> {
        let is_store = self
            .scene
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("rlv"));
        let path = match &self.built {
            Some(_) if is_store => {
                return Err(Error::usage(
                    "the scene is a store, and --built names another one",
                    "name the scene's own file",
                ));
            }
            Some(path) => path,
            None if is_store => &self.scene,
            None => return Ok(None),
        };
        Ok(Some(Store::open(path)?))
    }
}

/// The method whose hierarchies a store holds, unless another one is asked for.
fn stored_method(store: &Store, asked: Option<MethodArgument>) -> Result<Method> {
    let name = store.method();
    let mut known = Method::ALL.into_iter().filter(|method| method.is_stored());
    let Some(method) = known.find(|method| method.name() == name) else {
        return Err(unusable(
            store,
            &format!("its method is `{name}`, which is unknown here"),
        ));
    };
    match asked {
        Some(MethodArgument(asked)) if asked != Choice::One(method) => Err(Error::usage(
            format!("--method {}, where {name} was built", asked.name()),
            "leave one of both out",
        )),
        _ => Ok(method),
    }
}

fn unusable(store: &Store, message: &str) -> Error {
    Fault::new(message)
        .in_file(store.path())
        .advise("run `relievo build` again")
        .into()
}

fn ptex_filter(name: &str) -> std::result::Result<PtexFilter, String> {
    PtexFilter::named(name).map_err(|fault| {
        let advice = fault.help.clone().unwrap_or_default();
        format!("{fault}: {advice}")
    })
}
