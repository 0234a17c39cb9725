//! Ways of tracing one surface, set against each other: whether they see the same ([`verify()`]), and how fast and how
//! large they are ([`bench()`]), which [`write_report()`] draws.

mod bench;
mod random;
mod report;
mod traced;
mod verify;

pub use bench::{Bench, BenchOptions, BenchRow, BySpeed, Machine, Reference, bench};
pub use report::{Measured, check_report, report_json, write_report};
pub use verify::{Verified, VerifyRow, achieved_by, verify};

use crate::memory::Budget;
use crate::world::{CacheSize, Choice, MaxError};

/// How finely surfaces are diced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fineness {
    /// All edges of the scene alike, so that about this many micro-triangles result.
    MicroTriangles(u64),
    /// Micro-edges of this many pixels before the scene's camera.
    DicingRate(f32),
}

/// What both comparisons are told.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    /// Which methods.
    pub methods: Vec<Choice>,
    /// How finely they dice.
    pub fineness: Fineness,
    /// Diffuse rays of which speed is measured meet micro-edges so many times as long, above 1, where the method [has
    /// any](crate::world::Method::is_diced); none for the same.
    pub bounce_dicing: Option<f32>,
    /// The farthest that a method which compresses may move a micro-vertex.
    pub max_error: MaxError,
    /// Bytes of the cache, for the method that has one.
    pub cache_size: CacheSize,
    /// What the whole program may have in memory.
    pub memory_budget: Budget,
    /// Rays: for each mesh to verify, for the whole scene to measure speed.
    pub rays: u64,
}
