//! `relievo info`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use relievo::Result;
use relievo::mesh::{Crease, Scheme};
use relievo::scene::{self, LoadOptions};

/// Tell what is in a scene.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    /// Frame to look at [default: the file's start frame]
    #[arg(long, allow_negative_numbers = true)]
    frame: Option<f64>,
    /// One line for every mesh, light and material.
    #[arg(long, short)]
    long: bool,
}

impl Info {
    #[expect(clippy::print_stdout, reason = "this command prints")]
    pub(crate) fn run(self) -> Result<()> {
        let options = LoadOptions {
            frame: self.frame,
            ..LoadOptions::default()
        };
        let scene = scene::load(&self.scene, &options)?;
        println!("{}", self.scene.display());
        println!("  files       {}", scene.files.len());
        println!(
            "  up          {}",
            if scene.up == relievo::math::Vec3::Z {
                "Z"
            } else {
                "Y"
            }
        );
        println!("  units       {} m", scene.meters_per_unit);
        if let Some(frame) = scene.frame {
            println!(
                "  frame       {frame} of {} a second",
                scene.frames_per_second
            );
        }
        for camera in &scene.cameras {
            println!(
                "  camera      {}  {} mm, f/{}, shutter {}..{}",
                camera.path,
                camera.focal_length,
                camera.f_stop,
                camera.shutter[0],
                camera.shutter[1]
            );
        }
        let meshes = || scene.shapes.iter().filter_map(|s| s.geometry.mesh());
        let faces: usize = scene.shapes.iter().map(|s| s.geometry.face_count()).sum();
        println!(
            "  surfaces    {} in {} places, {faces} faces",
            scene.shapes.len(),
            scene.placements.len()
        );
        for (scheme, name) in [
            (Scheme::CatmullClark, "Catmull-Clark"),
            (Scheme::Loop, "Loop"),
            (Scheme::Bilinear, "bilinear"),
            (Scheme::None, "polygons"),
        ] {
            let count = meshes().filter(|m| m.scheme == scheme).count();
            if count > 0 {
                println!("    {name:13} {count}");
            }
        }
        let patches = scene.shapes.len() - meshes().count();
        if patches > 0 {
            println!("    {:13} {patches}", "NURBS patches");
        }
        let creases = meshes().map(|m| m.creases.len()).sum::<usize>();
        let infinite = meshes()
            .flat_map(|m| &m.creases)
            .filter(|c| c.sharpness >= Crease::INFINITE)
            .count();
        println!("    creases       {creases} edges, {infinite} of them infinitely sharp");
        println!(
            "    corners       {}",
            meshes().map(|m| m.corners.len()).sum::<usize>()
        );
        println!(
            "    holes         {}",
            meshes().map(|m| m.holes.len()).sum::<usize>()
        );
        println!("  lights      {}", scene.lights.len());
        println!("  materials   {}", scene.materials.len());
        println!("  textures    {}", scene.textures.len());
        let bytes: usize = scene.shapes.iter().map(|s| s.geometry.memory()).sum();
        println!(
            "  memory      {:.1} MB of control points and faces",
            bytes as f64 / 1e6
        );
        if self.long {
            for shape in &scene.shapes {
                let names: BTreeSet<&str> = shape
                    .geometry
                    .primvars()
                    .iter()
                    .map(|p| p.name.as_str())
                    .collect();
                println!(
                    "  mesh        {}  {} faces, primvars {names:?}",
                    shape.path,
                    shape.geometry.face_count()
                );
            }
            for light in &scene.lights {
                println!("  light       {}  {:?}", light.path, light.kind);
            }
            for material in &scene.materials {
                println!("  material    {}", material.path);
            }
        }
        for warning in scene.warnings.iter() {
            println!(
                "  warning     {} ({} times)",
                warning.message, warning.count
            );
        }
        Ok(())
    }
}
