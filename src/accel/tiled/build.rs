//! Building: the limit surface is cut into quads, all alike, and the tile's triangles are put into a tree.

use std::sync::Arc;

use rayon::prelude::*;

use super::tile::Tile;
use super::{HALVES, MARGIN, Quad, Tiled};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::prism::{Lifted, may_fold};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec3, Vec2, Vec3};
use crate::surface::{FaceGrid, Rates, Shell, ShellTolerance, Surface, Tiles};

/// Quads along an edge of a face at most.
const MOST_CUTS: u32 = 64;

/// Tiles that a quad may have along u or v.
const MOST_TILES: f32 = 65536.0;

impl Tiled {
    /// Builds it for the tiles over a surface. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Input`] where a quad has too many tiles, or texture coordinates are no numbers; [`Error::Interrupted`] if
    /// stopped; [`Error::Memory`] beyond 2^32 corners.
    pub fn build(
        surface: &Surface,
        tiles: &Arc<Tiles>,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let shell = shell(surface, tiles);
        go_on(progress(0.5))?;
        let cuts = shell
            .grids()
            .first()
            .map_or(1, |grid| u32::from(grid.size[0]));
        let [low, high] = tiles.heights();
        let keys = shell.keys();
        let all = shell.st().len();
        if all as u64 * u64::from(keys) >= u64::from(u32::MAX) {
            return Err(Error::Memory {
                message: format!("{all} corners of prisms at {keys} motion keys"),
                help: None,
            });
        }
        let lifted = Lifted::new(surface);
        let (grids, by_key) = lifted.corners(&Rates::uniform(&lifted.plain, cuts));
        let corners: Vec<[Vec3; 2]> = (by_key.iter().flatten())
            .map(|&[p, n]| [p + low * n, (high - low) * n])
            .collect();
        let uv: Vec<Vec2> = (shell.st().iter())
            .map(|&st| st * tiles.repeats())
            .collect();
        check(&grids, &uv)?;
        let ends = |[p, n]: [Vec3; 2]| [p, p + n];
        let bounds = Bounds3::of(corners.iter().flat_map(|&c| ends(c)));
        let lattice = Lattice::around(&bounds, bounds.extent().max_element() / (1 << 22) as f32);
        let quads: Vec<Quad> = (grids.iter())
            .flat_map(|grid| {
                let places = (0..grid.size[1]).flat_map(|j| (0..grid.size[0]).map(move |i| [i, j]));
                places.map(|place| Quad {
                    face: grid.face,
                    place,
                    corner: grid.vertex(place[0], place[1]) as u32,
                })
            })
            .collect();
        let row = cuts as usize + 1;
        let of_key = |quad: &Quad, key: usize| {
            let first = quad.corner as usize + key * all;
            [first, first + 1, first + row, first + row + 1].map(|c| corners[c])
        };
        let extents: Vec<Vec<Extent>> = (0..keys as usize)
            .map(|key| {
                (quads.par_iter())
                    .map(|quad| around(&lattice, of_key(quad, key)))
                    .collect()
            })
            .collect();
        let (top, order) = Top::new(extents);
        let quads = order
            .par_iter()
            .map(|&number| {
                let quad = quads[number as usize];
                let folds = (0..keys as usize).any(|key| {
                    let of_key = of_key(&quad, key).map(|ends| ends.map(|x| x.as_dvec3()));
                    let heights = [-MARGIN, 1.0 + MARGIN];
                    // Between motion keys it might, where it does at neither: what moves is taken to.
                    keys > 1
                        || HALVES
                            .iter()
                            .any(|h| may_fold(h.map(|c| of_key[c]), heights))
                });
                Quad {
                    face: quad.face | if folds { Quad::FOLDS } else { 0 },
                    ..quad
                }
            })
            .collect();
        go_on(progress(0.9))?;
        let tile = Tile::new(tiles);
        go_on(progress(1.0))?;
        let reach = (0..keys as usize).map(|key| {
            let extent = top.extent(key);
            let ends = extent.min.iter().chain(&extent.max);
            ends.fold(0, |most, x| most.max(x.unsigned_abs().min(1 << 24)))
        });
        Ok(Self {
            isa: Isa::best(),
            lattice,
            reach: reach.max().unwrap_or(0) as f32,
            keys,
            cuts,
            top,
            quads,
            corners,
            uv,
            tile,
            shell: shell.achieved(),
        })
    }

    /// The bytes that it will hold, a little more.
    pub fn expected_bytes(surface: &Surface, tiles: &Arc<Tiles>) -> u64 {
        let (shell, _) = needed(surface, tiles);
        let (cuts, faces) = (u64::from(most_cuts(&shell)), shell.grids().len() as u64);
        let (quads, corners) = (cuts * cuts * faces, (cuts + 1) * (cuts + 1) * faces);
        let keys = u64::from(shell.keys());
        quads * (14 + 14 * keys) + corners * (8 + 24 * keys) + Tile::new(tiles).memory() as u64
    }
}

fn go_on(does: bool) -> Result<()> {
    if does {
        Ok(())
    } else {
        Err(Error::Interrupted)
    }
}

/// The quads, with the tolerance that they are to keep.
fn needed(surface: &Surface, tiles: &Tiles) -> (Shell, ShellTolerance) {
    let tolerance = ShellTolerance {
        heights: tiles.heights(),
        ..ShellTolerance::default()
    };
    let rates = Rates::uniform(surface, MOST_CUTS);
    (
        Shell::new(surface, &rates, &tolerance, |needs, _| needs),
        tolerance,
    )
}

/// Into how many quads each face is cut along an edge, if each is cut as it needs.
fn most_cuts(shell: &Shell) -> u32 {
    let sizes = shell.grids().iter().flat_map(|grid| grid.size);
    sizes.max().map_or(1, u32::from)
}

/// The same, as many for each face as the most curved one needs.
fn shell(surface: &Surface, tiles: &Tiles) -> Shell {
    let (shell, tolerance) = needed(surface, tiles);
    let rates = Rates::uniform(surface, most_cuts(&shell));
    Shell::new(surface, &rates, &tolerance, |_, most| most)
}

/// Around the prisms over a quad, which are within the corners' hull.
fn around(lattice: &Lattice, corners: [[Vec3; 2]; 4]) -> Extent {
    let margin = MARGIN as f32;
    let ends = corners.map(|[p, n]| [p - margin * n, p + (1.0 + margin) * n]);
    let points: Vec<DVec3> = (ends.as_flattened().iter())
        .map(|&p| lattice.on_lattice(p))
        .collect();
    Extent::around(&points)
}

fn check(grids: &[FaceGrid], uv: &[Vec2]) -> Result<(), Fault> {
    for grid in grids {
        let [columns, rows] = grid.vertices().map(|n| n as usize);
        let first = grid.first_vertex as usize;
        let of_face = &uv[first..first + columns * rows];
        let at = |i: usize, j: usize| of_face[j * columns + i];
        for j in 0..rows - 1 {
            for i in 0..columns - 1 {
                let corners = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
                let low = corners.into_iter().fold(Vec2::INFINITY, Vec2::min);
                let high = corners.into_iter().fold(Vec2::NEG_INFINITY, Vec2::max);
                let most = (high - low).max_element();
                let is_fine = low.is_finite() && high.is_finite() && most <= MOST_TILES;
                if !is_fine {
                    let message = format!("{most} tiles on a part of it, and {MOST_TILES} is most");
                    let fault = Fault::new(message).at_face(grid.face as usize);
                    return Err(fault
                        .advise("author fewer repeats, or texture coordinates that are numbers"));
                }
            }
        }
    }
    Ok(())
}
