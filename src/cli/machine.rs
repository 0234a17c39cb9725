//! What long commands are told of the machine, how they tell of their progress, and how they are ended.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Args, ValueEnum};
use relievo::render::{Progress, ProgressStyle};
use relievo::{Error, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

#[derive(Debug, Args)]
pub(super) struct Machine {
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
    /// Memory that the whole program may have, its own code included: 800M, 12G. See `relievo info`.
    #[arg(long, value_name = "BYTES", value_parser = bytes, help_heading = "Machine")]
    pub(super) memory_budget: Option<usize>,
    /// Form of the progress reports.
    #[arg(long, value_enum, default_value_t = ProgressArgument::Auto, help_heading = "Machine")]
    progress: ProgressArgument,
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

/// More than any machine has: so many can still be started, and the work is done.
const MAX_THREADS: i64 = 1024;

impl Machine {
    /// Whether all that is said shall be JSON.
    pub(super) fn reports_json(&self) -> bool {
        matches!(self.progress, ProgressArgument::Json)
    }

    pub(super) fn progress(&self, quiet: bool) -> Progress {
        Progress::new(match (quiet, self.progress) {
            (true, _) | (_, ProgressArgument::None) => ProgressStyle::Quiet,
            (_, ProgressArgument::Auto) => ProgressStyle::Auto,
            (_, ProgressArgument::Plain) => ProgressStyle::Plain,
            (_, ProgressArgument::Json) => ProgressStyle::Json,
        })
    }

    /// 0 for all.
    pub(super) fn threads(&self) -> usize {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        match self.threads {
            n if n >= 0 => n as usize,
            n => all.saturating_sub(n.unsigned_abs() as usize).max(1),
        }
    }
}

/// What Ctrl-C and its like set.
pub(super) fn interrupt() -> Result<Arc<AtomicBool>> {
    let interrupt = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // A second Ctrl-C waits for nothing, not for the libraries' own clean-up either: threads still use them.
        flag::register_conditional_shutdown(signal, 130, interrupt.clone())
            .and_then(|_| flag::register(signal, interrupt.clone()))
            .map_err(|e| Error::failed(format!("cannot listen for Ctrl-C: {e}")))?;
    }
    Ok(interrupt)
}

pub(super) fn bytes(text: &str) -> std::result::Result<usize, String> {
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
