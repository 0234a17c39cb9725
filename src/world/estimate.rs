//! What a surface will take, told before it is diced.
//!
//! How many micro-triangles there will be is known exactly: it follows from the rates, which are measured on the
//! displaced surface. Bytes follow from them by what methods keep of each face, block and micro-triangle. Embree's are
//! as its memory monitor counts them on `scenes/creature` and `scenes/relief`; ours are those of the structures, with the
//! bits that a vertex takes at most. So they are rather too large: by a tenth for Embree's, and up to twice for ours.

use super::method::Method;
use crate::accel::Tiled;
use crate::surface::{Displacement, Rates, Surface};

/// What a surface is diced into.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Triangles.
    pub micro_triangles: u64,
    /// Vertices, those on edges counted by each face.
    micro_vertices: u64,
    /// Those within edges, counted once.
    on_edges: u64,
    faces: u64,
    keys: u64,
    /// Parts of faces of so many quads along each side.
    of_2: u64,
    of_7: u64,
    of_9: u64,
    of_28: u64,
    of_40: u64,
    /// Micro-quads, of each face no more than are as much as all quads that it may be cut into.
    in_quads: u64,
    /// Vertices whose heights are kept where they are not looked up in an image as it is.
    asked_once: u64,
    /// Bytes of prisms and tile where tiles of geometry are over it, which then is not diced; their triangles are counted as
    /// its micro-triangles.
    tiled: Option<u64>,
}

/// What quads take of a face at most, in micro-quads' shares: 128 x 128 of five each.
const MOST_IN_QUADS: u64 = 5 * 128 * 128;

/// Bytes that a method takes of a surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Need {
    /// In the end.
    pub held: u64,
    /// As much more while it is diced.
    pub dicing: u64,
    /// As much more while Embree builds the scene that it is in.
    pub commit: u64,
}

impl Need {
    /// Both, made one after the other; Embree builds them together.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            held: self.held + other.held,
            dicing: self.dicing.max(other.dicing),
            commit: self.commit + other.commit,
        }
    }

    /// The most at once, of this surface alone.
    pub fn peak(&self) -> u64 {
        self.held + self.dicing.max(self.commit)
    }
}

impl Counts {
    /// What these rates make of a surface.
    pub fn new(surface: &Surface, rates: &Rates) -> Self {
        let base = surface.base();
        let mut counts = Self {
            keys: base.keys().into(),
            ..Self::default()
        };
        if let Some(tiles) = surface.tiles() {
            counts.micro_triangles = tiles.count_over(base);
            counts.micro_vertices = tiles.vertices_of(counts.micro_triangles);
            counts.tiled = Some(Tiled::expected_bytes(surface, tiles));
            return counts;
        }
        let is_asked = match surface.displacement() {
            Displacement::None => false,
            Displacement::Scalar(amount) | Displacement::Vector(amount, _) => {
                amount.map.image().is_none()
            }
        };
        for face in (0..base.faces()).filter(|&face| !base.is_hole(face)) {
            let [u, v] = rates.face(face).map(u64::from);
            let parts = |of: u64| u.div_ceil(of) * v.div_ceil(of);
            counts.micro_triangles += 2 * u * v;
            counts.micro_vertices += (u + 1) * (v + 1);
            counts.on_edges += u + v;
            counts.faces += 1;
            counts.of_2 += parts(2);
            counts.of_7 += parts(7);
            counts.of_9 += parts(9);
            counts.of_28 += parts(28);
            counts.of_40 += parts(40);
            counts.in_quads += (u * v).min(MOST_IN_QUADS);
        }
        if is_asked {
            counts.asked_once = counts.micro_vertices;
        }
        counts
    }
}

impl Counts {
    /// Whether tiles of geometry are seen in the surface's place.
    pub(super) fn is_tiled(&self) -> bool {
        self.tiled.is_some()
    }
}

#[cfg(test)]
impl Counts {
    /// Of faces of 32 x 32 quads.
    pub(super) fn of_quads(quads: u64) -> Self {
        let faces = quads.div_ceil(1024);
        let parts = |of: u64| faces * 32_u64.div_ceil(of).pow(2);
        Self {
            micro_triangles: 2 * quads,
            micro_vertices: faces * 33 * 33,
            on_edges: faces * 64,
            faces,
            keys: 1,
            of_2: parts(2),
            of_7: parts(7),
            of_9: parts(9),
            of_28: parts(28),
            of_40: parts(40),
            in_quads: quads,
            asked_once: 0,
            tiled: None,
        }
    }
}

impl Method {
    /// What it takes of a surface, at most: a surface that moves takes as much at each motion key. The cache that all
    /// surfaces share is not counted.
    pub fn need(self, counts: &Counts) -> Need {
        let Counts { keys, faces, .. } = *counts;
        let triangles = counts.micro_triangles;
        if let Some(tiled) = counts.tiled {
            if !self.copies_tiles() {
                return Need {
                    held: tiled,
                    ..Need::default()
                };
            }
            // Indices, twice, and faces; Embree's leaves hold fewer slivers than triangles. Points of which Embree has a copy,
            // and parameters; a fifth more of them where prisms end.
            let vertices = counts.micro_vertices + counts.micro_vertices / 5;
            return Need {
                held: tiled + triangles * (28 + 90 * keys) + vertices * (8 + 12 * keys),
                dicing: tiled + triangles * 16 + vertices * (8 + 24 * keys),
                commit: 28 * keys * triangles,
            };
        }
        let points = 12 * counts.micro_vertices * keys;
        let shared = 12 * (counts.on_edges + faces) * keys;
        // Numbers of faces, their sizes, and where their vertices are, as hits tell of them.
        let grids = 48 * faces;
        match self {
            // Embree has copies of the points and of indices, 12 bytes a triangle, beside its tree.
            Self::EmbreeTriangles => Need {
                held: points + grids + (12 + 68 * keys) * triangles,
                dicing: 2 * points + shared + 12 * triangles,
                commit: 28 * keys * triangles,
            },
            // A leaf is a grid of 2 x 2 quads.
            Self::EmbreeGrid | Self::EmbreeGridCompact => Need {
                held: points + 2 * grids + 72 * keys * counts.of_2,
                dicing: 2 * points + shared,
                commit: 34 * keys * counts.of_2,
            },
            Self::EmbreeSubdivision => Need {
                held: 400 * faces + 26 * keys * triangles,
                dicing: 0,
                commit: 200 * faces + 4 * keys * triangles,
            },
            Self::Tessellated => Need {
                held: points + grids + 26 * keys * triangles,
                dicing: shared + 24 * triangles,
                commit: 0,
            },
            // A block of 7 x 7 quads has a head of 24 bytes and up to 16 bits a vertex; a patch of 16 of them a node of
            // 128 bytes, and some 60 in the tree above. Nodes exist twice for a moment.
            Self::Compact => Need {
                held: keys * (152 * counts.of_7 + 190 * counts.of_28) + 32 * faces,
                dicing: shared + keys * (60 * counts.of_7 + 220 * counts.of_28) + grids,
                commit: 0,
            },
            Self::Compressed => Need {
                held: keys * (96 * counts.of_9 + 180 * counts.of_40) + 32 * faces,
                dicing: shared + keys * (40 * counts.of_9 + 220 * counts.of_40) + grids,
                commit: 0,
            },
            // Where the surface is strongly curved, quads of a few micro-quads with corners, borders and a patch each; but no
            // more than it may be cut into. A block's heights, and those of parts above it, take 2.4 bytes.
            Self::Dbvh => Need {
                held: keys * (12 * counts.in_quads + 4 * counts.asked_once)
                    + 3 * counts.of_7
                    + 192 * faces,
                dicing: 8 * keys * counts.in_quads + grids,
                commit: 0,
            },
            // Heights of 2 bytes, ranges of 64 bytes for 16 x 16 quads at most, and quads of some 500 micro-triangles, where
            // they are no more than 16384. Heights are found in single precision, and copied.
            Self::Nonlinear => {
                let quads = (triangles / 500).max(16384).min(triangles) + faces;
                let heights = counts.micro_vertices + counts.on_edges;
                Need {
                    held: keys * (2 * heights + 80 * counts.of_9 + 80 * quads) + 80 * faces,
                    dicing: keys * (6 * heights + 80 * counts.of_9 + 20 * quads) + 3 * shared,
                    commit: 0,
                }
            }
            Self::Cache => Need {
                held: 12 * faces * keys + 40 * keys * counts.of_28 + 32 * faces,
                dicing: keys * 100 * counts.of_28 + grids,
                commit: 0,
            },
        }
    }
}
