//! What a Ptex file is made of: faces with their sizes and neighbours, types of data, modes at borders.

/// Which faces the mesh has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshType {
    /// Triangles, with texels that fill a square twice: even triangles and odd ones.
    Triangle,
    /// Quads, and polygons as one sub-face for every corner.
    Quad,
}

/// The type in which texels are stored, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataType {
    /// Unsigned bytes; 255 is one.
    U8,
    /// Unsigned 16-bit integers; 65535 is one.
    U16,
    /// IEEE half floats.
    F16,
    /// IEEE single floats.
    F32,
}

impl DataType {
    /// Bytes of one channel of one texel.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// Whether it counts in whole steps, up to [`DataType::one`].
    #[must_use]
    pub fn is_integer(self) -> bool {
        matches!(self, Self::U8 | Self::U16)
    }

    /// What is stored for 1.
    #[must_use]
    pub fn one(self) -> f32 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65535.0,
            Self::F16 | Self::F32 => 1.0,
        }
    }
}

/// What a filter sees beyond an edge that has no neighbour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BorderMode {
    /// The last row or column again.
    Clamp,
    /// Nothing: zero in every channel.
    Black,
    /// The other side of the same face.
    Periodic,
}

/// What happens to a texel's channels on the way to a neighbour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeFilter {
    /// They stay as they are.
    None,
    /// The first two are a vector in the face's tangent plane, which turns with the frame.
    TangentVector,
}

/// The size of a face's texture, or of a reduction: the logarithms to base 2 of its columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Res {
    /// Logarithm of the number of columns, along u.
    pub ulog2: i8,
    /// Logarithm of the number of rows, along v.
    pub vlog2: i8,
}

/// The face beyond an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Neighbour {
    /// Its index.
    pub face: u32,
    /// The edge of that face, 0 to 3, that the two have in common.
    pub edge: u8,
}

/// One face of a file: its full size, its neighbours and what is known of its texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaceInfo {
    /// The size of its texture.
    pub res: Res,
    /// What lies beyond each of its edges.
    pub neighbours: [Option<Neighbour>; 4],
    /// All its texels are equal.
    pub constant: bool,
    /// An incremental edit replaced it: stored reductions no longer hold.
    pub has_edits: bool,
    /// It is constant, and so are all faces around it, with the same texel.
    pub constant_neighbourhood: bool,
    /// It is one corner of a polygon that is not a quad, and a quarter of a quad in size.
    pub subface: bool,
}
