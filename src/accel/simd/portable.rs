//! The sixteen lanes in plain Rust: what the others must agree with.

use super::{FIELD_PADDING, FIELDS, FROM_HALF, LANES, Lanes, NARROW_FIELDS, Nibbles};

/// Needs nothing.
#[derive(Clone, Copy)]
pub(in crate::accel) struct Portable;

type Floats = [f32; LANES];
type Ints = [i32; LANES];

#[inline(always)]
fn each<T: Copy, U: Copy + Default>(
    a: [T; LANES],
    b: [T; LANES],
    f: impl Fn(T, T) -> U,
) -> [U; LANES] {
    let mut out = [U::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn bits(a: Floats, b: Floats, f: impl Fn(f32, f32) -> bool) -> u32 {
    let mut out = 0;
    for i in 0..LANES {
        out |= u32::from(f(a[i], b[i])) << i;
    }
    out
}

impl Lanes for Portable {
    type Floats = Floats;
    type Ints = Ints;

    #[inline(always)]
    fn floats(self, value: f32) -> Floats {
        [value; LANES]
    }
    #[inline(always)]
    fn ints(self, value: i32) -> Ints {
        [value; LANES]
    }
    #[inline(always)]
    fn load_ints(self, values: &Ints) -> Ints {
        *values
    }
    #[inline(always)]
    fn load(self, values: &Floats) -> Floats {
        *values
    }
    #[inline(always)]
    fn store(self, values: Floats, to: &mut Floats) {
        *to = values;
    }
    #[inline(always)]
    fn add(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, a: Floats, b: Floats, c: Floats) -> Floats {
        std::array::from_fn(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn sub_mul(self, c: Floats, a: Floats, b: Floats) -> Floats {
        std::array::from_fn(|i| (-a[i]).mul_add(b[i], c[i]))
    }
    #[inline(always)]
    fn min(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Floats, b: Floats) -> Floats {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn less(self, a: Floats, b: Floats) -> u32 {
        bits(a, b, |a, b| a < b)
    }
    #[inline(always)]
    fn less_equal(self, a: Floats, b: Floats) -> u32 {
        bits(a, b, |a, b| a <= b)
    }
    #[inline(always)]
    fn signs(self, four: [Floats; 4]) -> [u64; 2] {
        let mut signs = [0; 2];
        for (i, value) in four.as_flattened().iter().enumerate() {
            signs[0] |= u64::from(*value < 0.0) << i;
            signs[1] |= u64::from(*value > 0.0) << i;
        }
        signs
    }
    #[inline(always)]
    fn sqrt(self, a: Floats) -> Floats {
        a.map(f32::sqrt)
    }
    #[inline(always)]
    fn if_less(self, a: Floats, b: Floats, then: Floats, otherwise: Floats) -> Floats {
        let mut out = otherwise;
        for i in 0..LANES {
            if a[i] < b[i] {
                out[i] = then[i];
            }
        }
        out
    }
    #[inline(always)]
    fn add_ints(self, a: Ints, b: Ints) -> Ints {
        each(a, b, i32::wrapping_add)
    }
    #[inline(always)]
    fn and_ints(self, a: Ints, b: Ints) -> Ints {
        each(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn mul_ints(self, a: Ints, b: Ints) -> Ints {
        each(a, b, i32::wrapping_mul)
    }
    #[inline(always)]
    fn shift_right<const BY: u32>(self, a: Ints) -> Ints {
        a.map(|a| a >> BY)
    }
    #[inline(always)]
    fn to_floats(self, a: Ints) -> Floats {
        a.map(|a| a as f32)
    }
    #[inline(always)]
    fn abs(self, a: Floats) -> Floats {
        a.map(f32::abs)
    }
    #[inline(always)]
    fn floor(self, a: Floats) -> Floats {
        a.map(f32::floor)
    }
    #[inline(always)]
    fn to_ints(self, a: Floats) -> Ints {
        a.map(|a| a as i32)
    }
    #[inline(always)]
    fn select(self, bits: u32, a: Floats, b: Floats) -> Floats {
        std::array::from_fn(|i| if bits >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn of_bits(self, a: Ints) -> Floats {
        a.map(|a| f32::from_bits(a as u32))
    }
    #[inline(always)]
    fn of_halves(self, a: Ints) -> Floats {
        a.map(|a| {
            let size = f32::from_bits((a as u32 & 0x7fff) << 13) * FROM_HALF;
            f32::from_bits(size.to_bits() | (a as u32 & 0x8000) << 16)
        })
    }
    #[inline(always)]
    fn shift_right_unsigned<const BY: u32>(self, a: Ints) -> Ints {
        a.map(|a| (a as u32 >> BY) as i32)
    }
    #[inline(always)]
    fn gather(self, bytes: &[u8], at: Ints, bits: u32) -> Option<Ints> {
        let last = bytes.len().checked_sub(4)?;
        let is_set = |lane: usize| bits >> lane & 1 == 1;
        let is_there = |lane: usize| !is_set(lane) || at[lane] as u32 as usize <= last;
        (0..LANES).all(is_there).then(|| {
            std::array::from_fn(|lane| {
                if !is_set(lane) {
                    return 0;
                }
                let at = at[lane] as u32 as usize;
                i32::from_le_bytes(std::array::from_fn(|b| bytes[at + b]))
            })
        })
    }
    #[inline(always)]
    fn prefetch(self, _bytes: &[u8], _at: Ints) {}
    #[inline(always)]
    fn two(self, low: f32, high: f32) -> Floats {
        std::array::from_fn(|i| if i < LANES / 2 { low } else { high })
    }
    #[inline(always)]
    fn two_rows(self, a: Floats, pair: usize) -> [Floats; 2] {
        let at = |half: usize| std::array::from_fn(|i| a[8 * half + 2 * pair + i / 8]);
        [at(0), at(1)]
    }
    #[inline(always)]
    fn compress(self, a: Floats, bits: u32) -> Floats {
        let mut out = [0.0; LANES];
        let set = (0..LANES).filter(|lane| bits >> lane & 1 == 1);
        for (out, lane) in out.iter_mut().zip(set) {
            *out = a[lane];
        }
        out
    }
    #[inline(always)]
    fn expand(self, a: Floats, bits: u32) -> Floats {
        let mut out = [0.0; LANES];
        let set = (0..LANES).filter(|lane| bits >> lane & 1 == 1);
        for (value, lane) in a.into_iter().zip(set) {
            out[lane] = value;
        }
        out
    }
    #[inline(always)]
    fn bytes(self, bytes: &[u8; LANES]) -> Floats {
        bytes.map(f32::from)
    }
    #[inline(always)]
    fn fields(self, bytes: &[u8], rows: [usize; 2], width: u32) -> Ints {
        let fields = &FIELDS[width as usize];
        assert!(
            rows[0].max(rows[1]) + fields.middle + FIELD_PADDING <= bytes.len(),
            "fields beyond the end"
        );
        let mut out = [0; LANES];
        for (i, out) in out.iter_mut().enumerate() {
            let first = (i % 8) * width as usize;
            let at = rows[i / 8] + first / 8;
            let window =
                u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
            *out = ((window >> (first % 8)) & fields.mask) as i32;
        }
        out
    }
    #[inline(always)]
    fn narrow_fields(self, bytes: &[u8], at: usize, width: u32) -> Ints {
        let fields = &NARROW_FIELDS[width as usize];
        let all = u128::from_le_bytes(bytes[at..at + 16].try_into().expect("16 bytes"));
        let mut out = [0; LANES];
        for (i, out) in out.iter_mut().enumerate() {
            *out = ((all >> (i as u32 * width)) as u32 & fields.mask) as i32;
        }
        out
    }
    #[inline(always)]
    fn fours(self, values: &[u16], places: [usize; 4]) -> Ints {
        let mut out = [0; LANES];
        for (four, place) in out.chunks_exact_mut(4).zip(places) {
            for (out, value) in four.iter_mut().zip(&values[place..place + 4]) {
                *out = i32::from(*value);
            }
        }
        out
    }
    #[inline(always)]
    fn shorts(self, values: &[u16; LANES]) -> Ints {
        values.map(i32::from)
    }
    #[inline(always)]
    fn pick(self, numbers: &Nibbles, table: Floats) -> Floats {
        let mut out = [0.0; LANES];
        for (lane, out) in out.iter_mut().enumerate() {
            *out = table[usize::from(numbers.get(lane))];
        }
        out
    }
    #[inline(always)]
    fn next_in_row(self, a: Floats) -> Floats {
        let mut out = a;
        out[..7].copy_from_slice(&a[1..8]);
        out[8..15].copy_from_slice(&a[9..]);
        out
    }
    #[inline(always)]
    fn next_row(self, a: Floats, b: Floats) -> Floats {
        let mut out = b;
        out[..8].copy_from_slice(&a[8..]);
        out[8..].copy_from_slice(&b[..8]);
        out
    }
}
