//! Ways of tracing by their names, and how far they may move what they trace.

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use relievo::world::{CacheSize, Choice, MaxError, Method};

use super::machine::bytes;

/// A method by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct MethodArgument(pub(super) Choice);

impl ValueEnum for MethodArgument {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [MethodArgument; Method::ALL.len() + 1] = {
            let mut all = [MethodArgument(Choice::Auto); Method::ALL.len() + 1];
            let mut i = 0;
            while i < Method::ALL.len() {
                all[i] = MethodArgument(Choice::One(Method::ALL[i]));
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.about()))
    }
}

/// The size of the cache.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct CacheArgument {
    /// Memory for what `cache` dices, for all surfaces together: 60M, 1G [default: 128M, and at most an eighth of the
    /// memory budget; with `auto` what is left]
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    cache_size: Option<usize>,
}

impl CacheArgument {
    pub(super) fn size(self) -> Option<CacheSize> {
        self.cache_size.map(CacheSize)
    }
}

/// How many times as long micro-edges are after a bounce: 1 to 64.
pub(super) fn bounce_dicing(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(times) if (1.0..=64.0).contains(&times) => Ok(times),
        _ => Err("micro-edges may be 1 to 64 times as long after a bounce".to_owned()),
    }
}

/// An error in pixels (`0.25px`) or in diagonals (`1e-5`).
pub(super) fn max_error(text: &str) -> Result<MaxError, String> {
    let (number, kind): (&str, fn(f32) -> MaxError) = match text.strip_suffix("px") {
        Some(pixels) => (pixels.trim_end(), MaxError::Pixels),
        None => (text, MaxError::Diagonals),
    };
    match number.parse::<f32>() {
        Ok(error) if error > 0.0 && error.is_finite() => Ok(kind(error)),
        _ => Err(
            "it is not above 0: 0.25px is a quarter of a pixel, 1e-5 that part of the diagonal"
                .to_owned(),
        ),
    }
}
