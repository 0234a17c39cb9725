//! `relievo subdivide`: counts, messages and exit codes of every scheme, and curves.

use std::fs;

use crate::common::program::{Bench, expect, said};

const CUBE: &str = "v -1 -1 -1\nv 1 -1 -1\nv 1 -1 1\nv -1 -1 1\nv -1 1 -1\nv 1 1 -1\nv 1 1 1\nv -1 1 1\n\
                    f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";
const OCTAHEDRON: &str = "v 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n\
                          f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 2 1 6\nf 3 2 6\nf 4 3 6\nf 1 4 6\n";
const CURVES: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nl 1 2 3 4 1\nl 1 2 3\n";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("cube.obj", CUBE);
    bench.write("octahedron.obj", OCTAHEDRON);
    bench.write("curves.obj", CURVES);
    bench
}

fn subdivide(bench: &Bench, arguments: &str) -> (i32, String) {
    let words: Vec<&str> = ["subdivide"]
        .into_iter()
        .chain(arguments.split(' '))
        .collect();
    said(&bench.command(&words).output().expect("the program runs"))
}

/// Points and faces of an OBJ file, or points and lines.
fn counts(bench: &Bench, name: &str) -> [usize; 2] {
    let text = fs::read_to_string(bench.path(name)).expect("written");
    let lines = |keywords: &[&str]| {
        let is_one = |line: &&str| keywords.iter().any(|k| line.starts_with(k));
        text.lines().filter(is_one).count()
    };
    [lines(&["v "]), lines(&["f ", "l "])]
}

#[test]
fn each_scheme_makes_its_points_and_faces() {
    let bench = bench();
    for (arguments, expected) in [
        ("cube.obj --scheme catmark -n 2", [98, 96]),
        ("cube.obj --scheme bilinear", [26, 24]),
        ("octahedron.obj --scheme loop -n 2", [66, 128]),
        ("cube.obj --scheme doo-sabin", [24, 26]),
        ("cube.obj --scheme doo-sabin -n 2 --limit", [96, 98]),
        ("octahedron.obj --scheme butterfly -n 2", [66, 128]),
        ("octahedron.obj --scheme sqrt3", [14, 24]),
        ("octahedron.obj --scheme sqrt3 -n 2 --limit", [38, 72]),
        ("octahedron.obj --scheme butterfly -n 0", [6, 8]),
    ] {
        expect(
            subdivide(&bench, &format!("{arguments} -o out.obj")),
            0,
            &[],
        );
        assert_eq!(counts(&bench, "out.obj"), expected, "{arguments}");
    }
}

#[test]
fn curves_become_finer_curves_or_a_page() {
    let bench = bench();
    expect(subdivide(&bench, "curves.obj -n 2 -o out.obj"), 0, &[]);
    // Closed: 4, 8, 16. Open: 3, 6, 12.
    assert_eq!(counts(&bench, "out.obj"), [28, 2]);
    let read = "out.obj --scheme chaikin -n 0 --limit -o limit.obj";
    expect(subdivide(&bench, read), 0, &[]);
    assert_eq!(counts(&bench, "limit.obj"), [28, 2]);
    expect(subdivide(&bench, "curves.obj -n 3 -o page.svg"), 0, &[]);
    let page = fs::read_to_string(bench.path("page.svg")).expect("written");
    assert_eq!(page.matches("<polygon").count(), 4);
    assert_eq!(page.matches("<polyline").count(), 4);
}

#[test]
fn a_finer_mesh_is_a_layer_of_usd() {
    let bench = bench();
    expect(
        subdivide(&bench, "cube.obj --scheme doo-sabin -n 2 -o out.usda"),
        0,
        &[],
    );
    let output = bench
        .command(&["info", "out.usda"])
        .output()
        .expect("the program runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("98 faces"), "{text}");
}

#[test]
fn what_has_no_effect_is_said() {
    let bench = bench();
    let tags = "t crease 2/1/0 0 1 2\nt corner 1/1/0 3 10\n";
    bench.write("tagged.obj", format!("{OCTAHEDRON}{tags}"));
    let ignored =
        |scheme: &str| subdivide(&bench, &format!("tagged.obj --scheme {scheme} -o out.obj"));
    let words = ["tagged.obj: 2 creases and corners", "Butterfly"];
    expect(ignored("butterfly"), 0, &words);
    // √3 keeps corners.
    expect(ignored("sqrt3"), 0, &["tagged.obj: 1 creases and corners"]);
    let (_, text) = ignored("loop");
    assert!(!text.contains("no effect"), "{text}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let bench = bench();
    for (arguments, code, words) in [
        ("cube.obj -o out.svg", 2, "only curves are drawn"),
        ("cube.obj -o out.ply", 2, "out.ply"),
        ("curves.obj --limit -o out.svg", 2, "all levels"),
        ("curves.obj --boundary none -o out.obj", 2, "not for curves"),
        (
            "cube.obj --scheme doo-sabin -n 0 --limit -o out.obj",
            2,
            "one level at least",
        ),
        ("cube.obj --scheme midpoint -o out.obj", 2, "doo-sabin"),
        (
            "cube.obj --scheme butterfly -o out.obj",
            3,
            "cube.obj: face 0",
        ),
        ("cube.obj --scheme chaikin -o out.obj", 3, "no polylines"),
        ("curves.obj --scheme loop -o out.obj", 3, "no faces"),
        ("none.obj --scheme sqrt3 -o out.obj", 3, "none.obj"),
    ] {
        expect(subdivide(&bench, arguments), code, &[words]);
        assert!(!bench.path("out.obj").exists(), "{arguments}");
    }
}

/// What a level leaves to be done is in the file: two commands make what one makes.
#[test]
fn a_level_at_a_time_is_the_same() {
    let bench = bench();
    let tags = "t crease 2/1/0 0 1 2.5\nt crease 2/1/0 1 2 1.5\nt corner 1/1/0 3 1.2\nt creasemethod 0/0/1 chaikin\n\
                t smoothtriangles 0/0/1 smooth\n";
    let triangle = CUBE.replace("f 4 8 5 1\n", "f 4 8 5\nf 4 5 1\n");
    bench.write("catmark_tagged.obj", format!("{triangle}{tags}"));
    for arguments in [
        "catmark_tagged.obj -n 2 -o whole.obj",
        "catmark_tagged.obj -n 1 -o half.obj",
        "half.obj -n 1 -o halves.obj",
    ] {
        expect(subdivide(&bench, arguments), 0, &[]);
    }
    let points = |name: &str| -> Vec<Vec<f32>> {
        let text = fs::read_to_string(bench.path(name)).expect("written");
        let lines = text.lines().filter_map(|line| line.strip_prefix("v "));
        let words = lines.map(|line| line.split(' ').map(|w| w.parse().expect("a number")));
        words.map(Iterator::collect).collect()
    };
    // Numbers of points follow those of the cage's edges, which are others in the middle of the way.
    let (whole, halves) = (points("whole.obj"), points("halves.obj"));
    assert_eq!(whole.len(), halves.len());
    for a in &whole {
        let is_same = |b: &&Vec<f32>| a.iter().zip(*b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(halves.iter().any(|b| is_same(&b)), "{a:?}");
    }
}
