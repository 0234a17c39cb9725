//! Dicing of a closed surface of regular patches, per micro-vertex; and the time from a cage of 100,000 faces to the
//! first ray: `cargo bench --bench dice`.
#![allow(missing_docs, reason = "criterion's macros make items without docs")]

mod shapes;

use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use relievo::accel::Tessellated;
use relievo::image::{ColorSpace, ImageSource, Texture, Wrap, write_png};
use relievo::math::{Bounds3, Ray, Vec2, Vec3, Vec4};
use relievo::mesh::{ControlMesh, Scheme};
use relievo::surface::{
    Amount, Base, Bicubic, Channels, Diced, Displacement, EdgeUse, ImageMap, LimitGrid, LimitPoint,
    Rates, Space, Subdivision, Surface, Texcoord, TexcoordGrid, UvRect,
};
use relievo::trace::{Device, DeviceOptions, Geometry, Scene, SceneBuilder, SceneOptions};

/// A torus of `SIDE` by `SIDE` uniform bicubic B-spline patches.
struct Torus(Vec<Bicubic>);

const SIDE: u32 = 64;

impl Torus {
    fn new() -> Self {
        let control = |i: u32, j: u32| {
            let turn = |i: u32| ((i % SIDE) as f32 / SIDE as f32 * std::f32::consts::TAU).sin_cos();
            let ((s, c), (t, d)) = (turn(i), turn(j));
            Vec3::new((1.0 + 0.4 * d) * c, (1.0 + 0.4 * d) * s, 0.4 * t)
        };
        // From B-spline to Bezier control points.
        let bezier = |p: [Vec3; 4]| {
            let inner = [(2.0 * p[1] + p[2]) / 3.0, (p[1] + 2.0 * p[2]) / 3.0];
            let end = |a: Vec3, b: Vec3, c: Vec3| (a + 4.0 * b + c) / 6.0;
            [
                end(p[0], p[1], p[2]),
                inner[0],
                inner[1],
                end(p[1], p[2], p[3]),
            ]
        };
        let patches = (0..SIDE * SIDE).map(|face| {
            let (i, j) = (face % SIDE, face / SIDE);
            let rows: [[Vec3; 4]; 4] = std::array::from_fn(|r| {
                bezier(std::array::from_fn(|c| control(i + c as u32, j + r as u32)))
            });
            let columns: [[Vec3; 4]; 4] =
                std::array::from_fn(|c| bezier(std::array::from_fn(|r| rows[r][c])));
            Bicubic(std::array::from_fn(|i| columns[i % 4][i / 4]))
        });
        Self(patches.collect())
    }
}

impl Base for Torus {
    fn faces(&self) -> u32 {
        SIDE * SIDE
    }
    fn edge(&self, face: u32, k: u32) -> EdgeUse {
        let (i, j) = (face % SIDE, face / SIDE);
        let edge = match k {
            0 => face,
            1 => SIDE * SIDE + (i + 1) % SIDE + j * SIDE,
            2 => i + (j + 1) % SIDE * SIDE,
            _ => SIDE * SIDE + face,
        };
        EdgeUse {
            edge,
            reversed: k > 1,
        }
    }
    fn vertex(&self, face: u32, k: u32) -> u32 {
        let (i, j) = (face % SIDE, face / SIDE);
        let (right, up) = (u32::from(k == 1 || k == 2), u32::from(k > 1));
        (i + right) % SIDE + (j + up) % SIDE * SIDE
    }
    fn evaluate(&self, face: u32, uv: Vec2, _key: u32) -> LimitPoint {
        self.0[face as usize].evaluate(uv)
    }
    fn evaluate_grid(&self, face: u32, us: &[f32], vs: &[f32], _key: u32, out: &mut LimitGrid) {
        self.0[face as usize].grid::<true>(us, vs, out);
    }
    fn hull(&self, face: u32, rect: &UvRect, _key: u32) -> Bounds3 {
        self.0[face as usize].hull(rect)
    }
    fn bezier(&self, face: u32, rect: &UvRect, _key: u32) -> Option<Bicubic> {
        Some(self.0[face as usize].restricted(rect))
    }
    fn texcoord(&self, face: u32, uv: Vec2) -> Option<Texcoord> {
        let corner = Vec2::new((face % SIDE) as f32, (face / SIDE) as f32);
        Some(Texcoord {
            st: (corner + uv) / SIDE as f32,
            du: Vec2::X / SIDE as f32,
            dv: Vec2::Y / SIDE as f32,
            ..Texcoord::default()
        })
    }
    fn texcoord_grid(
        &self,
        face: u32,
        us: &[f32],
        vs: &[f32],
        slopes: bool,
        out: &mut TexcoordGrid,
    ) -> bool {
        let corner = Vec2::new((face % SIDE) as f32, (face / SIDE) as f32);
        out.clear();
        for &v in vs {
            let row = us.iter().map(|&u| (corner + Vec2::new(u, v)) / SIDE as f32);
            out.st.extend(row);
        }
        if slopes {
            out.du.resize(out.st.len(), Vec2::X / SIDE as f32);
            out.dv.resize(out.st.len(), Vec2::Y / SIDE as f32);
        }
        true
    }
    fn memory(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

/// An 8-bit image of 2048 by 2048 bumps.
fn heights() -> Texture {
    const SIZE: u32 = 2048;
    let pixels: Vec<Vec4> = (0..SIZE * SIZE)
        .map(|i| {
            let (x, y) = ((i % SIZE) as f32 * 0.05, (i / SIZE) as f32 * 0.07);
            Vec3::new(0.5 + 0.5 * x.sin() * y.cos(), x.fract(), y.fract()).extend(1.0)
        })
        .collect();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("heights.png");
    write_png(&path, SIZE, SIZE, &pixels).expect("written");
    let source = ImageSource::File(path);
    Texture::load(&source, [Wrap::Repeat; 2], ColorSpace::Raw).expect("loaded")
}

fn dice(c: &mut Criterion) {
    let mut group = c.benchmark_group("dice");
    group.sample_size(10);
    let texture = Arc::new(heights());
    let image = |channels| Amount {
        map: Arc::new(ImageMap::new(Arc::clone(&texture), channels)),
        scale: 0.02,
        bias: 0.0,
    };
    for (name, displacement) in [
        ("none", Displacement::None),
        ("scalar", Displacement::Scalar(image(Channels::Scalar))),
        (
            "vector",
            Displacement::Vector(image(Channels::Vector), Space::Object),
        ),
        (
            "tangent",
            Displacement::Vector(image(Channels::Vector), Space::Tangent),
        ),
    ] {
        let surface = Surface::new(Arc::new(Torus::new()), displacement);
        for segments in [8, 16, 32] {
            let rates = Rates::uniform(&surface, segments);
            group.throughput(Throughput::Elements(rates.micro_vertices()));
            group.bench_function(BenchmarkId::new(name, segments), |b| {
                b.iter(|| Diced::new(&surface, &rates));
            });
        }
    }
    group.finish();
}

/// From a loaded cage, a torus of which some faces hold extraordinary vertices, to the first hit: limit surface, dicing
/// at four segments an edge, the scene, one ray. All that is held is freed beyond the time taken.
fn first_ray(c: &mut Criterion) {
    const CAGE_SIDE: u32 = 314;
    let cage = shapes::torus(Scheme::CatmullClark, CAGE_SIDE);
    let cage = shapes::twisted(cage, CAGE_SIDE, 16);
    let faces = cage.face_vertex_counts.len();
    let mut group = c.benchmark_group(format!("first ray, {faces} faces"));
    group.sample_size(10);
    group.bench_function("tessellated", |b| {
        b.iter_with_large_drop(|| {
            traced(&cage, |device, diced| {
                let tree = Tessellated::build(Arc::new(diced));
                Geometry::user(device, Arc::new(tree)).expect("Embree takes a tree")
            })
        });
    });
    group.bench_function("embree-triangles", |b| {
        b.iter_with_large_drop(|| {
            traced(&cage, |device, diced| {
                Geometry::diced_triangles(device, &diced).expect("Embree takes triangles")
            })
        });
    });
    group.finish();
}

fn traced(cage: &ControlMesh, geometry: impl Fn(&Device, Diced) -> Geometry) -> (Surface, Scene) {
    let base = Subdivision::new(cage, None);
    let surface = Surface::new(Arc::new(base), Displacement::None);
    let diced = Diced::new(&surface, &Rates::uniform(&surface, 4));
    let device = Device::new(&DeviceOptions::default()).expect("Embree starts");
    let options = SceneOptions {
        robust: true,
        compact: false,
    };
    let mut builder = SceneBuilder::new(&device, options).expect("Embree makes a scene");
    builder.attach(geometry(&device, diced));
    let scene = builder.commit(&|_| true).expect("the scene is small");
    let ray = Ray::new(Vec3::new(3.0, 0.1, 9.0), Vec3::NEG_Z, 0.0);
    assert!(scene.intersect(&ray).is_some(), "the ray meets the torus");
    (surface, scene)
}

criterion_group!(benches, dice, first_ray);
criterion_main!(benches);
