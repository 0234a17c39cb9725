//! Large pieces of memory, which the system may refuse: under a limit (`ulimit -v`), or because it has no more.
//!
//! What is asked for here ends with [`Error::Memory`] then, which says what it was for; where a collection grows by itself,
//! the program itself ends with the same exit code.
//! Small pieces are not worth asking for: [`is_there`] tells beforehand whether there is enough for many of them.

use exhausted::asking;

use super::amount;
use crate::error::{Error, Result};

/// Bytes of small pieces that may be taken between two questions, on all threads. They are reserved for a moment, and not
/// written to, so that it costs nothing to ask.
pub const SMALL_PIECES: usize = 64 << 20;

/// Whether the system would give so many bytes now.
pub fn is_there(bytes: usize) -> bool {
    asking(|| Vec::<u8>::new().try_reserve_exact(bytes)).is_ok()
}

/// An empty vector with room for so many items, which are called `what` (as in "micro-vertices").
///
/// # Errors
/// If the system has no room for them.
pub fn room_for<T>(count: usize, what: &str) -> Result<Vec<T>> {
    let mut items = Vec::new();
    match asking(|| items.try_reserve_exact(count)) {
        Ok(()) => Ok(items),
        Err(_) => Err(refused::<T>(count, what)),
    }
}

/// Several of them, such as one for each motion key.
///
/// # Errors
/// As [`room_for`].
pub fn rooms_for<T>(rooms: usize, count: usize, what: &str) -> Result<Vec<Vec<T>>> {
    (0..rooms).map(|_| room_for(count, what)).collect()
}

/// So many items that are all alike.
///
/// # Errors
/// As [`room_for`].
pub fn filled<T: Clone>(count: usize, item: T, what: &str) -> Result<Vec<T>> {
    let mut items = room_for(count, what)?;
    items.resize(count, item);
    Ok(items)
}

/// Makes room for so many more items: for more than that, if there is enough, so that often making some is cheap.
///
/// # Errors
/// As [`room_for`].
pub fn more_room<T>(items: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    let there = asking(|| {
        items
            .try_reserve(more)
            .or_else(|_| items.try_reserve_exact(more))
    });
    if there.is_ok() {
        return Ok(());
    }
    Err(refused::<T>(items.len().saturating_add(more), what))
}

fn refused<T>(count: usize, what: &str) -> Error {
    let bytes = count as f64 * size_of::<T>() as f64;
    none_left(format!("{what} take {}", amount(bytes)))
}

/// That the system has no more: `what` is said first.
pub fn none_left(what: impl std::fmt::Display) -> Error {
    Error::Memory {
        message: format!("{what}, and the system has no more memory for this program"),
        help: Some(
            "dice more coarsely (--dicing-rate), choose --method compact or cache, or let the program have more memory"
                .to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_refuses_is_an_error() {
        let error = room_for::<u64>(1 << 50, "numbers").expect_err("no machine has it");
        assert_eq!(error.exit_code(), 4);
        assert!(error.to_string().contains("numbers"), "{error}");
        assert!(filled(usize::MAX, 1_u16, "numbers").is_err());
        let mut some = filled(3, 7, "numbers").expect("there is room");
        assert_eq!(some, [7; 3]);
        more_room(&mut some, 1 << 50, "numbers").expect_err("no machine has it");
        more_room(&mut some, 1, "numbers").expect("there is room");
        assert_eq!(some, [7; 3]);
        assert!(is_there(SMALL_PIECES) && !is_there(1 << 60));
    }
}
