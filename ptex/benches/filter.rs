//! Lookups per second, with all texels in the cache: `cargo bench -p relievo-ptex --bench filter`.
//!
//! The file is a torus of faces of 16 to 512 texels a side, three channels of bytes. Lookups are everywhere, from a
//! 256th to a 16th of a face wide.
#![allow(missing_docs, reason = "criterion's macros make items without docs")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relievo_ptex::{
    Cache, Consistent, DataType, FaceInfo, Filter, FilterKind, Format, MeshType, Neighbour, Reader,
    Res, Writer,
};
use std::hint::black_box;

/// Faces around the torus, either way.
const ACROSS: u32 = 12;
const LOOKUPS: usize = 10_000;

fn torus() -> Reader {
    let at = |x: u32, y: u32| (y % ACROSS) * ACROSS + x % ACROSS;
    let mut random = random();
    let format = Format::new(MeshType::Quad, DataType::U8, 3);
    let mut writer = Writer::new(format, ACROSS * ACROSS).expect("a torus is a mesh");
    for face in 0..ACROSS * ACROSS {
        let (x, y) = (face % ACROSS, face / ACROSS);
        let beyond = [
            (x, y + ACROSS - 1),
            (x + 1, y),
            (x, y + 1),
            (x + ACROSS - 1, y),
        ];
        let mut size = || 4 + (random() * 6.0) as i8;
        let res = Res {
            ulog2: size(),
            vlog2: size(),
        };
        let info = FaceInfo {
            res,
            neighbours: std::array::from_fn(|edge| {
                let (x, y) = beyond[edge];
                Some(Neighbour {
                    face: at(x, y),
                    edge: (edge as u8 + 2) % 4,
                })
            }),
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: false,
        };
        let texels: Vec<u8> = (0..3_usize << (res.ulog2 + res.vlog2))
            .map(|_| (random() * 255.0) as u8)
            .collect();
        writer.face(face, &info, &texels).expect("the texels fit");
    }
    let bytes = writer.bytes().expect("the file can be made");
    Reader::from_bytes(bytes, "torus", &Cache::default()).expect("the file can be read")
}

/// Numbers from 0 to 1, always the same.
fn random() -> impl FnMut() -> f32 {
    let mut state = 1_u64;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 40) as f32 / (1 << 24) as f32
    }
}

fn lookups(criterion: &mut Criterion) {
    let reader = torus();
    let mut random = random();
    let places: Vec<(u32, [f32; 2], [f32; 4])> = (0..LOOKUPS)
        .map(|_| {
            let face = (random() * (ACROSS * ACROSS) as f32) as u32;
            let place = [random(), random()];
            let mut width = || (-8.0 + 4.0 * random()).exp2();
            (face, place, [width(), 0.0, 0.0, width()])
        })
        .collect();
    let mut group = criterion.benchmark_group("lookups");
    group.throughput(Throughput::Elements(LOOKUPS as u64));
    for (name, kind) in FilterKind::NAMES {
        let filter = Filter::new(kind);
        let mut out = [0.0; 3];
        group.bench_function(name, |bench| {
            bench.iter(|| {
                for (face, [u, v], w) in &places {
                    filter
                        .eval(&reader, *face, *u, *v, *w, 0, false, &mut out)
                        .expect("the lookup is possible");
                    black_box(&out);
                }
            });
        });
    }
    let consistent = Consistent::new(&reader, 0, false).expect("the mesh is of quads");
    let mut out = [0.0; 3];
    group.bench_function("consistent", |bench| {
        bench.iter(|| {
            for (face, [u, v], _) in &places {
                consistent
                    .eval(&reader, *face, *u, *v, 0, &mut out)
                    .expect("the lookup is possible");
                black_box(&out);
            }
        });
    });
    group.finish();
}

criterion_group!(benches, lookups);
criterion_main!(benches);
