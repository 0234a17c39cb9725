//! Meta data: named strings and arrays of numbers.

use crate::error::{Error, Result};
use crate::layout::Bytes;

/// Entries of more bytes than this are stored each on its own.
pub(crate) const LARGE: usize = 1024;
/// The longest key: its size with the NUL behind it is stored in a byte.
pub(crate) const MAX_KEY: usize = 254;

/// What an entry of the meta data holds.
#[derive(Clone, Debug, PartialEq)]
pub enum MetaValue {
    /// Text. What is not UTF-8 in a file is read as U+FFFD.
    String(String),
    /// Signed bytes.
    I8(Vec<i8>),
    /// 16-bit integers.
    I16(Vec<i16>),
    /// 32-bit integers.
    I32(Vec<i32>),
    /// Single floats.
    F32(Vec<f32>),
    /// Double floats.
    F64(Vec<f64>),
}

impl MetaValue {
    /// Its type's name: `string`, `int8`, `int16`, `int32`, `float` or `double`.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::String(_) => "string",
            Self::I8(_) => "int8",
            Self::I16(_) => "int16",
            Self::I32(_) => "int32",
            Self::F32(_) => "float",
            Self::F64(_) => "double",
        }
    }

    /// Numbers in the array, or bytes of the string with the NUL that ends it.
    #[must_use]
    pub fn count(&self) -> usize {
        match self {
            Self::String(s) => s.len() + 1,
            Self::I8(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    fn tag(&self) -> u8 {
        match self {
            Self::String(_) => 0,
            Self::I8(_) => 1,
            Self::I16(_) => 2,
            Self::I32(_) => 3,
            Self::F32(_) => 4,
            Self::F64(_) => 5,
        }
    }

    pub(crate) fn parse(key: &str, tag: u8, bytes: &[u8]) -> Result<Self> {
        fn numbers<T, const N: usize>(
            key: &str,
            bytes: &[u8],
            read: fn([u8; N]) -> T,
        ) -> Result<Vec<T>> {
            let (all, rest) = bytes.as_chunks::<N>();
            if !rest.is_empty() {
                return Err(Error::malformed(format!(
                    "meta data {key:?} has {} bytes, which is no multiple of {N}",
                    bytes.len()
                )));
            }
            Ok(all.iter().map(|bytes| read(*bytes)).collect())
        }
        Ok(match tag {
            0 => {
                let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
                Self::String(String::from_utf8_lossy(text).into_owned())
            }
            1 => Self::I8(numbers(key, bytes, i8::from_le_bytes)?),
            2 => Self::I16(numbers(key, bytes, i16::from_le_bytes)?),
            3 => Self::I32(numbers(key, bytes, i32::from_le_bytes)?),
            4 => Self::F32(numbers(key, bytes, f32::from_le_bytes)?),
            5 => Self::F64(numbers(key, bytes, f64::from_le_bytes)?),
            n => {
                return Err(Error::malformed(format!(
                    "meta data {key:?} has type {n}; 0 to 5 are known"
                )));
            }
        })
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        match self {
            Self::String(s) => [s.as_bytes(), &[0]].concat(),
            Self::I8(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Self::I16(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Self::I32(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Self::F32(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
            Self::F64(v) => v.iter().flat_map(|n| n.to_le_bytes()).collect(),
        }
    }
}

/// The meta data of a file, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Meta {
    entries: Vec<(String, MetaValue)>,
}

impl Meta {
    /// The entry of that name.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&MetaValue> {
        self.iter().find(|(k, _)| *k == key).map(|(_, value)| value)
    }

    /// All entries.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &MetaValue)> {
        self.entries
            .iter()
            .map(|(key, value)| (key.as_str(), value))
    }

    /// Entries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there is no entry.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Adds an entry, or replaces the one of that name in its place.
    pub fn set(&mut self, key: impl Into<String>, value: MetaValue) {
        let key = key.into();
        match self.entries.iter_mut().find(|(k, _)| *k == key) {
            Some((_, old)) => *old = value,
            None => self.entries.push((key, value)),
        }
    }

    /// Adds the entries of an expanded block.
    pub(crate) fn read(&mut self, bytes: &[u8]) -> Result<()> {
        let mut r = Bytes(bytes);
        while !r.0.is_empty() {
            let (key, tag, size) = head(&mut r)?;
            let data = r.take(size as usize)?;
            let value = MetaValue::parse(&key, tag, data)?;
            self.set(key, value);
        }
        Ok(())
    }
}

/// A large entry, as the block of their headers tells it.
pub(crate) struct LargeEntry {
    pub(crate) key: String,
    pub(crate) tag: u8,
    pub(crate) size: u32,
    pub(crate) zip_size: u32,
}

pub(crate) fn read_large(bytes: &[u8]) -> Result<Vec<LargeEntry>> {
    let mut r = Bytes(bytes);
    let mut entries = Vec::new();
    while !r.0.is_empty() {
        let (key, tag, size) = head(&mut r)?;
        entries.push(LargeEntry {
            key,
            tag,
            size,
            zip_size: r.u32()?,
        });
    }
    Ok(entries)
}

fn head(r: &mut Bytes<'_>) -> Result<(String, u8, u32)> {
    let size = r.u8()?;
    let key = r.take(usize::from(size))?;
    let key = key.strip_suffix(&[0]).unwrap_or(key);
    let key = String::from_utf8_lossy(key).into_owned();
    Ok((key, r.u8()?, r.u32()?))
}

/// What stands before an entry's data, or its compressed size.
pub(crate) fn write_head(key: &str, value: &MetaValue, size: usize, out: &mut Vec<u8>) {
    debug_assert!(key.len() <= MAX_KEY, "a key of {} bytes", key.len());
    out.push(key.len() as u8 + 1);
    out.extend(key.as_bytes());
    out.push(0);
    out.push(value.tag());
    out.extend((size as u32).to_le_bytes());
}
