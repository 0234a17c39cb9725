//! OpenSubdiv's tag lines: `t name ints/floats/strings int… float… string…`, points and faces from 0.

use std::str::FromStr;

use super::at_line;
use crate::error::{Fault, Warnings};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, CreaseMethod, FaceVaryingInterpolation,
    TriangleRule,
};

/// What the tags of a file say, with the line of each that names points or faces.
#[derive(Debug, Default)]
pub(super) struct Tags {
    /// Whether there was a tag at all.
    pub(super) any: bool,
    creases: Vec<(u32, Crease)>,
    corners: Vec<(u32, Corner)>,
    holes: Vec<(u32, u32)>,
    boundary: Option<BoundaryInterpolation>,
    face_varying: Option<FaceVaryingInterpolation>,
    triangle_rule: Option<TriangleRule>,
    crease_method: Option<CreaseMethod>,
}

impl Tags {
    /// Reads one line, without its `t`.
    pub(super) fn read(
        &mut self,
        rest: &str,
        line: u32,
        warnings: &mut Warnings,
    ) -> Result<(), Fault> {
        self.any = true;
        let mut words = rest.split_whitespace();
        let (Some(name), Some(counts)) = (words.next(), words.next()) else {
            return Err(at_line(line, "a tag without name or counts").advise(FORM));
        };
        if matches!(
            name,
            "vertexedit" | "edgeedit" | "faceedit" | "facevaryingpropagatecorners"
        ) {
            warnings.add(format!("obj-tag-{name}"), || {
                format!("line {line}: the tag {name} is not supported")
            });
            return Ok(());
        }
        let counts: Vec<usize> = counts.split('/').filter_map(|n| n.parse().ok()).collect();
        let words: Vec<&str> = words.collect();
        let [ints, floats, strings] = counts[..] else {
            return Err(at_line(line, format!("tag {name}: three counts expected")).advise(FORM));
        };
        let total = ints.saturating_add(floats).saturating_add(strings);
        if total != words.len() {
            let message = format!(
                "tag {name}: {total} arguments announced, {} found",
                words.len()
            );
            return Err(at_line(line, message).advise(FORM));
        }
        let (int_words, words) = words.split_at(ints);
        let (float_words, strings) = words.split_at(floats);
        let ints: Vec<u32> = all(int_words, name, line)?;
        let floats: Vec<f32> = all(float_words, name, line)?;
        if let Some(s) = floats.iter().find(|&&s| s.is_nan() || s < 0.0) {
            return Err(at_line(line, format!("tag {name}: sharpness {s}"))
                .advise("sharpness runs from 0 (smooth) to 10 (infinitely sharp)"));
        }
        let wrong = || at_line(line, format!("tag {name}: wrong arguments")).advise(FORM);
        let sharpness = |i: usize, count: usize| match floats[..] {
            [s] => Ok(s),
            _ if floats.len() == count => Ok(floats[i]),
            _ => Err(wrong()),
        };

        match (name, &ints[..], strings) {
            ("crease", [_, _, ..], []) if ints.len().is_multiple_of(2) => {
                for (i, pair) in ints.chunks_exact(2).enumerate() {
                    let crease = Crease {
                        vertices: [pair[0], pair[1]],
                        sharpness: sharpness(i, ints.len() / 2)?,
                    };
                    self.creases.push((line, crease));
                }
            }
            ("corner", [_, ..], []) => {
                for (i, &vertex) in ints.iter().enumerate() {
                    let sharpness = sharpness(i, ints.len())?;
                    self.corners.push((line, Corner { vertex, sharpness }));
                }
            }
            ("hole", _, []) => self.holes.extend(ints.iter().map(|&f| (line, f))),
            ("interpolateboundary", &[k @ 0..=2], []) => {
                self.boundary = Some(match k {
                    0 => BoundaryInterpolation::None,
                    1 => BoundaryInterpolation::EdgeAndCorner,
                    _ => BoundaryInterpolation::EdgeOnly,
                });
            }
            ("facevaryinginterpolateboundary", &[k @ 0..=5], []) => {
                self.face_varying = Some(match k {
                    0 => FaceVaryingInterpolation::None,
                    1 => FaceVaryingInterpolation::CornersOnly,
                    2 => FaceVaryingInterpolation::CornersPlus1,
                    3 => FaceVaryingInterpolation::CornersPlus2,
                    4 => FaceVaryingInterpolation::Boundaries,
                    _ => FaceVaryingInterpolation::All,
                });
            }
            ("creasemethod", [], ["normal"]) => self.crease_method = Some(CreaseMethod::Uniform),
            ("creasemethod", [], ["chaikin"]) => self.crease_method = Some(CreaseMethod::Chaikin),
            ("smoothtriangles", [], ["catmark"]) => {
                self.triangle_rule = Some(TriangleRule::CatmullClark);
            }
            ("smoothtriangles", [], ["smooth"]) => self.triangle_rule = Some(TriangleRule::Smooth),
            _ => return Err(wrong()),
        }
        Ok(())
    }

    /// Whether all points and faces that tags name exist.
    pub(super) fn check(&self, points: usize, faces: usize) -> Result<(), Fault> {
        let crease_ends = self
            .creases
            .iter()
            .flat_map(|(l, c)| c.vertices.map(|v| (*l, v)));
        let corners = self.corners.iter().map(|(l, c)| (*l, c.vertex));
        let mut vertices = crease_ends.chain(corners);
        if let Some((line, v)) = vertices.find(|&(_, v)| v as usize >= points) {
            let message = format!("a tag names point {v} (from 0), but there are {points}");
            return Err(at_line(line, message));
        }
        if let Some(&(line, f)) = self.holes.iter().find(|&&(_, f)| f as usize >= faces) {
            let message = format!("a tag names face {f} (from 0), but there are {faces}");
            return Err(at_line(line, message));
        }
        Ok(())
    }

    /// Puts the tags on the mesh.
    pub(super) fn apply(&self, mesh: &mut ControlMesh) {
        mesh.creases = self.creases.iter().map(|t| t.1).collect();
        mesh.corners = self.corners.iter().map(|t| t.1).collect();
        mesh.holes = self.holes.iter().map(|t| t.1).collect();
        mesh.boundary = self.boundary.unwrap_or(mesh.boundary);
        mesh.face_varying = self.face_varying.unwrap_or(mesh.face_varying);
        mesh.triangle_rule = self.triangle_rule.unwrap_or_default();
        mesh.crease_method = self.crease_method.unwrap_or_default();
    }
}

const FORM: &str =
    "a tag reads \"t name ints/floats/strings\" and then as many arguments: t crease 2/1/0 0 1 2.5";

fn all<T: FromStr>(words: &[&str], name: &str, line: u32) -> Result<Vec<T>, Fault> {
    let parse = |word: &&str| {
        let bad = |_| {
            at_line(
                line,
                format!("tag {name}: \"{word}\" is not a number that fits here"),
            )
        };
        word.parse().map_err(bad)
    };
    words.iter().map(parse).collect()
}
