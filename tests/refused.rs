//! The system itself refuses memory, once, wherever the program or a library of its asks for much: each time there is an exit
//! code, an explanation, and no file that was not finished.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::program::said;
use crate::common::{effort, read};
use crate::stored::sheet;
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

const RENDER: &str = "render sheet.usda -o out.exr --progress none --spp 1 -t 2 --res 96 64 --dicing-rate 0.5 --cache-size 1M";

/// Each fifth piece, others by each method; `RELIEVO_EFFORT` of 5 or more refuses all, which takes some minutes.
#[test]
fn whichever_large_piece_of_memory_is_refused_the_program_ends_in_order() {
    let bench = sheet();
    // Large enough for its pixels to be asked for as such a piece.
    let pixels = "200 90 30 ".repeat(256 * 256);
    bench.write("heights.ppm", format!("P3 256 256 255\n{pixels}"));
    let library = refusing(bench.folder());
    let told = bench.path("refused");
    let picture = bench.path("out.exr");
    let step = (5 / effort().max(1) as usize).max(1);
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
            let mut kept = vec!["heights.ppm", "refuse.so", "refused", "sheet.usda"];
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
