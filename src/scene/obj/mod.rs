//! OBJ files with OpenSubdiv's tags.
//!
//! Tags number the points and faces of the whole file, so a file becomes one control mesh, with a subset of faces for
//! each material. The statements are read here and not by the `tobj` crate, which numbers points anew in each object,
//! drops those that no face has, and makes up texture coordinates; it reads the material libraries. Normals (`vn`)
//! are not read: what comes out is a subdivision surface.

mod materials;
mod polylines;
mod tags;
#[cfg(test)]
mod tests;

pub use polylines::{is_curves, load_polylines, parse_polylines};

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::sync::Arc;

use self::materials::Materials;
use self::tags::Tags;
use super::{Description, Geometry, LoadOptions, Placement, Shape};
use crate::error::{Fault, Result, Warnings};
use crate::math::{DAffine3, Vec3};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, FaceVaryingInterpolation, Interpolation, Primvar, Scheme,
};

/// More bytes than a mesh that 32 bits can number would need.
const LARGEST_FILE: u64 = 1 << 38;
/// A material library is text of a few lines a material.
const LARGEST_LIBRARY: u64 = 1 << 26;
/// A corner without texture coordinates.
const NO_UV: u32 = u32::MAX;

/// Reads an OBJ file and its material libraries.
///
/// # Errors
/// Bad input, with the line, for a file that cannot be read or is not a mesh.
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Description> {
    let file = open(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let library = |name: &str| {
        let path = folder.join(name.replace('\\', "/"));
        let mut bytes = Vec::new();
        let file = File::open(&path).ok()?;
        file.take(LARGEST_LIBRARY).read_to_end(&mut bytes).ok()?;
        Some((path, bytes))
    };
    read(BufReader::new(file), path, library)
}

/// Reads the text of an OBJ file. `name` decides the scheme and stands in messages; no other file is read.
///
/// # Errors
/// Bad input, with the line, for what is not a mesh.
pub fn parse(bytes: &[u8], name: &Path) -> Result<Description> {
    read(bytes, name, |_| None)
}

fn open(path: &Path) -> Result<File, Fault> {
    let open = || -> std::io::Result<File> {
        let file = File::open(path)?;
        if file.metadata()?.len() > LARGEST_FILE {
            return Err(std::io::Error::other("more than 256 GiB"));
        }
        Ok(file)
    };
    open().map_err(|e| unreadable(path, &e))
}

fn unreadable(path: &Path, error: &std::io::Error) -> Fault {
    Fault::new(format!("cannot be read: {error}")).in_file(path)
}

/// A fault in line `line`, from 1.
fn at_line(line: u32, message: impl Into<String>) -> Fault {
    Fault::new(message).at_prim(format!("line {line}"))
}

type Library = (std::path::PathBuf, Vec<u8>);

fn read(
    text: impl BufRead,
    name: &Path,
    library: impl Fn(&str) -> Option<Library>,
) -> Result<Description> {
    let mut reader = Reader::default();
    let each = |statement: &str, line| reader.statement(statement, line, &library);
    statements(text, name, each)?;
    Ok(reader.finish(name).map_err(|fault| fault.in_file(name))?)
}

/// Hands out the statements with their lines, from 1.
fn statements(
    mut text: impl BufRead,
    name: &Path,
    mut each: impl FnMut(&str, u32) -> Result<(), Fault>,
) -> Result<(), Fault> {
    let mut bytes = Vec::new();
    let mut line = 0_u32;
    loop {
        bytes.clear();
        let first = line.saturating_add(1);
        // A backslash at its end continues a line.
        loop {
            let had = bytes.len();
            text.read_until(b'\n', &mut bytes)
                .map_err(|e| unreadable(name, &e))?;
            if bytes.len() == had {
                break;
            }
            line = line.saturating_add(1);
            let end = bytes.trim_ascii_end().len();
            if end == 0 || bytes[end - 1] != b'\\' {
                break;
            }
            bytes.truncate(end - 1);
            bytes.push(b' ');
        }
        if bytes.is_empty() {
            return Ok(());
        }
        let statement = String::from_utf8_lossy(&bytes);
        each(statement.trim(), first).map_err(|fault| fault.in_file(name))?;
    }
}

#[derive(Default)]
struct Reader {
    points: Vec<Vec3>,
    uvs: Vec<f32>,
    counts: Vec<u32>,
    indices: Vec<u32>,
    uv_indices: Vec<u32>,
    /// The line of each face, for messages.
    face_lines: Vec<u32>,
    object: Option<String>,
    objects: usize,
    tags: Tags,
    materials: Materials,
    warnings: Warnings,
}

impl Reader {
    fn statement(
        &mut self,
        statement: &str,
        line: u32,
        library: &impl Fn(&str) -> Option<Library>,
    ) -> Result<(), Fault> {
        let (keyword, rest) = statement
            .split_once(char::is_whitespace)
            .unwrap_or((statement, ""));
        let rest = rest.trim();
        match keyword {
            "v" => {
                let [x, y, z] = numbers(rest, line)?;
                self.points.push(Vec3::new(x, y, z));
                if rest.split_whitespace().nth(5).is_some() {
                    self.warnings.add("obj-vertex-colours", || {
                        format!("line {line}: colours of points are not used")
                    });
                }
            }
            "vt" if rest.split_whitespace().nth(1).is_some() => {
                self.uvs.extend(numbers::<2>(rest, line)?);
            }
            "vt" => {
                let [u] = numbers(rest, line)?;
                self.uvs.extend([u, 0.0]);
            }
            "f" => self.face(rest, line)?,
            "t" => self.tags.read(rest, line, &mut self.warnings)?,
            "o" => {
                self.objects += 1;
                self.object.get_or_insert_with(|| rest.to_owned());
            }
            "usemtl" => self.materials.select(rest),
            "mtllib" => match library(rest) {
                Some((path, bytes)) => self.materials.library(path, &bytes, &mut self.warnings),
                None => self.warnings.add("obj-material-library", || {
                    format!("line {line}: the material library {rest} cannot be read")
                }),
            },
            "p" | "l" | "curv" | "curv2" | "surf" => {
                self.warnings.add(format!("obj-element-{keyword}"), || {
                    format!("line {line}: only faces are rendered, not elements of kind {keyword}")
                });
            }
            "" | "vn" | "vp" | "g" | "s" | "mg" => {}
            _ if keyword.starts_with('#') => {}
            _ => self.warnings.add("obj-statement", || {
                let keyword: String = keyword.chars().take(32).collect();
                format!("line {line}: the statement \"{keyword}\" is not known")
            }),
        }
        Ok(())
    }

    fn face(&mut self, rest: &str, line: u32) -> Result<(), Fault> {
        let (points, uvs) = (self.points.len(), self.uvs.len() / 2);
        let before = self.indices.len();
        for corner in rest.split_whitespace() {
            let mut parts = corner.split('/');
            let bad = || at_line(line, format!("\"{corner}\" is not the corner of a face"));
            let point = parts
                .next()
                .and_then(|v| index(v, points))
                .ok_or_else(bad)?;
            let uv = match parts.next() {
                None | Some("") => NO_UV,
                Some(vt) => index(vt, uvs).ok_or_else(bad)?,
            };
            self.indices.push(point);
            self.uv_indices.push(uv);
        }
        let corners = self.indices.len() - before;
        if corners < 3 {
            return Err(at_line(line, format!("a face with {corners} corners"))
                .advise("a face has at least 3 corners; remove the face"));
        }
        if self.indices.len() as u64 > u64::from(u32::MAX) {
            return Err(at_line(line, "more corners than 32 bits can number"));
        }
        self.counts.push(corners as u32);
        self.face_lines.push(line);
        self.materials.face();
        Ok(())
    }

    fn finish(mut self, name: &Path) -> Result<Description, Fault> {
        if self.counts.is_empty() {
            return Err(Fault::new("no faces").advise("is it a Wavefront OBJ file in text form?"));
        }
        let stem = name.file_stem().unwrap_or_default().to_string_lossy();
        let prefixes = [
            ("catmark_", Scheme::CatmullClark),
            ("loop_", Scheme::Loop),
            ("bilinear_", Scheme::Bilinear),
        ];
        let scheme = prefixes.iter().find(|(p, _)| stem.starts_with(p));
        // OpenSubdiv's defaults for its own files, USD's for all others.
        let (boundary, face_varying) = if self.tags.any || scheme.is_some() {
            (
                BoundaryInterpolation::EdgeOnly,
                FaceVaryingInterpolation::All,
            )
        } else {
            (
                BoundaryInterpolation::EdgeAndCorner,
                FaceVaryingInterpolation::default(),
            )
        };
        let mut mesh = ControlMesh {
            scheme: scheme.map_or(Scheme::CatmullClark, |s| s.1),
            boundary,
            face_varying,
            left_handed: stem.contains("_lefthanded"),
            ..ControlMesh::default()
        };
        self.check_corners()?;
        self.tags.check(self.points.len(), self.counts.len())?;
        self.tags.apply(&mut mesh);
        mesh.primvars.extend(self.texture_coordinates());
        mesh.points = vec![self.points];
        mesh.face_vertex_counts = self.counts;
        mesh.face_vertex_indices = self.indices;
        mesh.validate()?;
        if !mesh.has_area() {
            return Err(Fault::new(
                "no face has an area: all its points lie on a line or in a point",
            )
            .advise("export the cage again; is it scaled to nothing?"));
        }
        if let Some((face, point)) = mesh.repeated_corner() {
            let line = self.face_lines[face];
            self.warnings.add("repeated corner", || {
                format!("line {line}: point {} is more than one corner of the face; remove the repeated ones", point + 1)
            });
        }
        if let Some((count, [a, b])) = mesh.creases_without_edge() {
            self.warnings.add("crease without edge", || {
                format!("{count} creases have no effect: no edge joins their points, as {a} and {b} (from 0)")
            });
        }

        let path = match self.object {
            Some(object) if self.objects == 1 && !object.is_empty() => format!("/{object}"),
            _ => format!("/{stem}"),
        };
        let mut description = Description {
            files: vec![name.to_owned()],
            up: Vec3::Y,
            meters_per_unit: 1.0,
            frames_per_second: 24.0,
            placements: vec![Placement {
                path: path.clone(),
                shape: 0,
                world_from_object: vec![DAffine3::IDENTITY],
                display_color: None,
                material: None,
            }],
            warnings: self.warnings,
            ..Description::default()
        };
        let materials = self.materials.finish(name, &mut description);
        description.shapes.push(Shape {
            path,
            geometry: Geometry::Mesh(Arc::new(mesh)),
            materials,
            double_sided: true,
            unusable_primvars: Vec::new(),
            tiles: None,
        });
        Ok(description)
    }

    /// Faces may name points that follow them, so only the end can tell.
    fn check_corners(&self) -> Result<(), Fault> {
        let lists = [
            ("point", &self.indices, self.points.len()),
            ("vt", &self.uv_indices, self.uvs.len() / 2),
        ];
        for (what, list, count) in lists {
            let outside = |&i: &u32| i as usize >= count && !(what == "vt" && i == NO_UV);
            if let Some(corner) = list.iter().position(outside) {
                let mut end = 0;
                let face = self.counts.iter().position(|&n| {
                    end += n as usize;
                    end > corner
                });
                let face = face.unwrap_or_default();
                let number = u64::from(list[corner]) + 1;
                let message = format!("{what} {number}, but there are {count}");
                return Err(at_line(self.face_lines[face], message).at_face(face));
            }
        }
        Ok(())
    }

    fn texture_coordinates(&mut self) -> Option<Primvar> {
        let missing = self.uv_indices.iter().filter(|&&i| i == NO_UV).count();
        let corners = self.uv_indices.len();
        if missing > 0 {
            if missing < corners {
                self.warnings.add("obj-texture-coordinates", || {
                    format!(
                        "{missing} of {corners} corners have no texture coordinates: none are used"
                    )
                });
            }
            return None;
        }
        Some(Primvar {
            name: "st".into(),
            interpolation: Interpolation::FaceVarying,
            width: 2,
            values: std::mem::take(&mut self.uvs),
            indices: Some(std::mem::take(&mut self.uv_indices)),
        })
    }
}

/// The first `N` numbers of a statement.
fn numbers<const N: usize>(rest: &str, line: u32) -> Result<[f32; N], Fault> {
    let mut words = rest.split_whitespace();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        let word = words
            .next()
            .ok_or_else(|| at_line(line, format!("fewer than {N} numbers")))?;
        *number = word
            .parse()
            .ok()
            .filter(|x: &f32| x.is_finite())
            .ok_or_else(|| at_line(line, format!("\"{word}\" is not a usable number")))?;
    }
    Ok(numbers)
}

/// A number from 1, or counted back from the `count` so far by a negative one, as one from 0.
fn index(word: &str, count: usize) -> Option<u32> {
    let i: i64 = word.parse().ok()?;
    let from_zero = match i {
        0 => return None,
        1.. => i - 1,
        _ => i64::try_from(count).ok()?.checked_add(i)?,
    };
    u32::try_from(from_zero).ok().filter(|&i| i != NO_UV)
}
