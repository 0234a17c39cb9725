//! Look-ups in an image's texels, sixteen at once: as [`Texels::eval`] does each.

use super::block::Sheet;
use crate::accel::quads::PAIRS;
use crate::accel::simd::{LANES, Lanes};
use crate::surface::{FROM_BYTE, Fold, TexelKind, Texels, Wrap};

/// Coordinates in texels along an axis, from the middle of the first one; the texel before, how far after it they are,
/// and the lanes where that texel and the next are within the image.
#[inline(always)]
fn along<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    axis: usize,
    s: L::Floats,
) -> (L::Floats, L::Floats, u32) {
    let s = match texels.fold(axis) {
        Fold::Ones => lanes.sub(s, lanes.floor(s)),
        Fold::Twos => {
            let twos = lanes.floor(lanes.mul(lanes.floats(0.5), s));
            lanes.sub(s, lanes.mul(lanes.floats(2.0), twos))
        }
        Fold::Within([low, high]) => lanes.min(lanes.max(s, lanes.floats(low)), lanes.floats(high)),
    };
    let size = texels.size[axis] as f32;
    let x = lanes.sub(lanes.mul(s, lanes.floats(size)), lanes.floats(0.5));
    let left = lanes.floor(x);
    let within = lanes.less_equal(lanes.floats(0.0), left)
        & lanes.less_equal(left, lanes.floats(size - 2.0));
    (left, lanes.sub(x, left), within)
}

#[inline(always)]
fn blend<L: Lanes>(lanes: L, [a, b]: [L::Floats; 2], f: L::Floats) -> L::Floats {
    lanes.add(a, lanes.mul(lanes.sub(b, a), f))
}

/// Of the vertices of a block in two of its rows, those whose bits are set.
#[inline(always)]
pub(super) fn of_pair(bits: u64, pair: usize) -> u32 {
    (bits >> (LANES * pair)) as u32 & 0xffff
}

/// The least and the greatest value at a block's vertices, lane by lane.
#[inline(always)]
pub(super) fn range_of_all<L: Lanes, S: Sheet<L>>(
    lanes: L,
    texels: &Texels<'_>,
    sheet: &S,
    pairs: usize,
) -> [L::Floats; 2] {
    let (s, t) = (sheet.st(lanes, 0), sheet.st(lanes, 1));
    let (mut least, mut most) = (lanes.floats(f32::MAX), lanes.floats(f32::MIN));
    for pair in 0..pairs {
        let at = [sheet.pair(lanes, s, pair), sheet.pair(lanes, t, pair)];
        let value = look_up(lanes, texels, at, 0xffff);
        // What is no number decides nothing.
        least = lanes.min(value, least);
        most = lanes.max(value, most);
    }
    [least, most]
}

/// Values at vertices of a block. Those that are needed are often few: they are put side by side, so that as few times as
/// can be sixteen are looked up.
#[inline(always)]
pub(super) fn look_up_all<L: Lanes, S: Sheet<L>>(
    lanes: L,
    texels: &Texels<'_>,
    sheet: &S,
    needed: u64,
    values: &mut [L::Floats; PAIRS],
) {
    const ROOM: usize = LANES * (PAIRS + 1);
    let (s, t) = (sheet.st(lanes, 0), sheet.st(lanes, 1));
    let mut places = [[0.0; ROOM]; 2];
    let mut count = 0;
    for pair in 0..PAIRS {
        let some = of_pair(needed, pair);
        if some != 0 {
            let (s, t) = (sheet.pair(lanes, s, pair), sheet.pair(lanes, t, pair));
            lanes.store(lanes.compress(s, some), at_mut(&mut places[0], count));
            lanes.store(lanes.compress(t, some), at_mut(&mut places[1], count));
            count += some.count_ones() as usize;
        }
    }
    let mut found = [0.0; ROOM];
    for first in (0..count).step_by(LANES) {
        let some = 0xffff >> (LANES - (count - first).min(LANES));
        let [s, t] = [at(&places[0], first), at(&places[1], first)];
        let value = look_up(lanes, texels, [lanes.load(s), lanes.load(t)], some);
        lanes.store(value, at_mut(&mut found, first));
    }
    let mut first = 0;
    for (pair, value) in values.iter_mut().enumerate() {
        let some = of_pair(needed, pair);
        if some != 0 {
            *value = lanes.expand(lanes.load(at(&found, first)), some);
            first += some.count_ones() as usize;
        }
    }
}

/// Has the texels brought near that a block's vertices will be looked up in, if the image is larger than what is near anyway.
#[inline(always)]
pub(super) fn expect<L: Lanes, S: Sheet<L>>(
    lanes: L,
    texels: &Texels<'_>,
    sheet: &S,
    pairs: usize,
) {
    const NEAR: usize = 1 << 20;
    if texels.bytes.len() < NEAR {
        return;
    }
    let (s, t) = (sheet.st(lanes, 0), sheet.st(lanes, 1));
    let one = lanes.ints(1);
    for pair in 0..pairs {
        let (x, _, _) = along(lanes, texels, 0, sheet.pair(lanes, s, pair));
        let (y, _, _) = along(lanes, texels, 1, sheet.pair(lanes, t, pair));
        let (x, y) = (lanes.to_ints(x), lanes.to_ints(y));
        let columns = [x, lanes.add_ints(x, one)];
        let rows = [y, lanes.add_ints(y, one)];
        // Four neighbours lie in one line of the cache or in two, but for few.
        let [[at, _], [_, across]] = places(lanes, texels, columns, rows);
        lanes.prefetch(texels.bytes, at);
        lanes.prefetch(texels.bytes, across);
    }
}

/// Sixteen numbers from some place on.
#[inline(always)]
fn at(all: &[f32], first: usize) -> &[f32; LANES] {
    all[first..].first_chunk().expect("there is room for all")
}

#[inline(always)]
fn at_mut(all: &mut [f32], first: usize) -> &mut [f32; LANES] {
    all[first..]
        .first_chunk_mut()
        .expect("there is room for all")
}

/// Sixteen look-ups at once, as [`Texels::eval`] does each, in the lanes whose bits are set.
#[inline(always)]
fn look_up<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [s, t]: [L::Floats; 2],
    needed: u32,
) -> L::Floats {
    let (x, fx, x_within) = along(lanes, texels, 0, s);
    let (y, fy, y_within) = along(lanes, texels, 1, t);
    let four = if x_within & y_within & needed == needed {
        inner(lanes, texels, [lanes.to_ints(x), lanes.to_ints(y)], needed)
    } else {
        at_borders(lanes, texels, [x, y], needed)
    };
    let [low, high] = match four {
        Some(four) => four,
        None => by_one(lanes, texels, [x, y], needed),
    };
    blend(lanes, [blend(lanes, low, fx), blend(lanes, high, fx)], fy)
}

/// The four texels around places that are not at a border; none if more bytes than there are would be read.
#[inline(always)]
fn inner<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Ints; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let Texels {
        bytes,
        kind,
        size: [width, height],
        stride,
        first,
        order,
        ..
    } = *texels;
    if !order.is_rows() {
        return in_squares(lanes, texels, [x, y], needed);
    }
    // Rows go down, y goes up.
    let row = stride * width as usize;
    let lowest = lanes.ints((row * (height as usize - 1) + first) as i32);
    let at = lanes.add_ints(lowest, lanes.mul_ints(x, lanes.ints(stride as i32)));
    let at = lanes.add_ints(at, lanes.mul_ints(y, lanes.ints(-(row as i32))));
    let above = lanes.add_ints(at, lanes.ints(-(row as i32)));
    let here = lanes.gather(bytes, at, needed)?;
    let there = lanes.gather(bytes, above, needed)?;
    // Both texels of a row in four bytes, if they are.
    Some(match (kind, stride) {
        (TexelKind::Half, 2) => [
            [lanes.of_halves(here), upper_half(lanes, here)],
            [lanes.of_halves(there), upper_half(lanes, there)],
        ],
        (TexelKind::Byte, 1) => [
            [
                byte(lanes, here),
                byte(lanes, lanes.shift_right_unsigned::<8>(here)),
            ],
            [
                byte(lanes, there),
                byte(lanes, lanes.shift_right_unsigned::<8>(there)),
            ],
        ],
        (TexelKind::Byte, 3) => [
            [
                byte(lanes, here),
                byte(lanes, lanes.shift_right_unsigned::<24>(here)),
            ],
            [
                byte(lanes, there),
                byte(lanes, lanes.shift_right_unsigned::<24>(there)),
            ],
        ],
        _ => {
            let next = lanes.ints(stride as i32);
            let right = lanes.gather(bytes, lanes.add_ints(at, next), needed)?;
            let above_right = lanes.gather(bytes, lanes.add_ints(above, next), needed)?;
            [
                [number(lanes, kind, here), number(lanes, kind, right)],
                [number(lanes, kind, there), number(lanes, kind, above_right)],
            ]
        }
    })
}

/// The same of an image whose texels lie in squares.
#[inline(always)]
fn in_squares<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Ints; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let one = lanes.ints(1);
    let columns = [x, lanes.add_ints(x, one)];
    let rows = [y, lanes.add_ints(y, one)];
    gather(lanes, texels, places(lanes, texels, columns, rows), needed)
}

/// The same at borders, where what is beyond is the image again; none where it is black.
#[inline(always)]
fn at_borders<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Floats; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let columns = wrapped(lanes, texels, 0, x, needed)?;
    let rows = wrapped(lanes, texels, 1, y, needed)?;
    gather(lanes, texels, places(lanes, texels, columns, rows), needed)
}

/// The indices along an axis, and the next ones, where the image has them: as [`Texels::place`]. None where it has not, or
/// where there are more than floats count.
#[inline(always)]
fn wrapped<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    axis: usize,
    i: L::Floats,
    needed: u32,
) -> Option<[L::Ints; 2]> {
    const MOST: u32 = 1 << 22;
    let count = texels.size[axis];
    if count > MOST {
        return None;
    }
    let (zero, last) = (lanes.floats(0.0), lanes.floats((count - 1) as f32));
    let next = lanes.add(i, lanes.floats(1.0));
    let [a, b] = match texels.wrap[axis] {
        Wrap::Black => return None,
        Wrap::Clamp => [i, lanes.min(next, last)],
        Wrap::Repeat => [i, lanes.if_less(last, next, zero, next)],
        Wrap::Mirror => {
            let end = lanes.floats((2 * count - 1) as f32);
            [
                lanes.min(i, lanes.sub(end, i)),
                lanes.min(next, lanes.sub(end, next)),
            ]
        }
    };
    // One before the first.
    let before = match texels.wrap[axis] {
        Wrap::Repeat => last,
        _ => zero,
    };
    let a = lanes.if_less(a, zero, before, a);
    let b = lanes.max(b, zero);
    let within = lanes.less_equal(lanes.floats(-1.0), i)
        & lanes.less_equal(a, last)
        & lanes.less_equal(b, last);
    (within & needed == needed).then_some([lanes.to_ints(a), lanes.to_ints(b)])
}

/// The places of texels in two columns and two rows from below, in bytes.
#[inline(always)]
fn places<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, next]: [L::Ints; 2],
    [y, above]: [L::Ints; 2],
) -> [[L::Ints; 2]; 2] {
    let (across, down) = (texels.order.across(), texels.order.down());
    // Rows go down.
    let (top, minus) = (lanes.ints(texels.size[1] as i32 - 1), lanes.ints(-1));
    let row = lanes.add_ints(top, lanes.mul_ints(y, minus));
    let above = lanes.add_ints(top, lanes.mul_ints(above, minus));
    let first = lanes.ints(texels.first as i32);
    let left = lanes.add_ints(place(lanes, across, x, texels.stride), first);
    let right = lanes.add_ints(place(lanes, across, next, texels.stride), first);
    let low = place(lanes, down, row, texels.stride);
    let high = place(lanes, down, above, texels.stride);
    [
        [lanes.add_ints(left, low), lanes.add_ints(right, low)],
        [lanes.add_ints(left, high), lanes.add_ints(right, high)],
    ]
}

/// The numbers in these places.
#[inline(always)]
fn gather<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [[a, b], [c, d]]: [[L::Ints; 2]; 2],
    needed: u32,
) -> Option<[[L::Floats; 2]; 2]> {
    let (kind, bytes) = (texels.kind, texels.bytes);
    let at = [
        lanes.gather(bytes, a, needed)?,
        lanes.gather(bytes, b, needed)?,
        lanes.gather(bytes, c, needed)?,
        lanes.gather(bytes, d, needed)?,
    ];
    Some([
        [number(lanes, kind, at[0]), number(lanes, kind, at[1])],
        [number(lanes, kind, at[2]), number(lanes, kind, at[3])],
    ])
}

/// What is to be added for columns or rows, in bytes: see [`TexelOrder`](crate::surface::TexelOrder).
#[inline(always)]
fn place<L: Lanes>(lanes: L, by: [u32; 3], i: L::Ints, stride: usize) -> L::Ints {
    let [one, small, large] = by.map(|by| (by as usize * stride) as i32);
    let ones = lanes.mul_ints(i, lanes.ints(one));
    let fourths = lanes.mul_ints(lanes.shift_right::<2>(i), lanes.ints(small));
    let rest = lanes.mul_ints(lanes.shift_right::<5>(i), lanes.ints(large));
    lanes.add_ints(lanes.add_ints(ones, fourths), rest)
}

#[inline(always)]
fn byte<L: Lanes>(lanes: L, four: L::Ints) -> L::Floats {
    let byte = lanes.to_floats(lanes.and_ints(four, lanes.ints(255)));
    lanes.mul(byte, lanes.floats(FROM_BYTE))
}

#[inline(always)]
fn upper_half<L: Lanes>(lanes: L, two: L::Ints) -> L::Floats {
    lanes.of_halves(lanes.shift_right_unsigned::<16>(two))
}

#[inline(always)]
fn number<L: Lanes>(lanes: L, kind: TexelKind, four: L::Ints) -> L::Floats {
    match kind {
        TexelKind::Byte => byte(lanes, four),
        TexelKind::Half => lanes.of_halves(four),
        TexelKind::Float => lanes.of_bits(four),
    }
}

/// The same anywhere, one after the other.
#[inline(always)]
fn by_one<L: Lanes>(
    lanes: L,
    texels: &Texels<'_>,
    [x, y]: [L::Floats; 2],
    needed: u32,
) -> [[L::Floats; 2]; 2] {
    let (mut xs, mut ys) = ([0.0; LANES], [0.0; LANES]);
    lanes.store(x, &mut xs);
    lanes.store(y, &mut ys);
    let [[a, b], [c, d]] = each(texels, [&xs, &ys], needed);
    [
        [lanes.load(&a), lanes.load(&b)],
        [lanes.load(&c), lanes.load(&d)],
    ]
}

#[inline(never)]
fn each(texels: &Texels<'_>, [xs, ys]: [&[f32; LANES]; 2], needed: u32) -> [[[f32; LANES]; 2]; 2] {
    let mut four = [[[0.0; LANES]; 2]; 2];
    for i in (0..LANES).filter(|i| needed >> i & 1 == 1) {
        let values = texels.four(xs[i] as i64, ys[i] as i64);
        for (four, value) in four.iter_mut().flatten().zip(values.as_flattened()) {
            four[i] = *value;
        }
    }
    four
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::simd::{Body, Isa};
    use crate::math::Vec2;
    use crate::surface::tests::shapes::{Random, noise};

    struct LookUp<'a>(&'a Texels<'a>, [[f32; LANES]; 2]);

    impl Body for LookUp<'_> {
        type Output = [f32; LANES];

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> [f32; LANES] {
            let Self(texels, [s, t]) = self;
            let mut out = [0.0; LANES];
            let st = [lanes.load(&s), lanes.load(&t)];
            lanes.store(look_up(lanes, texels, st, 0xffff), &mut out);
            out
        }
    }

    /// In rows and in squares, within the image, at its borders and beyond.
    #[test]
    fn sixteen_at_once_are_what_each_is() {
        let mut random = Random(7);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp, Wrap::Black] {
            for size in [[37, 23], [1, 3], [512, 544]] {
                let texture = noise(size, "Y", wrap, 5);
                let texels = texture.texels(0).expect("it is as in memory");
                assert_eq!(texels.order.is_rows(), size[0] < 512);
                for round in 0..400 {
                    // All over, and within a texel or two of a border.
                    let mut along = |axis: usize| {
                        let reach = 2.0 / size[axis] as f32;
                        let border = (4.0 * random.next()).floor() - 1.0;
                        match round % 4 {
                            0 => random.next(),
                            1 => 4.0 * random.next() - 1.5,
                            2 => border,
                            _ => border + reach * (2.0 * random.next() - 1.0),
                        }
                    };
                    let s = std::array::from_fn(|_| along(0));
                    let t = std::array::from_fn(|_| along(1));
                    let each = std::array::from_fn(|i| texels.eval(Vec2::new(s[i], t[i])));
                    for isa in Isa::all() {
                        let all: [f32; LANES] = isa.run(LookUp(&texels, [s, t]));
                        assert_eq!(all, each, "{wrap:?} {size:?} {isa:?}: {s:?} {t:?}");
                    }
                }
            }
        }
    }
}
