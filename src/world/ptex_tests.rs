//! A closed surface that Ptex displaces, face by face of another size, has no holes.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use relievo_ptex::{DataType, Format, Res, Writer};

use super::textures::Textures;
use super::{BuildOptions, How, Method, objects};
use crate::accel::{CacheSize, MaxError};
use crate::error::Warnings;
use crate::image::PtexTexture;
use crate::math::{Area, Ray, Vec2, Vec3};
use crate::memory::Budget;
use crate::mesh::{ControlMesh, ptex_face_count, ptex_faces, ptex_kind};
use crate::scene::{Geometry, LoadOptions, load};
use crate::surface::tests::effort;
use crate::surface::tests::shapes::Random;
use crate::surface::{Rates, Surface, edge_uv};
use crate::trace::{Device, DeviceOptions, SceneBuilder};

/// A prism of hexagons and quads: whole faces meet two sub-faces, and three faces meet at each corner.
const PRISM: &str = r#"#usda 1.0
def Material "Rough" {
    token outputs:displacement.connect = </Rough/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:displacement.connect = </Rough/Heights.outputs:r>
        token outputs:displacement
    }
    def Shader "Heights" {
        uniform token info:id = "RelievoPtexTexture"
        asset inputs:file = @./heights.ptx@
        float4 inputs:scale = (0.2, 0.2, 0.2, 1)
        float outputs:r
    }
}
def Mesh "Prism" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Rough>
    int[] faceVertexCounts = [6, 6, 4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5,  11, 10, 9, 8, 7, 6,  6, 7, 1, 0,  7, 8, 2, 1,  8, 9, 3, 2,  9, 10, 4, 3,  10, 11, 5, 4,  11, 6, 0, 5]
    point3f[] points = [(1, 0, 1), (0.5, 0.866, 1), (-0.5, 0.866, 1), (-1, 0, 1), (-0.5, -0.866, 1), (0.5, -0.866, 1), (1, 0, -1), (0.5, 0.866, -1), (-0.5, 0.866, -1), (-1, 0, -1), (-0.5, -0.866, -1), (0.5, -0.866, -1)]
    uniform token subdivisionScheme = "catmullClark"
}
"#;

/// Random heights, from one texel a face to 16 x 64.
fn heights(mesh: &ControlMesh) -> Writer {
    let format = Format::new(ptex_kind(mesh), DataType::F32, 1);
    let mut writer = Writer::new(format, ptex_face_count(mesh)).expect("a format");
    let mut random = Random(7);
    for (number, face) in (0..).zip(ptex_faces(mesh)) {
        let res = Res {
            ulog2: (number % 5) as i8,
            vlog2: (number % 7) as i8,
        };
        let texels: Vec<u8> = (0..1 << (res.ulog2 + res.vlog2))
            .flat_map(|_| random.next().to_le_bytes())
            .collect();
        let stored = writer.face(number, &face.info(res), &texels);
        stored.expect("texels of that size");
    }
    writer
}

fn rough_prism() -> Surface {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("prism.usda");
    std::fs::write(&path, PRISM).expect("the folder takes files");
    let scene = load(&path, &LoadOptions::default()).expect("a scene");
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else {
        panic!("not a mesh");
    };
    let written = heights(mesh).write(folder.path().join("heights.ptx"));
    written.expect("the folder takes files");
    let object = objects(&scene, &Budget::default(), &mut Warnings::default())
        .expect("a surface")
        .remove(0);
    std::sync::Arc::into_inner(object.surface).expect("held once")
}

#[test]
fn both_faces_at_an_edge_are_displaced_alike() {
    let surface = rough_prism();
    let base = surface.base();
    let mut sides: std::collections::BTreeMap<u32, Vec<(u32, u32, bool)>> = Default::default();
    for face in 0..base.faces() {
        for k in 0..4 {
            let edge = base.edge(face, k);
            let side = (face, k, edge.reversed);
            sides.entry(edge.edge).or_default().push(side);
        }
    }
    assert!(sides.values().all(|sides| sides.len() == 2));
    // Limit points differ by roundings from side to side, and heights do not: so much is left of 0.2.
    let scale = 1e-5;
    for sides in sides.values() {
        for i in 0..=64 {
            let t = i as f32 / 64.0;
            let [a, b] = [0, 1].map(|s| {
                let (face, k, reversed) = sides[s];
                let uv = edge_uv(k, if reversed { 1.0 - t } else { t });
                surface.evaluate(face, uv, 0)
            });
            let off = a.position.distance(b.position);
            // At vertices of three faces limit normals agree, too.
            assert!(off < scale, "{sides:?} at {t}: {off:e}");
        }
    }
}

/// A million rays (times `RELIEVO_EFFORT`) by each way to trace.
#[test]
fn no_ray_escapes_what_ptex_displaces() {
    let surface = std::sync::Arc::new(rough_prism());
    let device = Device::new(&DeviceOptions::default()).expect("a device");
    let rates = Rates::by_edge(&surface, |edge| 3 + (edge * 7 + edge / 3) % 14);
    let faces = surface.base().faces();
    let mut lost = Vec::new();
    for method in Method::ALL {
        let how = How {
            max_error: MaxError::Usual,
            cache: &method.cache(CacheSize::default()),
            go_on: &|_| true,
            keep: None,
        };
        let built = method
            .build(&surface, &rates, &device, how)
            .expect("a surface");
        let mut builder = SceneBuilder::new(&device, method.scene_options()).expect("a scene");
        builder.attach(built.geometry);
        let scene = builder.commit(&|_| true).expect("a scene");
        let escaped = AtomicUsize::new(0);
        let rays = effort(1_000_000);
        (0..64_usize).into_par_iter().for_each(|part| {
            let mut random = Random(part as u64 + 1);
            for i in 0..rays / 64 {
                let origin = 0.2 * Vec3::new(random.next(), random.next(), random.next());
                let towards = if i % 2 == 0 {
                    Vec3::new(random.next(), random.next(), random.next()) - 0.5
                } else {
                    // Along the rim of a face, where faces meet.
                    let face = ((random.next() * faces as f32) as u32).min(faces - 1);
                    let k = ((random.next() * 4.0) as u32).min(3);
                    let uv: Vec2 = edge_uv(k, random.next());
                    surface.evaluate(face, uv, 0).position - origin
                };
                let ray = Ray::new(origin, towards, 0.0);
                if towards.length() > 1e-3 && !scene.occluded(&ray) {
                    escaped.fetch_add(1, Ordering::Relaxed);
                }
            }
        });
        let escaped = escaped.into_inner();
        println!("{}: {escaped} of {rays}", method.name());
        lost.push((method, escaped));
    }
    // Embree's edge test contradicts itself for some rays that meet a micro-vertex to the bit: see the diced surfaces'
    // tests of the trace module. Of rays that are aimed at edges few are such.
    let allowed = |method: Method| match method {
        Method::Tessellated
        | Method::Compact
        | Method::Compressed
        | Method::Cache
        | Method::Dbvh
        | Method::Nonlinear => 0,
        _ => effort(1_000_000) / 10_000_000,
    };
    lost.retain(|&(method, escaped)| escaped > allowed(method));
    assert!(lost.is_empty(), "{lost:?}");
}

/// However many nodes read a file, and displacement beside them.
#[test]
fn a_file_is_held_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("prism.usda");
    let colours = r#"
        color3f inputs:diffuseColor.connect = </Rough/Heights.outputs:rgb>
        color3f inputs:emissiveColor.connect = </Rough/Plain.outputs:rgb>
        token outputs:surface
    }
    def Shader "Plain" {
        uniform token info:id = "RelievoPtexTexture"
        asset inputs:file = @./heights.ptx@
        token inputs:sourceColorSpace = "raw"
        color3f outputs:rgb
    }
    def Shader "Heights" {
        color3f outputs:rgb"#;
    let scene = PRISM
        .replace("    }\n    def Shader \"Heights\" {", colours)
        .replace(
            "def Material \"Rough\" {",
            "def Material \"Rough\" {\n    token outputs:surface.connect = </Rough/Surface.outputs:surface>",
        );
    std::fs::write(&path, scene).expect("the folder takes files");
    let scene = load(&path, &LoadOptions::default()).expect("a scene");
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else {
        panic!("not a mesh");
    };
    let written = heights(mesh).write(folder.path().join("heights.ptx"));
    written.expect("the folder takes files");
    let (options, budget) = (BuildOptions::default(), Budget::default());
    let textures = Textures::load(&scene, &options, &budget, &mut Warnings::default());
    let textures = textures.expect("a file");
    assert_eq!(textures.files().count(), 3);
    let look = |texture: &PtexTexture| {
        for face in 0..ptex_face_count(mesh) {
            texture.eval(face, Vec2::splat(0.5), &Area::POINT);
        }
        assert!(texture.fault().is_none());
        textures.memory()
    };
    let held: Vec<usize> = textures.files().map(|texture| look(texture)).collect();
    assert!(
        held[0] > 0 && held.iter().all(|bytes| *bytes == held[0]),
        "{held:?}"
    );
}
