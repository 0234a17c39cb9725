//! Files mapped into memory, slices that are owned or lie in one, and memory in large pages.

use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::ops::{Deref, DerefMut, Range};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::Arc;

use bytemuck::{AnyBitPattern, Zeroable};
use memmap2::{Mmap, MmapMut};

/// A file's bytes, which the system reads when they are asked for.
///
/// Whoever changes the file while it is mapped changes what is read here; who shortens it ends the process by a signal.
/// Files that are replaced by renaming another one are safe: the old file lives on until it is let go.
#[derive(Debug)]
pub struct MappedFile(Mmap);

impl MappedFile {
    /// Maps a whole file.
    ///
    /// # Errors
    /// If it cannot be opened, or cannot be mapped as a pipe cannot.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        // SAFETY: the map is private to us and read only. Should another process write to the file meanwhile, what was
        // checked may no longer hold: readers see other numbers, but every number is a valid `AnyBitPattern`, and who
        // uses them as indices does so with bounds checks; should it be shortened, reading beyond its end raises
        // SIGBUS, which ends the process. The type's documentation says so, and our own files are replaced whole.
        let map = unsafe { Mmap::map(&file)? };
        Ok(Self(map))
    }

    /// All of it.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// A slice that is owned, or lies in a mapped file; as fast to read as a vector.
pub struct Items<T> {
    start: NonNull<T>,
    len: usize,
    // Never touched again, but for being dropped.
    _owner: Owner<T>,
}

#[allow(dead_code, reason = "they only keep alive what `start` points to")]
enum Owner<T> {
    Vec(Vec<T>),
    File(Arc<MappedFile>),
}

// SAFETY: it is a slice that nobody changes, with its owner: as good to send as a vector of the same.
unsafe impl<T: Send> Send for Items<T> {}
// SAFETY: likewise for sharing.
unsafe impl<T: Sync> Sync for Items<T> {}

impl<T: AnyBitPattern> Items<T> {
    /// Those in a range of a file's bytes: none if they end beyond it, or in the middle of one, or are not aligned.
    pub fn in_file(file: &Arc<MappedFile>, bytes: Range<usize>) -> Option<Self> {
        let items: &[T] = bytemuck::try_cast_slice(file.bytes().get(bytes)?).ok()?;
        Some(Self {
            start: NonNull::from(items).cast(),
            len: items.len(),
            _owner: Owner::File(file.clone()),
        })
    }
}

impl<T> From<Vec<T>> for Items<T> {
    fn from(items: Vec<T>) -> Self {
        Self {
            start: NonNull::from(items.as_slice()).cast(),
            len: items.len(),
            _owner: Owner::Vec(items),
        }
    }
}

impl<T> Default for Items<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> Deref for Items<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        // SAFETY: `start` and `len` are those of a slice that the owner keeps where it is for as long as `self` lives:
        // the vector is not changed any more, and moving it moves no items; the map stays until its last owner is gone.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T: PartialEq> PartialEq for Items<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Eq> Eq for Items<T> {}

impl<T: std::fmt::Debug> std::fmt::Debug for Items<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

/// Asks the system for large pages where many items that are not written to yet will lie. It is advice: where it is not taken,
/// or not known, pages are small, and nothing else is different.
pub fn prefer_large_pages<T>(room: &mut [MaybeUninit<T>]) {
    #[cfg(target_os = "linux")]
    {
        // Of most processors.
        const PAGE: usize = 2 << 20;
        let range = room.as_mut_ptr_range();
        let start = range.start.addr().next_multiple_of(PAGE);
        let end = range.end.addr() / PAGE * PAGE;
        if start < end {
            // SAFETY: these pages are wholly within the room, which is ours alone, and the advice leaves what they hold.
            unsafe {
                let first = range.start.byte_add(start - range.start.addr());
                libc::madvise(first.cast(), end - start, libc::MADV_HUGEPAGE);
            }
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = room;
}

/// Very many items that are read here and there: in large pages, where the system has them, so that it finds each at once.
pub struct Large<T> {
    start: NonNull<T>,
    len: usize,
    /// Never touched again, but for being dropped. None of no items.
    _map: Option<MmapMut>,
    items: PhantomData<T>,
}

// SAFETY: it owns its items, and hands them out as a vector does.
unsafe impl<T: Send> Send for Large<T> {}
// SAFETY: likewise for sharing.
unsafe impl<T: Sync> Sync for Large<T> {}

impl<T: Zeroable + Copy> Large<T> {
    /// So many items, all zero.
    ///
    /// # Errors
    /// If the system has no memory for them.
    pub fn zeros(len: usize) -> io::Result<Self> {
        let bytes = (len.checked_mul(size_of::<T>())).ok_or(io::ErrorKind::OutOfMemory)?;
        if bytes == 0 {
            return Ok(Self::default());
        }
        let mut map = MmapMut::map_anon(bytes)?;
        // It is advice: where it is not taken, or not known, pages are small.
        #[cfg(target_os = "linux")]
        let _ = map.advise(memmap2::Advice::HugePage);
        let start: NonNull<T> = NonNull::from(&mut map[..]).cast();
        assert!(start.is_aligned(), "pages are aligned to all that is");
        Ok(Self {
            start,
            len,
            _map: Some(map),
            items: PhantomData,
        })
    }
}

impl<T> Default for Large<T> {
    fn default() -> Self {
        Self {
            start: NonNull::dangling(),
            len: 0,
            _map: None,
            items: PhantomData,
        }
    }
}

impl<T> Deref for Large<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        // SAFETY: the map is `len` items long, aligned, and its zeros are items, as `zeros` demands; it stays where it is
        // for as long as `self` lives, and none but `self` knows it. Of no items there is nothing to point to.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T> DerefMut for Large<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as above; `self` is borrowed for as long.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl<T: PartialEq> PartialEq for Large<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: std::fmt::Debug> std::fmt::Debug for Large<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_memory_is_zero_at_first_and_keeps_what_it_is_given() {
        for len in [0, 1, 5_000_000] {
            let mut large = Large::<u32>::zeros(len).expect("there is so much");
            assert_eq!(large.len(), len);
            assert!(large.iter().all(|&item| item == 0));
            for (i, item) in large.iter_mut().enumerate() {
                *item = i as u32;
            }
            assert!(large.iter().zip(0..).all(|(item, i)| *item == i));
        }
        assert!(Large::<u32>::zeros(usize::MAX).is_err());
    }

    #[test]
    fn large_pages_hold_what_small_ones_do() {
        for len in [0, 1, 5_000_000] {
            let mut items = Vec::with_capacity(len);
            prefer_large_pages(items.spare_capacity_mut());
            items.extend(0..len);
            assert!(items.iter().zip(0..).all(|(item, i)| *item == i));
        }
    }

    #[test]
    fn items_of_a_file_are_its_bytes() {
        let path = std::env::temp_dir().join(format!("mapped-{}", std::process::id()));
        let bytes: Vec<u8> = (0..64).collect();
        std::fs::write(&path, &bytes).expect("written");
        let file = Arc::new(MappedFile::open(&path).expect("mapped"));
        std::fs::remove_file(&path).expect("removed");
        let items = Items::<u32>::in_file(&file, 4..12).expect("two");
        drop(file);
        assert_eq!(*items, [0x0706_0504, 0x0b0a_0908]);
        let owned = Items::from(vec![0x0706_0504, 0x0b0a_0908]);
        assert_eq!(owned, items);
        assert!(Items::<u32>::default().is_empty());
    }

    #[test]
    fn what_does_not_fit_is_none() {
        let path = std::env::temp_dir().join(format!("mapped-odd-{}", std::process::id()));
        std::fs::write(&path, [1_u8; 16]).expect("written");
        let file = Arc::new(MappedFile::open(&path).expect("mapped"));
        std::fs::remove_file(&path).expect("removed");
        for bytes in [2..10, 0..6, 12..20, 20..24, usize::MAX - 3..usize::MAX] {
            assert!(
                Items::<u32>::in_file(&file, bytes.clone()).is_none(),
                "{bytes:?}"
            );
        }
        assert!(Items::<u32>::in_file(&file, 16..16).is_some_and(|none| none.is_empty()));
    }
}
