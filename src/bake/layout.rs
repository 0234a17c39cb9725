//! Where the faces of a cage lie in an image.

use std::path::Path;

use rayon::prelude::*;
use relievo_ptex::MeshType;

use super::{Cage, Run};
use crate::convert::lengths;
use crate::error::{Fault, Result};
use crate::math::{DVec2, DVec3, Vec2};
use crate::mesh::ControlMesh;
use crate::surface::Subdivision;

/// A cage's texture coordinates over its limit surface.
pub struct Layout {
    surface: Subdivision,
}

/// A pixel, and what lies there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// Row by row from the top.
    pub(super) number: usize,
    /// Parameters of the Ptex face.
    pub(super) uv: [f64; 2],
}

/// The name of the primvar that has the coordinates.
const TEXCOORDS: &str = "st";
/// How far beyond the unit square coordinates may lie by rounding.
const ROUNDING: f32 = 1e-5;
/// The most cells that a face is cut into along u, and along v.
const MOST_CELLS: usize = 1 << 12;

impl Layout {
    /// The layout of a valid mesh, by its own texture coordinates.
    ///
    /// # Errors
    /// If it has none, or they leave the unit square. `file` is what faults name.
    pub fn new(mesh: &ControlMesh, file: &Path) -> Result<Self, Fault> {
        let surface = Subdivision::new(mesh, Some(TEXCOORDS));
        if !surface.has_texcoords() {
            let fault = Fault::new(
                "the cage has no texture coordinates, by which an image would be laid out",
            );
            let help = "give every corner of its faces texture coordinates (vt), with --atlas or by hand, or bake to \
                        .ptx, which needs none";
            return Err(fault.in_file(file).advise(help));
        }
        Ok(Self { surface })
    }

    /// Checks that all faces lie within the image.
    pub(super) fn check(&self, cage: &Cage) -> Result<(), Fault> {
        let unit = |st: Vec2| st.min_element() >= -ROUNDING && st.max_element() <= 1.0 + ROUNDING;
        for (ptex, face) in (0..).zip(cage.faces()) {
            let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
            let last = if cage.kind() == MeshType::Triangle {
                3
            } else {
                4
            };
            let places = corners[..last].iter();
            let mut given = places.filter_map(|uv| self.surface.texcoord_on_ptex(ptex, *uv));
            if let Some(st) = given.find(|st| !unit(*st)) {
                let message = format!(
                    "its texture coordinates run to ({}, {}), and one image covers 0 to 1",
                    st.x, st.y
                );
                let help = "lay it out within the unit square, or bake to .ptx";
                return Err(cage.name(Fault::new(message).at_face(face.face as usize).advise(help)));
            }
        }
        Ok(())
    }

    /// How long a Ptex face is along u and v, in widths and heights of the image.
    pub(super) fn lengths(&self, cage: &Cage, ptex: u32) -> [f64; 2] {
        lengths(cage.kind(), |uv| {
            let st = self.surface.texcoord_on_ptex(ptex, uv)?;
            Some(st.extend(0.0).as_dvec3())
        })
    }

    /// Texture coordinates at a place of a Ptex face; none where there is no surface.
    pub(super) fn texcoord(&self, ptex: u32, uv: [f64; 2]) -> Option<Vec2> {
        self.surface.texcoord_on_ptex(ptex, uv)
    }

    /// Their derivatives by the face's parameters, likewise.
    pub(super) fn slopes(&self, ptex: u32, uv: [f64; 2]) -> Option<[Vec2; 2]> {
        self.surface.texcoord_slopes_on_ptex(ptex, uv)
    }

    /// By Ptex face the pixels of a square image whose middles lie on it, or, if `shifted`, whose lower right corners do,
    /// in order of their numbers.
    ///
    /// Faces are cut into cells about as large as pixels, within which coordinates run linearly.
    ///
    /// # Errors
    /// If interrupted.
    pub(super) fn pixels(
        &self,
        cage: &Cage,
        side: usize,
        shifted: bool,
        run: Run<'_>,
    ) -> Result<Vec<Vec<Pixel>>> {
        let shift = if shifted { 1.0 } else { 0.5 };
        let found = (0..cage.faces().len() as u32)
            .into_par_iter()
            .map(|ptex| match run.goes_on() {
                true => self.of_face(cage, ptex, side, shift),
                false => Vec::new(),
            })
            .collect();
        run.check()?;
        Ok(found)
    }

    fn of_face(&self, cage: &Cage, ptex: u32, side: usize, shift: f64) -> Vec<Pixel> {
        let longest = self.lengths(cage, ptex).into_iter().fold(0.0, f64::max);
        let cells = ((longest * side as f64).ceil() as usize).clamp(1, MOST_CELLS);
        // In pixels, so that those wanted are at whole numbers; y runs down.
        let place = |i: usize, j: usize| {
            let uv = [i, j].map(|i| i as f64 / cells as f64);
            let st = self.texcoord(ptex, uv)?.as_dvec2();
            let at = side as f64 * DVec2::new(st.x, 1.0 - st.y) - shift;
            Some((at, DVec2::from(uv)))
        };
        let mut pixels = Vec::new();
        let mut row: Vec<_> = (0..=cells).map(|i| place(i, 0)).collect();
        for j in 0..cells {
            let whole = cage.kind() == MeshType::Quad;
            let last = if whole { cells } else { cells - j };
            let next: Vec<_> = (0..=cells)
                .map(|i| {
                    if whole || i + j < cells {
                        place(i, j + 1)
                    } else {
                        None
                    }
                })
                .collect();
            for i in 0..last {
                let corners = [
                    row[i],
                    row[i + 1],
                    next.get(i + 1).copied().flatten(),
                    next[i],
                ];
                if let [Some(a), Some(b), _, Some(d)] = corners {
                    triangle([a, b, d], side, &mut pixels);
                }
                if let [_, Some(b), Some(c), Some(d)] = corners {
                    triangle([b, c, d], side, &mut pixels);
                }
            }
            row = next;
        }
        pixels.sort_by_key(|pixel| pixel.number);
        pixels.dedup_by_key(|pixel| pixel.number);
        pixels
    }
}

/// Adds what lies at whole numbers in a triangle of places in an image, and has these parameters at its corners.
fn triangle(corners: [(DVec2, DVec2); 3], side: usize, out: &mut Vec<Pixel>) {
    /// A part of the triangle: who lies on the edge of two is in one of them at least.
    const EDGE: f64 = 1e-9;
    let [(a, _), (b, _), (c, _)] = corners;
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let last = (side - 1) as f64;
    let low = a
        .min(b)
        .min(c)
        .ceil()
        .clamp(DVec2::ZERO, DVec2::splat(last + 1.0));
    let high = a.max(b).max(c).floor().min(DVec2::splat(last));
    for y in low.y as usize..(high.y + 1.0).max(0.0) as usize {
        for x in low.x as usize..(high.x + 1.0).max(0.0) as usize {
            let p = DVec2::new(x as f64, y as f64);
            let weights = DVec3::new(
                (b - p).perp_dot(c - p),
                (c - p).perp_dot(a - p),
                (a - p).perp_dot(b - p),
            ) / area;
            if weights.min_element() < -EDGE {
                continue;
            }
            let weights = weights.to_array();
            let uv: DVec2 = (corners.iter().zip(weights))
                .map(|((_, uv), weight)| weight * *uv)
                .sum();
            out.push(Pixel {
                number: y * side + x,
                uv: uv.to_array(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_covered_once_with_its_parameters() {
        let corner = |x: f64, y: f64| (DVec2::new(4.0 * x, 4.0 * y) - 0.5, DVec2::new(x, y));
        let [a, b, c, d] = [
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ];
        let mut pixels = Vec::new();
        triangle([a, b, d], 4, &mut pixels);
        triangle([b, c, d], 4, &mut pixels);
        pixels.sort_by_key(|p| p.number);
        pixels.dedup_by_key(|p| p.number);
        assert_eq!(pixels.len(), 16);
        for pixel in pixels {
            let at = [pixel.number % 4, pixel.number / 4].map(|i| (i as f64 + 0.5) / 4.0);
            assert!((DVec2::from(at) - DVec2::from(pixel.uv)).length() < 1e-12);
        }
    }
}
