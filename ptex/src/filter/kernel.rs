//! The taps of a separable filter along one axis: which texels, with which weights.
//!
//! Burley and Lacewell 2008, section 5, as files of today are filtered: a filter of width `w` works on the reduction
//! whose texels are not wider than it, and the kernel is sampled at the texels' centres. Close to the width of a whole
//! face too few texels are left to sample the kernel, and bumps of ever simpler shape take its place, down to the mean
//! of two faces. With `lerp` each pair of texels that the next reduction would average drifts towards a common weight,
//! so that nothing jumps where the reduction changes.

use super::FilterKind;

/// Most taps along an axis. A kernel has 10 at most: 8 within two widths, rounded out to pairs. Only the two to four
/// taps at one texel a face are ever doubled.
pub(super) const MAX_TAPS: usize = 16;

/// Taps side by side along one axis of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    /// Logarithm of the texels along the side of the face that the taps are placed on.
    pub(super) log2: i8,
    /// The first tap's texel. Texels below 0 and from 2^`log2` on are beyond an edge.
    pub(super) at: i32,
    len: usize,
    weights: [f32; MAX_TAPS],
}

/// What a filter is along both axes.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub(super) kind: FilterKind,
    /// The sharpness that a bicubic kernel has.
    pub(super) sharpness: f32,
    pub(super) lerp: bool,
}

impl Shape {
    /// The taps around `x`, in units of the face, for a width `w` on a side of 2^`log2` texels.
    pub(super) fn taps(self, x: f32, w: f32, log2: i8) -> Taps {
        let texel = texel_size(log2);
        let mut taps = match self.kind {
            FilterKind::Point => Taps::new(log2, clamped_floor(x * scale(log2), log2)).with(1.0),
            FilterKind::Bilinear => bilinear(x, level(w.max(texel).min(1.0))),
            FilterKind::Box => covered(x, w.max(texel).min(1.0)),
            FilterKind::Gaussian => self.sampled(gaussian, x, w.max(texel)),
            FilterKind::Bicubic
            | FilterKind::BSpline
            | FilterKind::CatmullRom
            | FilterKind::Mitchell => {
                let cubic = Cubic::new(match self.kind {
                    FilterKind::BSpline => 0.0,
                    FilterKind::CatmullRom => 1.0,
                    FilterKind::Mitchell => 2.0 / 3.0,
                    _ => self.sharpness,
                });
                self.sampled(|x| cubic.at(x), x, w.max(texel))
            }
        };
        taps.trim();
        taps
    }

    /// The kernel `k`, which has width 4 and reaches two widths to either side, sampled at texels.
    #[inline]
    fn sampled(self, k: impl Fn(f32) -> f32, x: f32, w: f32) -> Taps {
        if w < 0.25 {
            let log2 = level(w);
            let (p, reach) = (x * scale(log2) - 0.5, w * scale(log2));
            let ends = (ceil(p - 2.0 * reach), ceil(p + 2.0 * reach));
            let narrow = 1.0 / reach;
            let mix = reach - 1.0;
            // At one texel there is nothing to mix, and taps that only complete a pair would be too many.
            if self.lerp && mix > 0.0 {
                return blended(
                    log2,
                    pairs(ends),
                    mix,
                    |i| k((i - p) * narrow),
                    |i| k((i + 0.5 - p) * narrow),
                );
            }
            // Never more than eight, and eight at a time are as quick as four.
            let mut taps = Taps::new(log2, ends.0);
            let start = ends.0 as f32 - p;
            for (i, weight) in taps.weights[..8].iter_mut().enumerate() {
                *weight = k((start + i as f32) * narrow);
            }
            taps.len = ends.1.saturating_sub(ends.0).clamp(0, 8) as usize;
            taps
        } else if w < 0.5 {
            let p = 4.0 * x - 0.5;
            let ends = pairs((ceil(p - 2.0), ceil(p + 2.0)));
            if self.lerp {
                return blended(
                    2,
                    ends,
                    4.0 * w - 1.0,
                    |i| k(i - p),
                    |i| bump((i + 0.5 - p) * 0.5 / (w + 0.75)),
                );
            }
            Taps::sampled(2, ends, |i| k(i - p))
        } else if w < 1.0 {
            let p = 2.0 * x - 0.5;
            let first = 2 * floor(x - 0.5);
            let wide = 1.5 * w + 0.5;
            let ends = (first, first + 4);
            if self.lerp {
                return blended(
                    1,
                    ends,
                    2.0 * w - 1.0,
                    |i| bump((i - p) / wide),
                    |i| bump((i + 0.5 - p) / wide),
                );
            }
            Taps::sampled(1, ends, |i| bump((i - p) / wide))
        } else {
            let first = floor(x - 0.5);
            let weight = bump(x - 0.5 - first as f32);
            Taps::new(0, first).with(weight).with(1.0 - weight)
        }
    }
}

/// Each tap between its own weight and one that it shares with its partner: `mix` is how far on the way to the next
/// reduction. Both functions take the number of a texel; `common` takes that of the first of a pair.
#[inline]
fn blended(
    log2: i8,
    ends: (i32, i32),
    mix: f32,
    own: impl Fn(f32) -> f32,
    common: impl Fn(f32) -> f32,
) -> Taps {
    Taps::sampled(log2, ends, |i| {
        (1.0 - mix) * own(i) + mix * common(2.0 * (i * 0.5).floor())
    })
}

fn bilinear(x: f32, log2: i8) -> Taps {
    let p = x * scale(log2) - 0.5;
    let first = floor(p);
    let part = p - first as f32;
    Taps::new(log2, first).with(1.0 - part).with(part)
}

/// Of each texel the part that lies within half a width of `x`.
fn covered(x: f32, w: f32) -> Taps {
    let log2 = level(w);
    let low = (x - 0.5 * w) * scale(log2);
    let high = (x + 0.5 * w) * scale(log2);
    Taps::sampled(log2, (floor(low), ceil(high)), |i| {
        (high.min(i + 1.0) - low.max(i)).max(0.0)
    })
}

fn gaussian(x: f32) -> f32 {
    (-2.0 * x * x).exp()
}

/// The family of Mitchell and Netravali (1988) with `B + 2 C = 1`; sharpness is `1 - B`.
#[derive(Clone, Copy)]
struct Cubic {
    /// Coefficients of |x|³, x², |x| and 1, for |x| up to 1 and from there up to 2.
    near: [f32; 4],
    far: [f32; 4],
}

impl Cubic {
    fn new(sharpness: f32) -> Self {
        let b = 1.0 - sharpness;
        Self {
            near: [1.5 - b, 1.5 * b - 2.5, 0.0, 1.0 - b / 3.0],
            far: [
                b / 3.0 - 0.5,
                2.5 - 1.5 * b,
                2.0 * b - 4.0,
                2.0 - 2.0 * b / 3.0,
            ],
        }
    }

    #[inline]
    fn at(&self, x: f32) -> f32 {
        let x = x.abs();
        // Both are computed and one is taken: so several are computed at once.
        let [near, far] =
            [self.near, self.far].map(|[c3, c2, c1, c0]| ((c3 * x + c2) * x + c1) * x + c0);
        let value = if x < 1.0 { near } else { far };
        if x < 2.0 { value } else { 0.0 }
    }
}

/// One at 0, down to nothing at 1, smooth at both.
fn bump(x: f32) -> f32 {
    let x = x.abs();
    if x < 1.0 {
        (2.0 * x - 3.0) * x * x + 1.0
    } else {
        0.0
    }
}

/// The reduction for a width: the logarithm of its size, so that a texel is not wider than `w`, and more than half of
/// it. Below 0 for widths from 2 on.
pub(super) fn level(w: f32) -> i8 {
    let exponent = (w.to_bits() >> 23 & 0xff) as i32;
    (127 - exponent) as i8
}

/// 2^`log2`.
pub(super) fn scale(log2: i8) -> f32 {
    f32::from_bits(((127 + i32::from(log2)) as u32) << 23)
}

fn texel_size(log2: i8) -> f32 {
    scale(-log2)
}

/// Rounds down. The instruction for it is younger than the processors that this is built for.
#[inline]
fn floor(x: f32) -> i32 {
    let cut = x as i32;
    cut.saturating_sub(i32::from(x < cut as f32))
}

#[inline]
fn ceil(x: f32) -> i32 {
    let cut = x as i32;
    cut.saturating_add(i32::from(x > cut as f32))
}

/// Out to even numbers on both sides.
fn pairs((first, end): (i32, i32)) -> (i32, i32) {
    (first & !1, (end + 1) & !1)
}

pub(super) fn clamped_floor(x: f32, log2: i8) -> i32 {
    floor(x).clamp(0, (1 << log2) - 1)
}

impl Taps {
    fn new(log2: i8, at: i32) -> Self {
        Self {
            log2,
            at,
            len: 0,
            weights: [0.0; MAX_TAPS],
        }
    }

    fn with(mut self, weight: f32) -> Self {
        self.push(weight);
        self
    }

    #[inline]
    fn sampled(log2: i8, (first, end): (i32, i32), weight: impl Fn(f32) -> f32) -> Self {
        let mut taps = Self::new(log2, first);
        // Numbers that are none, or too large to be told apart, give no range to speak of.
        taps.len = (end.saturating_sub(first).max(0) as usize).min(MAX_TAPS);
        for (i, w) in taps.weights[..taps.len].iter_mut().enumerate() {
            *w = weight(first as f32 + i as f32);
        }
        taps
    }

    fn push(&mut self, weight: f32) {
        if let Some(place) = self.weights.get_mut(self.len) {
            *place = weight;
            self.len += 1;
        }
    }

    /// Texels along the side.
    #[inline]
    pub(super) fn size(&self) -> i32 {
        1 << self.log2
    }

    #[inline]
    pub(super) fn weights(&self) -> &[f32] {
        &self.weights[..self.len]
    }

    #[inline]
    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }

    #[inline]
    pub(super) fn sum(&self) -> f32 {
        self.weights().iter().sum()
    }

    /// One past the last tap's texel.
    #[inline]
    fn end(&self) -> i32 {
        self.at + self.len as i32
    }

    #[inline]
    pub(super) fn below(&self) -> bool {
        self.at < 0
    }

    #[inline]
    pub(super) fn above(&self) -> bool {
        self.end() > self.size()
    }

    /// Drops taps without weight at either end.
    fn trim(&mut self) {
        while self.len > 0 && self.weights[self.len - 1] == 0.0 {
            self.len -= 1;
        }
        while self.len > 0 && self.weights[0] == 0.0 {
            self.drop_first(1);
        }
    }

    fn drop_first(&mut self, count: usize) {
        self.weights.copy_within(count..self.len, 0);
        self.len -= count;
        self.at += count as i32;
    }

    /// Cuts off what lies below 0, and moves it to where the side beyond has it.
    pub(super) fn cut_below(&mut self) -> Self {
        let mut cut = *self;
        let count = (-self.at).clamp(0, self.len as i32) as usize;
        cut.len = count;
        cut.at += self.size();
        self.drop_first(count);
        cut
    }

    /// The same for what lies past the last texel.
    pub(super) fn cut_above(&mut self) -> Self {
        let mut cut = *self;
        let stay = (self.size() - self.at).clamp(0, self.len as i32) as usize;
        cut.drop_first(stay);
        cut.at -= self.size();
        self.len = stay;
        cut
    }

    /// Adds what was cut off at the low end to the first texel.
    pub(super) fn fold_below(&mut self, cut: &Self) {
        if self.is_empty() {
            self.at = 0;
            self.push(0.0);
        }
        self.weights[0] += cut.sum();
    }

    /// Adds what was cut off at the high end to the last texel.
    pub(super) fn fold_above(&mut self, cut: &Self) {
        if self.is_empty() {
            self.at = self.size() - 1;
            self.push(0.0);
        }
        self.weights[self.len - 1] += cut.sum();
    }

    /// From the other end.
    pub(super) fn mirror(&mut self) {
        self.weights[..self.len].reverse();
        self.at = self.size() - self.end();
    }

    /// Twice the texels, the same weights in all.
    fn double(&mut self) {
        let count = self.len.min(MAX_TAPS / 2);
        debug_assert_eq!(count, self.len);
        for i in (0..2 * count).rev() {
            self.weights[i] = 0.5 * self.weights[i / 2];
        }
        self.len = 2 * count;
        self.at *= 2;
        self.log2 += 1;
    }

    /// The same texels on a side that is half as long, and counts half as many.
    pub(super) fn onto_half(&mut self) {
        if self.log2 == 0 {
            self.double();
        }
        self.log2 -= 1;
    }

    /// The same texels on a side that is twice as long.
    pub(super) fn onto_double(&mut self) {
        self.log2 += 1;
    }

    /// Down to 2^`log2` texels: the two of a pair are added.
    #[inline]
    pub(super) fn reduce_to(&mut self, log2: i8) {
        while self.log2 > log2 {
            let odd = (self.at & 1) as usize;
            let len = (self.len + odd).div_ceil(2) * usize::from(self.len > 0);
            let mut weights = [0.0; MAX_TAPS];
            for (i, weight) in self.weights().iter().enumerate() {
                weights[(i + odd) / 2] += weight;
            }
            self.weights = weights;
            self.len = len;
            self.at >>= 1;
            self.log2 -= 1;
        }
    }

    /// Two rows of taps that begin at the same corner, as one: the sums, as many as both have.
    pub(super) fn merged(mut self, other: &Self) -> Self {
        self.len = self.len.min(other.len);
        for (weight, other) in self.weights[..self.len].iter_mut().zip(other.weights()) {
            *weight += other;
        }
        self
    }

    pub(super) fn multiply(&mut self, factor: f32) {
        for weight in &mut self.weights[..self.len] {
            *weight *= factor;
        }
    }
}
