//! Two registers of eight.

use std::arch::x86_64::*;

use super::{Avx2, four_places, prefetch_all, windows};
use crate::accel::simd::{FROM_HALF, LANES, Lanes, NARROW_FIELDS, Nibbles};

/// A lane that stays empty.
const NONE: u8 = 0x80;

/// For each set of eight lanes: where these come from when they are put side by side, and where they come from when lanes that
/// are side by side are put into them. A byte each.
static MOVES: [[u64; 2]; 256] = {
    let mut all = [[0; 2]; 256];
    let mut bits = 0;
    while bits < 256 {
        let mut ways = [[NONE; 8]; 2];
        let (mut lane, mut count) = (0, 0);
        while lane < 8 {
            if bits >> lane & 1 == 1 {
                ways[0][count] = lane as u8;
                ways[1][lane] = count as u8;
                count += 1;
            }
            lane += 1;
        }
        all[bits] = [u64::from_le_bytes(ways[0]), u64::from_le_bytes(ways[1])];
        bits += 1;
    }
    all
};

impl Avx2 {
    /// Eight lanes, each from the lane that a byte of `numbers` names.
    #[inline(always)]
    fn moved(self, a: __m256, numbers: u64) -> __m256 {
        op!({
            let numbers = _mm256_cvtepi8_epi32(_mm_cvtsi64_si128(numbers as i64));
            let moved = _mm256_permutevar8x32_ps(a, numbers);
            // Where the sign is set, zero.
            _mm256_blendv_ps(moved, _mm256_setzero_ps(), _mm256_castsi256_ps(numbers))
        })
    }
}

// Functions, not closures: these are not compiled for the instruction set where they are not inlined.
impl Avx2 {
    /// The numbers whose halves are in the lower 16 bits.
    #[inline(always)]
    fn of_eight_halves(self, a: __m256i) -> __m256 {
        op!({
            let size = _mm256_and_si256(a, _mm256_set1_epi32(0x7fff));
            let size = _mm256_castsi256_ps(_mm256_slli_epi32::<13>(size));
            let size = _mm256_mul_ps(size, _mm256_set1_ps(FROM_HALF));
            let sign = _mm256_and_si256(a, _mm256_set1_epi32(0x8000));
            _mm256_or_ps(size, _mm256_castsi256_ps(_mm256_slli_epi32::<16>(sign)))
        })
    }

    /// Bits which as an integer are below zero, zero, or above, where the number is.
    #[inline(always)]
    fn signed(self, a: __m256) -> __m256i {
        // The sum of zeros of either sign is the positive one.
        op!(_mm256_castps_si256(_mm256_add_ps(a, _mm256_setzero_ps())))
    }

    /// Bits of the lanes that are below zero, and above.
    #[inline(always)]
    fn signs_of(self, a: [__m256; 2], b: [__m256; 2]) -> [u32; 2] {
        let (a0, a1) = (self.signed(a[0]), self.signed(a[1]));
        let (b0, b1) = (self.signed(b[0]), self.signed(b[1]));
        op!({
            // Saturating: what is below or above zero remains so.
            let all = _mm256_packs_epi16(_mm256_packs_epi32(a0, a1), _mm256_packs_epi32(b0, b1));
            // They were packed by halves of registers.
            let order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
            let all = _mm256_permutevar8x32_epi32(all, order);
            let below = _mm256_movemask_epi8(all) as u32;
            let zero = _mm256_cmpeq_epi8(all, _mm256_setzero_si256());
            let zero = _mm256_movemask_epi8(zero) as u32;
            [below, !(below | zero)]
        })
    }

    /// A bit for each lane whose sign is set in `set` and whose offset is beyond `last`.
    #[inline(always)]
    fn beyond(self, at: __m256i, set: __m256i, last: u32) -> i32 {
        op!({
            let most = _mm256_set1_epi32(last as i32);
            let within = _mm256_cmpeq_epi32(_mm256_max_epu32(at, most), most);
            _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_andnot_si256(within, set)))
        })
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
    fn mul_add(self, a: [__m256; 2], b: [__m256; 2], c: [__m256; 2]) -> [__m256; 2] {
        op!([
            _mm256_fmadd_ps(a[0], b[0], c[0]),
            _mm256_fmadd_ps(a[1], b[1], c[1])
        ])
    }
    #[inline(always)]
    fn sub_mul(self, c: [__m256; 2], a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
        op!([
            _mm256_fnmadd_ps(a[0], b[0], c[0]),
            _mm256_fnmadd_ps(a[1], b[1], c[1])
        ])
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
    fn signs(self, [a, b, c, d]: [[__m256; 2]; 4]) -> [u64; 2] {
        let [low, high] = [self.signs_of(a, b), self.signs_of(c, d)];
        [
            u64::from(low[0]) | u64::from(high[0]) << 32,
            u64::from(low[1]) | u64::from(high[1]) << 32,
        ]
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
        [self.of_eight_halves(a[0]), self.of_eight_halves(a[1])]
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
        let beyond = self.beyond(at[0], set[0], last) | self.beyond(at[1], set[1], last);
        // Offsets are signed to the instruction.
        if beyond != 0 || last > i32::MAX as u32 {
            return None;
        }
        let from = bytes.as_ptr().cast();
        let zero = op!(_mm256_setzero_si256());
        let mut all = [zero; 2];
        for half in 0..2 {
            // Often few are asked for, and they are the first.
            if bits >> (8 * half) & 0xff != 0 {
                let (at, set) = (at[half], set[half]);
                // SAFETY: the token says that the instructions are there; all four bytes from each offset are whose bit is
                // set.
                all[half] = unsafe { _mm256_mask_i32gather_epi32::<1>(zero, from, at, set) };
            }
        }
        Some(all)
    }
    #[inline(always)]
    fn prefetch(self, bytes: &[u8], at: [__m256i; 2]) {
        let mut all = [0; LANES];
        // SAFETY: the token says that the instructions are there; 32 bytes are for each half.
        unsafe {
            _mm256_storeu_si256(all.as_mut_ptr().cast(), at[0]);
            _mm256_storeu_si256(all.as_mut_ptr().add(LANES / 2).cast(), at[1]);
        }
        prefetch_all(bytes, &all);
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
        let [low, high] = [bits & 0xff, bits >> 8 & 0xff].map(|bits| bits as usize);
        let mut out = [0.0; LANES];
        let second = low.count_ones() as usize;
        // SAFETY: the token says that the instructions are there; 32 bytes are from each place, the second of which is 8 at
        // most.
        unsafe {
            _mm256_storeu_ps(out.as_mut_ptr(), self.moved(a[0], MOVES[low][0]));
            _mm256_storeu_ps(
                out.as_mut_ptr().add(second),
                self.moved(a[1], MOVES[high][0]),
            );
        }
        self.load(&out)
    }
    #[inline(always)]
    fn expand(self, a: [__m256; 2], bits: u32) -> [__m256; 2] {
        let [low, high] = [bits & 0xff, bits >> 8 & 0xff].map(|bits| bits as usize);
        let mut all = [0.0; LANES];
        self.store(a, &mut all);
        let second = low.count_ones() as usize;
        // SAFETY: the token says that the instructions are there; 32 bytes are from the place on, which is 8 at most.
        let rest = unsafe { _mm256_loadu_ps(all.as_ptr().add(second)) };
        [
            self.moved(a[0], MOVES[low][1]),
            self.moved(rest, MOVES[high][1]),
        ]
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
