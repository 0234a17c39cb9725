//! How the program behaves towards disks, farms, users in a hurry and the scene's own settings.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::common::program::{Bench, expect, quad, said};
use crate::common::read;

#[test]
fn a_full_disk_is_an_error_for_every_file() {
    let bench = Bench::new();
    bench.write("scene.usda", quad(""));
    fs::create_dir(bench.path("small")).expect("a folder");
    let run = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c"]);
        command.arg(format!("mount -t tmpfs -o size=16k none small && {script}"));
        said(
            &command
                .current_dir(bench.folder())
                .output()
                .expect("a shell"),
        )
    };
    if run("true").0 != 0 {
        println!(
            "SKIPPED a_full_disk_is_an_error_for_every_file: no file system can be mounted here"
        );
        return;
    }
    let relievo = env!("CARGO_BIN_EXE_relievo");
    let aovs = "beauty,albedo,normal,depth,position";
    for more in [
        "",
        "--multi-part",
        "--tile 64",
        "--multi-part --pixel-type float",
    ] {
        let render = format!(
            "{relievo} render scene.usda -o small/out.exr --res 200 150 --spp 1 --progress none --aov {aovs} {more}"
        );
        let (code, text) = run(&format!("{render}; code=$?; ls -A small >&2; exit $code"));
        expect((code, text.clone()), 1, &["small/out.exr", "space"]);
        // Neither half a picture nor a temporary file is left.
        assert!(!text.trim_end().ends_with(".exr"), "{more}: {text}");
    }
    let png = format!(
        "{relievo} render scene.usda -o out.exr --png small/out.png --res 300 200 --spp 1 --progress none"
    );
    expect(run(&png), 1, &["small/out.png"]);
}

/// The exit code of a render that gets these signals as soon as it is well into it.
fn interrupted(bench: &Bench, resolution: [&str; 2], kill: &str) -> Option<i32> {
    bench.write("scene.usda", quad(""));
    let [width, height] = resolution;
    let mut child = bench
        .command(&[
            "render",
            "scene.usda",
            "-o",
            "out.exr",
            "--res",
            width,
            height,
        ])
        .args(["--spp", "65536", "--progress", "json"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let mut sent = false;
    for line in lines {
        let line = line.expect("a line of text");
        let value: serde_json::Value = serde_json::from_str(&line).expect("every line is JSON");
        // The first passes take no time.
        if !sent && value["stage"] == "render" && value["done"].as_f64() > Some(0.0) {
            sent = true;
            let pid = child.id().to_string();
            // The shell's own: a small system may have no other.
            Command::new("sh")
                .args(["-c", &kill.replace("PID", &pid)])
                .status()
                .expect("a signal");
        }
    }
    child.wait().expect("an end").code()
}

#[test]
fn interrupted_renders_write_what_is_there() {
    let bench = Bench::new();
    assert_eq!(
        interrupted(&bench, ["64", "48"], "kill -INT PID"),
        Some(130)
    );
    let (width, height, pixels) = read(&bench.path("out.exr"));
    assert_eq!((width, height), (64, 48));
    assert!(
        pixels
            .iter()
            .all(|p| p.is_finite() && p.max_element() > 0.0)
    );
}

#[test]
fn a_second_interrupt_ends_at_once() {
    let bench = Bench::new();
    // Large enough that the picture is not written before the second one comes.
    let twice = "kill -INT PID; sleep 0.02; kill -INT PID";
    assert_eq!(interrupted(&bench, ["4096", "4096"], twice), Some(130));
    assert!(!bench.path("out.exr").exists());
}

#[test]
fn reports_for_farms_are_json() {
    let bench = Bench::new();
    bench.write(
        "scene.usda",
        quad("") + "def Cube \"C\" {}\ndef Camera \"Cam\" {}\n",
    );
    let json = |more: &[&str]| {
        let mut arguments = vec![
            "render",
            "scene.usda",
            "--res",
            "8",
            "6",
            "--spp",
            "2",
            "--progress",
            "json",
        ];
        arguments.extend(more);
        let output = bench
            .command(&arguments)
            .output()
            .expect("the program runs");
        let lines: Vec<serde_json::Value> = String::from_utf8_lossy(&output.stderr)
            .lines()
            .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")))
            .collect();
        (output.status.code(), lines)
    };
    let (code, lines) = json(&["-o", "out.exr"]);
    assert_eq!(code, Some(0));
    let stages: Vec<_> = lines.iter().filter_map(|l| l["stage"].as_str()).collect();
    assert!(
        stages.contains(&"load") && stages.contains(&"render"),
        "{stages:?}"
    );
    assert!(
        lines
            .iter()
            .any(|l| l["warning"].as_str().is_some_and(|w| w.contains("Cube")))
    );
    let (code, lines) = json(&["-o", "out.exr", "--camera", "Nobody"]);
    assert_eq!(code, Some(3));
    let last = lines.last().expect("a line");
    assert_eq!(last["code"], 3);
    assert!(
        last["error"].as_str().is_some_and(|e| e.contains("Nobody")),
        "{last}"
    );
}

#[test]
fn render_settings_are_honoured() {
    let bench = Bench::new();
    let settings = r#"#usda 1.0
(renderSettingsPrimPath = "/Render")
def RenderSettings "Render" {
    uniform token[] includedPurposes = ["default", "proxy"]
    uniform int2 resolution = (16, 9)
    rel products = </Render/Product>
    def RenderProduct "Product" {
        token productName = "named.exr"
    }
}
"#;
    let proxy = quad("uniform token purpose = \"proxy\"").replace("#usda 1.0\n", settings);
    bench.write("scene.usda", proxy);
    let run = |more: &[&str]| {
        let mut arguments = vec!["render", "scene.usda", "--spp", "1", "--progress", "none"];
        arguments.extend(more);
        said(
            &bench
                .command(&arguments)
                .output()
                .expect("the program runs"),
        )
    };
    expect(run(&[]), 0, &[]);
    let (width, height, _) = read(&bench.path("named.exr"));
    assert_eq!((width, height), (16, 9));
    expect(
        run(&["--purpose", "render"]),
        3,
        &["nothing to see", "--purpose"],
    );
    expect(run(&["--purpose", "guide,proxy", "-o", "mine.exr"]), 0, &[]);
    assert!(bench.path("mine.exr").exists());
}

#[test]
fn info_says_what_is_there() {
    let bench = Bench::new();
    bench.write("scene.usda", quad("int[] creaseIndices = [0, 1]\n int[] creaseLengths = [2]\n float[] creaseSharpnesses = [10]"));
    let tell = |arguments: &[&str]| {
        let output = bench.command(arguments).output().expect("the program runs");
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let text = tell(&["info", "--long", "scene.usda"]);
    for word in ["1 faces", "Catmull-Clark", "1 edges", "/Quad", "memory"] {
        assert!(text.contains(word), "{word} is not in: {text}");
    }
    for shell in ["bash", "zsh", "fish"] {
        assert!(tell(&["completions", shell]).contains("relievo"), "{shell}");
    }
    assert!(tell(&["--help"]).contains("Exit codes"));
    assert!(tell(&["render", "--help"]).contains("--missing-layers"));
    let gone = bench
        .command(&["info", "gone.obj"])
        .output()
        .expect("the program runs");
    expect(said(&gone), 3, &["gone.obj"]);
}
