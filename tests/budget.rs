//! A memory budget holds for the whole program, as the system sees it; what does not fit is refused before it is begun,
//! and what is said to fit fits.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::common::program::Bench;
use relievo::world::Method;

/// A wavy field of quads, displaced by a primvar, that fills the picture; and small balls before it.
fn field(balls: usize) -> String {
    const CELLS: i32 = 24;
    let at = |i: i32, j: i32| j * (CELLS + 1) + i;
    let vertices = || (0..=CELLS).flat_map(|j| (0..=CELLS).map(move |i| (i, j)));
    let points: Vec<String> = vertices().map(|(i, j)| format!("({i}, {j}, 0)")).collect();
    let heights: Vec<String> = vertices()
        .map(|(i, j)| format!("{}", f64::from((i * 7 + j * 5) % 4) / 8.0))
        .collect();
    let indices: Vec<String> = (0..CELLS)
        .flat_map(|j| (0..CELLS).map(move |i| (i, j)))
        .flat_map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .map(|v| v.to_string())
        .collect();
    let counts = vec!["4"; (CELLS * CELLS) as usize].join(", ");
    let mut text = format!(
        r#"#usda 1.0
def Camera "Camera" {{
    float focalLength = 50
    float horizontalAperture = 36
    float verticalAperture = 24
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (12, 12, 30)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def DomeLight "Sky" {{ float inputs:intensity = 1 }}
def Material "Bumpy" {{
    token outputs:surface.connect = </Bumpy/Surface.outputs:surface>
    token outputs:displacement.connect = </Bumpy/Surface.outputs:displacement>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        float inputs:displacement.connect = </Bumpy/Height.outputs:result>
        token outputs:displacement
        token outputs:surface
    }}
    def Shader "Height" {{
        uniform token info:id = "UsdPrimvarReader_float"
        string inputs:varname = "height"
        float outputs:result
    }}
}}
def Mesh "Field" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </Bumpy>
    int[] faceVertexCounts = [{counts}]
    int[] faceVertexIndices = [{}]
    point3f[] points = [{}]
    float[] primvars:height = [{}] (interpolation = "vertex")
}}
"#,
        indices.join(", "),
        points.join(", "),
        heights.join(", ")
    );
    for ball in 0..balls {
        text += &format!(
            "def Sphere \"Ball{ball}\" {{\n    double radius = 0.2\n    \
             double3 xformOp:translate = ({}, {}, 3)\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}}\n",
            5 + 2 * ball,
            6 + ball,
        );
    }
    text
}

/// What became of a command, seen from outside.
struct Watched {
    code: i32,
    said: String,
    /// The most memory that it had, bytes.
    peak: u64,
}

fn watched(mut command: Command) -> Watched {
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    let code = loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kibibytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
        peak = peak.max(1024 * kibibytes.unwrap_or(0));
        if let Some(status) = child.try_wait().expect("it can be waited for") {
            break status.code().unwrap_or(-1);
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let mut said = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().expect("it is piped"), &mut said)
        .expect("text");
    Watched { code, said, peak }
}

/// The dicing rate that makes some 1.6 million micro-triangles.
const FINE: &str = "0.6";

/// A fine picture; `more` comes in place of what it is told otherwise.
fn render(bench: &Bench, scene: &str, more: &[&str]) -> Watched {
    let mut arguments = vec!["render", scene, "--progress", "none", "--spp", "1"];
    arguments.extend(["-o", "out.exr", "--stats", "stats.json"]);
    arguments.extend(["--res", "480", "320"]);
    for (option, value) in [("--dicing-rate", FINE), ("-t", "2")] {
        if !more.contains(&option) {
            arguments.extend([option, value]);
        }
    }
    arguments.extend(more);
    // Of an earlier one.
    for old in ["out.exr", "stats.json"] {
        let _ = std::fs::remove_file(bench.path(old));
    }
    watched(bench.command(&arguments))
}

fn stats(bench: &Bench) -> Value {
    let text = std::fs::read_to_string(bench.path("stats.json")).expect("statistics");
    serde_json::from_str(&text).expect("JSON")
}

/// Nothing but the scene and whole files.
fn is_clean(folder: &Path, kept: &[&str]) -> bool {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries.flatten().all(|entry| {
        let name = entry.file_name();
        kept.iter().any(|kept| *kept == name)
    })
}

/// Mebibytes that the program takes without anything in it, and some for a film.
fn program(bench: &Bench) -> u64 {
    let alone = render(bench, "scene.usda", &["--dicing-rate", "1000"]);
    assert_eq!(alone.code, 0, "{}", alone.said);
    (alone.peak >> 20) + 1
}

#[test]
fn no_method_takes_more_than_the_budget() {
    let bench = Bench::new();
    bench.write("scene.usda", field(3));
    let program = program(&bench);
    for more in [24, 60, 300] {
        let budget = format!("{}M", program + more);
        let limit = (program + more) << 20;
        let names = Method::ALL.map(Method::name);
        for method in names.into_iter().chain(["auto"]) {
            let run = render(
                &bench,
                "scene.usda",
                &["--method", method, "--memory-budget", &budget],
            );
            println!(
                "{method} within {} MiB: exit code {}, {} MiB",
                limit >> 20,
                run.code,
                run.peak >> 20
            );
            let said = &run.said;
            assert!(
                run.peak as f64 <= 1.05 * limit as f64,
                "{method}: {}",
                run.peak
            );
            let fits: &[i32] = match (method, more) {
                ("auto" | "compact" | "compressed" | "cache", _) | (_, 300) => &[0],
                // 85 bytes a micro-triangle.
                ("embree-triangles", _) => &[4],
                _ => &[0, 4],
            };
            assert!(
                fits.contains(&run.code),
                "{method} within {budget}: {}: {said}",
                run.code
            );
            if run.code == 4 {
                assert!(
                    said.contains("/Field") && said.contains("--memory-budget to"),
                    "{said}"
                );
                assert!(is_clean(bench.folder(), &["scene.usda"]), "{method}");
            }
        }
    }
}

#[test]
fn what_is_said_to_fit_fits() {
    let bench = Bench::new();
    bench.write("scene.usda", field(1));
    let program = program(&bench);
    for (method, more) in [
        ("embree-triangles", 60),
        ("embree-grid", 24),
        ("tessellated", 40),
    ] {
        let budget = format!("{}M", program + more);
        let asked = ["--method", method, "--memory-budget", &budget];
        let run = render(&bench, "scene.usda", &asked);
        assert_eq!(run.code, 4, "{method}: {}", run.said);
        println!("{}", run.said);
        let mut tried = 0;
        for option in ["--method", "--dicing-rate", "--memory-budget"] {
            let (_, help) = run.said.split_once("help:").expect("it says what to do");
            let Some((_, after)) = help
                .split_once(&format!("{option} "))
                .map(|(before, after)| (before, after.strip_prefix("to ").unwrap_or(after)))
            else {
                continue;
            };
            let value: String = after
                .chars()
                .take_while(|c| c.is_alphanumeric() || "-.".contains(*c))
                .collect();
            let mut other: Vec<&str> = asked.to_vec();
            match other.iter().position(|word| *word == option) {
                Some(at) => other[at + 1] = &value,
                None => other.extend([option, &value]),
            }
            let run = render(&bench, "scene.usda", &other);
            assert_eq!(
                run.code, 0,
                "{option} {value} instead of {asked:?}: {}",
                run.said
            );
            tried += 1;
        }
        assert_eq!(tried, 3, "{}", run.said);
    }
}

#[test]
fn methods_are_chosen_object_by_object() {
    let bench = Bench::new();
    bench.write("scene.usda", field(3));
    let program = program(&bench);
    let mut seen = Vec::new();
    for more in [600, 90, 40] {
        let budget = format!("{}M", program + more);
        let mut pictures = Vec::new();
        for threads in ["1", "3"] {
            let asked = [
                "--method",
                "auto",
                "--memory-budget",
                &budget,
                "-t",
                threads,
            ];
            let run = render(&bench, "scene.usda", &asked);
            assert_eq!(run.code, 0, "{budget}: {}", run.said);
            let stats = stats(&bench);
            let of = |name: &str| {
                let objects = stats["objects"].as_array().expect("objects");
                let object = objects
                    .iter()
                    .find(|o| o["path"] == name)
                    .expect("it is there");
                object["method"].as_str().expect("a name").to_owned()
            };
            // It costs nothing, and would cost more in a tree of our own.
            assert_eq!(of("/Ball1"), "embree-triangles");
            pictures.push((
                of("/Field"),
                std::fs::read(bench.path("out.exr")).expect("a picture"),
            ));
        }
        let methods: Vec<&String> = pictures.iter().map(|(method, _)| method).collect();
        assert_eq!(methods[0], methods[1]);
        // The head tells the seconds.
        let tail = |bytes: &Vec<u8>| bytes[bytes.len() - 20_000..].to_vec();
        assert!(tail(&pictures[0].1) == tail(&pictures[1].1), "{budget}");
        seen.push(pictures.remove(0).0);
    }
    println!("{seen:?}");
    assert_eq!(seen[0], "embree-triangles");
    assert_eq!(seen[1], "compact");
}

#[test]
fn a_store_and_textures_are_held_to_the_budget() {
    let bench = Bench::new();
    bench.write("scene.usda", field(0));
    let program = program(&bench);
    let mut arguments = vec!["build", "scene.usda", "-o", "field.rlv"];
    arguments.extend(["--res", "480", "320", "--dicing-rate", "0.25"]);
    let built = bench
        .command(&arguments)
        .output()
        .expect("the program runs");
    assert!(built.status.success(), "{built:?}");
    let size = std::fs::metadata(bench.path("field.rlv"))
        .expect("a store")
        .len();
    assert!(size > 4 << 20, "{size}");
    let within = |mebibytes: u64| {
        let budget = format!("{mebibytes}M");
        let arguments = ["render", "field.rlv", "--spp=1", "--progress", "none"];
        let more = ["-o", "out.exr", "--memory-budget", &budget];
        watched(bench.command(&[&arguments[..], &more].concat()))
    };
    let run = within(program + (size >> 20) + 24);
    assert_eq!(run.code, 0, "{}", run.said);
    // Where program and film fit, and the store does not.
    let mut refused = (program - 40..program + 8).step_by(2).map(within);
    assert!(refused.any(|run| run.code == 4 && run.said.contains("hierarchies")));

    // 16 MB with its levels, and all of the file while it is read.
    let pixels = vec![[7_u8, 90, 200]; 2048 * 2048];
    let mut ppm = b"P6\n2048 2048\n255\n".to_vec();
    ppm.extend(pixels.as_flattened());
    bench.write("large.ppm", ppm);
    bench.write(
        "textured.usda",
        crate::common::program::quad(
            "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"vertex\")\n\
             rel material:binding = </M>\n}\n\
             def Material \"M\" {\n token outputs:surface.connect = </M/S.outputs:surface>\n\
             def Shader \"S\" {\n uniform token info:id = \"UsdPreviewSurface\"\n\
             color3f inputs:diffuseColor.connect = </M/T.outputs:rgb>\n token outputs:surface\n }\n\
             def Shader \"T\" {\n uniform token info:id = \"UsdUVTexture\"\n asset inputs:file = @large.ppm@\n\
             float3 outputs:rgb\n }\n",
        ),
    );
    for (more, code) in [(8, 4), (60, 0)] {
        let budget = format!("{}M", program + more);
        let run = render(&bench, "textured.usda", &["--memory-budget", &budget]);
        assert_eq!(run.code, code, "{}", run.said);
        assert!(
            run.peak as f64 <= 1.05 * ((program + more) << 20) as f64,
            "{}",
            run.peak
        );
        assert!(code == 0 || run.said.contains("textures"), "{}", run.said);
    }
}
