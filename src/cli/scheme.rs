//! Words of the command line for subdivision rules: OpenSubdiv's and USD's.

use clap::ValueEnum;
use relievo::mesh::{BoundaryInterpolation, ControlMesh, Scheme};
use relievo::subdiv::schemes::classic::SchemeKind;

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

/// Everything that refines: USD's schemes, the classical ones, and Chaikin's for curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RefinementName {
    /// Catmull and Clark 1978: any faces, creases.
    #[value(name = "catmark", aliases = ["catmull-clark", "catmullClark"])]
    CatmullClark,
    /// Loop 1987: triangles, creases.
    Loop,
    /// Faces split, points stay.
    Bilinear,
    /// Doo and Sabin 1978: any faces; one for each old face, edge and vertex.
    DooSabin,
    /// Modified Butterfly (Zorin 1996): triangles; the surface passes through all points.
    Butterfly,
    /// Kobbelt's √3 (2000): triangles, three for one; two levels make nine.
    Sqrt3,
    /// Chaikin 1974: polylines, whose corners are cut off.
    Chaikin,
}

/// What a [`RefinementName`] stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refinement {
    /// A scheme of control meshes.
    Standard(SchemeName),
    /// A classical one.
    Classic(SchemeKind),
    /// Curves.
    Chaikin,
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

impl RefinementName {
    /// What it stands for.
    pub(crate) fn kind(self) -> Refinement {
        match self {
            Self::CatmullClark => Refinement::Standard(SchemeName::CatmullClark),
            Self::Loop => Refinement::Standard(SchemeName::Loop),
            Self::Bilinear => Refinement::Standard(SchemeName::Bilinear),
            Self::DooSabin => Refinement::Classic(SchemeKind::DooSabin),
            Self::Butterfly => Refinement::Classic(SchemeKind::Butterfly),
            Self::Sqrt3 => Refinement::Classic(SchemeKind::Sqrt3),
            Self::Chaikin => Refinement::Chaikin,
        }
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
