//! The system itself refuses memory, once, wherever the program or a library of its asks for much: each time there is an exit
//! code, an explanation, and no file that was not finished.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::program::{Bench, said};
use crate::common::read;
use relievo::world::Method;

/// Builds what is loaded before all libraries: see there.
fn refusing(folder: &Path) -> PathBuf {
    let library = folder.join("refuse.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/refused/refuse.c");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .args([&library, &source])
        .status()
        .expect("a C compiler");
    assert!(built.success());
    library
}

/// A dozen of faces with a displacement from an image, that much of everything is asked for.
fn scene(bench: &Bench) {
    let pixels: String = (0..256 * 256)
        .map(|i| format!("{} ", (i * 7) % 256))
        .collect();
    bench.write("heights.pgm", format!("P2 256 256 255\n{pixels}"));
    bench.write(
        "scene.usda",
        r#"#usda 1.0
def DomeLight "Sky" { float inputs:intensity = 1 }
def Material "Bumpy" {
    token outputs:surface.connect = </Bumpy/Surface.outputs:surface>
    token outputs:displacement.connect = </Bumpy/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:displacement.connect = </Bumpy/Heights.outputs:r>
        token outputs:displacement
        token outputs:surface
    }
    def Shader "Heights" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @heights.pgm@
        float4 inputs:scale = (0.2, 0.2, 0.2, 1)
        float2 inputs:st.connect = </Bumpy/Place.outputs:result>
        float outputs:r
    }
    def Shader "Place" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
}
def Mesh "Sheet" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Bumpy>
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(0, 0, 0), (2, 0, 1), (4, 0, 0), (0, 3, 0), (2, 3, 1), (4, 3, 0)]
    texCoord2f[] primvars:st = [(0, 0), (0.5, 0), (1, 0), (0, 1), (0.5, 1), (1, 1)] (interpolation = "vertex")
}
"#,
    );
}

const RENDER: &str = "render scene.usda -o out.exr --progress none --spp 1 -t 2 --res 96 64 --dicing-rate 0.5 --cache-size 1M";

/// Each fifth piece, others by each method; `RELIEVO_EFFORT` of 5 or more refuses all, which takes some minutes.
#[test]
fn whichever_large_piece_of_memory_is_refused_the_program_ends_in_order() {
    let bench = Bench::new();
    scene(&bench);
    let library = refusing(bench.folder());
    let told = bench.path("refused");
    let picture = bench.path("out.exr");
    let effort: usize = (std::env::var("RELIEVO_EFFORT").ok())
        .and_then(|effort| effort.parse().ok())
        .unwrap_or(1);
    let step = (5 / effort.max(1)).max(1);
    for (first, method) in Method::ALL.into_iter().enumerate() {
        let render = |which: usize| {
            let _ = std::fs::remove_file(&picture);
            let _ = std::fs::remove_file(&told);
            let output = bench
                .command(&RENDER.split(' ').collect::<Vec<_>>())
                .args(["--method", method.name()])
                .env("LD_PRELOAD", &library)
                .env("REFUSE", which.to_string())
                .env("REFUSED", &told)
                .output()
                .expect("the program runs");
            said(&output)
        };
        let name = method.name();
        let (code, text) = render(usize::MAX >> 1);
        assert!(
            code == 0 && !told.exists(),
            "{name}, nothing is refused: {text}"
        );
        let whole = read(&picture);
        let mut codes = [0; 2];
        for which in (first % step..).step_by(step) {
            let (code, text) = render(which);
            if !told.exists() {
                break;
            }
            assert!([0, 4].contains(&code), "{name}, {which}: {code}: {text}");
            assert!(
                code == 0 || text.contains("memory"),
                "{name}, {which}: {text}"
            );
            codes[usize::from(code == 4)] += 1;
            let mut left: Vec<_> = std::fs::read_dir(bench.folder())
                .expect("a folder")
                .map(|entry| entry.expect("an entry").file_name())
                .collect();
            left.sort();
            let mut kept = vec!["heights.pgm", "refuse.so", "refused", "scene.usda"];
            if code == 0 {
                kept.insert(1, "out.exr");
                assert_eq!(read(&picture), whole, "{name}, {which}");
            }
            assert_eq!(left, kept, "{name}, {which}: {text}");
        }
        let [done, ended] = codes;
        println!("{name}: {ended} refusals end the program, {done} do not");
        assert!(ended > 1, "{name}");
    }
}
