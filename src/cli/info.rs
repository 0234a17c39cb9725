//! `relievo info`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use rayon::prelude::*;
use relievo::Result;
use relievo::image::Texture;
use relievo::memory::{Budget, amount};
use relievo::mesh::{Crease, Scheme};
use relievo::render::{Estimate, estimate, picture_size};
use relievo::scene::{self, Description, LoadOptions, MissingLayers};
use relievo::world::{BuildOptions, Method};

use super::machine::bytes;
use super::staging::Staging;

/// Tell what is in a scene: prims, faces, creases, textures, and what memory a picture of it will take.
///
/// Textures are read for their size. Layers that are missing are told and do not stop it. How many micro-triangles surfaces
/// are diced into is known exactly; bytes by each method follow from that, and are rather too large: by a tenth for
/// Embree's, up to twice for ours.
#[derive(Debug, Args)]
pub(crate) struct Info {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    /// One line for every mesh, light, material and texture, and all objects' memory.
    #[arg(long, short)]
    long: bool,
    /// What `--method auto` may take, for what it chooses: 800M, 12G [default: half of the machine's memory]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    memory_budget: Option<usize>,
    #[command(flatten)]
    staging: Staging,
}

impl Info {
    pub(crate) fn run(self) -> Result<()> {
        self.staging.check()?;
        let options = LoadOptions {
            missing_layers: MissingLayers::Skip,
            ..self.staging.load()
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
        writeln!(
            out,
            "  textures    {}, {missing} of them cannot be read",
            textures.len()
        )?;
        match self.estimate(scene) {
            Ok(estimate) => self.tell_memory(&estimate, out)?,
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

impl Info {
    fn estimate(&self, scene: &Description) -> Result<Estimate> {
        let staging = &self.staging;
        let size = staging
            .resolution()
            .unwrap_or_else(|| picture_size(scene))
            .map(|n| ((n as f32 * staging.scale()).round() as u32).max(1));
        let options = BuildOptions {
            dicing: staging.dicing(),
            bounce_dicing: staging.bounce_dicing(),
            max_error: staging.max_error.unwrap_or_default(),
            // What cannot be read was told.
            missing_textures: Some(relievo::math::Vec4::ONE),
            ..BuildOptions::default()
        };
        let budget = Budget::from(self.memory_budget);
        estimate(scene, (staging.camera.as_deref(), size), &options, &budget)
    }

    fn tell_memory(&self, estimate: &Estimate, out: &mut String) -> std::fmt::Result {
        let [width, height] = estimate.resolution;
        let all = &estimate.foreseen;
        let beside = estimate.control_meshes + all.surfaces + all.textures + estimate.film;
        writeln!(
            out,
            "  memory      at {width} x {height} pixels, beside the program"
        )?;
        for (name, bytes) in [
            ("meshes", estimate.control_meshes),
            ("surfaces", all.surfaces),
            ("textures", all.textures),
            ("film", estimate.film),
        ] {
            writeln!(out, "    {name:20} {:>10}", amount(bytes as f64))?;
        }
        let triangles: u64 = all.objects.iter().filter_map(|o| o.micro_triangles).sum();
        writeln!(
            out,
            "  by method   at most, all of this included, for {triangles} micro-triangles"
        )?;
        for (method, bytes) in Method::ALL.iter().zip(&all.together) {
            let note = if *method == Method::Cache {
                " and --cache-size"
            } else {
                ""
            };
            let bytes = amount((bytes + beside) as f64);
            writeln!(out, "    {:20} {bytes:>10}{note}", method.name())?;
        }
        let bytes = amount((all.chosen + all.cache + beside) as f64);
        writeln!(out, "    {:20} {bytes:>10}", "auto")?;
        // The largest ones, unless all are asked for.
        let mut objects: Vec<_> = all.objects.iter().collect();
        objects.sort_by_key(|object| std::cmp::Reverse(object.bytes[0]));
        let shown = if self.long {
            objects.len()
        } else {
            objects.len().min(5)
        };
        for object in &objects[..shown] {
            match object.micro_triangles {
                None => writeln!(
                    out,
                    "  object      {}  polygons, {}",
                    object.path,
                    amount(object.bytes[0] as f64)
                )?,
                Some(count) => {
                    writeln!(
                        out,
                        "  object      {}  {count} micro-triangles, auto: {}",
                        object.path,
                        object.chosen.name()
                    )?;
                    let by = |(method, bytes): (&Method, &u64)| {
                        format!("{} {}", method.name(), amount(*bytes as f64))
                    };
                    let methods: Vec<String> =
                        Method::ALL.iter().zip(&object.bytes).map(by).collect();
                    writeln!(out, "    {}", methods.join(", "))?;
                }
            }
        }
        if shown < objects.len() {
            writeln!(
                out,
                "  and {} smaller objects: --long",
                objects.len() - shown
            )?;
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
                let bytes = amount(texture.memory() as f64);
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
