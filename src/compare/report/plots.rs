//! The plots of a report, as SVG: memory against speed, memory against error, bars of speed, and speed against detail.
//!
//! All are black and grey on nothing but for the methods' colours, so that a page can show them in its own ink.

use std::collections::BTreeMap;

use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::labels::{Area, LETTER, LINE, Point, place};
use super::page::counted;
use crate::compare::bench::{Bench, BenchRow, BySpeed};
use crate::error::{Error, Result};
use crate::world::Method;

/// Kinds of rays in the order in which they are shown.
pub(super) const KINDS: [&str; 3] = ["primary", "diffuse", "shadow"];

/// What is nearer to the reference than this, in diagonals, is shown as this far: single precision ends there.
pub(super) const LEAST_DISTANCE: f64 = 1e-8;

const SIZE: (u32, u32) = (760, 440);

/// Of all text. SVG's size is this over 1.24.
const FONT: (&str, u32) = ("sans-serif", 17);

/// Grid lines.
const GREY: RGBColor = RGBColor(200, 200, 200);

/// One for each method, that of the same number: dark enough for white paper, light enough for a black screen.
const COLOURS: [RGBColor; 10] = [
    RGBColor(122, 127, 135),
    RGBColor(47, 126, 216),
    RGBColor(213, 94, 0),
    RGBColor(133, 96, 197),
    RGBColor(214, 80, 130),
    RGBColor(18, 145, 120),
    RGBColor(128, 134, 30),
    RGBColor(166, 98, 60),
    RGBColor(200, 80, 210),
    RGBColor(40, 140, 60),
];

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A method's colour, everywhere.
pub(super) fn colour(name: &str) -> RGBColor {
    let number = Method::ALL.iter().position(|m| m.name() == name);
    COLOURS[number.unwrap_or(0) % COLOURS.len()]
}

/// The largest number of threads that was measured.
pub(super) fn most_threads(rows: &[BenchRow]) -> String {
    let counts = rows.iter().flat_map(|row| row.mrays.values());
    let most = counts
        .flat_map(BTreeMap::keys)
        .max_by_key(|threads| threads.parse::<usize>().unwrap_or(0));
    most.cloned().unwrap_or_default()
}

/// A figure of a kind of rays and a number of threads; 0 if there is none.
pub(super) fn figure(table: &BySpeed, kind: &str, threads: &str) -> f64 {
    let by_threads = table.get(kind);
    by_threads
        .and_then(|by_threads| by_threads.get(threads))
        .copied()
        .unwrap_or(0.0)
}

/// Bytes for each micro-triangle against millions of rays a second, on all threads.
pub(super) fn speed(rows: &[BenchRow]) -> Result<String> {
    let threads = most_threads(rows);
    let speed_of = |row: &BenchRow, kind| figure(&row.mrays, kind, &threads);
    let marks: Vec<Marks> = rows
        .iter()
        .map(|row| Marks {
            method: row.method,
            x: row.bytes_per_micro_triangle,
            ys: vec![speed_of(row, "primary"), speed_of(row, "diffuse")],
        })
        .collect();
    let top = 1.15 * greatest(marks.iter().flat_map(|m| m.ys.iter().copied())).max(1e-3);
    let names = (
        "bytes per micro-triangle",
        format!("million rays a second, {}", counted(&threads, "thread")),
    );
    svg(|canvas| {
        scatter(canvas, &marks, 0.0..top, names, &short)?;
        kinds(canvas, ["primary rays", "diffuse rays"])
    })
}

/// Bytes for each micro-triangle against distances, to the reference and to triangles diced alike; nothing if those were
/// not measured.
pub(super) fn error(rows: &[BenchRow]) -> Result<Option<String>> {
    let marks: Vec<Marks> = rows
        .iter()
        .filter_map(|row| {
            Some(Marks {
                method: row.method,
                x: row.bytes_per_micro_triangle,
                ys: [row.rms_distance?, row.rms_to_triangles?]
                    .map(|distance| distance.max(LEAST_DISTANCE))
                    .to_vec(),
            })
        })
        .collect();
    if marks.is_empty() {
        return Ok(None);
    }
    let all = || marks.iter().flat_map(|m| m.ys.iter().copied());
    let low = least(all()).log10().floor() as i32;
    // With room for a name above.
    let high = ((greatest(all()).log10() + 0.3).ceil() as i32).max(low + 1);
    let steps: &[f64] = if high - low < 3 {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    let end = 10_f64.powi(high);
    let ticks = (low..=high)
        .flat_map(|e| steps.iter().map(move |step| step * 10_f64.powi(e)))
        .filter(|&tick| tick <= 1.001 * end)
        .collect();
    let range = (10_f64.powi(low)..end).log_scale().with_key_points(ticks);
    let names = (
        "bytes per micro-triangle",
        "RMS distance, in diagonals of the box".to_owned(),
    );
    svg(|canvas| {
        scatter(canvas, &marks, range, names, &|v| format!("{v:.0e}"))?;
        kinds(canvas, ["to the finer surface", "to triangles diced alike"])
    })
    .map(Some)
}

/// Speed over that of what all are compared with, by kinds of rays and threads.
pub(super) fn ratios(bench: &Bench) -> Result<String> {
    let rows = &bench.rows;
    let Some(first) = rows.first() else {
        return svg(|_| Ok(()));
    };
    let mut groups: Vec<(&str, &String)> = KINDS
        .iter()
        .filter_map(|kind| Some((*kind, first.ratio.get(kind)?)))
        .flat_map(|(kind, by_threads)| by_threads.keys().map(move |threads| (kind, threads)))
        .collect();
    groups.sort_by_key(|(_, threads)| threads.parse::<usize>().unwrap_or(0));
    let all = rows.iter().flat_map(|row| row.ratio.values());
    let top = 1.08 * greatest(all.flat_map(|r| r.values().copied())).max(1.0);
    let count = groups.len() as f64;
    svg(|canvas| {
        let legend = legend(canvas, rows)?;
        let mut chart = drawn(
            ChartBuilder::on(canvas)
                .margin_top(legend + 8)
                .margin_right(16)
                .x_label_area_size(56)
                .y_label_area_size(72)
                .build_cartesian_2d(0.0..count, 0.0..top),
        )?;
        drawn(
            in_style(chart.configure_mesh().disable_x_mesh())
                .x_labels(0)
                .y_labels(8)
                .y_label_formatter(&|v| short(*v))
                .y_desc(format!("speed, {} = 1", bench.relative_to))
                .draw(),
        )?;
        let width = 0.8 / rows.len() as f64;
        for (g, group) in groups.iter().enumerate() {
            for (i, row) in rows.iter().enumerate() {
                let left = g as f64 + 0.1 + i as f64 * width;
                let corners = [
                    (left, 0.0),
                    (left + 0.9 * width, figure(&row.ratio, group.0, group.1)),
                ];
                let bar = Rectangle::new(corners, colour(row.method).filled());
                drawn(chart.draw_series([bar]))?;
            }
        }
        let one = PathElement::new([(0.0, 1.0), (count, 1.0)], BLACK);
        drawn(chart.draw_series([one]))?;
        for (g, (kind, threads)) in groups.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(g as f64 + 0.5, 0.0));
            text(canvas, kind, (x, y + 16), HPos::Center)?;
            text(
                canvas,
                &counted(threads, "thread"),
                (x, y + 34),
                HPos::Center,
            )?;
        }
        Ok(())
    })
}

/// Micro-triangles against millions of rays a second: a line for each method and kind of rays.
pub(super) fn detail(rows: &[&BenchRow], threads: &str) -> Result<String> {
    let kinds_shown = [KINDS[0], KINDS[1]];
    let mut methods: Vec<&BenchRow> = Vec::new();
    for row in rows {
        if methods.iter().all(|known| known.method != row.method) {
            methods.push(row);
        }
    }
    let xs = || rows.iter().map(|row| row.micro_triangles.max(1) as f64);
    let speeds = rows
        .iter()
        .flat_map(|row| kinds_shown.map(|kind| figure(&row.mrays, kind, threads)));
    let top = 1.15 * greatest(speeds).max(1e-3);
    svg(|canvas| {
        let legend = legend(canvas, methods.iter().copied())?;
        let x_range = (least(xs()) / 1.8..greatest(xs()) * 1.8).log_scale();
        let mut chart = drawn(
            ChartBuilder::on(canvas)
                .margin_top(legend + 32)
                .margin_right(16)
                .x_label_area_size(56)
                .y_label_area_size(72)
                .build_cartesian_2d(x_range, 0.0..top),
        )?;
        drawn(
            in_style(&mut chart.configure_mesh())
                .x_label_formatter(&|v| format!("{v:.0e}"))
                .y_label_formatter(&|v| short(*v))
                .x_desc("micro-triangles")
                .y_desc(format!(
                    "million rays a second, {}",
                    counted(threads, "thread")
                ))
                .draw(),
        )?;
        for method in &methods {
            let colour = colour(method.method);
            for (kind, name) in kinds_shown.into_iter().enumerate() {
                let mut points: Vec<(f64, f64)> = (rows.iter())
                    .filter(|row| row.method == method.method)
                    .map(|row| {
                        (
                            row.micro_triangles.max(1) as f64,
                            figure(&row.mrays, name, threads),
                        )
                    })
                    .collect();
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                let at: Vec<Point> = points.iter().map(|p| chart.backend_coord(p)).collect();
                drawn(canvas.draw(&PathElement::new(at.clone(), colour.stroke_width(2))))?;
                for p in at {
                    draw_mark(canvas, p, kind, &colour)?;
                }
            }
        }
        let below = canvas.clone().margin(legend, 0, 0, 0);
        kinds(&below, ["primary rays", "diffuse rays"])
    })
}

/// A method's marks, one above the other.
struct Marks {
    method: &'static str,
    x: f64,
    ys: Vec<f64>,
}

/// Marks over a logarithmic axis, each method's with a line between and its name beside.
fn scatter<Y>(
    canvas: &Canvas<'_>,
    marks: &[Marks],
    y_range: Y,
    (x_name, y_name): (&str, String),
    y_format: &dyn Fn(f64) -> String,
) -> Result<()>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let xs = || marks.iter().map(|m| m.x.max(1e-6));
    let (low, high) = (least(xs()) / 1.8, greatest(xs()) * 1.8);
    let ticks = (-6..12)
        .flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10_f64.powi(e)))
        .filter(|tick| (low..high).contains(tick))
        .collect();
    let mut chart = drawn(
        ChartBuilder::on(canvas)
            .margin_top(36)
            .margin_right(16)
            .x_label_area_size(56)
            .y_label_area_size(72)
            .build_cartesian_2d((low..high).log_scale().with_key_points(ticks), y_range),
    )?;
    drawn(
        in_style(&mut chart.configure_mesh())
            .x_label_formatter(&|v| short(*v))
            .y_label_formatter(&|v| y_format(*v))
            .x_desc(x_name)
            .y_desc(y_name)
            .draw(),
    )?;
    let mut anchors = Vec::with_capacity(marks.len());
    let mut taken: Vec<Area> = Vec::new();
    for mark in marks {
        let colour = colour(mark.method);
        let at: Vec<Point> = (mark.ys.iter())
            .map(|&y| chart.backend_coord(&(mark.x, y)))
            .collect();
        drawn(canvas.draw(&PathElement::new(at.clone(), colour.stroke_width(2))))?;
        for (kind, &p) in at.iter().enumerate() {
            draw_mark(canvas, p, kind, &colour)?;
        }
        let (tops, bottoms) = (at.iter().map(|p| p.1).min(), at.iter().map(|p| p.1).max());
        if let (Some(top), Some(bottom)) = (tops, bottoms) {
            taken.push([at[0].0 - 9, top - 9, at[0].0 + 9, bottom + 9]);
            // Beside the mark above, or else anywhere along the line.
            anchors.push(vec![
                (at[0].0, top),
                (at[0].0, (2 * top + bottom) / 3),
                (at[0].0, (top + 2 * bottom) / 3),
                (at[0].0, bottom),
            ]);
        }
    }
    let (x, y) = chart.plotting_area().get_pixel_range();
    let within = [x.start + 2, y.start + 2, x.end - 2, y.end - 2];
    let names: Vec<&str> = marks.iter().map(|m| m.method).collect();
    for (name, place) in names.iter().zip(place(&names, &anchors, taken, within)) {
        if let Some(leader) = place.leader {
            drawn(canvas.draw(&PathElement::new(leader, colour(name))))?;
        }
        // Letters are narrower than the room that is kept for them: in its middle.
        let middle = place.at.0 + LETTER * name.len() as i32 / 2;
        text(canvas, name, (middle, place.at.1 + LINE / 2), HPos::Center)?;
    }
    Ok(())
}

/// What the two marks stand for, at the top.
fn kinds(canvas: &Canvas<'_>, names: [&str; 2]) -> Result<()> {
    let mut x = SIZE.0 as i32 - 16;
    for (kind, name) in names.into_iter().enumerate().rev() {
        x -= LETTER * name.len() as i32 + 32;
        draw_mark(canvas, (x, 18), kind, &BLACK)?;
        text(canvas, name, (x + 14, 18), HPos::Left)?;
    }
    Ok(())
}

/// A disc for the first kind, a lozenge for the second.
fn draw_mark(canvas: &Canvas<'_>, at: Point, kind: usize, colour: &RGBColor) -> Result<()> {
    const HALF: i32 = 7;
    if kind == 0 {
        drawn(canvas.draw(&Circle::new(at, HALF - 1, colour.filled())))
    } else {
        let corners = [(0, -HALF), (HALF, 0), (0, HALF), (-HALF, 0)];
        let corners: Vec<_> = (corners.iter())
            .map(|(x, y)| (at.0 + x, at.1 + y))
            .collect();
        drawn(canvas.draw(&Polygon::new(corners, colour)))
    }
}

/// A plot's axes and grid, as all plots have them.
fn in_style<'m, 'a, 'b, X: Ranged, Y: Ranged, DB: DrawingBackend>(
    mesh: &'m mut MeshStyle<'a, 'b, X, Y, DB>,
) -> &'m mut MeshStyle<'a, 'b, X, Y, DB> {
    mesh.bold_line_style(GREY)
        .light_line_style(TRANSPARENT)
        .axis_style(BLACK)
        .label_style(FONT)
}

/// Names and colours in rows at the top. Gives their height.
fn legend<'r>(canvas: &Canvas<'_>, rows: impl IntoIterator<Item = &'r BenchRow>) -> Result<i32> {
    const LEFT: i32 = 72;
    let (mut x, mut y) = (LEFT, 16);
    for row in rows {
        let width = LETTER * row.method.len() as i32 + 30;
        if x + width > SIZE.0 as i32 && x > LEFT {
            (x, y) = (LEFT, y + 22);
        }
        let square = [(x, y - 6), (x + 12, y + 6)];
        drawn(canvas.draw(&Rectangle::new(square, colour(row.method).filled())))?;
        text(canvas, row.method, (x + 18, y), HPos::Left)?;
        x += width;
    }
    Ok(y + 12)
}

/// Black text, at its height's middle.
fn text(canvas: &Canvas<'_>, words: &str, at: Point, anchor: HPos) -> Result<()> {
    let style = TextStyle::from(FONT.into_font())
        .color(&BLACK)
        .pos(Pos::new(anchor, VPos::Center));
    drawn(canvas.draw(&Text::new(words.to_owned(), at, style)))
}

fn svg(draw: impl FnOnce(&Canvas<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let canvas = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        draw(&canvas)?;
        drawn(canvas.present())?;
    }
    Ok(svg)
}

fn drawn<T, E: std::error::Error + Send + Sync>(
    result: std::result::Result<T, DrawingAreaErrorKind<E>>,
) -> Result<T> {
    result.map_err(|e| Error::failed(format!("a plot cannot be drawn: {e}")))
}

/// A tick without the noise of binary fractions.
fn short(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{rounded}")
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

fn greatest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast as WCAG 2.1 has it, relative luminance of sRGB.
    fn contrast(a: RGBColor, b: RGBColor) -> f64 {
        let luminance = |c: RGBColor| {
            let linear = |v: u8| {
                let v = f64::from(v) / 255.0;
                if v <= 0.04045 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                }
            };
            0.2126 * linear(c.0) + 0.7152 * linear(c.1) + 0.0722 * linear(c.2) + 0.05
        };
        let (a, b) = (luminance(a), luminance(b));
        a.max(b) / a.min(b)
    }

    #[test]
    fn each_method_has_a_colour_of_its_own_that_shows_on_white_and_on_black() {
        let colours = Method::ALL.map(|m| colour(m.name()));
        for (i, &one) in colours.iter().enumerate() {
            assert!(!colours[i + 1..].contains(&one), "{i}");
        }
        for colour in COLOURS {
            for paper in [WHITE, RGBColor(22, 24, 28)] {
                let contrast = contrast(colour, paper);
                assert!(contrast >= 3.0, "{colour:?} on {paper:?}: {contrast}");
            }
        }
    }
}
