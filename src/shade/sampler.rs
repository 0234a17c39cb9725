//! Where samples fall: Burley, "Practical Hash-based Owen Scrambling" (JCGT 2020), by the crate
//! `sobol_burley`.
//!
//! All samples of a pixel are one Owen-scrambled Sobol sequence, whose seed is a hash of the pixel and the
//! user's seed: pixels are decorrelated, and a sample depends on nothing but pixel, number and seed, so that
//! a picture does not depend on the number of threads or on the order of the tiles. The tables end at 64
//! sets of four dimensions and at 2^16 samples; beyond either, the number of the block (of sets, of samples)
//! is hashed into the seed. Each block is stratified in itself, and independent of the others.
//!
//! The crate computes a Sobol number bit by bit of the sample's number, with a jump that no processor foresees.
//! Here it comes from tables, four bits at a time, to the same numbers in less time; what is left of the
//! crate's `sample_4d` is put together from its parts.

use std::sync::LazyLock;

use sobol_burley::parts::{
    Int4, hash, hash_int4, owen_scramble_int4_rev, owen_scramble_rev, sobol_int4_rev,
};
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};

/// Samples to a block: what the tables hold.
const SAMPLES: u32 = 1 << 16;

/// One sample of one pixel: a point of the unit cube of as many dimensions as anybody asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampler {
    seed: u32,
    index: u32,
    /// The index as the seed shuffles it, its bits reversed: alike for all sets of the first block.
    shuffled_rev: u32,
}

impl Sampler {
    /// The `sample`-th sample of `pixel`; `seed` gives the whole picture another noise.
    pub fn new(pixel: [u32; 2], sample: u32, seed: u32) -> Self {
        let mut hash = mix(seed, 0x9e37_79b9);
        hash = mix(hash, pixel[0]);
        hash = mix(hash, pixel[1]);
        if sample >= SAMPLES {
            hash = mix(hash, sample / SAMPLES);
        }
        Self::with_seed(hash, sample % SAMPLES)
    }

    fn with_seed(seed: u32, index: u32) -> Self {
        Self {
            seed,
            index,
            shuffled_rev: owen_scramble_rev(index.reverse_bits(), hash(seed ^ 0x79c6_8e4a)),
        }
    }

    /// Four numbers in 0..1 (1 excluded). The four of one set are stratified together, and the first two
    /// best; so are sets with low numbers among each other.
    #[inline]
    pub fn set(&self, dimension_set: u32) -> [f32; 4] {
        if dimension_set < NUM_DIMENSION_SETS_4D {
            return self.of_first_block(dimension_set);
        }
        let block = dimension_set / NUM_DIMENSION_SETS_4D;
        // The constant keeps blocks of sets apart from blocks of samples.
        let seed = mix(self.seed ^ 0x85eb_ca6b, block);
        sample_4d(self.index, dimension_set % NUM_DIMENSION_SETS_4D, seed)
    }

    /// `sample_4d(self.index, set, self.seed)`.
    #[inline]
    fn of_first_block(&self, set: u32) -> [f32; 4] {
        let seed = self.seed.wrapping_mul(0x9c8f_2d3b) ^ set;
        let keys = Int4::from([0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8]);
        let keys = keys ^ Int4::from([seed; 4]);
        let sobol_rev = NIBBLES.sobol_rev(self.shuffled_rev, set);
        owen_scramble_int4_rev(sobol_rev, hash_int4(keys))
            .reverse_bits()
            .to_f32_norm()
    }
}

static NIBBLES: LazyLock<Nibbles> = LazyLock::new(Nibbles::new);

/// Sobol numbers are linear in the bits of the index: the exclusive or of what each of its four nibbles gives.
/// A kibibyte to a set of dimensions, and 16 KiB that a path of eight bounces looks at.
struct Nibbles(Vec<[[Int4; 16]; 4]>);

impl Nibbles {
    fn new() -> Self {
        let nibble =
            |set, place: u32, value: usize| sobol_int4_rev((value as u32) << (28 - 4 * place), set);
        let of_set =
            |set| [0, 1, 2, 3].map(|place| std::array::from_fn(|value| nibble(set, place, value)));
        Self((0..NUM_DIMENSION_SETS_4D).map(of_set).collect())
    }

    /// The parts' `sobol_int4_rev`.
    #[inline]
    fn sobol_rev(&self, index_rev: u32, set: u32) -> Int4 {
        let [a, b, c, d] = &self.0[set as usize];
        let nibble = |place: u32| (index_rev >> (28 - 4 * place)) as usize & 15;
        (a[nibble(0)] ^ b[nibble(1)]) ^ (c[nibble(2)] ^ d[nibble(3)])
    }
}

/// Hashes `value` into `state`. The finaliser is Wellons', "Prospecting for Hash Functions" (2018),
/// `lowbias32`: each bit of the input flips each bit of the output with a probability within 0.2 % of one half.
fn mix(state: u32, value: u32) -> u32 {
    let mut x = state.rotate_left(5) ^ value.wrapping_mul(0x9e37_79b1);
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chi-square of `counts` against equal counts.
    fn chi_square(counts: &[u32]) -> f64 {
        let expected = f64::from(counts.iter().sum::<u32>()) / counts.len() as f64;
        counts
            .iter()
            .map(|&n| (f64::from(n) - expected).powi(2) / expected)
            .sum()
    }

    #[test]
    fn a_sample_depends_on_pixel_number_and_seed_only() {
        let a = Sampler::new([3, 5], 7, 11);
        assert_eq!(a, Sampler::new([3, 5], 7, 11));
        for other in [
            Sampler::new([5, 3], 7, 11),
            Sampler::new([3, 5], 8, 11),
            Sampler::new([3, 5], 7, 12),
            Sampler::new([3, 5], 7 + SAMPLES, 11),
        ] {
            assert_ne!(a.set(0), other.set(0));
        }
        assert_ne!(a.set(0), a.set(NUM_DIMENSION_SETS_4D));
        assert_ne!(a.set(1), a.set(1 + 5 * NUM_DIMENSION_SETS_4D));
    }

    #[test]
    fn tables_give_the_numbers_of_the_crate() {
        for set in 0..NUM_DIMENSION_SETS_4D {
            for index in (0..SAMPLES).step_by(257).chain([1, SAMPLES - 1]) {
                let seed = mix(set, index);
                let sampler = Sampler::with_seed(seed, index);
                assert_eq!(sampler.set(set), sample_4d(index, set, seed));
            }
        }
    }

    #[test]
    fn one_pixel_is_stratified() {
        // 256 samples put exactly one into each of 256 strata of each dimension, in any block.
        for (set, first) in [(0, 0), (17, 256), (64, 0), (1000, 0), (3, 5 * SAMPLES)] {
            let mut hit = [[0_u32; 256]; 4];
            for sample in first..first + 256 {
                let u = Sampler::new([10, 20], sample, 1).set(set);
                for (hit, u) in hit.iter_mut().zip(u) {
                    assert!((0.0..1.0).contains(&u));
                    hit[(u * 256.0) as usize] += 1;
                }
            }
            assert!(hit.iter().flatten().all(|&n| n == 1), "set {set}");
        }
    }

    #[test]
    fn pixels_are_independent() {
        // The first sample of 2^14 pixels in 8 x 8 cells: independent draws. 63 degrees of freedom: more
        // than 120 has a probability below 2e-5.
        for set in [0, 1, 70] {
            let mut cells = [0_u32; 64];
            for y in 0..128 {
                for x in 0..128 {
                    let u = Sampler::new([x, y], 0, 0).set(set);
                    cells[(u[0] * 8.0) as usize * 8 + (u[1] * 8.0) as usize] += 1;
                }
            }
            assert!(chi_square(&cells) < 120.0, "{}", chi_square(&cells));
        }
    }
}
