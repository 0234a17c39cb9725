//! Lookups with every filter, anywhere, in meshes whose faces name each other at random and lie about it.

use relievo_ptex::{
    BorderMode, Cache, Consistent, DataType, EdgeFilter, FaceInfo, Filter, FilterKind, Format,
    MeshType, Neighbour, Reader, Res, Writer,
};

/// Makes a mesh of the bytes, and lookups of what is left.
pub fn run(bytes: &[u8]) {
    let mut input = Input(bytes);
    let Some(reader) = file(&mut input) else {
        return;
    };
    let consistent = Consistent::new(&reader, input.byte() % 4, input.bit()).ok();
    let bounds = consistent.as_ref().map(|consistent| {
        let all = 0..reader.face_count();
        all.map(|face| consistent.bounds(&reader, face, 0, reader.channels(), input.byte() % 8))
            .map(|bounds| bounds.expect("the face is there"))
            .collect::<Vec<_>>()
    });
    let mut out = vec![0.0; reader.channels()];
    while !input.0.is_empty() {
        let face = u32::from(input.byte()) % reader.face_count();
        let (u, v) = (input.float(), input.float());
        let w = std::array::from_fn(|_| input.float());
        let kind = FilterKind::NAMES[usize::from(input.byte()) % FilterKind::NAMES.len()].1;
        let filter = Filter {
            kind,
            sharpness: f32::from(input.byte()) / 255.0,
            lerp: input.bit(),
            edge_blend: input.bit(),
            width: input.float(),
            blur: input.float(),
        };
        let _ = filter.eval(&reader, face, u, v, w, 0, input.bit(), &mut out);
        let (Some(consistent), Some(bounds)) = (&consistent, &bounds) else {
            continue;
        };
        if consistent.eval(&reader, face, u, v, 0, &mut out).is_err() {
            continue;
        }
        let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
        for (channel, value) in out.iter().enumerate() {
            let [low, high] = bounds[face as usize].range([u; 2], [v; 2], channel);
            assert!(
                low <= *value && *value <= high,
                "{value} is not within {low} and {high}"
            );
        }
    }
}

/// A file of a few small faces.
fn file(input: &mut Input) -> Option<Reader> {
    let triangles = input.byte().is_multiple_of(4);
    let mesh_type = if triangles {
        MeshType::Triangle
    } else {
        MeshType::Quad
    };
    let data_type = [DataType::U8, DataType::U16, DataType::F32][usize::from(input.byte()) % 3];
    let mut format = Format::new(mesh_type, data_type, 1 + usize::from(input.byte()) % 6);
    let mut border = || {
        [BorderMode::Clamp, BorderMode::Black, BorderMode::Periodic][usize::from(input.byte()) % 3]
    };
    (format.u_border, format.v_border) = (border(), border());
    format.alpha_channel = input.bit().then_some(0);
    format.reductions = input.bit();
    if input.bit() {
        format.edge_filter = EdgeFilter::TangentVector;
    }
    let faces = 1 + u32::from(input.byte()) % 8;
    let mut writer = Writer::new(format.clone(), faces).ok()?;
    for face in 0..faces {
        let (size, flags) = (input.byte(), input.byte());
        let ulog2 = (size % 5) as i8;
        let res = Res {
            ulog2,
            vlog2: if triangles {
                ulog2
            } else {
                (size / 5 % 5) as i8
            },
        };
        let edges = if triangles { 3 } else { 4 };
        let info = FaceInfo {
            res,
            neighbours: std::array::from_fn(|edge| {
                let (at, on) = (input.byte(), input.byte());
                (edge < edges && at < 240).then(|| Neighbour {
                    face: u32::from(at) % faces,
                    edge: on % edges as u8,
                })
            }),
            constant: false,
            has_edits: false,
            constant_neighbourhood: false,
            subface: !triangles && flags & 1 == 1,
        };
        let samples = format.channels << (res.ulog2 + res.vlog2);
        let seed = u32::from(flags);
        let texels: Vec<u8> = (0..samples as u32)
            .map(|i| (i + seed).wrapping_mul(0x9e37_79b9_u32.wrapping_mul(seed >> 1)))
            .flat_map(|n| match data_type {
                DataType::U8 => vec![(n >> 24) as u8],
                DataType::U16 => ((n >> 16) as u16).to_le_bytes().to_vec(),
                _ => ((n >> 8) as f32 / (1 << 23) as f32 - 1.0)
                    .to_le_bytes()
                    .to_vec(),
            })
            .collect();
        writer.face(face, &info, &texels).ok()?;
    }
    Reader::from_bytes(writer.bytes().ok()?, "fuzz.ptx", &Cache::new(1 << 20)).ok()
}

/// Bytes that decide; zeros when they are used up.
struct Input<'a>(&'a [u8]);

impl Input<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else {
            return 0;
        };
        self.0 = rest;
        *first
    }

    fn bit(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    /// Mostly a number from -1 to 3, with the ends of texels among them, at times any.
    fn float(&mut self) -> f32 {
        let how = self.byte();
        match how % 4 {
            0 => f32::from(self.byte() % 65) / 16.0 - 1.0,
            1 => f32::from(u16::from_le_bytes([self.byte(), self.byte()])) / 65536.0,
            2 => f32::from(how / 4) * 2.0_f32.powi(-i32::from(self.byte() % 32)),
            _ => f32::from_le_bytes(std::array::from_fn(|_| self.byte())),
        }
    }
}
