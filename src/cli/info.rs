//! `relievo info`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use rayon::prelude::*;
use relievo::Result;
use relievo::image::Texture;
use relievo::mesh::{Crease, Scheme};
use relievo::render::estimate;
use relievo::scene::{self, Description, LoadOptions, MissingLayers};

/// Tell what is in a scene: prims, faces, creases, textures, and what memory a picture of it will take.
///
/// Textures are read for their size. Layers that are missing are told and do not stop it.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    /// Frame to look at [default: the file's start frame]
    #[arg(long, allow_negative_numbers = true)]
    frame: Option<f64>,
    /// One line for every mesh, light, material and texture.
    #[arg(long, short)]
    long: bool,
}

impl Info {
    pub(crate) fn run(self) -> Result<()> {
        let options = LoadOptions {
            frame: self.frame,
            missing_layers: MissingLayers::Skip,
            ..LoadOptions::default()
        };
        let scene = scene::load(&self.scene, &options)?;
        let mut out = format!("{}\n", self.scene.display());
        // Writing to a string cannot fail.
        let _ = self.tell(&scene, &mut out);
        super::print(out.as_bytes())
    }

    fn tell(&self, scene: &Description, out: &mut String) -> std::fmt::Result {
        tell_stage(scene, out)?;
        tell_meshes(scene, out)?;
        writeln!(out, "  lights      {}", scene.lights.len())?;
        writeln!(out, "  materials   {}", scene.materials.len())?;
        let textures: Vec<_> = scene
            .textures
            .par_iter()
            .enumerate()
            .map(|(i, t)| {
                let (wrap, levels) = ([t.wrap_s, t.wrap_t], scene.is_shaded_by(i));
                Texture::load_by_coordinates(&t.image, wrap, t.color_space, levels)
            })
            .collect();
        let missing = textures.iter().filter(|t| t.is_err()).count();
        let bytes: usize = textures.iter().flatten().map(Texture::memory).sum();
        writeln!(
            out,
            "  textures    {}, {missing} of them cannot be read",
            textures.len()
        )?;
        match estimate(scene) {
            Ok(e) => {
                let all = e.embree + e.control_meshes + e.film + bytes as u64;
                let [width, height] = e.resolution;
                writeln!(
                    out,
                    "  memory      about {} at {width} x {height} pixels",
                    megabytes(all)
                )?;
                writeln!(
                    out,
                    "    geometry      about {} for {} micro-triangles",
                    megabytes(e.embree),
                    e.micro_triangles
                )?;
                writeln!(out, "    meshes        {}", megabytes(e.control_meshes))?;
                writeln!(out, "    textures      {}", megabytes(bytes as u64))?;
                writeln!(out, "    film          {}", megabytes(e.film))?;
            }
            Err(error) => writeln!(out, "  memory      {error}")?,
        }
        if self.long {
            tell_each(scene, &textures, out)?;
        }
        for warning in scene.warnings.iter() {
            let times = match warning.count {
                1 => String::new(),
                n => format!(" ({n} times)"),
            };
            writeln!(out, "  warning     {}{times}", warning.message)?;
        }
        Ok(())
    }
}

fn tell_stage(scene: &Description, out: &mut String) -> std::fmt::Result {
    let up = if scene.up == relievo::math::Vec3::Z {
        "Z"
    } else {
        "Y"
    };
    writeln!(out, "  files       {}", scene.files.len())?;
    writeln!(out, "  up          {up}")?;
    writeln!(out, "  units       {} m", scene.meters_per_unit)?;
    if let Some(frame) = scene.frame {
        let rate = scene.frames_per_second;
        writeln!(out, "  frame       {frame} of {rate} a second")?;
    }
    for camera in &scene.cameras {
        let [open, close] = camera.shutter;
        writeln!(
            out,
            "  camera      {}  {} mm, f/{}, shutter {open}..{close}",
            camera.path, camera.focal_length, camera.f_stop,
        )?;
    }
    Ok(())
}

fn tell_meshes(scene: &Description, out: &mut String) -> std::fmt::Result {
    let meshes = || scene.shapes.iter().filter_map(|s| s.geometry.mesh());
    let faces: usize = scene.shapes.iter().map(|s| s.geometry.face_count()).sum();
    writeln!(
        out,
        "  surfaces    {} in {} places, {faces} faces",
        scene.shapes.len(),
        scene.placements.len()
    )?;
    for (scheme, name) in [
        (Scheme::CatmullClark, "Catmull-Clark"),
        (Scheme::Loop, "Loop"),
        (Scheme::Bilinear, "bilinear"),
        (Scheme::None, "polygons"),
    ] {
        let count = meshes().filter(|m| m.scheme == scheme).count();
        if count > 0 {
            writeln!(out, "    {name:13} {count}")?;
        }
    }
    let patches = scene.shapes.len() - meshes().count();
    if patches > 0 {
        writeln!(out, "    {:13} {patches}", "NURBS patches")?;
    }
    let creases = meshes().map(|m| m.creases.len()).sum::<usize>();
    let infinite = meshes()
        .flat_map(|m| &m.creases)
        .filter(|c| c.sharpness >= Crease::INFINITE)
        .count();
    let corners = meshes().map(|m| m.corners.len()).sum::<usize>();
    let holes = meshes().map(|m| m.holes.len()).sum::<usize>();
    writeln!(
        out,
        "    creases       {creases} edges, {infinite} of them infinitely sharp"
    )?;
    writeln!(out, "    corners       {corners}")?;
    writeln!(out, "    holes         {holes}")
}

/// A line for each thing.
fn tell_each(
    scene: &Description,
    textures: &[Result<Texture, relievo::error::Fault>],
    out: &mut String,
) -> std::fmt::Result {
    for shape in &scene.shapes {
        let mut names: Vec<&str> = shape
            .geometry
            .primvars()
            .iter()
            .map(|p| p.name.as_str())
            .collect();
        names.sort_unstable();
        let faces = shape.geometry.face_count();
        let primvars = match names.as_slice() {
            [] => "no primvars".to_owned(),
            names => format!("primvars {}", names.join(", ")),
        };
        writeln!(
            out,
            "  mesh        {}  {faces} faces, {primvars}",
            shape.path
        )?;
    }
    for light in &scene.lights {
        writeln!(out, "  light       {}  {:?}", light.path, light.kind)?;
    }
    for material in &scene.materials {
        writeln!(out, "  material    {}", material.path)?;
    }
    for (source, texture) in scene.textures.iter().zip(textures) {
        match texture {
            Ok(texture) => {
                let [width, height] = texture.size();
                let bytes = megabytes(texture.memory() as u64);
                writeln!(
                    out,
                    "  texture     {}  {width} x {height}, {bytes}",
                    source.image
                )?;
            }
            Err(fault) => writeln!(out, "  texture     {fault}, for {}", source.prim)?,
        }
    }
    Ok(())
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}
