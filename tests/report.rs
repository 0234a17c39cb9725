//! `bench --report`: the page is well-formed and shows what was measured, the copy beside it is what is printed.

use std::fs;

use relievo::world::Method;
use roxmltree::{Document, Node, ParsingOptions};
use serde_json::Value;

use crate::common::program::{Bench, expect, said};

const TETRAHEDRON: &str = r#"#usda 1.0
def Mesh "Rounded" {
    int[] faceVertexCounts = [3, 3, 3, 3]
    int[] faceVertexIndices = [0, 2, 1,  0, 1, 3,  1, 2, 3,  2, 0, 3]
    point3f[] points = [(1, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1)]
}
"#;

const HTML: &str = "http://www.w3.org/1999/xhtml";
const SVG: &str = "http://www.w3.org/2000/svg";

fn elements<'a>(
    node: Node<'a, 'a>,
    name: (&'static str, &'static str),
) -> impl Iterator<Item = Node<'a, 'a>> {
    node.descendants().filter(move |n| n.has_tag_name(name))
}

fn text(node: Node<'_, '_>) -> String {
    let pieces = node.descendants().filter(Node::is_text);
    let text: String = pieces.filter_map(|piece| piece.text()).collect();
    text.trim().to_owned()
}

fn parsed(html: &str) -> Document<'_> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(html, options).expect("well-formed")
}

/// Three plots and a table with all rows.
fn check_section(section: Node<'_, '_>, measured: &Value) {
    let plots: Vec<Node> = elements(section, (HTML, "figure"))
        .flat_map(|figure| elements(figure, (SVG, "svg")))
        .collect();
    assert_eq!(plots.len(), 3);
    for method in Method::ALL {
        let name = method.name();
        for plot in &plots {
            let mut texts = elements(*plot, (SVG, "text"));
            assert!(texts.any(|t| text(t) == name), "{name} is not in a plot");
        }
    }
    let rows = measured["rows"].as_array().expect("rows");
    let methods = rows.iter().map(|row| row["method"].as_str());
    assert!(
        methods.eq(Method::ALL.map(|m| Some(m.name()))),
        "{measured}"
    );
    for row in rows {
        let number = |value: &Value| value.as_f64().expect("a number");
        let (rms, max) = (number(&row["rms_distance"]), number(&row["max_distance"]));
        assert!(0.0 < rms && rms < max && max < 1e-2, "{row}");
        let added = number(&row["rms_to_triangles"]);
        assert!(added <= number(&row["max_to_triangles"]), "{row}");
        // All but Embree's subdivision dice alike. A slab is hit somewhere within, and says how thick it is.
        let thick = match row["method"].as_str() {
            Some("compressed" | "nonlinear") => number(&row["achieved_error"]["rms_diagonals"]),
            _ => 0.0,
        };
        assert!(
            added < 2e-5 + thick || row["method"] == "embree-subdivision",
            "{row}"
        );
        let line = elements(section, (HTML, "tr"))
            .find(|line| elements(*line, (HTML, "th")).any(|head| text(head) == row["method"]))
            .unwrap_or_else(|| panic!("{row} is not in the table"));
        let cells: Vec<String> = elements(line, (HTML, "td")).map(text).collect();
        let speed = |threads: &str| {
            let figure = |table: &str| number(&row[table]["diffuse"][threads]);
            format!("{:.2} {:.2}", figure("mrays"), figure("ratio"))
        };
        let wanted = [
            format!("{:.2}", number(&row["bytes_per_micro_triangle"])),
            format!("{:.3}", number(&row["build_seconds"])),
            speed("1"),
            format!("{rms:.2e}"),
            format!("{max:.2e}"),
            format!("{added:.2e}"),
        ];
        for figure in wanted {
            assert!(cells.contains(&figure), "{figure} is not in {cells:?}");
        }
        if row["achieved_error"].is_object() {
            let of_method = format!("{}, ", row["method"].as_str().expect("a name"));
            let starts = |head| text(head).starts_with(&of_method);
            let line = elements(section, (HTML, "tr"))
                .find(|line| elements(*line, (HTML, "th")).any(starts))
                .unwrap_or_else(|| panic!("{row} is not in the second table"));
            let cells: Vec<String> = elements(line, (HTML, "td")).map(text).collect();
            let rms = number(&row["achieved_error"]["rms_diagonals"]);
            let linear = &row["achieved_error"]["linear_normals"]["rms_diagonals"];
            let linear = linear
                .as_f64()
                .map_or("–".to_owned(), |d| format!("{d:.2e}"));
            let hit = number(&row["max_hit_error"]);
            assert_eq!(
                [&cells[0], &cells[2], &cells[4]],
                [&format!("{rms:.2e}"), &linear, &format!("{hit:.2e}")]
            );
        }
    }
}

#[test]
fn every_method_of_every_scene_is_shown() {
    let bench = Bench::new();
    // Nothing in a name may end a tag.
    let scenes = ["one.usda", "a&b <two>.usda"];
    for scene in scenes {
        bench.write(scene, TETRAHEDRON);
    }
    let options = "--json --rays 2000 --micro-triangles 2000 --report out.html";
    let options: Vec<&str> = options.split(' ').collect();
    let printed = bench.report(&[&["bench"], &scenes[..], &options[..]].concat());

    let copy = fs::read_to_string(bench.path("out.json")).expect("a copy");
    let copy: Value = serde_json::from_str(&copy).expect("JSON");
    assert_eq!(copy, printed);
    let html = fs::read_to_string(bench.path("out.html")).expect("a page");
    let page = parsed(&html);
    assert_eq!(elements(page.root(), (HTML, "script")).count(), 0);
    let sections: Vec<Node> = elements(page.root(), (HTML, "section")).collect();
    assert_eq!(sections.len(), scenes.len());
    for (i, (section, scene)) in sections.into_iter().zip(scenes).enumerate() {
        assert_eq!(printed[i]["scene"], scene);
        let heading = elements(section, (HTML, "h2")).next().map(text);
        assert_eq!(heading.as_deref(), Some(scene));
        let embree = printed[i]["machine"]["embree"].as_str().expect("a version");
        assert!(text(section).contains(&format!("Embree {embree}")));
        check_section(section, &printed[i]);
    }
    // Two scenes, the page and its copy: nothing temporary.
    let files = fs::read_dir(bench.folder()).expect("a folder").count();
    assert_eq!(files, 4);
}

/// A curve of speed against detail, where a scene is measured at several numbers of micro-triangles; and ratios to any
/// method.
#[test]
fn detail_is_drawn_and_any_method_may_be_the_measure() {
    let bench = Bench::new();
    bench.write("one.usda", TETRAHEDRON);
    let options = "bench one.usda --json --rays 500 --micro-triangles 500 --and-at 1000,4000 --methods dbvh,compact \
                   --relative-to compact --report out.html";
    let printed = bench.report(&options.split_whitespace().collect::<Vec<_>>());
    let all = printed.as_array().expect("several");
    let counts: Vec<u64> = (all.iter())
        .map(|one| one["rows"][0]["micro_triangles"].as_u64().expect("a count"))
        .collect();
    assert!(
        counts.is_sorted_by(|a, b| 2 * a <= 3 * b) && counts.len() == 3,
        "{counts:?}"
    );
    for one in all {
        assert_eq!(one["relative_to"], "compact");
        let rows = one["rows"].as_array().expect("rows");
        let names: Vec<_> = rows.iter().map(|row| row["method"].as_str()).collect();
        assert_eq!(names, [Some("dbvh"), Some("compact")]);
        assert_eq!(rows[1]["ratio"]["primary"]["1"], 1.0);
    }
    let html = fs::read_to_string(bench.path("out.html")).expect("a page");
    let page = parsed(&html);
    assert_eq!(elements(page.root(), (HTML, "section")).count(), 3);
    let named = |name: &str| {
        let mut plots = elements(page.root(), (SVG, "svg"));
        plots
            .find(|plot| plot.attribute("aria-label") == Some(name))
            .map(|plot| plot.descendants().count())
    };
    let curve = named("Detail against speed on one.usda").expect("a curve");
    // A mark for each method, kind of rays and number of micro-triangles at least.
    assert!(curve > 12, "{curve}");

    let mut command = bench.command(&["bench", "one.usda", "--relative-to", "auto"]);
    expect(
        said(&command.output().expect("the program runs")),
        2,
        &["--relative-to"],
    );
}

#[test]
fn a_place_that_cannot_be_written_to_is_told_of_before_anything_is_measured() {
    let bench = Bench::new();
    // There is no scene either: the page is asked for first.
    let run = |report: &str| {
        let mut command = bench.command(&["bench", "none.usda", "--report", report]);
        said(&command.output().expect("the program runs"))
    };
    expect(
        run("nowhere/out.html"),
        1,
        &["nowhere", "Create the folder"],
    );
    expect(run("out.json"), 2, &["out.json", ".html"]);
    expect(run("out.html"), 3, &["none.usda"]);
}
