//! The displaced surface: limit surface plus displacement, with normals, certified bounds and dicing.
//!
//! [`Base`] is what is asked of a limit surface, whoever computes it; a [`Surface`] adds a [`Displacement`] to it.
//! [`Rates`] say how finely edges are cut, and a [`Diced`] surface holds the micro-vertices: where two faces meet,
//! both have the very same ones, bit for bit. Nothing here reads a file, and nothing fails on a valid mesh.

mod adjacency;
mod base;
mod bicubic;
mod bounds;
mod carried;
mod dice;
mod displace;
mod evaluate;
mod grids;
mod image_map;
mod parts;
mod patch;
mod pyramid;
mod rates;
mod shared;
mod shell;
mod subdivided;
mod subdivision;
#[cfg(test)]
pub(crate) mod tests;
mod tiles;

pub use base::{
    Base, Carrier, EdgeUse, LimitGrid, LimitPoint, Texcoord, TexcoordGrid, UvRect, edge_uv,
};
pub use bicubic::Bicubic;

pub use crate::image::{FROM_BYTE, Fold, TexelKind, TexelOrder, Texels, Wrap};
pub use dice::{Diced, FaceGrid, Grids};
pub use displace::{
    Amount, Displacement, DisplacementMap, DisplacementPoint, Function, MapGrid, Region, Slope,
    Space,
};
pub use evaluate::{DisplacedPoint, Faults, Surface, tangents};
pub use image_map::{Channels, HeightImage, ImageMap};
pub use patch::Patch;
pub use pyramid::Pyramid;
pub use rates::{Dicing, MOST_SEGMENTS, Places, Rates, View};
pub use shared::{Scratch, SharedSamples};
pub use shell::{Shell, ShellError, ShellPoint, ShellTolerance, Torn};
pub use subdivision::Subdivision;
pub use tiles::Tiles;
