//! How far the render is: a bar with ETA on a terminal, plain lines in a pipe, JSON lines for farms.

use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::error::{Warning, Warnings};
use indicatif::{ProgressBar, ProgressStyle as BarStyle};

/// The form of progress reports, all on the standard error stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ProgressStyle {
    /// A bar if the stream is a terminal, else plain lines.
    #[default]
    Auto,
    /// A line for every ten percent, or every thirty seconds.
    Plain,
    /// One JSON object a line: `{"stage":"render","done":0.42,"elapsed":12.1,"remaining":16.8}`, and
    /// `{"warning":"…","count":3}` in between.
    Json,
    /// Nothing.
    Quiet,
}

/// Reports progress; shared by all threads.
pub struct Progress {
    style: ProgressStyle,
    bar: Option<ProgressBar>,
    done: AtomicU64,
    stage: Mutex<Stage>,
}

struct Stage {
    name: &'static str,
    total: u64,
    start: Instant,
    told: u64,
    told_at: Instant,
}

impl Progress {
    /// Reports in this style.
    pub fn new(style: ProgressStyle) -> Self {
        let style = match style {
            ProgressStyle::Auto if std::io::stderr().is_terminal() => ProgressStyle::Auto,
            ProgressStyle::Auto => ProgressStyle::Plain,
            other => other,
        };
        let bar = (style == ProgressStyle::Auto).then(|| {
            let bar = ProgressBar::new(1);
            bar.set_style(
                BarStyle::with_template(
                    "{prefix:>7} {bar:40} {percent:>3}%  {elapsed} elapsed, {eta} left",
                )
                .expect("the template is a constant"),
            );
            bar
        });
        let now = Instant::now();
        let stage = Stage {
            name: "",
            total: 1,
            start: now,
            told: 0,
            told_at: now,
        };
        Self {
            style,
            bar,
            done: AtomicU64::new(0),
            stage: Mutex::new(stage),
        }
    }

    /// Begins a stage of `total` steps.
    pub fn stage(&self, name: &'static str, total: u64) {
        let now = Instant::now();
        self.done.store(0, Ordering::Relaxed);
        *self.lock() = Stage {
            name,
            total: total.max(1),
            start: now,
            told: 0,
            told_at: now,
        };
        if let Some(bar) = &self.bar {
            bar.reset();
            bar.set_length(total.max(1));
            bar.set_prefix(name);
        } else if self.style != ProgressStyle::Quiet {
            self.tell(&self.lock(), 0);
        }
    }

    /// So many more steps are done.
    pub fn by(&self, steps: u64) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        self.report(done);
    }

    /// So many steps are done in all.
    pub fn at(&self, done: u64) {
        self.done.store(done, Ordering::Relaxed);
        self.report(done);
    }

    /// Tells warnings, without tearing the bar.
    pub fn warn(&self, warnings: &Warnings) {
        for warning in warnings.iter() {
            let Warning { message, count, .. } = warning;
            let say = || match count {
                1 => tracing::warn!("{message}"),
                _ => tracing::warn!("{message} ({count} times)"),
            };
            match (&self.bar, self.style) {
                (Some(bar), _) => bar.suspend(say),
                (None, ProgressStyle::Json) => {
                    let line = serde_json::json!({ "warning": message, "count": count });
                    let _ = writeln!(std::io::stderr(), "{line}");
                }
                (None, _) => say(),
            }
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    fn report(&self, done: u64) {
        if let Some(bar) = &self.bar {
            bar.set_position(done);
            return;
        }
        if self.style == ProgressStyle::Quiet {
            return;
        }
        // Another thread that is telling already tells enough.
        let Ok(mut stage) = self.stage.try_lock() else {
            return;
        };
        // The load and build of small scenes would fill a log with lines that say nothing.
        let (share, every) = if self.style == ProgressStyle::Json {
            (100, 1)
        } else {
            (10, 30)
        };
        let tenth = share * done / stage.total;
        let due = tenth > share * stage.told / stage.total
            && stage.told_at.elapsed() > Duration::from_millis(200);
        if done > stage.told && (due || stage.told_at.elapsed() > Duration::from_secs(every)) {
            stage.told = done;
            stage.told_at = Instant::now();
            self.tell(&stage, done);
        }
    }

    fn tell(&self, stage: &Stage, done: u64) {
        let fraction = (done as f64 / stage.total as f64).min(1.0);
        let elapsed = stage.start.elapsed().as_secs_f64();
        let remaining = (fraction > 0.0).then(|| elapsed * (1.0 - fraction) / fraction);
        let line = if self.style == ProgressStyle::Json {
            serde_json::json!({
                "stage": stage.name, "done": fraction, "elapsed": elapsed, "remaining": remaining,
            })
            .to_string()
        } else {
            let left = remaining.map_or(String::new(), |r| format!(", {r:.0} s left"));
            format!(
                "{:>7} {:3.0} %, {elapsed:.0} s{left}",
                stage.name,
                100.0 * fraction
            )
        };
        // A closed pipe is no reason to stop rendering.
        let _ = writeln!(std::io::stderr(), "{line}");
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Stage> {
        self.stage
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
