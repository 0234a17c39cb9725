//! `relievo bake`: a dense mesh becomes displacement over a cage, and the displaced cage becomes the dense mesh.

mod fit;
mod image;
mod models;
mod vector;

use std::io::{BufRead, BufReader};
use std::process::Command;
use std::sync::Arc;

use relievo::image::{
    ColorSpace, ImageSource, PtexFilter, PtexHeights, PtexOptions, PtexTexture, Texture, Wrap,
};
use relievo::math::{DVec3, Vec2, Vec3};
use relievo::scene::{LoadOptions, obj};
use relievo::surface::{
    Amount, Carrier, Channels, Displacement, DisplacementMap, Function, ImageMap, Subdivision,
    Surface,
};
use relievo_ptex::{Cache, DataType, MeshType};
use serde_json::Value;

use crate::common::program::{Bench, expect, said};
use crate::common::sound::open;
use crate::common::{mean, options, read, run};
use models::{Model, bump, cube_sphere, lifted, octahedron_sphere, off};

fn bake(bench: &Bench, arguments: &[&str]) -> (i32, String) {
    let mut all = vec!["bake", "--progress", "none"];
    all.extend(arguments);
    said(&bench.command(&all).output().expect("the program runs"))
}

/// Bakes, or fails the test; what is told.
fn report(bench: &Bench, arguments: &[&str]) -> Value {
    let mut all = vec!["bake", "--json", "--progress", "none"];
    all.extend(arguments);
    bench.report(&all)
}

fn number(report: &Value, name: &str) -> f64 {
    let value = &report[name];
    value.as_f64().unwrap_or_else(|| panic!("{name}: {report}"))
}

/// How far the report says it is from the dense mesh at most.
fn largest(report: &Value) -> f64 {
    number(&report["residual"], "largest")
}

/// A Ptex file as displacement reads it.
fn consistent(image: &ImageSource) -> PtexTexture {
    let options = PtexOptions {
        filter: PtexFilter::Consistent,
        first_channel: 0,
        color_space: ColorSpace::Raw,
    };
    let reader = PtexTexture::open(image, &Cache::default()).expect("a Ptex file");
    PtexTexture::new(reader, &options).expect("its first channel")
}

/// A cage, displaced by a Ptex file or an image as renders do it.
fn displaced(bench: &Bench, cage: &str, file: &str) -> Surface {
    let scene = obj::load(&bench.path(cage), &LoadOptions::default()).expect("a cage");
    let mesh = scene.shapes[0].geometry.mesh().expect("a mesh");
    let base = Arc::new(Subdivision::new(mesh, Some("st")));
    let image = ImageSource::File(bench.path(file));
    let map: Arc<dyn DisplacementMap> = if file.ends_with(".exr") {
        let texture = Texture::load(&image, [Wrap::Clamp; 2], ColorSpace::Raw).expect("an image");
        Arc::new(ImageMap::new(Arc::new(texture), Channels::Scalar))
    } else {
        let heights = PtexHeights::new(Arc::new(consistent(&image)), 0);
        let carrier = base.clone();
        Arc::new(Function::scalar(move |at| {
            let (face, uv) = carrier.ptex(at.face, at.uv).expect("a Ptex face");
            heights.eval(face, uv)
        }))
    };
    let amount = Amount {
        map,
        scale: 1.0,
        bias: 0.0,
    };
    Surface::new(base, Displacement::Scalar(amount))
}

/// Places all over a surface, `n` x `n` on each face.
fn points(surface: &Surface, n: u32) -> impl Iterator<Item = DVec3> + '_ {
    let places = move |face: u32| {
        let part = move |i: u32| (i as f32 + 0.37) / n as f32;
        let places = (0..n).flat_map(move |y| (0..n).map(move |x| Vec2::new(part(x), part(y))));
        places.map(move |uv| (face, uv))
    };
    (0..surface.base().faces())
        .flat_map(places)
        .map(|(face, uv)| surface.evaluate(face, uv, 0).position.as_dvec3())
}

#[test]
fn a_plane_above_a_plane_is_its_height_everywhere() {
    let bench = Bench::new();
    let plane = |z: f64, n: i32| {
        let mut text = String::new();
        for (i, j) in (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))) {
            let [x, y] = [i, j].map(|i| 4.0 * f64::from(i) / f64::from(n) - 2.0);
            text += &format!("v {x} {y} {z}\n");
        }
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            let a = j * (n + 1) + i + 1;
            text += &format!("f {a} {} {} {}\n", a + 1, a + n + 2, a + n + 1);
        }
        text
    };
    bench.write("cage.obj", plane(0.0, 2));
    for height in [0.25, -0.125, 0.0] {
        bench.write("dense.obj", plane(height, 16));
        let report = report(&bench, &["dense.obj", "cage.obj", "-o", "flat.ptx"]);
        for name in ["least", "greatest"] {
            assert!((number(&report, name) - height).abs() < 1e-7, "{report}");
        }
        assert_eq!(
            (&report["missed"], &report["cage_faces"]),
            (&0.into(), &4.into())
        );
        // Eight edges of the dense mesh along each side of a face.
        let reader = open(&bench, "flat.ptx");
        let res = reader.face(0).res;
        assert_eq!((res.ulog2, res.vlog2), (3, 3));
        let constant = reader.face(0).constant;
        assert!(constant, "{height}");
    }
}

/// Every kind of cage, and faces of different sizes side by side.
#[test]
fn every_kind_of_cage_becomes_the_dense_sphere() {
    let bench = Bench::new();
    bench.write("dense.obj", cube_sphere(80).moved(lifted).obj());
    let creases = "t crease 2/1/0 0 1 2\nt crease 2/1/0 1 2 2.5\nt corner 1/1/0 3 1\n";
    let quads = cube_sphere(3).obj();
    let triangles = octahedron_sphere(1).obj();
    let cages = [
        ("catmark_quads.obj", quads.clone(), MeshType::Quad),
        ("catmark_creases.obj", quads + creases, MeshType::Quad),
        ("catmark_triangles.obj", triangles.clone(), MeshType::Quad),
        ("loop_triangles.obj", triangles, MeshType::Triangle),
        (
            "catmark_lefthanded.obj",
            cube_sphere(3).turned().obj(),
            MeshType::Quad,
        ),
    ];
    for (cage, text, kind) in cages {
        bench.write(cage, text);
        let report = report(&bench, &["dense.obj", cage, "-o", "out.ptx"]);
        let reader = open(&bench, "out.ptx");
        assert_eq!(reader.mesh_type(), kind);
        assert_eq!(
            (&report["missed"], &report["turned"]),
            (&0.into(), &false.into()),
            "{cage}"
        );
        let half_a_step = 0.5 * number(&report, "step");
        assert!(largest(&report) < half_a_step, "{cage}: {report}");
        // As it was told, seen from the shape's formula; facets are up to 3e-4 off it.
        let surface = displaced(&bench, cage, "out.ptx");
        let worst = points(&surface, 24).map(off).fold(0.0, f64::max);
        println!("{cage}: {worst:.2e} off, step {:.2e}", 2.0 * half_a_step);
        assert!(worst < half_a_step + 3e-4, "{cage}: {worst}");
    }
}

#[test]
fn what_is_missed_is_filled_from_around_and_told() {
    let bench = Bench::new();
    bench.write("cage.obj", cube_sphere(3).obj());
    let dense = cube_sphere(60).moved(lifted);
    let hole = DVec3::new(0.3, 0.2, 1.0).normalize();
    let open = dense.without(|p| p.normalize().dot(hole) > 0.97);
    bench.write("dense.obj", open.obj());
    let arguments = ["dense.obj", "cage.obj", "-o", "out.ptx"];
    let told = report(&bench, &arguments);
    let (missed, texels) = (number(&told, "missed"), number(&told, "texels"));
    // A cap of this angle is 0.015 of the sphere.
    assert!((0.01..0.02).contains(&(missed / texels)), "{told}");
    let surface = displaced(&bench, "cage.obj", "out.ptx");
    for p in points(&surface, 24) {
        // Within the hole nothing is known but that it lies between what is around.
        let bound = if p.normalize().dot(hole) > 0.965 {
            0.13
        } else {
            4e-3
        };
        assert!(off(p) < bound, "{p}: {}", off(p));
        assert!((0.93..1.07).contains(&p.length()), "{p}");
    }
    expect(
        bake(&bench, &arguments),
        0,
        &["met nothing", "filled from around"],
    );
    let near = [&arguments[..], &["--reach", "0.06"]].concat();
    let nearer = report(&bench, &near);
    assert!(number(&nearer, "missed") > 10.0 * missed, "{nearer}");
    assert!(number(&nearer, "greatest") <= 0.06, "{nearer}");
}

/// A shell in a shell, as modellers make walls: each of them faces its own way.
#[test]
fn what_faces_away_does_not_count() {
    let bench = Bench::new();
    let cage = cube_sphere(3);
    bench.write("cage.obj", cage.obj());
    // The limit surface has a radius of 0.85 to 0.89: the inner shell is nearer.
    let outer = cube_sphere(40);
    let inner = outer.moved(|p| 0.9 * p).turned();
    let shift = outer.points.len();
    let mut wall = outer.clone();
    wall.points.extend(&inner.points);
    let shifted = |face: &Vec<usize>| face.iter().map(|v| v + shift).collect();
    wall.faces.extend(inner.faces.iter().map(shifted));
    bench.write("wall.obj", wall.obj());
    bench.write("outer.obj", outer.obj());
    let of = |dense: &str, more: &[&str]| {
        let arguments = [&[dense, "cage.obj", "-o", "out.ptx"], more].concat();
        let told = report(&bench, &arguments);
        assert_eq!(told["missed"], 0, "{told}");
        let surface = displaced(&bench, "cage.obj", "out.ptx");
        let radii: Vec<f64> = points(&surface, 5).map(DVec3::length).collect();
        (radii.iter().sum::<f64>() / radii.len() as f64, told)
    };
    let (alone, _) = of("outer.obj", &[]);
    assert!((alone - 1.0).abs() < 1e-3, "{alone}");
    let (outside, told) = of("wall.obj", &[]);
    assert!((outside - alone).abs() < 1e-4, "{outside} {told}");
    let (nearest, told) = of("wall.obj", &["--two-sided"]);
    assert!((nearest - 0.9).abs() < 1e-3, "{nearest} {told}");
    // Turned as a whole, it is taken as it is meant.
    bench.write("turned.obj", outer.turned().obj());
    let (turned, told) = of("turned.obj", &[]);
    assert!((turned - alone).abs() < 5e-4, "{turned} {told}");
    assert_eq!(told["turned"], true);
}

#[test]
fn threads_do_not_change_a_byte_and_sizes_are_as_asked() {
    let bench = Bench::new();
    bench.write("cage.obj", octahedron_sphere(1).obj());
    let dense = cube_sphere(50).moved(lifted);
    let dense = dense.without(|p| p.x > 0.95);
    bench.write("dense.obj", dense.obj());
    for (name, threads) in [("one.ptx", "1"), ("two.ptx", "2"), ("five.ptx", "5")] {
        report(
            &bench,
            &["dense.obj", "cage.obj", "-o", name, "-t", threads],
        );
    }
    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("written");
    assert_eq!(bytes("one.ptx"), bytes("two.ptx"));
    assert_eq!(bytes("one.ptx"), bytes("five.ptx"));

    let more = ["--texels", "16", "--type", "half"];
    let arguments = [&["dense.obj", "cage.obj", "-o", "half.ptx"][..], &more].concat();
    report(&bench, &arguments);
    let reader = open(&bench, "half.ptx");
    assert_eq!(reader.data_type(), DataType::F16);
    let all = (0..reader.face_count()).map(|face| reader.face(face).res);
    assert!(all.into_iter().all(|res| (res.ulog2, res.vlog2) == (4, 4)));

    let finer = ["dense.obj", "cage.obj", "-o", "fine.ptx", "--rate", "4"];
    report(&bench, &finer);
    let (usual, fine) = (open(&bench, "one.ptx"), open(&bench, "fine.ptx"));
    for face in 0..usual.face_count() {
        let [a, b] = [&usual, &fine].map(|reader| reader.face(face).res);
        assert_eq!((a.ulog2 + 2, a.vlog2 + 2), (b.ulog2, b.vlog2), "{face}");
    }
}

#[test]
fn bad_input_is_named_with_its_place() {
    let bench = Bench::new();
    let sphere = cube_sphere(3);
    bench.write("cage.obj", sphere.obj());
    bench.write("dense.obj", cube_sphere(9).obj());
    bench.write("empty.obj", "v 0 0 0\n");
    bench.write("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n");
    bench.write("far.obj", sphere.moved(|p| p + 100.0 * DVec3::X).obj());
    bench.write(
        "quad.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 3 7\n",
    );
    let fin = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 0 -1\nv 0 0 -1\n\
               f 1 2 3 4\nf 2 1 5 6\nf 1 2 7 8\n";
    bench.write("fin.obj", fin);
    let bow = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv -1 0 0\nv -1 -1 0\nf 1 2 3\nf 1 4 5\n";
    bench.write("bow.obj", bow);
    bench.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    let cases: &[(&[&str], i32, &[&str])] = &[
        (
            &["none.obj", "cage.obj"],
            3,
            &["none.obj", "cannot be read"],
        ),
        (
            &["dense.obj", "none.obj"],
            3,
            &["none.obj", "cannot be read"],
        ),
        (&["empty.obj", "cage.obj"], 3, &["empty.obj", "no faces"]),
        (&["dense.obj", "empty.obj"], 3, &["empty.obj", "no faces"]),
        (&["nan.obj", "cage.obj"], 3, &["nan.obj", "line 2", "nan"]),
        (&["flat.obj", "cage.obj"], 3, &["flat.obj", "area"]),
        (
            &["quad.obj", "cage.obj"],
            3,
            &["quad.obj", "line 6", "face 1", "point 7"],
        ),
        (
            &["dense.obj", "cage.obj", "--scheme", "loop"],
            3,
            &["cage.obj", "face 0", "Loop"],
        ),
        (
            &["dense.obj", "fin.obj"],
            3,
            &["fin.obj", "face 2", "3 faces", "0 to 1"],
        ),
        (
            &["dense.obj", "bow.obj"],
            3,
            &["bow.obj", "face 0", "point 0", "manifold"],
        ),
        (
            &["far.obj", "cage.obj"],
            3,
            &["far.obj", "meets it within", "--reach"],
        ),
        (
            &["dense.obj", "cage.obj", "--texels", "1048576"],
            3,
            &["cage.obj", "face", "--texels"],
        ),
        (
            &["dense.obj", "cage.obj", "--texels", "3"],
            2,
            &["power of two"],
        ),
        (&["dense.obj", "cage.obj", "--reach", "0"], 2, &["above 0"]),
        (
            &["dense.obj", "cage.obj", "-o", "out.png"],
            2,
            &["out.png", ".ptx"],
        ),
        (
            &["dense.obj", "cage.obj", "-o", "none/out.ptx"],
            1,
            &["none/out.ptx", "folder"],
        ),
    ];
    for (arguments, code, words) in cases {
        let mut all = arguments.to_vec();
        if !all.contains(&"-o") {
            all.extend(["-o", "out.ptx"]);
        }
        expect(bake(&bench, &all), *code, words);
    }
    let left = std::fs::read_dir(bench.folder()).expect("a folder");
    let left = left.map(|entry| entry.expect("an entry").file_name());
    assert!(
        left.into_iter()
            .all(|name| name.to_string_lossy().ends_with(".obj"))
    );
}

#[test]
fn an_interrupt_leaves_nothing() {
    let bench = Bench::new();
    bench.write("cage.obj", cube_sphere(8).obj());
    bench.write("dense.obj", cube_sphere(60).moved(lifted).obj());
    let mut child = bench
        .command(&["bake", "dense.obj", "cage.obj", "-o", "out.ptx"])
        .args(["--texels", "1024", "--progress", "json"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the program runs");
    let lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let mut sent = false;
    for line in lines.map(|line| line.expect("a line of text")) {
        let value: Value = serde_json::from_str(&line).expect("every line is JSON");
        if !sent && value["stage"] == "bake" {
            sent = true;
            let kill = format!("kill -INT {}", child.id());
            let status = Command::new("sh").args(["-c", &kill]).status();
            status.expect("a signal");
        }
    }
    assert_eq!(child.wait().expect("an end").code(), Some(130));
    assert_eq!(
        std::fs::read_dir(bench.folder()).expect("a folder").count(),
        2
    );
}

/// A scene with a model of clay under a light; `heights` is a Ptex file that displaces it.
fn clay(model: &Model, scheme: &str, heights: Option<&str>) -> String {
    let [connected, output, shader] = match heights {
        None => [const { String::new() }; 3],
        Some(file) => [
            "token outputs:displacement.connect = </Clay/Surface.outputs:displacement>".to_owned(),
            "float inputs:displacement.connect = </Clay/Heights.outputs:r>\n        \
             token outputs:displacement"
                .to_owned(),
            format!(
                "def Shader \"Heights\" {{\n        uniform token info:id = \"RelievoPtexTexture\"\n        \
                 asset inputs:file = @./{file}@\n        float outputs:r\n    }}"
            ),
        ],
    };
    let attributes = format!(
        "    rel material:binding = </Clay>\n    uniform token subdivisionScheme = \"{scheme}\"\n"
    );
    format!(
        r#"#usda 1.0
def Camera "Camera" {{
    float focalLength = 50
    float horizontalAperture = 20
    float verticalAperture = 20
    double3 xformOp:translate = (0, 0, 6.2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def DistantLight "Key" {{
    float inputs:intensity = 2
    float inputs:angle = 0
    float3 xformOp:rotateXYZ = (-35, 40, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}}
def DomeLight "Sky" {{ float inputs:intensity = 0.3 }}
def Material "Clay" {{
    token outputs:surface.connect = </Clay/Surface.outputs:surface>
    {connected}
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.6, 0.55, 0.5)
        float inputs:roughness = 0.5
        token outputs:surface
        {output}
    }}
    {shader}
}}
{}"#,
        model.usda(&attributes)
    )
}

/// The root of the mean square of what two pictures differ by, as a part of the first one's mean.
fn difference(a: &[Vec3], b: &[Vec3]) -> f64 {
    let squares = a
        .iter()
        .zip(b)
        .map(|(a, b)| f64::from((*a - *b).length_squared()));
    let rms = (squares.sum::<f64>() / (3 * a.len()) as f64).sqrt();
    rms / f64::from(mean(a).element_sum() / 3.0)
}

/// A million triangles on 96 faces. A texel's height step is the largest difference of the heights of two texels side by
/// side; what the file displaces the cage to is everywhere within half of that from the dense mesh.
#[test]
fn a_million_triangles_come_back_within_half_a_step_and_look_the_same() {
    let bench = Bench::new();
    let (cage, dense) = (cube_sphere(4), cube_sphere(290).moved(lifted));
    bench.write("cage.obj", cage.obj());
    bench.write("dense.obj", dense.obj());
    let told = report(&bench, &["dense.obj", "cage.obj", "-o", "heights.ptx"]);
    assert!(number(&told, "dense_triangles") >= 1e6);
    assert_eq!(
        (&told["cage_faces"], &told["missed"]),
        (&96.into(), &0.into())
    );
    let half_a_step = 0.5 * number(&told, "step");
    let surface = displaced(&bench, "cage.obj", "heights.ptx");
    let worst = points(&surface, 200).map(off).fold(0.0, f64::max);
    println!(
        "half a step {half_a_step:.2e}; told {:.2e} at most; {worst:.2e} from the formula",
        largest(&told)
    );
    assert!(
        largest(&told) < half_a_step && worst < half_a_step,
        "{worst} {told}"
    );
    // And the step itself is small against the bumps.
    assert!(half_a_step < 0.02 * (number(&told, "greatest") - number(&told, "least")));

    bench.write("dense.usda", clay(&dense, "none", None));
    bench.write(
        "baked.usda",
        clay(&cage, "catmullClark", Some("heights.ptx")),
    );
    let picture = |scene: &str, seed: u32| {
        let out = bench.path("picture.exr");
        let mut options = options(&bench.path(scene), &out);
        options.resolution = Some([128, 128]);
        options.spp = 32;
        options.seed = seed;
        run(&options);
        read(&out).2
    };
    let [first, second] = [0, 1].map(|seed| picture("dense.usda", seed));
    let baked = picture("baked.usda", 0);
    let (noise, differs) = (difference(&first, &second), difference(&first, &baked));
    let brighter = (mean(&baked) / mean(&first) - 1.0).abs().max_element();
    println!("noise {noise:.2e}, baked differs by {differs:.2e}, its mean by {brighter:.2e}");
    assert!(differs < 0.5 * noise, "{differs} {noise}");
    assert!(brighter < 1e-3, "{brighter}");
    assert!(
        bump(DVec3::Z) != 0.0,
        "it is not the unit sphere that came back"
    );
}
