//! Displacement by a map: texture coordinates find their way from the scene to the surface, for pictures and for every
//! way to trace.

use std::fmt::Write;

use relievo::image::{Channel, ChannelFormat, Compression, Part, Picture, write_exr};
use relievo::world::Method;
use serde_json::Value;

use crate::common::program::Bench;
use crate::common::{mean, options, read, run};

/// A sheet of 4 by 4 quads from -2 to 2 under a light from straight above, its heights those of a ramp along x, times
/// `scale`; coordinates in its points or, with a seam nowhere, in its corners. They keep off the ramp's ends, which are
/// level from the middle of the last pixel on: where its slope ends no micro-edge runs, and each way to trace would
/// bridge the bend in its own way.
fn sheet(scale: f32, by_corner: bool) -> String {
    let (mut points, mut st, mut indices) = (String::new(), Vec::new(), Vec::new());
    for (i, j) in (0..5).flat_map(|j| (0..5).map(move |i| (i, j))) {
        write!(points, "({}, {}, 0), ", i - 2, j - 2).expect("a string takes all");
        let [s, t] = [i, j].map(|i| 0.1 + 0.2 * f64::from(i));
        st.push(format!("({s}, {t})"));
    }
    for (i, j) in (0..4).flat_map(|j| (0..4).map(move |i| (i, j))) {
        let first = 5 * j + i;
        indices.extend([first, first + 1, first + 6, first + 5]);
    }
    let (interpolation, st) = if by_corner {
        let by_corner = indices.iter().map(|&i| st[i].clone());
        ("faceVarying", by_corner.collect())
    } else {
        ("vertex", st)
    };
    let (st, counts) = (st.join(", "), ["4"; 16].join(", "));
    format!(
        r#"#usda 1.0
def Camera "Camera" {{
    float focalLength = 50
    float horizontalAperture = 20
    float verticalAperture = 20
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def DistantLight "Light" {{
    float inputs:intensity = 1
    float inputs:angle = 0
}}
def Mesh "Sheet" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </Ramp>
    int[] faceVertexCounts = [{counts}]
    int[] faceVertexIndices = {indices:?}
    point3f[] points = [{points}]
    texCoord2f[] primvars:st = [{st}] (
        interpolation = "{interpolation}"
    )
}}
def Material "Ramp" {{
    token outputs:surface.connect = </Ramp/Surface.outputs:surface>
    token outputs:displacement.connect = </Ramp/Surface.outputs:displacement>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        float inputs:displacement.connect = </Ramp/Heights.outputs:r>
        token outputs:displacement
        token outputs:surface
    }}
    def Shader "Heights" {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @ramp.exr@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "clamp"
        token inputs:wrapT = "clamp"
        float4 inputs:scale = ({scale}, {scale}, {scale}, 1)
        float2 inputs:st.connect = </Ramp/Where.outputs:result>
        float outputs:r
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

/// From 0 at the left to 1 at the right.
fn write_ramp(bench: &Bench) {
    let channel = |name: &str| Channel {
        name: name.into(),
        format: ChannelFormat::Float,
    };
    let ramp = Picture {
        width: 64,
        height: 1,
        display_window: (64, 1, 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: ["R", "G", "B"].map(channel).to_vec(),
            pixels: (0..64).flat_map(|i| [(i as f32 + 0.5) / 64.0; 3]).collect(),
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    };
    write_exr(&bench.path("ramp.exr"), &ramp).expect("the test's folder takes files");
}

#[test]
fn a_ramp_along_a_texture_coordinate_tilts_the_sheet() {
    let bench = Bench::new();
    write_ramp(&bench);
    let light = |name: &str, scale, by_corner| {
        bench.write(name, sheet(scale, by_corner));
        let mut options = options(&bench.path(name), &bench.path("sheet.exr"));
        options.build.clay = Some(0.5);
        run(&options);
        let (.., pixels) = read(&bench.path("sheet.exr"));
        mean(&pixels).x
    };
    let flat = light("flat.usda", 0.0, false);
    for by_corner in [false, true] {
        // Two up over four along: eight tenths of the ramp.
        let tilted = light("tilted.usda", 2.5, by_corner);
        let cosine = 1.0 / (1.0_f32 + 0.25).sqrt();
        assert!((tilted / flat - cosine).abs() < 5e-3, "{tilted} {flat}");
    }
}

#[test]
fn all_ways_to_trace_read_the_same_texture_coordinates() {
    let bench = Bench::new();
    write_ramp(&bench);
    for by_corner in [false, true] {
        bench.write("sheet.usda", sheet(2.5, by_corner));
        let report = bench.report(&[
            "verify",
            "sheet.usda",
            "--json",
            "--rays",
            "5000",
            "--micro-triangles",
            "10000",
        ]);
        let rows = report["rows"].as_array().expect("rows");
        let references = |row: &&Value| row["reference"] == "embree-subdivision";
        let others = Method::ALL.len() - 1;
        assert_eq!(rows.iter().filter(references).count(), others, "{report}");
        for row in rows {
            let distance = row["max_distance"].as_f64().expect("a number");
            // The sheet is flat, tilted. At other places of the map it would be thousands of times as far.
            let rounded = ["compact", "cache"]
                .map(Value::from)
                .contains(&row["method"]);
            let lattice = if rounded { 3.6e-5 } else { 0.0 };
            assert!(distance < 1e-5 + lattice, "{row}");
        }
    }
}
