//! Ptex files on surfaces: the right face, the right place on it, whole or in sub-faces, by every method.

use std::path::Path;

use relievo::math::Vec3;
use relievo::mesh::{ControlMesh, PtexFace, ptex_face_count, ptex_faces, ptex_kind};
use relievo::scene::{Geometry, LoadOptions, load};
use relievo::world::Method;
use relievo_ptex::{DataType, Format, Res, Writer};

use crate::common::program::Bench;
use crate::common::{options, read, run, write_scene};

/// A hexagonal prism that glows as its Ptex file says, seen from above.
const PRISM: &str = r#"
def Camera "Camera" {
    token projection = "orthographic"
    float horizontalAperture = 24
    float verticalAperture = 24
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (0, 0, 14)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DomeLight "Sky" { float inputs:intensity = 0 }
def Material "Glow" {
    token outputs:surface.connect = </Glow/Surface.outputs:surface>
    token outputs:displacement.connect = </Glow/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0, 0, 0)
        color3f inputs:emissiveColor.connect = </Glow/Ptex.outputs:rgb>
        float inputs:displacement.connect = </Glow/Ptex.outputs:r>
        token outputs:displacement
        token outputs:surface
    }
    def Shader "Ptex" {
        uniform token info:id = "RelievoPtexTexture"
        asset inputs:file = @./glow.ptx@
        token inputs:filter = "FILTER"
        float4 inputs:scale = (0.5, 0.5, 0.5, 1)
        color3f outputs:rgb
        float outputs:r
    }
}
def Mesh "Prism" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Glow>
    int[] faceVertexCounts = [6, 6, 4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5,  11, 10, 9, 8, 7, 6,  6, 7, 1, 0,  7, 8, 2, 1,  8, 9, 3, 2,  9, 10, 4, 3,  10, 11, 5, 4,  11, 6, 0, 5]
    point3f[] points = [(1, 0, 1), (0.5, 0.866, 1), (-0.5, 0.866, 1), (-1, 0, 1), (-0.5, -0.866, 1), (0.5, -0.866, 1), (1, 0, 0), (0.5, 0.866, 0), (-0.5, 0.866, 0), (-1, 0, 0), (-0.5, -0.866, 0), (0.5, -0.866, 0)]
    uniform token subdivisionScheme = "SCHEME"
}
"#;

/// The colour of a Ptex face: told from all others by its green and blue, and red like they.
fn colour(face: usize) -> [f32; 3] {
    [0.1, (face % 6) as f32 / 6.0, (face / 6) as f32 / 6.0]
}

/// A Ptex file for the first mesh of a scene, each face of a size of its own.
fn write_ptex(scene: &Path, ptex: &Path, texel: impl Fn(usize, [f32; 2]) -> [f32; 3]) {
    let description = load(scene, &LoadOptions::default()).expect("a scene");
    let Geometry::Mesh(mesh) = &description.shapes[0].geometry else {
        panic!("not a mesh");
    };
    ptex_of(mesh, texel).write(ptex).expect("a file");
}

fn ptex_of(mesh: &ControlMesh, texel: impl Fn(usize, [f32; 2]) -> [f32; 3]) -> Writer {
    let format = Format::new(ptex_kind(mesh), DataType::F32, 3);
    let mut writer = Writer::new(format, ptex_face_count(mesh)).expect("a format");
    for (number, face) in ptex_faces(mesh).into_iter().enumerate() {
        let res = size(number, &face);
        let [columns, rows] = [res.ulog2, res.vlog2].map(|log| 1 << log);
        let middle = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
        let mut texels = Vec::new();
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            let value = texel(number, [middle(x, columns), middle(y, rows)]);
            texels.extend(value.into_iter().flat_map(f32::to_le_bytes));
        }
        let stored = writer.face(number as u32, &face.info(res), &texels);
        stored.expect("texels of that size");
    }
    writer
}

fn size(number: usize, face: &PtexFace) -> Res {
    let log = if face.corner.is_some() { 1 } else { 2 } + number as i8 % 2;
    Res {
        ulog2: log,
        vlog2: log,
    }
}

/// The colours of the prism's top at a distance from its middle, in the direction of each corner.
fn top(scene: &Path, method: Method, at: f64) -> Vec<Vec3> {
    let picture = scene.with_extension("exr");
    let mut options = options(scene, &picture);
    options.resolution = Some([96, 96]);
    options.spp = 1;
    options.build.method = method.into();
    run(&options);
    let (width, _, pixels) = read(&picture);
    // An aperture of 24 tenths of a unit.
    let pixel = |x: f64| (48.0 + x / 2.4 * 96.0) as usize;
    let corner = |k: u32| {
        let angle = f64::from(k) * std::f64::consts::FRAC_PI_3;
        let (x, y) = (at * angle.cos(), -at * angle.sin());
        pixels[pixel(y) * width as usize + pixel(x)]
    };
    (0..6).map(corner).collect()
}

#[test]
fn each_sub_face_has_its_colour_by_every_method() {
    let folder = tempfile::tempdir().expect("a folder");
    for scheme in ["catmullClark", "bilinear"] {
        for filter in ["point", "consistent"] {
            let body = PRISM.replace("SCHEME", scheme).replace("FILTER", filter);
            let scene = write_scene(folder.path(), "prism.usda", &body);
            write_ptex(&scene, &folder.path().join("glow.ptx"), |face, _| {
                colour(face)
            });
            for method in Method::ALL {
                for (k, found) in top(&scene, method, 0.4).into_iter().enumerate() {
                    let wanted = 0.5 * Vec3::from(colour(k));
                    let off = (found - wanted).abs().max_element();
                    assert!(
                        off < 1e-3,
                        "{scheme}, {filter}, {}: corner {k} is {found}, not {wanted}",
                        method.name()
                    );
                }
            }
        }
    }
}

#[test]
fn u_runs_from_the_corner_along_the_edge_that_leaves_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let body = PRISM
        .replace("SCHEME", "bilinear")
        .replace("FILTER", "bilinear");
    let scene = write_scene(folder.path(), "prism.usda", &body);
    write_ptex(&scene, &folder.path().join("glow.ptx"), |_, [u, v]| {
        [0.0, u, v]
    });
    // Where the middle of a sub-face is: two thirds of the way to the corner, by symmetry of the kite.
    for method in [Method::EmbreeGrid, Method::EmbreeSubdivision] {
        for found in top(&scene, method, 0.5) {
            let [_, u, v] = (2.0 * found).to_array();
            assert!((u - v).abs() < 0.05 && (0.3..0.7).contains(&u), "{found}");
        }
    }
}

/// Four squares side by side, seen from above and lit from the right, each of which begins at another corner.
const TURNED: &str = r#"
def Camera "Camera" {
    token projection = "orthographic"
    float horizontalAperture = 40
    float verticalAperture = 40
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (0, 0, 10)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Sun" {
    float inputs:intensity = 1
    float inputs:angle = 0
    float xformOp:rotateY = 45
    uniform token[] xformOpOrder = ["xformOp:rotateY"]
}
def Material "Tilted" {
    token outputs:surface.connect = </Tilted/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.5, 0.5, 0.5)
        float inputs:ior = 1
        normal3f inputs:normal.connect = </Tilted/Ptex.outputs:rgb>
        token outputs:surface
    }
    def Shader "Ptex" {
        uniform token info:id = "RelievoPtexTexture"
        asset inputs:file = @./tilted.ptx@
        token inputs:sourceColorSpace = "raw"
        float4 inputs:scale = (2, 2, 2, 1)
        float4 inputs:bias = (-1, -1, -1, 0)
        color3f outputs:rgb
    }
}
def Mesh "Squares" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Tilted>
    uniform token subdivisionScheme = "bilinear"
    int[] faceVertexCounts = [4, 4, 4, 4TRIANGLE]
    int[] faceVertexIndices = [0, 1, 6, 5, 2, 7, 6, 1, 8, 7, 2, 3, 8, 3, 4, 9CORNERS]
    point3f[] points = [(-2, -1, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0), (2, -1, 0),
                        (-2, 1, 0), (-1, 1, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0),
                        (9, 9, 0), (10, 9, 0), (9, 10, 0)]
}
"#;

#[test]
fn normals_follow_the_parameters_of_faces() {
    let folder = tempfile::tempdir().expect("a folder");
    let normal = Vec3::new(0.3, -0.5, 0.8).normalize();
    // u runs to the right, up, to the left, down; v a quarter turn further.
    let to_the_right = [normal.x, -normal.y, -normal.x, normal.y];
    // A triangle beside them cuts all faces into quarters, each with parameters of its own.
    for (triangle, corners) in [("", ""), (", 3", ", 10, 11, 12")] {
        let body = TURNED.replace("TRIANGLE", triangle);
        let scene = write_scene(
            folder.path(),
            "squares.usda",
            &body.replace("CORNERS", corners),
        );
        let stored = (0.5 * (normal + 1.0)).to_array();
        write_ptex(&scene, &folder.path().join("tilted.ptx"), |_, _| stored);
        for method in [Method::EmbreeGrid, Method::EmbreeSubdivision] {
            let picture = scene.with_extension("exr");
            let mut options = options(&scene, &picture);
            options.resolution = Some([64, 64]);
            options.spp = 1;
            options.build.method = method.into();
            run(&options);
            let pixels = read(&picture).2;
            let seen = |square: usize, y: usize| pixels[y * 64 + 8 + 16 * square].x;
            // Both factors of the light's share: a flat square would have a normal of (0, 0, 1).
            let shares = to_the_right.map(|x| (x + normal.z).max(0.0));
            for (square, share) in shares.into_iter().enumerate() {
                for y in [20, 30, 40] {
                    let found = seen(square, y) / seen(0, 30) * shares[0];
                    let name = method.name();
                    assert!(
                        (found - share).abs() < 2e-3,
                        "{name} {square}: {found}, not {share}"
                    );
                }
            }
        }
    }
}

#[test]
fn what_does_not_fit_the_mesh_is_bad_input() {
    let bench = Bench::new();
    let body = PRISM
        .replace("SCHEME", "catmullClark")
        .replace("FILTER", "bilinear");
    bench.write("prism.usda", format!("#usda 1.0\n{body}"));

    let (code, said) = bench.render("prism.usda", &[]);
    assert_eq!(code, 3, "{said}");
    assert!(
        said.contains("glow.ptx") && said.contains("/Glow/Ptex"),
        "{said}"
    );
    let (code, said) = bench.render("prism.usda", &["--missing-textures", "magenta"]);
    assert_eq!(code, 0, "{said}");

    // A file for another mesh.
    let format = Format::new(relievo_ptex::MeshType::Quad, DataType::U8, 3);
    let other = Writer::new(format, 6).expect("a format");
    other.write(bench.path("glow.ptx")).expect("a file");
    let (code, said) = bench.render("prism.usda", &[]);
    assert_eq!(code, 3, "{said}");
    for word in ["18 Ptex faces", "6 quads", "/Prism", "/Glow"] {
        assert!(said.contains(word), "{word}: {said}");
    }

    // Damaged where no header tells: texels that are read while rays are traced.
    let scene = bench.path("prism.usda");
    write_ptex(&scene, &bench.path("glow.ptx"), |face, [u, v]| {
        [u, v, face as f32]
    });
    let mut bytes = std::fs::read(bench.path("glow.ptx")).expect("the file");
    let middle = bytes.len() / 2;
    bytes[middle..middle + 64].fill(0x5a);
    bench.write("glow.ptx", bytes);
    let (code, said) = bench.render("prism.usda", &[]);
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("glow.ptx"), "{said}");

    // No subdivision surface.
    let body = body.replace("catmullClark", "none");
    bench.write("prism.usda", format!("#usda 1.0\n{body}"));
    let (code, said) = bench.render("prism.usda", &[]);
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("subdivision"), "{said}");
}

#[test]
fn a_ptex_file_on_an_ordinary_texture_is_bad_input() {
    let bench = Bench::new();
    let body = PRISM
        .replace("SCHEME", "catmullClark")
        .replace("RelievoPtexTexture", "UsdUVTexture");
    bench.write("prism.usda", format!("#usda 1.0\n{body}"));
    let format = Format::new(relievo_ptex::MeshType::Quad, DataType::U8, 3);
    let file = Writer::new(format, 18).expect("a format");
    for name in ["glow.ptx", "glow.png"] {
        // Not its name says what it is.
        let body = body.replace("glow.ptx", name);
        bench.write("prism.usda", format!("#usda 1.0\n{body}"));
        file.write(bench.path(name)).expect("a file");
        let (code, said) = bench.render("prism.usda", &[]);
        assert_eq!(code, 3, "{said}");
        for word in [name, "/Glow/Ptex", "RelievoPtexTexture"] {
            assert!(said.contains(word), "{word}: {said}");
        }
    }
}
