//! Displacement traced without any stored micro-geometry: boxes, and the micro-vertices themselves, are computed where
//! a ray passes.
//!
//! After Thonat, Beaune, Sun, Carr, Boubekeur, "Tessellation-Free Displacement Mapping for Ray Tracing", ACM Transactions
//! on Graphics 40(6), 2021: the tree over a primitive is the texture's own, a node's box is computed from the least and
//! the greatest height in it, and its leaves are two triangles for each texel, made on the spot. And after Ogaki,
//! "Nonlinear Ray Tracing for Displacement and Shell Mapping", SIGGRAPH Asia 2023, who leaves normals linear.
//!
//! ```text
//!     tree over patches         see `top`; boxes on a lattice             some 9 bytes a patch
//!       patch                   a quad, or a large part of one            16 bytes
//!         parts                 4 x 4 in each, and so on: see `part`      their heights: 2 bytes each
//!           blocks              of up to 7 x 7 micro-quads                nothing: P, N, st of the quad's corners
//!
//!          h1 _______           What is over a part of a quad is affine in u, v and h each: the parallelepiped of Su, Sv
//!       N \ /      /\ N         and the range of h along N, but for what is bent, which is added to its planes. A ray
//!         \/______/  \          meets sixteen of them at once, each between three pairs of planes. To flat quads the ray
//!         / h0   /              is straight in (u, v, h), and parts are boxes there.
//!        ·------·               Of a block, those vertices are computed whose micro-quads are not wholly on one side of
//!          P(u,v)               the ray for all heights in the range.
//! ```
//!
//! What it traces: the limit surface cut into quads as finely as it is curved ([`crate::surface::Shell`], which tells how far
//! they are from it), displaced by bilinear look-ups at micro-vertices, S = P + h N with P, N and st bilinear between a quad's
//! corners; two triangles for each micro-quad. Micro-vertices are as many as by other methods, but for rounding to whole
//! ones a quad. Neighbours compute what they share in the same arithmetic from the same corners, so that it has the same
//! bits. Where they cannot, since an edge is a crease or a seam or the faces beside it are not cut alike, the
//! displaced points along it are kept, for all faces to take: the mean of what each has there, as in
//! [`SharedSamples`](crate::surface::SharedSamples).
//!
//! What is kept: the corners of quads, those edges, patches, and some two and a half bytes for each block, its heights' range
//! and its share in those above: a fortieth of a byte for a micro-triangle where quads are large, and up to some four bytes
//! where they are no larger than a block. Heights are read from the image itself as it is in memory. Heights that do not come
//! from such an image (a primvar, Ptex, tiles of UDIM) are asked for once and kept as floats, 2 bytes a micro-triangle.
//!
//! Unlike the papers: quads of a subdivided surface rather than triangles, with stitched edges; blocks of 64
//! micro-vertices, computed and tested at once in registers, rather than one texel after the other; no curved rays; parts
//! are bounded by parallelepipeds rather than boxes, which is tighter and no dearer; and micro-vertices follow
//! the dicing rates rather than the texels.

mod block;
mod build;
#[cfg(test)]
mod deep_tests;
mod edges;
mod edits;
mod face;
mod heights;
mod look_at;
mod look_up;
mod part;
mod shadows;
mod source;
#[cfg(test)]
mod tests;
mod traverse;
mod woven;

use mapped::Large;

use super::Hit;
use super::lattice::Lattice;
use super::moment::Moment;
use super::quads::SIDE;
use super::simd::Isa;
use super::top::Top;
use super::traversal::{Tree, Trunk};
use crate::math::{DVec3, Ray, Vec2};
use crate::stats::AchievedError;
use crate::surface::{ShellError, ShellTolerance};
use edges::Plan;
use face::{Corner, Face, Patch};
use heights::Heights;
use traverse::{Met, Walk};

/// How to build.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DbvhOptions {
    /// How far the quads, and what heights make of them, may be from the limit surface and what heights make of that.
    pub tolerance: ShellTolerance,
    /// The least and the greatest height for which this is to hold, in units of the surface's points; those that the
    /// surface has if there are none.
    pub heights: Option<[f32; 2]>,
}

/// A surface whose micro-geometry is computed where rays pass.
pub struct Dbvh {
    isa: Isa,
    lattice: Lattice,
    /// The largest coordinate on the lattice.
    reach: f32,
    left_handed: bool,
    heights: Heights,
    /// Those that are not holes.
    faces: Vec<Face>,
    /// By motion key, on the lattice.
    corners: Vec<Vec<Corner>>,
    /// Where heights are looked up.
    st: Vec<Vec2>,
    /// The least and the greatest height for which quads and lattice are made.
    built_for: [f32; 2],
    /// The largest number that computing heights comes across, on the lattice.
    highest: f32,
    plan: Plan,
    /// Points of edges that are kept, by motion key, on the lattice.
    kept: Vec<Vec<[f32; 3]>>,
    /// The tree over the patches, which are in its order.
    top: Top,
    patches: Vec<Patch>,
    /// Of the children of parts, patch by patch.
    ranges: Large<heights::Ranges>,
    shell: ShellError,
    /// Pixels that a unit covers at the closest view; none where no pixels are known.
    pixels_per_unit: Option<f32>,
}

impl Dbvh {
    /// How far the quads are from the limit surface, in units of its points.
    pub fn shell(&self) -> ShellError {
        self.shell
    }

    /// How far what is traced is from the displaced limit surface at the same parameters, along its normal. Where the
    /// image is looked up may be off by a little beside that: see [`ShellError::shift`].
    pub fn achieved(&self) -> AchievedError {
        self.shell.achieved(self.pixels_per_unit)
    }

    /// How many micro-triangles rays may meet.
    pub fn micro_triangles(&self) -> u64 {
        self.faces.iter().map(Face::micro_triangles).sum()
    }

    fn keys(&self) -> u32 {
        self.corners.len() as u32
    }
}

impl Tree for Dbvh {
    type Met = Met;
    type Walk<'a, const ANY: bool, const MOVES: bool> = Walk<'a, MOVES>;

    #[inline(always)]
    fn trunk(&self) -> Trunk<'_> {
        Trunk {
            isa: self.isa,
            keys: self.keys(),
            lattice: &self.lattice,
            top: &self.top,
        }
    }

    #[inline(always)]
    fn walk<'a, const ANY: bool, const MOVES: bool>(
        &'a self,
        moment: &'a Moment,
        ray: &Ray,
    ) -> Option<Self::Walk<'a, ANY, MOVES>> {
        Walk::new(self, moment, ray)
    }

    fn hit_on(&self, ray: &Ray, met: &Met) -> Hit {
        let patch = &self.patches[met.patch as usize];
        let face = &self.faces[patch.face as usize];
        let moment = Moment::new(self.keys(), ray.time);
        let (i, j) = (
            met.first[0] + met.cell % SIDE,
            met.first[1] + met.cell / SIDE,
        );
        let corners = if met.second {
            [(i + 1, j + 1), (i, j + 1), (i + 1, j)]
        } else {
            [(i, j), (i + 1, j), (i, j + 1)]
        };
        let [a, b, c] = corners.map(|(i, j)| {
            let [x, y, z] = self.vertex(patch, [i, j], &moment).map(f64::from);
            DVec3::new(x, y, z)
        });
        let normal = (b - a).cross(c - a);
        let normal = if self.left_handed { -normal } else { normal };
        // Measured rather than estimated, in double precision: the point that whoever reads `t` computes, and the plane.
        let point = self.lattice.on_lattice(ray.at(met.hit.t));
        let distance = normal.dot(point - a).abs() / normal.length().max(f64::MIN_POSITIVE);
        let distance = distance * self.lattice.step();
        let [a, b, c] = corners.map(|(i, j)| face.uv(patch.quad, [i, j]));
        let (u, v) = (met.hit.u, met.hit.v);
        let uv = (1.0 - u - v) * a + u * b + v * c;
        Hit {
            t: met.hit.t,
            face: face.face,
            uv: uv.clamp(Vec2::ZERO, Vec2::ONE),
            normal: normal.as_vec3(),
            error: (distance * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE,
        }
    }

    fn bytes(&self) -> usize {
        let corners: usize = self.corners.iter().map(|c| size_of_val(c.as_slice())).sum();
        let kept: usize = self.kept.iter().map(|k| size_of_val(k.as_slice())).sum();
        corners
            + kept
            + self.plan.memory()
            + size_of_val(self.st.as_slice())
            + size_of_val(self.faces.as_slice())
            + size_of_val(self.patches.as_slice())
            + size_of_val(&*self.ranges)
            + self.top.memory()
            + self.heights.memory()
    }
}
