//! What bad input gets, seen from outside: the exit code, and a message that names the place and what to do.

use std::time::{Duration, Instant};

use crate::common::program::{Bench, POINTS, QUAD, expect, mesh, quad, said};

/// A quad whose material reads a texture through `st`.
fn textured(file: &str, st: &str) -> String {
    quad(&format!("rel material:binding = </Look>\n    {st}")).replace(
        "def Mesh \"Quad\"",
        "def Mesh \"Quad\" (prepend apiSchemas = [\"MaterialBindingAPI\"])",
    ) + &format!(
        r#"
def Material "Look" {{
    token outputs:surface.connect = </Look/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Look/Image.outputs:rgb>
        token outputs:surface
    }}
    def Shader "Image" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{file}@
        float2 inputs:st.connect = </Look/Where.outputs:result>
        float3 outputs:rgb
    }}
    def Shader "Where" {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }}
}}
"#
    )
}

/// Braces in braces.
fn nested(depth: usize) -> String {
    format!(
        "#usda 1.0\n{}{}",
        "def \"a\" {\n".repeat(depth),
        "}\n".repeat(depth)
    )
}

#[test]
fn bad_scenes_are_named_with_their_place() {
    let bench = Bench::new();
    bench.write("deep.usda", nested(100_000));
    bench.write(
        "noise.usdc",
        "PXR-USDC then nothing that a table of contents could be made of",
    );
    let whole = quad("");
    let cases: &[(&str, String, &[&str])] = &[
        ("empty.usda", String::new(), &["the file is empty"]),
        ("cut.usda", whole[..whole.len() - 30].to_owned(), &[]),
        ("cut.usdc", "PXR-USDC".to_owned(), &[]),
        ("noise.usdz", "PK and no more".to_owned(), &[]),
        (
            "syntax.usda",
            "#usda 1.0\ndef Mesh \"M\" {\n    int[ = 3\n}\n".to_owned(),
            &[":3:"],
        ),
        (
            "counts.usda",
            mesh(&format!(
                "int[] faceVertexCounts = [4, 3]\n int[] faceVertexIndices = [0, 1, 2, 3]\n {POINTS}"
            )),
            &["/Quad", "add up to 7", "4 faceVertexIndices"],
        ),
        (
            "range.usda",
            quad("").replace("2, 3]\n", "2, 9]\n"),
            &["/Quad", "face 0", "index 9", "4 points"],
        ),
        (
            "negative.usda",
            quad("").replace("2, 3]\n", "2, -3]\n"),
            &["/Quad", "-3"],
        ),
        (
            "nan.usda",
            quad("").replace("(1, 1, 0)", "(1, nan, 0)"),
            &["/Quad", "point 2", "NaN"],
        ),
        ("pointless.usda", mesh(QUAD), &["/Quad", "no points"]),
        (
            "collapsed.usda",
            mesh(&format!(
                "{QUAD} point3f[] points = [(1, 2, 3), (1, 2, 3), (2, 4, 6), (3, 6, 9)]"
            )),
            &["/Quad", "no face of the mesh has an area", "nothing to see"],
        ),
        (
            "collapsed.obj",
            "v 1 2 3\nv 1 2 3\nv 1 2 3\nf 1 2 3\n".to_owned(),
            &["no face has an area"],
        ),
        (
            "whole.usda",
            mesh(&format!("{QUAD} int[] points = [0, 1, 2, 3]")),
            &["/Quad", "point3f[]"],
        ),
        (
            "loop.usda",
            quad("uniform token subdivisionScheme = \"loop\""),
            &["/Quad", "face 0", "4 corners"],
        ),
        (
            "crease.usda",
            quad(
                "int[] creaseIndices = [0, 1]\n int[] creaseLengths = [3]\n float[] creaseSharpnesses = [1]",
            ),
            &["/Quad", "creaseLengths add up to 3", "2 creaseIndices"],
        ),
        (
            "sharp.usda",
            quad("int[] cornerIndices = [0]\n float[] cornerSharpnesses = [-1]"),
            &["/Quad", "sharpness -1"],
        ),
        (
            "hole.usda",
            quad("int[] holeIndices = [4]"),
            &["/Quad", "face 4"],
        ),
        // Counts of billions must not be believed before they are checked.
        (
            "billions.usda",
            mesh(&format!(
                "int[] faceVertexCounts = [2147483647, 2147483647]\n int[] faceVertexIndices = [0, 1, 2]\n {POINTS}"
            )),
            &["/Quad", "4294967294"],
        ),
        (
            "far.usda",
            quad(
                "int[] creaseIndices = [0, 1]\n int[] creaseLengths = [2147483647]\n float[] creaseSharpnesses = [1]",
            ),
            &["/Quad", "2147483647"],
        ),
        // What does not compose.
        (
            "reference.usda",
            quad("") + "def \"A\" (references = @nowhere.usda@</X>) {}\n",
            &["nowhere.usda", "/A", "--missing-layers"],
        ),
        (
            "payload.usda",
            quad("") + "def \"A\" (payload = @nowhere.usda@) {}\n",
            &["nowhere.usda", "/A"],
        ),
        (
            "target.usda",
            quad("") + "def \"A\" (references = </Nobody>) {}\n",
            &["/Nobody", "/A"],
        ),
        (
            "sublayer.usda",
            quad("").replacen('\n', "\n(subLayers = [@nowhere.usda@])\n", 1),
            &["nowhere.usda"],
        ),
        (
            "cycle.usda",
            quad("") + "def \"A\" (references = </B>) {}\ndef \"B\" (references = </A>) {}\n",
            &["cycle"],
        ),
        ("deeper.usda", nested(100_000), &["braces nest"]),
        (
            "refers.usda",
            quad("") + "def \"A\" (references = @deep.usda@</a>) {}\n",
            &["deep.usda", "/A", "braces nest"],
        ),
        (
            "stacks.usda",
            quad("").replacen('\n', "\n(subLayers = [@deep.usda@])\n", 1),
            &["deep.usda", "braces nest"],
        ),
        // OBJ.
        (
            "range.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_owned(),
            &["line 4", "point 4", "there are 3"],
        ),
        (
            "nan.obj",
            "v 0 0 0\nv 1 nan 0\n".to_owned(),
            &["line 2", "nan"],
        ),
        (
            "edge.obj",
            "v 0 0 0\nv 1 0 0\nf 1 2\n".to_owned(),
            &["line 3", "2 corners"],
        ),
        ("none.obj", "v 0 0 0\n".to_owned(), &["no faces"]),
        (
            "billions.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4294967295\n".to_owned(),
            &["line 4", "4294967295"],
        ),
        (
            "more.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n".to_owned(),
            &["line 4"],
        ),
        (
            "nothing.usda",
            "#usda 1.0\ndef Xform \"A\" {}\n".to_owned(),
            &["nothing to see"],
        ),
        (
            "cube.usda",
            "#usda 1.0\ndef Points \"A\" {}\n".to_owned(),
            &["/A", "Points", "nothing to see"],
        ),
        ("scene.txt", "no scene".to_owned(), &["\"txt\"", ".usda"]),
    ];
    for (name, text, words) in cases {
        bench.write(name, text);
        let start = Instant::now();
        let (code, text) = bench.render(name, &[]);
        let mut words = words.to_vec();
        words.extend([*name, "error:"]);
        expect((code, text), 3, &words);
        assert!(start.elapsed() < Duration::from_secs(20), "{name}");
        assert!(!bench.path("out.exr").exists(), "{name}");
    }
    expect(
        bench.render("gone.usda", &[]),
        3,
        &["gone.usda", "No such file"],
    );
    expect(bench.render("noise.usdc", &[]), 3, &["noise.usdc"]);
    expect(
        bench.render("reference.usda", &["--missing-layers", "skip"]),
        0,
        &["nowhere.usda"],
    );
}

#[test]
fn a_primvar_that_does_not_fit_matters_where_it_is_read() {
    let bench = Bench::new();
    let spare = "float[] primvars:spare = [1, 2, 3] (interpolation = \"uniform\")";
    bench.write("spare.usda", quad(spare));
    expect(
        bench.render("spare.usda", &[]),
        0,
        &[
            "/Quad",
            "primvar spare has 3 elements for 1 faces",
            "left out",
        ],
    );
    let st = "texCoord2f[] primvars:st = [(0, 0), (1, 0)] (interpolation = \"vertex\")";
    bench.write("image.png", b"");
    bench.write("st.usda", textured("image.png", st));
    let magenta = ["--missing-textures", "magenta"];
    expect(
        bench.render("st.usda", &magenta),
        3,
        &[
            "/Quad",
            "primvar st has 2 elements for 4 points",
            "/Look reads it",
        ],
    );
    expect(bench.render("st.usda", &["--clay"]), 0, &["primvar st"]);
    bench.write("negative.usda", quad("float[] primvars:w = [1] (interpolation = \"vertex\")\n int[] primvars:w:indices = [0, 0, -2, 0]"));
    expect(
        bench.render("negative.usda", &[]),
        0,
        &["/Quad", "primvar w", "-2"],
    );
}

#[test]
fn repeated_corners_are_told() {
    let bench = Bench::new();
    bench.write("twice.usda", quad("").replace("2, 3]\n", "2, 1]\n"));
    let words = ["/Quad", "face 0", "point 1 is more than one"];
    expect(bench.render("twice.usda", &[]), 0, &words);
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 2\n";
    for scheme in ["catmark", "bilinear"] {
        // Embree subdivides them in quads only, on others its own checks would end the process.
        let name = format!("{scheme}_triangle.obj");
        bench.write(&name, text);
        expect(bench.render(&name, &[]), 0, &["more than one"]);
        expect(
            bench.render(&name, &["--method", "embree-subdivision"]),
            0,
            &["face 1", "point 1 more than once", "embree-triangles"],
        );
    }
    bench.write(
        "ten.obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 2 1 2 1 3 1 3 1 2 3\n",
    );
    let embree = ["--method", "embree-subdivision"];
    expect(bench.render("ten.obj", &[]), 0, &[]);
    expect(
        bench.render("ten.obj", &embree),
        0,
        &["face 0", "10 corners"],
    );
    bench.write("loop_twice.obj", text);
    let words = ["line 5: point 2 is more than one"];
    expect(bench.render("loop_twice.obj", &[]), 0, &words);
}

#[test]
fn creases_without_an_edge_are_counted() {
    let bench = Bench::new();
    bench.write(
        "quad.usda",
        quad("int[] creaseIndices = [0, 1, 3, 2, 0]\n int[] creaseLengths = [5]\n float[] creaseSharpnesses = [2]"),
    );
    let words = ["/Quad: 2 creases have no effect", "as 1 and 3"];
    expect(bench.render("quad.usda", &[]), 0, &words);
    bench.write(
        "quad.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nt crease 2/1/0 0 2 3\nt crease 2/1/0 3 0 3\n",
    );
    let words = ["1 creases have no effect", "as 0 and 2"];
    expect(bench.render("quad.obj", &[]), 0, &words);
}

#[test]
fn missing_textures_are_an_error_or_magenta() {
    let bench = Bench::new();
    let st =
        "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"vertex\")";
    bench.write("scene.usda", textured("gone.png", st));
    expect(
        bench.render("scene.usda", &[]),
        3,
        &["gone.png", "/Look/Image", "--missing-textures magenta"],
    );
    expect(
        bench.render("scene.usda", &["--missing-textures", "magenta"]),
        0,
        &["gone.png"],
    );
    bench.write("broken.png", b"\x89PNG\r\n\x1a\nand no more");
    bench.write("broken.usda", textured("broken.png", st));
    expect(
        bench.render("broken.usda", &[]),
        3,
        &["broken.png", "/Look/Image", "--missing-textures magenta"],
    );
}

#[test]
fn what_the_command_line_cannot_mean() {
    let bench = Bench::new();
    bench.write("scene.usda", quad("") + "def Camera \"Cam\" {}\n");
    expect(
        bench.render("scene.usda", &["--camera", "Nobody"]),
        3,
        &["scene.usda", "Nobody", "/Cam"],
    );
    expect(bench.render("scene.usda", &[]), 0, &["no light"]);
    expect(
        bench.render("scene.usda", &["--res", "0", "0"]),
        2,
        &["0 x 0", "--res"],
    );
    expect(
        bench.render("scene.usda", &["--res", "70000", "8"]),
        2,
        &["70000", "--res"],
    );
    expect(bench.render("scene.usda", &["--spp", "0"]), 2, &["--spp"]);
    for (option, value) in [
        ("--frame", "NaN"),
        ("--dicing-rate", "-1"),
        ("--dicing-rate", "NaN"),
        ("--scale", "-2"),
        ("--threads", "100000"),
    ] {
        let mut command = bench.command(&["render", "scene.usda", option, value]);
        let output = command.output().expect("the program runs");
        expect(said(&output), 2, &[option, value]);
    }
    expect(
        bench.render("scene.usda", &["--settings", "/No"]),
        3,
        &["/No", "RenderSettings"],
    );
    expect(
        bench.render("scene.usda", &["-o", "out.tif"]),
        2,
        &["out.tif", ".exr"],
    );
    expect(
        bench.render("scene.usda", &["-o", "no/such/folder/out.exr"]),
        1,
        &["no/such/folder"],
    );
    expect(
        bench.render("scene.usda", &["--stats", "no/folder/s.json"]),
        1,
        &["no/folder"],
    );
    expect(
        bench.render("scene.usda", &["--memory-budget", "1K"]),
        4,
        &["--memory-budget"],
    );
    let narrow = [
        "--memory-budget",
        "100K",
        "--res",
        "40",
        "30",
        "--dicing-rate",
        "0.01",
    ];
    expect(bench.render("scene.usda", &narrow), 4, &["memory"]);
}

/// The tests' scenes are what they claim to be: the same without the fault renders without a word.
#[test]
fn the_scenes_without_their_faults_render() {
    let bench = Bench::new();
    bench.write("quad.usda", quad(""));
    let (code, text) = bench.render("quad.usda", &[]);
    assert_eq!((code, text.as_str()), (0, ""));
    assert!(bench.path("out.exr").exists());
}
