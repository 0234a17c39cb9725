//! What cannot be converted.

use relievo_ptex::DataType;

use super::{SQUARE, noise, ramp, run};
use crate::common::program::{Bench, expect};

#[test]
fn what_cannot_be_converted_is_told() {
    let bench = Bench::new();
    noise(&bench, "noise.ptx", DataType::U16, 2);
    ramp(&bench, "ramp.exr", [4, 4]);
    bench.write("bilinear_square.obj", SQUARE);
    bench.write("bare.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n");
    let mesh = "def Mesh \"NAME\" {\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n \
                point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]\n}\n";
    let two = ["One", "Two"]
        .map(|name| mesh.replace("NAME", name))
        .concat();
    bench.write("two.usda", format!("#usda 1.0\n{two}"));
    let mut cut = std::fs::read(bench.path("noise.ptx")).expect("a file");
    cut.truncate(cut.len() / 2);
    bench.write("cut.ptx", cut);
    let to_ptex = ["ramp.exr", "-o", "out.ptx", "--mesh"];
    let of_noise = ["noise.ptx", "-o"];
    for (arguments, code, words) in [
        (
            &of_noise[..],
            &["out.tif"][..],
            2,
            &["out.tif", ".ptx, .exr or .png"][..],
        ),
        (
            &of_noise,
            &["out.exr", "--face", "3"],
            2,
            &["--face 3", "3 faces"],
        ),
        (&of_noise, &["out.ptx", "--face", "1"], 2, &["--face"]),
        (&of_noise, &["out.exr", "--type", "u8"], 2, &["--type"]),
        (
            &of_noise,
            &["out.ptx", "--scale", "3"],
            2,
            &["power of two"],
        ),
        (
            &of_noise,
            &["out.ptx", "--max-res", "21"],
            2,
            &["--max-res"],
        ),
        (&of_noise, &["out.ptx", "--res", "2"], 2, &["--mesh"]),
        (
            &of_noise,
            &["out.ptx", "--mesh", "bare.obj"],
            2,
            &["--mesh"],
        ),
        (
            &of_noise,
            &["out.png"],
            3,
            &["noise.ptx", "2 channels", ".exr"],
        ),
        (&of_noise, &["none/out.ptx"], 1, &["none"]),
        (
            &of_noise,
            &["out.exr", "--scale", "65536"],
            3,
            &["noise.ptx", "bytes", "--scale"],
        ),
        (&["ramp.exr", "-o"], &["out.ptx"], 2, &["--mesh"]),
        (
            &["ramp.exr", "-o"],
            &["out.png", "--mesh", "bare.obj"],
            2,
            &["out.png"],
        ),
        (&["cut.ptx", "-o"], &["out.ptx"], 3, &["cut.ptx", "help:"]),
        (&["none.ptx", "-o"], &["out.ptx"], 3, &["none.ptx", "help:"]),
        (
            &["none.exr", "-o"],
            &["out.ptx", "--mesh", "bilinear_square.obj"],
            3,
            &["none.exr", "help:"],
        ),
        (
            &to_ptex,
            &["bare.obj"],
            3,
            &["bare.obj", "no primvar \"st\"", "help:"],
        ),
        (&to_ptex, &["two.usda"], 3, &["two.usda", "/One, /Two"]),
        (
            &to_ptex,
            &["two.usda", "--prim", "/Three"],
            3,
            &["/Three", "/One, /Two"],
        ),
        (
            &to_ptex,
            &["two.usda", "--prim", "/Two"],
            3,
            &["/Two: ", "no primvar"],
        ),
        (
            &to_ptex,
            &["bilinear_square.obj", "--res", "20"],
            3,
            &["bilinear_square.obj", "face 0", "--res"],
        ),
    ]
    .map(|(first, more, code, words)| ([first, more].concat(), code, words))
    {
        let found = run(&bench, &arguments);
        assert!(found.0 == code, "{arguments:?}: {found:?}");
        expect(found, code, words);
    }
    let left = std::fs::read_dir(bench.folder()).expect("the folder");
    let left: Vec<_> = left
        .map(|entry| entry.expect("an entry").file_name())
        .filter(|name| name.to_string_lossy().contains("out"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}
