//! How many texels faces get: by the size of the faces and of the dense mesh's triangles on them.

use rayon::prelude::*;
use relievo_ptex::{MeshType, Res};

use super::along_normal::{self, Facing, Line};
use super::{Cage, Dense, Run};
use crate::convert::{CENTROID, MOST_AT_ONCE, MOST_OF_FILE, admit, in_triangle, log2};
use crate::error::{Fault, Result};

/// How many texels a face gets: powers of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sizes {
    /// Two to this power along u and v, for all.
    Log2(i8),
    /// At least so many along u and v for each edge of the dense mesh over the face: 1 keeps what the mesh has.
    PerEdge(f64),
}

/// Lines along u, and along v, by which a face is looked over.
const PROBES: usize = 4;
/// The most texels of a face along u or v that are chosen, as a power of two.
const MOST_CHOSEN: i8 = 12;

/// What a first look at the dense mesh tells.
pub(super) struct Probed {
    /// Which way the dense mesh faces as a whole.
    pub(super) facing: Facing,
    /// By Ptex face: the middle length of the dense mesh's edges there, as seen along the normal.
    edges: Vec<Option<f64>>,
    /// That of all faces.
    usual: Option<f64>,
}

/// Looks along a few normals of each face. The dense mesh faces the other way than the cage only if more of them meet
/// nothing that faces the same way, but something that does not: walls have both, each on its side.
///
/// # Errors
/// If interrupted.
pub(super) fn probe(cage: &Cage, dense: &Dense, reach: f64, run: Run<'_>) -> Result<Probed> {
    run.progress.stage("probe", cage.faces().len() as u64);
    let length = |line: &Line, facing: Facing| {
        let hit = along_normal::closest(dense, line, reach, facing).ok()?;
        Some(hit.across.dot(line.normal).abs().sqrt())
    };
    // What faces the same way, and what does not.
    let looks: Vec<Vec<[Option<f64>; 2]>> = (0..cage.faces().len() as u32)
        .into_par_iter()
        .map(|ptex| {
            if !run.goes_on() {
                return Vec::new();
            }
            let places = (0..PROBES).flat_map(|y| (0..PROBES).map(move |x| [x, y]));
            let lines =
                places.filter_map(|at| cage.line(ptex, middle(cage.kind(), at, [PROBES; 2])));
            let looks =
                lines.map(|line| [Facing::Same, Facing::Opposite].map(|f| length(&line, f)));
            let looks = looks.collect();
            run.progress.by(1);
            looks
        })
        .collect();
    run.check()?;
    let met = |side: usize| looks.iter().flatten().filter(|l| l[side].is_some()).count();
    let (facing, side) = match met(0) >= met(1) {
        true => (Facing::Same, 0),
        false => (Facing::Opposite, 1),
    };
    let lengths = |looks: &Vec<[Option<f64>; 2]>| looks.iter().filter_map(|l| l[side]).collect();
    let lengths: Vec<Vec<f64>> = looks.iter().map(lengths).collect();
    Ok(Probed {
        facing,
        usual: median(lengths.concat()),
        edges: lengths.into_iter().map(median).collect(),
    })
}

fn median(mut lengths: Vec<f64>) -> Option<f64> {
    lengths.retain(|length| *length > 0.0);
    lengths.sort_by(f64::total_cmp);
    lengths.get(lengths.len() / 2).copied()
}

/// The middle length of the dense mesh's edges on a Ptex face, or on all where none is known there.
pub(super) fn edge(probed: &Probed, ptex: u32) -> Option<f64> {
    probed.edges[ptex as usize].or(probed.usual)
}

/// The middle of texel `at` of `size` texels of a Ptex face.
pub(super) fn middle(kind: MeshType, at: [usize; 2], size: [usize; 2]) -> [f64; 2] {
    match kind {
        MeshType::Triangle => in_triangle(at[0], at[1], size[0], CENTROID),
        MeshType::Quad => [0, 1].map(|i| (at[i] as f64 + 0.5) / size[i] as f64),
    }
}

/// The sizes of all faces.
///
/// # Errors
/// If their texels would take too much memory.
pub(super) fn sizes(
    cage: &Cage,
    probed: &Probed,
    sizes: Sizes,
    pixel_bytes: usize,
) -> Result<Vec<Res>, Fault> {
    let chosen: Vec<Res> = (0..cage.faces().len() as u32)
        .into_par_iter()
        .map(|ptex| {
            let one = Res { ulog2: 0, vlog2: 0 };
            if cage.point(ptex, [1.0 / 3.0; 2]).is_none() {
                return one;
            }
            match sizes {
                Sizes::Log2(log2) => Res {
                    ulog2: log2,
                    vlog2: log2,
                },
                Sizes::PerEdge(rate) => {
                    let Some(edge) = edge(probed, ptex) else {
                        return one;
                    };
                    let lengths = cage.lengths(ptex);
                    let [ulog2, vlog2] =
                        lengths.map(|length| log2(rate * length / edge).min(MOST_CHOSEN));
                    Res { ulog2, vlog2 }
                }
            }
        })
        .collect();
    const FEWER: &str = "ask for fewer by --texels or --rate";
    let texels = |res: &Res| 1_u64 << (res.ulog2 + res.vlog2) as u32;
    let bytes = |texels: u64, each: usize| texels.saturating_mul(each as u64);
    if let Some((res, face)) = chosen.iter().zip(cage.faces()).max_by_key(|f| texels(f.0)) {
        let what = format!("its 2^{} x 2^{} texels", res.ulog2, res.vlog2);
        let admitted = admit(bytes(texels(res), pixel_bytes), MOST_AT_ONCE, &what, FEWER);
        admitted.map_err(|fault| fault.at_face(face.face as usize))?;
    }
    let all = chosen.iter().map(texels).fold(0_u64, u64::saturating_add);
    admit(
        bytes(all, pixel_bytes),
        MOST_OF_FILE,
        "the texels of all faces",
        FEWER,
    )?;
    Ok(chosen)
}
