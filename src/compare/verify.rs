//! Whether all methods see the same surface.
//!
//! Rays come from a sphere around each mesh and aim into its box. Where a ray meets the method's surface, the distance
//! to the reference is the least of four, each of them as long as the true one or longer: along the ray, which tells of
//! its own slope where it grazes; along the method's normal, which may miss the sheet that is meant and meet another;
//! and to the reference's points of the same face and parameters, of its smooth surface and of its micro-triangles,
//! which may have slid along the surface. Normals are
//! those of the smooth surfaces, compared where the method's normal meets the reference or, where that faces away, at the
//! same face and parameters, if either is close by.
//!
//! Leaks are rays that leave a closed mesh from within by the method's account, and not by the reference's. They start
//! halfway between the points where a ray enters and leaves the reference, wherever that is far from it on all sides, by
//! more than the method's surface may be off: what is within a fold's width of the surface may well be outside of it.
//!
//! What stands over a surface tile by tile is compared with copies of it in Embree's triangles.
//!
//! References are micro-triangles as grids, four times as fine along an edge, or less where that would take too much
//! memory.

use rayon::prelude::*;
use serde::Serialize;

use super::CompareOptions;
use super::random::Random;
use super::traced::{Prepared, Traced, device, how_much_finer, methods, prepare};
use crate::error::{Error, Result, Warnings};
use crate::math::{Ray, Vec3};
use crate::render::{camera, picture_size};
use crate::scene::Description;
use crate::surface::Rates;
use crate::trace::{Device, Scene, SceneHit};
use crate::world::{AchievedError, CacheSize, Choice, Method, objects};

/// Farther apart than this part of the box, two hits are not of one place, and their normals are not compared.
const SAME_PLACE: f32 = 1e-3;

/// What was found.
#[derive(Debug, Clone)]
pub struct Verified {
    /// Each method against each reference.
    pub rows: Vec<VerifyRow>,
    /// What could not be compared.
    pub warnings: Warnings,
}

/// A method against a reference, over all meshes of the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VerifyRow {
    /// The method's name.
    pub method: &'static str,
    /// `embree-subdivision`, or `fine-triangles`: our own dicing, finer.
    pub reference: &'static str,
    /// Rays traced.
    pub rays: u64,
    /// Rays that met only the method's surface.
    pub only_method: u64,
    /// Rays that met only the reference.
    pub only_reference: u64,
    /// The largest distance, in diagonals of the mesh's box.
    pub max_distance: f64,
    /// The root of the mean squared distance, likewise.
    pub rms_distance: f64,
    /// The largest angle between normals, in degrees.
    pub max_normal_degrees: f64,
    /// Rays that left a closed mesh from within.
    pub leaks: u64,
    /// The largest error of a hit, in diagonals: how far it was from the very geometry that the method traces, as the method
    /// itself measured; 0 by Embree's geometries, which do not measure.
    pub max_hit_error: f64,
    /// How far the method moved micro-vertices, or how thick its slabs are: a part of the distances.
    pub achieved_error: Option<AchievedError>,
}

/// What the achieved error of a method of this name says, ahead of "up to so many diagonals".
pub fn achieved_by(method: &str) -> &'static str {
    let is = |named: Method| named.name() == method;
    match () {
        () if is(Method::Compressed) => "slabs thick by",
        () if is(Method::Nonlinear) => "micro-vertices beside their parameters by",
        () if is(Method::Dbvh) => "quads off the displaced limit surface by",
        () => "micro-vertices moved by",
    }
}

/// What rays found, in sums.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Found {
    rays: u64,
    only_method: u64,
    only_reference: u64,
    /// Rays that met both.
    pub(super) measured: u64,
    /// The largest distance.
    pub(super) max: f64,
    squares: f64,
    degrees: f64,
    leaks: u64,
    /// The largest error of a hit.
    pub(super) hit_error: f64,
    error: Option<AchievedError>,
}

impl Found {
    /// The root of the mean squared distance.
    pub(super) fn rms(&self) -> f64 {
        (self.squares / self.measured.max(1) as f64).sqrt()
    }

    pub(super) fn and(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            only_method: self.only_method + other.only_method,
            only_reference: self.only_reference + other.only_reference,
            measured: self.measured + other.measured,
            max: self.max.max(other.max),
            squares: self.squares + other.squares,
            degrees: self.degrees.max(other.degrees),
            leaks: self.leaks + other.leaks,
            hit_error: self.hit_error.max(other.hit_error),
            error: AchievedError::of_all([self.error, other.error]),
        }
    }
}

/// Compares all methods over all meshes of a scene.
///
/// # Errors
/// If the scene cannot be built.
pub fn verify(description: &Description, options: &CompareOptions) -> Result<Verified> {
    let mut warnings = Warnings::default();
    let objects = objects(description, &options.memory_budget, &mut warnings)?;
    let view = || camera(description, picture_size(description));
    let prepared = prepare(objects, (options.fineness, options.max_error), &view)?;
    let mut found: Vec<(Choice, &'static str, Found)> = Vec::new();
    let choices: Vec<(Choice, Vec<Method>)> = (options.methods.iter())
        .map(|&choice| (choice, methods(choice, &prepared, &options.memory_budget)))
        .collect();
    for (number, prepared) in prepared.iter().enumerate() {
        let device = device(&options.memory_budget)?;
        let none = Method::EmbreeTriangles.cache(options.cache_size);
        let finer = how_much_finer(prepared.rates.micro_triangles()).unwrap_or_else(|| {
            warnings.add("coarse references", || {
                format!(
                    "{}: compared with surfaces diced alike: more finely diced, they would take too much memory",
                    prepared.object.path
                )
            });
            1
        });
        let fine = prepared.finer(finer);
        // Copies of tiles are triangles, and nothing else.
        let (embree, triangles) = if prepared.is_tiled() {
            (None, Method::EmbreeTriangles)
        } else {
            let embree = supported(prepared, &fine, &device, &mut warnings)?;
            (embree, Method::EmbreeGrid)
        };
        let triangles = prepared.build(triangles, &fine, &device, &none)?;
        for (choice, methods) in &choices {
            let (choice, method) = (*choice, methods[number]);
            if method == Method::EmbreeSubdivision && embree.is_none() {
                continue;
            }
            if method == Method::Cache {
                let size = options.cache_size.0 as u64;
                options.memory_budget.ask(size, "the cache")?;
            }
            let cache = method.cache(options.cache_size);
            let traced = prepared.build(method, &prepared.rates, &device, &cache)?;
            let leaks = if prepared.object.surface.is_closed() && !prepared.is_tiled() {
                leaks(prepared, &traced, &triangles, options.rays)
            } else {
                0
            };
            let embree = embree
                .as_ref()
                .filter(|_| method != Method::EmbreeSubdivision);
            let references = [
                embree.map(|reference| ("embree-subdivision", reference)),
                Some(("fine-triangles", &triangles)),
            ];
            for (name, reference) in references.into_iter().flatten() {
                let now = Found {
                    leaks,
                    error: traced.error,
                    ..compare(prepared, &traced, reference, options.rays)
                };
                match found
                    .iter_mut()
                    .find(|(m, n, _)| (*m, *n) == (choice, name))
                {
                    Some((_, _, all)) => *all = all.and(now),
                    None => found.push((choice, name, now)),
                }
            }
        }
    }
    let row = |(method, reference, found): (Choice, &'static str, Found)| VerifyRow {
        method: method.name(),
        reference,
        rays: found.rays,
        only_method: found.only_method,
        only_reference: found.only_reference,
        max_distance: found.max,
        rms_distance: found.rms(),
        max_normal_degrees: found.degrees,
        leaks: found.leaks,
        max_hit_error: found.hit_error,
        achieved_error: found.error,
    };
    Ok(Verified {
        rows: found.into_iter().map(row).collect(),
        warnings,
    })
}

/// Embree's own surface, if Embree takes the mesh.
fn supported(
    prepared: &Prepared,
    rates: &Rates,
    device: &Device,
    warnings: &mut Warnings,
) -> Result<Option<Traced>> {
    let none = Method::EmbreeSubdivision.cache(CacheSize::default());
    match prepared.build(Method::EmbreeSubdivision, rates, device, &none) {
        Ok(traced) => Ok(Some(traced)),
        Err(Error::Input(fault)) => {
            warnings.add("not in Embree", || {
                format!(
                    "{}: not compared with Embree's subdivision: {fault}",
                    prepared.object.path
                )
            });
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// From a sphere around the mesh into its box.
fn ray(prepared: &Prepared, random: &mut Random) -> Ray {
    let (centre, diagonal) = (prepared.object.centre(), prepared.object.diagonal());
    let from = centre + diagonal * random.direction();
    let to = centre + 0.5 * diagonal * random.next().cbrt() * random.direction();
    Ray::new(from, (to - from).normalize_or(Vec3::X), 0.0)
}

/// Rays whose findings are summed up at once: sums are the same for any number of threads.
const TOGETHER: u64 = 1024;

/// Sends rays to both.
pub(super) fn compare(
    prepared: &Prepared,
    traced: &Traced,
    reference: &Traced,
    rays: u64,
) -> Found {
    let sums: Vec<Found> = (0..rays.div_ceil(TOGETHER))
        .into_par_iter()
        .map(|chunk| {
            let first = chunk * TOGETHER;
            (first..rays.min(first + TOGETHER))
                .map(|seed| compare_ray(prepared, traced, reference, seed))
                .fold(Found::default(), Found::and)
        })
        .collect();
    sums.into_iter().fold(Found::default(), Found::and)
}

fn compare_ray(prepared: &Prepared, traced: &Traced, reference: &Traced, seed: u64) -> Found {
    let diagonal = prepared.object.diagonal();
    let ray = ray(prepared, &mut Random::new(seed));
    let hits = [traced, reference].map(|t| t.scene.intersect(&ray));
    let mut found = Found {
        rays: 1,
        only_method: u64::from(hits[0].is_some() && hits[1].is_none()),
        only_reference: u64::from(hits[0].is_none() && hits[1].is_some()),
        ..Found::default()
    };
    let [Some(hit), Some(other)] = hits else {
        return found;
    };
    found.hit_error = f64::from(hit.error / diagonal);
    let (p, place) = (ray.at(hit.t), traced.place(&hit));
    if prepared.is_tiled() {
        let hits = [(&hit, p), (&other, ray.at(other.t))];
        return over(found, hits, reference, diagonal);
    }
    let normal = traced.smooth(place).normal;
    let probe = (normal != Vec3::ZERO)
        .then(|| reference.probe(p, normal))
        .flatten();
    let same = reference.smooth(place);
    let distances = [
        Some((hit.t - other.t).abs()),
        probe.map(|(d, _)| d),
        Some(same.position.distance(p)),
        reference.flat(place).map(|q| q.distance(p)),
    ];
    // Where a point is not a number, it is not the least either.
    let least = distances.into_iter().flatten().fold(f32::MAX, f32::min);
    let distance = f64::from(least / diagonal);
    found.measured = 1;
    found.max = distance;
    found.squares = distance * distance;
    // What faces away is another sheet, or one that has slid: then only equal parameters can tell.
    let is_near = |d: f32| d < SAME_PLACE * diagonal;
    let met = probe
        .filter(|&(d, _)| is_near(d))
        .map(|(_, hit)| reference.smooth(reference.place(&hit)).normal)
        .filter(|met| met.dot(normal) >= 0.0);
    let beside = is_near(same.position.distance(p)).then_some(same.normal);
    if let Some(other) = met.or(beside)
        && normal != Vec3::ZERO
    {
        let cos = f64::from(normal.dot(other));
        found.degrees = cos.clamp(-1.0, 1.0).acos().to_degrees();
    }
    found
}

/// What stands over a surface has no smooth surface to ask: the distance is that along the ray, or along the hit's normal.
fn over(
    mut found: Found,
    [(hit, p), (other, q)]: [(&SceneHit, Vec3); 2],
    reference: &Traced,
    diagonal: f32,
) -> Found {
    let normal = hit.normal.normalize_or_zero();
    let probe = (normal != Vec3::ZERO).then(|| reference.probe(p, normal));
    let (near, met) = match probe.flatten() {
        Some((distance, met)) if distance < p.distance(q) => (distance, met.normal),
        _ => (p.distance(q), other.normal),
    };
    let distance = f64::from(near / diagonal);
    found.measured = 1;
    found.max = distance;
    found.squares = distance * distance;
    let cos = f64::from(normal.dot(met.normalize_or_zero()));
    if near < SAME_PLACE * diagonal && cos > 0.0 {
        found.degrees = cos.min(1.0).acos().to_degrees();
    }
    found
}

/// Rays from inside of a closed mesh that meet nothing.
fn leaks(prepared: &Prepared, traced: &Traced, reference: &Traced, rays: u64) -> u64 {
    let diagonal = prepared.object.diagonal();
    let off = traced.error.map_or(0.0, |error| error.max_diagonals) as f32;
    let apart = diagonal * (2e-3 + off);
    (0..rays)
        .into_par_iter()
        .filter(|&seed| {
            let mut random = Random::new(seed);
            let ray = ray(prepared, &mut random);
            let Some(inside) = inside(&reference.scene, ray, apart) else {
                return false;
            };
            let out = Ray::new(inside, random.direction(), 0.0);
            !traced.scene.occluded(&out) && reference.scene.occluded(&out)
        })
        .count() as u64
}

/// A point within what a ray from outside meets first, with nothing so near in any of many directions.
fn inside(scene: &Scene, ray: Ray, apart: f32) -> Option<Vec3> {
    let first = scene.intersect(&ray)?;
    let beyond = Ray {
        t_min: first.t.next_up(),
        ..ray
    };
    let second = scene.intersect(&beyond)?;
    // In through one side and out through the other.
    let sides = [first, second].map(|hit| hit.normal.dot(ray.direction));
    if sides[0] * sides[1] >= 0.0 || second.t - first.t < 2.0 * apart {
        return None;
    }
    let inside = ray.at(0.5 * (first.t + second.t));
    let signs = [-1.0_f32, 0.0, 1.0];
    let mut around = signs.iter().flat_map(|&x| {
        signs
            .iter()
            .flat_map(move |&y| signs.map(|z| Vec3::new(x, y, z)))
    });
    let near = around.any(|direction| {
        let Some(direction) = direction.try_normalize() else {
            return false;
        };
        let probe = Ray {
            t_max: apart,
            ..Ray::new(inside, direction, 0.0)
        };
        scene.occluded(&probe)
    });
    (!near).then_some(inside)
}
