//! Gradient noise and cells from a seed (Perlin 1985, Worley 1996).

/// A number from 0 to 1 for a lattice point.
pub(crate) fn hash(seed: u32, x: i32, y: i32) -> f32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
    for multiplier in [0x7feb_352d, 0x846c_a68b] {
        h = (h ^ (h >> 16)).wrapping_mul(multiplier);
    }
    ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
}

/// Smooth noise of one octave, about -0.7 to 0.7.
pub(crate) fn noise(seed: u32, x: f32, y: f32) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let (u, v) = (x - i, y - j);
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let corner = |a: i32, b: i32| {
        let angle = std::f32::consts::TAU * hash(seed, i as i32 + a, j as i32 + b);
        angle.cos() * (u - a as f32) + angle.sin() * (v - b as f32)
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let low = mix(corner(0, 0), corner(1, 0), fade(u));
    let high = mix(corner(0, 1), corner(1, 1), fade(u));
    mix(low, high, fade(v))
}

/// `octaves` octaves, each twice as fine and half as strong.
pub(crate) fn fractal(seed: u32, x: f32, y: f32, octaves: u32) -> f32 {
    let octave = |i: u32| {
        let scale = (1 << i) as f32;
        noise(seed.wrapping_add(i), x * scale, y * scale) / scale
    };
    (0..octaves).map(octave).sum()
}

/// How much farther the second nearest of scattered points is than the nearest: 0 at the walls between cells.
pub(crate) fn cell_wall(seed: u32, x: f32, y: f32) -> f32 {
    let (i, j) = (x.floor() as i32, y.floor() as i32);
    let (mut nearest, mut second) = (f32::INFINITY, f32::INFINITY);
    for (a, b) in (-2..=2).flat_map(|b| (-2..=2).map(move |a| (i + a, j + b))) {
        let p = [a as f32 + hash(seed, a, b), b as f32 + hash(!seed, a, b)];
        let d = (p[0] - x).hypot(p[1] - y);
        if d < nearest {
            (nearest, second) = (d, nearest);
        } else if d < second {
            second = d;
        }
    }
    second - nearest
}
