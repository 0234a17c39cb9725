//! The displacement maps: a slab with fossils, and a tile of scales.

use std::f32::consts::{LN_2, PI, TAU};

use super::HeightMap;
use super::noise::{cell_wall, fractal, hash, noise};

/// Ammonites in a broken slab: logarithmic spirals of round tubes with ribs.
pub(crate) struct Relief {
    seed: u32,
    shells: Vec<Shell>,
}

struct Shell {
    middle: [f32; 2],
    radius: f32,
    turn: f32,
    /// 1 or -1: which way it winds.
    hand: f32,
    ribs: f32,
}

impl Relief {
    pub(crate) fn new(seed: u32) -> Self {
        let places = [
            (0.40, 0.56, 0.31),
            (0.79, 0.77, 0.16),
            (0.78, 0.25, 0.19),
            (0.20, 0.15, 0.12),
            (0.12, 0.88, 0.09),
            (0.50, 0.10, 0.07),
            (0.93, 0.50, 0.06),
        ];
        let shell = |(i, (x, y, radius)): (i32, (f32, f32, f32))| Shell {
            middle: [x, y],
            radius,
            turn: TAU * hash(seed, i, 1),
            hand: if hash(seed, i, 2) < 0.5 { 1.0 } else { -1.0 },
            ribs: 22.0 + (10.0 * hash(seed, i, 3)).floor(),
        };
        Self {
            seed,
            shells: (0..).zip(places).map(shell).collect(),
        }
    }

    /// Weathered stone: broken plates over rolling ground.
    fn stone(&self, s: f32, t: f32) -> f32 {
        let warp = 0.06 * noise(self.seed ^ 7, 6.0 * s, 6.0 * t);
        let wall = cell_wall(self.seed ^ 5, 7.0 * (s + warp), 7.0 * (t - warp));
        let crack = -0.10 * (-(wall / 0.05).powi(2)).exp();
        let grain = 0.05 * fractal(self.seed ^ 3, 40.0 * s, 40.0 * t, 5);
        0.22 + 0.22 * fractal(self.seed, 3.0 * s, 3.0 * t, 6) + crack + grain
    }
}

impl HeightMap for Relief {
    fn height(&self, s: f32, t: f32) -> f32 {
        let stone = self.stone(s, t);
        let worn = 0.012 * fractal(self.seed ^ 9, 90.0 * s, 90.0 * t, 3);
        let shells = self.shells.iter().map(|shell| shell.height(s, t) + worn);
        shells.fold(stone, |low, shell| smooth_max(low, shell, 0.03))
    }
}

impl Shell {
    fn height(&self, s: f32, t: f32) -> f32 {
        let (x, y) = (s - self.middle[0], self.hand * (t - self.middle[1]));
        let r = x.hypot(y) / self.radius;
        if r > 1.0 {
            return -1.0;
        }
        let angle = y.atan2(x) + self.turn;
        // Each whorl is twice as far out as the one within it: the tube's number, and where we are across it.
        let whorls = r.max(1e-4).ln() / LN_2 - angle / TAU;
        let across = whorls - whorls.floor();
        let along = angle + TAU * whorls.floor();
        // The outermost whorl ends at its mouth, on the shell's own circle of radius 1.
        let outer = (LN_2 * (whorls.floor() + 1.0 + angle / TAU)).exp();
        if outer > 1.0 {
            return -1.0;
        }
        let round = (1.0 - (2.0 * across - 1.0).powi(2)).max(0.0).sqrt();
        let rib = (along * self.ribs / 2.0 + 2.0 * (across - 0.5).powi(2) * PI).cos();
        let size = self.radius * outer;
        let rise = 0.30 + 1.9 * size * round * (1.0 + 0.09 * rib);
        rise.min(1.0) * (round * 6.0).min(1.0)
    }
}

/// The larger of two, rounded off where they meet.
fn smooth_max(a: f32, b: f32, width: f32) -> f32 {
    let h = (width - (a - b).abs()).max(0.0) / width;
    a.max(b) + h * h * width / 4.0
}

/// A tile of rounded scales. It has all eight symmetries of the square: whatever way a neighbouring face is turned,
/// the heights on their common edge are the same, so that no face needs to know how the others lie.
pub(crate) struct Scales {
    seed: u32,
}

impl Scales {
    pub(crate) fn new(seed: u32) -> Self {
        Self { seed }
    }
}

impl HeightMap for Scales {
    fn height(&self, s: f32, t: f32) -> f32 {
        // Folded into one eighth of the square.
        let fold = |x: f32| 0.5 - (x - 0.5).abs();
        let (a, b) = (fold(s), fold(t));
        let (x, y) = (a.max(b), a.min(b));
        let wall = cell_wall(self.seed, 7.0 * x, 7.0 * y);
        let scale = (wall / 0.55).min(1.0);
        let grain = 0.06 * fractal(self.seed, 24.0 * x, 24.0 * y, 3);
        scale * (2.0 - scale) * (0.9 + grain)
    }
}
