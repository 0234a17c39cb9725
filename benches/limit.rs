//! Limit points with first derivatives at random faces and parameters, one thread; with the feature `opensubdiv` by
//! OpenSubdiv's Far too, over the same faces and parameters.
//!
//! `cargo bench --bench limit --features opensubdiv` (Debian: libosd-dev)
#![allow(missing_docs, reason = "a benchmark")]

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relievo::math::Vec3;
use relievo::mesh::{ControlMesh, Scheme};
use relievo::subdiv::{LimitSurface, Real};

const SIDE: u32 = 64;
const SAMPLES: usize = 1 << 14;

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .without_plots();
    targets = limits
}
criterion_main!(benches);

fn limits(criterion: &mut Criterion) {
    for (name, mesh) in [
        ("catmull-clark regular", torus(Scheme::CatmullClark)),
        (
            "catmull-clark irregular",
            twisted(torus(Scheme::CatmullClark)),
        ),
        ("loop regular", torus(Scheme::Loop)),
        ("loop irregular", turned(torus(Scheme::Loop))),
    ] {
        one::<f32>(criterion, &format!("{name} f32"), &mesh);
        one::<f64>(criterion, &format!("{name} f64"), &mesh);
    }
}

fn one<T: Number>(criterion: &mut Criterion, name: &str, mesh: &ControlMesh) {
    let surface = LimitSurface::new(mesh);
    let points = surface.points::<T>(mesh, 0);
    let (faces, uvs) = places(&surface);
    let mut group = criterion.benchmark_group(name);
    group.throughput(Throughput::Elements(SAMPLES as u64));
    let mut out = vec![[[T::default(); 3]; 3]; SAMPLES];
    group.bench_function("relievo", |bencher| {
        bencher.iter(|| {
            for ((out, &face), &[u, v]) in out.iter_mut().zip(&faces).zip(&uvs) {
                let p = surface.first_order(&points, face, u, v);
                *out = [p.position, p.du, p.dv];
            }
            black_box(&out);
        });
    });
    #[cfg(feature = "opensubdiv")]
    {
        let positions: Vec<[f32; 3]> = mesh.points[0].iter().map(|p| p.to_array()).collect();
        let triangles = mesh.scheme == Scheme::Loop;
        // The level to which irregular faces are refined, as deep as our plans.
        let far =
            opensubdiv_sys::Far::<T>::new(triangles, &mesh.face_vertex_indices, &positions, 5);
        let faces: Vec<i32> = faces.iter().map(|&f| f as i32).collect();
        let uvs: Vec<[T; 2]> = uvs.iter().map(|uv| uv.map(T::of)).collect();
        let mut theirs = vec![[[T::default(); 3]; 3]; SAMPLES];
        group.bench_function("Far", |bencher| {
            bencher.iter(|| {
                far.evaluate(&faces, &uvs, &mut theirs);
                black_box(&theirs);
            });
        });
        // What is compared must be the same; Far approximates next to extraordinary vertices.
        let off = |a: &[[T; 3]; 3], b: &[[T; 3]; 3]| {
            (0..3).any(|i| (a[0][i].get() - b[0][i].get()).abs() > 1e-3)
        };
        let different = out.iter().zip(&theirs).filter(|(a, b)| off(a, b)).count();
        assert_eq!(different, 0, "{name}: places at which the surfaces differ");
    }
    group.finish();
}

#[cfg(not(feature = "opensubdiv"))]
use Real as Number;

#[cfg(feature = "opensubdiv")]
trait Number: Real + opensubdiv_sys::Real {}
#[cfg(feature = "opensubdiv")]
impl<T: Real + opensubdiv_sys::Real> Number for T {}

/// Random faces and parameters, the same each time.
fn places(surface: &LimitSurface) -> (Vec<u32>, Vec<[f64; 2]>) {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = || {
        // Marsaglia's xorshift.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let count = surface.face_count() as f64;
    (0..SAMPLES)
        .map(|_| {
            let face = (random() * count) as u32;
            let [u, v] = [random(), random()];
            let outside = surface.is_triangular() && u + v > 1.0;
            (face, if outside { [1.0 - u, 1.0 - v] } else { [u, v] })
        })
        .unzip()
}

/// A wavy torus: all vertices are regular.
fn torus(scheme: Scheme) -> ControlMesh {
    let tau = std::f32::consts::TAU;
    let point = |i: u32| {
        let [a, b] = [i % SIDE, i / SIDE].map(|k| tau * k as f32 / SIDE as f32);
        let r = 3.0 + b.cos() + 0.1 * (5.0 * a + 3.0 * b).sin();
        Vec3::new(r * a.cos(), r * a.sin(), b.sin())
    };
    let mut faces: Vec<u32> = Vec::new();
    for y in 0..SIDE {
        for x in 0..SIDE {
            let at = |dx: u32, dy: u32| (y + dy) % SIDE * SIDE + (x + dx) % SIDE;
            let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
            match scheme {
                Scheme::Loop => faces.extend([a, b, c, a, c, d]),
                _ => faces.extend([a, b, c, d]),
            }
        }
    }
    let sides = if scheme == Scheme::Loop { 3 } else { 4 };
    ControlMesh {
        scheme,
        face_vertex_counts: vec![sides; faces.len() / sides as usize],
        face_vertex_indices: faces,
        points: vec![(0..SIDE * SIDE).map(point).collect()],
        ..ControlMesh::default()
    }
}

/// Every fourth place each way.
fn is_chosen(place: u32) -> bool {
    (place % SIDE).is_multiple_of(4) && (place / SIDE).is_multiple_of(4)
}

/// Every fourth quad each way has another within it: eight vertices, four of valence 3 and four of 5.
fn twisted(mut mesh: ControlMesh) -> ControlMesh {
    let mut faces: Vec<u32> = Vec::new();
    for (i, quad) in (0_u32..).zip(mesh.face_vertex_indices.chunks_exact(4)) {
        if !is_chosen(i) {
            faces.extend(quad);
            continue;
        }
        let points = &mut mesh.points[0];
        let first = points.len() as u32;
        let centre = quad.iter().map(|&v| points[v as usize]).sum::<Vec3>() / 4.0;
        points.extend([0, 1, 2, 3].map(|k| points[quad[k] as usize].lerp(centre, 0.5)));
        for k in 0..4 {
            let next = (k + 1) % 4;
            faces.extend([quad[k], quad[next], first + next as u32, first + k as u32]);
        }
        faces.extend([first, first + 1, first + 2, first + 3]);
    }
    mesh.face_vertex_counts = vec![4; faces.len() / 4];
    mesh.face_vertex_indices = faces;
    mesh
}

/// Every fourth pair of triangles each way has the other diagonal: valences 5 and 7.
fn turned(mut mesh: ControlMesh) -> ControlMesh {
    for (i, pair) in (0_u32..).zip(mesh.face_vertex_indices.chunks_exact_mut(6)) {
        if is_chosen(i) {
            let [a, b, c, d] = [pair[0], pair[1], pair[2], pair[5]];
            pair.copy_from_slice(&[a, b, d, b, c, d]);
        }
    }
    mesh
}
