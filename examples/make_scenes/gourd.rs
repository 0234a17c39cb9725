//! The gourd's Ptex files: warts around points that are spread over a sphere, painted on the limit surface itself.

use std::path::Path;
use std::sync::Arc;

use relievo::error::{Fault, Result};
use relievo::math::{Vec2, Vec3};
use relievo::mesh::{ControlMesh, PtexFace, ptex_face_count, ptex_faces};
use relievo::scene::{Geometry, LoadOptions, load};
use relievo::surface::{Base, Subdivision};
use relievo_ptex::{DataType, Format, MeshType, Res, Writer};

/// Points that warts are around.
const WARTS: u32 = 260;

/// What is painted: a colour, or a height.
pub(crate) fn write(scene: &str, what: &str, path: &str) -> Result<()> {
    let mesh = &mesh(scene)?;
    let (data_type, channels) = match what {
        "colours" => (DataType::U8, 3),
        _ => (DataType::U16, 1),
    };
    let format = Format::new(MeshType::Quad, data_type, channels);
    let mut writer = Writer::new(format, ptex_face_count(mesh))?;
    let surface = Subdivision::new(mesh, None);
    let warts = Warts::new();
    for (number, face) in (0..).zip(ptex_faces(mesh)) {
        // Faces side by side have different sizes: the filter does not show it.
        let size = if face.corner.is_some() {
            6
        } else {
            7 + number % 3
        };
        let res = Res {
            ulog2: size as i8,
            vlog2: (size - number % 2) as i8,
        };
        let mut texels = Vec::new();
        for place in middles(res) {
            let wart = warts.at(point(mesh, &surface, &face, place));
            if channels == 3 {
                texels.extend(wart.colour().map(|c| (c * 255.0).round() as u8));
            } else {
                texels.extend(((wart.height() * 65535.0).round() as u16).to_le_bytes());
            }
        }
        writer.face(number, &face.info(res), &texels)?;
    }
    if let Some(folder) = Path::new(path).parent() {
        std::fs::create_dir_all(folder)
            .map_err(|e| Fault::new(format!("cannot be made: {e}")).in_file(folder))?;
    }
    Ok(writer.write(path)?)
}

/// The gourd of a scene.
pub(crate) fn mesh(scene: &str) -> Result<Arc<ControlMesh>> {
    let description = load(Path::new(scene), &LoadOptions::default())?;
    let gourd = description
        .shapes
        .into_iter()
        .find_map(|shape| match shape.geometry {
            Geometry::Mesh(mesh) if shape.path.ends_with("/Gourd") => Some(mesh),
            _ => None,
        });
    let fault = || Fault::new("there is no mesh named Gourd").in_file(scene);
    Ok(gourd.ok_or_else(fault)?)
}

/// The middles of all texels, row by row.
fn middles(res: Res) -> impl Iterator<Item = Vec2> {
    let [columns, rows] = [res.ulog2, res.vlog2].map(|log| 1_u32 << log);
    let middle = |i: u32, n: u32| (i as f32 + 0.5) / n as f32;
    (0..rows).flat_map(move |y| {
        (0..columns).map(move |x| Vec2::new(middle(x, columns), middle(y, rows)))
    })
}

/// The limit point at a place of a Ptex face.
fn point(mesh: &ControlMesh, surface: &Subdivision, face: &PtexFace, uv: Vec2) -> Vec3 {
    debug_assert!(mesh.points.len() == 1, "it does not move");
    let (part, uv) = surface.of_cage(face.face, face.corner, uv);
    surface.evaluate(part, uv, 0).position
}

/// Directions that warts are around.
struct Warts(Vec<Vec3>);

/// How near the nearest wart and the next one are: the cosines of the angles to them.
#[derive(Clone, Copy)]
struct Wart {
    nearest: f32,
    next: f32,
    /// 0 to 1, another for each wart.
    shade: f32,
    up: f32,
}

impl Warts {
    /// Evenly by the golden angle, and each a little off its place.
    fn new() -> Self {
        let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
        let one = |i: u32| {
            let y = 1.0 - 2.0 * (i as f32 + 0.5) / WARTS as f32;
            let angle = golden * i as f32 + 0.35 * super::noise::hash(super::SEED, i as i32, 1);
            let radius = (1.0 - y * y).sqrt();
            Vec3::new(radius * angle.cos(), y, radius * angle.sin())
        };
        Self((0..WARTS).map(one).collect())
    }

    fn at(&self, p: Vec3) -> Wart {
        let direction = p.normalize();
        let mut wart = Wart {
            nearest: -1.0,
            next: -1.0,
            shade: 0.0,
            up: p.y,
        };
        for (i, centre) in self.0.iter().enumerate() {
            let near = centre.dot(direction);
            if near > wart.nearest {
                wart.next = wart.nearest;
                wart.nearest = near;
                wart.shade = super::noise::hash(super::SEED, i as i32, 2);
            } else if near > wart.next {
                wart.next = near;
            }
        }
        wart
    }
}

impl Wart {
    /// 0 between warts, 1 on top of one.
    fn height(self) -> f32 {
        let [near, far] = [self.nearest, self.next].map(|cos| cos.clamp(-1.0, 1.0).acos());
        let inside = ((far - near) / (far + near)).clamp(0.0, 1.0);
        let size = 0.35 + 0.65 * self.shade;
        size * (1.0 - (1.0 - inside).powi(3))
    }

    /// Encoded as sRGB.
    fn colour(self) -> [f32; 3] {
        let (low, high) = (Vec3::new(0.36, 0.42, 0.16), Vec3::new(0.93, 0.63, 0.18));
        let ripe = (0.5 + 0.5 * (1.4 * self.up).sin()).clamp(0.0, 1.0);
        let skin = low.lerp(high, ripe);
        let top = Vec3::new(0.98, 0.86, 0.52).lerp(skin, 0.7 * self.shade);
        skin.lerp(top, self.height())
            .to_array()
            .map(|c| c.clamp(0.0, 1.0))
    }
}
