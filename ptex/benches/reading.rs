//! What reading costs on one thread: opening a file of many faces, texels that are at hand, texels that are not.
//! `cargo bench -p relievo-ptex -- open` runs those with that word.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput};
use relievo_ptex::{Cache, DataType, FaceInfo, Format, MeshType, Neighbour, Reader, Res, Writer};

fn main() {
    let mut criterion = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .sample_size(20)
        .configure_from_args();
    for benchmarks in [opening, warm, cold] {
        benchmarks(&mut criterion);
    }
    criterion.final_summary();
}

/// Columns and rows of the faces of a mesh that is a torus.
type Size = [u32; 2];

/// A file of faces of 2^`log2`(face) texels on a side.
fn file([columns, rows]: Size, log2: impl Fn(u32) -> i8) -> Vec<u8> {
    let format = Format::new(MeshType::Quad, DataType::U8, 3);
    let mut writer = Writer::new(format, columns * rows).expect("a file");
    for face in 0..columns * rows {
        let (x, y) = (face % columns, face / columns);
        let at = |x: u32, y: u32, edge| {
            let face = y % rows * columns + x % columns;
            Some(Neighbour { face, edge })
        };
        let size = log2(face);
        let info = FaceInfo {
            res: Res {
                ulog2: size,
                vlog2: size,
            },
            neighbours: [
                at(x, y + rows - 1, 2),
                at(x + 1, y, 3),
                at(x, y + 1, 0),
                at(x + columns - 1, y, 1),
            ],
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: false,
        };
        let texels: Vec<u8> = (0..3_u32 << (2 * size))
            .map(|n| ((n * 37 + face * 11) % 251) as u8)
            .collect();
        writer.face(face, &info, &texels).expect("a face");
    }
    writer.bytes().expect("a file")
}

/// 100,000 faces, as a production mesh may have: in a file, so that the system's part is in.
fn opening(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("many.ptx");
    std::fs::write(&path, file([400, 250], |face| (face % 4) as i8)).expect("written");
    c.bench_function("open 100,000 faces", |b| {
        b.iter(|| Reader::open(&path, &Cache::default()).expect("a file"));
    });
}

/// Everything is loaded: finding texels, and summing 4 x 4 of them, on faces at random.
fn warm(c: &mut Criterion) {
    let bytes = file([32, 32], |face| 3 + (face % 4) as i8);
    let reader = Reader::from_bytes(bytes, "mixed.ptx", &Cache::default()).expect("a file");
    let places: Vec<(u32, Res)> = (0..4096_u32)
        .map(|i| {
            let face = i.wrapping_mul(0x9e37_79b9) >> 22;
            let full = reader.face(face).res;
            let res = Res {
                ulog2: full.ulog2 - (i % 2) as i8,
                vlog2: full.vlog2 - (i / 2 % 2) as i8,
            };
            (face, res)
        })
        .collect();
    let mut group = c.benchmark_group("warm");
    group.throughput(Throughput::Elements(places.len() as u64));
    group.bench_function("texels of a face", |b| {
        b.iter(|| {
            for (face, res) in &places {
                black_box(reader.texels(*face, *res, false).expect("texels"));
            }
        });
    });
    group.bench_function("sums of 4 x 4 texels of 3 channels", |b| {
        let weights = [0.1, 0.4, 0.4, 0.1];
        b.iter(|| {
            let mut sums = [0.0; 3];
            for (face, res) in &places {
                let texels = reader.texels(*face, *res, false).expect("texels");
                texels
                    .add_weighted(0, 0, &weights, &weights, 1.0, 0, &mut sums)
                    .expect("texels");
            }
            sums
        });
    });
}

/// Nothing is kept: each face is read and expanded.
fn cold(c: &mut Criterion) {
    let bytes = file([16, 16], |_| 6);
    let reader = Reader::from_bytes(bytes, "cold.ptx", &Cache::new(0)).expect("a file");
    let mut group = c.benchmark_group("cold");
    group.throughput(Throughput::Bytes(256 * 3 * (1 << 12)));
    group.bench_function("256 faces of 64 x 64 texels", |b| {
        b.iter(|| {
            for face in 0..256 {
                black_box(
                    reader
                        .texels(face, reader.face(face).res, false)
                        .expect("texels"),
                );
            }
        });
    });
}
