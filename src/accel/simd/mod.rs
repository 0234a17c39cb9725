//! Sixteen lanes at once: one body of code for AVX-512, AVX2 and plain Rust.
//!
//! A [`Body`] is written once over the operations of [`Lanes`]; [`Isa::run`] compiles it for each instruction set and
//! runs the one that was chosen when the program found out what the processor has. All operations are those of IEEE
//! 754 one by one, and those that are fused say so: every instruction set gives the same bits, and the tests hold it to
//! that. Sixteen lanes are the children of a node, or two rows of eight vertices.
#![allow(unsafe_code)]

mod doubles;
mod portable;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod x86;

use bytemuck::{Pod, Zeroable};

pub(super) use doubles::{Doubles, EIGHT};
pub(super) use portable::Portable;

/// Lanes in a register.
pub(super) const LANES: usize = 16;

/// The widest field that [`Lanes::fields`] takes apart, in bits.
pub(super) const WIDEST: u32 = 25;

/// The widest field that [`Lanes::narrow_fields`] takes apart, in bits.
pub(super) const NARROW: u32 = 8;

/// Two to the power of 112: what the bits of half a float, shifted into a float's place, are multiplied by.
const FROM_HALF: f32 = f32::from_bits(239 << 23);

/// Bytes that must follow the last field.
pub(super) const FIELD_PADDING: usize = 16;

/// Operations on sixteen lanes. The value itself is the permission to use an instruction set.
pub(super) trait Lanes: Doubles {
    /// Sixteen numbers of single precision.
    type Floats: Copy;
    /// Sixteen integers of 32 bits, which wrap around.
    type Ints: Copy;

    /// The same in all lanes.
    fn floats(self, value: f32) -> Self::Floats;
    /// The same in all lanes.
    fn ints(self, value: i32) -> Self::Ints;
    /// One by one.
    fn load_ints(self, values: &[i32; LANES]) -> Self::Ints;
    /// One by one.
    fn load(self, values: &[f32; LANES]) -> Self::Floats;
    /// One by one.
    fn store(self, values: Self::Floats, to: &mut [f32; LANES]);

    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// `a b + c`, rounded once.
    fn mul_add(self, a: Self::Floats, b: Self::Floats, c: Self::Floats) -> Self::Floats;
    /// `c - a b`, rounded once.
    fn sub_mul(self, c: Self::Floats, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// The lesser one; `b` if either is not a number.
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// The greater one; `b` if either is not a number.
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// A bit for each lane where `a < b`.
    fn less(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// A bit for each lane where `a <= b`.
    fn less_equal(self, a: Self::Floats, b: Self::Floats) -> u32;
    /// Bits of the lanes of four, those of the first lowest: which are below zero, and which above. Zeros of either sign are
    /// neither; what is no number is either.
    fn signs(self, four: [Self::Floats; 4]) -> [u64; 2];
    /// The square root.
    fn sqrt(self, a: Self::Floats) -> Self::Floats;
    /// Where `a < b` the lane of `then`, and elsewhere that of `otherwise`.
    fn if_less(
        self,
        a: Self::Floats,
        b: Self::Floats,
        then: Self::Floats,
        otherwise: Self::Floats,
    ) -> Self::Floats;

    fn add_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn and_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    fn mul_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    /// Towards minus infinity.
    fn shift_right<const BY: u32>(self, a: Self::Ints) -> Self::Ints;
    /// Exact below 2^24.
    fn to_floats(self, a: Self::Ints) -> Self::Floats;

    /// The size of a number.
    fn abs(self, a: Self::Floats) -> Self::Floats;
    /// The greatest whole number that is not above it.
    fn floor(self, a: Self::Floats) -> Self::Floats;
    /// Whole numbers below 2^31 as integers.
    fn to_ints(self, a: Self::Floats) -> Self::Ints;
    /// From `a` where the lane's bit is set, else from `b`.
    fn select(self, bits: u32, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    /// What these bits are as numbers.
    fn of_bits(self, a: Self::Ints) -> Self::Floats;
    /// The numbers whose halves are in the lower 16 bits. Infinities and what is no number are not told from large ones.
    fn of_halves(self, a: Self::Ints) -> Self::Floats;
    /// Zeros come in from above.
    fn shift_right_unsigned<const BY: u32>(self, a: Self::Ints) -> Self::Ints;
    /// Four bytes from each offset on, which is not below 0, in the lanes whose bits are set, and zeros in the others; none if
    /// they are not all there.
    fn gather(self, bytes: &[u8], at: Self::Ints, bits: u32) -> Option<Self::Ints>;
    /// Has the bytes at these offsets brought near, for who gathers them soon. Where there are none nothing happens.
    fn prefetch(self, bytes: &[u8], at: Self::Ints);
    /// The one in the eight lower lanes, the other in the upper ones.
    fn two(self, low: f32, high: f32) -> Self::Floats;
    /// Two rows of what `a` has for eight rows on one side in its lower half, and on the other side in its upper half:
    /// lanes `2 pair` and `2 pair + 1` of each half, all over the lower and the upper lanes.
    fn two_rows(self, a: Self::Floats, pair: usize) -> [Self::Floats; 2];

    /// The lanes whose bits are set, one after the other from the first lane on; zeros follow.
    fn compress(self, a: Self::Floats, bits: u32) -> Self::Floats;
    /// The first lanes, in order, in the lanes whose bits are set; zeros in the others.
    fn expand(self, a: Self::Floats, bits: u32) -> Self::Floats;

    /// Bytes as numbers.
    fn bytes(self, bytes: &[u8; LANES]) -> Self::Floats;
    /// Two rows of eight fields, each `width` bits wide, lowest bits first; the rows start at the given bytes.
    ///
    /// # Panics
    /// If `width` exceeds [`WIDEST`], or the bytes end less than [`FIELD_PADDING`] after the last field.
    fn fields(self, bytes: &[u8], rows: [usize; 2], width: u32) -> Self::Ints;

    /// Sixteen fields, each `width` bits wide, one after the other from byte `at` on, lowest bits first.
    ///
    /// # Panics
    /// If `width` exceeds [`NARROW`], or fewer than 16 bytes follow.
    fn narrow_fields(self, bytes: &[u8], at: usize, width: u32) -> Self::Ints;

    /// Four numbers from each of four places in `values`.
    ///
    /// # Panics
    /// If fewer than four follow any of the places.
    fn fours(self, values: &[u16], places: [usize; 4]) -> Self::Ints;

    /// Sixteen numbers.
    fn shorts(self, values: &[u16; LANES]) -> Self::Ints;

    /// For each lane, the entry of `table` that its number in `numbers` names.
    fn pick(self, numbers: &Nibbles, table: Self::Floats) -> Self::Floats;

    /// Lane i takes lane i + 1 of its half; the last lane of each half stays.
    fn next_in_row(self, a: Self::Floats) -> Self::Floats;
    /// The upper half of `a`, then the lower half of `b`.
    fn next_row(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
}

/// Sixteen numbers of four bits, one a lane: those of the even lanes, then those of the odd ones, so that no lane has to
/// look beyond its half of eight bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Nibbles([u8; LANES / 2]);

impl Nibbles {
    /// Of numbers below 16.
    pub(super) const fn new(numbers: [u8; LANES]) -> Self {
        let mut nibbles = [0; LANES / 2];
        let mut lane = 0;
        while lane < LANES {
            assert!(numbers[lane] < 16, "four bits each");
            let (byte, shift) = Self::place(lane);
            nibbles[byte] |= numbers[lane] << shift;
            lane += 1;
        }
        Self(nibbles)
    }

    /// The number of a lane.
    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> u8 {
        let (byte, shift) = Self::place(lane);
        self.0[byte] >> shift & 15
    }

    /// Its byte, and the bits in it that precede it.
    #[inline(always)]
    const fn place(lane: usize) -> (usize, usize) {
        let nibble = LANES / 2 * (lane % 2) + lane / 2;
        (nibble / 2, nibble % 2 * 4)
    }
}

/// Something to be done with lanes. Implementations are `#[inline(always)]`, and so is all that they call: only what is
/// inlined is compiled for the instruction set.
pub(super) trait Body {
    /// What it results in.
    type Output;
    /// Does it.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// An instruction set that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Isa(Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Set {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    /// All that this processor has, the fastest last.
    pub(super) fn all() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut all = vec![Self(Set::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            if x86::has_avx2() {
                all.push(Self(Set::Avx2));
            }
            if x86::has_avx512() {
                all.push(Self(Set::Avx512));
            }
        }
        all
    }

    /// The fastest one.
    pub(super) fn best() -> Self {
        Self::all().pop().unwrap_or(Self(Set::Portable))
    }

    /// Does it with this instruction set.
    #[inline]
    pub(super) fn run<B: Body>(self, body: B) -> B::Output {
        match self.0 {
            Set::Portable => body.run(Portable),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `all` names AVX2 only where the processor has it.
            Set::Avx2 => unsafe { x86::run_avx2(body) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: likewise for AVX-512.
            Set::Avx512 => unsafe { x86::run_avx512(body) },
        }
    }
}

/// How eight fields of one width are taken apart: four lie in the 16 bytes from the row's start, four in those from
/// byte `middle`.
struct Fields {
    /// For each lane, its four bytes among these 16.
    shuffle: [u8; 32],
    /// For each lane, the bits of these that precede the field.
    shift: [u32; 8],
    mask: u32,
    middle: usize,
}

static FIELDS: [Fields; WIDEST as usize + 1] = {
    const NONE: Fields = Fields {
        shuffle: [0; 32],
        shift: [0; 8],
        mask: 0,
        middle: 0,
    };
    let mut all = [NONE; WIDEST as usize + 1];
    let mut width = 0;
    while width <= WIDEST as usize {
        let middle = 4 * width / 8;
        let mut lane = 0;
        while lane < 8 {
            let first = lane * width - if lane < 4 { 0 } else { 8 * middle };
            let mut byte = 0;
            while byte < 4 {
                all[width].shuffle[4 * lane + byte] = (first / 8 + byte) as u8;
                byte += 1;
            }
            all[width].shift[lane] = (first % 8) as u32;
            lane += 1;
        }
        all[width].mask = (1 << width) - 1;
        all[width].middle = middle;
        width += 1;
    }
    all
};

/// How sixteen narrow fields are taken apart, which all lie in 16 bytes.
struct NarrowFields {
    /// For each lane, its two bytes among these 16, and two that are zero.
    shuffle: [u8; 64],
    /// For each lane, the bits of these that precede the field.
    shift: [u32; LANES],
    mask: u32,
}

static NARROW_FIELDS: [NarrowFields; NARROW as usize + 1] = {
    const ZERO: u8 = 0x80;
    const NONE: NarrowFields = NarrowFields {
        shuffle: [ZERO; 64],
        shift: [0; LANES],
        mask: 0,
    };
    let mut all = [NONE; NARROW as usize + 1];
    let mut width = 0;
    while width <= NARROW as usize {
        let mut lane = 0;
        while lane < LANES {
            let first = lane * width;
            all[width].shuffle[4 * lane] = (first / 8) as u8;
            // The last field may end with the last byte.
            if first / 8 + 1 < 16 {
                all[width].shuffle[4 * lane + 1] = (first / 8 + 1) as u8;
            }
            all[width].shift[lane] = (first % 8) as u32;
            lane += 1;
        }
        all[width].mask = (1 << width) - 1;
        width += 1;
    }
    all
};
