//! What `relievo verify` and `relievo bench` are both told.

use std::path::Path;

use clap::Args;
use relievo::compare::{CompareOptions, Fineness};
use relievo::error::Warnings;
use relievo::scene::{self, Description, LoadOptions};
use relievo::world::Method;
use relievo::{Error, Result};

use super::method::MethodArgument;

#[derive(Debug, Args)]
pub(super) struct Compare {
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

impl Compare {
    pub(super) fn load(&self, path: &Path) -> Result<Description> {
        if self
            .dicing_rate
            .is_some_and(|rate| !(rate > 0.0 && rate.is_finite()))
        {
            return Err(Error::usage(
                "--dicing-rate is not above 0",
                "give the length of a micro-edge in pixels, as 1",
            ));
        }
        let scene = scene::load(path, &LoadOptions::default())?;
        self.warn(&scene.warnings);
        Ok(scene)
    }

    pub(super) fn options(&self, rays: u64) -> CompareOptions {
        let mut methods: Vec<Method> = Vec::new();
        for &MethodArgument(method) in &self.methods {
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
