//! The polylines of an OBJ file: its elements of kind `l`.
//!
//! One whose last point is its first one is closed. Faces and all else in the file are passed over.

use std::io::{BufRead, BufReader};
use std::path::Path;

use super::{at_line, index, numbers, open, statements};
use crate::error::{Fault, Result};
use crate::math::Vec3;
use crate::mesh::Polyline;

/// Reads the polylines of an OBJ file.
///
/// # Errors
/// Bad input, with the line, for a file that cannot be read, has no polylines, or has one that is none.
pub fn load_polylines(path: &Path) -> Result<Vec<Polyline>> {
    read(BufReader::new(open(path)?), path)
}

/// Reads the text of an OBJ file; `name` stands in messages.
///
/// # Errors
/// Bad input, with the line.
pub fn parse_polylines(bytes: &[u8], name: &Path) -> Result<Vec<Polyline>> {
    read(bytes, name)
}

/// Whether an OBJ file has polylines and no faces.
///
/// # Errors
/// Bad input for a file that cannot be read.
pub fn is_curves(path: &Path) -> Result<bool> {
    let (mut lines, mut faces) = (false, false);
    statements(BufReader::new(open(path)?), path, |statement, _| {
        match statement.split_whitespace().next() {
            Some("l") => lines = true,
            Some("f") => faces = true,
            _ => {}
        }
        Ok(())
    })?;
    Ok(lines && !faces)
}

fn read(text: impl BufRead, name: &Path) -> Result<Vec<Polyline>> {
    let mut points = Vec::new();
    let mut lines: Vec<(u32, Vec<u32>)> = Vec::new();
    statements(text, name, |statement, line| {
        let (keyword, rest) = statement
            .split_once(char::is_whitespace)
            .unwrap_or((statement, ""));
        if keyword == "v" {
            points.push(Vec3::from_array(numbers(rest, line)?));
        } else if keyword == "l" {
            let number = |word: &str| {
                let point = word.split('/').next().unwrap_or_default();
                index(point, points.len())
                    .ok_or_else(|| at_line(line, format!("\"{word}\" is not a point of a line")))
            };
            let of_line: Result<_, Fault> = rest.split_whitespace().map(number).collect();
            lines.push((line, of_line?));
        }
        Ok(())
    })?;
    if lines.is_empty() {
        let fault = Fault::new("no polylines").advise("curves are elements of kind l: \"l 1 2 3\"");
        return Err(fault.in_file(name).into());
    }
    let polyline = |(line, mut indices): (u32, Vec<u32>)| {
        // Lines may name points that follow them, so only the end can tell.
        if let Some(&i) = indices.iter().find(|&&i| i as usize >= points.len()) {
            let message = format!("point {}, but there are {}", u64::from(i) + 1, points.len());
            return Err(at_line(line, message).in_file(name));
        }
        let closed = indices.len() > 2 && indices.first() == indices.last();
        if closed {
            indices.pop();
        }
        let polyline = Polyline {
            points: indices.iter().map(|&i| points[i as usize]).collect(),
            closed,
        };
        let place = |fault: Fault| fault.at_prim(format!("line {line}")).in_file(name);
        polyline.validate().map_err(place)?;
        Ok(polyline)
    };
    Ok(lines
        .into_iter()
        .map(polyline)
        .collect::<Result<_, Fault>>()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn parse(lines: &str) -> Result<Vec<Polyline>> {
        parse_polylines(format!("{SQUARE}{lines}").as_bytes(), Path::new("a.obj"))
    }

    #[test]
    fn a_line_that_comes_back_is_closed() {
        let lines = parse("l 1 2 3 4 1\nf 1 2 3\nl -1/1 -2/2\n").expect("valid");
        assert_eq!((lines[0].closed, lines[0].points.len()), (true, 4));
        assert_eq!((lines[1].closed, lines[1].points[0]), (false, Vec3::Y));
    }

    #[test]
    fn faults_name_the_line() {
        for (line, message) in [
            ("l 1", "a.obj: line 5: an open polyline of 1 points"),
            ("l 1 2 1", "a.obj: line 5: a closed polyline of 2 points"),
            ("l 1 9", "a.obj: line 5: point 9, but there are 4"),
            ("l 1 x", "a.obj: line 5: \"x\" is not a point of a line"),
            ("f 1 2 3", "a.obj: no polylines"),
        ] {
            let error = parse(line).expect_err(line);
            assert_eq!(error.to_string(), message);
        }
    }
}
