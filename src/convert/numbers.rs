//! Texels as numbers: out of a file's type and into it, and from one meaning to another.

use half::f16;
use relievo_ptex::DataType;

use crate::image::{linear_from_srgb, srgb_from_linear};

/// Appends the numbers that bytes of a type stand for, 1 being what is stored as 255 or 65535.
pub(super) fn numbers(data_type: DataType, bytes: &[u8], out: &mut Vec<f32>) {
    let one = data_type.one();
    match data_type {
        DataType::U8 => out.extend(bytes.iter().map(|&n| f32::from(n) / one)),
        DataType::U16 => {
            let (all, _) = bytes.as_chunks();
            out.extend(all.iter().map(|&n| f32::from(u16::from_le_bytes(n)) / one));
        }
        DataType::F16 => {
            let (all, _) = bytes.as_chunks();
            out.extend(all.iter().map(|&n| f16::from_le_bytes(n).to_f32()));
        }
        DataType::F32 => {
            let (all, _) = bytes.as_chunks();
            out.extend(all.iter().map(|&n| f32::from_le_bytes(n)));
        }
    }
}

/// Appends the bytes that a type has for numbers. Integers are rounded and clipped, and what is not a number is 0;
/// finite numbers become finite halves.
pub(crate) fn store(data_type: DataType, numbers: &[f32], out: &mut Vec<u8>) {
    // A cast clips by itself.
    let scaled = |n: f32| n * data_type.one() + 0.5;
    match data_type {
        DataType::U8 => out.extend(numbers.iter().map(|&n| scaled(n) as u8)),
        DataType::U16 => {
            out.extend(
                numbers
                    .iter()
                    .flat_map(|&n| (scaled(n) as u16).to_le_bytes()),
            );
        }
        DataType::F16 => out.extend(numbers.iter().flat_map(|&n| {
            let n = if n.is_finite() {
                n.clamp(f16::MIN.to_f32(), f16::MAX.to_f32())
            } else {
                n
            };
            f16::from_f32(n).to_le_bytes()
        })),
        DataType::F32 => out.extend(numbers.iter().flat_map(|n| n.to_le_bytes())),
    }
}

/// The channels of a texel that are colours: the first three that are not alpha.
pub(super) fn colors(channels: usize, alpha: Option<usize>) -> impl Iterator<Item = usize> {
    (0..channels).filter(move |c| Some(*c) != alpha).take(3)
}

/// Whether a file of these channels has colours by the sRGB curve, unless its numbers are raw.
pub(super) fn is_encoded(data_type: DataType, channels: usize, alpha: Option<usize>) -> bool {
    data_type == DataType::U8 && colors(channels, alpha).count() == 3
}

/// What happens to colours on the way from one kind of file to another.
#[derive(Debug, Clone)]
pub(super) struct Recoding {
    channels: usize,
    colors: Vec<usize>,
    change: Option<fn(f32) -> f32>,
}

impl Recoding {
    /// For texels that are encoded by the sRGB curve, or shall be.
    pub(super) fn new(
        channels: usize,
        alpha: Option<usize>,
        from_encoded: bool,
        to_encoded: bool,
    ) -> Self {
        Self {
            channels,
            colors: colors(channels, alpha).collect(),
            change: match (from_encoded, to_encoded) {
                (true, false) => Some(linear_from_srgb),
                (false, true) => Some(srgb_from_linear),
                _ => None,
            },
        }
    }

    /// Changes whole texels.
    pub(super) fn apply(&self, texels: &mut [f32]) {
        let Some(change) = self.change else { return };
        for texel in texels.chunks_exact_mut(self.channels) {
            for &c in &self.colors {
                texel[c] = change(texel[c]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_stored_comes_back() {
        let types = [DataType::U8, DataType::U16, DataType::F16, DataType::F32];
        for data_type in types {
            let bytes: Vec<u8> = match data_type {
                DataType::U8 => (0..=255).collect(),
                DataType::U16 => (0..=u16::MAX).flat_map(u16::to_le_bytes).collect(),
                DataType::F16 => (0..f16::INFINITY.to_bits())
                    .flat_map(u16::to_le_bytes)
                    .collect(),
                DataType::F32 => [0.1_f32, -3.0, 1e30, f32::INFINITY]
                    .into_iter()
                    .flat_map(f32::to_le_bytes)
                    .collect(),
            };
            let (mut middle, mut back) = (Vec::new(), Vec::new());
            numbers(data_type, &bytes, &mut middle);
            store(data_type, &middle, &mut back);
            assert_eq!(back, bytes, "{data_type:?}");
        }
    }

    #[test]
    fn encoded_bytes_survive_linear_light() {
        let bytes: Vec<u8> = (0..=254).collect();
        let (mut texels, mut back) = (Vec::new(), Vec::new());
        numbers(DataType::U8, &bytes, &mut texels);
        let wanted = texels.clone();
        Recoding::new(3, None, true, false).apply(&mut texels);
        assert_ne!(texels, wanted);
        Recoding::new(3, None, false, true).apply(&mut texels);
        store(DataType::U8, &texels, &mut back);
        assert_eq!(back, bytes);
    }

    #[test]
    fn numbers_out_of_range_are_clipped() {
        let mut bytes = Vec::new();
        store(DataType::U8, &[-1.0, 2.0, f32::NAN], &mut bytes);
        assert_eq!(bytes, [0, 255, 0]);
        bytes.clear();
        store(DataType::F16, &[1e9], &mut bytes);
        assert_eq!(bytes, f16::MAX.to_le_bytes());
    }
}
