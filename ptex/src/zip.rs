//! zlib streams whose expanded size is known: how nearly everything in a file is stored.

use flate2::{Compress, Compression, Decompress, FlushCompress, FlushDecompress, Status};

use crate::error::{Error, Result};

/// How many bytes deflate can make of one at most: a match of 258 bytes takes two bits.
pub(crate) const MOST: u64 = 1032;

/// Expands a whole stream to exactly `size` bytes, its checksum included. A size that the stream cannot have is found
/// before memory is taken for it.
pub(crate) fn inflate(stream: &[u8], size: u64) -> Result<Vec<u8>> {
    expandable(stream.len() as u64, size)?;
    let mut out = Vec::with_capacity(size as usize);
    let mut state = Decompress::new(true);
    loop {
        let before = (state.total_in(), state.total_out());
        let rest = &stream[before.0 as usize..];
        let status = state
            .decompress_vec(rest, &mut out, FlushDecompress::Finish)
            .map_err(|e| Error::malformed(format!("a compressed block is corrupt ({e})")))?;
        if status == Status::StreamEnd {
            break;
        }
        if before == (state.total_in(), state.total_out()) {
            let wrong = if out.len() as u64 == size {
                format!("a compressed block holds more than the {size} bytes that it should")
            } else {
                format!(
                    "a compressed block ends after {} of {size} bytes",
                    out.len()
                )
            };
            return Err(Error::malformed(wrong));
        }
    }
    if out.len() as u64 != size {
        return Err(Error::malformed(format!(
            "a compressed block holds {} bytes where {size} are needed",
            out.len()
        )));
    }
    Ok(out)
}

/// Whether a stream of `stored` bytes can expand to `size` bytes at all.
pub(crate) fn expandable(stored: u64, size: u64) -> Result<()> {
    if size > stored.saturating_mul(MOST) {
        return Err(Error::malformed(format!(
            "a compressed block of {stored} bytes cannot hold {size} bytes"
        )));
    }
    Ok(())
}

/// One zlib stream at zlib's default level.
pub(crate) fn deflate(bytes: &[u8]) -> Vec<u8> {
    deflate_at(bytes, Compression::default())
}

/// One zlib stream, quickly made.
pub(crate) fn deflate_fast(bytes: &[u8]) -> Vec<u8> {
    deflate_at(bytes, Compression::fast())
}

fn deflate_at(bytes: &[u8], level: Compression) -> Vec<u8> {
    let mut state = Compress::new(level, true);
    let mut out = Vec::with_capacity(bytes.len() / 2 + 64);
    loop {
        let rest = &bytes[state.total_in() as usize..];
        let status = state
            .compress_vec(rest, &mut out, FlushCompress::Finish)
            .expect("compressing asks nothing of its input");
        if status == Status::StreamEnd {
            return out;
        }
        out.reserve(out.len().max(64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_has_its_size_and_its_checksum() {
        let bytes: Vec<u8> = (0..1000_u32).map(|i| (i * i % 251) as u8).collect();
        let stream = deflate(&bytes);
        assert_eq!(inflate(&stream, 1000).unwrap(), bytes);
        assert!(inflate(&stream, 999).is_err());
        assert!(inflate(&stream, 1001).is_err());
        assert!(inflate(&stream[..stream.len() - 1], 1000).is_err());
        let mut wrong = stream;
        *wrong.last_mut().unwrap() ^= 1;
        assert!(inflate(&wrong, 1000).is_err());
        let zeros = deflate(&vec![0; 1 << 22]);
        assert_eq!(inflate(&zeros, 1 << 22).unwrap().len(), 1 << 22);
        assert!(inflate(&[], 1).is_err());
        assert!(inflate(&deflate(&[]), 0).unwrap().is_empty());
    }
}
