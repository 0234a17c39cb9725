//! What the pieces of a path cost on one thread: rays through Embree, callbacks out of it, points of the limit
//! surface, samples, scattering. `cargo bench` runs all; `cargo bench -- callback` those with that word.
//!
//! A callback's price is the difference between a ray through boxes in a row and one that misses them, divided by
//! the number of boxes.

use std::f32::consts::TAU;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, Throughput};
use relievo::accel::{Hit, Intersector};
use relievo::math::{Bounds3, Frame, Ray, Vec2, Vec3};
use relievo::mesh::ControlMesh;
use relievo::shade::bsdf::{Bsdf, SurfaceParams};
use relievo::shade::sampler::Sampler;
use relievo::trace::{
    Device, DeviceOptions, Geometry, Rates, Scene, SceneBuilder, SceneOptions, SubdivisionOptions,
};

fn main() {
    let mut criterion = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .sample_size(20)
        .configure_from_args();
    for benchmarks in [queries, callbacks, limit_points, samples, scattering] {
        benchmarks(&mut criterion);
    }
    criterion.final_summary();
}

/// Rays at a ring of 128 faces, cut into 32 x 32 quads each: from a ball around it to points near it, and
/// between points of its cage.
fn queries(c: &mut Criterion) {
    let scene = subdivided(ring(16, 8), 32.0);
    let outside = rays(|[u, v, s, t]| {
        let (from, to) = (4.0 * direction(u, v), 3.0 * direction(s, t));
        Ray::new(from, to - from, 0.0)
    });
    let between = rays(|[u, v, s, t]| {
        let (from, to) = (on_ring(u, v), on_ring(s, t));
        Ray {
            t_max: 1.0,
            ..Ray::new(from, to - from, 0.0)
        }
    });
    let mut group = c.benchmark_group("query");
    group.throughput(Throughput::Elements(outside.len() as u64));
    for (name, rays) in [("from outside", &outside), ("between points", &between)] {
        group.bench_function(format!("closest hit, {name}"), |b| {
            b.iter(|| rays.iter().filter_map(|r| scene.intersect(r)).count());
        });
        group.bench_function(format!("any hit, {name}"), |b| {
            b.iter(|| rays.iter().filter(|r| scene.occluded(r)).count());
        });
    }
}

/// Boxes in a row along x that hold nothing.
struct EmptyBoxes(u32);

impl Intersector for EmptyBoxes {
    fn primitives(&self) -> u32 {
        self.0
    }

    fn bounds(&self, p: u32, _key: u32) -> Bounds3 {
        let min = Vec3::new(2.0 * p as f32, -1.0, -1.0);
        Bounds3 {
            min,
            max: min + Vec3::new(1.0, 2.0, 2.0),
        }
    }

    fn intersect(&self, _p: u32, _ray: &Ray) -> Option<Hit> {
        None
    }

    fn memory(&self) -> usize {
        0
    }
}

fn callbacks(c: &mut Criterion) {
    let through = Ray::new(Vec3::new(-1.0, 0.1, 0.2), Vec3::X, 0.0);
    let past = Ray::new(Vec3::new(-1.0, 3.0, 0.2), Vec3::X, 0.0);
    for boxes in [1, 8, 32] {
        let device = Device::new(&DeviceOptions::default()).expect("Embree starts");
        let geometry =
            Geometry::user(&device, Arc::new(EmptyBoxes(boxes))).expect("Embree takes boxes");
        let scene = committed(&device, geometry);
        let mut group = c.benchmark_group("callback");
        for (name, ray) in [("through", &through), ("past", &past)] {
            group.bench_function(format!("closest hit, {name} {boxes}"), |b| {
                b.iter(|| scene.intersect(black_box(ray)).is_some());
            });
            group.bench_function(format!("any hit, {name} {boxes}"), |b| {
                b.iter(|| scene.occluded(black_box(ray)));
            });
        }
    }
}

fn limit_points(c: &mut Criterion) {
    let mut group = c.benchmark_group("limit point");
    for (name, mesh) in [("regular face", ring(16, 8)), ("irregular face", cube())] {
        let scene = subdivided(mesh, 4.0);
        let at = points();
        group.throughput(Throughput::Elements(at.len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                let point = |uv: &Vec2| scene.geometry(0).surface_point(0, *uv, 0.0);
                at.iter().map(|uv| point(uv).position).sum::<Vec3>()
            });
        });
    }
}

/// A path's first four sets of four dimensions, and the same from the crate without tables.
fn samples(c: &mut Criterion) {
    let mut group = c.benchmark_group("16 dimensions of a sample");
    let mut pixel = 0;
    group.bench_function("tables", |b| {
        b.iter(|| {
            pixel += 1;
            let sampler = Sampler::new([pixel, 7], 5, 0);
            [0, 1, 2, 3].map(|set| sampler.set(set))
        });
    });
    group.bench_function("bit by bit", |b| {
        b.iter(|| {
            pixel += 1;
            let seed = pixel.wrapping_mul(0x9e37_79b9);
            [0, 1, 2, 3].map(|set| sobol_burley::sample_4d(5, set, seed))
        });
    });
}

/// What a path does at a surface: look, evaluate towards a light, choose a direction.
fn scattering(c: &mut Criterion) {
    let mut group = c.benchmark_group("look, evaluate, choose");
    let layered = SurfaceParams {
        clearcoat: 0.5,
        ..SurfaceParams::default()
    };
    let diffuse = SurfaceParams::lambert(Vec3::splat(0.5));
    for (name, params) in [
        ("diffuse", diffuse),
        ("specular over diffuse", SurfaceParams::default()),
        ("coated", layered),
    ] {
        let u: Vec<_> = (0..1024)
            .map(|i| Sampler::new([i, 1], 0, 0).set(0))
            .collect();
        group.throughput(Throughput::Elements(u.len() as u64));
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let wi = Vec3::new(0.0, -0.6, 0.8);
        group.bench_function(name, |b| {
            b.iter(|| {
                let scatter = |u: &[f32; 4]| {
                    let bsdf = Bsdf::new(black_box(&params), Frame::around(Vec3::Z), Vec3::Z);
                    let view = bsdf.seen_from(wo)?;
                    let lit = view.eval(wi).total();
                    view.sample([u[0], u[1], u[2]]).map(|s| s.value + lit)
                };
                u.iter().filter_map(scatter).sum::<Vec3>()
            });
        });
    }
}

fn committed(device: &Device, geometry: Geometry) -> Scene {
    let options = SceneOptions {
        robust: true,
        compact: false,
    };
    let mut builder = SceneBuilder::new(device, options).expect("Embree makes a scene");
    builder.attach(geometry);
    builder.commit(&|_| true).expect("the scene is small")
}

fn subdivided(mesh: ControlMesh, rate: f32) -> Scene {
    let device = Device::new(&DeviceOptions::default()).expect("Embree starts");
    let options = SubdivisionOptions {
        rates: Rates::Uniform(rate),
        displacement: None,
        primvars: Vec::new(),
    };
    let geometry =
        Geometry::subdivision(&device, Arc::new(mesh), options).expect("the mesh is valid");
    committed(&device, geometry)
}

/// A point of a ring around z: once around it for u, once around its tube for v.
fn on_ring(u: f32, v: f32) -> Vec3 {
    let [(sin_u, cos_u), (sin_v, cos_v)] = [u, v].map(|x| (x * TAU).sin_cos());
    let radius = 2.0 + cos_v;
    Vec3::new(radius * cos_u, radius * sin_u, sin_v)
}

fn ring(around: u32, along: u32) -> ControlMesh {
    let at = |i: u32, j: u32| (i % around) * along + j % along;
    let faces = (0..around).flat_map(|i| (0..along).map(move |j| (i, j)));
    ControlMesh {
        face_vertex_counts: vec![4; (around * along) as usize],
        face_vertex_indices: faces
            .clone()
            .flat_map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
            .collect(),
        points: vec![
            faces
                .map(|(i, j)| on_ring(i as f32 / around as f32, j as f32 / along as f32))
                .collect(),
        ],
        ..ControlMesh::default()
    }
}

fn cube() -> ControlMesh {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    ControlMesh {
        face_vertex_counts: vec![4; 6],
        face_vertex_indices: vec![
            4, 5, 7, 6, 0, 2, 3, 1, 0, 1, 5, 4, 2, 6, 7, 3, 1, 3, 7, 5, 0, 4, 6, 2,
        ],
        points: vec![(0..8).map(corner).collect()],
        ..ControlMesh::default()
    }
}

/// The unit vector that two numbers in 0..1 stand for, even over the sphere.
fn direction(u: f32, v: f32) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let (sin, cos) = (v * TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

fn rays(of: impl Fn([f32; 4]) -> Ray) -> Vec<Ray> {
    (0..1024)
        .map(|i| of(Sampler::new([0, 0], i, 0).set(0)))
        .collect()
}

fn points() -> Vec<Vec2> {
    (0..1024)
        .map(|i| Sampler::new([0, 0], i, 1).set(0))
        .map(|[u, v, ..]| Vec2::new(u, v))
        .collect()
}
