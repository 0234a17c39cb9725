//! The memory that the whole program may take, and what it takes.
//!
//! What is counted is what the system counts: resident memory, with the program's own code, its libraries, and files
//! that are mapped. Whoever is about to take much asks first; what is promised to somebody who has not taken it yet (a
//! cache that fills while rays are traced) is set aside. Where the system does not tell how much is resident, only what
//! is asked for at once counts. With a budget or without, whoever asks is also told by no if the system would not give it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use crate::error::{Error, Result};

mod room;

pub use room::{SMALL_PIECES, filled, is_there, more_room, none_left, room_for, rooms_for};

/// How much the program may have in memory, if there is a limit. Clones are the same budget.
#[derive(Debug, Clone, Default)]
pub struct Budget(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    limit: usize,
    /// Set aside for what does not show in resident memory yet.
    promised: AtomicUsize,
    /// How often somebody asked, and which time is refused, whatever was asked for.
    asked: AtomicU64,
    refused: Option<u64>,
}

impl Inner {
    /// Bytes that are in memory or set aside.
    fn taken(&self) -> usize {
        resident().unwrap_or(0) + self.promised.load(Ordering::Relaxed)
    }
}

impl Budget {
    /// Of so many bytes.
    pub fn new(limit: usize) -> Self {
        Self::refusing(limit, None)
    }

    /// The same, but the `time`-th question, from 0, is answered by no: for tests of all that follows a refusal.
    pub fn refusing_once(limit: usize, time: u64) -> Self {
        Self::refusing(limit, Some(time))
    }

    fn refusing(limit: usize, refused: Option<u64>) -> Self {
        Self(Some(Arc::new(Inner {
            limit,
            promised: AtomicUsize::new(0),
            asked: AtomicU64::new(0),
            refused,
        })))
    }

    /// Bytes of the whole, if there is a limit.
    pub fn limit(&self) -> Option<usize> {
        self.0.as_ref().map(|inner| inner.limit)
    }

    /// How often somebody asked so far.
    pub fn asked(&self) -> u64 {
        let asked = self.0.as_ref();
        asked.map_or(0, |inner| inner.asked.load(Ordering::Relaxed))
    }

    /// Sets so many bytes aside, in place of what was set aside before.
    pub fn promise(&self, bytes: usize) {
        if let Some(inner) = &self.0 {
            inner.promised.store(bytes, Ordering::Relaxed);
        }
    }

    /// Bytes that may still be taken, if there is a limit: 0 where it is passed.
    pub fn left(&self) -> Option<usize> {
        let inner = self.0.as_ref()?;
        Some(inner.limit.saturating_sub(inner.taken()))
    }

    /// Whether this question is not the one to be refused.
    pub fn grants(&self) -> bool {
        let Some(inner) = &self.0 else {
            return true;
        };
        let time = inner.asked.fetch_add(1, Ordering::Relaxed);
        inner.refused != Some(time)
    }

    /// Whether the limit is kept, with what was set aside, and the system has [more](SMALL_PIECES). Ask while memory is being
    /// taken.
    pub fn is_kept(&self) -> bool {
        self.grants()
            && is_there(SMALL_PIECES)
            && (self.0.as_ref()).is_none_or(|inner| inner.taken() <= inner.limit)
    }

    /// Asks for bytes for something.
    ///
    /// # Errors
    /// [`Error::Memory`] if they are not left: `what` (as in "textures") takes them.
    pub fn ask(&self, bytes: u64, what: &str) -> Result<()> {
        let whole = usize::try_from(bytes).unwrap_or(usize::MAX);
        let fits = (self.0.as_ref())
            .is_none_or(|inner| inner.taken().saturating_add(whole) <= inner.limit);
        if self.grants() && fits && is_there(whole.saturating_add(SMALL_PIECES)) {
            return Ok(());
        }
        Err(self.exceeded(format!("{what} take about {}", amount(bytes as f64))))
    }

    /// That the budget does not suffice, or that the system has no more: `what` is said first, then what there is.
    pub fn exceeded(&self, what: impl std::fmt::Display) -> Error {
        let (Some(limit), Some(left), true) = (self.limit(), self.left(), is_there(SMALL_PIECES))
        else {
            return none_left(what);
        };
        Error::Memory {
            message: format!(
                "{what}, and {} of the memory budget of {} are left",
                amount(left as f64),
                amount(limit as f64)
            ),
            help: Some("raise --memory-budget".to_owned()),
        }
    }
}

impl From<Option<usize>> for Budget {
    fn from(limit: Option<usize>) -> Self {
        limit.map_or_else(Self::default, Self::new)
    }
}

/// Bytes of this process in memory, libraries and mapped files included; none where the system does not tell.
pub fn resident() -> Option<usize> {
    status("VmRSS:")
}

/// The most that it ever had.
pub fn peak_resident() -> Option<usize> {
    status("VmHWM:")
}

/// The machine's memory; none where the system does not tell.
pub fn of_machine() -> Option<usize> {
    kibibytes("/proc/meminfo", "MemTotal:")
}

/// From Linux's process file system.
fn status(name: &str) -> Option<usize> {
    kibibytes("/proc/self/status", name)
}

fn kibibytes(file: &str, name: &str) -> Option<usize> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(name))?;
    let kibibytes: usize = line.trim().strip_suffix("kB")?.trim_end().parse().ok()?;
    Some(1024 * kibibytes)
}

/// Bytes as a person says them, in the units in which budgets are given.
pub fn amount(bytes: f64) -> String {
    const KIB: f64 = 1024.0;
    if bytes < KIB * KIB {
        format!("{:.1} KiB", bytes / KIB)
    } else if bytes < KIB * KIB * KIB {
        format!("{:.1} MiB", bytes / (KIB * KIB))
    } else {
        format!("{:.2} GiB", bytes / (KIB * KIB * KIB))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_counts_what_is_resident_and_promised() {
        let resident = resident().expect("Linux tells");
        assert!(peak_resident() >= Some(resident));
        let budget = Budget::new(resident + (1 << 30));
        let left = budget.left().expect("there is a limit");
        assert!(left > 1 << 29 && left < 3 << 29, "{left}");
        budget.ask(1 << 20, "trees").expect("they fit");
        let refused = budget.ask(1 << 32, "trees").expect_err("they do not");
        assert_eq!(refused.exit_code(), 4);
        budget.promise(2 << 30);
        assert!(!budget.is_kept());
        assert!(Budget::default().is_kept());
        assert_eq!(Budget::default().left(), None);
    }

    #[test]
    fn one_question_is_refused() {
        let budget = Budget::refusing_once(usize::MAX, 1);
        let answers: Vec<bool> = (0..3).map(|_| budget.is_kept()).collect();
        assert_eq!(answers, [true, false, true]);
    }
}
