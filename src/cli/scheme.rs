//! Words of the command line for subdivision rules: OpenSubdiv's and USD's.

use clap::ValueEnum;
use relievo::mesh::{BoundaryInterpolation, ControlMesh, Scheme};

/// How faces become a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SchemeName {
    /// Catmull-Clark 1978.
    #[value(name = "catmark", aliases = ["catmull-clark", "catmullClark"])]
    CatmullClark,
    /// Loop 1987, triangles only.
    Loop,
    /// Faces split, points stay.
    Bilinear,
}

/// What the surface does at the mesh's border.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "camelCase")]
pub(crate) enum BoundaryName {
    /// Faces at the border are left out.
    None,
    /// Border edges are sharp.
    EdgeOnly,
    /// Border edges are sharp, and so are points with one face.
    EdgeAndCorner,
}

impl SchemeName {
    /// Gives `mesh` this scheme.
    pub(crate) fn apply(self, mesh: &mut ControlMesh) {
        mesh.scheme = match self {
            Self::CatmullClark => Scheme::CatmullClark,
            Self::Loop => Scheme::Loop,
            Self::Bilinear => Scheme::Bilinear,
        };
    }
}

impl BoundaryName {
    /// Gives `mesh` this rule.
    pub(crate) fn apply(self, mesh: &mut ControlMesh) {
        mesh.boundary = match self {
            Self::None => BoundaryInterpolation::None,
            Self::EdgeOnly => BoundaryInterpolation::EdgeOnly,
            Self::EdgeAndCorner => BoundaryInterpolation::EdgeAndCorner,
        };
    }
}
