//! The sixteen lanes on x86-64: one register of AVX-512, or two of AVX2.

use std::arch::x86_64::*;

use super::{Body, FIELD_PADDING, FIELDS, FROM_HALF, Fields, LANES, Lanes, NARROW_FIELDS, Nibbles};

/// Exists only while code for AVX2 runs.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// Exists only while code for AVX-512 (F, BW, DQ, VL) runs.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

/// Whether the processor has what [`run_avx512`] asks for.
pub(super) fn has_avx512() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// # Safety
/// The processor must have AVX2.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn run_avx2<B: Body>(body: B) -> B::Output {
    body.run(Avx2(()))
}

/// # Safety
/// The processor must have AVX-512 F, BW, DQ and VL, BMI 1 and 2, and the counts of bits that come with them.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn run_avx512<B: Body>(body: B) -> B::Output {
    body.run(Avx512(()))
}

/// An operation on registers alone.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: a token of the instruction set is at hand, so the processor has it. No memory is touched.
        unsafe { $e }
    };
}

/// The fields' description, and the four places that 16 bytes are loaded from, all within `bytes`.
#[inline(always)]
fn windows(bytes: &[u8], rows: [usize; 2], width: u32) -> (&'static Fields, [*const __m128i; 4]) {
    let fields = &FIELDS[width as usize];
    assert!(
        rows[0].max(rows[1]) + fields.middle + FIELD_PADDING <= bytes.len(),
        "fields beyond the end"
    );
    let at = |row: usize| bytes.as_ptr().wrapping_add(row).cast::<__m128i>();
    let places = [
        at(rows[0]),
        at(rows[0] + fields.middle),
        at(rows[1]),
        at(rows[1] + fields.middle),
    ];
    (fields, places)
}

/// Four shorts from each of four places, two places to a register.
#[inline(always)]
fn four_places(values: &[u16], [a, b, c, d]: [usize; 4]) -> [__m128i; 2] {
    let (a, b) = (four(values, a), four(values, b));
    let (c, d) = (four(values, c), four(values, d));
    // SAFETY: every x86-64 processor has SSE2; no memory is touched.
    unsafe { [_mm_unpacklo_epi64(a, b), _mm_unpacklo_epi64(c, d)] }
}

#[inline(always)]
fn four(values: &[u16], place: usize) -> __m128i {
    let four = &values[place..place + 4];
    // SAFETY: every x86-64 processor has SSE2; 8 bytes are there.
    unsafe { _mm_loadl_epi64(four.as_ptr().cast()) }
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

impl Avx2 {
    /// For each bit that is set, one lane moved to another: `ways` says from where and to where, of the bit's lane and the
    /// number of those before it. All lanes are below sixteen.
    #[inline(always)]
    fn moved(
        self,
        a: [__m256; 2],
        bits: u32,
        ways: impl Fn(usize, usize) -> [usize; 2],
    ) -> [__m256; 2] {
        let (mut all, mut out) = ([0.0; LANES], [0.0; LANES]);
        self.store(a, &mut all);
        let (mut bits, mut place) = (bits & 0xffff, 0);
        while bits != 0 {
            let [from, to] = ways(bits.trailing_zeros() as usize, place).map(|lane| lane % LANES);
            out[to] = all[from];
            bits &= bits - 1;
            place += 1;
        }
        self.load(&out)
    }
}

impl Lanes for Avx2 {
    type Floats = [__m256; 2];
    type Ints = [__m256i; 2];

    #[inline(always)]
    fn floats(self, value: f32) -> [__m256; 2] {
        [op!(_mm256_set1_ps(value)); 2]
    }
    #[inline(always)]
    fn ints(self, value: i32) -> [__m256i; 2] {
        [op!(_mm256_set1_epi32(value)); 2]
    }
    #[inline(always)]
    fn load_ints(self, values: &[i32; LANES]) -> [__m256i; 2] {
        let at = values.as_ptr().cast::<__m256i>();
        // SAFETY: the token says that the instructions are there; twice 32 bytes are.
        unsafe { [_mm256_loadu_si256(at), _mm256_loadu_si256(at.add(1))] }
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> [__m256; 2] {
        let at = values.as_ptr();
        // SAFETY: the token says that the instructions are there; twice 32 bytes are.
        unsafe { [_mm256_loadu_ps(at), _mm256_loadu_ps(at.add(8))] }
    }
    #[inline(always)]
    fn store(self, values: [__m256; 2], to: &mut [f32; LANES]) {
        let at = to.as_mut_ptr();
        // SAFETY: the token says that the instructions are there; twice 32 bytes are.
        unsafe {
            _mm256_storeu_ps(at, values[0]);
            _mm256_storeu_ps(at.add(8), values[1]);
        }
    }
    #[inline(always)]
    fn add(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn sub(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn mul(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn div(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_div_ps(a[0], b[0]), _mm256_div_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn min(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn max(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])])
    }
    #[inline(always)]
    fn less(self, a: [__m256; 2], b: [__m256; 2]) -> u32 {
        let bits = |i: usize| op!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a[i], b[i])));
        (bits(0) | (bits(1) << 8)) as u32
    }
    #[inline(always)]
    fn less_equal(self, a: [__m256; 2], b: [__m256; 2]) -> u32 {
        let bits = |i: usize| op!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a[i], b[i])));
        (bits(0) | (bits(1) << 8)) as u32
    }
    #[inline(always)]
    fn sqrt(self, a: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_sqrt_ps(a[0]), _mm256_sqrt_ps(a[1])])
    }
    #[inline(always)]
    fn if_less(
        self,
        a: [__m256; 2],
        b: [__m256; 2],
        then: [__m256; 2],
        otherwise: [__m256; 2],
    ) -> [__m256; 2] {
        op!([
            _mm256_blendv_ps(
                otherwise[0],
                then[0],
                _mm256_cmp_ps::<_CMP_LT_OQ>(a[0], b[0])
            ),
            _mm256_blendv_ps(
                otherwise[1],
                then[1],
                _mm256_cmp_ps::<_CMP_LT_OQ>(a[1], b[1])
            ),
        ])
    }
    #[inline(always)]
    fn add_ints(self, a: [__m256i; 2], b: [__m256i; 2]) -> [__m256i; 2] {
        op!([_mm256_add_epi32(a[0], b[0]), _mm256_add_epi32(a[1], b[1])])
    }
    #[inline(always)]
    fn and_ints(self, a: [__m256i; 2], b: [__m256i; 2]) -> [__m256i; 2] {
        op!([_mm256_and_si256(a[0], b[0]), _mm256_and_si256(a[1], b[1])])
    }
    #[inline(always)]
    fn mul_ints(self, a: [__m256i; 2], b: [__m256i; 2]) -> [__m256i; 2] {
        op!([
            _mm256_mullo_epi32(a[0], b[0]),
            _mm256_mullo_epi32(a[1], b[1])
        ])
    }
    #[inline(always)]
    fn shift_right<const BY: u32>(self, a: [__m256i; 2]) -> [__m256i; 2] {
        // The instruction takes the count from a register as well; `BY` is a constant there.
        op!({
            let by = _mm_cvtsi32_si128(BY as i32);
            [_mm256_sra_epi32(a[0], by), _mm256_sra_epi32(a[1], by)]
        })
    }
    #[inline(always)]
    fn to_floats(self, a: [__m256i; 2]) -> [__m256; 2] {
        op!([_mm256_cvtepi32_ps(a[0]), _mm256_cvtepi32_ps(a[1])])
    }
    #[inline(always)]
    fn abs(self, a: [__m256; 2]) -> [__m256; 2] {
        op!({
            let sign = _mm256_set1_ps(-0.0);
            [_mm256_andnot_ps(sign, a[0]), _mm256_andnot_ps(sign, a[1])]
        })
    }
    #[inline(always)]
    fn floor(self, a: [__m256; 2]) -> [__m256; 2] {
        op!([_mm256_floor_ps(a[0]), _mm256_floor_ps(a[1])])
    }
    #[inline(always)]
    fn to_ints(self, a: [__m256; 2]) -> [__m256i; 2] {
        op!([_mm256_cvttps_epi32(a[0]), _mm256_cvttps_epi32(a[1])])
    }
    #[inline(always)]
    fn select(self, bits: u32, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!({
            let bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let mask = |bits: u32| {
                let all = _mm256_and_si256(_mm256_set1_epi32(bits as i32), bit);
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(all, bit))
            };
            [
                _mm256_blendv_ps(b[0], a[0], mask(bits)),
                _mm256_blendv_ps(b[1], a[1], mask(bits >> 8)),
            ]
        })
    }
    #[inline(always)]
    fn of_bits(self, a: [__m256i; 2]) -> [__m256; 2] {
        op!([_mm256_castsi256_ps(a[0]), _mm256_castsi256_ps(a[1])])
    }
    #[inline(always)]
    fn of_halves(self, a: [__m256i; 2]) -> [__m256; 2] {
        op!(a.map(|a| {
            let size = _mm256_and_si256(a, _mm256_set1_epi32(0x7fff));
            let size = _mm256_castsi256_ps(_mm256_slli_epi32::<13>(size));
            let size = _mm256_mul_ps(size, _mm256_set1_ps(FROM_HALF));
            let sign = _mm256_and_si256(a, _mm256_set1_epi32(0x8000));
            _mm256_or_ps(size, _mm256_castsi256_ps(_mm256_slli_epi32::<16>(sign)))
        }))
    }
    #[inline(always)]
    fn shift_right_unsigned<const BY: u32>(self, a: [__m256i; 2]) -> [__m256i; 2] {
        // As above.
        op!({
            let by = _mm_cvtsi32_si128(BY as i32);
            [_mm256_srl_epi32(a[0], by), _mm256_srl_epi32(a[1], by)]
        })
    }
    #[inline(always)]
    fn gather(self, bytes: &[u8], at: [__m256i; 2], bits: u32) -> Option<[__m256i; 2]> {
        let last = u32::try_from(bytes.len().checked_sub(4)?).unwrap_or(u32::MAX);
        let set = op!({
            // Each lane's own bit, up to its sign.
            let low = _mm256_setr_epi32(31, 30, 29, 28, 27, 26, 25, 24);
            let high = _mm256_setr_epi32(23, 22, 21, 20, 19, 18, 17, 16);
            let all = _mm256_set1_epi32(bits as i32);
            [_mm256_sllv_epi32(all, low), _mm256_sllv_epi32(all, high)]
        });
        let beyond = op!({
            let most = _mm256_set1_epi32(last as i32);
            let beyond = |at, set| {
                let within = _mm256_cmpeq_epi32(_mm256_max_epu32(at, most), most);
                _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_andnot_si256(within, set)))
            };
            beyond(at[0], set[0]) | beyond(at[1], set[1]) != 0
        });
        // Offsets are signed to the instruction.
        if beyond || last > i32::MAX as u32 {
            return None;
        }
        let from = bytes.as_ptr().cast();
        let zero = op!(_mm256_setzero_si256());
        // SAFETY: the token says that the instructions are there; all four bytes from each offset are whose bit is set.
        Some(unsafe {
            [
                _mm256_mask_i32gather_epi32::<1>(zero, from, at[0], set[0]),
                _mm256_mask_i32gather_epi32::<1>(zero, from, at[1], set[1]),
            ]
        })
    }
    #[inline(always)]
    fn two(self, low: f32, high: f32) -> [__m256; 2] {
        op!([_mm256_set1_ps(low), _mm256_set1_ps(high)])
    }
    #[inline(always)]
    fn two_rows(self, a: [__m256; 2], pair: usize) -> [[__m256; 2]; 2] {
        op!({
            let first = _mm256_set1_epi32(2 * pair as i32);
            let next = _mm256_add_epi32(first, _mm256_set1_epi32(1));
            a.map(|a| {
                [
                    _mm256_permutevar8x32_ps(a, first),
                    _mm256_permutevar8x32_ps(a, next),
                ]
            })
        })
    }
    #[inline(always)]
    fn compress(self, a: [__m256; 2], bits: u32) -> [__m256; 2] {
        self.moved(a, bits, |lane, place| [lane, place])
    }
    #[inline(always)]
    fn expand(self, a: [__m256; 2], bits: u32) -> [__m256; 2] {
        self.moved(a, bits, |lane, place| [place, lane])
    }
    #[inline(always)]
    fn bytes(self, bytes: &[u8; LANES]) -> [__m256; 2] {
        let at = bytes.as_ptr();
        // SAFETY: the token says that the instructions are there; twice 8 bytes are.
        unsafe {
            let [a, b] = [
                _mm_loadl_epi64(at.cast()),
                _mm_loadl_epi64(at.add(8).cast()),
            ];
            [
                _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(a)),
                _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(b)),
            ]
        }
    }
    #[inline(always)]
    fn fields(self, bytes: &[u8], rows: [usize; 2], width: u32) -> [__m256i; 2] {
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
            let shuffle = _mm256_loadu_si256(fields.shuffle.as_ptr().cast());
            let shift = _mm256_loadu_si256(fields.shift.as_ptr().cast());
            let mask = _mm256_set1_epi32(fields.mask as i32);
            let take = |row| {
                _mm256_and_si256(
                    _mm256_srlv_epi32(_mm256_shuffle_epi8(row, shuffle), shift),
                    mask,
                )
            };
            [take(low), take(high)]
        }
    }
    #[inline(always)]
    fn narrow_fields(self, bytes: &[u8], at: usize, width: u32) -> [__m256i; 2] {
        let fields = &NARROW_FIELDS[width as usize];
        let bytes = &bytes[at..at + 16];
        let shuffle = fields.shuffle.as_ptr().cast::<__m256i>();
        let shift = fields.shift.as_ptr().cast::<__m256i>();
        // SAFETY: the token says that the instructions are there; the 16 bytes are, and the tables have twice 32.
        unsafe {
            let all = _mm256_broadcastsi128_si256(_mm_loadu_si128(bytes.as_ptr().cast()));
            let mask = _mm256_set1_epi32(fields.mask as i32);
            let low = _mm256_shuffle_epi8(all, _mm256_loadu_si256(shuffle));
            let high = _mm256_shuffle_epi8(all, _mm256_loadu_si256(shuffle.add(1)));
            [
                _mm256_and_si256(_mm256_srlv_epi32(low, _mm256_loadu_si256(shift)), mask),
                _mm256_and_si256(
                    _mm256_srlv_epi32(high, _mm256_loadu_si256(shift.add(1))),
                    mask,
                ),
            ]
        }
    }
    #[inline(always)]
    fn fours(self, values: &[u16], places: [usize; 4]) -> [__m256i; 2] {
        let all = four_places(values, places);
        op!([_mm256_cvtepu16_epi32(all[0]), _mm256_cvtepu16_epi32(all[1])])
    }
    #[inline(always)]
    fn shorts(self, values: &[u16; LANES]) -> [__m256i; 2] {
        let at = values.as_ptr().cast::<__m128i>();
        // SAFETY: the token says that the instructions are there; twice 16 bytes are.
        unsafe {
            [
                _mm256_cvtepu16_epi32(_mm_loadu_si128(at)),
                _mm256_cvtepu16_epi32(_mm_loadu_si128(at.wrapping_add(1))),
            ]
        }
    }
    #[inline(always)]
    fn pick(self, numbers: &Nibbles, [low, high]: [__m256; 2]) -> [__m256; 2] {
        op!({
            let both = _mm256_set1_epi64x(i64::from_le_bytes(numbers.0));
            let pick = |shift: __m256i| {
                let at = _mm256_srlv_epi32(both, shift);
                // Of each number in a lane the lowest three bits count; the fourth one chooses the half.
                let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(at));
                let (a, b) = (
                    _mm256_permutevar8x32_ps(low, at),
                    _mm256_permutevar8x32_ps(high, at),
                );
                _mm256_blendv_ps(a, b, upper)
            };
            [
                pick(_mm256_setr_epi32(0, 0, 4, 4, 8, 8, 12, 12)),
                pick(_mm256_setr_epi32(16, 16, 20, 20, 24, 24, 28, 28)),
            ]
        })
    }
    #[inline(always)]
    fn next_in_row(self, a: [__m256; 2]) -> [__m256; 2] {
        op!({
            let from = _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7);
            [
                _mm256_permutevar8x32_ps(a[0], from),
                _mm256_permutevar8x32_ps(a[1], from),
            ]
        })
    }
    #[inline(always)]
    fn next_row(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        [a[1], b[0]]
    }
}
