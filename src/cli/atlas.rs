//! `relievo atlas`: texture coordinates for a cage without them.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relievo::atlas::{AtlasOptions, atlas};
use relievo::image::write_whole;
use relievo::mesh::{
    BoundaryInterpolation, ControlMesh, CreaseMethod, Primvar, Scheme, TriangleRule,
};
use relievo::{Error, Result};

use super::cage::{Wanted, load_mesh};
use super::keep_inputs;
use super::subdivide::obj_text;

/// Give a cage texture coordinates: charts by least squares conformal maps, packed into the unit square.
///
/// Faces keep their order and corners. Coordinates are linear within each face, and one to one: no two faces meet but
/// at their edges. As far as stretch within charts allows, all have the same density of texels.
///
/// OUTPUT.usda of a USD file is a layer that has nothing but the coordinates: list it among the subLayers of the scene.
#[derive(Debug, Args)]
pub(crate) struct Atlas {
    /// Cage: an OBJ or USD file.
    cage: PathBuf,
    /// The cage with texture coordinates: an OBJ file (.obj), whose first word should name the scheme, or a USD file
    /// (.usda).
    #[arg(short, long)]
    output: PathBuf,
    /// The path of the mesh, if there are several.
    #[arg(long)]
    prim: Option<String>,
    /// The name of the primvar.
    #[arg(long, default_value = "st")]
    primvar: String,
    /// Texels across the picture that the charts are for.
    #[arg(long, default_value_t = 1024)]
    resolution: u32,
    /// Texels between charts at least, and half as many along the picture's sides.
    #[arg(long, default_value_t = 4.0)]
    margin: f64,
    /// How many times as long or short as all over a chart its lengths become at most: less makes more charts.
    #[arg(long, default_value_t = 2.0)]
    max_stretch: f64,
}

impl Atlas {
    pub(crate) fn run(self) -> Result<()> {
        if !(self.ends_in("obj") || self.ends_in("usda")) {
            return Err(Error::usage(
                format!("{}: such a file cannot be written", self.output.display()),
                "give the output a name that ends in .obj or .usda",
            ));
        }
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if !self
            .primvar
            .starts_with(|c| is_word(c) && !c.is_ascii_digit())
            || !self.primvar.chars().all(is_word)
        {
            return Err(Error::usage(
                format!("--primvar {:?} is no name", self.primvar),
                "use letters, digits and underscores, and begin with no digit",
            ));
        }
        if !self.ends_in("obj") {
            // A layer has the coordinates alone.
            keep_inputs(&[&self.cage], [&self.output])?;
        }
        let shape = load_mesh(&self.cage, self.prim.as_deref(), Wanted::Any)?;
        let mesh = shape.geometry.mesh().expect("it is a mesh");
        let options = AtlasOptions {
            primvar: self.primvar.clone(),
            resolution: self.resolution,
            margin: self.margin,
            most_stretch: self.max_stretch,
        };
        options.check().map_err(|fault| Error::Usage {
            message: fault.message,
            help: fault.help,
        })?;
        let made = atlas(mesh, &options)
            .map_err(|fault| fault.at_prim(shape.path.as_str()).in_file(&self.cage))?;
        tracing::info!(
            "{}: {} faces in {} charts, which fill {:.0} % of the square",
            shape.path,
            mesh.face_count(),
            made.chart_count,
            100.0 * made.filled
        );
        let coordinates = made.coordinates.clone();
        let mut worn = ControlMesh::clone(mesh);
        made.put_on(&mut worn);
        let of_obj = (self.cage.extension()).is_some_and(|e| e.eq_ignore_ascii_case("obj"));
        let text = match (self.ends_in("obj"), of_obj) {
            (true, _) => {
                // The only one that OBJ has.
                worn.primvars = vec![coordinates];
                obj_text(&worn)
            }
            (false, true) => mesh_layer(&worn, &coordinates),
            (false, false) => layer(&shape.path, &coordinates),
        };
        write_whole(&self.output, |path| {
            std::fs::write(path, &text)
                .map_err(|e| Error::failed(format!("{}: {e}", self.output.display())))
        })
    }

    fn ends_in(&self, ending: &str) -> bool {
        let own = self.output.extension().unwrap_or_default();
        own.eq_ignore_ascii_case(ending)
    }
}

/// A layer with the coordinates of the mesh at a path.
fn layer(path: &str, coordinates: &Primvar) -> String {
    let mut text = "#usda 1.0\n\n".to_owned();
    let names: Vec<&str> = path.split('/').filter(|name| !name.is_empty()).collect();
    for (depth, name) in names.iter().enumerate() {
        let indent = "    ".repeat(depth);
        text += &format!("{indent}over \"{name}\"\n{indent}{{\n");
    }
    text += &attributes(coordinates, &"    ".repeat(names.len()));
    for depth in (0..names.len()).rev() {
        text += &format!("{}}}\n", "    ".repeat(depth));
    }
    text
}

/// A layer with a mesh of an OBJ file, its tags and its coordinates.
fn mesh_layer(mesh: &ControlMesh, coordinates: &Primvar) -> String {
    let mut text =
        "#usda 1.0\n(\n    defaultPrim = \"Mesh\"\n)\n\ndef Mesh \"Mesh\"\n{\n".to_owned();
    let mut line = |line: std::fmt::Arguments<'_>| {
        writeln!(text, "    {line}").expect("a string takes all that is written");
    };
    let scheme = match mesh.scheme {
        Scheme::CatmullClark => "catmullClark",
        Scheme::Loop => "loop",
        Scheme::Bilinear => "bilinear",
        Scheme::None => "none",
    };
    line(format_args!(
        "uniform token subdivisionScheme = \"{scheme}\""
    ));
    let boundary = match mesh.boundary {
        BoundaryInterpolation::None => "none",
        BoundaryInterpolation::EdgeOnly => "edgeOnly",
        BoundaryInterpolation::EdgeAndCorner => "edgeAndCorner",
    };
    line(format_args!("token interpolateBoundary = \"{boundary}\""));
    if mesh.triangle_rule == TriangleRule::Smooth {
        line(format_args!("token triangleSubdivisionRule = \"smooth\""));
    }
    let counts = list(mesh.face_vertex_counts.iter());
    line(format_args!("int[] faceVertexCounts = [{counts}]"));
    let indices = list(mesh.face_vertex_indices.iter());
    line(format_args!("int[] faceVertexIndices = [{indices}]"));
    let points = mesh.points[0]
        .iter()
        .map(|p| format!("({}, {}, {})", p.x, p.y, p.z));
    line(format_args!("point3f[] points = [{}]", list(points)));
    if !mesh.creases.is_empty() {
        let ends = list(mesh.creases.iter().flat_map(|c| c.vertices));
        line(format_args!("int[] creaseIndices = [{ends}]"));
        let lengths = list(mesh.creases.iter().map(|_| 2));
        line(format_args!("int[] creaseLengths = [{lengths}]"));
        let sharpness = list(mesh.creases.iter().map(|c| c.sharpness));
        line(format_args!("float[] creaseSharpnesses = [{sharpness}]"));
    }
    if !mesh.corners.is_empty() {
        let vertices = list(mesh.corners.iter().map(|c| c.vertex));
        line(format_args!("int[] cornerIndices = [{vertices}]"));
        let sharpness = list(mesh.corners.iter().map(|c| c.sharpness));
        line(format_args!("float[] cornerSharpnesses = [{sharpness}]"));
    }
    if !mesh.holes.is_empty() {
        line(format_args!(
            "int[] holeIndices = [{}]",
            list(mesh.holes.iter())
        ));
    }
    if mesh.crease_method == CreaseMethod::Chaikin {
        tracing::warn!("USD has no Chaikin creases: in the output they are uniform");
    }
    text += &attributes(coordinates, "    ");
    text + "}\n"
}

fn attributes(coordinates: &Primvar, indent: &str) -> String {
    let name = &coordinates.name;
    let values = coordinates.values.chunks_exact(2);
    let values = list(values.map(|st| format!("({}, {})", st[0], st[1])));
    let indices = list(coordinates.indices.iter().flatten());
    format!(
        "{indent}token faceVaryingLinearInterpolation = \"all\"\n\
         {indent}texCoord2f[] primvars:{name} = [{values}] (\n\
         {indent}    interpolation = \"faceVarying\"\n{indent})\n\
         {indent}int[] primvars:{name}:indices = [{indices}]\n"
    )
}

fn list(items: impl Iterator<Item = impl ToString>) -> String {
    items
        .map(|item| item.to_string())
        .collect::<Vec<_>>()
        .join(", ")
}
