//! The lookup for displacement: the same bits from all faces, no jumps, and bounds that hold.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::mesh::{Mesh, noise, polygons, rotated};
use proptest::prelude::*;
use relievo_ptex::{Consistent, Reader, Res};

const CHANNELS: usize = 3;

/// A mesh with turned faces, sizes of 1 to 16 texels and texels at random.
fn random(which: u32, seed: u32) -> (Mesh, Reader) {
    let size = |face, channel| (noise(seed, face, [0.1, 0.2], channel) * 5.0) as i8;
    let mesh = Mesh::new(&rotated(polygons(which), seed), |face| Res {
        ulog2: size(face, 0),
        vlog2: size(face, 1),
    });
    let reader = mesh.reader(CHANNELS, |face, at, channel| {
        noise(seed, face, at, channel) * 4.0 - 2.0
    });
    (mesh, reader)
}

fn eval(consistent: &Consistent, reader: &Reader, face: u32, [u, v]: [f32; 2]) -> [f32; CHANNELS] {
    let mut out = [f32::NAN; CHANNELS];
    consistent.eval(reader, face, u, v, 0, &mut out).unwrap();
    out
}

/// A point of an edge, counter-clockwise.
fn on_edge(edge: usize, t: f32) -> [f32; 2] {
    [[t, 0.0], [1.0, t], [1.0 - t, 1.0], [0.0, 1.0 - t]][edge]
}

fn bits(value: [f32; CHANNELS]) -> [u32; CHANNELS] {
    value.map(f32::to_bits)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn edges_have_the_same_bits_from_both_sides(
        which: u32, seed: u32, level in 0..3_u8, t in prop_oneof![0.0..1.0_f32, 0.0..0.01_f32, Just(0.5), Just(0.0)],
    ) {
        let (mesh, reader) = random(which, seed);
        let consistent = Consistent::new(&reader, level, false).unwrap();
        // Between faces and sub-faces only as many digits are common.
        let coarse = (t * 8_388_608.0).round() / 8_388_608.0;
        for (face, info) in (0..).zip(&mesh.faces) {
            for edge in 0..4 {
                let Some(next) = info.neighbours[edge] else { continue };
                let other = &mesh.faces[next.face as usize];
                let [here, there] = if info.subface == other.subface {
                    [(edge, t), (usize::from(next.edge), 1.0 - t)]
                } else if info.subface {
                    // The first of two sub-faces is the one that the face names.
                    let first = other.neighbours[usize::from(next.edge)].unwrap().face == face;
                    let on = if first { 0.5 * (1.0 - coarse) } else { 1.0 - 0.5 * coarse };
                    [(edge, coarse), (usize::from(next.edge), on)]
                } else {
                    continue;
                };
                let here = eval(&consistent, &reader, face, on_edge(here.0, here.1));
                let there = eval(&consistent, &reader, next.face, on_edge(there.0, there.1));
                prop_assert_eq!(bits(here), bits(there), "face {} edge {}, {} {}", face, edge, t, coarse);
            }
        }
    }

    #[test]
    fn vertices_have_the_same_bits_from_all_faces(which: u32, seed: u32) {
        let (mesh, reader) = random(which, seed);
        let consistent = Consistent::new(&reader, 0, false).unwrap();
        let mut all: Vec<_> = (0..)
            .zip(&mesh.points)
            .flat_map(|(face, points)| (0..4).map(move |k| (points[k], face, k)))
            .map(|(point, face, k)| (point, bits(eval(&consistent, &reader, face, on_edge(k, 0.0))), face))
            .collect();
        all.sort();
        for pair in all.windows(2) {
            if pair[0].0 == pair[1].0 {
                prop_assert_eq!(pair[0].1, pair[1].1, "{:?}", pair);
            }
        }
    }

    /// No step is higher than the steepest slope allows: differences of texels (up to 4) within half a texel, and in
    /// corners, where two slopes meet, some times that.
    #[test]
    fn nothing_jumps(which: u32, seed: u32, from in prop::array::uniform2(0.0..1.0_f32), edge in 0..4_usize) {
        const STEPS: u32 = 200;
        let (mesh, reader) = random(which, seed);
        let consistent = Consistent::new(&reader, 0, false).unwrap();
        for face in 0..mesh.faces.len() as u32 {
            let to = on_edge(edge, from[0]);
            let mut before = eval(&consistent, &reader, face, from);
            for i in 1..=STEPS {
                let s = i as f32 / STEPS as f32;
                let at = [0, 1].map(|k| if i == STEPS { to[k] } else { from[k] + (to[k] - from[k]) * s });
                let value = eval(&consistent, &reader, face, at);
                for (a, b) in value.iter().zip(before) {
                    prop_assert!((a - b).abs() < 4.0 * 2.0 * 32.0 * 4.0 / STEPS as f32, "{:?}", at);
                }
                before = value;
            }
        }
        // Close to an edge, up to the edge.
        for face in 0..mesh.faces.len() as u32 {
            let to = on_edge(edge, from[0]);
            let close = [0, 1].map(|k| to[k] + (from[k] - to[k]) * 1e-6);
            let (on, off) = (eval(&consistent, &reader, face, to), eval(&consistent, &reader, face, close));
            for (a, b) in on.iter().zip(off) {
                prop_assert!((a - b).abs() < 2e-3, "{:?} {:?} {:?}", close, on, off);
            }
        }
    }

    #[test]
    fn bounds_hold(
        which: u32, seed: u32, finest in 0..4_u8, level in 0..2_u8,
        a in prop::array::uniform2(0.0..1.0_f32), b in prop::array::uniform2(0.0..1.0_f32),
    ) {
        let (mesh, reader) = random(which, seed);
        let consistent = Consistent::new(&reader, level, false).unwrap();
        for face in 0..mesh.faces.len() as u32 {
            let bounds = consistent.bounds(&reader, face, 1, 2, finest).unwrap();
            let [u, v] = [0, 1].map(|k| [a[k].min(b[k]), a[k].max(b[k])]);
            for i in 0..=8 {
                for j in 0..=8 {
                    let at = [(u, i), (v, j)].map(|(x, i)| (x[0] + (x[1] - x[0]) * (i as f32 / 8.0)).clamp(x[0], x[1]));
                    let value = eval(&consistent, &reader, face, at);
                    for channel in 0..2 {
                        let [low, high] = bounds.range(u, v, channel);
                        let value = value[channel + 1];
                        prop_assert!(low <= value && value <= high, "{:?} is not within {} and {}", value, low, high);
                        let [low, high] = bounds.whole(channel);
                        prop_assert!(low <= value && value <= high);
                    }
                }
            }
        }
    }
}

/// Faces of a plane, side by side.
fn plane(columns: u32, rows: u32) -> Vec<Vec<u32>> {
    let vertex = |x, y| y * (columns + 1) + x;
    (0..rows)
        .flat_map(|y| (0..columns).map(move |x| (x, y)))
        .map(|(x, y)| {
            vec![
                vertex(x, y),
                vertex(x + 1, y),
                vertex(x + 1, y + 1),
                vertex(x, y + 1),
            ]
        })
        .collect()
}

#[test]
fn slopes_are_kept_where_sizes_match() {
    // Columns of 4, 16 and 2 texels: the edge between two columns divides the distance as their middles do.
    let mesh = Mesh::new(&plane(3, 3), |face| Res {
        ulog2: [2, 4, 1][face as usize % 3],
        vlog2: 2,
    });
    let place = |face: u32, at: [f32; 2]| [(face % 3) as f32 + at[0], (face / 3) as f32 + at[1]];
    let reader = mesh.reader(2, |face, at, channel| place(face, at)[channel]);
    let consistent = Consistent::new(&reader, 0, false).unwrap();
    let mut out = [0.0; 2];
    for i in 0..=32 {
        for j in 0..=32 {
            let at = [i, j].map(|i| i as f32 / 32.0);
            consistent
                .eval(&reader, 4, at[0], at[1], 0, &mut out)
                .unwrap();
            let wanted = place(4, at);
            assert!(
                out.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5),
                "{at:?}: {out:?} for {wanted:?}"
            );
        }
    }
}

#[test]
fn bounds_are_close_inside() {
    let mesh = Mesh::new(&plane(1, 1), |_| Res { ulog2: 6, vlog2: 6 });
    let reader = mesh.reader(1, |_, at, _| at[0]);
    let consistent = Consistent::new(&reader, 0, false).unwrap();
    let bounds = consistent.bounds(&reader, 0, 0, 1, 0).unwrap();
    let [low, high] = bounds.range([0.5, 0.51], [0.3, 0.31], 0);
    assert!(low > 0.45 && high < 0.55, "{low} {high}");
    let [low, high] = bounds.whole(0);
    assert!(low > 0.007 && high < 0.993, "{low} {high}");
    assert!(bounds.memory() <= 8 * 64 * 64 * 3 / 2);
}

#[test]
fn whoever_is_not_named_has_a_border() {
    let mut mesh = Mesh::new(&plane(2, 1), |_| Res { ulog2: 2, vlog2: 2 });
    mesh.faces[1].neighbours = [None; 4];
    let reader = mesh.reader(1, |face, _, _| face as f32);
    let consistent = Consistent::new(&reader, 0, false).unwrap();
    let mut out = [0.5];
    consistent.eval(&reader, 0, 1.0, 0.5, 0, &mut out).unwrap();
    assert_eq!(out, [0.0]);
    consistent.eval(&reader, 1, 0.0, 0.5, 0, &mut out).unwrap();
    assert_eq!(out, [1.0]);
}

#[test]
fn what_cannot_be_is_an_error() {
    let mesh = Mesh::new(&plane(2, 1), |_| Res { ulog2: 2, vlog2: 2 });
    let reader = mesh.reader(1, |face, _, _| face as f32);
    let other = Mesh::new(&plane(1, 1), |_| Res { ulog2: 2, vlog2: 2 }).reader(1, |_, _, _| 0.0);
    let consistent = Consistent::new(&reader, 0, false).unwrap();
    let mut out = [0.0; 2];
    for (reader, face, u, count) in [
        (&reader, 2, 0.5, 1),
        (&reader, 0, f32::NAN, 1),
        (&reader, 0, 0.5, 2),
        (&other, 0, 0.5, 1),
    ] {
        let result = consistent.eval(reader, face, u, 0.5, 0, &mut out[..count]);
        assert!(result.is_err(), "{face} {u} {count}");
    }
}
