//! Ways to meet rays with a surface. This layer does not know that Embree exists.

mod boxes;
mod cache;
mod compact;
mod compressed;
mod dbvh;
mod face;
mod lattice;
mod moment;
mod nonlinear;
mod prism;
mod quads;
mod simd;
mod stored;
#[cfg(test)]
mod stored_tests;
mod tessellated;
#[cfg(test)]
pub(crate) mod tests;
mod tiled;
mod top;
mod traversal;
mod triangle;
mod trimmed;
mod waiting;

use crate::math::{Bounds3, Ray, Vec2, Vec3};

pub use cache::{CacheSize, Cached, cache_use};
pub use compact::{Accuracy, Compact, CompactOptions, MaxError};
pub use compressed::Compressed;
pub use dbvh::{Dbvh, DbvhOptions};
pub use nonlinear::Nonlinear;
pub use segments::Cache;
pub use stored::{Keep, Stored};
pub use tessellated::Tessellated;
pub use tiled::{Copies, Tiled};
pub use trimmed::Trimmed;

/// A way to meet rays with one displaced surface. Shared by all render threads.
pub trait Intersector: Send + Sync {
    /// How many primitives Embree shall put into its tree: faces, or parts of faces that the method chose.
    fn primitives(&self) -> u32;
    /// How many motion keys [`bounds`](Self::bounds) answers for, evenly over the shutter; 1 if nothing moves.
    fn keys(&self) -> u32 {
        1
    }
    /// Bounds of everything that primitive `p` may show at motion key `key`. Never too small; empty for a hole.
    fn bounds(&self, p: u32, key: u32) -> Bounds3;
    /// The nearest hit with `ray.t_min < t < ray.t_max`, or none.
    fn intersect(&self, p: u32, ray: &Ray) -> Option<Hit>;
    /// Whether anything lies in that interval. Override where stopping early is cheaper.
    fn occluded(&self, p: u32, ray: &Ray) -> bool {
        self.intersect(p, ray).is_some()
    }
    /// Bytes held, beyond the control mesh and the textures themselves.
    fn memory(&self) -> usize;
}

/// Where a ray met a surface, as the method itself sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// The face, as the surface's base counts them: the Ptex face of a subdivision surface.
    pub face: u32,
    /// Parameters on the face, 0..1 each.
    pub uv: Vec2,
    /// Unnormalised geometric normal, in the space of the ray, towards the surface's front.
    pub normal: Vec3,
    /// How far the point may lie from the geometry that the method traces, in the ray's space.
    pub error: f32,
}
