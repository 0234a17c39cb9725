//! `relievo build` and renders from what it kept: the same pictures, and errors where something has changed.

use std::fs;

use crate::common::program::{Bench, expect, said};
use crate::common::{read, write_scene};
use crate::methods::SCENE;

/// A sheet that an image displaces, and a light.
const SHEET: &str = r#"
def Camera "Camera" {
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (0, 0, 6)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "Sun" { float inputs:intensity = 2 }
def Material "Rough" {
    token outputs:surface.connect = </Rough/Surface.outputs:surface>
    token outputs:displacement.connect = </Rough/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.8, 0.4, 0.3)
        float inputs:displacement.connect = </Rough/Map.outputs:r>
        token outputs:displacement
        token outputs:surface
    }
    def Shader "Map" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @heights.ppm@
        token inputs:sourceColorSpace = "raw"
        float2 inputs:st.connect = </Rough/St.outputs:result>
        float4 inputs:scale = (0.4, 0.4, 0.4, 1)
        float outputs:r
    }
    def Shader "St" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
def Mesh "Sheet" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Rough>
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(-2, -1, 0), (0, -1, 0.5), (2, -1, 0), (-2, 1, 0), (0, 1, 0.5), (2, 1, 0)]
    int[] creaseIndices = [1, 4]
    int[] creaseLengths = [2]
    float[] creaseSharpnesses = [1.5]
    texCoord2f[] primvars:st = [(0, 0), (0.5, 0), (1, 0), (0, 1), (0.5, 1), (1, 1)] (interpolation = "vertex")
}
"#;

const HEIGHTS: &str = "P3\n2 2\n255\n0 0 0  200 0 0\n90 0 0  30 0 0\n";

pub fn sheet() -> Bench {
    let bench = Bench::new();
    write_scene(bench.folder(), "sheet.usda", SHEET);
    bench.write("heights.ppm", HEIGHTS);
    bench
}

fn build(bench: &Bench, scene: &str, more: &[&str]) -> (i32, String) {
    let arguments = [&["build", scene, "--progress", "none"], more].concat();
    said(
        &bench
            .command(&arguments)
            .output()
            .expect("the program runs"),
    )
}

#[test]
fn what_was_built_shows_the_same_picture() {
    same_picture("compact");
    same_picture("compressed");
}

fn same_picture(method: &str) {
    let bench = Bench::new();
    write_scene(bench.folder(), "scene.usda", SCENE);
    let small = ["--method", method, "--res", "40", "40"];
    let thread = |n| [small.as_slice(), &["-t", n, "-o", "two.rlv"]].concat();
    expect(
        build(&bench, "scene.usda", &[&small[..], &["-t", "1"]].concat()),
        0,
        &[],
    );
    expect(build(&bench, "scene.usda", &thread("2")), 0, &[]);
    let stores = ["scene.rlv", "two.rlv"].map(|name| fs::read(bench.path(name)).expect("a store"));
    assert!(stores[0] == stores[1], "bytes depend on threads");

    let built = ["--method", method, "--res", "40", "40", "-o", "built.exr"];
    expect(bench.render("scene.usda", &built), 0, &[]);
    let named = ["--built", "two.rlv", "--res", "40", "40", "-o", "named.exr"];
    expect(bench.render("scene.usda", &named), 0, &[]);
    // What the build was told need not be said again.
    let arguments = [
        "render",
        "scene.rlv",
        "--spp",
        "1",
        "-o",
        "stored.exr",
        "--stats",
        "stats.json",
    ];
    let output = bench
        .command(&arguments)
        .output()
        .expect("the program runs");
    expect(said(&output), 0, &[]);
    let pixels = |name: &str| {
        let (width, height, pixels) = read(&bench.path(name));
        let bits = pixels.into_iter().map(|p| p.to_array().map(f32::to_bits));
        (width, height, bits.collect::<Vec<_>>())
    };
    assert!(pixels("built.exr") == pixels("stored.exr"));
    assert!(pixels("built.exr") == pixels("named.exr"));
    let stats = fs::read_to_string(bench.path("stats.json")).expect("statistics");
    assert!(stats.contains("max_diagonals"), "{stats}");
}

#[test]
fn what_has_changed_is_noticed() {
    let bench = sheet();
    let small = ["--res", "8", "6", "--dicing-rate", "0.5"];
    expect(build(&bench, "sheet.usda", &small), 0, &[]);
    let from_store = ["--built", "sheet.rlv"];
    let stale = ["sheet.rlv: /Sheet: the store is stale", "relievo build"];
    expect(bench.render("sheet.usda", &from_store), 0, &[]);
    for (old, new) in [
        ("(2, 1, 0)]", "(2, 1.01, 0)]"),
        ("[1.5]", "[1.6]"),
        ("[0, 1, 4, 3, 1", "[1, 4, 3, 0, 1"),
        ("(0.5, 1), (1, 1)]", "(0.5, 1), (1, 0.9)]"),
        ("(0.4, 0.4, 0.4, 1)", "(0.5, 0.4, 0.4, 1)"),
        ("(0, 0, 6)", "(0, 0, 6.1)"),
        ("rel material:binding = </Rough>\n", ""),
        (
            "def Mesh \"Sheet\" (",
            "def Mesh \"Sheet\" (\n    doc = \"smooth\"\n",
        ),
        ("float inputs:intensity = 2", "float inputs:intensity = 3"),
        ("(0.8, 0.4, 0.3)", "(0.3, 0.4, 0.8)"),
    ] {
        assert!(SHEET.contains(old), "{old}");
        write_scene(bench.folder(), "sheet.usda", &SHEET.replacen(old, new, 1));
        // Documentation, lights and colours are no geometry.
        let kept = new.contains("doc") || old.contains("intensity") || old.contains("0.8");
        let said = bench.render("sheet.usda", &from_store);
        if kept {
            expect(said, 0, &[]);
        } else {
            println!("{new}");
            expect(said, 3, &stale);
        }
    }
    write_scene(bench.folder(), "sheet.usda", SHEET);
    for more in [
        ["--dicing-rate", "1"],
        ["--max-error", "1e-4"],
        ["--scale", "2"],
    ] {
        // It names the option.
        let words = ["/Sheet: the store is stale", more[0], "relievo build"];
        expect(
            bench.render("sheet.usda", &[&from_store[..], &more].concat()),
            3,
            &words,
        );
    }
    bench.write("heights.ppm", HEIGHTS.replace("90", "91"));
    expect(bench.render("sheet.usda", &from_store), 3, &stale);
    bench.write("heights.ppm", HEIGHTS);
    expect(bench.render("sheet.usda", &from_store), 0, &[]);
    let renamed = SHEET.replace("\"Sheet\"", "\"Cloth\"");
    write_scene(bench.folder(), "sheet.usda", &renamed);
    let words = ["/Cloth: the object is not in the store", "relievo build"];
    expect(bench.render("sheet.usda", &from_store), 3, &words);
}

#[test]
fn stores_that_are_none_are_refused() {
    let bench = sheet();
    expect(build(&bench, "sheet.usda", &[]), 0, &[]);
    let whole = fs::read(bench.path("sheet.rlv")).expect("a store");
    let refused = |bytes: &[u8], words: &[&str]| {
        bench.write("other.rlv", bytes);
        expect(
            bench.render("sheet.usda", &["--built", "other.rlv"]),
            3,
            words,
        );
        expect(bench.render("other.rlv", &[]), 3, words);
    };
    refused(
        SHEET.as_bytes(),
        &["other.rlv: it is no store", "relievo build"],
    );
    refused(&[], &["other.rlv: it is no store"]);
    refused(
        &whole[..whole.len() / 2],
        &["does not end there", "relievo build"],
    );
    let mut damaged = whole;
    damaged[200] ^= 1;
    bench.write("other.rlv", &damaged);
    let output = bench
        .command(&["render", "other.rlv"])
        .output()
        .expect("the program runs");
    expect(said(&output), 3, &["/Sheet: the section", "is damaged"]);
    expect(
        bench.render("sheet.usda", &["--built", "none.rlv"]),
        3,
        &["none.rlv"],
    );

    // They hold one dicing.
    let bounces = ["--bounce-dicing", "4"];
    expect(
        build(&bench, "sheet.usda", &bounces),
        2,
        &["--bounce-dicing"],
    );
    expect(bench.render("sheet.rlv", &bounces), 2, &["--bounce-dicing"]);
    let words = ["embree-grid", "cannot be stored", "compact"];
    expect(
        build(&bench, "sheet.usda", &["--method", "embree-grid"]),
        2,
        &words,
    );
    let other = ["--built", "sheet.rlv", "--method", "tessellated"];
    expect(
        bench.render("sheet.usda", &other),
        2,
        &["--method tessellated"],
    );
    expect(
        bench.render("sheet.rlv", &["--built", "sheet.rlv"]),
        2,
        &["--built"],
    );
    expect(
        build(&bench, "none.usda", &["-o", "new.rlv"]),
        3,
        &["none.usda"],
    );
    assert!(!bench.path("new.rlv").exists());
    expect(
        build(&bench, "sheet.usda", &["-o", "none/new.rlv"]),
        1,
        &["none/new.rlv"],
    );
}
