use super::*;
use proptest::prelude::*;

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

fn text(text: &str, name: &str) -> Result<Description> {
    parse(text.as_bytes(), Path::new(name))
}

#[test]
fn tags_and_name_decide() {
    let tags = "t crease 2/1/0 0 1 2.5\nt corner 2/1/0 0 1 0\nt hole 1/0/0 0\nt creasemethod 0/0/1 chaikin\n";
    let d = text(&format!("{tags}{QUAD}"), "catmark_a_lefthanded.obj").expect("valid");
    let mesh = d.shapes[0].geometry.mesh().expect("a mesh");
    assert_eq!(mesh.boundary, BoundaryInterpolation::EdgeOnly);
    assert!(mesh.left_handed);
    assert_eq!(
        (mesh.creases[0].sharpness, mesh.corners[1].sharpness),
        (2.5, 0.0)
    );
    assert_eq!(mesh.holes, [0]);
    let d = text(QUAD, "a.obj").expect("valid");
    assert_eq!(
        d.shapes[0].geometry.mesh().expect("a mesh").boundary,
        BoundaryInterpolation::EdgeAndCorner
    );
}

#[test]
fn faults_name_the_line() {
    for (line, message) in [
        (
            "t crease 2/1/0 0 1",
            "a.obj: line 6: tag crease: 3 arguments announced, 2 found",
        ),
        (
            "t crease 2/1/0 0 1 -1",
            "a.obj: line 6: tag crease: sharpness -1",
        ),
        (
            "t nonsense 0/0/0",
            "a.obj: line 6: tag nonsense: wrong arguments",
        ),
        (
            "t corner 1/1/0 4 1",
            "a.obj: line 6: a tag names point 4 (from 0), but there are 4",
        ),
        ("f 1 2 5", "a.obj: line 6: face 1: point 5, but there are 4"),
        (
            "f 1 2 0",
            "a.obj: line 6: \"0\" is not the corner of a face",
        ),
        ("v 0 nan 0", "a.obj: line 6: \"nan\" is not a usable number"),
    ] {
        let error = text(&format!("{QUAD}{line}\n"), "a.obj").expect_err(line);
        assert_eq!(error.to_string(), message);
    }
}

#[test]
fn the_shared_shapes_load() {
    let Some(shared) = std::env::var_os("RELIEVO_SHARED") else {
        println!("SKIPPED: RELIEVO_SHARED is not set");
        return;
    };
    let mut count = 0;
    for folder in ["assets/opensubdiv", "assets/models"] {
        for entry in std::fs::read_dir(Path::new(&shared).join(folder)).expect("folder") {
            let path = entry.expect("entry").path();
            if path.extension().is_some_and(|e| e == "obj") {
                load(&path, &LoadOptions::default()).expect("loads");
                count += 1;
            }
        }
    }
    assert_eq!(count, 71);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = parse(&bytes, Path::new("loop_x.obj"));
    }

    #[test]
    fn random_statements_do_not_panic(
        words in prop::collection::vec("(v|vt|f|t|crease|corner|hole|[0-9]/[0-9]/[0-9]|-?[0-9]{1,20}|\n|usemtl a|\\\\\n)", 0..60)
    ) {
        let _ = parse(format!("{QUAD}{}", words.join(" ")).as_bytes(), Path::new("loop_x.obj"));
    }

    #[test]
    fn truncated_files_do_not_panic(length in 0..QUAD.len()) {
        let _ = parse(&QUAD.as_bytes()[..length], Path::new("x.obj"));
    }
}
