//! From a scene file to a picture: the stages in their order.

mod build;
mod estimate;
mod framing;
mod output;
mod progress;

pub use build::{Recorded, build};
pub use estimate::{Estimate, camera, estimate, picture_size};
pub use output::{AOVS, Aov, Output, PixelType};
pub use progress::{Progress, ProgressStyle};

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::error::{Error, Fault, Result};
use crate::film::{Film, Tile};
use crate::integrate::{PathOptions, path};
use crate::math::Vec2;
use crate::memory::{Budget, amount, peak_resident};
use crate::scene::{self, AspectRatioConform, Description, LoadOptions};
use crate::shade::camera::{Camera, CameraOptions};
use crate::shade::filter::Filter;
use crate::shade::sampler::Sampler;
use crate::stats::{Bytes, ObjectStats, Rays, SceneCounts, Stage, Stats};
use crate::store::Store;
use crate::trace::{Device, DeviceOptions};
use crate::world::{BuildOptions, Built, Choice, World, cache_use};

/// Everything that a render can be told. `None` leaves it to the scene, then to the default.
#[derive(Debug, Clone)]
pub struct RenderOptions {
    /// The scene file.
    pub scene: PathBuf,
    /// What is written.
    pub output: Output,
    /// Path or last name of the camera.
    pub camera: Option<String>,
    /// Pixels.
    pub resolution: Option<[u32; 2]>,
    /// Multiplies the resolution.
    pub scale: f32,
    /// Samples in each pixel, 1..=65536.
    pub spp: u32,
    /// How far paths go.
    pub path: PathOptions,
    /// How pixels are made of samples.
    pub filter: Filter,
    /// Chooses the random numbers.
    pub seed: u32,
    /// Threads; 0 takes all.
    pub threads: usize,
    /// What the whole program may have in memory.
    pub memory_budget: Budget,
    /// How the scene is read.
    pub load: LoadOptions,
    /// Whether the lens may blur.
    pub depth_of_field: bool,
    /// How the world is built.
    pub build: BuildOptions,
    /// Where the hierarchies lie that [`build()`] has built. The method must be the store's.
    pub built: Option<Arc<Store>>,
}

/// The picture's size where neither the user nor the scene says one.
const DEFAULT_RESOLUTION: [u32; 2] = [960, 540];

/// The largest side of a picture: EXR files of more pixels exist, but not from renderers.
const MAX_RESOLUTION: u32 = 65_536;

/// Renders a scene and writes what [`Output`] asks for.
///
/// Setting `interrupt` ends the render at the next tile: what is there by then is written, and the result is
/// [`Error::Interrupted`].
///
/// # Errors
/// As the stages: bad input, a memory budget that does not suffice, output that cannot be written.
pub fn render(
    options: &RenderOptions,
    progress: &Progress,
    interrupt: &AtomicBool,
) -> Result<Stats> {
    let mut stats = Stats {
        scene: options.scene.display().to_string(),
        ..Stats::default()
    };
    let mut output = options.output.clone();
    output.check()?;

    let staged = stage(options, progress, &mut stats, interrupt)?;
    let Staged {
        description,
        camera,
        resolution,
        device,
        pool,
    } = staged;
    if output.from_scene
        && let Some(name) = &description.settings.product_name
    {
        output.picture = PathBuf::from(name);
        output.check()?;
    }
    stats.scene_hash = hash(&description)?;
    let settings = &description.settings;

    let (origin, size) = window(settings.data_window, resolution);
    let budget = &options.memory_budget;
    // It is there before anything is built, so that whoever asks what is left need not know of it.
    let film_bytes = Film::bytes(size);
    let of_picture = film_bytes + output.bytes(size);
    budget.ask(
        of_picture as u64,
        "the film and the picture that is written",
    )?;
    let mut film = Film::new(origin, size);
    let build = &BuildOptions {
        held_beside: of_picture,
        ..options.build.clone()
    };
    let built = building(
        &pool,
        progress,
        &mut stats,
        interrupt,
        |go_on| match &options.built {
            Some(store) => World::stored(&description, &camera, &device, build, store, go_on),
            None => World::build(&description, &camera, &device, build, go_on),
        },
    )?;
    let (world, cache) = (built.world, built.cache);
    tell_choice(build.method, &built.objects);
    stats.objects = built.objects;
    stats.achieved_error = built.error;
    stats.bytes = Bytes {
        control_meshes: description.shapes.iter().map(|s| s.geometry.memory()).sum(),
        embree: device.memory(),
        embree_peak: device.peak_memory(),
        surfaces: built.surface_bytes,
        textures: built.texture_bytes,
        film: film_bytes,
    };
    stats.scene_counts = counts(&description);
    progress.warn(&built.warnings);
    let mut warnings = description.warnings.clone();
    warnings.extend(built.warnings);
    stats.warnings = warnings.iter().cloned().collect();

    // Render: whole passes over the picture, so that what an interruption leaves is a whole picture.
    let job = Job {
        world: &world,
        camera: &camera,
        options,
        path: PathOptions {
            footprint: options.path.footprint * share_of_pixel(options.spp),
            ..options.path
        },
        exposure: camera.exposure(),
    };
    let counters = Counters::default();
    progress.stage("render", u64::from(options.spp) * film.tiles.len() as u64);
    stats.time("render", |_| {
        pool.install(|| {
            for pass in passes(options.spp) {
                // Tiles of the sky take no time: each is there to be taken over until the last.
                let tiles = film.tiles.par_iter_mut().with_max_len(1);
                tiles.for_each(|tile| {
                    if !interrupt.load(Ordering::Relaxed) {
                        job.tile(tile, pass.clone(), &counters);
                        progress.by(u64::from(pass.end - pass.start));
                    }
                });
            }
        });
    });
    if let Some(message) = world.take_panic() {
        return Err(Error::failed(format!(
            "a callback failed while rays were traced: {message}"
        )));
    }

    world.check_textures()?;

    // Write. The world makes room for what is written.
    drop(world);
    stats.resolution = size;
    stats.samples_per_pixel = film.samples();
    stats.threads = pool.current_num_threads();
    stats.rays = counters.rays();
    stats.cache = cache.as_deref().map(cache_use);
    drop(cache);
    stats.non_finite_samples = counters.non_finite.load(Ordering::Relaxed);
    let (rays, seconds) = (stats.rays.total() as f64, stats.seconds("render"));
    stats.mrays_per_second = rays / 1e6 / seconds.max(1e-9);
    stats.nanoseconds_per_ray = 1e9 * seconds * stats.threads as f64 / rays.max(1.0);
    progress.stage("write", 1);
    let record = output::Record {
        stats: &stats,
        camera: &camera,
        resolution,
        options,
    };
    let start = std::time::Instant::now();
    let written = output.write(&film, &record);
    stats.stages.push(Stage::ended("write", start));
    progress.finish();
    written?;
    stats.peak_resident_bytes = peak_resident().map(|bytes| bytes as u64);
    if let Some(path) = &output.stats {
        stats.write(path)?;
    }
    interrupted(interrupt)?;
    Ok(stats)
}

/// What is there before anything is built.
struct Staged {
    description: Description,
    camera: Camera,
    /// Of the whole picture.
    resolution: [u32; 2],
    device: Device,
    pool: rayon::ThreadPool,
}

/// Loads the scene, and prepares camera, threads and Embree.
fn stage(
    options: &RenderOptions,
    progress: &Progress,
    stats: &mut Stats,
    interrupt: &AtomicBool,
) -> Result<Staged> {
    progress.stage("load", 1);
    options
        .memory_budget
        .ask(scene::expected_memory(&options.scene), "the scene's file")?;
    let description = stats.time("load", |_| scene::load(&options.scene, &options.load))?;
    // Told before anything can fail: they often say why it does.
    progress.warn(&description.warnings);
    let (camera_source, framed) = framing::camera(&description, options.camera.as_deref())?;
    if framed {
        tracing::info!("the scene has no camera: it is framed whole");
    }
    let resolution = resolution(&description, options)?;
    let settings = &description.settings;
    let camera = Camera::new(
        &camera_source,
        CameraOptions {
            resolution,
            conform: if framed {
                AspectRatioConform::ExpandAperture
            } else {
                settings.conform
            },
            pixel_aspect: settings.pixel_aspect_ratio.unwrap_or(1.0),
            depth_of_field: options.depth_of_field
                && !settings.disable_depth_of_field.unwrap_or(false),
        },
    )?;
    interrupted(interrupt)?;

    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .build()
        .map_err(|e| Error::failed(format!("cannot start {} threads: {e}", options.threads)))?;
    options.memory_budget.ask(0, "program and scene")?;
    let device = Device::new(&DeviceOptions {
        threads: pool.current_num_threads(),
        memory_budget: options.memory_budget.clone(),
        ..DeviceOptions::default()
    })?;
    Ok(Staged {
        description,
        camera,
        resolution,
        device,
        pool,
    })
}

/// Says by which methods objects are traced, if they were chosen.
fn tell_choice(choice: Choice, objects: &[ObjectStats]) {
    if choice != Choice::Auto {
        return;
    }
    let mut names: Vec<&str> = objects.iter().map(|object| object.method).collect();
    names.sort_unstable();
    names.dedup();
    for name in names {
        let by = || objects.iter().filter(|object| object.method == name);
        let triangles: u64 = by().filter_map(|object| object.micro_triangles).sum();
        let bytes: u64 = by().map(|object| object.expected_bytes).sum();
        let which: Vec<&str> = by().take(3).map(|object| object.path.as_str()).collect();
        let more = if by().count() > which.len() {
            ", ..."
        } else {
            ""
        };
        tracing::info!(
            "auto: {name} for {} objects ({}{more}), {triangles} micro-triangles, about {}",
            by().count(),
            which.join(", "),
            amount(bytes as f64)
        );
    }
}

/// The stage `build` on the pool's threads. `build` is handed what it is to tell how far it is, and whether to go on.
fn building(
    pool: &rayon::ThreadPool,
    progress: &Progress,
    stats: &mut Stats,
    interrupt: &AtomicBool,
    build: impl FnOnce(&(dyn Fn(f64) -> bool + Sync)) -> Result<Built> + Send,
) -> Result<Built> {
    progress.stage("build", 1000);
    let go_on = |done: f64| {
        progress.at((1000.0 * done) as u64);
        !interrupt.load(Ordering::Relaxed)
    };
    stats.time("build", |_| pool.install(|| build(&go_on)))
}

fn interrupted(interrupt: &AtomicBool) -> Result<()> {
    if interrupt.load(Ordering::Relaxed) {
        Err(Error::Interrupted)
    } else {
        Ok(())
    }
}

/// Pass by pass 1, 1, 2, 4, … up to 16 samples: something to see at once, and few visits to each tile.
fn passes(spp: u32) -> impl Iterator<Item = std::ops::Range<u32>> {
    let mut start = 0;
    std::iter::from_fn(move || {
        (start < spp).then(|| {
            let end = spp.min(start + start.clamp(1, 16));
            let pass = start..end;
            start = end;
            pass
        })
    })
}

struct Job<'a> {
    world: &'a World,
    camera: &'a Camera,
    options: &'a RenderOptions,
    /// The options' with the footprint of one sample of many.
    path: PathOptions,
    /// Radiance is multiplied by this.
    exposure: f32,
}

#[derive(Default)]
struct Counters {
    camera: AtomicU64,
    scattered: AtomicU64,
    shadow: AtomicU64,
    non_finite: AtomicU64,
}

impl Counters {
    fn add(&self, rays: Rays, non_finite: u64) {
        self.camera.fetch_add(rays.camera, Ordering::Relaxed);
        self.scattered.fetch_add(rays.scattered, Ordering::Relaxed);
        self.shadow.fetch_add(rays.shadow, Ordering::Relaxed);
        self.non_finite.fetch_add(non_finite, Ordering::Relaxed);
    }

    fn rays(&self) -> Rays {
        Rays {
            camera: self.camera.load(Ordering::Relaxed),
            scattered: self.scattered.load(Ordering::Relaxed),
            shadow: self.shadow.load(Ordering::Relaxed),
        }
    }
}

impl Job<'_> {
    fn tile(&self, tile: &mut Tile, samples: std::ops::Range<u32>, counters: &Counters) {
        let mut rays = Rays::default();
        let mut non_finite = 0;
        let moves = self.world.moves || self.camera.moves();
        for (i, pixel) in tile.pixels.iter_mut().enumerate() {
            let at = [
                tile.origin[0] + i as u32 % tile.size[0],
                tile.origin[1] + i as u32 / tile.size[0],
            ];
            for sample in samples.clone() {
                let sampler = Sampler::new(at, sample, self.options.seed);
                let [film_u, film_v, lens_u, lens_v] = sampler.set(0);
                let time = if moves { sampler.set(TIME_SET)[0] } else { 0.0 };
                let offset = self.options.filter.sample([film_u, film_v]);
                let film = Vec2::new(at[0] as f32 + 0.5, at[1] as f32 + 0.5) + offset;
                let ray = self.camera.ray(film, [lens_u, lens_v], time);
                let wide_ray = (ray, self.camera.cone(film));
                let mut found = path(self.world, &self.path, wide_ray, &sampler, &mut rays);
                found.radiance *= self.exposure;
                let depth = |p| self.camera.depth(p, time);
                let added = pixel.add(&found, offset.length(), depth);
                non_finite += u64::from(added.is_err());
            }
        }
        counters.add(rays, non_finite);
    }
}

/// The part of a pixel's width that a sample stands for: they share its area. Where many of them blur by themselves, a
/// little is left so that no texel is missed or seen alone (as in pbrt, version 4).
fn share_of_pixel(spp: u32) -> f32 {
    const LEAST: f32 = 0.125;
    (spp.max(1) as f32).sqrt().recip().max(LEAST)
}

/// The shutter's dimension set lies beyond those of the path.
const TIME_SET: u32 = 8192;

fn counts(description: &Description) -> SceneCounts {
    SceneCounts {
        shapes: description.shapes.len(),
        placements: description.placements.len(),
        faces: description
            .shapes
            .iter()
            .map(|s| s.geometry.face_count())
            .sum(),
        lights: description.lights.len(),
        materials: description.materials.len(),
        textures: description.textures.len(),
    }
}

fn resolution(description: &Description, options: &RenderOptions) -> Result<[u32; 2]> {
    let asked = options
        .resolution
        .unwrap_or_else(|| picture_size(description));
    let scaled = asked.map(|n| {
        if n == 0 {
            0
        } else {
            ((n as f32 * options.scale).round() as u32).max(1)
        }
    });
    if scaled.iter().any(|&n| n == 0 || n > MAX_RESOLUTION) {
        let message = format!(
            "a picture of {} x {} pixels cannot be rendered",
            scaled[0], scaled[1]
        );
        let help = format!("each side must have 1 to {MAX_RESOLUTION} pixels: --res 1920 1080");
        return Err(if options.resolution.is_some() {
            Error::usage(message, help)
        } else {
            Fault::new(message)
                .in_file(&options.scene)
                .advise(help)
                .into()
        });
    }
    Ok(scaled)
}

/// The part of the picture that the settings' data window asks for, in pixels: origin and size.
fn window(data_window: Option<[f32; 4]>, [width, height]: [u32; 2]) -> ([u32; 2], [u32; 2]) {
    let Some([x0, y0, x1, y1]) = data_window else {
        return ([0, 0], [width, height]);
    };
    let pixel = |f: f32, n: u32| (f.clamp(0.0, 1.0) * n as f32).round() as u32;
    // The window's y points up, the picture's rows run down.
    let (left, right) = (pixel(x0, width), pixel(x1, width));
    let (top, bottom) = (pixel(1.0 - y1, height), pixel(1.0 - y0, height));
    if left >= right || top >= bottom {
        return ([0, 0], [width, height]);
    }
    ([left, top], [right - left, bottom - top])
}

fn hash(description: &Description) -> Result<String> {
    let mut hash = Sha256::new();
    for file in &description.files {
        // A file inside a package has no bytes of its own on the disk: the package is in the list too.
        if let Ok(mut file) = std::fs::File::open(file) {
            std::io::copy(&mut file, &mut hash)
                .map_err(|e| Error::failed(format!("reading again for the hash: {e}")))?;
        }
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_cover_all_samples_once() {
        for spp in [1, 2, 5, 64, 100] {
            let all: Vec<u32> = passes(spp).flatten().collect();
            assert_eq!(all, (0..spp).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_data_window_counts_from_below() {
        assert_eq!(
            window(Some([0.0, 0.5, 0.5, 1.0]), [100, 50]),
            ([0, 0], [50, 25])
        );
        assert_eq!(window(None, [100, 50]), ([0, 0], [100, 50]));
    }
}
