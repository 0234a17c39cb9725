//! `relievo subdivide`: uniform refinement of a cage, or of curves.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relievo::error::Fault;
use relievo::image::write_whole;
use relievo::mesh::{ControlMesh, CreaseMethod, Interpolation, Polyline, Primvar, TriangleRule};
use relievo::scene::obj;
use relievo::subdiv;
use relievo::subdiv::schemes::classic::{self, SchemeKind};
use relievo::subdiv::schemes::{chaikin, chaikin_page, classic_limit};
use relievo::{Error, Result};

use super::eval::load_cage;
use super::scheme::{BoundaryName, Refinement, RefinementName};

/// Refine a cage, level by level, to a finer OBJ or USD file.
///
/// Polylines (elements `l` of an OBJ file without faces) are refined as curves; if OUTPUT ends in .svg, a page shows
/// them and all their levels.
///
/// Doo-Sabin, Butterfly and √3 have no rule for creases: tags without effect are counted in a warning.
#[derive(Debug, Args)]
pub(crate) struct Subdivide {
    /// Cage or curves: an OBJ file, with OpenSubdiv's tags.
    cage: PathBuf,
    /// The finer mesh: an OBJ file, where sharpness that is left is written as tags, or its faces as a USD file
    /// (.usda). Curves: an OBJ or SVG file.
    #[arg(short, long)]
    output: PathBuf,
    /// How many levels.
    #[arg(short = 'n', long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=16))]
    levels: u32,
    /// Move the points to the limit surface, or curve.
    #[arg(long)]
    limit: bool,
    /// The scheme [default: the first word of the cage's name, else catmark; chaikin for polylines].
    #[arg(long, value_enum)]
    scheme: Option<RefinementName>,
    /// What happens at the border [default: as the cage's tags say].
    #[arg(long, value_enum)]
    boundary: Option<BoundaryName>,
}

impl Subdivide {
    pub(crate) fn run(self) -> Result<()> {
        if !["obj", "usda", "svg"].iter().any(|e| self.ends_in(e)) {
            return Err(Error::usage(
                format!("{}: such a file cannot be written", self.output.display()),
                "give the output a name that ends in .obj, .usda or, for curves, .svg",
            ));
        }
        let text = match self.scheme.map(RefinementName::kind) {
            Some(Refinement::Chaikin) => self.curves()?,
            None if obj::is_curves(&self.cage)? => self.curves()?,
            _ if self.draws() => {
                return Err(Error::usage(
                    "only curves are drawn to SVG, not meshes",
                    "give the output a name that ends in .obj",
                ));
            }
            Some(Refinement::Classic(kind)) => self.classic(kind)?,
            Some(Refinement::Standard(scheme)) => self.standard(|mesh| scheme.apply(mesh))?,
            None => self.standard(|_| {})?,
        };
        write_whole(&self.output, |path| {
            std::fs::write(path, &text)
                .map_err(|e| Error::failed(format!("{}: {e}", self.output.display())))
        })
    }

    /// By USD's schemes.
    fn standard(&self, set_scheme: impl FnOnce(&mut ControlMesh)) -> Result<String> {
        let mut mesh = self.mesh()?;
        set_scheme(&mut mesh);
        mesh.validate().map_err(|f| f.in_file(&self.cage))?;
        let corners = mesh.face_vertex_indices.len() as u64;
        if corners.saturating_mul(4_u64.pow(self.levels)) > u64::from(u32::MAX) {
            return Err(Error::usage(
                format!(
                    "{} levels of {} faces are more than 32 bits can number",
                    self.levels,
                    mesh.face_count()
                ),
                "ask for fewer --levels",
            ));
        }
        let mut refined = subdiv::refine(&mesh, self.levels);
        if self.limit {
            refined.move_to_limit(&mesh);
        }
        Ok(self.text(&refined.mesh))
    }

    fn classic(&self, kind: SchemeKind) -> Result<String> {
        if self.limit && kind == SchemeKind::DooSabin && self.levels == 0 {
            return Err(Error::usage(
                "--limit: the cage's own points have no place on a Doo-Sabin surface",
                "ask for one level at least",
            ));
        }
        let mesh = self.mesh()?;
        let refined = match self.limit {
            true => classic_limit::refine_to_limit(&mesh, kind, self.levels),
            false => classic::refine(&mesh, kind, self.levels),
        };
        let refined = refined.map_err(|f| f.in_file(&self.cage))?;
        if refined.ignored_tags > 0 {
            tracing::warn!(
                "{}: {} creases and corners have no effect: {} subdivision has no rule for them",
                self.cage.display(),
                refined.ignored_tags,
                kind.name()
            );
        }
        Ok(self.text(&refined.mesh))
    }

    fn curves(&self) -> Result<String> {
        if self.boundary.is_some() {
            return Err(Error::usage(
                "--boundary is for meshes, not for curves",
                "leave it out",
            ));
        }
        let fault = |fault: Fault| Error::from(fault.in_file(&self.cage));
        let polylines = obj::load_polylines(&self.cage)?;
        if self.draws() {
            if self.limit {
                return Err(Error::usage(
                    "--limit has no meaning for a page that shows all levels",
                    "leave it out, or give the output a name that ends in .obj",
                ));
            }
            return chaikin_page::draw(&polylines, self.levels).map_err(fault);
        }
        let refine = |polyline: &Polyline| -> Result<Polyline, Fault> {
            let fine = chaikin::refine(polyline, self.levels)?;
            if !self.limit {
                return Ok(fine);
            }
            let points = (0..fine.points.len()).map(|i| {
                let (position, _) = chaikin::limit(&fine, i as f64)?;
                Ok(position.as_vec3())
            });
            Ok(Polyline {
                points: points.collect::<Result<_, Fault>>()?,
                closed: fine.closed,
            })
        };
        let fine: Result<Vec<_>, Fault> = polylines.iter().map(refine).collect();
        Ok(polylines_text(&fine.map_err(fault)?))
    }

    /// Whether the output is a page.
    fn draws(&self) -> bool {
        self.ends_in("svg")
    }

    fn ends_in(&self, ending: &str) -> bool {
        let own = self.output.extension().unwrap_or_default();
        own.eq_ignore_ascii_case(ending)
    }

    /// The mesh in the output's format.
    fn text(&self, mesh: &ControlMesh) -> String {
        if self.ends_in("usda") {
            usda_text(mesh)
        } else {
            obj_text(mesh)
        }
    }

    /// The cage with the boundary rule that is asked for.
    fn mesh(&self) -> Result<ControlMesh> {
        let mut mesh = load_cage(&self.cage)?;
        if let Some(boundary) = self.boundary {
            boundary.apply(&mut mesh);
        }
        Ok(mesh)
    }
}

/// Polylines as an OBJ file; a closed one comes back to its first point.
fn polylines_text(polylines: &[Polyline]) -> String {
    let mut text = String::new();
    let mut first = 1;
    for polyline in polylines {
        for p in &polyline.points {
            writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("a string takes all");
        }
        let end = first + polyline.points.len();
        text.push('l');
        for i in (first..end).chain(polyline.closed.then_some(first)) {
            write!(text, " {i}").expect("a string takes all");
        }
        text.push('\n');
        first = end;
    }
    text
}

/// The faces of a mesh as a layer of USD: polygons, without tags.
fn usda_text(mesh: &ControlMesh) -> String {
    fn list(items: impl Iterator<Item = String>) -> String {
        items.collect::<Vec<_>>().join(", ")
    }
    let hole: std::collections::HashSet<u32> = mesh.holes.iter().copied().collect();
    let shown = || {
        let faces = mesh.faces().zip(0..);
        faces.filter_map(|(corners, face)| (!hole.contains(&face)).then_some(corners))
    };
    let counts = shown().map(|corners| corners.len().to_string());
    let indices = shown().flat_map(|corners| &mesh.face_vertex_indices[corners]);
    let points = mesh.points[0].iter();
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"Mesh\"\n)\n\ndef Mesh \"Mesh\"\n{{\n    \
         uniform token subdivisionScheme = \"none\"\n    \
         int[] faceVertexCounts = [{}]\n    int[] faceVertexIndices = [{}]\n    point3f[] points = [{}]\n}}\n",
        list(counts),
        list(indices.map(u32::to_string)),
        list(points.map(|p| format!("({}, {}, {})", p.x, p.y, p.z))),
    )
}

/// A mesh as an OBJ file with OpenSubdiv's tags.
pub(super) fn obj_text(mesh: &ControlMesh) -> String {
    let mut text = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| {
        text.write_fmt(line)
            .expect("a string takes all that is written");
        text.push('\n');
    };
    for p in &mesh.points[0] {
        line(format_args!("v {} {} {}", p.x, p.y, p.z));
    }
    let is_st = |p: &&Primvar| p.interpolation == Interpolation::FaceVarying && p.width == 2;
    let st = mesh.primvars.iter().find(is_st);
    for vt in st.iter().flat_map(|st| st.values.chunks_exact(2)) {
        line(format_args!("vt {} {}", vt[0], vt[1]));
    }
    for face in mesh.faces() {
        let corners = face.map(|corner| {
            let point = mesh.face_vertex_indices[corner] + 1;
            match st {
                Some(st) => {
                    let element = st.indices.as_ref().map_or(corner as u32, |i| i[corner]);
                    format!(" {point}/{}", element + 1)
                }
                None => format!(" {point}"),
            }
        });
        line(format_args!("f{}", corners.collect::<String>()));
    }
    for crease in &mesh.creases {
        let [a, b] = crease.vertices;
        line(format_args!("t crease 2/1/0 {a} {b} {}", crease.sharpness));
    }
    for corner in &mesh.corners {
        line(format_args!(
            "t corner 1/1/0 {} {}",
            corner.vertex, corner.sharpness
        ));
    }
    for hole in &mesh.holes {
        line(format_args!("t hole 1/0/0 {hole}"));
    }
    let boundary = match mesh.boundary {
        relievo::mesh::BoundaryInterpolation::None => 0,
        relievo::mesh::BoundaryInterpolation::EdgeAndCorner => 1,
        relievo::mesh::BoundaryInterpolation::EdgeOnly => 2,
    };
    line(format_args!("t interpolateboundary 1/0/0 {boundary}"));
    if st.is_some() {
        let rule = mesh.face_varying as u32;
        line(format_args!(
            "t facevaryinginterpolateboundary 1/0/0 {rule}"
        ));
    }
    // The others are what a file without the tag has.
    if mesh.crease_method == CreaseMethod::Chaikin {
        line(format_args!("t creasemethod 0/0/1 chaikin"));
    }
    if mesh.triangle_rule == TriangleRule::Smooth {
        line(format_args!("t smoothtriangles 0/0/1 smooth"));
    }
    text
}
