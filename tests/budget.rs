//! A memory budget holds for the whole program, as the system sees it; what does not fit is refused before it is begun,
//! and what is said to fit fits.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::common::effort;
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

/// Of one scene, whatever it is told otherwise.
struct Tried(BTreeMap<Vec<String>, Watched>);

impl Tried {
    fn render(&mut self, bench: &Bench, more: &[&str]) -> &Watched {
        let key = more.iter().map(|&word| word.to_owned()).collect();
        self.0
            .entry(key)
            .or_insert_with(|| render(bench, "scene.usda", more))
    }
}

/// What is advised after an option's name.
fn advised(said: &str, option: &str) -> Option<String> {
    let (_, help) = said.split_once("help:")?;
    let (_, after) = help.split_once(&format!("{option} "))?;
    let after = after.strip_prefix("to ").unwrap_or(after);
    let is_of_value = |c: &char| c.is_alphanumeric() || "-.".contains(*c);
    Some(after.chars().take_while(is_of_value).collect())
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
            let Some(value) = advised(&run.said, option) else {
                continue;
            };
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

/// 4.8 million micro-triangles, times `RELIEVO_EFFORT`: at 100 (`make budgets`) they would take 40 GB as Embree's triangles.
#[test]
fn whatever_a_scene_would_take_a_render_keeps_to_its_budget() {
    let effort = effort();
    let bench = Bench::new();
    bench.write("scene.usda", field(0));
    let program = program(&bench);
    let rate = format!("{:.4}", 0.35 / (effort as f64).sqrt());
    let mut tried = Tried(BTreeMap::new());
    for more in [4, 9, 18, 55].map(|share| 24 + share * effort) {
        let budget = format!("{}M", program + more);
        let limit = ((program + more) << 20) as f64;
        let names = Method::ALL.map(Method::name);
        for method in names.into_iter().chain(["auto"]) {
            let mut kept = |method: &str, rate: &str| {
                let asked = ["--method", method, "--memory-budget", &budget];
                let more = ["--dicing-rate", rate, "--max-segments", "4096"];
                let run = tried.render(&bench, &[asked, more].concat());
                println!(
                    "{method:20} at {rate:6} within {budget:>6}: exit code {}, {:5} MiB, {:.2} of it",
                    run.code,
                    run.peak >> 20,
                    run.peak as f64 / limit
                );
                assert!(run.peak as f64 <= 1.05 * limit, "{method}: {}", run.peak);
                (run.code, run.said.clone())
            };
            let (code, said) = kept(method, &rate);
            if code == 0 {
                continue;
            }
            assert_eq!(code, 4, "{method} within {budget}: {said}");
            assert!(advised(&said, "--memory-budget").is_some(), "{said}");
            // What is advised instead is done.
            if let Some(other) = advised(&said, "--method") {
                assert_eq!(kept(&other, &rate).0, 0, "{method} within {budget}: {said}");
            }
            if let Some(coarser) = advised(&said, "--dicing-rate") {
                let (code, then) = kept(method, &coarser);
                assert_eq!(code, 0, "{method} within {budget}: {said}, {then}");
            }
        }
    }
}

#[test]
fn comparisons_keep_to_a_budget_too() {
    let bench = Bench::new();
    bench.write("scene.usda", field(0));
    let program = program(&bench);
    for command in ["bench", "verify"] {
        for (more, code) in [(8, 4), (600, 0)] {
            let budget = format!("{}M", program + more);
            let arguments = [command, "scene.usda", "--methods", "embree-triangles"];
            let how = ["--micro-triangles", "200000", "--rays", "1000"];
            let within = ["--memory-budget", &budget];
            let run = watched(bench.command(&[&arguments[..], &how, &within].concat()));
            assert_eq!(run.code, code, "{command} within {budget}: {}", run.said);
            assert!(code == 0 || run.said.contains("raise --memory-budget"));
            let limit = ((program + more) << 20) as f64;
            assert!(run.peak as f64 <= 1.05 * limit, "{command}: {}", run.peak);
        }
    }
}

/// The program under a limit of its address space, which is the shell's to set: whatever is refused by the system ends it
/// with exit code 4, not by a signal, and leaves no file behind.
#[test]
fn where_the_system_has_no_more_a_render_ends_with_exit_code_4() {
    const CELLS: usize = 16;
    let mut obj = String::new();
    for (i, j) in (0..=CELLS).flat_map(|j| (0..=CELLS).map(move |i| (i, j))) {
        obj += &format!("v {i} {j} {}\n", (7 * i + 5 * j) % 4);
    }
    for (i, j) in (0..CELLS).flat_map(|j| (0..CELLS).map(move |i| (i, j))) {
        let at = |i: usize, j: usize| j * (CELLS + 1) + i + 1;
        let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        obj += &format!("f {}\n", corners.map(|v| v.to_string()).join(" "));
    }
    let bench = Bench::new();
    bench.write("scene.obj", obj);
    let within = |mebibytes: u64, method: &str, rate: &str| {
        let arguments = ["render", "scene.obj", "--progress", "none", "--spp", "1"];
        let more = ["-t", "2", "--res", "240", "160", "-o", "out.exr"];
        let how = ["--method", method, "--dicing-rate", rate];
        let program = bench.command(&[&arguments[..], &more, &how].concat());
        let mut shell = Command::new("sh");
        let limited = format!("ulimit -v {}; exec \"$0\" \"$@\"", mebibytes << 10);
        shell.current_dir(bench.folder()).args(["-c", &limited]);
        shell.arg(program.get_program()).args(program.get_args());
        let _ = std::fs::remove_file(bench.path("out.exr"));
        watched(shell)
    };
    // The least in which a coarse picture is made: libraries and threads take address space of their own.
    let mut least = 400;
    while within(least, "embree-grid", "100").code != 0 {
        least += 50;
        assert!(least < 4000, "it needs all that?");
    }
    // How much that is differs from run to run.
    least += 150;
    let names = Method::ALL.map(Method::name);
    for method in names.into_iter().chain(["auto"]) {
        let mut codes = Vec::new();
        for more in [0, 20, 40, 80, 160, 320, 1000] {
            let run = within(least + more, method, "0.12");
            assert!(
                [0, 4].contains(&run.code),
                "{method}, {} MiB: {}: {}",
                least + more,
                run.code,
                run.said
            );
            let picture: &[&str] = if run.code == 0 { &["out.exr"] } else { &[] };
            assert!(
                is_clean(bench.folder(), &[&["scene.obj"], picture].concat()),
                "{method}"
            );
            codes.push(run.code);
        }
        println!("{method}, {least} MiB and more: {codes:?}");
        assert_eq!(codes.last(), Some(&0), "{method}");
    }
}
