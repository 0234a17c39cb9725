//! Images in and out, through OpenImageIO. Knows no mesh and no scene.

mod source;

pub use source::{ColorSpace, ImageSource, Wrap};
