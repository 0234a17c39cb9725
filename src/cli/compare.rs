//! What `relievo verify` and `relievo bench` are both told.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use relievo::compare::{CompareOptions, Fineness, Method};
use relievo::error::Warnings;
use relievo::scene::{self, Description, LoadOptions};
use relievo::{Error, Result};

#[derive(Debug, Args)]
pub(super) struct Compare {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    pub(super) scene: PathBuf,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    pub(super) json: bool,
    /// Methods, with commas between [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    methods: Vec<MethodArgument>,
    /// Length of a micro-edge in pixels, before the scene's camera.
    #[arg(long, conflicts_with = "micro_triangles")]
    dicing_rate: Option<f32>,
    /// Dice all edges alike, so that about this many micro-triangles result.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..=1 << 30))]
    micro_triangles: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MethodArgument {
    EmbreeSubdivision,
    EmbreeTriangles,
    EmbreeGrid,
    Tessellated,
    Compact,
}

impl Compare {
    pub(super) fn load(&self) -> Result<Description> {
        if self
            .dicing_rate
            .is_some_and(|rate| !(rate > 0.0 && rate.is_finite()))
        {
            return Err(Error::usage(
                "--dicing-rate is not above 0",
                "give the length of a micro-edge in pixels, as 1",
            ));
        }
        let scene = scene::load(&self.scene, &LoadOptions::default())?;
        self.warn(&scene.warnings);
        Ok(scene)
    }

    pub(super) fn options(&self, rays: u64) -> CompareOptions {
        let mut methods: Vec<Method> = Vec::new();
        for argument in &self.methods {
            let method = match argument {
                MethodArgument::EmbreeSubdivision => Method::EmbreeSubdivision,
                MethodArgument::EmbreeTriangles => Method::EmbreeTriangles,
                MethodArgument::EmbreeGrid => Method::EmbreeGrid,
                MethodArgument::Tessellated => Method::Tessellated,
                MethodArgument::Compact => Method::Compact,
            };
            if !methods.contains(&method) {
                methods.push(method);
            }
        }
        if methods.is_empty() {
            methods = Method::ALL.to_vec();
        }
        CompareOptions {
            methods,
            fineness: match self.dicing_rate {
                Some(rate) => Fineness::DicingRate(rate),
                None => Fineness::MicroTriangles(self.micro_triangles),
            },
            rays,
        }
    }

    pub(super) fn warn(&self, warnings: &Warnings) {
        for warning in warnings.iter() {
            tracing::warn!("{}", warning.message);
        }
    }
}
