//! Building: the limit surface is cut into quads, all alike, and the tile's triangles are put into a tree.

use std::sync::Arc;

use rayon::prelude::*;

use super::tile::Tile;
use super::{MARGIN, Quad, Tiled};
use crate::accel::lattice::{Extent, Lattice};
use crate::accel::prism::{HALVES, Lifted, may_fold};
use crate::accel::simd::Isa;
use crate::accel::top::Top;
use crate::error::{Error, Fault, Result};
use crate::math::{Bounds3, DVec3, DisjointSets, Vec2, Vec3};
use crate::surface::{FaceGrid, Rates, Shell, ShellTolerance, Surface, Tiles};

/// Quads along an edge of a face at most.
const MOST_CUTS: u32 = 64;

/// How far prisms may be from those over the limit surface, in diagonals of the object: what stands in them hides it, and each
/// of them costs a ray as much as some tiles do.
const DISTANCE: f32 = 4e-4;

/// No tile may be farther from the first.
const FARTHEST: f32 = 1e7;

/// Tiles that a quad may have along u or v.
const MOST_TILES: f32 = 65536.0;

impl Tiled {
    /// Builds it for the tiles over a surface. `progress` is told from 0 to 1, and stops the build by returning false.
    ///
    /// # Errors
    /// [`Error::Input`] where a quad has too many tiles, or texture coordinates are too large or no numbers; [`Error::Interrupted`] if
    /// stopped; [`Error::Memory`] beyond 2^32 corners.
    pub fn build(
        surface: &Surface,
        tiles: &Arc<Tiles>,
        progress: &dyn Fn(f64) -> bool,
    ) -> Result<Self> {
        let (shell, tolerance) = needed(surface, tiles);
        let rates = even(surface, &shell);
        let shell = Shell::new(surface, &rates, &tolerance, |_, most| most);
        go_on(progress(0.5))?;
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
        let (grids, by_key) = lifted.corners(&rates);
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
                    size: grid.size,
                    corner: grid.vertex(place[0], place[1]) as u32,
                })
            })
            .collect();
        let of_key =
            |quad: &Quad, key: usize| quad.numbers().map(|number| corners[number + key * all]);
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
        let rates = even(surface, &shell);
        let (mut quads, mut corners) = (0, 0);
        for grid in shell.grids() {
            let [u, v] = rates.face(grid.face).map(u64::from);
            quads += u * v;
            corners += (u + 1) * (v + 1);
        }
        let keys = u64::from(shell.keys());
        quads * (16 + 45 * keys) + corners * (8 + 24 * keys) + Tile::new(tiles).memory() as u64
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
        distance: DISTANCE,
        heights: tiles.heights(),
        ..ShellTolerance::default()
    };
    let rates = Rates::uniform(surface, MOST_CUTS);
    (
        Shell::new(surface, &rates, &tolerance, |needs, _| needs),
        tolerance,
    )
}

/// Into how many quads edges are cut: as many as the most curved face needs of those that edges go through from side to opposite
/// side, so that no face has more quads along an edge than another.
fn even(surface: &Surface, shell: &Shell) -> Rates {
    let base = surface.base();
    let edge = |face: u32, k: u32| base.edge(face, k).edge as usize;
    let mut sizes = vec![[1; 2]; base.faces() as usize];
    for grid in shell.grids() {
        sizes[grid.face as usize] = grid.size;
    }
    let sides = || (0..base.faces()).flat_map(|face| (0..4).map(move |k| (face, k)));
    let count = sides().map(|(face, k)| edge(face, k) + 1).max();
    let mut strips = DisjointSets::new(count.unwrap_or(0));
    for face in 0..base.faces() {
        strips.join(edge(face, 0), edge(face, 2));
        strips.join(edge(face, 1), edge(face, 3));
    }
    let mut cuts = vec![1; count.unwrap_or(0)];
    for (face, k) in sides() {
        let of_strip = &mut cuts[strips.least(edge(face, k))];
        *of_strip = u32::from(sizes[face as usize][k as usize % 2]).max(*of_strip);
    }
    let of_edge: Vec<u32> = (0..cuts.len())
        .map(|edge| cuts[strips.least(edge)])
        .collect();
    Rates::by_edge(surface, |edge| of_edge[edge as usize])
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
                let is_fine = corners.iter().all(|c| c.abs().max_element() <= FARTHEST);
                if !is_fine || most > MOST_TILES {
                    let message = format!(
                        "{most} tiles on a part of it, from {low} to {high}, where {MOST_TILES} are most, and none beyond {FARTHEST}"
                    );
                    let fault = Fault::new(message).at_face(grid.face as usize);
                    return Err(fault
                        .advise("author fewer repeats, or texture coordinates that are numbers"));
                }
            }
        }
    }
    Ok(())
}
