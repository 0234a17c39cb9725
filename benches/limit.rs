//! Limit points with first, and with first and second derivatives at random faces and parameters, one thread; with the
//! feature `opensubdiv` by OpenSubdiv's Far too, over the same faces and parameters, in the same precision.
//!
//! `cargo bench --bench limit --features opensubdiv` (Debian: libosd-dev)
#![allow(missing_docs, reason = "a benchmark")]

mod shapes;

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relievo::mesh::{ControlMesh, Scheme};
use relievo::subdiv::{LimitSurface, Real};

use shapes::{torus, twisted};

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
        ("catmull-clark regular", torus(Scheme::CatmullClark, SIDE)),
        (
            "catmull-clark irregular",
            twisted(torus(Scheme::CatmullClark, SIDE), SIDE, 4),
        ),
        ("loop regular", torus(Scheme::Loop, SIDE)),
        ("loop irregular", turned(torus(Scheme::Loop, SIDE))),
    ] {
        one::<f32>(criterion, &format!("{name} f32"), &mesh);
        one::<f64>(criterion, &format!("{name} f64"), &mesh);
    }
}

fn one<T: Number>(criterion: &mut Criterion, name: &str, mesh: &ControlMesh) {
    let surface = LimitSurface::new(mesh);
    let points = surface.points::<T>(mesh, 0);
    compare(criterion, &format!("{name} first"), mesh, |face, u, v| {
        let p = surface.first_order(&points, face, u, v);
        [p.position, p.du, p.dv]
    });
    compare(criterion, &format!("{name} second"), mesh, |face, u, v| {
        let p = surface.evaluate(&points, face, u, v);
        [p.position, p.du, p.dv, p.duu, p.duv, p.dvv]
    });
}

/// Our evaluation of a point and its derivatives, and Far's.
fn compare<T: Number, const N: usize>(
    criterion: &mut Criterion,
    name: &str,
    mesh: &ControlMesh,
    ours: impl Fn(u32, f64, f64) -> [[T; 3]; N],
) {
    let (faces, uvs) = places(mesh);
    let mut group = criterion.benchmark_group(name);
    group.throughput(Throughput::Elements(SAMPLES as u64));
    let mut out = vec![[[T::default(); 3]; N]; SAMPLES];
    group.bench_function("relievo", |bencher| {
        bencher.iter(|| {
            for ((out, &face), &[u, v]) in out.iter_mut().zip(&faces).zip(&uvs) {
                *out = ours(face, u, v);
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
        let face_numbers: Vec<i32> = faces.iter().map(|&f| f as i32).collect();
        let far_uvs: Vec<[T; 2]> = uvs.iter().map(|uv| uv.map(T::of)).collect();
        let mut theirs = vec![[[T::default(); 3]; N]; SAMPLES];
        group.bench_function("Far", |bencher| {
            bencher.iter(|| {
                far.evaluate(&face_numbers, &far_uvs, &mut theirs);
                black_box(&theirs);
            });
        });
        // What is compared must be the same; Far approximates next to extraordinary vertices. Either side may have
        // been left out by the command line.
        far.evaluate(&face_numbers, &far_uvs, &mut theirs);
        let off = |a: &[T; 3], b: &[T; 3]| (0..3).any(|i| (a[i].get() - b[i].get()).abs() > 1e-3);
        let different = theirs
            .iter()
            .zip(&faces)
            .zip(&uvs)
            .filter(|&((theirs, &face), &[u, v])| off(&ours(face, u, v)[0], &theirs[0]));
        assert_eq!(
            different.count(),
            0,
            "{name}: places at which the surfaces differ"
        );
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
fn places(mesh: &ControlMesh) -> (Vec<u32>, Vec<[f64; 2]>) {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = || {
        // Marsaglia's xorshift.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let count = mesh.face_vertex_counts.len() as f64;
    (0..SAMPLES)
        .map(|_| {
            let face = (random() * count) as u32;
            let [u, v] = [random(), random()];
            let outside = mesh.scheme == Scheme::Loop && u + v > 1.0;
            (face, if outside { [1.0 - u, 1.0 - v] } else { [u, v] })
        })
        .unzip()
}

/// Every fourth pair of triangles each way has the other diagonal: valences 5 and 7.
fn turned(mut mesh: ControlMesh) -> ControlMesh {
    for (i, pair) in (0_u32..).zip(mesh.face_vertex_indices.chunks_exact_mut(6)) {
        if shapes::is_chosen(i, SIDE, 4) {
            let [a, b, c, d] = [pair[0], pair[1], pair[2], pair[5]];
            pair.copy_from_slice(&[a, b, d, b, c, d]);
        }
    }
    mesh
}
