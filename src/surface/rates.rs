//! Dicing rates: into how many segments each edge is cut, and how fine the grid within each face is.
//!
//! After Reyes (Cook, Carpenter, Catmull, "The Reyes Image Rendering Architecture", 1987, section 2.4): micro-edges of
//! a given length in pixels. Unlike there the length is measured on the displaced surface, and seen squarely rather
//! than foreshortened, so that silhouettes and what mirrors show are as fine as the rest. An edge is measured once,
//! on the points that its faces share; a face may be finer than its edges where its middle lines are longer.
//!
//! Floors and walls that nothing displaces are not diced: see [`Rates::sparing_even_faces`].

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::adjacency::Side;
use super::base::UvRect;
use super::evaluate::Surface;
use super::shared::Scratch;
use crate::math::{Affine3A, Bounds3, Vec3};

/// The most segments that an edge is cut into.
pub const MOST_SEGMENTS: u32 = 4096;

/// What the dicing rates aim at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dicing {
    /// Length of a micro-edge in pixels, above 0.
    pub rate: f32,
    /// The most segments an edge is cut into, 1 to [`MOST_SEGMENTS`].
    pub max_segments: u32,
    /// How fast micro-edges grow beyond the picture: their length at a distance of one picture's width from it is this
    /// much more, as a factor; 0 for the same rate all around. At least 0. Embree's own subdivision ignores it.
    pub off_screen: f32,
}

impl Default for Dicing {
    fn default() -> Self {
        Self {
            rate: 1.0,
            max_segments: 128,
            off_screen: 1.0,
        }
    }
}

/// What dicing asks of a camera.
pub trait View: Sync {
    /// Where it is, world space.
    fn position(&self) -> Vec3;
    /// Pixels that a scene unit at `p` covers at most, looked at squarely. Finite and above 0.
    fn pixels_per_unit(&self, p: Vec3) -> f32;
    /// How far a sphere lies outside of the picture, in widths of the picture; 0 where a part of it may be seen.
    fn outside(&self, centre: Vec3, radius: f32) -> f32;
}

/// The places in which a surface stands before a camera. All of them share one dicing, fine enough for each.
pub struct Places<'a> {
    view: &'a dyn View,
    world_from_object: Vec<Affine3A>,
}

/// Places that are looked at one by one: of many instances only the nearest decide.
const MOST_PLACES: usize = 16;

impl<'a> Places<'a> {
    /// The places that decide, for a surface within `bounds`. For a moving one, name its places at all motion keys.
    pub fn nearest(view: &'a dyn View, bounds: &Bounds3, world_from_object: &[Affine3A]) -> Self {
        let mut places: Vec<(f32, &Affine3A)> = world_from_object
            .iter()
            .map(|place| {
                let bounds = bounds.transformed(place);
                let nearest = view.position().clamp(bounds.min, bounds.max);
                (view.pixels_per_unit(nearest), place)
            })
            .collect();
        places.sort_by(|a, b| b.0.total_cmp(&a.0));
        places.truncate(MOST_PLACES);
        Self {
            view,
            world_from_object: places.into_iter().map(|(_, place)| *place).collect(),
        }
    }

    /// Those that decide.
    pub(crate) fn world_from_object(&self) -> &[Affine3A] {
        &self.world_from_object
    }

    /// The length in pixels of the segment between two points of the surface, where it is longest.
    pub fn pixels(&self, a: Vec3, b: Vec3) -> f32 {
        self.world_from_object
            .iter()
            .map(|place| {
                let (a, b) = (place.transform_point3(a), place.transform_point3(b));
                let end = |p| self.view.pixels_per_unit(p);
                a.distance(b) * end(a).max(end(b)).max(end(0.5 * (a + b)))
            })
            .fold(0.0, f32::max)
    }

    /// How far a box of the surface lies outside of the picture, where it is nearest to it.
    fn outside(&self, bounds: &Bounds3) -> f32 {
        self.world_from_object
            .iter()
            .map(|place| {
                let bounds = bounds.transformed(place);
                self.view
                    .outside(bounds.centre(), 0.5 * bounds.extent().length())
            })
            .fold(f32::INFINITY, f32::min)
    }
}

/// Segments of each edge, and of each face along u and v.
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    edges: Vec<u16>,
    /// At least those of the face's edges; 0 for holes.
    faces: Vec<[u16; 2]>,
    /// See [`pixels_per_unit`](Self::pixels_per_unit).
    closest: Option<f32>,
}

impl Rates {
    /// All edges alike.
    pub fn uniform(surface: &Surface, segments: u32) -> Self {
        Self::by_edge(surface, |_| segments)
    }

    /// By the number of the edge; what is beyond 1 and [`MOST_SEGMENTS`] is clamped. Edges that are but a point have
    /// one segment in any case.
    pub fn by_edge(surface: &Surface, segments: impl Fn(u32) -> u32 + Sync) -> Self {
        Self::new(surface, segments, |_| [1; 2])
    }

    /// By the length of micro-edges on the screen; [even faces](Self::sparing_even_faces) are not cut.
    pub fn on_screen(surface: &Surface, places: &Places<'_>, dicing: &Dicing) -> Self {
        let rates = Measure::new(surface, places, dicing).rates();
        rates.sparing_even_faces(surface)
    }

    /// The same without cuts where they change nothing: of faces that are [even](Surface::is_even), and of edges whose
    /// faces all are. An even face beside one that is not keeps the cuts of their edge.
    #[must_use]
    pub fn sparing_even_faces(&self, surface: &Surface) -> Self {
        let even: Vec<bool> = (0..surface.base().faces())
            .into_par_iter()
            .map(|face| surface.is_even(face))
            .collect();
        let is_spared = |edge| {
            let mut sides = surface.adjacency.edge(edge);
            sides.all(|side| even[side.face as usize])
        };
        self.changed(
            surface,
            |edge| if is_spared(edge) { 1 } else { self.edge(edge) },
            |face| {
                if even[face as usize] {
                    [1; 2]
                } else {
                    self.face(face)
                }
            },
        )
    }

    /// Other rates, [by edge and face](Self::new), for the same view.
    fn changed(
        &self,
        surface: &Surface,
        segments: impl Fn(u32) -> u32 + Sync,
        within: impl Fn(u32) -> [u32; 2] + Sync,
    ) -> Self {
        Self {
            closest: self.closest,
            ..Self::new(surface, segments, within)
        }
    }

    /// Micro-edges so many times as long, at least 1.
    #[must_use]
    pub fn coarser(&self, surface: &Surface, times: f32) -> Self {
        let fewer = |segments: u32| (segments as f32 / times).ceil() as u32;
        self.changed(
            surface,
            |edge| fewer(self.edge(edge)),
            |face| self.face(face).map(fewer),
        )
    }

    /// Pixels that a unit of the object covers where it is seen from closest by; beyond the picture they count for as
    /// much less as dicing is coarser there. None of rates that know no view, and of a surface without an extent.
    pub fn pixels_per_unit(&self) -> Option<f32> {
        self.closest
    }

    /// The segments of an edge.
    pub fn edge(&self, edge: u32) -> u32 {
        u32::from(self.edges[edge as usize])
    }

    /// The segments of a face along u and v: those of its grid. 0 for holes.
    pub fn face(&self, face: u32) -> [u32; 2] {
        self.faces[face as usize].map(u32::from)
    }

    /// How many micro-vertices result, those on edges counted by each face.
    pub fn micro_vertices(&self) -> u64 {
        self.sizes().map(|[u, v]| (u + 1) * (v + 1)).sum()
    }

    /// How many micro-triangles result.
    pub fn micro_triangles(&self) -> u64 {
        self.sizes().map(|[u, v]| 2 * u * v).sum()
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        size_of_val(self.edges.as_slice()) + size_of_val(self.faces.as_slice())
    }

    fn sizes(&self) -> impl Iterator<Item = [u64; 2]> + '_ {
        self.faces
            .iter()
            .filter(|size| size[0] > 0)
            .map(|size| size.map(u64::from))
    }

    /// By the number of the edge and, for what is within, along u and v, by the face; as [`by_edge`](Self::by_edge).
    pub fn new(
        surface: &Surface,
        segments: impl Fn(u32) -> u32 + Sync,
        within: impl Fn(u32) -> [u32; 2] + Sync,
    ) -> Self {
        let clamped = |segments: u32| segments.clamp(1, MOST_SEGMENTS) as u16;
        let edges: Vec<u16> = (0..surface.adjacency.edge_count())
            .into_par_iter()
            .map(|edge| {
                let collapsed = surface
                    .adjacency
                    .edge(edge)
                    .any(|side| surface.base().is_collapsed(side.face, side.k));
                if collapsed {
                    1
                } else {
                    clamped(segments(edge))
                }
            })
            .collect();
        let faces = (0..surface.base().faces())
            .into_par_iter()
            .map(|face| {
                if surface.base().is_hole(face) {
                    return [0; 2];
                }
                let [u, v] = within(face).map(clamped);
                let edge = |k: u32| edges[surface.base().edge(face, k).edge as usize];
                [u.max(edge(0)).max(edge(2)), v.max(edge(1)).max(edge(3))]
            })
            .collect();
        Self {
            edges,
            faces,
            closest: None,
        }
    }
}

/// A surface before a camera.
struct Measure<'a> {
    surface: &'a Surface,
    places: &'a Places<'a>,
    dicing: &'a Dicing,
    /// Of each motion key.
    vertices: Vec<Vec<Vec3>>,
    /// What lengths of each face are multiplied by; 1 on the screen.
    factors: Vec<f32>,
    /// The most pixels that a unit of a measured line covered, times its factor, as bits: those of numbers from 0 on
    /// have the numbers' order.
    closest: AtomicU32,
}

impl<'a> Measure<'a> {
    fn new(surface: &'a Surface, places: &'a Places<'a>, dicing: &'a Dicing) -> Self {
        let keys = surface.base().keys();
        let vertices = (0..keys)
            .map(|key| {
                (0..surface.adjacency.vertex_count())
                    .into_par_iter()
                    .map_init(Scratch::default, |scratch, vertex| {
                        surface.vertex_point(vertex, key, scratch)
                    })
                    .collect()
            })
            .collect();
        let factor = |face: u32| {
            if dicing.off_screen <= 0.0 || surface.base().is_hole(face) {
                return 1.0;
            }
            // What cannot be bounded may be anywhere.
            let bounds = (0..keys).try_fold(Bounds3::EMPTY, |all, key| {
                Some(all.union(surface.bounds(face, &UvRect::UNIT, key)?))
            });
            let outside = bounds.map_or(0.0, |bounds| places.outside(&bounds));
            1.0 / (1.0 + dicing.off_screen * outside)
        };
        Self {
            surface,
            places,
            dicing,
            vertices,
            factors: (0..surface.base().faces())
                .into_par_iter()
                .map(factor)
                .collect(),
            closest: AtomicU32::new(0),
        }
    }

    fn rates(&self) -> Rates {
        let rates = Rates::new(self.surface, |edge| self.edge(edge), |face| self.face(face));
        let closest = f32::from_bits(self.closest.load(Ordering::Relaxed));
        Rates {
            closest: (closest > 0.0).then_some(closest),
            ..rates
        }
    }

    fn edge(&self, edge: u32) -> u32 {
        let adjacency = &self.surface.adjacency;
        let Some(Side { face, k, reversed }) = adjacency.edge(edge).next() else {
            return 1;
        };
        // As fine as the face that is nearest to the picture.
        let factor = adjacency
            .edge(edge)
            .map(|side| self.factors[side.face as usize])
            .fold(0.0, f32::max);
        let mut ends = [k, (k + 1) % 4].map(|k| self.surface.base().vertex(face, k) as usize);
        if reversed {
            ends.reverse();
        }
        let mut scratch = Scratch::default();
        let mut samples = Vec::new();
        self.segments(factor, |segments, key| {
            samples.clear();
            samples.resize(segments as usize - 1, Vec3::ZERO);
            self.surface
                .edge_points(edge, key as u32, &mut scratch, &mut samples);
            let [first, last] = ends.map(|end| self.vertices[key][end]);
            let points = std::iter::once(first).chain(samples.iter().copied());
            self.length(factor, points.chain([last]))
        })
    }

    /// Along u and v, on the lines through the middle.
    fn face(&self, face: u32) -> [u32; 2] {
        let factor = self.factors[face as usize];
        let mut scratch = Scratch::default();
        [true, false].map(|along_u| {
            self.segments(factor, |segments, key| {
                let line =
                    self.surface
                        .inner_line(face, along_u, segments, key as u32, &mut scratch);
                self.length(factor, line.iter().copied())
            })
        })
    }

    /// How many segments a line needs whose length in pixels `measure` takes with the given segments and key. It is
    /// measured anew with more of them until it needs no more than that: displacement makes lines longer the closer
    /// one looks.
    fn segments(&self, factor: f32, mut measure: impl FnMut(u32, usize) -> f32) -> u32 {
        let most = self.dicing.max_segments.clamp(1, MOST_SEGMENTS);
        let mut segments = 4;
        loop {
            let pixels = (0..self.vertices.len())
                .map(|key| measure(segments, key))
                .fold(0.0, f32::max);
            let needed = (factor * pixels / self.dicing.rate)
                .ceil()
                .clamp(1.0, most as f32) as u32;
            if needed <= segments || segments >= most {
                return needed.max(1);
            }
            segments = needed.next_power_of_two().min(most);
        }
    }

    /// The length of a line in pixels. `factor` is its face's, for the closest view.
    fn length(&self, factor: f32, mut points: impl Iterator<Item = Vec3>) -> f32 {
        let mut from = points.next().unwrap_or(Vec3::ZERO);
        let mut closest = 0.0_f32;
        let sum = points
            .map(|to| {
                let from = std::mem::replace(&mut from, to);
                let (pixels, units) = (self.places.pixels(from, to), from.distance(to));
                if units > 0.0 && pixels.is_finite() {
                    closest = closest.max(factor * pixels / units);
                }
                pixels
            })
            .sum();
        self.closest.fetch_max(closest.to_bits(), Ordering::Relaxed);
        sum
    }
}
