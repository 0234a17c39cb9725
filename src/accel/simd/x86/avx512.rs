//! One register of sixteen.

use std::arch::x86_64::*;

use super::{Avx512, four_places, prefetch_all, windows};
use crate::accel::simd::{LANES, Lanes, NARROW_FIELDS, Nibbles};

impl Avx512 {
    /// Bits which as an integer are below zero, zero, or above, where the number is.
    #[inline(always)]
    fn signed(self, a: __m512) -> __m512i {
        // The sum of zeros of either sign is the positive one.
        op!(_mm512_castps_si512(_mm512_add_ps(a, _mm512_setzero_ps())))
    }
}

impl Lanes for Avx512 {
    type Floats = __m512;
    type Ints = __m512i;

    #[inline(always)]
    fn floats(self, value: f32) -> __m512 {
        op!(_mm512_set1_ps(value))
    }
    #[inline(always)]
    fn ints(self, value: i32) -> __m512i {
        op!(_mm512_set1_epi32(value))
    }
    #[inline(always)]
    fn load_ints(self, values: &[i32; LANES]) -> __m512i {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_loadu_si512(values.as_ptr().cast()) }
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> __m512 {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_loadu_ps(values.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, values: __m512, to: &mut [f32; LANES]) {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), values) }
    }
    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_add_ps(a, b))
    }
    #[inline(always)]
    fn sub(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_sub_ps(a, b))
    }
    #[inline(always)]
    fn mul(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_mul_ps(a, b))
    }
    #[inline(always)]
    fn div(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_div_ps(a, b))
    }
    #[inline(always)]
    fn mul_add(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        op!(_mm512_fmadd_ps(a, b, c))
    }
    #[inline(always)]
    fn sub_mul(self, c: __m512, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_fnmadd_ps(a, b, c))
    }
    #[inline(always)]
    fn min(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_min_ps(a, b))
    }
    #[inline(always)]
    fn max(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_max_ps(a, b))
    }
    #[inline(always)]
    fn less(self, a: __m512, b: __m512) -> u32 {
        u32::from(op!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b)))
    }
    #[inline(always)]
    fn less_equal(self, a: __m512, b: __m512) -> u32 {
        u32::from(op!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)))
    }
    #[inline(always)]
    fn signs(self, [a, b, c, d]: [__m512; 4]) -> [u64; 2] {
        let (a, b) = (self.signed(a), self.signed(b));
        let (c, d) = (self.signed(c), self.signed(d));
        op!({
            // Saturating: what is below or above zero remains so.
            let all = _mm512_packs_epi16(_mm512_packs_epi32(a, b), _mm512_packs_epi32(c, d));
            // They were packed by quarters of registers.
            let order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
            let all = _mm512_permutexvar_epi32(order, all);
            let below = _mm512_movepi8_mask(all);
            [below, _mm512_test_epi8_mask(all, all) & !below]
        })
    }
    #[inline(always)]
    fn sqrt(self, a: __m512) -> __m512 {
        op!(_mm512_sqrt_ps(a))
    }
    #[inline(always)]
    fn if_less(self, a: __m512, b: __m512, then: __m512, otherwise: __m512) -> __m512 {
        op!(_mm512_mask_blend_ps(
            _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b),
            otherwise,
            then
        ))
    }
    #[inline(always)]
    fn add_ints(self, a: __m512i, b: __m512i) -> __m512i {
        op!(_mm512_add_epi32(a, b))
    }
    #[inline(always)]
    fn and_ints(self, a: __m512i, b: __m512i) -> __m512i {
        op!(_mm512_and_si512(a, b))
    }
    #[inline(always)]
    fn mul_ints(self, a: __m512i, b: __m512i) -> __m512i {
        op!(_mm512_mullo_epi32(a, b))
    }
    #[inline(always)]
    fn shift_right<const BY: u32>(self, a: __m512i) -> __m512i {
        op!(_mm512_srai_epi32::<BY>(a))
    }
    #[inline(always)]
    fn to_floats(self, a: __m512i) -> __m512 {
        op!(_mm512_cvtepi32_ps(a))
    }
    #[inline(always)]
    fn abs(self, a: __m512) -> __m512 {
        op!(_mm512_abs_ps(a))
    }
    #[inline(always)]
    fn floor(self, a: __m512) -> __m512 {
        op!(_mm512_roundscale_ps::<
            { _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC },
        >(a))
    }
    #[inline(always)]
    fn to_ints(self, a: __m512) -> __m512i {
        op!(_mm512_cvttps_epi32(a))
    }
    #[inline(always)]
    fn select(self, bits: u32, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_mask_blend_ps(bits as u16, b, a))
    }
    #[inline(always)]
    fn of_bits(self, a: __m512i) -> __m512 {
        op!(_mm512_castsi512_ps(a))
    }
    #[inline(always)]
    fn of_halves(self, a: __m512i) -> __m512 {
        op!(_mm512_cvtph_ps(_mm512_cvtepi32_epi16(a)))
    }
    #[inline(always)]
    fn shift_right_unsigned<const BY: u32>(self, a: __m512i) -> __m512i {
        op!(_mm512_srli_epi32::<BY>(a))
    }
    #[inline(always)]
    fn gather(self, bytes: &[u8], at: __m512i, bits: u32) -> Option<__m512i> {
        let last = u32::try_from(bytes.len().checked_sub(4)?).unwrap_or(u32::MAX);
        let bits = bits as u16;
        let beyond = op!(_mm512_mask_cmpgt_epu32_mask(
            bits,
            at,
            _mm512_set1_epi32(last as i32)
        ));
        // Offsets are signed to the instruction.
        if beyond != 0 || last > i32::MAX as u32 {
            return None;
        }
        let zero = op!(_mm512_setzero_si512());
        // SAFETY: the token says that the instructions are there; all four bytes from each offset are whose bit is set.
        Some(unsafe { _mm512_mask_i32gather_epi32::<1>(zero, bits, at, bytes.as_ptr().cast()) })
    }
    #[inline(always)]
    fn prefetch(self, bytes: &[u8], at: __m512i) {
        let mut all = [0; LANES];
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_storeu_si512(all.as_mut_ptr().cast(), at) };
        prefetch_all(bytes, &all);
    }
    #[inline(always)]
    fn two(self, low: f32, high: f32) -> __m512 {
        op!(_mm512_mask_blend_ps(
            0xff00,
            _mm512_set1_ps(low),
            _mm512_set1_ps(high)
        ))
    }
    #[inline(always)]
    fn two_rows(self, a: __m512, pair: usize) -> [__m512; 2] {
        op!({
            let first = _mm512_set1_epi32(2 * pair as i32);
            let row = _mm512_setr_epi32(0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1);
            let low = _mm512_add_epi32(first, row);
            let high = _mm512_add_epi32(low, _mm512_set1_epi32(8));
            [
                _mm512_permutexvar_ps(low, a),
                _mm512_permutexvar_ps(high, a),
            ]
        })
    }
    #[inline(always)]
    fn compress(self, a: __m512, bits: u32) -> __m512 {
        op!(_mm512_maskz_compress_ps(bits as u16, a))
    }
    #[inline(always)]
    fn expand(self, a: __m512, bits: u32) -> __m512 {
        op!(_mm512_maskz_expand_ps(bits as u16, a))
    }
    #[inline(always)]
    fn bytes(self, bytes: &[u8; LANES]) -> __m512 {
        // SAFETY: the token says that the instructions are there; 16 bytes are.
        unsafe { _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128(bytes.as_ptr().cast()))) }
    }
    #[inline(always)]
    fn fields(self, bytes: &[u8], rows: [usize; 2], width: u32) -> __m512i {
        let (fields, [a, b, c, d]) = windows(bytes, rows, width);
        // SAFETY: the token says that the instructions are there; `windows` has seen to the 16 bytes of each place, and
        // the tables are as long as what is loaded of them.
        unsafe {
            let low = _mm256_inserti128_si256::<1>(
                _mm256_castsi128_si256(_mm_loadu_si128(a)),
                _mm_loadu_si128(b),
            );
            let high = _mm256_inserti128_si256::<1>(
                _mm256_castsi128_si256(_mm_loadu_si128(c)),
                _mm_loadu_si128(d),
            );
            let all = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(low), high);
            let shuffle =
                _mm512_broadcast_i64x4(_mm256_loadu_si256(fields.shuffle.as_ptr().cast()));
            let shift = _mm512_broadcast_i64x4(_mm256_loadu_si256(fields.shift.as_ptr().cast()));
            let here = _mm512_srlv_epi32(_mm512_shuffle_epi8(all, shuffle), shift);
            _mm512_and_si512(here, _mm512_set1_epi32(fields.mask as i32))
        }
    }
    #[inline(always)]
    fn narrow_fields(self, bytes: &[u8], at: usize, width: u32) -> __m512i {
        let fields = &NARROW_FIELDS[width as usize];
        let bytes = &bytes[at..at + 16];
        // SAFETY: the token says that the instructions are there; the 16 bytes are, and the tables have 64.
        unsafe {
            let all = _mm512_broadcast_i32x4(_mm_loadu_si128(bytes.as_ptr().cast()));
            let shuffle = _mm512_loadu_si512(fields.shuffle.as_ptr().cast());
            let shift = _mm512_loadu_si512(fields.shift.as_ptr().cast());
            let here = _mm512_srlv_epi32(_mm512_shuffle_epi8(all, shuffle), shift);
            _mm512_and_si512(here, _mm512_set1_epi32(fields.mask as i32))
        }
    }
    #[inline(always)]
    fn fours(self, values: &[u16], places: [usize; 4]) -> __m512i {
        let all = four_places(values, places);
        op!(_mm512_cvtepu16_epi32(_mm256_set_m128i(all[1], all[0])))
    }
    #[inline(always)]
    fn shorts(self, values: &[u16; LANES]) -> __m512i {
        // SAFETY: the token says that the instructions are there; 32 bytes are.
        unsafe { _mm512_cvtepu16_epi32(_mm256_loadu_si256(values.as_ptr().cast())) }
    }
    #[inline(always)]
    fn pick(self, numbers: &Nibbles, table: __m512) -> __m512 {
        op!({
            let both = _mm512_set1_epi64(i64::from_le_bytes(numbers.0));
            let shift = _mm512_setr_epi32(0, 0, 4, 4, 8, 8, 12, 12, 16, 16, 20, 20, 24, 24, 28, 28);
            // Of each number in a lane the lowest four bits count.
            _mm512_permutexvar_ps(_mm512_srlv_epi32(both, shift), table)
        })
    }
    #[inline(always)]
    fn next_in_row(self, a: __m512) -> __m512 {
        op!({
            let from = _mm512_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7, 9, 10, 11, 12, 13, 14, 15, 15);
            _mm512_permutexvar_ps(from, a)
        })
    }
    #[inline(always)]
    fn next_row(self, a: __m512, b: __m512) -> __m512 {
        op!(_mm512_shuffle_f32x4::<0b01_00_11_10>(a, b))
    }
}
