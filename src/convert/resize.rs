//! The faces of a Ptex file in other sizes, and in another type.
//!
//! Smaller ones are the file's own reductions, stored or computed by the format's rules. They are premultiplied where
//! the file has alpha, so they are divided again. Larger ones are looked up bilinearly, over the edges of faces too: a
//! bilinear lookup sees no seam in them. Triangle files have a filter of their own, which smooths a little.

use rayon::prelude::*;
use relievo_ptex::{
    DataType, EncodedFace, FaceInfo, Filter, FilterKind, Format, MAX_LOG2, MeshType, Reader, Res,
    Writer,
};

use super::numbers::{Recoding, is_encoded, numbers, store};
use super::{CENTROID, MOST_AT_ONCE, MOST_OF_FILE, admit, in_triangle};
use crate::error::Fault;

/// How many texels faces get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// As many as they have.
    Same,
    /// Two to this power times as many along u and v, but one at least.
    Scale(i8),
    /// Two to this power at most along u and v.
    Most(i8),
}

/// The faces of a file in some size.
#[derive(Debug)]
pub struct Resized<'a> {
    reader: &'a Reader,
    resolution: Resolution,
}

impl<'a> Resized<'a> {
    /// Reads nothing yet.
    pub fn new(reader: &'a Reader, resolution: Resolution) -> Self {
        Self { reader, resolution }
    }

    /// The file.
    pub fn reader(&self) -> &'a Reader {
        self.reader
    }

    /// A face's size.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn res(&self, face: u32) -> Res {
        let Res { ulog2, vlog2 } = self.reader.face(face).res;
        let size = |log2: i8| match self.resolution {
            Resolution::Same => log2,
            Resolution::Scale(more) => log2.saturating_add(more).clamp(0, MAX_LOG2),
            Resolution::Most(most) => log2.min(most.max(0)),
        };
        Res {
            ulog2: size(ulog2),
            vlog2: size(vlog2),
        }
    }

    /// A face's texels, row 0 first, or one that stands for all; 1 is what is stored as 255 or 65535. Alpha is not
    /// multiplied in.
    ///
    /// # Errors
    /// If the file is damaged, or the texels would take too much memory.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn texels(&self, face: u32) -> Result<Vec<f32>, Fault> {
        let info = self.reader.face(face);
        let res = self.res(face);
        if self.is_one(info, res) {
            return self.smaller(face, info, info.res);
        }
        let floats = (4 * self.reader.channels() as u64) << (res.ulog2 + res.vlog2) as u32;
        let what = format!("2^{} x 2^{} texels", res.ulog2, res.vlog2);
        admit(floats, MOST_AT_ONCE, &what, FEWER).map_err(|f| f.at_face(face as usize))?;
        if grows(info, res) {
            self.larger(face, res)
        } else {
            self.smaller(face, info, res)
        }
    }

    /// The file in these sizes, its adjacency and meta data kept. `raw` stores bytes of colours as they are in any
    /// type, where they are decoded or encoded else.
    ///
    /// # Errors
    /// As [`texels`](Self::texels).
    pub fn ptex(&self, data_type: Option<DataType>, raw: bool) -> Result<Writer, Fault> {
        let reader = self.reader;
        let format = Format {
            data_type: data_type.unwrap_or(reader.data_type()),
            ..Format::of(reader)
        };
        let faces = 0..reader.face_count();
        let bytes = faces.clone().fold(0_u64, |sum, face| {
            let (info, res) = (reader.face(face), self.res(face));
            let texels = match self.is_one(info, res) {
                true => 1,
                false => 1 << (res.ulog2 + res.vlog2) as u32,
            };
            sum.saturating_add(texels * format.pixel_bytes() as u64)
        });
        admit(bytes, MOST_OF_FILE, "its texels", FEWER)?;

        let recoding = {
            let encoded = |data_type| {
                !raw && is_encoded(data_type, reader.channels(), reader.alpha_channel())
            };
            Recoding::new(
                reader.channels(),
                reader.alpha_channel(),
                encoded(reader.data_type()),
                encoded(format.data_type),
            )
        };
        let encoded: Vec<EncodedFace> = faces
            .into_par_iter()
            .map(|face| {
                let mut texels = self.texels(face)?;
                recoding.apply(&mut texels);
                let mut bytes = Vec::new();
                store(format.data_type, &texels, &mut bytes);
                let encoded = format.encode(self.res(face), &bytes);
                encoded.map_err(|e| Fault::from(e).at_face(face as usize))
            })
            .collect::<Result<_, _>>()?;
        let mut writer = Writer::new(format, reader.face_count())?;
        for (face, encoded) in (0..).zip(encoded) {
            let info = FaceInfo {
                res: self.res(face),
                ..*reader.face(face)
            };
            writer.encoded_face(face, &info, encoded)?;
        }
        for (key, value) in reader.meta()?.iter() {
            writer.set_meta(key, value.clone())?;
        }
        Ok(writer)
    }

    /// Whether one texel stands for all: constant faces, unless larger ones see others beyond their edges.
    fn is_one(&self, info: &FaceInfo, res: Res) -> bool {
        info.constant && (!grows(info, res) || info.constant_neighbourhood)
    }

    fn smaller(&self, face: u32, info: &FaceInfo, res: Res) -> Result<Vec<f32>, Fault> {
        let reader = self.reader;
        let channels = reader.channels();
        let multiplied = reader.alpha_channel().filter(|_| res != info.res);
        let texels = reader.texels(face, res, multiplied.is_some())?;
        let (across, up) = match texels.constant() {
            true => (1, 1),
            false => (1 << res.ulog2, 1 << res.vlog2),
        };
        let (mut bytes, mut out) = (Vec::new(), Vec::new());
        texels.copy(0, 0, across, up, &mut bytes)?;
        numbers(reader.data_type(), &bytes, &mut out);
        if let Some(alpha) = multiplied {
            for texel in out.chunks_exact_mut(channels) {
                divide(texel, alpha);
            }
        }
        Ok(out)
    }

    fn larger(&self, face: u32, res: Res) -> Result<Vec<f32>, Fault> {
        let reader = self.reader;
        let channels = reader.channels();
        let filter = Filter::new(FilterKind::Bilinear);
        let [across, up] = [res.ulog2, res.vlog2].map(|log2| 1_usize << log2);
        let mut out = vec![0.0; across * up * channels];
        let places = (0..up).flat_map(|y| (0..across).map(move |x| (x, y)));
        for ((x, y), texel) in places.zip(out.chunks_exact_mut(channels)) {
            let [u, v] = match reader.mesh_type() {
                MeshType::Triangle => in_triangle(x, y, across, CENTROID),
                MeshType::Quad => [
                    (x as f64 + 0.5) / across as f64,
                    (y as f64 + 0.5) / up as f64,
                ],
            };
            filter.eval(reader, face, u as f32, v as f32, [0.0; 4], 0, false, texel)?;
        }
        Ok(out)
    }
}

const FEWER: &str = "ask for fewer texels by --scale or --max-res";

fn grows(info: &FaceInfo, res: Res) -> bool {
    res.ulog2 > info.res.ulog2 || res.vlog2 > info.res.vlog2
}

/// Takes alpha out of the channels that the format multiplies with it: all after it if it is the first, those before it
/// otherwise. What cannot be seen has no colour.
fn divide(texel: &mut [f32], alpha: usize) {
    let by = texel[alpha];
    let multiplied = match alpha {
        0 => 1..texel.len(),
        alpha => 0..alpha,
    };
    for number in &mut texel[multiplied] {
        *number = if by == 0.0 { 0.0 } else { *number / by };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_comes_out_of_what_it_was_multiplied_with() {
        let mut texel = [0.25, 0.5, 0.5, 0.75];
        divide(&mut texel, 2);
        assert_eq!(texel, [0.5, 1.0, 0.5, 0.75]);
        divide(&mut texel, 0);
        assert_eq!(texel, [0.5, 2.0, 1.0, 1.5]);
        let mut unseen = [0.5, 0.0];
        divide(&mut unseen, 1);
        assert_eq!(unseen, [0.0, 0.0]);
    }
}
