//! Neighbours have to be mutual. Between a large face and the two sub-faces along one of its edges they are in a way
//! of their own: both name the large face, which names the one where its edge begins, and the other lies behind that
//! one's next edge but two.

use super::{Findings, Severity};
use crate::layout::StoredFace;
use crate::reader::Reader;
use crate::types::{FaceInfo, MeshType, Neighbour};
use crate::writer::neighbourhood::constant_neighbourhoods;
use crate::{Res, Result};

pub(super) fn check(reader: &Reader, stored: &[StoredFace], findings: &mut Findings) {
    let triangles = reader.mesh_type() == MeshType::Triangle;
    let edges = if triangles { 3 } else { 4 };
    let count = i64::from(reader.face_count());
    let mut wrong = |face: u32, message: String| {
        findings.add(Severity::Wrong, Some(face), message);
    };
    for (face, stored) in (0..).zip(stored) {
        for edge in 0..4 {
            let (other, entered) = (stored.faces[edge], stored.edge(edge));
            if other < -1 || i64::from(other) >= count {
                wrong(
                    face,
                    format!("names face {other} beyond edge {edge}, and there are {count}"),
                );
            } else if other >= 0 && (edge >= edges || usize::from(entered) >= edges) {
                wrong(
                    face,
                    format!(
                        "names edge {entered} of face {other} beyond edge {edge}, and faces have {edges} edges"
                    ),
                );
            } else if other >= 0 {
                let here = Neighbour {
                    face,
                    edge: edge as u8,
                };
                if let Some(found) = one_sided(reader, here) {
                    let says = match found {
                        Some(n) => format!("names edge {} of face {}", n.edge, n.face),
                        None => "names none".to_owned(),
                    };
                    wrong(
                        face,
                        format!(
                            "names edge {entered} of face {other} beyond edge {edge}, which in turn {says}"
                        ),
                    );
                }
            }
        }
    }
    neighbourhoods(reader, findings);
}

/// What lies beyond the edge beyond an edge, if that is not the edge itself.
fn one_sided(reader: &Reader, here: Neighbour) -> Option<Option<Neighbour>> {
    let face = |n: Neighbour| reader.face(n.face);
    let beyond = |n: Neighbour| face(n).neighbours[usize::from(n.edge)];
    let there = beyond(here)?;
    let back = beyond(there);
    if back == Some(here) {
        return None;
    }
    // A sub-face that the large face does not name: it lies behind the one that it names.
    if face(here).subface && !face(there).subface {
        let named = back?;
        let next = |n: Neighbour| Neighbour {
            edge: (n.edge + 3) % 4,
            ..n
        };
        if face(named).subface && beyond(next(named)).map(next) == Some(here) {
            return None;
        }
    }
    Some(back)
}

/// The flags of faces among constant ones, as they would be set today.
fn neighbourhoods(reader: &Reader, findings: &mut Findings) {
    let count = reader.face_count();
    let mut texels = Vec::new();
    let texel = |face: u32| -> Result<Vec<u8>> {
        let mut out = Vec::new();
        if reader.face(face).constant {
            let one = Res { ulog2: 0, vlog2: 0 };
            reader
                .texels(face, one, false)?
                .copy(0, 0, 1, 1, &mut out)?;
        }
        Ok(out)
    };
    for face in 0..count {
        match texel(face) {
            Ok(texel) => texels.push(texel),
            Err(e) => return findings.unreadable(&e),
        }
    }
    let faces: Vec<FaceInfo> = (0..count).map(|face| *reader.face(face)).collect();
    let flags =
        constant_neighbourhoods(&faces, reader.mesh_type(), reader.border_modes(), |a, b| {
            texels[a] == texels[b]
        });
    // A missing flag costs time. Old files have none at all.
    let flagged = faces.iter().any(|face| face.constant_neighbourhood);
    for (face, (info, is)) in (0..).zip(faces.iter().zip(flags)) {
        if info.constant && info.constant_neighbourhood && !is {
            findings.add(
                Severity::Wrong,
                Some(face),
                "is flagged as lying among constant faces of its texel, and does not",
            );
        } else if flagged && is && !info.constant_neighbourhood && !info.has_edits {
            findings.add(
                Severity::Odd,
                Some(face),
                "lies among constant faces of its texel, and is not flagged so",
            );
        }
    }
}
