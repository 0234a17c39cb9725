//! The memory that texels of open files take, all files together, held to a budget.
//!
//! What is loaded is noted in a queue. When the budget is passed, the queue is walked: what was used since the last
//! time gets a second chance, the rest goes (the clock algorithm, Corbató 1968). Lookups take no part in this: all they
//! do is to set a flag where it is not set.

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// A budget in bytes, shared by every file that is opened with it. Clones are the same cache.
#[derive(Clone)]
pub struct Cache(Arc<Inner>);

struct Inner {
    budget: usize,
    held: AtomicUsize,
    queue: Mutex<VecDeque<Item>>,
}

struct Item {
    bytes: usize,
    owner: Box<dyn Evict>,
}

/// Where a cached thing can be found again to be let go.
pub(crate) trait Evict: Send {
    /// Lets it go, unless it was used since the last time. True: it is gone.
    fn evict(&self) -> bool;
}

impl Cache {
    /// A cache that holds `budget` bytes of texels. What one lookup needs is held beyond it for as long as the lookup
    /// takes.
    #[must_use]
    pub fn new(budget: usize) -> Self {
        Self(Arc::new(Inner {
            budget,
            held: AtomicUsize::new(0),
            queue: Mutex::default(),
        }))
    }

    /// Bytes that may be held.
    #[must_use]
    pub fn budget(&self) -> usize {
        self.0.budget
    }

    /// Bytes that are held, those of closed files included until their room is needed.
    #[must_use]
    pub fn held(&self) -> usize {
        self.0.held.load(Ordering::Relaxed)
    }

    /// Notes what was loaded, and lets go of what has not been used for long.
    pub(crate) fn note(&self, bytes: usize, owner: Box<dyn Evict>) {
        let mut queue = self.0.queue.lock().unwrap_or_else(PoisonError::into_inner);
        queue.push_back(Item { bytes, owner });
        let mut held = self.0.held.load(Ordering::Relaxed) + bytes;
        // Twice around: the first time clears the flags of what was used.
        for _ in 0..2 * queue.len() {
            if held <= self.0.budget {
                break;
            }
            let Some(item) = queue.pop_front() else { break };
            if item.owner.evict() {
                held -= item.bytes;
            } else {
                queue.push_back(item);
            }
        }
        self.0.held.store(held, Ordering::Relaxed);
    }
}

impl Default for Cache {
    /// A cache of 1 GiB.
    fn default() -> Self {
        Self::new(1 << 30)
    }
}

impl fmt::Debug for Cache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Cache")
            .field("budget", &self.budget())
            .field("held", &self.held())
            .finish()
    }
}
