//! Writes small files with everything that the format has, for the fuzzer to begin with:
//! `cargo run -p relievo-ptex --example fuzz_seeds -- fuzz/seeds/ptex`.

use std::path::PathBuf;

use relievo_ptex::{
    BorderMode, Cache, DataType, EdgeFilter, Editor, FaceInfo, Format, MeshType, MetaValue,
    Neighbour, Reader, Res, Result, Writer,
};

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| ".".into()));
    let write = |name: &str, writer: &Writer| writer.write(folder.join(name));

    let mut small = Format::new(MeshType::Quad, DataType::U8, 3);
    small.edge_filter = EdgeFilter::TangentVector;
    let mut writer = pair(small, [4, 3])?;
    for (key, value) in [
        ("text", MetaValue::String("a few words".into())),
        ("bytes", MetaValue::I8(vec![-1, 0, 1])),
        ("shorts", MetaValue::I16(vec![-300, 300])),
        ("ints", MetaValue::I32((0..400).collect())),
        ("floats", MetaValue::F32(vec![0.5])),
        ("doubles", MetaValue::F64(vec![0.25, -1e300])),
    ] {
        writer.set_meta(key, value)?;
    }
    write("quads_u8.ptx", &writer)?;

    let reader = Reader::from_bytes(writer.bytes()?, "quads_u8.ptx", &Cache::default())?;
    let mut editor = Editor::new(&reader);
    editor.face(0, &face([2, 2], 1), &texels(reader.data_type(), 3, [2, 2]))?;
    editor.face(1, &face([3, 3], 0), &[9, 8, 7])?;
    editor.set_meta("text", MetaValue::String("others".into()))?;
    editor.write(folder.join("edited_u8.ptx"))?;

    let mut alpha = Format::new(MeshType::Quad, DataType::U16, 4);
    alpha.alpha_channel = Some(3);
    alpha.u_border = BorderMode::Black;
    alpha.v_border = BorderMode::Periodic;
    write("alpha_u16.ptx", &pair(alpha, [3, 4])?)?;

    let triangles = Format::new(MeshType::Triangle, DataType::F32, 1);
    write("triangles_f32.ptx", &pair(triangles, [4, 4])?)?;

    let mut plain = Format::new(MeshType::Quad, DataType::F16, 2);
    plain.reductions = false;
    write("plain_f16.ptx", &pair(plain, [2, 5])?)?;

    // Large enough for tiles, and nearly all of it the same.
    let mut tiled = Writer::new(Format::new(MeshType::Quad, DataType::U8, 1), 2)?;
    let mut bytes = vec![7; 1 << 18];
    bytes[..300].copy_from_slice(&texels(DataType::U8, 1, [9, 0])[..300]);
    tiled.face(0, &face([9, 9], 1), &bytes)?;
    write("tiled_u8.ptx", &tiled)
}

/// Two faces side by side, of which the other one is turned.
fn pair(format: Format, size: [i8; 2]) -> Result<Writer> {
    let bytes = texels(format.data_type, format.channels, size);
    let mut writer = Writer::new(format, 2)?;
    writer.face(0, &face(size, 1), &bytes)?;
    writer.face(1, &face(size, 0), &bytes)?;
    Ok(writer)
}

fn face([ulog2, vlog2]: [i8; 2], other: u32) -> FaceInfo {
    let across = Neighbour {
        face: other,
        edge: 1,
    };
    FaceInfo {
        res: Res { ulog2, vlog2 },
        neighbours: [None, Some(across), None, None],
        constant: false,
        has_edits: false,
        constant_neighbourhood: false,
        subface: false,
    }
}

fn texels(data_type: DataType, channels: usize, [ulog2, vlog2]: [i8; 2]) -> Vec<u8> {
    let values = (0..channels << (ulog2 + vlog2)).map(|n| (n * n % 61) as u8);
    values
        .flat_map(|value| match data_type {
            DataType::U8 => vec![value],
            DataType::U16 => (u16::from(value) * 999).to_le_bytes().to_vec(),
            // The upper byte of a half float, and of a single one.
            DataType::F16 => vec![value, 0x38],
            DataType::F32 => (f32::from(value) / 8.0 - 4.0).to_le_bytes().to_vec(),
        })
        .collect()
}
