//! An image with texture coordinates to a Ptex file, through the cage that has them.
//!
//! The texture coordinates are carried over the limit surface by the rules of subdivision. The middle of each texel of
//! each Ptex face is taken to the image, and what the image is there becomes the texel. A texel that covers several of
//! the image's is the mean of as many points. Faces of holes have texels too: filters reach into them.

use glam::Vec4;
use rayon::prelude::*;
use relievo_ptex::{DataType, EncodedFace, Format, MeshType, Res, Writer};

use super::numbers::{Recoding, is_encoded, store};
use super::sizes::{SLACK, lengths, log2};
use super::{CENTROID, MOST_AT_ONCE, MOST_OF_FILE, admit, in_triangle};
use crate::error::{Fault, Warnings};
use crate::image::Texture;
use crate::math::{DVec2, Vec2};
use crate::mesh::{ControlMesh, PtexFace, ptex_faces, ptex_kind};
use crate::surface::Subdivision;

/// What becomes of an image, and how.
#[derive(Debug, Clone)]
pub struct FromImage {
    /// The primvar of two components that has the texture coordinates.
    pub primvar: String,
    /// How many texels the faces get.
    pub sizes: Sizes,
    /// Their type; `None`: bytes for bytes, halves for halves, else floats.
    pub data_type: Option<DataType>,
    /// Stores the image's numbers as they are, bytes of colours too.
    pub raw: bool,
}

/// How many texels a face gets: powers of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sizes {
    /// At least as many along u and v as the face covers of the image there.
    OfImage,
    /// Two to this power along u and v, for all.
    Log2(i8),
    /// At least as many along u and v as its length on the limit surface says, in units of the mesh's own space.
    PerUnit(f64),
}

/// The most points along u and v whose mean is a texel.
const MOST_POINTS: f64 = 16.0;
/// Looks an image up at all texels of a valid cage's faces.
///
/// # Errors
/// If the cage has no such texture coordinates, or the texels would take too much memory.
pub fn ptex_from_image(
    image: &Texture,
    mesh: &ControlMesh,
    options: &FromImage,
) -> Result<(Writer, Warnings), Fault> {
    let cage = Cage::new(mesh, &options.primvar)?;
    let faces = ptex_faces(mesh);
    let mut warnings = Warnings::default();
    let numbers = 0..faces.len() as u32;
    let sizes: Vec<Size> = numbers
        .clone()
        .into_par_iter()
        .map(|ptex| cage.size(image, ptex, options.sizes))
        .collect();
    for (face, size) in faces.iter().zip(&sizes) {
        if let Size::Outside = size {
            warnings.add("ptex-outside-tiles", || {
                let face = face.face;
                format!("face {face}: its middle lies in no tile of the image: there it is black")
            });
        }
    }

    let format = format_for(image, mesh, options);
    check_memory(&faces, &sizes, &format)?;
    let encode = |ptex: u32| {
        let size = &sizes[ptex as usize];
        let texels = cage.texels(image, ptex, size, &format, options.raw);
        format.encode(size.res(), &texels)
    };
    let encoded: Vec<EncodedFace> = numbers
        .into_par_iter()
        .map(encode)
        .collect::<Result<_, _>>()?;
    let mut writer = Writer::new(format, faces.len() as u32)?;
    for ((number, face), encoded) in (0..).zip(&faces).zip(encoded) {
        let info = face.info(sizes[number as usize].res());
        writer.encoded_face(number, &info, encoded)?;
    }
    Ok((writer, warnings))
}

fn format_for(image: &Texture, mesh: &ControlMesh, options: &FromImage) -> Format {
    let data_type = options.data_type.unwrap_or(match image.depth() {
        1 => DataType::U8,
        2 => DataType::F16,
        _ => DataType::F32,
    });
    let colors = image.colors();
    let channels = colors + usize::from(image.has_alpha());
    Format {
        alpha_channel: image.has_alpha().then_some(colors),
        ..Format::new(ptex_kind(mesh), data_type, channels)
    }
}

fn check_memory(faces: &[PtexFace], sizes: &[Size], format: &Format) -> Result<(), Fault> {
    let texels = |size: &Size| 1_u64 << (size.res().ulog2 + size.res().vlog2) as u32;
    let all: u64 = sizes
        .iter()
        .map(texels)
        .fold(0, |sum, n| sum.saturating_add(n));
    let largest = sizes
        .iter()
        .zip(faces)
        .max_by_key(|(size, _)| texels(size))
        .map_or((Res { ulog2: 0, vlog2: 0 }, 0), |(size, face)| {
            (size.res(), face.face)
        });
    let (Res { ulog2, vlog2 }, face) = largest;
    let at_face = |fault: Fault| fault.at_face(face as usize);
    let help = "ask for fewer texels by --res, or see whether its texture coordinates are meant";
    let what = format!("its 2^{ulog2} x 2^{vlog2} texels");
    let floats = (4 * format.channels as u64) << (ulog2 + vlog2) as u32;
    admit(floats, MOST_AT_ONCE, &what, help).map_err(at_face)?;
    let bytes = all.saturating_mul(format.pixel_bytes() as u64);
    let what = format!("{what} and those of all other faces");
    admit(bytes, MOST_OF_FILE, &what, help).map_err(at_face)
}

/// A face's texels, and how many texels of the image one of them covers along u and v.
#[derive(Debug, Clone, Copy)]
enum Size {
    Covers(Res, [f64; 2]),
    /// Its middle lies in none of the image's tiles.
    Outside,
    /// There is no surface: a face at a border that is left out.
    Unseen,
}

impl Size {
    fn res(&self) -> Res {
        match self {
            Self::Covers(res, _) => *res,
            Self::Outside | Self::Unseen => Res { ulog2: 0, vlog2: 0 },
        }
    }
}

/// The cage's limit surface with its texture coordinates.
struct Cage {
    surface: Subdivision,
    kind: MeshType,
}

impl Cage {
    fn new(mesh: &ControlMesh, primvar: &str) -> Result<Self, Fault> {
        let mut whole = mesh.clone();
        whole.holes.clear();
        let surface = Subdivision::carrying(&whole, &[primvar], Some(primvar));
        if !surface.has_texcoords() {
            let known: Vec<_> = (mesh.primvars.iter().filter(|p| p.width == 2))
                .map(|p| p.name.as_str())
                .collect();
            let help = match &known[..] {
                [] => {
                    "give the mesh texture coordinates of two components, for each point or corner"
                        .to_owned()
                }
                known => format!("ask for --primvar {}", known.join(" or ")),
            };
            let message = format!(
                "there is no primvar \"{primvar}\" of two components that varies within faces"
            );
            return Err(Fault::new(message).advise(help));
        }
        Ok(Self {
            surface,
            kind: ptex_kind(mesh),
        })
    }

    fn st(&self, ptex: u32, uv: [f64; 2]) -> Option<Vec2> {
        self.surface.texcoord_on_ptex(ptex, uv)
    }

    fn size(&self, image: &Texture, ptex: u32, sizes: Sizes) -> Size {
        let middle = match self.kind {
            MeshType::Triangle => CENTROID,
            MeshType::Quad => [0.5; 2],
        };
        let Some(st) = self.st(ptex, middle) else {
            return Size::Unseen;
        };
        let Some(size) = image.size_at(st) else {
            return Size::Outside;
        };
        let size = DVec2::from(size.map(f64::from));
        let covered = lengths(self.kind, |uv| {
            let st = self.st(ptex, uv)?.as_dvec2() * size;
            Some(st.extend(0.0))
        });
        let [ulog2, vlog2] = match sizes {
            Sizes::OfImage => covered.map(log2),
            Sizes::Log2(log2) => [log2; 2],
            Sizes::PerUnit(density) => {
                let position = |uv| Some(self.surface.position_on_ptex(ptex, uv)?.as_dvec3());
                lengths(self.kind, position).map(|length| log2(length * density))
            }
        };
        let res = Res { ulog2, vlog2 };
        Size::Covers(
            res,
            [
                covered[0] / f64::from(1 << ulog2),
                covered[1] / f64::from(1 << vlog2),
            ],
        )
    }

    /// A face's texels as the file has them; one of zeros where there is nothing to look up.
    fn texels(
        &self,
        image: &Texture,
        ptex: u32,
        size: &Size,
        format: &Format,
        raw: bool,
    ) -> Vec<u8> {
        let channels = format.channels;
        let Size::Covers(res, covered) = size else {
            return vec![0; format.pixel_bytes()];
        };
        let [across, up] = [res.ulog2, res.vlog2].map(|log2| 1_usize << log2);
        let points = self.points(*covered);
        let mut texels = Vec::with_capacity(across * up * channels);
        for (y, x) in (0..up).flat_map(|y| (0..across).map(move |x| (y, x))) {
            let mut sum = Vec4::ZERO;
            for &[a, b] in &points {
                let uv = match self.kind {
                    MeshType::Triangle => in_triangle(x, y, across, [a, b]),
                    MeshType::Quad => [(x as f64 + a) / across as f64, (y as f64 + b) / up as f64],
                };
                if let Some(st) = self.st(ptex, uv) {
                    sum += image.eval(st);
                }
            }
            let mean = (sum / points.len() as f32).to_array();
            let colors = image.colors();
            texels.extend(&mean[..colors]);
            texels.extend(image.has_alpha().then_some(mean[3]));
        }
        let encoded = !raw && is_encoded(format.data_type, channels, format.alpha_channel);
        Recoding::new(channels, format.alpha_channel, false, encoded).apply(&mut texels);
        let mut bytes = Vec::new();
        store(format.data_type, &texels, &mut bytes);
        bytes
    }

    /// The points of a texel that are looked up: its middle, or as many as it covers of the image.
    fn points(&self, covered: [f64; 2]) -> Vec<[f64; 2]> {
        let [across, up] =
            covered.map(|n| (n * (-SLACK).exp2()).ceil().clamp(1.0, MOST_POINTS) as usize);
        let cells =
            |across: usize, up: usize| (0..up).flat_map(move |y| (0..across).map(move |x| (x, y)));
        match self.kind {
            MeshType::Triangle => cells(across, across)
                .map(|(x, y)| in_triangle(x, y, across, CENTROID))
                .collect(),
            MeshType::Quad => cells(across, up)
                .map(|(x, y)| {
                    [
                        (x as f64 + 0.5) / across as f64,
                        (y as f64 + 0.5) / up as f64,
                    ]
                })
                .collect(),
        }
    }
}
