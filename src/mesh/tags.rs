//! What a control mesh says beyond its faces. Words and numbers are those of OpenSubdiv and UsdGeomMesh.

/// How faces become a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// Catmull and Clark 1978.
    #[default]
    CatmullClark,
    /// Loop 1987; triangles only.
    Loop,
    /// Faces split, points stay.
    Bilinear,
    /// No subdivision: flat polygons.
    None,
}

/// A sharp edge between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crease {
    /// The edge's two points.
    pub vertices: [u32; 2],
    /// 0 is smooth, [`Crease::INFINITE`] and more is sharp in the limit.
    pub sharpness: f32,
}

impl Crease {
    /// From this sharpness on, an edge or vertex is sharp in the limit (OpenSubdiv's and USD's convention).
    pub const INFINITE: f32 = 10.0;
}

/// A sharp point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// The point.
    pub vertex: u32,
    /// As for [`Crease`].
    pub sharpness: f32,
}

/// What the surface does at the border of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BoundaryInterpolation {
    /// Faces at the border shape their neighbours and are not part of the surface.
    None,
    /// Border edges are sharp.
    EdgeOnly,
    /// Border edges are sharp, and so are points with one face.
    #[default]
    EdgeAndCorner,
}

/// Where face-varying primvars stay linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FaceVaryingInterpolation {
    /// Smooth everywhere.
    None,
    /// Sharp at corners.
    CornersOnly,
    /// Sharp at corners, and at junctions of three or more regions.
    #[default]
    CornersPlus1,
    /// Also at darts and concave corners.
    CornersPlus2,
    /// Linear along the borders of regions.
    Boundaries,
    /// Linear everywhere.
    All,
}

/// How Catmull-Clark refines triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TriangleRule {
    /// Like any face.
    #[default]
    CatmullClark,
    /// With weights that make triangulated parts smoother.
    Smooth,
}

/// How sharpness decays along a crease.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CreaseMethod {
    /// By one a level, each edge alone.
    #[default]
    Uniform,
    /// Smoothed along the crease like Chaikin's corner cutting.
    Chaikin,
}
