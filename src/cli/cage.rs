//! The mesh of a scene that a command is about.

use std::path::Path;

use relievo::Result;
use relievo::error::Fault;
use relievo::mesh::Scheme;
use relievo::scene::{self, LoadOptions, Shape};

/// Which meshes a command takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Those with a scheme.
    Subdivision,
    /// Polygon meshes too.
    Any,
}

impl Wanted {
    fn name(self) -> &'static str {
        match self {
            Self::Subdivision => "subdivision surface",
            Self::Any => "mesh",
        }
    }
}

/// The one mesh of a file, or the one with that path.
///
/// # Errors
/// If the file cannot be read, there is none, or there are several.
pub(super) fn load_mesh(file: &Path, prim: Option<&str>, wanted: Wanted) -> Result<Shape> {
    let scene = scene::load(file, &LoadOptions::default())?;
    for warning in scene.warnings.iter() {
        tracing::warn!("{}", warning.message);
    }
    let is_wanted = |shape: &Shape| {
        let mesh = shape.geometry.mesh();
        mesh.is_some_and(|m| wanted == Wanted::Any || m.scheme != Scheme::None)
    };
    let mut cages: Vec<Shape> = scene.shapes.into_iter().filter(is_wanted).collect();
    let paths: Vec<&str> = cages.iter().map(|shape| shape.path.as_str()).collect();
    let (names, kind) = (paths.join(", "), wanted.name());
    if cages.is_empty() {
        let help = match wanted {
            Wanted::Subdivision => {
                "give a mesh with a subdivision scheme: only those have Ptex faces"
            }
            Wanted::Any => "give a file with a mesh",
        };
        return Err(Fault::new(format!("there is no {kind} in it"))
            .in_file(file)
            .advise(help)
            .into());
    }
    if let Some(prim) = prim {
        cages.retain(|shape| shape.path == prim);
    }
    if let [_] = cages[..] {
        return Ok(cages.remove(0));
    }
    let fault = match prim {
        Some(prim) if cages.is_empty() => Fault::new(format!("there is no {kind} {prim} in it")),
        Some(prim) => Fault::new(format!("there are {} of the path {prim}", cages.len())),
        None => Fault::new(format!("there are {} {kind}s in it", cages.len())),
    };
    let help = format!("name one of them by --prim: {names}");
    Err(fault.in_file(file).advise(help).into())
}
