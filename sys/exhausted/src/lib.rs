//! An allocator that ends the program in order where the system has no more memory.
//!
//! Large pieces are asked for, and whoever asks says what there was no memory for. All others cannot be: a collection that
//! grows has no way to fail, and the standard library ends the process by a signal then. A batch of renders must be able to
//! tell that from a crash: with [`OrExit`] as its global allocator the program says what is the matter and ends with an
//! exit code.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Whether this thread asks, and so wants to be told.
    static ASKS: Cell<bool> = const { Cell::new(false) };
}

/// Asks for memory by one of the `try_` functions of collections: of what is refused meanwhile, whoever asks is told.
pub fn asking<T>(ask: impl FnOnce() -> T) -> T {
    struct Until(bool);
    impl Drop for Until {
        fn drop(&mut self) {
            ASKS.set(self.0);
        }
    }
    let _until = Until(ASKS.replace(true));
    ask()
}

/// The system's allocator, but that the program ends where it refuses what nobody [asked](asking) for.
#[derive(Debug)]
pub struct OrExit {
    code: i32,
    message: &'static str,
}

impl OrExit {
    /// With an exit code, and what is to be written to the standard error before.
    pub const fn new(code: i32, message: &'static str) -> Self {
        Self { code, message }
    }

    /// Gives on what the system gave.
    fn given(&self, memory: *mut u8) -> *mut u8 {
        // A thread that is about to end has no state of its own any more.
        if memory.is_null() && !ASKS.try_with(Cell::get).unwrap_or(false) {
            // SAFETY: the text is there, and so long. Neither call allocates, unwinds or comes back to anything of ours: the
            // second one does not come back at all.
            unsafe {
                libc::write(
                    libc::STDERR_FILENO,
                    self.message.as_ptr().cast(),
                    self.message.len(),
                );
                libc::_exit(self.code);
            }
        }
        memory
    }
}

// SAFETY: all memory is the system allocator's, by the same layouts; nothing unwinds.
unsafe impl GlobalAlloc for OrExit {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps to the same contract.
        self.given(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps to the same contract.
        self.given(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller keeps to the same contract.
        self.given(unsafe { System.realloc(memory, layout, size) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps to the same contract.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[global_allocator]
    static ALLOCATOR: OrExit = OrExit::new(4, "no more\n");

    #[test]
    fn who_asks_is_told() {
        let mut bytes = Vec::<u8>::new();
        assert!(asking(|| bytes.try_reserve_exact(1 << 60)).is_err());
        assert!(asking(|| bytes.try_reserve_exact(1 << 20)).is_ok());
        assert!(!ASKS.get());
    }
}
