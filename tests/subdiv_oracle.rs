//! Compares limit surfaces and refined meshes with OpenSubdiv's values, written down as JSON for cages of every kind:
//! positions, derivatives, normals, face-varying values and the points of uniform refinement.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use relievo::mesh::{
    BoundaryInterpolation, ControlMesh, CreaseMethod, FaceVaryingInterpolation, Interpolation,
    Scheme, TriangleRule,
};
use relievo::scene::{LoadOptions, obj};
use relievo::subdiv::{Field, LimitSurface, Sample, refine};
use serde_json::Value;

use crate::common::program::{Bench, said};
use crate::common::shared;

const ORACLES: &str = "oracles/subdiv";

/// The level at which the reference isolates extraordinary vertices.
const ISOLATION: Option<u32> = Some(10);

/// Relative to the diagonal of the cage's box.
const POSITION: f64 = 1e-6;
const CORNER_POSITION: f64 = 2e-6;
const REFINED: f64 = 1e-6;
/// Relative to the longer derivative; of normals as they are.
const DERIVATIVE: f64 = 1e-5;
const FACE_VARYING: f64 = 1e-6;
/// Derivatives shorter than this part of the diagonal are compared as if they had this length.
const LEAST_DERIVATIVE: f64 = 1e-6;

#[test]
fn limit_surfaces_and_refined_meshes_are_opensubdivs() {
    let Some(shared) = shared("limit_surfaces_and_refined_meshes_are_opensubdivs") else {
        return;
    };
    let folder = &shared.join(ORACLES);
    let mut worst = Worst::default();
    let mut faults = Vec::new();
    let files = oracles(folder);
    for path in &files {
        let reference = Reference::load(path);
        reference.check_samples(&mut worst, &mut faults);
        reference.check_face_varying(&mut worst, &mut faults);
        reference.check_refined(folder, &mut worst, &mut faults);
    }
    let count = files.len();
    for (what, (difference, place, checked)) in &worst.0 {
        println!("{what}: {checked} values, largest difference {difference:.2e} at {place}");
    }
    assert!(count > 100, "{count} files only");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// What single precision costs, over the same samples, with the bounds that the documentation states.
#[test]
fn single_precision_stays_close_to_double() {
    let Some(shared) = shared("single_precision_stays_close_to_double") else {
        return;
    };
    let [mut position, mut derivative, mut relative, mut normal] =
        [const { (0.0, String::new()) }; 4];
    for path in oracles(&shared.join(ORACLES)) {
        let reference = Reference::load(&path);
        let surface = LimitSurface::new(&reference.mesh);
        let double: Field<f64> = surface.points(&reference.mesh, 0);
        let single: Field<f32> = surface.points(&reference.mesh, 0);
        for row in reference.rows() {
            let Row { ptex, uv, .. } = row;
            if surface.is_hole(ptex) {
                continue;
            }
            let a = surface.evaluate(&double, ptex, uv[0], uv[1]);
            let b = surface.evaluate(&single, ptex, uv[0], uv[1]);
            let wide = |p: [f32; 3]| p.map(f64::from);
            let scale = length(a.du).max(length(a.dv));
            // Rounding is relative to the coordinates, which may be larger than the box.
            let size = a
                .position
                .iter()
                .fold(reference.diagonal, |m, x| m.max(x.abs()));
            let note = |worst: &mut (f64, String), difference: f64| {
                if difference > worst.0 {
                    *worst = (difference, reference.place(&row));
                }
            };
            note(&mut position, distance(a.position, wide(b.position)) / size);
            if scale > LEAST_DERIVATIVE * reference.diagonal {
                let off = distance(a.du, wide(b.du)).max(distance(a.dv, wide(b.dv)));
                note(&mut derivative, off / size);
                note(&mut relative, off / scale);
                // Where tangents are nearly parallel the normal is what rounding makes it.
                if length(cross(a.du, a.dv)) > 0.1 * scale * scale
                    && let (Some(a), Some(b)) = (a.normal(uv[0], uv[1]), b.normal(uv[0], uv[1]))
                {
                    note(&mut normal, distance(a, b));
                }
            }
        }
    }
    println!(
        "single precision: positions {position:?}, derivatives {derivative:?}, normals {normal:?}"
    );
    assert!(position.0 < 3e-7, "{position:?}");
    assert!(derivative.0 < 2e-5, "{derivative:?}");
    assert!(normal.0 < 2e-3, "{normal:?}");
}

#[test]
fn the_command_gives_the_librarys_values() {
    let Some(shared) = shared("the_command_gives_the_librarys_values") else {
        return;
    };
    for name in ["catmark_fvar_bound0.edgeAndCorner", "loop_cube_creases0"] {
        let path = shared.join(ORACLES).join(format!("{name}.json"));
        let reference = Reference::load(&path);
        let bench = Bench::new();
        let out = bench.path("out.json");
        let mut command = bench.command(&["eval", "--quiet"]);
        command.arg(&reference.cage).arg("--samples").arg(&path);
        command.arg("-o").arg(&out);
        let (code, text) = said(&command.output().expect("the program runs"));
        assert_eq!(code, 0, "{text}");
        let result = parse(&out);
        let mut worst = Worst::default();
        let mut faults = Vec::new();
        for (row, found) in reference.rows().zip(list(&result["samples"])) {
            let place = [&found[1], &found[2], &found[3]].map(number);
            assert_eq!(place, [f64::from(row.ptex), row.uv[0], row.uv[1]]);
            assert_eq!(found[4], row.values[4]);
            let sample = point(&found[5]).map(|position| Sample {
                position,
                derivatives: point(&found[6]).zip(point(&found[7])).map(<[_; 2]>::from),
                normal: point(&found[8]),
            });
            reference.compare(&row, sample, &mut worst, &mut faults);
        }
        for (rule, expected) in reference.face_varying() {
            let found = list(&result["faceVarying"][rule]);
            assert_eq!(found.len(), expected.len(), "{name}, {rule}");
        }
        assert!(faults.is_empty(), "{}", faults.join("\n"));
    }
}

/// The largest difference of each kind, where it is, and how many values were compared.
#[derive(Default)]
struct Worst(BTreeMap<String, (f64, String, usize)>);

impl Worst {
    fn note(&mut self, what: &str, difference: f64, place: impl Fn() -> String) {
        let entry = self.0.entry(what.to_owned()).or_default();
        entry.2 += 1;
        if difference > entry.0 || difference.is_nan() {
            (entry.0, entry.1) = (difference, place());
        }
    }
}

/// A file of reference values, and its cage under the file's options.
struct Reference {
    name: String,
    values: Value,
    cage: PathBuf,
    mesh: ControlMesh,
    diagonal: f64,
}

/// A sample of the reference.
struct Row<'a> {
    index: usize,
    values: &'a [Value],
    ptex: u32,
    uv: [f64; 2],
}

impl Reference {
    fn load(path: &Path) -> Self {
        let values = parse(path);
        let name = path.file_stem().expect("files have names");
        let name = name.to_string_lossy().into_owned();
        let cage = path
            .ancestors()
            .nth(3)
            .expect("the shared folder")
            .join("assets/opensubdiv")
            .join(word(&values["cage"]));
        let scene = obj::load(&cage, &LoadOptions::default())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut mesh = ControlMesh::clone(scene.shapes[0].geometry.mesh().expect("a mesh"));
        mesh.scheme = match word(&values["scheme"]) {
            "catmark" => Scheme::CatmullClark,
            "loop" => Scheme::Loop,
            "bilinear" => Scheme::Bilinear,
            other => panic!("{name}: scheme {other}"),
        };
        let options = &values["options"];
        mesh.boundary = match word(&options["interpolateBoundary"]) {
            "none" => BoundaryInterpolation::None,
            "edgeOnly" => BoundaryInterpolation::EdgeOnly,
            "edgeAndCorner" => BoundaryInterpolation::EdgeAndCorner,
            other => panic!("{name}: boundary {other}"),
        };
        mesh.crease_method = match word(&options["creaseMethod"]) {
            "uniform" => CreaseMethod::Uniform,
            "chaikin" => CreaseMethod::Chaikin,
            other => panic!("{name}: crease method {other}"),
        };
        mesh.triangle_rule = match word(&options["triangleSubdivision"]) {
            "catmark" => TriangleRule::CatmullClark,
            "smooth" => TriangleRule::Smooth,
            other => panic!("{name}: triangle rule {other}"),
        };
        mesh.validate()
            .unwrap_or_else(|fault| panic!("{name}: {fault}"));
        let bounds = mesh.bounds();
        let diagonal = f64::from((bounds.max - bounds.min).length());
        Self {
            name,
            values,
            cage,
            mesh,
            diagonal,
        }
    }

    fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        list(&self.values["samples"])
            .iter()
            .enumerate()
            .map(|(index, row)| Row {
                index,
                values: list(row),
                ptex: row[1].as_u64().expect("a Ptex face") as u32,
                uv: [&row[2], &row[3]].map(number),
            })
    }

    fn place(&self, row: &Row) -> String {
        let kind = word(&row.values[4]);
        format!(
            "{} sample {} (Ptex face {}, {:?}, {kind})",
            self.name, row.index, row.ptex, row.uv
        )
    }

    fn check_samples(&self, worst: &mut Worst, faults: &mut Vec<String>) {
        let surface = LimitSurface::new(&self.mesh);
        let points = surface.points::<f64>(&self.mesh, 0);
        for row in self.rows() {
            let sample = surface.sample(&points, row.ptex, row.uv, ISOLATION);
            self.compare(&row, sample, worst, faults);
        }
        let without: Vec<u32> = (0..self.mesh.face_count() as u32)
            .filter(|&face| surface.is_hole(surface.ptex_faces(face).start))
            .collect();
        let expected = list(&self.values["facesWithoutLimit"]).iter();
        let expected: Vec<u32> = expected.map(|face| number(face) as u32).collect();
        if without != expected {
            faults.push(format!("{}: no limit on {without:?}", self.name));
        }
    }

    fn compare(
        &self,
        row: &Row,
        sample: Option<Sample>,
        worst: &mut Worst,
        faults: &mut Vec<String>,
    ) {
        let mut check = |what: &str, bound: f64, difference: Option<f64>| {
            let difference = difference.unwrap_or(f64::INFINITY);
            worst.note(what, difference, || self.place(row));
            if difference > bound || difference.is_nan() {
                faults.push(format!(
                    "{}: {what} off by {difference:.2e}",
                    self.place(row)
                ));
            }
        };
        let [expected, du, dv, normal] = [5, 6, 7, 8].map(|i| point(&row.values[i]));
        let (what, bound) = match word(&row.values[4]) {
            "corner" => ("positions at corners", CORNER_POSITION),
            _ => ("positions", POSITION),
        };
        let expected = expected.expect("every sample has a position");
        check(
            what,
            bound,
            sample.map(|s| distance(s.position, expected) / self.diagonal),
        );
        let scale = [du, dv].into_iter().flatten().map(length);
        let scale = scale.fold(LEAST_DERIVATIVE * self.diagonal, f64::max);
        for (i, expected) in [du, dv].into_iter().enumerate() {
            if let Some(expected) = expected {
                let found = sample.and_then(|s| s.derivatives).map(|d| d[i]);
                check(
                    "derivatives",
                    DERIVATIVE,
                    found.map(|d| distance(d, expected) / scale),
                );
            }
        }
        if let Some(expected) = normal {
            let found = sample.and_then(|s| s.normal);
            // An exact fold: one derivative is 0 or along the other, and which side their cross product, a rounding
            // error, points to is chance.
            let is_fold = du
                .zip(dv)
                .is_some_and(|(du, dv)| length(cross(du, dv)) < 1e-9 * scale * scale);
            let minus = expected.map(|x| -x);
            check(
                if is_fold {
                    "normals at folds"
                } else {
                    "normals"
                },
                DERIVATIVE,
                found.map(|n| match is_fold {
                    true => distance(n, expected).min(distance(n, minus)),
                    false => distance(n, expected),
                }),
            );
        }
    }

    /// The values by each rule.
    fn face_varying(&self) -> impl Iterator<Item = (&String, &[Value])> {
        let rules = self.values["faceVarying"].as_object().into_iter().flatten();
        rules.filter_map(|(rule, values)| Some((rule, values.as_array()?.as_slice())))
    }

    fn check_face_varying(&self, worst: &mut Worst, faults: &mut Vec<String>) {
        for (name, expected) in self.face_varying() {
            let rule = match name.as_str() {
                "none" => FaceVaryingInterpolation::None,
                "cornersOnly" => FaceVaryingInterpolation::CornersOnly,
                "cornersPlus1" => FaceVaryingInterpolation::CornersPlus1,
                "cornersPlus2" => FaceVaryingInterpolation::CornersPlus2,
                "boundaries" => FaceVaryingInterpolation::Boundaries,
                "allLinear" => FaceVaryingInterpolation::All,
                other => panic!("{}: rule {other}", self.name),
            };
            let mut primvars = self.mesh.primvars.iter();
            let st = primvars
                .find(|p| p.interpolation == Interpolation::FaceVarying)
                .expect("the cage has texture coordinates");
            let (surface, elements) = LimitSurface::face_varying(&self.mesh, st, rule);
            let values = elements.iter().flat_map(|&e| st.element(e as usize));
            let field = surface.field(values.map(|&x| f64::from(x)).collect(), 2);
            for (row, expected) in self.rows().zip(expected) {
                let Some(expected) = expected.as_array() else {
                    continue;
                };
                let found = surface.sample_value(&field, row.ptex, row.uv, ISOLATION);
                let difference = found.map_or(f64::INFINITY, |found| {
                    let both = found.iter().zip(expected);
                    both.fold(0.0, |most, (a, b)| (a - number(b)).abs().max(most))
                });
                let place = || format!("{}, {name}", self.place(&row));
                worst.note("face-varying", difference, place);
                if difference > FACE_VARYING || difference.is_nan() {
                    faults.push(format!("{}: off by {difference:.2e}", place()));
                }
            }
        }
    }

    /// Uniform refinement, in the reference's order of points.
    fn check_refined(&self, folder: &Path, worst: &mut Worst, faults: &mut Vec<String>) {
        let Some(uniform) = self.values.get("uniform") else {
            return;
        };
        let levels = uniform["level"].as_u64().expect("a level") as u32;
        let expected = read_npy(&folder.join(word(&uniform["positions"])));
        let refined = refine(&self.mesh, levels).mesh;
        let points = &refined.points[0];
        if points.len() != expected.len()
            || refined.face_count() as f64 != number(&uniform["faces"])
        {
            faults.push(format!(
                "{}: {} points and {} faces",
                self.name,
                points.len(),
                refined.face_count()
            ));
            return;
        }
        for (i, (point, expected)) in points.iter().zip(&expected).enumerate() {
            let difference = distance(point.as_dvec3().to_array(), *expected) / self.diagonal;
            let place = || format!("{}, refined point {i}", self.name);
            worst.note("refined", difference, place);
            if difference > REFINED || difference.is_nan() {
                faults.push(format!("{}: off by {difference:.2e}", place()));
            }
        }
    }
}

/// All files of reference values.
fn oracles(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut files: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "json") && !f.ends_with("index.json"));
    files.sort();
    files
}

/// A NumPy file of rows of three single-precision numbers.
fn read_npy(path: &Path) -> Vec<[f64; 3]> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert!(
        bytes.starts_with(b"\x93NUMPY\x01"),
        "{} is not NumPy's",
        path.display()
    );
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let text = String::from_utf8_lossy(&bytes[10..10 + header]);
    assert!(
        text.contains("'<f4'") && text.contains("'fortran_order': False"),
        "{text}"
    );
    let numbers = bytes[10 + header..].chunks_exact(4).map(|b| {
        let b = b.try_into().expect("four bytes");
        f64::from(f32::from_le_bytes(b))
    });
    let numbers: Vec<f64> = numbers.collect();
    numbers
        .chunks_exact(3)
        .map(|p| [p[0], p[1], p[2]])
        .collect()
}

fn parse(path: &Path) -> Value {
    let text = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_slice(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn word(value: &Value) -> &str {
    value.as_str().expect("a word")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn point(value: &Value) -> Option<[f64; 3]> {
    let values = value.as_array()?;
    Some([0, 1, 2].map(|i| number(&values[i])))
}

fn length(a: [f64; 3]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    length([0, 1, 2].map(|i| a[i] - b[i]))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}
