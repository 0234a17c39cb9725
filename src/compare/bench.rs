//! How fast and how large all methods are, on one set of rays in one process.
//!
//! Methods and numbers of threads take turns, so that a machine that slows down slows all of them; what counts is the
//! median. Threads that other programs kept from the processors are told of. Primary rays go through the pixels of the
//! scene's camera, tile by tile as pictures are rendered; from where they hit, one diffuse bounce (by the cosine)
//! and one shadow ray to a point above the scene. The hits are those of `embree-triangles`, or of what else all others are compared with, for all methods.
//!
//! Distances are measured as [`verify()`](super::verify()) does, to the same surfaces diced four times as finely, or less
//! where that would take too much memory. Such references are held as grids: those are the same micro-triangles, in a
//! sixth of the memory. Most of these distances is what micro-triangles are off the smooth surface; what a method adds
//! to that shows in the distances to what they are compared with, diced alike.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use super::CompareOptions;
use super::random::Random;
use super::traced::{
    MOST_IN_REFERENCE, Prepared, Traced, bounced, device, how_much_finer, methods, prepare,
    together,
};
use super::verify::{Found, compare};
use crate::error::{Error, Result, Warnings};
use crate::film::tiles;
use crate::math::{Affine3A, Bounds3, Frame, Ray, Vec2, Vec3};
use crate::memory::Budget;
use crate::render::{camera, picture_size};
use crate::scene::Description;
use crate::trace::Scene;
use crate::world::{AchievedError, Cache, CacheSize, CacheUse, Choice, Method, cache_use, objects};

/// Times that everything is measured.
const REPEATS: usize = 5;

/// Shorter than this, the system's count of processor time is too coarse.
const ENOUGH_SECONDS: f64 = 0.5;

/// Part of their time for which threads should have had processors.
const ENOUGH_SHARE: f64 = 0.85;

/// What measuring is told.
#[derive(Debug, Clone)]
pub struct BenchOptions {
    /// What and how finely; primary rays, about.
    pub compare: CompareOptions,
    /// What all others are compared with, and whose hits rays leave from.
    pub relative_to: Method,
    /// Whether to measure distances to finely diced surfaces, and to what they are compared with, too. It takes a while.
    pub distances: bool,
}

/// What was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Bench {
    /// Where.
    pub machine: Machine,
    /// When, as `2026-01-31T12:00:00Z`.
    pub date: String,
    /// How many rays of each kind.
    pub rays: BTreeMap<&'static str, u64>,
    /// What speeds are given as ratios to.
    pub relative_to: &'static str,
    /// How many times as long the micro-edges are that diffuse rays met, if they are, where methods have any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounce_dicing: Option<f32>,
    /// What distances were measured to, if they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<Reference>,
    /// Each method.
    pub rows: Vec<BenchRow>,
    /// What could not be measured.
    #[serde(skip)]
    pub warnings: Warnings,
}

/// The surfaces that distances are measured to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Reference {
    /// How many times as fine, along an edge.
    pub finer: u32,
    /// Rays of each method.
    pub rays: u64,
}

/// The machine that it was measured on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// The processor's name.
    pub processor: String,
    /// Threads used where all are.
    pub threads: usize,
    /// Embree's version.
    pub embree: String,
    /// This program's version.
    pub relievo: &'static str,
}

/// By kind of ray, then by number of threads.
pub type BySpeed = BTreeMap<&'static str, BTreeMap<String, f64>>;

/// A method's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchRow {
    /// Its name.
    pub method: &'static str,
    /// Micro-triangles of all meshes, each counted once. For Embree's subdivision, those of the same rates.
    pub micro_triangles: u64,
    /// Bytes held, trees and Embree's own included, control meshes and textures not.
    pub bytes: u64,
    /// The same by the micro-triangle.
    pub bytes_per_micro_triangle: f64,
    /// Dicing and building trees, on all threads.
    pub build_seconds: f64,
    /// How far the method moved micro-vertices, or how thick its slabs are, if it did or has any.
    pub achieved_error: Option<AchievedError>,
    /// What the cache was asked for, by the method that has one, in all repetitions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cache: Option<CacheUse>,
    /// Millions of rays a second.
    pub mrays: BySpeed,
    /// That over the same of what all are compared with.
    pub ratio: BySpeed,
    /// The root of the mean squared distance to the reference, in diagonals of each mesh's box, if it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_distance: Option<f64>,
    /// The largest distance, likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_distance: Option<f64>,
    /// The root of the mean squared distance to what all are compared with, diced alike, likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_to_triangles: Option<f64>,
    /// The largest distance to these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_to_triangles: Option<f64>,
    /// The largest error of a hit: see [`VerifyRow`](super::VerifyRow).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_hit_error: Option<f64>,
}

struct Entry {
    method: Choice,
    /// Each surface alone.
    traced: Vec<Traced>,
    /// All together.
    scene: Scene,
    /// The same as diffuse rays meet it, if that is something else.
    bounced: Option<Scene>,
    bytes: u64,
    cache: Option<Arc<Cache>>,
    error: Option<AchievedError>,
    builds: Vec<f64>,
    /// What rays to the reference and to triangles diced alike found.
    found: Option<[Found; 2]>,
    /// By kind of ray and number of threads.
    speeds: BTreeMap<(&'static str, usize), Vec<f64>>,
}

/// Threads to measure on, and whether they had processors.
struct Pool {
    threads: usize,
    pool: rayon::ThreadPool,
    /// Seconds by the clock and of all processors together.
    clock: f64,
    processors: f64,
}

impl Pool {
    fn new(threads: usize) -> Result<Self> {
        Ok(Self {
            threads,
            pool: rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|e| Error::failed(format!("cannot start {threads} threads: {e}")))?,
            clock: 0.0,
            processors: 0.0,
        })
    }

    /// Runs it on the threads, and notes what they got.
    fn watched(&mut self, run: impl FnOnce() + Send) {
        let (clock, processors) = (Instant::now(), processor_seconds());
        self.pool.install(run);
        self.clock += clock.elapsed().as_secs_f64();
        self.processors += processor_seconds() - processors;
    }

    /// Warns if other programs had the processors: figures of several threads then say nothing.
    fn report(&self, warnings: &mut Warnings) {
        let had = self.processors / self.clock;
        if self.clock > ENOUGH_SECONDS && had < ENOUGH_SHARE * self.threads as f64 {
            let threads = self.threads;
            warnings.add("busy machine", || {
                format!(
                    "{threads} threads had {had:.1} processors: measure again on an idle machine"
                )
            });
        }
    }
}

/// Measures all methods over a scene.
///
/// # Errors
/// If the scene cannot be built, or there is nothing in it to see.
pub fn bench(description: &Description, options: &BenchOptions) -> Result<Bench> {
    let BenchOptions {
        compare: options,
        relative_to,
        distances,
    } = options;
    let relative_to = Choice::One(*relative_to);
    let mut warnings = Warnings::default();
    let all = objects(description, &options.memory_budget, &mut warnings)?;
    let view = camera(
        description,
        picture_of(options.rays, picture_size(description)),
    )?;
    let prepared = prepare(all, (options.fineness, options.max_error), &|| {
        camera(description, picture_size(description))
    })?;
    let micro_triangles: u64 = prepared.iter().map(Prepared::triangles).sum();

    let mut methods = options.methods.clone();
    if !methods.contains(&relative_to) {
        methods.insert(0, relative_to);
    }
    let mut entries: Vec<Entry> = Vec::new();
    for round in 0..REPEATS.div_ceil(2) {
        for &method in &methods {
            if round > 0 && !entries.iter().any(|e| e.method == method) {
                continue;
            }
            match build(method, &prepared, options) {
                Ok(entry) => match entries.iter_mut().find(|e| e.method == method) {
                    Some(earlier) => earlier.builds.extend(entry.builds),
                    None => entries.push(entry),
                },
                Err(Error::Input(fault)) if method == Choice::One(Method::EmbreeSubdivision) => {
                    warnings.add("not in Embree", || {
                        format!("Embree's subdivision is left out: {fault}")
                    });
                }
                Err(error) => return Err(error),
            }
        }
    }
    let twin = entries
        .iter()
        .position(|entry| entry.method == relative_to)
        .expect("it was put among the methods");
    let kinds = rays(&entries[twin], &view);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut counts = vec![1, threads];
    counts.dedup();
    let mut pools = counts
        .into_iter()
        .map(Pool::new)
        .collect::<Result<Vec<_>>>()?;
    for _ in 0..REPEATS {
        for pool in &mut pools {
            let count = pool.threads;
            pool.watched(|| {
                for (kind, rays) in &kinds {
                    for entry in &mut entries {
                        let speed = speed(entry, kind, rays);
                        entry.speeds.entry((kind, count)).or_default().push(speed);
                    }
                }
            });
        }
    }
    for pool in &pools {
        pool.report(&mut warnings);
    }
    let reference = if *distances {
        measure_distances(&prepared, &mut entries, twin, options, &mut warnings)?
    } else {
        None
    };
    let medians = |entry: &Entry| -> BySpeed {
        let mut all = BySpeed::new();
        for ((kind, count), speeds) in &entry.speeds {
            all.entry(kind)
                .or_default()
                .insert(count.to_string(), median(speeds));
        }
        all
    };
    let norm = medians(&entries[twin]);
    let rows = entries
        .iter()
        .filter(|entry| options.methods.contains(&entry.method))
        .map(|entry| {
            let mrays = medians(entry);
            let mut ratio = mrays.clone();
            for (kind, by_threads) in &mut ratio {
                for (count, speed) in by_threads {
                    *speed /= norm[kind][count].max(f64::MIN_POSITIVE);
                }
            }
            BenchRow {
                method: entry.method.name(),
                micro_triangles,
                bytes: entry.bytes,
                bytes_per_micro_triangle: entry.bytes as f64 / micro_triangles.max(1) as f64,
                build_seconds: median(&entry.builds),
                achieved_error: entry.error,
                cache: entry.cache.as_deref().map(cache_use),
                mrays,
                ratio,
                rms_distance: entry.found.map(|[fine, _]| fine.rms()),
                max_distance: entry.found.map(|[fine, _]| fine.max),
                rms_to_triangles: entry.found.map(|[_, alike]| alike.rms()),
                max_to_triangles: entry.found.map(|[_, alike]| alike.max),
                max_hit_error: entry.found.map(|[fine, _]| fine.hit_error),
            }
        })
        .collect();
    Ok(Bench {
        machine: machine(threads)?,
        date: jiff::Timestamp::now()
            .strftime("%Y-%m-%dT%H:%M:%SZ")
            .to_string(),
        rays: (kinds.iter())
            .map(|(kind, rays)| (*kind, rays.len() as u64))
            .collect(),
        relative_to: relative_to.name(),
        bounce_dicing: options.bounce_dicing,
        reference,
        rows,
        warnings,
    })
}

/// The size of a picture of so many pixels, about, as wide for its height as another one.
fn picture_of(pixels: u64, [width, height]: [u32; 2]) -> [u32; 2] {
    let scale = (pixels.max(1) as f64 / (f64::from(width) * f64::from(height))).sqrt();
    [width, height].map(|side| (scale * f64::from(side)).ceil() as u32)
}

/// Builds all surfaces and their scene, and measures bytes and seconds.
fn build(method: Choice, prepared: &[Prepared], options: &CompareOptions) -> Result<Entry> {
    let device = device(&options.memory_budget)?;
    let before = device.memory();
    let methods = methods(method, prepared, &options.memory_budget);
    let has_cache = methods.contains(&Method::Cache);
    if has_cache {
        let size = options.cache_size.0 as u64;
        options.memory_budget.ask(size, "the cache")?;
    }
    let cache = Method::Cache.cache(if has_cache {
        options.cache_size
    } else {
        CacheSize(0)
    });
    let start = Instant::now();
    let traced = (prepared.iter().zip(&methods))
        .map(|(p, method)| p.build(*method, &p.rates, &device, &cache))
        .collect::<Result<Vec<_>>>()?;
    let places: Vec<&[Affine3A]> = prepared
        .iter()
        .map(|p| p.object.world_from_object.as_slice())
        .collect();
    let scene = together(method, &traced, &places, &device)?;
    let bounced = match options.bounce_dicing {
        Some(times) => {
            let by = (method, methods.as_slice());
            Some(bounced(prepared, by, (&traced, times), &device, &cache)?)
        }
        None => None,
    };
    let seconds = start.elapsed().as_secs_f64();
    let own: usize = traced.iter().map(|t| t.bytes).sum();
    let (bounced, beside) = bounced.map_or((None, 0), |(scene, bytes)| (Some(scene), bytes));
    let cache = has_cache.then_some(cache);
    let cached = cache.as_ref().map_or(0, |cache| cache.bytes());
    let bytes = own + beside + cached + device.memory().saturating_sub(before);
    Ok(Entry {
        method,
        error: AchievedError::of_all(traced.iter().map(|t| t.error)),
        traced,
        scene,
        bounced,
        bytes: bytes as u64,
        cache,
        builds: vec![seconds],
        found: None,
        speeds: BTreeMap::new(),
    })
}

/// How far each method's surfaces are from the same diced more finely, and from those of the twin, diced alike.
/// References are built one after the other.
fn measure_distances(
    prepared: &[Prepared],
    entries: &mut [Entry],
    twin: usize,
    options: &CompareOptions,
    warnings: &mut Warnings,
) -> Result<Option<Reference>> {
    let largest = (prepared.iter().map(|p| p.rates.micro_triangles())).max();
    let Some(finer) = how_much_finer(largest.unwrap_or(0)) else {
        warnings.add("no reference", || {
            "distances are not measured: more finely diced, a surface would have too many micro-triangles"
                .to_owned()
        });
        return Ok(None);
    };
    let each = options.rays.div_ceil(prepared.len().max(1) as u64);
    for (i, prepared) in prepared.iter().enumerate() {
        let device = device(&options.memory_budget)?;
        let none = Method::EmbreeGrid.cache(CacheSize::default());
        let fine = match prepared.copies() {
            None => prepared.build(Method::EmbreeGrid, &prepared.finer(finer), &device, &none)?,
            Some(copies) if copies <= MOST_IN_REFERENCE => {
                prepared.build(Method::EmbreeTriangles, &prepared.rates, &device, &none)?
            }
            Some(copies) => {
                warnings.add("no copies", || {
                    format!(
                        "{}: distances of its tiles are not measured: {copies} triangles would have to be copied",
                        prepared.object.path
                    )
                });
                continue;
            }
        };
        for e in 0..entries.len() {
            let traced = &entries[e].traced[i];
            let found = [&fine, &entries[twin].traced[i]]
                .map(|reference| compare(prepared, traced, reference, each));
            if found.iter().all(|found| found.measured > 0) {
                let [fine, alike] = entries[e].found.unwrap_or_default();
                entries[e].found = Some([fine.and(found[0]), alike.and(found[1])]);
            }
        }
    }
    Ok(Some(Reference {
        finer,
        rays: each * prepared.len() as u64,
    }))
}

/// The three kinds of rays.
fn rays(entry: &Entry, view: &crate::shade::camera::Camera) -> [(&'static str, Vec<Ray>); 3] {
    let scene = &entry.scene;
    let bounced = entry.bounced.as_ref().unwrap_or(scene);
    let primary: Vec<Ray> = tiles(view.resolution())
        .into_iter()
        .flat_map(|[[left, top], [width, height]]| {
            let rows = top..top + height;
            rows.flat_map(move |y| (left..left + width).map(move |x| [x, y]))
        })
        .map(|pixel| view.ray(Vec2::from(pixel.map(|n| n as f32 + 0.5)), [0.5; 2], 0.0))
        .collect();
    let Bounds3 { min, max } = scene.bounds();
    let light = 0.5 * (min + max) + (max - min).length() * Vec3::new(0.5, 1.0, 0.7);
    let (mut diffuse, mut shadow) = (Vec::new(), Vec::new());
    // Where a ray meets a scene, and the normal on its side.
    let seen = |scene: &Scene, ray: &Ray| {
        let hit = scene.intersect(ray)?;
        // Instances may be scaled and turned; the light's side of a random plane is as good for speed.
        let normal = hit.normal.normalize_or(Vec3::Y);
        let towards = -ray.direction.dot(normal).signum();
        Some((ray.at(hit.t), towards * normal))
    };
    let start = |p, direction| Ray {
        t_min: 1e-4 * (max - min).length(),
        ..Ray::new(p, direction, 0.0)
    };
    for (seed, ray) in (0..).zip(&primary) {
        if let Some((p, normal)) = seen(bounced, ray) {
            let mut random = Random::new(seed);
            let local = (random.direction() + Vec3::Z).normalize_or(Vec3::Z);
            diffuse.push(start(p, Frame::around(normal).world_from_local(local)));
        }
        if let Some((p, _)) = seen(scene, ray) {
            shadow.push(Ray {
                t_max: 1.0,
                t_min: 1e-4,
                ..start(p, light - p)
            });
        }
    }
    [
        ("primary", primary),
        ("diffuse", diffuse),
        ("shadow", shadow),
    ]
}

/// Millions of rays a second, on this pool.
fn speed(entry: &Entry, kind: &str, rays: &[Ray]) -> f64 {
    let scene = match &entry.bounced {
        Some(bounced) if kind == "diffuse" => bounced,
        _ => &entry.scene,
    };
    let start = Instant::now();
    let met: usize = rays
        .par_chunks(1024)
        // Some take many times as long as others: none waits for another.
        .with_max_len(1)
        .map(|rays| match kind {
            "shadow" => rays.iter().filter(|ray| scene.occluded(ray)).count(),
            _ => rays
                .iter()
                .filter(|ray| scene.intersect(ray).is_some())
                .count(),
        })
        .sum();
    std::hint::black_box(met);
    1e-6 * rays.len() as f64 / start.elapsed().as_secs_f64().max(1e-9)
}

/// What this process used so far, on Linux; elsewhere not a number.
fn processor_seconds() -> f64 {
    // A hundredth of a second each, whatever the kernel counts in.
    const TICKS: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The program's name may have spaces; user and system time are the 12th and 13th words after it.
    let after = text.rsplit(')').next().unwrap_or_default();
    let mut times = after.split_whitespace().skip(11).map(str::parse::<f64>);
    match (times.next(), times.next()) {
        (Some(Ok(user)), Some(Ok(system))) => (user + system) / TICKS,
        _ => f64::NAN,
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

fn machine(threads: usize) -> Result<Machine> {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split(':').nth(1))
        .map_or(std::env::consts::ARCH, str::trim);
    Ok(Machine {
        processor: name.to_owned(),
        threads,
        embree: device(&Budget::default())?.version(),
        relievo: env!("CARGO_PKG_VERSION"),
    })
}
