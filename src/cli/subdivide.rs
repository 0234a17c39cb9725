//! `relievo subdivide`: uniform refinement of a cage.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use relievo::image::write_whole;
use relievo::mesh::{ControlMesh, Interpolation, Primvar};
use relievo::subdiv;
use relievo::{Error, Result};

use super::eval::load_cage;
use super::scheme::{BoundaryName, SchemeName};

/// Refine a cage, level by level, to a finer OBJ file.
#[derive(Debug, Args)]
pub(crate) struct Subdivide {
    /// Cage: an OBJ file, with OpenSubdiv's tags.
    cage: PathBuf,
    /// The finer mesh: an OBJ file. Sharpness that is left is written as tags.
    #[arg(short, long)]
    output: PathBuf,
    /// How many levels.
    #[arg(short = 'n', long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=16))]
    levels: u32,
    /// Move the points to the limit surface.
    #[arg(long)]
    limit: bool,
    /// The scheme [default: the first word of the cage's name].
    #[arg(long, value_enum)]
    scheme: Option<SchemeName>,
    /// What happens at the border [default: as the cage's tags say].
    #[arg(long, value_enum)]
    boundary: Option<BoundaryName>,
}

impl Subdivide {
    pub(crate) fn run(self) -> Result<()> {
        let mut mesh = load_cage(&self.cage)?;
        if let Some(scheme) = self.scheme {
            scheme.apply(&mut mesh);
        }
        if let Some(boundary) = self.boundary {
            boundary.apply(&mut mesh);
        }
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
        let text = obj_text(&refined.mesh);
        write_whole(&self.output, |path| {
            std::fs::write(path, &text)
                .map_err(|e| Error::failed(format!("{}: {e}", self.output.display())))
        })
    }
}

/// A mesh as an OBJ file with OpenSubdiv's tags.
fn obj_text(mesh: &ControlMesh) -> String {
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
    text
}
