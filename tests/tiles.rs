//! Tiles of geometry over surfaces: the same picture by bent rays as by copies in Embree's triangles.

use crate::common::program::{Bench, expect, said};
use crate::common::{mean, read};
use relievo::math::Vec3;

/// A bent sheet of two by two faces, which moves, and stands in two places; a tile of blades that lean over its border, over a
/// plate.
fn scene() -> String {
    let mut points = vec![
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        (1.0, 1.0, 0.0),
        (0.0, 1.0, 0.0),
    ];
    let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
    for blade in 0..9 {
        let (x, y) = (
            f64::from(blade % 3) / 3.0 + 0.1,
            f64::from(blade / 3) / 3.0 + 0.1,
        );
        let lean = 0.1 * f64::from(blade) - 0.4;
        let first = points.len();
        points.extend([
            (x, y, 0.0),
            (x + 0.2, y + 0.05, 0.0),
            (x + lean, y + 0.3, 1.0),
        ]);
        triangles.push([first, first + 1, first + 2]);
    }
    let sheet = |key: f64| -> String {
        let point = |i: u32| {
            let (x, y) = (f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0);
            format!("({x}, {y}, {})", 0.4 * x * x - 0.3 * x * y + key * 0.1)
        };
        (0..9).map(point).collect::<Vec<_>>().join(", ")
    };
    let st = (0..9).map(|i| format!("({}, {})", f64::from(i % 3) / 2.0, f64::from(i / 3) / 2.0));
    let st = st.collect::<Vec<_>>().join(", ");
    format!(
        r#"#usda 1.0
class "Tiles" {{
    def Mesh "Tile" {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = {:?}
        int[] faceVertexIndices = {:?}
        point3f[] points = {points:?}
    }}
}}
class "Sheets" {{
    def Mesh "Sheet" (prepend apiSchemas = ["RelievoShellAPI"]) {{
        int[] faceVertexCounts = [4, 4, 4, 4]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8, 7]
        point3f[] points.timeSamples = {{ 0: [{}], 1: [{}] }}
        texCoord2f[] primvars:st = [{st}] (interpolation = "vertex")
        color3f[] primvars:displayColor = [(0.8, 0.5, 0.2)]
        rel relievo:shell:tile = </Tiles/Tile>
        float2 relievo:shell:repeats = (5, 4)
        float relievo:shell:height = 0.3
    }}
}}
def "One" (instanceable = true references = </Sheets>) {{
    double3 xformOp:translate = (-1.2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def "Two" (instanceable = true references = </Sheets>) {{
    double3 xformOp:translate = (1.2, 0, 0)
    float3 xformOp:rotateXYZ = (0, 25, 80)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}}
def Camera "Camera" {{
    float focalLength = 40
    double shutter:open = 0
    double shutter:close = 1
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (0, -4, 6)
    float3 xformOp:rotateXYZ = (33, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}}
def DomeLight "Sky" {{ float inputs:intensity = 1 }}
"#,
        vec![3; triangles.len()],
        triangles.concat(),
        sheet(0.0),
        sheet(1.0),
    )
}

/// The pixels of a picture of it.
fn picture(bench: &Bench, name: &str, more: &[&str]) -> Vec<Vec3> {
    let arguments = [
        "render",
        "tiles.usda",
        "--res",
        "60",
        "40",
        "--spp",
        "16",
        "-o",
        name,
    ];
    let arguments = [&arguments, more].concat();
    let output = bench.command(&arguments).output();
    expect(said(&output.expect("the program runs")), 0, &[]);
    read(&bench.path(name)).2
}

#[test]
fn bent_rays_show_what_copies_show() {
    let bench = Bench::new();
    bench.write("tiles.usda", scene());
    let copies = picture(&bench, "copies.exr", &["--method", "embree-triangles"]);
    let white = Vec3::splat(0.99);
    let seen = copies.iter().filter(|p| p.cmplt(white).any()).count();
    assert!(seen > copies.len() / 4, "{seen} pixels");
    let bent = picture(&bench, "bent.exr", &["-t", "1"]);
    let apart: f32 = bent.iter().zip(&copies).map(|(a, b)| a.distance(*b)).sum();
    let apart = apart / copies.len() as f32;
    // Straight triangles and bent ones differ at outlines, and paths that leave them have other noise.
    assert!(apart < 2e-2, "{apart}");
    let brighter = mean(&bent) - mean(&copies);
    assert!(brighter.abs().max_element() < 2e-3, "{brighter}");
    // The same by all methods, and for any number of threads.
    for method in ["compact", "dbvh", "nonlinear", "tessellated"] {
        let again = picture(&bench, "again.exr", &["--method", method, "-t", "3"]);
        assert!(again == bent, "{method}");
    }
}

#[test]
fn tiles_stand_in_renders_from_stores() {
    let bench = Bench::new();
    bench.write("tiles.usda", scene());
    let build = [
        "build",
        "tiles.usda",
        "-o",
        "tiles.rlv",
        "--res",
        "60",
        "40",
    ];
    let output = bench.command(&build).output().expect("the program runs");
    assert!(output.status.success(), "{output:?}");
    let plain = picture(&bench, "plain.exr", &["--method", "compact"]);
    let stored = picture(&bench, "stored.exr", &["--built", "tiles.rlv"]);
    assert!(plain == stored);
}

#[test]
fn copies_that_do_not_fit_are_refused_and_bent_rays_are_told() {
    let bench = Bench::new();
    bench.write("tiles.usda", scene().replace("(5, 4)", "(5000, 4000)"));
    let budget = ["--memory-budget", "600M"];
    let refused = bench.render(
        "tiles.usda",
        &[&budget[..], &["--method", "embree-triangles"]].concat(),
    );
    expect(refused, 4, &["/Sheet: 2", "micro-triangles", "--method"]);
    for method in ["auto", "embree-grid"] {
        let how = ["--method", method, "--stats", "stats.json"];
        expect(
            bench.render("tiles.usda", &[&budget[..], &how].concat()),
            0,
            &[],
        );
        let text = std::fs::read_to_string(bench.path("stats.json")).expect("statistics");
        let stats: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(stats["objects"][0]["method"], "tiles", "{method}");
    }
}
