//! `relievo build`.

use std::path::PathBuf;

use clap::Args;
use relievo::integrate::PathOptions;
use relievo::render::{Output, RenderOptions, build};
use relievo::shade::filter::{Filter, FilterKind};
use relievo::world::{BuildOptions, Choice, Method};
use relievo::{Error, Result};

use super::machine::{Machine, interrupt};
use super::method::MethodArgument;
use super::staging::Staging;

/// Build the hierarchies of all surfaces of a scene, and keep them in a file.
///
/// `relievo render FILE.rlv` then starts without building them. What is asked for here holds for that render too;
/// whatever changes a surface, its place or the camera calls for another build, and the render says so.
#[derive(Debug, Args)]
pub(crate) struct Build {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    /// Store to write [default: the scene's name with .rlv]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// How surfaces will be traced: a method of our own that compresses.
    #[arg(long, value_enum, default_value_t = MethodArgument(Choice::One(Method::Compact)), help_heading = "Quality")]
    method: MethodArgument,
    #[command(flatten)]
    staging: Staging,
    #[command(flatten)]
    machine: Machine,
}

impl Build {
    /// Whether all that is said shall be JSON.
    pub(crate) fn reports_json(&self) -> bool {
        self.machine.reports_json()
    }

    pub(crate) fn run(self, quiet: bool) -> Result<()> {
        self.staging.check()?;
        let interrupt = interrupt()?;
        let progress = self.machine.progress(quiet);
        let store = self.output.unwrap_or_else(|| {
            PathBuf::from(self.scene.file_stem().unwrap_or_default()).with_extension("rlv")
        });
        let told = serde_json::to_value(&self.staging)
            .map_err(|e| Error::failed(format!("options: {e}")))?;
        let options = RenderOptions {
            scene: self.scene,
            output: Output::default(),
            resolution: self.staging.resolution(),
            scale: self.staging.scale(),
            spp: 1,
            path: PathOptions::default(),
            filter: Filter::new(FilterKind::Box),
            seed: 0,
            threads: self.machine.threads(),
            memory_budget: self.machine.memory_budget.into(),
            load: self.staging.load(),
            depth_of_field: true,
            build: BuildOptions {
                method: self.method.0,
                dicing: self.staging.dicing(),
                bounce_dicing: self.staging.bounce_dicing(),
                max_error: self.staging.max_error.unwrap_or_default(),
                clay: None,
                missing_textures: self.staging.missing_textures(),
                ptex_filter: None,
                default_dome: 1.0,
                ..BuildOptions::default()
            },
            built: None,
            camera: self.staging.camera,
        };
        let recorded = build(&options, &store, told, &progress, &interrupt)?;
        tracing::info!(
            "{}: {} objects, {} bytes, built in {:.1} s",
            store.display(),
            recorded.objects,
            recorded.bytes,
            recorded.stats.seconds("build")
        );
        Ok(())
    }
}
