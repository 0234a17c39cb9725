//! One channel of a texel in each of the four types, and arrays of them.

use half::f16;

use crate::types::DataType;

/// Arithmetic that each type has of its own; every reader and writer of Ptex must agree on it to the bit.
pub(crate) trait Sample: Copy + PartialEq + Send + Sync + 'static {
    /// Bytes in a file.
    const BYTES: usize;
    /// Integers are stored as differences.
    const DIFFERENCES: bool;

    fn read(bytes: &[u8]) -> Self;
    fn write(self, out: &mut Vec<u8>);
    /// In stored units.
    fn float(self) -> f32;
    /// From stored units; integers are cut.
    fn from_float(value: f32) -> Self;
    /// Halfway between two: integers are cut.
    fn half_sum(a: Self, b: Self) -> Self;
    /// The average of four, added in this order: integers are cut.
    fn quarter_sum(s: [Self; 4]) -> Self;
    /// Times `alpha` of the same texel, as a part of one.
    fn times_alpha(self, alpha: f32) -> Self;
    /// `self` plus a difference, wrapping; `from` is what came before.
    fn after(self, from: Self) -> Self;
    /// What has to be added to `from` to get here.
    fn difference(self, from: Self) -> Self;
    /// What an array is wrapped in.
    fn wrap(samples: Vec<Self>) -> Pixels;
    /// The array inside. All arrays of a file are of its type.
    fn of(pixels: &Pixels) -> &[Self];
}

/// Samples of one type: texel after texel, row 0 first, the channels of a texel side by side.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Pixels {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F16(Vec<f16>),
    F32(Vec<f32>),
}

/// Runs `$body` with `$samples` bound to the slice inside.
macro_rules! with_samples {
    ($pixels:expr, $samples:ident => $body:expr) => {
        match $pixels {
            $crate::sample::Pixels::U8($samples) => $body,
            $crate::sample::Pixels::U16($samples) => $body,
            $crate::sample::Pixels::F16($samples) => $body,
            $crate::sample::Pixels::F32($samples) => $body,
        }
    };
}
pub(crate) use with_samples;

/// Runs `$body` with `$sample` as the name of the type that holds `$data_type`.
macro_rules! with_type {
    ($data_type:expr, $sample:ident => $body:expr) => {
        match $data_type {
            $crate::types::DataType::U8 => {
                type $sample = u8;
                $body
            }
            $crate::types::DataType::U16 => {
                type $sample = u16;
                $body
            }
            $crate::types::DataType::F16 => {
                type $sample = half::f16;
                $body
            }
            $crate::types::DataType::F32 => {
                type $sample = f32;
                $body
            }
        }
    };
}
pub(crate) use with_type;

impl Pixels {
    /// From texels as they are in memory: little endian, channels side by side.
    pub(crate) fn from_bytes(bytes: &[u8], data_type: DataType) -> Self {
        with_type!(data_type, S => S::wrap(bytes.chunks_exact(S::BYTES).map(S::read).collect()))
    }

    /// From a block: channel after channel, perhaps as differences.
    pub(crate) fn from_planes(
        bytes: &[u8],
        data_type: DataType,
        channels: usize,
        differences: bool,
    ) -> Self {
        with_type!(data_type, S => S::wrap(from_planes::<S>(bytes, channels, differences)))
    }

    /// Bytes that the samples take.
    pub(crate) fn memory(&self) -> usize {
        with_samples!(self, s => size_of_val(s.as_slice()))
    }

    /// Appends samples `from` to `to` as bytes of the file's type, little endian.
    pub(crate) fn write(&self, from: usize, to: usize, out: &mut Vec<u8>) {
        with_samples!(self, s => for sample in &s[from..to] {
            sample.write(out);
        });
    }
}

fn from_planes<S: Sample>(bytes: &[u8], channels: usize, differences: bool) -> Vec<S> {
    let zero = S::read(&[0; 4]);
    let texels = bytes.len() / S::BYTES / channels;
    let mut out = vec![zero; texels * channels];
    let mut before = zero;
    for (channel, plane) in bytes.chunks_exact((texels * S::BYTES).max(1)).enumerate() {
        let places = out[channel..].iter_mut().step_by(channels);
        for (place, bytes) in places.zip(plane.chunks_exact(S::BYTES)) {
            *place = S::read(bytes);
            if differences {
                *place = place.after(before);
                before = *place;
            }
        }
    }
    out
}

/// The bytes of a block before they are compressed: channel after channel, integers as differences.
pub(crate) fn to_planes<S: Sample>(samples: &[S], channels: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(samples.len() * S::BYTES);
    let mut before = S::read(&[0; 4]);
    for channel in 0..channels {
        for &value in samples.iter().skip(channel).step_by(channels) {
            if S::DIFFERENCES {
                value.difference(before).write(&mut out);
                before = value;
            } else {
                value.write(&mut out);
            }
        }
    }
    out
}

macro_rules! integer {
    ($t:ty, $variant:ident) => {
        impl Sample for $t {
            const BYTES: usize = size_of::<$t>();
            const DIFFERENCES: bool = true;

            fn read(bytes: &[u8]) -> Self {
                let mut le = [0; size_of::<$t>()];
                le.copy_from_slice(&bytes[..size_of::<$t>()]);
                Self::from_le_bytes(le)
            }
            fn write(self, out: &mut Vec<u8>) {
                out.extend(self.to_le_bytes());
            }
            fn float(self) -> f32 {
                f32::from(self)
            }
            fn from_float(value: f32) -> Self {
                value as Self
            }
            fn half_sum(a: Self, b: Self) -> Self {
                ((u32::from(a) + u32::from(b)) >> 1) as Self
            }
            fn quarter_sum(s: [Self; 4]) -> Self {
                (s.into_iter().map(u32::from).sum::<u32>() >> 2) as Self
            }
            fn times_alpha(self, alpha: f32) -> Self {
                // As it is done everywhere: alpha becomes a part of one first, in single precision.
                (f32::from(self) * (alpha * (1.0 / f32::from(Self::MAX)))) as Self
            }
            fn after(self, from: Self) -> Self {
                from.wrapping_add(self)
            }
            fn difference(self, from: Self) -> Self {
                self.wrapping_sub(from)
            }
            fn wrap(samples: Vec<Self>) -> Pixels {
                Pixels::$variant(samples)
            }
            fn of(pixels: &Pixels) -> &[Self] {
                match pixels {
                    Pixels::$variant(samples) => samples,
                    _ => unreachable!("a file has one type of data"),
                }
            }
        }
    };
}

integer!(u8, U8);
integer!(u16, U16);

macro_rules! float {
    ($t:ty, $variant:ident, $to:expr, $from:expr) => {
        impl Sample for $t {
            const BYTES: usize = size_of::<$t>();
            const DIFFERENCES: bool = false;

            fn read(bytes: &[u8]) -> Self {
                let mut le = [0; size_of::<$t>()];
                le.copy_from_slice(&bytes[..size_of::<$t>()]);
                Self::from_le_bytes(le)
            }
            fn write(self, out: &mut Vec<u8>) {
                out.extend(self.to_le_bytes());
            }
            fn float(self) -> f32 {
                $to(self)
            }
            fn from_float(value: f32) -> Self {
                $from(value)
            }
            fn half_sum(a: Self, b: Self) -> Self {
                $from(0.5 * (a.float() + b.float()))
            }
            fn quarter_sum([a, b, c, d]: [Self; 4]) -> Self {
                $from(0.25 * (((a.float() + b.float()) + c.float()) + d.float()))
            }
            fn times_alpha(self, alpha: f32) -> Self {
                $from(self.float() * alpha)
            }
            fn after(self, _: Self) -> Self {
                self
            }
            fn difference(self, _: Self) -> Self {
                self
            }
            fn wrap(samples: Vec<Self>) -> Pixels {
                Pixels::$variant(samples)
            }
            fn of(pixels: &Pixels) -> &[Self] {
                match pixels {
                    Pixels::$variant(samples) => samples,
                    _ => unreachable!("a file has one type of data"),
                }
            }
        }
    };
}

float!(f16, F16, f16::to_f32, to_half);
float!(f32, F32, std::convert::identity, std::convert::identity);

/// Rounds to a half float as Ptex does: half a unit of the last place is added and the rest cut, so that ties go away
/// from zero; too large becomes infinity, and -0 becomes 0.
pub(crate) fn to_half(value: f32) -> f16 {
    let bits = value.to_bits();
    let sign = (bits >> 16 & 0x8000) as u16;
    let magnitude = bits & 0x7fff_ffff;
    // The exponent with a half float's bias, still in the place of a single float's.
    let rebiased = i64::from(magnitude) - (112 << 23);
    let half = if magnitude == 0 {
        return f16::from_bits(0);
    } else if magnitude > 0x7f80_0000 {
        // Not a number stays that, whatever of its payload is lost.
        0x7c00 | ((magnitude >> 13 & 0x3ff) as u16).max(1)
    } else if rebiased < 1 << 23 {
        // Subnormal: a count of 2^-24.
        (f64::from(f32::from_bits(magnitude)) * 16_777_216.0 + 0.5) as u16
    } else {
        ((rebiased + 0x1000) >> 13).min(0x7c00) as u16
    };
    f16::from_bits(sign | half)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_round_away_from_zero() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            let back = to_half(half.to_f32());
            if bits == 0x8000 {
                assert_eq!(back.to_bits(), 0);
            } else if half.is_nan() {
                assert!(back.is_nan());
            } else {
                assert_eq!(back, half, "{bits:#x}");
            }
        }
        for low in (0..0x7bff_u16).step_by(7) {
            let (a, b) = (f16::from_bits(low), f16::from_bits(low + 1));
            let middle = 0.5 * (a.to_f32() + b.to_f32());
            assert_eq!(to_half(middle), b);
            assert_eq!(to_half(-middle), -b);
            assert_eq!(to_half(middle.next_down()), a, "{low:#x}");
        }
        assert_eq!(to_half(65519.0), f16::MAX);
        assert_eq!(to_half(65520.0), f16::INFINITY);
        assert_eq!(to_half(f32::MAX), f16::INFINITY);
        assert_eq!(to_half(f32::NEG_INFINITY), f16::NEG_INFINITY);
        assert!(to_half(f32::NAN).is_nan());
    }

    #[test]
    fn planes_come_back() {
        let samples: Vec<u16> = (0..60).map(|i| (i * 40503_u32) as u16).collect();
        let planes = to_planes(&samples, 3);
        assert_eq!(
            Pixels::from_planes(&planes, DataType::U16, 3, true),
            Pixels::U16(samples)
        );
        let samples: Vec<f32> = (0..20).map(|i| i as f32 / 3.0).collect();
        let planes = to_planes(&samples, 5);
        assert_eq!(
            Pixels::from_planes(&planes, DataType::F32, 5, false),
            Pixels::F32(samples)
        );
    }
}
