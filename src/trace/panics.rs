//! Panics must not cross Embree's frames: they stop here and wait to be reported.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use crate::error::{Error, Result};

/// `f`'s value; a panic in it, or in what it starts on other threads, is an error.
///
/// # Errors
/// Those of `f`, and [`Error::Failed`] with the panic's message.
pub(crate) fn caught<T>(doing: &str, f: impl FnOnce() -> Result<T>) -> Result<T> {
    // What a panic leaves half done is only what `f` captured, and whoever asked for it is told.
    catch_unwind(AssertUnwindSafe(f)).unwrap_or_else(|payload| {
        let message = message_of(payload.as_ref());
        Err(Error::failed(format!("panic while {doing}: {message}")))
    })
}

fn message_of(payload: &(dyn Any + Send)) -> String {
    payload
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a message".to_owned())
}

/// The message of the first panic in a callback.
#[derive(Default)]
pub(super) struct PanicSlot(Mutex<Option<String>>);

impl PanicSlot {
    /// `f`'s value, or `otherwise` if it panics.
    pub(super) fn guard<T>(&self, otherwise: T, f: impl FnOnce() -> T) -> T {
        // What a panic leaves half done is only what `f` captured; the render that saw it is given up.
        match catch_unwind(AssertUnwindSafe(f)) {
            Ok(value) => value,
            Err(payload) => {
                self.note(payload.as_ref());
                otherwise
            }
        }
    }

    /// The message, which is gone then.
    pub(super) fn take(&self) -> Option<String> {
        match self.0.lock() {
            Ok(mut slot) => slot.take(),
            Err(poisoned) => poisoned.into_inner().take(),
        }
    }

    fn note(&self, payload: &(dyn Any + Send)) {
        let message = message_of(payload);
        if let Ok(mut slot) = self.0.lock() {
            slot.get_or_insert(message);
        }
    }
}
