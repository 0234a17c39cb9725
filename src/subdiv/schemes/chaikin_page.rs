//! A page that shows what Chaikin's algorithm does: polylines with their refinements, as the text of an SVG picture.
//!
//! The curves are seen along -z, y upwards. The control polylines are thin and grey with a dot at each point; each
//! level is a line of its own, from pale to dark, and the last one is thick.

use std::fmt::Write;

use super::chaikin;
use crate::error::Fault;
use crate::math::Vec2;
use crate::mesh::Polyline;

/// Width of the page in pixels; the height follows the curves.
const WIDTH: f32 = 800.0;
/// Space around the curves.
const MARGIN: f32 = 24.0;

/// The picture of `polylines` and their levels from 1 to `levels`.
///
/// # Errors
/// Those of [`chaikin::refine`]; no polylines.
pub fn draw(polylines: &[Polyline], levels: u32) -> Result<String, Fault> {
    let points = || {
        polylines
            .iter()
            .flat_map(|p| &p.points)
            .map(|p| p.truncate())
    };
    let Some(first) = points().next() else {
        return Err(Fault::new("no polylines to draw"));
    };
    let low = points().fold(first, Vec2::min);
    let size = points().fold(first, Vec2::max) - low;
    // Curves stay within the box of their points. A page twice as high as wide is high enough.
    let inner = WIDTH - 2.0 * MARGIN;
    let scale = f32::min(inner / size.x, 2.0 * inner / size.y);
    let scale = if scale.is_finite() { scale } else { 1.0 };
    let height = size.y * scale + 2.0 * MARGIN;
    let place = |p: Vec2| {
        let q = (p - low) * scale;
        Vec2::new(MARGIN + q.x, height - MARGIN - q.y)
    };

    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height:.0}\" \
         viewBox=\"0 0 {WIDTH} {height:.3}\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <g fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\">\n"
    );
    for level in 0..=levels {
        // From grey to dark blue.
        let share = level as f32 / levels.max(1) as f32;
        let mix = |from: f32, to: f32| (from + (to - from) * share) as u8;
        let colour = format!(
            "#{:02x}{:02x}{:02x}",
            mix(176.0, 16.0),
            mix(182.0, 56.0),
            mix(190.0, 140.0)
        );
        let width = if level == levels { 2.5 } else { 1.0 };
        for polyline in polylines {
            let fine = chaikin::refine(polyline, level)?;
            let name = if fine.closed { "polygon" } else { "polyline" };
            let mut list = String::new();
            for p in &fine.points {
                let q = place(p.truncate());
                write!(list, "{:.3},{:.3} ", q.x, q.y).expect("a string takes all");
            }
            writeln!(
                svg,
                "<{name} stroke=\"{colour}\" stroke-width=\"{width}\" points=\"{}\"/>",
                list.trim_end()
            )
            .expect("a string takes all");
        }
    }
    svg.push_str("</g>\n<g fill=\"#c0392b\">\n");
    for p in points() {
        let q = place(p);
        writeln!(
            svg,
            "<circle cx=\"{:.3}\" cy=\"{:.3}\" r=\"3.5\"/>",
            q.x, q.y
        )
        .expect("a string takes all");
    }
    svg.push_str("</g>\n</svg>\n");
    Ok(svg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn each_level_is_a_line_within_the_page() {
        let square = Polyline {
            points: vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y],
            closed: true,
        };
        let open = Polyline {
            closed: false,
            ..square.clone()
        };
        let svg = draw(&[square, open], 3).expect("valid");
        assert_eq!(svg.matches("<polygon").count(), 4);
        assert_eq!(svg.matches("<polyline").count(), 4);
        assert_eq!(svg.matches("<circle").count(), 8);
        // Level 3 of the square has 32 points.
        let last = svg.lines().rfind(|l| l.starts_with("<polygon"));
        assert_eq!(last.expect("drawn").matches(',').count(), 32);
        let upright = Polyline {
            points: vec![Vec3::ZERO, Vec3::Z],
            closed: false,
        };
        assert!(!draw(&[upright], 1).expect("a dot").contains("NaN"));
        assert!(draw(&[], 1).is_err());
    }
}
