//! The sixteen lanes on x86-64: one register of AVX-512, or two of AVX2.

/// An operation on registers alone.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: a token of the instruction set is at hand, so the processor has it. No memory is touched.
        unsafe { $e }
    };
}

mod avx2;
mod avx512;
mod doubles;

use std::arch::x86_64::{__m128i, _MM_HINT_T0, _mm_loadl_epi64, _mm_prefetch, _mm_unpacklo_epi64};

use super::{Body, FIELD_PADDING, FIELDS, Fields, LANES};

/// Exists only while code for AVX2 runs, with FMA and the instructions on bits that came with both.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// Exists only while code for AVX-512 (F, BW, DQ, VL) runs.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

/// Whether the processor has what [`run_avx2`] asks for.
pub(super) fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// Whether the processor has what [`run_avx512`] asks for.
pub(super) fn has_avx512() -> bool {
    has_avx2()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
}

/// # Safety
/// The processor must have AVX2, FMA, BMI 1 and 2, and the counts of bits that come with them.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn run_avx2<B: Body>(body: B) -> B::Output {
    body.run(Avx2(()))
}

/// # Safety
/// The processor must have AVX-512 F, BW, DQ and VL, and what [`run_avx2`] asks for.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(super) unsafe fn run_avx512<B: Body>(body: B) -> B::Output {
    body.run(Avx512(()))
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

/// Asks for what is at these offsets.
#[inline(always)]
fn prefetch_all(bytes: &[u8], at: &[i32; LANES]) {
    for at in at {
        let at = bytes.as_ptr().wrapping_offset(*at as isize);
        // SAFETY: every x86-64 processor has SSE; nothing is read, wherever it is.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) };
    }
}
