//! What `relievo verify` and `relievo bench` are both told.

use std::path::Path;

use clap::Args;
use relievo::compare::{CompareOptions, Fineness, achieved_by};
use relievo::error::Warnings;
use relievo::memory::Budget;
use relievo::scene::{self, Description, LoadOptions};
use relievo::world::{AchievedError, CacheSize, Choice, MaxError, Method};
use relievo::{Error, Result};

use super::machine::bytes;
use super::method::{CacheArgument, MethodArgument, max_error};

#[derive(Debug, Args)]
pub(super) struct Compare {
    /// Methods, with commas between [default: all but auto]
    #[arg(long, value_enum, value_delimiter = ',')]
    methods: Vec<MethodArgument>,
    /// Length of a micro-edge in pixels, before the scene's camera.
    #[arg(long, conflicts_with = "micro_triangles")]
    dicing_rate: Option<f32>,
    /// Dice all edges alike, so that about this many micro-triangles result. Edges have 4096 micro-edges at most.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    micro_triangles: u64,
    /// How far `compact` and `cache` may move micro-vertices: 0.25px is a quarter of a pixel at the closest view (with
    /// --dicing-rate), 1e-5 that part of the object's diagonal [default: 3.6e-5, and with --dicing-rate at most 0.25px]
    #[arg(long, value_name = "ERROR", value_parser = max_error)]
    max_error: Option<MaxError>,
    #[command(flatten)]
    cache: CacheArgument,
    /// Memory that the whole program may have, its own code included: 800M, 12G.
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    memory_budget: Option<usize>,
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
        if let (Some(MaxError::Pixels(error)), None) = (self.max_error, self.dicing_rate) {
            return Err(Error::usage(
                format!("--max-error {error}px needs to know pixels"),
                "give --dicing-rate too, or a part of the object's diagonal, as --max-error 1e-5",
            ));
        }
        let budget = Budget::from(self.memory_budget);
        budget.ask(scene::expected_memory(path), "the scene's file")?;
        let scene = scene::load(path, &LoadOptions::default())?;
        budget.ask(0, "program and scene")?;
        self.warn(&scene.warnings);
        Ok(scene)
    }

    /// The fineness that was asked for.
    pub(super) fn fineness(&self) -> Fineness {
        match self.dicing_rate {
            Some(rate) => Fineness::DicingRate(rate),
            None => Fineness::MicroTriangles(self.micro_triangles),
        }
    }

    pub(super) fn options(&self, fineness: Fineness, rays: u64) -> CompareOptions {
        let mut methods: Vec<Choice> = Vec::new();
        for &MethodArgument(method) in &self.methods {
            if !methods.contains(&method) {
                methods.push(method);
            }
        }
        if methods.is_empty() {
            methods = Method::ALL.map(Choice::One).to_vec();
        }
        let eighth = self.memory_budget.map_or(usize::MAX, |budget| budget / 8);
        let cache_size = CacheSize::default().0.min(eighth);
        CompareOptions {
            methods,
            fineness,
            bounce_dicing: None,
            max_error: self.max_error.unwrap_or_default(),
            cache_size: self.cache.size().unwrap_or(CacheSize(cache_size)),
            memory_budget: self.memory_budget.into(),
            rays,
        }
    }

    pub(super) fn warn(&self, warnings: &Warnings) {
        for warning in warnings.iter() {
            tracing::warn!("{}", warning.message);
        }
    }
}

/// A line for each method that moves micro-vertices, or has slabs or quads instead.
pub(super) fn moved<'a>(rows: impl Iterator<Item = (&'a str, Option<AchievedError>)>) -> String {
    let mut told = Vec::new();
    let mut text = String::new();
    for (method, error) in rows {
        let Some(error) = error.filter(|_| !told.contains(&method)) else {
            continue;
        };
        told.push(method);
        let (max, rms) = (error.max_diagonals, error.rms_diagonals);
        let what = achieved_by(method);
        text += &format!("{method}: {what} up to {max:.2e} diagonals, rms {rms:.2e}");
        if let Some(pixels) = error.max_pixels {
            text += &format!("; up to {pixels:.3} pixels");
        }
        if let Some(moved) = error.linear_normals {
            let (max, rms) = (moved.max_diagonals, moved.rms_diagonals);
            text +=
                &format!("; normals of unit length would move them up to {max:.2e}, rms {rms:.2e}");
        }
        text.push('\n');
    }
    text
}
