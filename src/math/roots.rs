//! Roots of quadratic and cubic polynomials, in single and in double precision.
//!
//! Quadratics: the discriminant is a difference of products that is rounded once (Kahan, "On the Cost of Floating-Point
//! Computation Without Extra-Precise Arithmetic", 2004), and neither root is a difference of like numbers. Cubics: after
//! Yuksel, "High-Performance Polynomial Root Finding for Graphics" (HPG 2022), the interval is cut where the derivative
//! vanishes, and in each part, where the cubic is monotone, a change of sign is closed in on by Newton's steps that never
//! leave their bracket. Unlike there cubics come by their Bernstein coefficients, whose changes of sign tell without
//! further ado that there is no root, or only one (Descartes' rule).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers of single or double precision.
pub trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The distance from 1 to the next number.
    const EPSILON: Self;
    /// A small integer or the like, exactly.
    fn of(value: f32) -> Self;
    /// The absolute value.
    fn abs(self) -> Self;
    /// The square root.
    fn sqrt(self) -> Self;
    /// `a b - c d`, wrong by two roundings of the result at most, not of the products.
    fn difference_of_products(a: Self, b: Self, c: Self, d: Self) -> Self;
}

impl Real for f32 {
    const EPSILON: Self = Self::EPSILON;
    #[inline(always)]
    fn of(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn difference_of_products(a: Self, b: Self, c: Self, d: Self) -> Self {
        // Double precision holds the products exactly.
        let [a, b, c, d] = [a, b, c, d].map(f64::from);
        (a * b - c * d) as Self
    }
}

impl Real for f64 {
    const EPSILON: Self = Self::EPSILON;
    #[inline(always)]
    fn of(value: f32) -> Self {
        Self::from(value)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn difference_of_products(a: Self, b: Self, c: Self, d: Self) -> Self {
        let product = c * d;
        let error = (-c).mul_add(d, product);
        a.mul_add(b, -product) + error
    }
}

/// The real roots of `a x² + b x + c`, in any order; none where all three are 0. A double root may come once, twice, or not
/// at all, as rounding of the coefficients has it.
#[inline(always)]
pub fn quadratic<T: Real>(a: T, b: T, c: T) -> [Option<T>; 2] {
    let zero = T::of(0.0);
    if a == zero {
        return [(b != zero).then(|| -c / b), None];
    }
    let discriminant = T::difference_of_products(b, b, T::of(4.0) * a, c);
    // False for what is not a number, too.
    let is_real = discriminant >= zero;
    if !is_real {
        return [None; 2];
    }
    let root = discriminant.sqrt();
    let q = T::of(-0.5) * if b < zero { b - root } else { b + root };
    if q == zero {
        return [Some(zero), None];
    }
    [Some(q / a), Some(c / q)]
}

/// The least root within 0..1 of the cubic with these Bernstein coefficients; ends count where the cubic is 0 there.
#[inline(always)]
pub fn first_cubic_root<T: Real>(c: [T; 4]) -> Option<T> {
    let zero = T::of(0.0);
    let one = T::of(1.0);
    if c[0] == zero {
        return Some(zero);
    }
    let above = c[0] > zero;
    let beyond = |value: T| if above { value <= zero } else { value >= zero };
    match [beyond(c[1]), beyond(c[2]), beyond(c[3])] {
        [false, false, false] => None,
        // One change of sign.
        [false, false, true] | [false, true, true] | [true, true, true] => {
            Some(bracketed(&Cubic::of_bernstein(c), zero, one))
        }
        _ => {
            let cubic = Cubic::of_bernstein(c);
            let three = T::of(3.0);
            let mut cuts = quadratic(three * cubic.0[3], T::of(2.0) * cubic.0[2], cubic.0[1]);
            if let [Some(a), Some(b)] = cuts
                && b < a
            {
                cuts.swap(0, 1);
            }
            let mut low = zero;
            for cut in cuts.into_iter().flatten() {
                if cut > low && cut < one {
                    if beyond(cubic.at(cut)) {
                        return Some(bracketed(&cubic, low, cut));
                    }
                    low = cut;
                }
            }
            beyond(c[3]).then(|| bracketed(&cubic, low, one))
        }
    }
}

/// A cubic by its coefficients, that of the constant first.
struct Cubic<T>([T; 4]);

impl<T: Real> Cubic<T> {
    #[inline(always)]
    fn of_bernstein([a, b, c, d]: [T; 4]) -> Self {
        let three = T::of(3.0);
        let (ab, bc, cd) = (b - a, c - b, d - c);
        Self([a, three * ab, three * (bc - ab), cd - bc - (bc - ab)])
    }

    #[inline(always)]
    fn at(&self, x: T) -> T {
        let [a, b, c, d] = self.0;
        a + x * (b + x * (c + x * d))
    }

    #[inline(always)]
    fn slope(&self, x: T) -> T {
        let [_, b, c, d] = self.0;
        b + x * (T::of(2.0) * c + x * (T::of(3.0) * d))
    }
}

/// The root between two places of which the cubic has other signs, or zero.
#[inline]
fn bracketed<T: Real>(cubic: &Cubic<T>, mut low: T, mut high: T) -> T {
    let (from, to) = (cubic.at(low), cubic.at(high));
    let rises = from < to;
    let half = T::of(0.5);
    let mut x = low + (high - low) * (from / (from - to));
    if !(x > low && x < high) {
        x = half * (low + high);
    }
    for _ in 0..MOST_STEPS {
        let value = cubic.at(x);
        if value == T::of(0.0) {
            return x;
        }
        if (value < T::of(0.0)) == rises {
            low = x;
        } else {
            high = x;
        }
        let mut next = x - value / cubic.slope(x);
        if !(next > low && next < high) {
            next = half * (low + high);
        }
        let step = next - x;
        x = next;
        if step.abs() <= T::of(2.0) * T::EPSILON * x.abs() || high - low <= T::EPSILON * high.abs()
        {
            break;
        }
    }
    x
}

/// Bisection alone would need as many for double precision.
const MOST_STEPS: usize = 64;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bernstein(roots: [f64; 3], scale: f64) -> [f64; 4] {
        // (x - r) has the coefficients -r and 1 - r; products of them are symmetrised.
        let [p, q, r] = roots.map(|r| [-r, 1.0 - r]);
        let term = |i: usize, j: usize, k: usize| p[i] * q[j] * r[k];
        [
            scale * term(0, 0, 0),
            scale * (term(1, 0, 0) + term(0, 1, 0) + term(0, 0, 1)) / 3.0,
            scale * (term(1, 1, 0) + term(1, 0, 1) + term(0, 1, 1)) / 3.0,
            scale * term(1, 1, 1),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn quadratics_give_back_their_roots(
            a in -3.0_f64..3.0, b in -3.0_f64..3.0, scale in prop::sample::select(vec![1e-6, 1.0, -3.0, 1e5])
        ) {
            prop_assume!((a - b).abs() > 1e-3);
            let found = quadratic(scale, -scale * (a + b), scale * a * b);
            let mut found: Vec<f64> = found.into_iter().flatten().collect();
            found.sort_by(f64::total_cmp);
            prop_assert_eq!(found.len(), 2);
            prop_assert!((found[0] - a.min(b)).abs() < 1e-11 && (found[1] - a.max(b)).abs() < 1e-11);
            let single = quadratic(scale as f32, (-scale * (a + b)) as f32, (scale * a * b) as f32);
            for root in single.into_iter().flatten() {
                // Coefficients were rounded, too: close roots move apart.
                let near = (f64::from(root) - a).abs().min((f64::from(root) - b).abs());
                prop_assert!(near < 4e-6 / (a - b).abs(), "{root} {a} {b}");
            }
        }

        #[test]
        fn small_roots_of_quadratics_do_not_cancel(tiny in 1e-12_f64..1e-6, large in 1.0_f64..1e6) {
            for sign in [1.0, -1.0] {
                let found = quadratic(1.0, -sign * (tiny + large), tiny * large);
                let least = found.into_iter().flatten().map(f64::abs).fold(f64::INFINITY, f64::min);
                prop_assert!((least - tiny).abs() < 1e-14 * tiny.max(1e-3 * tiny), "{least} {tiny}");
            }
        }

        #[test]
        fn the_first_root_of_a_cubic_is_found(
            roots in prop::array::uniform3(-1.0_f64..2.0), scale in prop::sample::select(vec![1e-3, 1.0, -7.0])
        ) {
            let mut sorted = roots;
            sorted.sort_by(f64::total_cmp);
            let apart = (sorted[1] - sorted[0]).min(sorted[2] - sorted[1]);
            let from_ends = roots.iter().fold(1.0_f64, |m, r| m.min(r.abs()).min((r - 1.0).abs()));
            prop_assume!(apart > 1e-2 && from_ends > 1e-3);
            let expected = sorted.into_iter().find(|r| (0.0..=1.0).contains(r));
            let c = bernstein(roots, scale);
            match (first_cubic_root(c), expected) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-10, "{a} {b}"),
                (a, b) => prop_assert_eq!(a, b),
            }
            match (first_cubic_root(c.map(|c| c as f32)), expected) {
                (Some(a), Some(b)) => prop_assert!((f64::from(a) - b).abs() < 1e-2, "{a} {b}"),
                (a, b) => prop_assert_eq!(a.is_none(), b.is_none()),
            }
        }

        #[test]
        fn an_odd_number_of_roots_is_never_missed(c in prop::array::uniform4(-1.0_f32..1.0)) {
            if (c[0] < 0.0) != (c[3] < 0.0) {
                let root = first_cubic_root(c);
                prop_assert!(root.is_some_and(|x| (0.0..=1.0).contains(&x)), "{c:?}");
                let x = root.unwrap_or(0.0);
                prop_assert!(Cubic::of_bernstein(c).at(x).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn degenerate_polynomials_have_the_roots_they_have() {
        assert_eq!(quadratic(0.0, 0.0, 0.0), [None, None]);
        assert_eq!(quadratic(0.0, 2.0, -1.0), [Some(0.5), None]);
        assert_eq!(quadratic(1.0, 0.0, 0.0), [Some(0.0), None]);
        assert_eq!(quadratic(1.0, 0.0, 1.0), [None, None]);
        assert_eq!(quadratic(f64::NAN, 1.0, 1.0), [None, None]);
        assert_eq!(first_cubic_root([1.0, 1.0, 1.0, 1.0]), None);
        assert_eq!(first_cubic_root([0.0, 1.0, 1.0, 1.0]), Some(0.0));
        let end = first_cubic_root([1.0_f64, 1.0, 1.0, 0.0]).expect("a root");
        assert!((end - 1.0).abs() < 1e-15);
        let linear = first_cubic_root([-1.0_f64, 0.0, 1.0, 2.0]).expect("a root");
        assert!((linear - 1.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn products_that_cancel_are_not_lost() {
        let (a, b) = (1.0_f32 + f32::EPSILON, 1.0 - f32::EPSILON);
        assert_eq!(
            f32::difference_of_products(a, b, 1.0, 1.0),
            -(f32::EPSILON * f32::EPSILON)
        );
        let (a, b) = (1.0 + f64::EPSILON, 1.0 - f64::EPSILON);
        assert_eq!(
            f64::difference_of_products(a, b, 1.0, 1.0),
            -(f64::EPSILON * f64::EPSILON)
        );
    }
}
