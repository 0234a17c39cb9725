//! Meshes as layers of USD: one prim each, named in `defaultPrim`.

use std::fmt::Write;

use relievo::math::{Vec2, Vec3};

/// A mesh to be written.
#[derive(Default)]
pub(crate) struct Mesh {
    pub(crate) points: Vec<Vec3>,
    /// Counterclockwise from the front.
    pub(crate) faces: Vec<Vec<usize>>,
    /// Texture coordinates of all corners, face by face; none for a mesh without.
    pub(crate) st: Vec<Vec2>,
    /// A colour for each point, and the primvar's name.
    pub(crate) colors: Option<(&'static str, Vec<Vec3>)>,
}

impl Mesh {
    /// The layer, which says of itself `doc`.
    pub(crate) fn text(&self, name: &str, doc: &str, scheme: &str) -> String {
        let mut text = format!(
            "#usda 1.0\n(\n    defaultPrim = \"{name}\"\n    doc = \"{doc} Written by examples/make_scenes.\"\n)\n\n\
             def Mesh \"{name}\"\n{{\n    uniform token subdivisionScheme = \"{scheme}\"\n"
        );
        let mut list = |name: &str, values: Vec<String>, end: &str| {
            let rows: Vec<String> = values.chunks(8).map(|row| row.join(", ")).collect();
            let rows = rows.join(",\n        ");
            writeln!(text, "    {name} = [\n        {rows}\n    ]{end}")
                .expect("a string takes all");
        };
        let triple = |p: &Vec3| format!("({:.5}, {:.5}, {:.5})", p.x, p.y, p.z);
        let counts = self.faces.iter().map(|f| f.len().to_string());
        list("int[] faceVertexCounts", counts.collect(), "");
        let corners = self.faces.iter().flatten().map(usize::to_string);
        list("int[] faceVertexIndices", corners.collect(), "");
        list(
            "point3f[] points",
            self.points.iter().map(triple).collect(),
            "",
        );
        if !self.st.is_empty() {
            let pairs = self.st.iter().map(|p| format!("({}, {})", p.x, p.y));
            let end = " (\n        interpolation = \"faceVarying\"\n    )";
            list("texCoord2f[] primvars:st", pairs.collect(), end);
            text.push_str("    uniform token faceVaryingLinearInterpolation = \"all\"\n");
        }
        if let Some((primvar, colors)) = &self.colors {
            let mut list = |values: Vec<String>| {
                let values = values.join(", ");
                let end = "(\n        interpolation = \"vertex\"\n    )";
                writeln!(text, "    color3f[] primvars:{primvar} = [{values}] {end}")
                    .expect("a string takes all");
            };
            list(colors.iter().map(triple).collect());
        }
        text.push_str("}\n");
        text
    }
}
