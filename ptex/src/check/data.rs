//! Texels: whether they can be read, and whether what is stored twice is the same.

use super::{Findings, Severity};
use crate::reader::{Reader, Texels};
use crate::reduce::{premultiply, quartered, triangle};
use crate::sample::{Pixels, Sample, with_samples};
use crate::types::{MeshType, Res};
use crate::writer::face::{average_texel, stored_levels};
use crate::{Error, Result};

pub(super) fn check(reader: &Reader, findings: &mut Findings) {
    levels(reader, findings);
    for face in 0..reader.face_count() {
        if let Err(e) = texels(reader, face, findings) {
            findings.unreadable(&e);
        }
    }
}

/// Which faces are in which levels, and whether their blocks fill them.
fn levels(reader: &Reader, findings: &mut Findings) {
    let faces = || (0..reader.face_count()).map(|face| reader.face(face));
    // Of edited faces the size that they had is not known any more.
    let edited = (0..reader.face_count()).any(|face| reader.is_edited(face));
    for (level, info) in reader.levels().enumerate() {
        let wanted = faces()
            .filter(|face| level == 0 || stored_levels(face) > level)
            .count();
        if (level == 0 || !edited) && wanted != info.faces as usize {
            findings.add(
                if level == 0 {
                    Severity::Wrong
                } else {
                    Severity::Odd
                },
                None,
                format!(
                    "level {level} has {} faces, and {wanted} are large enough for it",
                    info.faces
                ),
            );
        }
        match reader.level_end(level) {
            Ok((end, wanted)) if end < wanted => findings.odd(format!(
                "level {level} has {} bytes that belong to no face",
                wanted - end
            )),
            Ok((end, wanted)) if end > wanted => findings.add(
                Severity::Wrong,
                None,
                format!(
                    "the faces of level {level} take {} bytes more than it has",
                    end - wanted
                ),
            ),
            Ok(_) => {}
            Err(e) => findings.unreadable(&e),
        }
    }
}

/// All sizes of a face that the file has.
fn texels(reader: &Reader, face: u32, findings: &mut Findings) -> Result<()> {
    let info = reader.face(face);
    if info.constant {
        if let Some(bytes) = reader.block_bytes(face)?.filter(|bytes| *bytes > 0) {
            findings.add(
                Severity::Odd,
                Some(face),
                format!("is constant, and has {bytes} bytes of texels"),
            );
        }
        return Ok(());
    }
    let channels = reader.channels();
    let mut pixels = whole(reader, face, info.res)?;
    if with_samples!(&pixels, s => s.chunks_exact(channels).all(|t| *t == s[..channels])) {
        findings.add(
            Severity::Odd,
            Some(face),
            "has texels that are all equal, and is not constant",
        );
    }
    if let Some(alpha) = reader.alpha_channel() {
        premultiply(&mut pixels, channels, alpha);
    }
    let mut res = info.res;
    while res.ulog2 > 0 && res.vlog2 > 0 {
        let width = 1 << res.ulog2;
        res.ulog2 -= 1;
        res.vlog2 -= 1;
        if (res.ulog2, res.vlog2) == (0, 0) || !reader.is_stored(face, res)? {
            break;
        }
        let wanted = match reader.mesh_type() {
            MeshType::Quad => {
                with_samples!(&pixels, s => Sample::wrap(quartered(s, width, channels)))
            }
            MeshType::Triangle => triangle(&pixels, width, channels),
        };
        pixels = whole(reader, face, res)?;
        if let Some((sample, stored, wanted)) = first_difference(&pixels, &wanted) {
            let texel = sample / channels;
            findings.add(
                Severity::Wrong,
                Some(face),
                format!(
                    "its stored reduction to 2^{} x 2^{} texels is another than that of the next \
                     larger one: column {}, row {} has {stored} for {wanted}",
                    res.ulog2,
                    res.vlog2,
                    texel & ((1 << res.ulog2) - 1),
                    texel >> res.ulog2,
                ),
            );
        }
    }
    constant(reader, face, &pixels, findings)
}

/// The constant texel of a face that is not constant is the average of the smallest reduction that is stored.
fn constant(reader: &Reader, face: u32, smallest: &Pixels, findings: &mut Findings) -> Result<()> {
    let alpha = reader.alpha_channel();
    let data_type = reader.data_type();
    let wanted = with_samples!(smallest, s => {
        Sample::wrap(average_texel(s, reader.channels(), alpha, data_type.one()))
    });
    let stored = whole(reader, face, Res { ulog2: 0, vlog2: 0 })?;
    // Others may sum in another order.
    let near = |a: f32, b: f32| {
        (a - b).abs()
            <= if data_type.is_integer() {
                1.0
            } else {
                1e-3 * a.abs().max(b.abs())
            }
    };
    if let Some((channel, a, b)) = first_difference(&stored, &wanted)
        && !near(a, b)
    {
        findings.add(
            Severity::Wrong,
            Some(face),
            format!("its constant texel has {a} in channel {channel}, and its texels have {b} on average"),
        );
    }
    Ok(())
}

fn whole(reader: &Reader, face: u32, res: Res) -> Result<Pixels> {
    let place = |e: Error| e.at_face(face);
    let texels: Texels<'_> = reader.texels(face, res, false).map_err(place)?;
    texels.whole().map_err(place)
}

/// The first sample that is another, and both.
fn first_difference(a: &Pixels, b: &Pixels) -> Option<(usize, f32, f32)> {
    fn of<S: Sample>(a: &[S], b: &[S]) -> Option<(usize, f32, f32)> {
        let at = a
            .iter()
            .zip(b)
            .position(|(a, b)| a != b && !(a.float().is_nan() && b.float().is_nan()))?;
        Some((at, a[at].float(), b[at].float()))
    }
    with_samples!(a, a => of(a, Sample::of(b)))
}
