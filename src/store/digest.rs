//! Digests of what a hierarchy follows from.

use bytemuck::NoUninit;
use sha2::{Digest as _, Sha256};

use super::{checksum, hex};

/// Gathers the parts of a description; two descriptions have the same digest only if they are the same. Each part is
/// told with its size, so that what ends one cannot begin the next.
#[derive(Clone)]
pub struct Digest(Sha256);

impl Digest {
    /// Of nothing yet but the version of the program: another one may build otherwise.
    pub fn new() -> Self {
        let mut digest = Self(Sha256::new());
        digest.text(env!("CARGO_PKG_VERSION"));
        digest
    }

    /// A part that is text.
    pub fn text(&mut self, text: &str) {
        self.0.update((text.len() as u64).to_le_bytes());
        self.0.update(text);
    }

    /// A part of many numbers. Large ones are read by all threads.
    pub fn numbers<T: NoUninit>(&mut self, numbers: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(numbers);
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(checksum(bytes));
    }

    /// As it stands in a store.
    pub fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}
