//! The page of a report.

use super::Measured;
use super::plots::{self, KINDS, LEAST_DISTANCE, colour, figure, most_threads};
use crate::compare::achieved_by;
use crate::compare::bench::{Bench, BenchRow};
use crate::error::Result;
use crate::world::Method;

/// Plots are drawn in black and grey: on a dark screen these become the page's colours.
const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5a5f66; --paper: #ffffff; --grid: #d4d4d4; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --soft: #a4a9b0; --paper: #16181c; --grid: #3a3e44; }
}
body { margin: 2rem auto; padding: 0 1rem; max-width: 76rem; font: 1rem/1.5 sans-serif;
  color: var(--ink); background: var(--paper); }
h1, h2 { line-height: 1.2; }
h2 { margin-top: 3rem; overflow-wrap: anywhere; }
a { color: inherit; }
p { max-width: 60rem; }
p.facts, figcaption { color: var(--soft); }
figure { margin: 2rem 0; break-inside: avoid; }
figcaption { max-width: 46rem; margin-top: 0.75rem; }
figure svg { display: block; width: 100%; max-width: 47.5rem; height: auto; }
figure svg text, figure svg [fill='#000000'] { fill: var(--ink); }
figure svg [stroke='#000000'] { stroke: var(--ink); }
figure svg [stroke='#C8C8C8'] { stroke: var(--grid); }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.875rem; font-variant-numeric: tabular-nums; white-space: nowrap; }
caption { text-align: left; color: var(--soft); white-space: normal; padding-bottom: 0.5rem; }
th, td { padding: 0.2rem 0.6rem; text-align: right; border-bottom: 1px solid var(--grid); font-weight: normal; }
th:first-child, td:first-child { text-align: left; }
thead th { vertical-align: bottom; color: var(--soft); }
small { color: var(--soft); }
dt { font-weight: bold; }
@media print { body { margin: 0; max-width: none; font-size: 9pt; } figure { margin: 0.5rem 0; } figure svg { max-width: 34rem; }
  table { font-size: 6.5pt; } small { font-size: 5pt; }
  th, td { padding: 0.1rem 0.25rem; } section { break-before: page; } section:first-of-type { break-before: auto; } }
";

/// The whole page.
pub(super) fn page(all: &[Measured]) -> Result<String> {
    let title = match all {
        [one, rest @ ..] if rest.iter().all(|other| other.scene == one.scene) => {
            format!("relievo bench: {}", escaped(&one.scene))
        }
        all => {
            let scenes = all.chunk_by(|a, b| a.scene == b.scene).count();
            format!("relievo bench: {scenes} scenes")
        }
    };
    let mut html = format!(
        "<!DOCTYPE html>\n<html xmlns=\"http://www.w3.org/1999/xhtml\" lang=\"en\">\n<head>\n\
         <meta charset=\"utf-8\"/>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>Ways of tracing, measured</h1>\n\
         <p>One surface can be traced in many ways. Each of them is measured here on the same micro-triangles and the \
         same rays: the memory that it takes, how fast rays are, and how far what they meet is from the surface.</p>\n"
    );
    if all.len() > 1 {
        html += "<ul>\n";
        for (i, one) in all.iter().enumerate() {
            html += &format!(
                "<li><a href=\"#scene-{i}\">{}</a>, {} micro-triangles</li>\n",
                escaped(&one.scene),
                grouped(micro_triangles(&one.bench))
            );
        }
        html += "</ul>\n";
    }
    for (i, one) in all.iter().enumerate() {
        html += &section(i, one)?;
    }
    for of_scene in all.chunk_by(|a, b| a.scene == b.scene) {
        html += &detail(of_scene)?;
    }
    html += &methods(all);
    html += "</body>\n</html>\n";
    Ok(html)
}

fn micro_triangles(bench: &Bench) -> u64 {
    bench.rows.first().map_or(0, |row| row.micro_triangles)
}

/// What detail costs: speed against micro-triangles, of a scene that was measured at several numbers of them.
fn detail(all: &[Measured]) -> Result<String> {
    let [first, _, ..] = all else {
        return Ok(String::new());
    };
    let scene = escaped(&first.scene);
    let rows: Vec<&BenchRow> = all.iter().flat_map(|one| &one.bench.rows).collect();
    let threads = most_threads(&first.bench.rows);
    Ok(format!(
        "<h2>Detail on {scene}</h2>\n{}",
        figure_of(
            &plots::detail(&rows, &threads)?,
            &format!("Detail against speed on {scene}"),
            &format!(
                "Detail against speed: across, micro-triangles on a logarithmic scale; upwards, millions of rays a second \
                 on {}. Discs are primary rays, lozenges are diffuse ones. A line that falls evenly is a cost that grows \
                 with the logarithm of detail.",
                counted(&threads, "thread")
            ),
        )
    ))
}

fn section(number: usize, one: &Measured) -> Result<String> {
    let Measured { scene, bench } = one;
    let rows = &bench.rows;
    let scene = escaped(scene);
    let threads = most_threads(rows);
    let mut html = format!(
        "<section id=\"scene-{number}\">\n<h2>{scene}</h2>\n{}",
        facts(bench)
    );
    html += &figure_of(
        &plots::speed(rows)?,
        &format!("Memory against speed on {scene}"),
        &format!(
            "Memory against speed: to the left is smaller, up is faster. Across, bytes for each micro-triangle, \
             everything counted, on a logarithmic scale; upwards, millions of rays a second on {}. Discs are primary \
             rays, through the pixels of the camera; lozenges are diffuse ones, that leave where those hit.",
            counted(&threads, "thread")
        ),
    );
    if let (Some(plot), Some(reference)) = (plots::error(rows)?, bench.reference) {
        html += &figure_of(
            &plot,
            &format!("Memory against error on {scene}"),
            &format!(
                "Memory against error: to the left is smaller, down is closer. Upwards, the root of the mean squared \
                 distance, in diagonals of each mesh's box, on a logarithmic scale, of what {} rays met. Discs are \
                 distances to the same surface diced {} times as finely: what micro-triangles of this size are off by, \
                 by any method, and what the method adds. Lozenges are distances to {} diced alike: only what the method \
                 adds. What is below {LEAST_DISTANCE:.0e}, where single precision ends, is drawn there.",
                grouped(reference.rays),
                reference.finer,
                bench.relative_to
            ),
        );
    }
    html += &figure_of(
        &plots::ratios(bench)?,
        &format!("Speed by kinds of rays on {scene}"),
        &format!(
            "Speed as a ratio to {}, by kinds of rays and threads: above the line is faster. Shadow rays run from where \
             primary ones hit to a point above the scene and stop at whatever they meet.",
            bench.relative_to
        ),
    );
    html += &table(bench);
    html += &achieved(bench);
    html += "</section>\n";
    Ok(html)
}

/// What was measured, and on what; what could not be.
fn facts(bench: &Bench) -> String {
    let machine = &bench.machine;
    let rays: Vec<String> = KINDS
        .iter()
        .filter_map(|kind| Some(format!("{} {kind}", grouped(*bench.rays.get(kind)?))))
        .collect();
    format!(
        "<p class=\"facts\">{} micro-triangles; {} rays.<br/>\n{}, {}; Embree {}; relievo {}; {}.</p>\n",
        grouped(micro_triangles(bench)),
        rays.join(", "),
        escaped(&machine.processor),
        counted(&machine.threads.to_string(), "thread"),
        escaped(&machine.embree),
        escaped(machine.relievo),
        escaped(&bench.date),
    ) + &bench.bounce_dicing.map_or_else(String::new, |times| {
        format!("<p>Diffuse rays meet micro-edges {times} times as long.</p>\n")
    }) + &bench
        .warnings
        .iter()
        .map(|w| format!("<p>Warning: {}</p>\n", escaped(&w.message)))
        .collect::<String>()
}

fn figure_of(svg: &str, name: &str, caption: &str) -> String {
    let named = svg.replacen(
        "<svg ",
        &format!("<svg role=\"img\" aria-label=\"{name}\" "),
        1,
    );
    format!("<figure>\n{named}<figcaption>{caption}</figcaption>\n</figure>\n")
}

/// All figures.
fn table(bench: &Bench) -> String {
    let rows = &bench.rows;
    let Some(first) = rows.first() else {
        return String::new();
    };
    let has_distances = rows.iter().any(|row| row.rms_distance.is_some());
    let columns: Vec<(&str, &String)> = KINDS
        .iter()
        .filter_map(|kind| Some((*kind, first.mrays.get(kind)?)))
        .flat_map(|(kind, by_threads)| by_threads.keys().map(move |threads| (kind, threads)))
        .collect();
    let mut html = format!(
        "<div class=\"wide\">\n<table>\n<caption>All figures. Speeds are millions of rays a second, medians \
                    of five; in small, the ratio to {}. Building is dicing and building trees, on all \
                    threads. Distances are in diagonals of each mesh's box.</caption>\n<thead><tr><th scope=\"col\">method</th><th scope=\"col\">bytes each</th>\
                    <th scope=\"col\">MB</th><th scope=\"col\">build s</th>",
        bench.relative_to
    );
    for (kind, threads) in &columns {
        html += &format!(
            "<th scope=\"col\">{kind},<br/>{}</th>",
            counted(threads, "thread")
        );
    }
    if has_distances {
        html += "<th scope=\"col\">RMS to<br/>finer</th><th scope=\"col\">largest to<br/>finer</th>\
                 <th scope=\"col\">RMS to<br/>triangles</th><th scope=\"col\">largest to<br/>triangles</th>";
    }
    html += "</tr></thead>\n<tbody>\n";
    for row in rows {
        html += &format!(
            "<tr><th scope=\"row\">{} {}</th><td>{:.2}</td><td>{:.1}</td><td>{:.3}</td>",
            swatch(row.method),
            row.method,
            row.bytes_per_micro_triangle,
            1e-6 * row.bytes as f64,
            row.build_seconds
        );
        for (kind, threads) in &columns {
            html += &format!(
                "<td>{:.2} <small>{:.2}</small></td>",
                figure(&row.mrays, kind, threads),
                figure(&row.ratio, kind, threads)
            );
        }
        if has_distances {
            let cell = |d: Option<f64>| d.map_or("–".to_owned(), |d| format!("{d:.2e}"));
            let distances = [
                row.rms_distance,
                row.max_distance,
                row.rms_to_triangles,
                row.max_to_triangles,
            ];
            for distance in distances {
                html += &format!("<td>{}</td>", cell(distance));
            }
        }
        html += "</tr>\n";
    }
    html + "</tbody>\n</table>\n</div>\n"
}

/// What methods change about the surface, and how near hits are to what they made of it.
fn achieved(bench: &Bench) -> String {
    let mut rows = String::new();
    for row in &bench.rows {
        let Some(error) = row.achieved_error else {
            continue;
        };
        let cell = |d: Option<f64>| d.map_or("–".to_owned(), |d| format!("{d:.2e}"));
        let linear = error.linear_normals;
        rows += &format!(
            "<tr><th scope=\"row\">{} {}, {}</th>",
            swatch(row.method),
            row.method,
            achieved_by(row.method)
        );
        let distances = [
            Some(error.rms_diagonals),
            Some(error.max_diagonals),
            linear.map(|linear| linear.rms_diagonals),
            linear.map(|linear| linear.max_diagonals),
            row.max_hit_error,
        ];
        for distance in distances {
            rows += &format!("<td>{}</td>", cell(distance));
        }
        rows += "</tr>\n";
    }
    if rows.is_empty() {
        return rows;
    }
    format!(
        "<div class=\"wide\">\n<table>\n<caption>What methods change about the surface, in diagonals of each object's box, as they \
         measured while they built; by how much normals of unit length in place of linear ones would move what is \
         displaced along them; and how far hits were at most from the very geometry that the method traces, measured \
         at each hit.</caption>\n<thead><tr><th scope=\"col\">method</th><th scope=\"col\">RMS</th>\
         <th scope=\"col\">largest</th><th scope=\"col\">RMS by<br/>unit normals</th>\
         <th scope=\"col\">largest by<br/>unit normals</th><th scope=\"col\">largest error<br/>of a hit</th></tr></thead>\n\
         <tbody>\n{rows}</tbody>\n</table>\n</div>\n"
    )
}

/// What the methods are that were measured.
fn methods(all: &[Measured]) -> String {
    let mut html = "<h2>The methods</h2>\n<dl>\n".to_owned();
    let is_measured = |method: &&Method| {
        let mut rows = all.iter().flat_map(|one| &one.bench.rows);
        rows.any(|row| row.method == method.name())
    };
    for method in Method::ALL.iter().filter(is_measured) {
        html += &format!(
            "<dt>{} {}</dt><dd>{}</dd>\n",
            swatch(method.name()),
            method.name(),
            escaped(method.about())
        );
    }
    html + "</dl>\n"
}

/// A dot of the method's colour.
fn swatch(method: &str) -> String {
    let plotters::style::RGBColor(r, g, b) = colour(method);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"10\" height=\"10\" aria-hidden=\"true\">\
         <circle cx=\"5\" cy=\"5\" r=\"5\" fill=\"#{r:02X}{g:02X}{b:02X}\"/></svg>"
    )
}

/// `1 thread`, `2 threads`.
pub(super) fn counted(count: &str, noun: &str) -> String {
    match count {
        "1" => format!("1 {noun}"),
        _ => format!("{count} {noun}s"),
    }
}

/// `1234567` as `1,234,567`.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.char_indices() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Text as HTML and XML have it; what XML cannot hold becomes a replacement character.
fn escaped(text: &str) -> String {
    let mut html = String::new();
    for c in text.chars() {
        match c {
            '&' => html += "&amp;",
            '<' => html += "&lt;",
            '>' => html += "&gt;",
            '"' => html += "&quot;",
            c if c.is_control() => html.push(char::REPLACEMENT_CHARACTER),
            c => html.push(c),
        }
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_numbers_are_grouped() {
        assert_eq!(escaped("a<b>&\"\u{7}"), "a&lt;b&gt;&amp;&quot;\u{FFFD}");
        let numbers = [0, 999, 1000, 1_234_567].map(grouped);
        assert_eq!(numbers, ["0", "999", "1,000", "1,234,567"]);
    }
}
