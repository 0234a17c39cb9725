//! What a render cost: seconds by stage, rays, bytes. Written as JSON by `--stats`.

mod achieved;

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use crate::error::{Error, Result, Warning};
use crate::memory::resident;

pub(crate) use achieved::Distances;
pub use achieved::{AchievedError, Spread};

/// Everything that `--stats` writes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Stats {
    /// Program and libraries: relievo, Embree, OpenImageIO.
    pub versions: Versions,
    /// The scene's root file.
    pub scene: String,
    /// SHA-256 over the scene's files in the order in which they were read.
    pub scene_hash: String,
    /// Time and memory of each stage, in order.
    pub stages: Vec<Stage>,
    /// Pixels that were rendered.
    pub resolution: [u32; 2],
    /// Samples in each pixel; fewer if the render was interrupted.
    pub samples_per_pixel: u32,
    /// Threads that rendered.
    pub threads: usize,
    /// Counts of rays.
    pub rays: Rays,
    /// Million rays a second of wall-clock time in the stage `render`.
    pub mrays_per_second: f64,
    /// Nanoseconds of one thread for a ray, all that the path does with it included.
    pub nanoseconds_per_ray: f64,
    /// Bytes by owner after building.
    pub bytes: Bytes,
    /// The most memory that the process had in use, all libraries included; none where the system does not tell.
    pub peak_resident_bytes: Option<u64>,
    /// How objects are traced.
    pub objects: Vec<ObjectStats>,
    /// How far the method moved micro-vertices, or how thick its slabs are, if it did or has any.
    pub achieved_error: Option<AchievedError>,
    /// What the cache was asked for, if surfaces were diced while rays were traced.
    pub cache: Option<CacheUse>,
    /// Counts of what the scene holds.
    pub scene_counts: SceneCounts,
    /// Samples that were not finite and were left out of the picture.
    pub non_finite_samples: u64,
    /// What was noticed and not honoured.
    pub warnings: Vec<Warning>,
}

/// Versions of the program and the libraries that it was built against.
#[derive(Debug, Clone, Serialize)]
pub struct Versions {
    /// This program.
    pub relievo: &'static str,
    /// Embree.
    pub embree: &'static str,
    /// OpenImageIO.
    pub openimageio: &'static str,
}

impl Default for Versions {
    fn default() -> Self {
        Self {
            relievo: env!("CARGO_PKG_VERSION"),
            embree: env!("RELIEVO_EMBREE"),
            openimageio: env!("RELIEVO_OIIO"),
        }
    }
}

/// What a stage took.
#[derive(Debug, Clone, Serialize)]
pub struct Stage {
    /// `load`, `build`, `render`, `write`.
    pub name: &'static str,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Memory that the process has in use at its end, all libraries included; none where the system does not tell.
    pub resident_bytes: Option<u64>,
}

impl Stage {
    /// A stage that began at `start` and ends now.
    pub fn ended(name: &'static str, start: Instant) -> Self {
        Self {
            name,
            seconds: start.elapsed().as_secs_f64(),
            resident_bytes: resident().map(|bytes| bytes as u64),
        }
    }
}

/// Rays by kind.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Rays {
    /// From the camera.
    pub camera: u64,
    /// From a surface on along the path.
    pub scattered: u64,
    /// To lights.
    pub shadow: u64,
}

impl Rays {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.camera + self.scattered + self.shadow
    }

    /// Adds what another thread counted.
    pub fn add(&mut self, other: Self) {
        self.camera += other.camera;
        self.scattered += other.scattered;
        self.shadow += other.shadow;
    }
}

/// Bytes by owner.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Bytes {
    /// Control meshes with their primvars.
    pub control_meshes: usize,
    /// Embree's trees and geometry, now.
    pub embree: usize,
    /// Embree's highest use while building.
    pub embree_peak: usize,
    /// Limit surfaces, and what the method of tracing holds beside Embree.
    pub surfaces: usize,
    /// Textures.
    pub textures: usize,
    /// The picture while it is rendered.
    pub film: usize,
}

/// How an object is traced, and what for.
#[derive(Debug, Clone, Serialize)]
pub struct ObjectStats {
    /// The prim.
    pub path: String,
    /// The method's name; `polygons` for what is not diced.
    pub method: &'static str,
    /// What it is diced into; none where it was built before.
    pub micro_triangles: Option<u64>,
    /// What was expected that it takes, by the method.
    pub expected_bytes: u64,
}

/// What a tessellation cache was asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct CacheUse {
    /// Its size.
    pub bytes: usize,
    /// Visits to patches that were there.
    pub hits: u64,
    /// Visits to patches that had to be diced.
    pub diced: u64,
    /// Those of them that found room in the cache.
    pub kept: u64,
}

/// Counts of what the scene holds.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct SceneCounts {
    /// Distinct meshes.
    pub shapes: usize,
    /// Places in which they stand.
    pub placements: usize,
    /// Faces of all distinct control meshes.
    pub faces: usize,
    /// Lights.
    pub lights: usize,
    /// Materials.
    pub materials: usize,
    /// Textures.
    pub textures: usize,
}

impl Stats {
    /// Runs a stage and notes how long it took.
    pub fn time<T>(&mut self, name: &'static str, stage: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let result = stage(self);
        self.stages.push(Stage::ended(name, start));
        result
    }

    /// Seconds of the stage of this name so far.
    pub fn seconds(&self, name: &str) -> f64 {
        self.stages
            .iter()
            .filter(|s| s.name == name)
            .map(|s| s.seconds)
            .sum()
    }

    /// Writes all as JSON.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::failed(format!("statistics: {e}")))?;
        crate::image::write_whole(path, |temporary| {
            std::fs::write(temporary, text + "\n")
                .map_err(|e| Error::failed(format!("{}: {e}", path.display())))
        })
    }
}
