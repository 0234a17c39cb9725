//! Files for the tests, made from a few numbers.

use relievo_ptex::{DataType, FaceInfo, Format, MeshType, MetaValue, Neighbour, Res, Writer};

/// Numbers that look random and are the same every time (xorshift).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11
    }

    /// From 0 to below `n`.
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }
}

/// A face and all its texels, or one for all.
#[derive(Clone)]
pub(crate) struct Face {
    pub(crate) info: FaceInfo,
    pub(crate) texels: Vec<u8>,
}

/// What a file is made of.
pub(crate) struct Made {
    pub(crate) format: Format,
    pub(crate) faces: Vec<Face>,
    pub(crate) meta: Vec<(String, MetaValue)>,
}

impl Made {
    /// A strip of `count` faces side by side, those of quads turned at random, of sizes up to 2^`log2`.
    pub(crate) fn new(format: Format, count: u32, log2: u64, numbers: &mut Numbers) -> Self {
        let turns: Vec<u8> = (0..count).map(|_| numbers.below(4) as u8).collect();
        let faces = (0..count).map(|face| {
            let mut neighbours = [None; 4];
            // In its own frame a quad's left is edge 3 and its right edge 1; turned, both move on.
            let edge = |face: u32, edge: u8| match format.mesh_type {
                MeshType::Quad => (edge + turns[face as usize]) % 4,
                MeshType::Triangle => edge % 3,
            };
            let mut join = |at: u8, other: u32, to: u8| {
                neighbours[usize::from(edge(face, at))] = Some(Neighbour {
                    face: other,
                    edge: edge(other, to),
                });
            };
            if face > 0 {
                join(3, face - 1, 1);
            }
            if face + 1 < count {
                join(1, face + 1, 3);
            }
            let ulog2 = numbers.below(log2 + 1) as i8;
            let vlog2 = match format.mesh_type {
                MeshType::Quad => numbers.below(log2 + 1) as i8,
                MeshType::Triangle => ulog2,
            };
            let info = FaceInfo {
                res: Res { ulog2, vlog2 },
                neighbours,
                constant: false,
                has_edits: false,
                constant_neighbourhood: false,
                subface: false,
            };
            let texels = texels(&format, info.res, numbers);
            Face { info, texels }
        });
        let faces = faces.collect();
        let meta = meta(numbers);
        Self {
            format,
            faces,
            meta,
        }
    }

    pub(crate) fn writer(&self) -> Writer {
        let mut writer = Writer::new(self.format.clone(), self.faces.len() as u32).unwrap();
        for (i, face) in (0..).zip(&self.faces) {
            writer.face(i, &face.info, &face.texels).unwrap();
        }
        for (key, value) in &self.meta {
            writer.set_meta(key, value.clone()).unwrap();
        }
        writer
    }
}

/// All texels of a face: smooth, noise, or one for all; floats are finite, from -4 to 4.
pub(crate) fn texels(format: &Format, res: Res, numbers: &mut Numbers) -> Vec<u8> {
    let kind = numbers.below(4);
    let count = match kind {
        0 => 1,
        _ => 1 << (res.ulog2 + res.vlog2),
    };
    let mut out = Vec::new();
    for i in 0..count {
        for channel in 0..format.channels {
            let part = match kind {
                1 => ((i * 37 + channel * 101) % 1000) as f32 / 999.0,
                // A large part of one value: constant tiles.
                2 if i < count / 2 => 0.25,
                _ => numbers.below(1000) as f32 / 999.0,
            };
            let float = part * 8.0 - 4.0;
            match format.data_type {
                DataType::U8 => out.push((part * 255.0) as u8),
                DataType::U16 => out.extend(((part * 65535.0) as u16).to_le_bytes()),
                DataType::F16 => out.extend(half::f16::from_f32(float).to_le_bytes()),
                DataType::F32 => out.extend(float.to_le_bytes()),
            }
        }
    }
    out
}

fn meta(numbers: &mut Numbers) -> Vec<(String, MetaValue)> {
    (0..numbers.below(5))
        .map(|i| {
            let n = [0, 1, 5, 256, 1100][numbers.below(5) as usize];
            let list = (0..n).map(|_| numbers.next() as i32);
            let value = match i {
                0 => MetaValue::String(list.map(|n| char::from(32 + (n & 63) as u8)).collect()),
                1 => MetaValue::I8(list.map(|n| n as i8).collect()),
                2 => MetaValue::I16(list.map(|n| n as i16).collect()),
                3 => MetaValue::F32(list.map(|n| n as f32).collect()),
                _ => MetaValue::F64(list.map(f64::from).collect()),
            };
            (format!("key {i}"), value)
        })
        .collect()
}
