//! All ways of tracing show one surface, and `verify` and `bench` say so in the form that they promise.

use std::sync::Arc;

use relievo::accel::{Intersector, Tessellated};
use relievo::math::{Ray, Vec3};
use relievo::mesh::{ControlMesh, Crease, Scheme};
use relievo::surface::{
    Amount, Diced, Displacement, Function, Rates, Subdivision, Surface, UvRect,
};
use relievo::world::Method;

use crate::common::program::{Bench, expect, said};

/// A house: a cube with a roof, of quads, triangles and pentagons, one eave half sharp.
const HOUSE: &str = r#"#usda 1.0
def Mesh "House" {
    int[] faceVertexCounts = [4, 4, 4, 5, 5, 4, 4]
    int[] faceVertexIndices = [0, 3, 2, 1,  0, 1, 5, 4,  2, 3, 7, 6,  1, 2, 6, 9, 5,  3, 0, 4, 8, 7,  4, 5, 9, 8,  8, 9, 6, 7]
    point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, 0, 2), (1, 0, 2)]
    int[] creaseIndices = [4, 5]
    int[] creaseLengths = [2]
    float[] creaseSharpnesses = [2.5]
}
"#;

fn house() -> ControlMesh {
    let p = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    ControlMesh {
        face_vertex_counts: vec![4, 4, 4, 5, 5, 4, 4],
        face_vertex_indices: vec![
            0, 3, 2, 1, 0, 1, 5, 4, 2, 3, 7, 6, 1, 2, 6, 9, 5, 3, 0, 4, 8, 7, 4, 5, 9, 8, 8, 9, 6,
            7,
        ],
        points: vec![vec![
            p(-1.0, -1.0, 0.0),
            p(1.0, -1.0, 0.0),
            p(1.0, 1.0, 0.0),
            p(-1.0, 1.0, 0.0),
            p(-1.0, -1.0, 1.0),
            p(1.0, -1.0, 1.0),
            p(1.0, 1.0, 1.0),
            p(-1.0, 1.0, 1.0),
            p(-1.0, 0.0, 2.0),
            p(1.0, 0.0, 2.0),
        ]],
        creases: vec![
            Crease {
                vertices: [4, 5],
                sharpness: 2.5,
            },
            Crease {
                vertices: [0, 1],
                sharpness: Crease::INFINITE,
            },
        ],
        ..ControlMesh::default()
    }
}

/// An octahedron for Loop.
fn octahedron() -> ControlMesh {
    ControlMesh {
        scheme: Scheme::Loop,
        face_vertex_counts: vec![3; 8],
        face_vertex_indices: vec![
            0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5,
        ],
        points: vec![vec![
            Vec3::X,
            Vec3::NEG_X,
            Vec3::Y,
            Vec3::NEG_Y,
            Vec3::Z,
            Vec3::NEG_Z,
        ]],
        creases: vec![Crease {
            vertices: [0, 2],
            sharpness: 1.5,
        }],
        ..ControlMesh::default()
    }
}

fn waves() -> Displacement {
    let wave = |p: Vec3| 0.05 * ((7.0 * p.x).sin() + (9.0 * p.y).sin() * (8.0 * p.z).cos());
    Displacement::Scalar(Amount {
        map: Arc::new(Function::scalar(move |at| wave(at.position)).bounded(|_| {
            relievo::math::Bounds3 {
                min: Vec3::new(-0.101, 0.0, 0.0),
                max: Vec3::new(0.101, 0.0, 0.0),
            }
        })),
        scale: 1.0,
        bias: 0.0,
    })
}

/// A direction for each number, without pattern.
fn direction(i: u32) -> Vec3 {
    let z = 2.0 * (i as f32 * 0.754_877_7).fract() - 1.0;
    let (sin, cos) = (std::f32::consts::TAU * (i as f32 * 0.569_840_3).fract()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

#[test]
fn displaced_creased_cages_of_any_faces_are_tight_and_bounded() {
    for (mesh, inside) in [
        (house(), Vec3::new(0.0, 0.0, 0.7)),
        (octahedron(), Vec3::ZERO),
    ] {
        mesh.validate().expect("a valid cage");
        let surface = Surface::new(Arc::new(Subdivision::new(&mesh, None)), waves());
        let rates = Rates::by_edge(&surface, |edge| 1 + edge * 7 % 13);
        let diced = Arc::new(Diced::new(&surface, &rates));
        for grid in diced.grids() {
            let bounds = surface
                .bounds(grid.face, &UvRect::UNIT, 0)
                .expect("the waves have a bound");
            let [columns, rows] = grid.vertices();
            for v in grid.first_vertex..grid.first_vertex + columns * rows {
                let p = diced.positions()[0][v as usize];
                assert_eq!(bounds.including(p), bounds, "face {}", grid.face);
            }
        }
        let tree = Tessellated::build(diced.clone());
        let lost = (0..100_000)
            .filter(|&i| {
                tree.intersect(0, &Ray::new(inside, direction(i), 0.0))
                    .is_none()
            })
            .count();
        // Through the micro-vertices themselves, where cracks would be.
        let lost_at_vertices = diced.positions()[0]
            .iter()
            .filter(|&&p| !tree.occluded(0, &Ray::new(inside, p - inside, 0.0)))
            .count();
        assert_eq!((lost, lost_at_vertices), (0, 0), "{:?}", mesh.scheme);
    }
}

#[test]
fn verify_finds_one_surface_by_all_methods() {
    let bench = Bench::new();
    bench.write("house.usda", HOUSE);
    let report = bench.report(&[
        "verify",
        "house.usda",
        "--json",
        "--rays",
        "20000",
        "--micro-triangles",
        "60000",
    ]);
    assert_eq!(report["scene"], "house.usda");
    let rows = report["rows"].as_array().expect("rows");
    // Each method against two references, but Embree's own against fine triangles only.
    assert_eq!(rows.len(), 2 * Method::ALL.len() - 1, "{report}");
    for row in rows {
        let number = |name: &str| row[name].as_f64().expect("a number");
        assert_eq!(number("rays"), 20_000.0);
        // A slab is hit somewhere within, and says how thick it is; heights lie beside their parameters.
        let thick = match row["method"].as_str() {
            Some("compressed" | "nonlinear") => row["achieved_error"]["max_diagonals"]
                .as_f64()
                .expect("told"),
            _ => 0.0,
        };
        assert!(thick < 5e-4, "{row}");
        assert!(number("max_distance") < 1e-4 + thick, "{row}");
        assert!(number("rms_distance") <= number("max_distance"), "{row}");
        assert!(number("max_normal_degrees") < 10.0, "{row}");
        assert!(
            number("only_method") + number("only_reference") < 40.0,
            "{row}"
        );
        assert_eq!(number("leaks"), 0.0, "{row}");
        let method = row["method"].as_str().expect("a name");
        if ["dbvh", "nonlinear"].contains(&method) {
            assert!((1e-12..1e-5).contains(&number("max_hit_error")), "{row}");
            assert!(row["achieved_error"]["linear_normals"]["max_diagonals"].is_f64());
        }
    }
}

#[test]
fn bench_reports_every_method() {
    let bench = Bench::new();
    bench.write("house.usda", HOUSE);
    let report = bench.report(&[
        "bench",
        "house.usda",
        "--json",
        "--rays",
        "2000",
        "--micro-triangles",
        "2000",
        "--methods",
        "embree-triangles,tessellated",
    ]);
    assert!(report["machine"]["threads"].is_u64(), "{report}");
    let rows = report["rows"].as_array().expect("rows");
    let methods: Vec<&str> = rows
        .iter()
        .filter_map(|row| row["method"].as_str())
        .collect();
    assert_eq!(methods, ["embree-triangles", "tessellated"]);
    for row in rows {
        let count = row["micro_triangles"].as_f64().expect("a count");
        assert!((1000.0..4000.0).contains(&count), "{row}");
        for name in ["bytes", "bytes_per_micro_triangle", "build_seconds"] {
            assert!(row[name].as_f64().expect("a number") > 0.0, "{name}: {row}");
        }
        for kind in ["primary", "diffuse", "shadow"] {
            for table in ["mrays", "ratio"] {
                let speed = row[table][kind]["1"].as_f64().expect("a number");
                assert!(speed > 0.0, "{table} {kind}: {row}");
            }
        }
    }
    assert_eq!(rows[0]["ratio"]["primary"]["1"], 1.0);
}

#[test]
fn the_error_that_compression_achieves_is_told() {
    let bench = Bench::new();
    bench.write("house.usda", HOUSE);
    let small = [
        "house.usda",
        "--methods",
        "embree-grid,compact",
        "--rays",
        "500",
    ];
    let row = |command: &str, more: &[&str]| {
        let arguments = [&[command, "--json"], small.as_slice(), more].concat();
        let report = bench.report(&arguments);
        let of = |method: &str| {
            let mut rows = report["rows"].as_array().expect("rows").iter();
            let row = rows.find(|row| row["method"] == method).expect("a row");
            row["achieved_error"].clone()
        };
        assert!(of("embree-grid").is_null());
        let (max, rms) = (
            &of("compact")["max_diagonals"],
            &of("compact")["rms_diagonals"],
        );
        let numbers = [max, rms].map(|number| number.as_f64().expect("a number"));
        (numbers, of("compact")["max_pixels"].as_f64())
    };
    let coarse = ["--micro-triangles", "5000", "--max-error", "1e-3"];
    for command in ["bench", "verify"] {
        let ([max, rms], pixels) = row(command, &coarse);
        assert!((0.8e-3..1.001e-3).contains(&max), "{command}: {max}");
        assert!((0.3e-3..0.8e-3).contains(&rms), "{command}: {rms}");
        assert_eq!(pixels, None);
    }
    let ([max, _], _) = row("bench", &["--micro-triangles", "5000"]);
    assert!((1e-5..3.61e-5).contains(&max), "{max}");
    let (_, pixels) = row("bench", &["--dicing-rate", "20", "--max-error", "0.5px"]);
    let pixels = pixels.expect("there is a camera");
    assert!((0.4..0.5001).contains(&pixels), "{pixels}");

    // A render tells it too.
    let arguments = [
        "--method",
        "compact",
        "--max-error",
        "0.1px",
        "--stats",
        "stats.json",
    ];
    expect(bench.render("house.usda", &arguments), 0, &[]);
    let stats = std::fs::read(bench.path("stats.json")).expect("statistics");
    let stats: serde_json::Value = serde_json::from_slice(&stats).expect("one object");
    let pixels = stats["achieved_error"]["max_pixels"].as_f64();
    assert!((0.05..0.1001).contains(&pixels.expect("pixels")), "{stats}");

    for bad in [
        "0",
        "-1px",
        "nan",
        "infpx",
        "px",
        "0.25 pixels",
        "",
        "1e-5 diagonals",
    ] {
        let more = format!("--max-error={bad}");
        for command in ["bench", "verify", "render"] {
            let output = bench.command(&[command, "house.usda", &more]).output();
            expect(
                said(&output.expect("the program runs")),
                2,
                &["--max-error"],
            );
        }
    }
    let blind = ["bench", "house.usda", "--max-error", "0.25px"];
    let output = bench.command(&blind).output().expect("the program runs");
    expect(said(&output), 2, &["--dicing-rate"]);
}
