//! `relievo ptex info`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use rayon::prelude::*;
use relievo::Result;
use relievo::error::Fault;
use relievo_ptex::{
    BorderMode, Cache, DataType, EdgeFilter, MeshType, MetaValue, Reader, Res, StoredFace, Texels,
};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

/// Tell what is in a Ptex file.
///
/// With --json: header, meta data, and of each face its size, neighbours, flags, constant texel, and the SHA-256 of its
/// texels in full size and in each reduction that halves both sides. That reads all of the file; what cannot be read has
/// an `error` in its place, and the exit code is 3.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// Ptex file.
    file: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The most bytes that the texels of a face are expanded to. A constant face of any size takes a few bytes of a file:
/// its size may be a mistake that would take days.
const MOST: u64 = 1 << 32;

impl Info {
    pub(crate) fn run(self) -> Result<()> {
        let reader = Reader::open(&self.file, &Cache::default())?;
        if !self.json {
            let mut out = format!("{}\n", self.file.display());
            // Writing to a string cannot fail.
            let _ = tell(&reader, &mut out);
            super::super::print(out.as_bytes())?;
            return reader.meta().map(|_| ()).map_err(Into::into);
        }
        let (report, error) = report(&reader)?;
        super::super::print(format!("{report}\n").as_bytes())?;
        error.map_or(Ok(()), |fault| Err(fault.into()))
    }
}

/// For people.
fn tell(reader: &Reader, out: &mut String) -> std::fmt::Result {
    let faces = || (0..reader.face_count()).map(|face| reader.face(face));
    let count = |what: &str, n: usize| match n {
        0 => String::new(),
        n => format!(", {n} {what}"),
    };
    let mesh = mesh_type(reader.mesh_type());
    writeln!(
        out,
        "  faces       {} of a {mesh} mesh{}{}{}",
        reader.face_count(),
        count("constant", faces().filter(|f| f.constant).count()),
        count("sub-faces", faces().filter(|f| f.subface).count()),
        count("edited", faces().filter(|f| f.has_edits).count()),
    )?;
    let alpha = reader.alpha_channel();
    let alpha = alpha.map_or_else(String::new, |alpha| format!(", alpha in channel {alpha}"));
    writeln!(
        out,
        "  texels      {}, {} channels{alpha}",
        data_type(reader.data_type()),
        reader.channels(),
    )?;
    let (u, v) = reader.border_modes();
    let edges = match reader.edge_filter() {
        EdgeFilter::None => "",
        EdgeFilter::TangentVector => ", tangent vectors turn at edges",
    };
    writeln!(
        out,
        "  borders     {} along u, {} along v{edges}",
        border(u),
        border(v)
    )?;
    writeln!(out, "  levels      {}", reader.levels().count())?;
    let mut sizes = BTreeMap::new();
    for face in faces() {
        *sizes.entry((face.res.ulog2, face.res.vlog2)).or_insert(0) += 1;
    }
    for ((u, v), faces) in sizes {
        let size = format!("{} x {}", 1_u64 << u, 1_u64 << v);
        writeln!(out, "    {size:13} {faces} faces")?;
    }
    if let Ok(meta) = reader.meta() {
        for (key, value) in meta.iter() {
            let text = match value {
                MetaValue::String(text) => format!("{text:?}"),
                value => meta_value(value).to_string(),
            };
            let short: String = text.chars().take(60).collect();
            let dots = if short.len() < text.len() { "…" } else { "" };
            let (kind, n) = (value.type_name(), value.count());
            writeln!(out, "  meta data   {key}: {kind}[{n}] {short}{dots}")?;
        }
    }
    Ok(())
}

/// For programs; and the first thing that could not be read.
fn report(reader: &Reader) -> Result<(Value, Option<Fault>)> {
    let mut first = None;
    let stored = reader.stored_faces()?;
    let faces: Vec<(Value, Option<Fault>)> = stored
        .par_iter()
        .enumerate()
        .map(|(face, stored)| face_report(reader, face as u32, stored))
        .collect();
    let faces: Vec<Value> = faces
        .into_iter()
        .map(|(value, fault)| {
            first = first.take().or(fault);
            value
        })
        .collect();
    let mut report = Map::new();
    report.insert("file".into(), json!(reader.path()));
    report.insert("info".into(), info(reader));
    report.insert("header".into(), header(reader));
    report.insert("ext_header".into(), ext_header(reader));
    let levels = reader.levels().map(|level| {
        json!({
            "nfaces": level.faces,
            "levelheadersize": level.header_size,
            "leveldatasize": level.size,
        })
    });
    report.insert("levels".into(), levels.collect());
    report.insert("reduction_order".into(), json!(reader.reduction_order()));
    match reader.meta() {
        Ok(meta) => {
            let entries = meta.iter().map(|(key, value)| {
                json!({
                    "key": key,
                    "type": value.type_name(),
                    "count": value.count(),
                    "value": meta_value(value),
                })
            });
            report.insert("metadata".into(), entries.collect());
        }
        Err(e) => {
            report.insert("metadata".into(), json!([]));
            report.insert("metadata_error".into(), json!(e.message()));
            first = first.or(Some(e.into()));
        }
    }
    report.insert("faces".into(), Value::Array(faces));
    Ok((Value::Object(report), first))
}

fn info(reader: &Reader) -> Value {
    let (u, v) = reader.border_modes();
    json!({
        "mesh_type": mesh_type(reader.mesh_type()),
        "data_type": data_type(reader.data_type()),
        "channels": reader.channels(),
        "alpha_channel": reader.header().alpha_channel,
        "faces": reader.face_count(),
        "u_border": border(u),
        "v_border": border(v),
        "edge_filter": match reader.edge_filter() {
            EdgeFilter::None => "none",
            EdgeFilter::TangentVector => "tanvec",
        },
        "has_edits": reader.has_edits(),
        "has_mipmaps": reader.header().levels > 1,
    })
}

/// The fields as they are stored.
fn header(reader: &Reader) -> Value {
    let header = reader.header();
    json!({
        "version": header.version,
        "minorversion": header.minor_version,
        "meshtype": header.mesh_type as u32,
        "datatype": header.data_type as u32,
        "alphachan": header.alpha_channel,
        "nchannels": header.channels,
        "nlevels": header.levels,
        "nfaces": header.faces,
        "extheadersize": header.ext_header_size,
        "faceinfosize": header.face_info_size,
        "constdatasize": header.constant_data_size,
        "levelinfosize": header.level_info_size,
        "leveldatasize": header.level_data_size,
        "metadatazipsize": header.meta_zip_size,
        "metadatamemsize": header.meta_size,
    })
}

/// Likewise; zeros of files that have none.
fn ext_header(reader: &Reader) -> Value {
    let ext = reader.ext_header();
    json!({
        "ubordermode": ext.u_border as u16,
        "vbordermode": ext.v_border as u16,
        "edgefiltermode": ext.edge_filter as u16,
        "lmdheaderzipsize": ext.large_meta_zip_size,
        "lmdheadermemsize": ext.large_meta_size,
        "lmddatasize": ext.large_meta_data_size,
        "editdatasize": ext.edit_size,
        "editdatapos": ext.edit_position,
    })
}

fn face_report(reader: &Reader, face: u32, stored: &StoredFace) -> (Value, Option<Fault>) {
    let info = reader.face(face);
    let mut object = Object::default();
    object.add("id", face);
    object.add("res", size(info.res));
    object.add("adjfaces", json!(stored.faces));
    object.add(
        "adjedges",
        json!([0, 1, 2, 3].map(|edge| stored.edge(edge))),
    );
    object.add("flags", stored.flags);
    object.add("constant", info.constant);
    object.add("nbconstant", info.constant_neighbourhood);
    object.add("hasedits", info.has_edits);
    object.add("subface", info.subface);
    object.try_add("tile_res", tile_res(reader, face, info.res));
    object.try_add("const_value", constant(reader, face));
    let mut chain = Vec::new();
    for level in 0..=info.res.ulog2.max(info.res.vlog2) {
        let res = Res {
            ulog2: (info.res.ulog2 - level).max(0),
            vlog2: (info.res.vlog2 - level).max(0),
        };
        let (entry, fault) = reduction(reader, face, res);
        object.fault = object.fault.or(fault);
        chain.push(entry);
    }
    object.add("chain", chain);
    (Value::Object(object.fields), object.fault)
}

fn reduction(reader: &Reader, face: u32, res: Res) -> (Value, Option<Fault>) {
    let mut entry = Object::default();
    entry.add("res", size(res));
    match reader.texels(face, res, false) {
        Ok(texels) => {
            entry.try_add("sha256", hash(reader, face, &texels));
            if texels.constant() {
                entry.add("constant", true);
            }
        }
        Err(e) => entry.fail(e.into()),
    }
    if reader.alpha_channel().is_some() {
        let texels = reader.texels(face, res, true).map_err(Fault::from);
        let hash = texels.and_then(|texels| hash(reader, face, &texels));
        entry.try_add("premult_sha256", hash);
    }
    match tile_res(reader, face, res) {
        Ok(Value::Null) => {}
        tiles => entry.try_add("tile_res", tiles),
    }
    (Value::Object(entry.fields), entry.fault)
}

/// An object in the making, some fields of which may not be had.
#[derive(Default)]
struct Object {
    fields: Map<String, Value>,
    fault: Option<Fault>,
}

impl Object {
    fn add(&mut self, name: &str, value: impl Into<Value>) {
        self.fields.insert(name.to_owned(), value.into());
    }

    fn try_add(&mut self, name: &str, value: Result<Value, Fault>) {
        match value {
            Ok(value) => self.add(name, value),
            Err(fault) => self.fail(fault),
        }
    }

    fn fail(&mut self, fault: Fault) {
        self.add("error", fault.message.as_str());
        self.fault.get_or_insert(fault);
    }
}

fn size(res: Res) -> Value {
    json!([res.ulog2, res.vlog2])
}

fn tile_res(reader: &Reader, face: u32, res: Res) -> Result<Value, Fault> {
    Ok(reader.tile_res(face, res)?.map_or(Value::Null, size))
}

/// The face's constant texel, channel by channel: integers, and floats as their bit patterns.
fn constant(reader: &Reader, face: u32) -> Result<Value, Fault> {
    let mut bytes = Vec::new();
    reader
        .texels(face, Res { ulog2: 0, vlog2: 0 }, false)?
        .copy(0, 0, 1, 1, &mut bytes)?;
    let channels = bytes.chunks_exact(reader.data_type().bytes());
    let bits = channels.map(|le| {
        le.iter()
            .rev()
            .fold(0_u32, |n, byte| n << 8 | u32::from(*byte))
    });
    Ok(bits.map(Value::from).collect())
}

/// The SHA-256 of all texels: row 0 first, channels side by side, little endian.
fn hash(reader: &Reader, face: u32, texels: &Texels<'_>) -> Result<Value, Fault> {
    let Res { ulog2, vlog2 } = texels.res();
    let pixel = reader.header().pixel_bytes() as u64;
    let bytes = pixel << (ulog2 + vlog2) as u32;
    if bytes > MOST {
        let fault = Fault::new(format!(
            "its 2^{ulog2} x 2^{vlog2} texels take {bytes} bytes, and at most {MOST} are looked at"
        ));
        let fault = fault.at_face(face as usize).in_file(reader.path());
        return Err(fault.advise("Write the face with fewer texels."));
    }
    let mut hash = Sha256::new();
    let mut row = Vec::new();
    for y in 0..1 << vlog2 {
        row.clear();
        texels.copy(0, y, 1 << ulog2, 1, &mut row)?;
        hash.update(&row);
    }
    let mut hex = String::with_capacity(64);
    for byte in hash.finalize() {
        // Writing to a string cannot fail.
        let _ = write!(hex, "{byte:02x}");
    }
    Ok(Value::String(hex))
}

fn meta_value(value: &MetaValue) -> Value {
    match value {
        MetaValue::String(text) => json!(text),
        MetaValue::I8(v) => json!(v),
        MetaValue::I16(v) => json!(v),
        MetaValue::I32(v) => json!(v),
        MetaValue::F32(v) => v.iter().map(|v| nine_digits(*v)).collect(),
        MetaValue::F64(v) => v.iter().map(|v| number(*v)).collect(),
    }
}

/// Nine digits tell a single float from all others.
fn nine_digits(value: f32) -> Value {
    format!("{value:.8e}").parse().map_or(Value::Null, number)
}

/// Whole numbers without a point; what is not finite is null.
fn number(value: f64) -> Value {
    // Up to here all whole numbers are exact.
    const EXACT: f64 = (1_u64 << 53) as f64;
    match value {
        v if v.fract() == 0.0 && v.abs() < EXACT => Value::from(v as i64),
        v => Value::from(v),
    }
}

fn mesh_type(mesh_type: MeshType) -> &'static str {
    match mesh_type {
        MeshType::Triangle => "triangle",
        MeshType::Quad => "quad",
    }
}

fn data_type(data_type: DataType) -> &'static str {
    match data_type {
        DataType::U8 => "uint8",
        DataType::U16 => "uint16",
        DataType::F16 => "float16",
        DataType::F32 => "float32",
    }
}

fn border(mode: BorderMode) -> &'static str {
    match mode {
        BorderMode::Clamp => "clamp",
        BorderMode::Black => "black",
        BorderMode::Periodic => "periodic",
    }
}
