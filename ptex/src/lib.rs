//! Ptex, per-face texture mapping (Burley and Lacewell, Eurographics Symposium on Rendering 2008), in safe Rust.
//!
//! A Ptex file holds one small texture for every face of a control mesh, and the adjacency of the faces: no uv
//! assignment, and no seams, because a filter that reaches past an edge goes on in the face beyond. [`types`] names
//! what a file is made of, [`Reader`] reads one, within the memory that a [`Cache`] grants.
//! [`Filter`] filters it as others do, [`Consistent`] gives displacement that does not tear.
//!
//! Conventions: `u` and `v` are in units of a face; edge 0 runs from (0, 0) to (1, 0), edge 1 from (1, 0) to (1, 1),
//! edge 2 from (1, 1) to (0, 1), edge 3 back to (0, 0); row 0 of the texels lies along edge 0.

#![forbid(unsafe_code)]

mod cache;
mod check;
mod editor;
mod error;
pub mod filter;
mod layout;
mod meta;
mod reader;
mod reduce;
mod sample;
mod source;
mod temporary;
pub mod types;
mod writer;
mod zip;

pub use cache::Cache;
pub use check::{Finding, Severity, check};
pub use editor::Editor;
pub use error::{Error, ErrorKind, Result};
pub use filter::{Consistent, FaceBounds, Filter, FilterKind};
pub use layout::{ExtHeader, Header, LevelInfo, MAX_LOG2, StoredFace};
pub use meta::{Meta, MetaValue};
pub use reader::{Reader, Texels};
pub use types::{BorderMode, DataType, EdgeFilter, FaceInfo, MeshType, Neighbour, Res};
pub use writer::{EncodedFace, Format, Writer};
