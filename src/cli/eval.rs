//! `relievo eval`: limit points of a cage at given parameters, as JSON.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use relievo::error::Fault;
use relievo::image::write_whole;
use relievo::mesh::{
    ControlMesh, CreaseMethod, FaceVaryingInterpolation, Interpolation, Primvar, TriangleRule,
};
use relievo::scene::{LoadOptions, obj};
use relievo::subdiv::{Field, LimitSurface};
use relievo::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::scheme::{BoundaryName, SchemeName};

/// Evaluate the limit surface of a cage.
///
/// Samples come as JSON: `fields` names the columns of `samples`, of which `face`, `ptex`, `u` and `v` are read. The
/// result has the same samples with all columns: P, dPdu, dPdv and the unit normal N, null where there is no value.
/// Derivatives are by u and v of the Ptex face.
/// If `faceVarying` names rules, the result has the texture coordinates by each of them.
#[derive(Debug, Args)]
pub(crate) struct Eval {
    /// Cage: an OBJ file, with OpenSubdiv's tags.
    cage: PathBuf,
    /// Where to evaluate: a JSON file.
    #[arg(long)]
    samples: PathBuf,
    /// The result: a JSON file.
    #[arg(short, long)]
    output: PathBuf,
    /// The scheme [default: the first word of the cage's name].
    #[arg(long, value_enum)]
    scheme: Option<SchemeName>,
    /// Exactly at extraordinary vertices, take the masks at this level of refinement, as OpenSubdiv does with this
    /// isolation level; `exact` gives the limit itself. They differ at darts, corners and ends of borders.
    #[arg(long, default_value = "10", value_parser = isolation)]
    isolation: Isolation,
    /// What happens at the border [default: as the samples' options or the cage's tags say].
    #[arg(long, value_enum)]
    boundary: Option<BoundaryName>,
}

/// Where to take the masks of extraordinary vertices: at a level, or at the limit.
type Isolation = Option<u32>;

fn isolation(word: &str) -> Result<Isolation, String> {
    match word {
        "exact" => Ok(None),
        _ => match word.parse() {
            Ok(level @ 6..=30) => Ok(Some(level)),
            _ => Err("a level from 6 to 30, or `exact`".to_owned()),
        },
    }
}

/// The samples file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Samples {
    fields: Vec<String>,
    samples: Vec<Vec<Value>>,
    #[serde(default)]
    options: Options,
    #[serde(default)]
    face_varying: Value,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Options {
    interpolate_boundary: Option<String>,
    crease_method: Option<String>,
    triangle_subdivision: Option<String>,
}

/// The columns of the result.
const FIELDS: [&str; 9] = ["face", "ptex", "u", "v", "kind", "P", "dPdu", "dPdv", "N"];

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Output {
    cage: String,
    fields: [&'static str; 9],
    samples: Vec<[Value; 9]>,
    #[serde(skip_serializing_if = "Map::is_empty")]
    face_varying: Map<String, Value>,
}

/// Where to evaluate.
#[derive(Debug, Clone, Copy)]
struct Place {
    face: u32,
    ptex: u32,
    uv: [f64; 2],
}

impl Eval {
    pub(crate) fn run(self) -> Result<()> {
        let fault = |fault: Fault| Error::from(fault.in_file(&self.samples));
        let samples = read(&self.samples)?;
        let rules = rules(&samples.face_varying).map_err(fault)?;
        let mut mesh = load_cage(&self.cage)?;
        samples.options.apply(&mut mesh).map_err(fault)?;
        if let Some(scheme) = self.scheme {
            scheme.apply(&mut mesh);
        }
        if let Some(boundary) = self.boundary {
            boundary.apply(&mut mesh);
        }
        mesh.validate().map_err(|f| f.in_file(&self.cage))?;

        let surface = LimitSurface::new(&mesh);
        let places = samples.places(&mesh, &surface).map_err(fault)?;
        let points = surface.points::<f64>(&mesh, 0);
        let kind = samples.fields.iter().position(|f| f == "kind");
        let rows = samples.samples.iter().zip(&places).map(|(sample, place)| {
            let [p, du, dv, n] = evaluate(&surface, &points, *place, self.isolation);
            let [u, v] = place.uv;
            let kind = kind.map_or(Value::Null, |k| sample[k].clone());
            [
                json!(place.face),
                json!(place.ptex),
                json!(u),
                json!(v),
                kind,
                p,
                du,
                dv,
                n,
            ]
        });
        let output = Output {
            cage: self
                .cage
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            fields: FIELDS,
            samples: rows.collect(),
            face_varying: face_varying(&mesh, &rules, &places, self.isolation)
                .map_err(|f| f.in_file(&self.cage))?,
        };
        let text = serde_json::to_vec(&output)
            .map_err(|e| Error::failed(format!("the result cannot be written as JSON: {e}")))?;
        write_whole(&self.output, |path| {
            std::fs::write(path, &text)
                .map_err(|e| Error::failed(format!("{}: {e}", self.output.display())))
        })
    }
}

/// The mesh of an OBJ file.
pub(crate) fn load_cage(path: &Path) -> Result<ControlMesh> {
    let scene = obj::load(path, &LoadOptions::default())?;
    for warning in scene.warnings.iter() {
        tracing::warn!("{}", warning.message);
    }
    let first = scene.shapes.first();
    let mesh = first.and_then(|s| s.geometry.mesh()).ok_or_else(|| {
        Fault::new("there is no mesh in it")
            .in_file(path)
            .advise("give an OBJ file with faces")
    })?;
    Ok(ControlMesh::clone(mesh))
}

fn read(path: &Path) -> Result<Samples> {
    let text = std::fs::read(path)
        .map_err(|e| Fault::new(format!("cannot be read: {e}")).in_file(path))?;
    let samples: Samples = serde_json::from_slice(&text).map_err(|e| {
        Fault::new(format!("is not a samples file: {e}"))
            .in_file(path)
            .advise(
                "it needs \"fields\", the names of the columns, and \"samples\", a list of rows",
            )
    })?;
    Ok(samples)
}

impl Options {
    fn apply(&self, mesh: &mut ControlMesh) -> Result<(), Fault> {
        let unknown = |name: &str, word: &str, known: &str| {
            Fault::new(format!("option {name} is \"{word}\"")).advise(format!("it may be {known}"))
        };
        if let Some(word) = &self.interpolate_boundary {
            let rule = BoundaryName::from_str(word, false).map_err(|_| {
                unknown(
                    "interpolateBoundary",
                    word,
                    "none, edgeOnly or edgeAndCorner",
                )
            })?;
            rule.apply(mesh);
        }
        if let Some(word) = &self.crease_method {
            mesh.crease_method = match word.as_str() {
                "uniform" | "normal" => CreaseMethod::Uniform,
                "chaikin" => CreaseMethod::Chaikin,
                _ => return Err(unknown("creaseMethod", word, "uniform or chaikin")),
            };
        }
        if let Some(word) = &self.triangle_subdivision {
            mesh.triangle_rule = match word.as_str() {
                "catmark" | "catmullClark" => TriangleRule::CatmullClark,
                "smooth" => TriangleRule::Smooth,
                _ => return Err(unknown("triangleSubdivision", word, "catmark or smooth")),
            };
        }
        Ok(())
    }
}

impl Samples {
    fn places(&self, mesh: &ControlMesh, surface: &LimitSurface) -> Result<Vec<Place>, Fault> {
        let column = |name: &str| {
            self.fields.iter().position(|f| f == name).ok_or_else(|| {
                Fault::new(format!("\"fields\" does not name a column {name}"))
                    .advise("the columns face, ptex, u and v are needed")
            })
        };
        let columns = [column("face")?, column("ptex")?, column("u")?, column("v")?];
        let place = |(i, sample): (usize, &Vec<Value>)| {
            let fault = |message: String| Fault::new(format!("sample {i}: {message}"));
            if sample.len() != self.fields.len() {
                return Err(fault(format!(
                    "{} values for {} fields",
                    sample.len(),
                    self.fields.len()
                )));
            }
            let [face, ptex] = [0, 1].map(|c| {
                let value = &sample[columns[c]];
                whole(value).ok_or_else(|| fault(format!("{value} is not the number of a face")))
            });
            let (face, ptex) = (face?, ptex?);
            if face as usize >= mesh.face_count() {
                return Err(fault(format!("face {face} of {}", mesh.face_count())));
            }
            let own = surface.ptex_faces(face);
            if !own.contains(&ptex) {
                return Err(fault(format!(
                    "Ptex face {ptex}, but face {face} has {} to {}",
                    own.start,
                    own.end - 1
                )));
            }
            let [u, v] = [2, 3].map(|c| {
                let value = &sample[columns[c]];
                let number = value.as_f64().filter(|x| (0.0..=1.0).contains(x));
                number.ok_or_else(|| fault(format!("parameter {value} is not within 0 and 1")))
            });
            let uv = [u?, v?];
            if surface.is_triangular() && uv[0] + uv[1] > 1.0 + 1e-9 {
                return Err(fault(format!(
                    "u + v is {}, outside of the triangle",
                    uv[0] + uv[1]
                )));
            }
            Ok(Place { face, ptex, uv })
        };
        self.samples.iter().enumerate().map(place).collect()
    }
}

/// A whole number, also one written as by programs that keep a row in floats: `3.0`.
fn whole(value: &Value) -> Option<u32> {
    let number = value.as_f64()?;
    (number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number))
        .then_some(number as u32)
}

/// Position, derivatives and unit normal, as far as there are any.
fn evaluate(
    surface: &LimitSurface,
    points: &Field<f64>,
    place: Place,
    isolation: Isolation,
) -> [Value; 4] {
    let Place { ptex, uv, .. } = place;
    let Some(sample) = surface.sample(points, ptex, uv, isolation) else {
        return [const { Value::Null }; 4];
    };
    let derivative = |i: usize| sample.derivatives.map_or(Value::Null, |d| json!(d[i]));
    [
        json!(sample.position),
        derivative(0),
        derivative(1),
        json!(sample.normal),
    ]
}

/// The names of face-varying rules.
const RULES: [(&str, FaceVaryingInterpolation); 6] = [
    ("none", FaceVaryingInterpolation::None),
    ("cornersOnly", FaceVaryingInterpolation::CornersOnly),
    ("cornersPlus1", FaceVaryingInterpolation::CornersPlus1),
    ("cornersPlus2", FaceVaryingInterpolation::CornersPlus2),
    ("boundaries", FaceVaryingInterpolation::Boundaries),
    ("allLinear", FaceVaryingInterpolation::All),
];

/// The rules that a list names, or an object's keys.
fn rules(named: &Value) -> Result<BTreeMap<String, FaceVaryingInterpolation>, Fault> {
    let names: Vec<&str> = match named {
        Value::Null => Vec::new(),
        Value::Array(names) => names
            .iter()
            .map(|n| n.as_str().unwrap_or_default())
            .collect(),
        // Numbers tell about the values and name no rule: how many were left out, how far two evaluators differ.
        Value::Object(map) => {
            let named = map.iter().filter(|(_, v)| !v.is_number());
            named.map(|(name, _)| name.as_str()).collect()
        }
        _ => vec![""],
    };
    names
        .into_iter()
        .map(|name| {
            let known = RULES
                .iter()
                .find(|r| r.0 == name || (name == "all" && r.0 == "allLinear"));
            known.map(|r| (name.to_owned(), r.1)).ok_or_else(|| {
                Fault::new(format!("\"faceVarying\" names a rule \"{name}\""))
                    .advise(format!("the rules are {}", RULES.map(|r| r.0).join(", ")))
            })
        })
        .collect()
}

fn face_varying(
    mesh: &ControlMesh,
    rules: &BTreeMap<String, FaceVaryingInterpolation>,
    places: &[Place],
    isolation: Isolation,
) -> Result<Map<String, Value>, Fault> {
    if rules.is_empty() {
        return Ok(Map::new());
    }
    let is_st = |p: &&Primvar| p.interpolation == Interpolation::FaceVarying && p.width == 2;
    let st = mesh.primvars.iter().find(is_st).ok_or_else(|| {
        Fault::new("the samples ask for texture coordinates, and the cage has none")
            .advise("give the faces vt indices, or leave out \"faceVarying\"")
    })?;
    let values = |rule| -> Vec<Value> {
        let (surface, elements) = LimitSurface::face_varying(mesh, st, rule);
        let values = elements.iter().flat_map(|&e| st.element(e as usize));
        let field = surface.field(values.map(|&x| f64::from(x)).collect(), 2);
        places
            .iter()
            .map(|place| json!(surface.sample_value(&field, place.ptex, place.uv, isolation)))
            .collect()
    };
    Ok(rules
        .iter()
        .map(|(name, &rule)| (name.clone(), Value::Array(values(rule))))
        .collect())
}
