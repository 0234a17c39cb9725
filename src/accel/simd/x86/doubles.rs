//! Eight doubles: one register of AVX-512, or two of AVX2.

use std::arch::x86_64::*;

use super::{Avx2, Avx512};
use crate::accel::simd::doubles::{Doubles, EIGHT};

impl Doubles for Avx2 {
    type Doubles = [__m256d; 2];

    #[inline(always)]
    fn doubles(self, value: f64) -> [__m256d; 2] {
        [op!(_mm256_set1_pd(value)); 2]
    }
    #[inline(always)]
    fn load_doubles(self, values: &[f64; EIGHT]) -> [__m256d; 2] {
        let at = values.as_ptr();
        // SAFETY: the token says that the instructions are there; twice 32 bytes are.
        unsafe { [_mm256_loadu_pd(at), _mm256_loadu_pd(at.add(4))] }
    }
    #[inline(always)]
    fn store_doubles(self, values: [__m256d; 2], to: &mut [f64; EIGHT]) {
        let at = to.as_mut_ptr();
        // SAFETY: the token says that the instructions are there; twice 32 bytes are.
        unsafe {
            _mm256_storeu_pd(at, values[0]);
            _mm256_storeu_pd(at.add(4), values[1]);
        }
    }
    #[inline(always)]
    fn add_doubles(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
        op!([_mm256_add_pd(a[0], b[0]), _mm256_add_pd(a[1], b[1])])
    }
    #[inline(always)]
    fn sub_doubles(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
        op!([_mm256_sub_pd(a[0], b[0]), _mm256_sub_pd(a[1], b[1])])
    }
    #[inline(always)]
    fn mul_doubles(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
        op!([_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])])
    }
    #[inline(always)]
    fn div_doubles(self, a: [__m256d; 2], b: [__m256d; 2]) -> [__m256d; 2] {
        op!([_mm256_div_pd(a[0], b[0]), _mm256_div_pd(a[1], b[1])])
    }
    #[inline(always)]
    fn mul_sub_doubles(self, a: [__m256d; 2], b: [__m256d; 2], c: [__m256d; 2]) -> [__m256d; 2] {
        op!([
            _mm256_fmsub_pd(a[0], b[0], c[0]),
            _mm256_fmsub_pd(a[1], b[1], c[1])
        ])
    }
    #[inline(always)]
    fn root_doubles(self, a: [__m256d; 2]) -> [__m256d; 2] {
        // The second one is taken if either is no number.
        op!(a.map(|a| _mm256_sqrt_pd(_mm256_max_pd(a, _mm256_setzero_pd()))))
    }
    #[inline(always)]
    fn with_signs(self, a: [__m256d; 2], signs: [__m256d; 2]) -> [__m256d; 2] {
        op!({
            let sign = _mm256_set1_pd(-0.0);
            [
                _mm256_or_pd(a[0], _mm256_and_pd(signs[0], sign)),
                _mm256_or_pd(a[1], _mm256_and_pd(signs[1], sign)),
            ]
        })
    }
    #[inline(always)]
    fn less_doubles(self, a: [__m256d; 2], b: [__m256d; 2]) -> u32 {
        let bits = |i: usize| op!(_mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a[i], b[i])));
        (bits(0) | (bits(1) << 4)) as u32
    }
    #[inline(always)]
    fn pick_doubles(self, numbers: &[i64; EIGHT], table: [__m256d; 2]) -> [__m256d; 2] {
        let mut all = [0.0; EIGHT];
        self.store_doubles(table, &mut all);
        let mut picked = [0.0; EIGHT];
        for lane in 0..EIGHT {
            picked[lane] = all[numbers[lane] as usize % EIGHT];
        }
        self.load_doubles(&picked)
    }
}

impl Doubles for Avx512 {
    type Doubles = __m512d;

    #[inline(always)]
    fn doubles(self, value: f64) -> __m512d {
        op!(_mm512_set1_pd(value))
    }
    #[inline(always)]
    fn load_doubles(self, values: &[f64; EIGHT]) -> __m512d {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_loadu_pd(values.as_ptr()) }
    }
    #[inline(always)]
    fn store_doubles(self, values: __m512d, to: &mut [f64; EIGHT]) {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe { _mm512_storeu_pd(to.as_mut_ptr(), values) }
    }
    #[inline(always)]
    fn add_doubles(self, a: __m512d, b: __m512d) -> __m512d {
        op!(_mm512_add_pd(a, b))
    }
    #[inline(always)]
    fn sub_doubles(self, a: __m512d, b: __m512d) -> __m512d {
        op!(_mm512_sub_pd(a, b))
    }
    #[inline(always)]
    fn mul_doubles(self, a: __m512d, b: __m512d) -> __m512d {
        op!(_mm512_mul_pd(a, b))
    }
    #[inline(always)]
    fn div_doubles(self, a: __m512d, b: __m512d) -> __m512d {
        op!(_mm512_div_pd(a, b))
    }
    #[inline(always)]
    fn mul_sub_doubles(self, a: __m512d, b: __m512d, c: __m512d) -> __m512d {
        op!(_mm512_fmsub_pd(a, b, c))
    }
    #[inline(always)]
    fn root_doubles(self, a: __m512d) -> __m512d {
        // The second one is taken if either is no number.
        op!(_mm512_sqrt_pd(_mm512_max_pd(a, _mm512_setzero_pd())))
    }
    #[inline(always)]
    fn with_signs(self, a: __m512d, signs: __m512d) -> __m512d {
        op!(_mm512_or_pd(a, _mm512_and_pd(signs, _mm512_set1_pd(-0.0))))
    }
    #[inline(always)]
    fn less_doubles(self, a: __m512d, b: __m512d) -> u32 {
        u32::from(op!(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b)))
    }
    #[inline(always)]
    fn pick_doubles(self, numbers: &[i64; EIGHT], table: __m512d) -> __m512d {
        // SAFETY: the token says that the instructions are there; 64 bytes are.
        unsafe {
            let numbers = _mm512_loadu_si512(numbers.as_ptr().cast());
            _mm512_permutexvar_pd(numbers, table)
        }
    }
}
