//! All instruction sets give the bits of the portable one.

use super::*;
use crate::surface::tests::shapes::Random;

/// Every operation on some lanes, as bits.
struct All<'a> {
    a: [f32; LANES],
    b: [f32; LANES],
    bytes: &'a [u8],
    rows: [usize; 2],
    width: u32,
    halves: [i32; LANES],
}

impl Body for All<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<u32> {
        let (a, b) = (lanes.load(&self.a), lanes.load(&self.b));
        let fields = lanes.fields(self.bytes, self.rows, self.width);
        let counts: [i32; LANES] = std::array::from_fn(|i| i as i32 - 7);
        let ints = lanes.mul_ints(fields, lanes.load_ints(&counts));
        let ints = lanes.shift_right::<6>(lanes.add_ints(ints, lanes.ints(-5)));
        let ints = lanes.and_ints(ints, lanes.ints(0x00ff_ff7f));
        let bytes: &[u8; LANES] = self.bytes[..LANES].try_into().expect("sixteen");
        let nibbles = bytes.map(|byte| byte & 15);
        let shorts = bytes.map(|byte| 257 * u16::from(byte));
        let floats = [
            lanes.add(a, b),
            lanes.sub(a, b),
            lanes.mul(a, b),
            lanes.div(a, b),
            lanes.mul_add(a, b, lanes.floats(self.a[2])),
            lanes.sub_mul(b, a, lanes.floats(self.b[1])),
            lanes.min(a, b),
            lanes.max(a, b),
            lanes.next_in_row(a),
            lanes.next_row(a, b),
            lanes.bytes(bytes),
            lanes.to_floats(ints),
            lanes.floats(self.a[3]),
            lanes.pick(&Nibbles::new(nibbles), a),
            lanes.sqrt(lanes.max(a, lanes.floats(0.0))),
            lanes.if_less(a, b, b, a),
            lanes.to_floats(lanes.fours(&shorts, [3, 0, 12, 7])),
            lanes.to_floats(lanes.shorts(&shorts)),
            lanes.to_floats(lanes.narrow_fields(
                self.bytes,
                self.rows[0],
                self.width % (NARROW + 1),
            )),
        ];
        let halves = lanes.load_ints(&self.halves);
        let [one, other] = lanes.two_rows(a, self.rows[0] % 4);
        let small =
            lanes.to_floats(lanes.to_ints(lanes.mul(lanes.bytes(bytes), lanes.floats(1.7))));
        let at = lanes.and_ints(fields, lanes.ints(63));
        let bits = lanes.less(b, a) | 1;
        let gathered = (lanes.gather(self.bytes, at, bits)).expect("they are all there");
        assert!(lanes.gather(&self.bytes[..3], at, bits).is_none());
        // What is not asked for need not be there.
        let far = lanes.add_ints(at, lanes.ints(i32::MAX - 1000));
        assert!(lanes.gather(self.bytes, far, bits).is_none());
        assert!(lanes.gather(self.bytes, far, 0).is_some());
        lanes.prefetch(self.bytes, far);
        let more = [
            lanes.abs(a),
            lanes.floor(a),
            small,
            lanes.select(self.width * 4099, a, b),
            lanes.compress(a, self.width * 4099),
            lanes.expand(b, self.width * 4099),
            lanes.of_bits(lanes.and_ints(gathered, lanes.ints(0x3fff_ffff))),
            lanes.of_halves(halves),
            lanes.to_floats(lanes.shift_right_unsigned::<9>(ints)),
            lanes.two(self.a[1], self.b[2]),
            one,
            other,
        ];
        let mut out = vec![lanes.less(a, b), lanes.less_equal(a, b)];
        for values in floats.into_iter().chain(more) {
            let mut stored = [0.0; LANES];
            lanes.store(values, &mut stored);
            out.extend(stored.map(f32::to_bits));
        }
        out
    }
}

/// The same of double precision.
struct AllDoubles([[f64; EIGHT]; 3]);

impl Body for AllDoubles {
    type Output = Vec<u64>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<u64> {
        let [a, b, c] = [
            lanes.load_doubles(&self.0[0]),
            lanes.load_doubles(&self.0[1]),
            lanes.load_doubles(&self.0[2]),
        ];
        let all = [
            lanes.add_doubles(a, b),
            lanes.sub_doubles(a, b),
            lanes.mul_doubles(a, b),
            lanes.div_doubles(a, b),
            lanes.mul_sub_doubles(a, b, c),
            lanes.root_doubles(a),
            lanes.with_signs(lanes.root_doubles(c), a),
            lanes.doubles(self.0[1][2]),
            lanes.pick_doubles(&[3, 0, 7, 7, 1, 2, 6, 4], c),
        ];
        let mut out = vec![u64::from(lanes.less_doubles(a, b))];
        for values in all {
            let mut stored = [0.0; EIGHT];
            lanes.store_doubles(values, &mut stored);
            let bits = |x: f64| if x.is_nan() { f64::NAN } else { x }.to_bits();
            out.extend(stored.map(bits));
        }
        out
    }
}

#[test]
fn all_sets_agree_on_doubles_to_the_bit() {
    let mut random = Random(12);
    for _ in 0..2000 {
        let mut value = || match (10.0 * random.next()) as u32 {
            0 => 0.0,
            1 => -0.0,
            2 => f64::INFINITY,
            3 => f64::NAN,
            _ => f64::from(random.next() - 0.5) / f64::from(random.next()),
        };
        let mut eight = || std::array::from_fn(|_| value());
        let all = [eight(), eight(), eight()];
        let expected = Isa(Set::Portable).run(AllDoubles(all));
        for isa in Isa::all() {
            assert_eq!(isa.run(AllDoubles(all)), expected, "{isa:?}, {all:?}");
        }
    }
}

#[test]
fn all_sets_agree_to_the_bit() {
    let mut random = Random(11);
    for round in 0..2000 {
        let mut value = || match (8.0 * random.next()) as u32 {
            0 => 0.0,
            1 => -0.0,
            2 => f32::INFINITY,
            3 => f32::NAN,
            4 => 1.0,
            _ => 200.0 * (random.next() - 0.5),
        };
        let (a, b) = (
            std::array::from_fn(|_| value()),
            std::array::from_fn(|_| value()),
        );
        let bytes: Vec<u8> = (0..120).map(|_| (256.0 * random.next()) as u8).collect();
        let width = round % (WIDEST + 1);
        let body = || All {
            a,
            b,
            bytes: &bytes,
            rows: [round as usize % 31, 40 + round as usize % 17],
            width,
            halves: std::array::from_fn(|i| {
                let half = i32::from(bytes[i]) << 8 | i32::from(bytes[i + 50]);
                // All but infinities.
                half & !0x0400
            }),
        };
        let not_numbers = |bits: Vec<u32>| -> Vec<u32> {
            // Which one of several it is, IEEE 754 leaves open.
            let nan = |b: u32| f32::from_bits(b).is_nan();
            bits.into_iter()
                .map(|b| if nan(b) { f32::NAN.to_bits() } else { b })
                .collect()
        };
        let expected = not_numbers(Isa(Set::Portable).run(body()));
        for isa in Isa::all() {
            assert_eq!(
                not_numbers(isa.run(body())),
                expected,
                "{isa:?}, {width} bits"
            );
        }
    }
}

#[test]
fn signs_are_those_of_numbers() {
    struct Signs([[f32; LANES]; 4]);
    impl Body for Signs {
        type Output = [u64; 2];
        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> [u64; 2] {
            let [a, b, c, d] = &self.0;
            lanes.signs([lanes.load(a), lanes.load(b), lanes.load(c), lanes.load(d)])
        }
    }
    let mut random = Random(13);
    for _ in 0..500 {
        let mut value = || {
            let size = match (6.0 * random.next()) as u32 {
                0 | 1 => 0.0,
                2 => f32::from_bits(1 + (300.0 * random.next()) as u32),
                3 => f32::INFINITY,
                4 => f32::MAX,
                _ => random.next(),
            };
            if random.next() < 0.5 { -size } else { size }
        };
        let four: [[f32; LANES]; 4] = std::array::from_fn(|_| std::array::from_fn(|_| value()));
        let bits = |is: fn(f32) -> bool| {
            let all = four.as_flattened().iter().enumerate();
            all.fold(0, |bits, (i, &value)| bits | u64::from(is(value)) << i)
        };
        let expected = [bits(|v| v < 0.0), bits(|v| v > 0.0)];
        for isa in Isa::all() {
            assert_eq!(isa.run(Signs(four)), expected, "{isa:?}: {four:?}");
        }
    }
}

#[test]
fn fields_come_back() {
    for width in 0..=WIDEST {
        let most = (1_u64 << width) - 1;
        let values: Vec<u64> = (0..8).map(|i| (most / 7 * i).min(most)).collect();
        let mut bytes = vec![0_u8; 64];
        for (i, value) in values.iter().enumerate() {
            for bit in 0..width as usize {
                let at = i * width as usize + bit;
                bytes[3 + at / 8] |= ((value >> bit & 1) as u8) << (at % 8);
            }
        }
        struct Take<'a>(&'a [u8], u32);
        impl Body for Take<'_> {
            type Output = [f32; LANES];
            #[inline(always)]
            fn run<L: Lanes>(self, lanes: L) -> [f32; LANES] {
                let mut out = [0.0; LANES];
                let fields = lanes.fields(self.0, [3, 3], self.1);
                lanes.store(lanes.to_floats(fields), &mut out);
                out
            }
        }
        for isa in Isa::all() {
            let out = isa.run(Take(&bytes, width));
            for (i, value) in values.iter().enumerate() {
                assert_eq!([out[i], out[i + 8]], [*value as f32; 2], "{isa:?} {width}");
            }
        }
    }
}
