//! Light from all directions: one radiance, or a latitude-longitude picture.
//!
//! UsdLux follows OpenEXR's environment maps: in the dome's own space the top row looks along +Y, the picture's
//! middle along +Z, and longitude falls from +pi at the left border to -pi at the right one, +pi/2 being +X: the
//! picture is the world as seen from inside, with +X left of its middle. Unlike OpenEXR, which puts the outermost
//! texels' centres on the poles and on the seam, we put the texels' outer edges there: no direction counts twice.
//!
//! The picture is sampled by luminance times solid angle, cell by cell, evenly over the solid angle in a cell. The
//! transform may be any affine map; a density then changes with the solid angle: if `d = M w` for unit `w`, a piece
//! of solid angle around `w` is multiplied with `|det M| / |d|^3`.

use std::f32::consts::PI;

use glam::Mat3;

use super::distribution::Grid;
use super::luminance;
use super::picture::Picture;
use crate::math::{DAffine3, Vec2, Vec3};

/// A dome light.
#[derive(Debug, Clone)]
pub(super) struct Dome {
    color: Vec3,
    dome_from_world: Mat3,
    world_from_dome: Mat3,
    /// |det| of `dome_from_world`.
    det: f32,
    picture: Option<(Picture, Grid)>,
    /// Mean radiance over the directions.
    pub(super) mean: Vec3,
}

/// The sampling table is at most this wide (and half as high): 8 MiB. Larger pictures are averaged down to it;
/// finer steps would hardly lower the noise.
const MOST_COLUMNS: u32 = 2048;

impl Dome {
    /// A dome of radiance `color`, times the picture.
    pub(super) fn new(color: Vec3, picture: Option<Picture>, world_from_light: &DAffine3) -> Self {
        let matrix = world_from_light.matrix3;
        let inverse = matrix.inverse();
        let picture = picture.map(|p| {
            let (grid, mean) = table(&p);
            ((p, grid), mean)
        });
        let mean = picture.as_ref().map_or(color, |(_, mean)| *mean * color);
        Self {
            color,
            dome_from_world: inverse.as_mat3(),
            world_from_dome: matrix.as_mat3(),
            det: inverse.determinant().abs() as f32,
            picture: picture.map(|(p, _)| p),
            mean,
        }
    }

    /// A direction and its density.
    pub(super) fn sample(&self, u: [f32; 2]) -> (Vec3, f32) {
        let Some((_, grid)) = &self.picture else {
            let z = 1.0 - 2.0 * u[0];
            let r = (4.0 * u[0] * (1.0 - u[0])).max(0.0).sqrt();
            let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
            return (Vec3::new(r * cos, r * sin, z), 0.25 / PI);
        };
        let (cell, within) = grid.pick(u);
        let [width, height] = grid.size().map(|n| n as f32);
        let longitude = PI - 2.0 * PI * (cell[0] as f32 + within[0]) / width;
        // Even in the sine of the latitude; near the poles by way of the versine, which keeps its digits.
        let [above, below] = [cell[1], cell[1] + 1].map(|y| versine(y as f32 / height));
        let v = above + within[1] * (below - above);
        let cos_latitude = (v * (2.0 - v)).max(0.0).sqrt();
        let (sin, cos) = longitude.sin_cos();
        let local = Vec3::new(sin * cos_latitude, 1.0 - v, cos * cos_latitude);
        let wi = (self.world_from_dome * local).normalize_or(Vec3::Y);
        let length = (self.dome_from_world * wi).length();
        let pdf = grid.probability(cell) / solid_angle(grid, cell[1]) * self.det / length.powi(3);
        (wi, pdf)
    }

    /// The density of the unit vector `wi`.
    pub(super) fn pdf(&self, wi: Vec3) -> f32 {
        let Some((_, grid)) = &self.picture else {
            return 0.25 / PI;
        };
        let local = self.dome_from_world * wi;
        let length = local.length();
        let [s, t] = latlong(local / length);
        let [width, height] = grid.size();
        let cell = [
            ((s * width as f32) as usize).min(width - 1),
            (((1.0 - t) * height as f32) as usize).min(height - 1),
        ];
        grid.probability(cell) / solid_angle(grid, cell[1]) * self.det / length.powi(3)
    }

    /// The radiance from the unit vector `wi`.
    pub(super) fn radiance(&self, wi: Vec3) -> Vec3 {
        match &self.picture {
            None => self.color,
            Some((picture, _)) => {
                let [s, t] = latlong((self.dome_from_world * wi).normalize_or(Vec3::Y));
                self.color * picture.eval(Vec2::new(s, t))
            }
        }
    }

    /// Bytes held beyond the texture.
    pub(super) fn memory(&self) -> usize {
        self.picture.as_ref().map_or(0, |(_, grid)| grid.memory())
    }
}

/// Texture coordinates of a unit vector in the dome's space; `t` is 1 at +Y.
pub(super) fn latlong(d: Vec3) -> [f32; 2] {
    let longitude = d.x.atan2(d.z);
    // Exact towards the poles, where asin is not.
    let latitude = d.y.atan2(d.x.hypot(d.z));
    [
        (0.5 - longitude / (2.0 * PI)).clamp(0.0, 1.0),
        (0.5 + latitude / PI).clamp(0.0, 1.0),
    ]
}

/// 1 - cos of the angle from +Y at the height `v` of the picture, 0 on top.
fn versine(v: f32) -> f32 {
    2.0 * (0.5 * PI * v).sin().powi(2)
}

/// Of one cell in row `y`.
fn solid_angle(grid: &Grid, y: usize) -> f32 {
    let [width, height] = grid.size().map(|n| n as f32);
    let (y, angle) = (y as f32, PI / height);
    // cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2)
    2.0 * (angle * (y + 0.5)).sin() * (0.5 * angle).sin() * 2.0 * PI / width
}

/// The sampling table and the mean colour over the sphere.
fn table(picture: &Picture) -> (Grid, Vec3) {
    let [w, h] = picture.size();
    let (width, height) = (w.min(MOST_COLUMNS), h.min(MOST_COLUMNS / 2));
    let part = |i: u32, n: u32, of: u32| (u64::from(i) * u64::from(of) / u64::from(n)) as u32;

    // Mean luminance of each cell
    let mut cells = Vec::with_capacity((width * height) as usize);
    let mut mean = Vec3::ZERO;
    for y in 0..height {
        let row_weight = (PI * (y as f32 + 0.5) / height as f32).sin();
        let mut row = Vec3::ZERO;
        for x in 0..width {
            let color = if picture.in_place() {
                let (xs, ys) = (
                    part(x, width, w)..part(x + 1, width, w),
                    part(y, height, h)..part(y + 1, height, h),
                );
                let n = (xs.len() * ys.len()) as f32;
                let sum: Vec3 = ys
                    .flat_map(|y| xs.clone().map(move |x| (x, y)))
                    .map(|(x, y)| picture.texel(x, y))
                    .sum();
                sum / n
            } else {
                let (s, t) = (x as f32 + 0.5, y as f32 + 0.5);
                picture.eval(Vec2::new(s / width as f32, 1.0 - t / height as f32))
            };
            row += color;
            cells.push(luminance(color));
        }
        mean += row * row_weight;
    }
    // The sum of sin over the rows is 1 / sin(pi / 2h) exactly.
    mean *= (0.5 * PI / height as f32).sin() / width as f32;

    // Filtering bleeds a texel into its neighbours: over a cell, 1/8 comes from either side
    let at = |x: u32, y: u32| cells[(y * width + x) as usize];
    let floor = if luminance(mean) > 0.0 {
        // Where a lookup finds what the table does not know (wrapping, a moved picture): seldom, but not never.
        1e-3 * luminance(mean)
    } else {
        1.0
    };
    let mut weights = Vec::with_capacity(cells.len());
    for y in 0..height {
        let row_weight = (PI * (y as f32 + 0.5) / height as f32).sin();
        let rows = [
            (y.saturating_sub(1), 0.125),
            (y, 0.75),
            ((y + 1).min(height - 1), 0.125),
        ];
        for x in 0..width {
            let columns = [
                ((x + width - 1) % width, 0.125),
                (x, 0.75),
                ((x + 1) % width, 0.125),
            ];
            let mut sum = 0.0;
            for (yy, b) in rows {
                for (xx, a) in columns {
                    sum += a * b * at(xx, yy);
                }
            }
            weights.push((sum + floor) * row_weight);
        }
    }
    (Grid::new(width as usize, &weights), mean)
}
