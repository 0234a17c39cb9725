//! Renders small scenes for the tests and reads the pictures back.

pub mod program;
pub mod sound;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use relievo::image::{ColorSpace, ImageSource, Texture, Wrap};
use relievo::integrate::PathOptions;
use relievo::math::Vec3;
use relievo::memory::Budget;
use relievo::render::{Output, PixelType, Progress, ProgressStyle, RenderOptions, render};
use relievo::scene::LoadOptions;
use relievo::shade::filter::{Filter, FilterKind};
use relievo::stats::Stats;
use relievo::world::BuildOptions;

/// Options that the tests share: a box filter, float pixels, no progress.
pub fn options(scene: &Path, picture: &Path) -> RenderOptions {
    RenderOptions {
        scene: scene.to_owned(),
        output: Output {
            picture: picture.to_owned(),
            pixel_type: PixelType::Float,
            ..Output::default()
        },
        camera: None,
        resolution: Some([32, 32]),
        scale: 1.0,
        spp: 16,
        path: PathOptions::default(),
        filter: Filter::new(FilterKind::Box),
        seed: 0,
        threads: 0,
        memory_budget: Budget::default(),
        load: LoadOptions::default(),
        depth_of_field: true,
        build: BuildOptions {
            default_dome: 1.0,
            ..BuildOptions::default()
        },
        built: None,
    }
}

/// Renders, or fails the test.
pub fn run(options: &RenderOptions) -> Stats {
    match render(
        options,
        &Progress::new(ProgressStyle::Quiet),
        &AtomicBool::new(false),
    ) {
        Ok(stats) => stats,
        Err(error) => panic!("{}: {error}", options.scene.display()),
    }
}

/// A picture's pixels, row by row from the top.
pub fn read(path: &Path) -> (u32, u32, Vec<Vec3>) {
    let texture = Texture::load(
        &ImageSource::File(path.to_owned()),
        [Wrap::Clamp; 2],
        ColorSpace::Raw,
    )
    .unwrap_or_else(|fault| panic!("{fault}"));
    let [width, height] = texture.size();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    (
        width,
        height,
        pixels
            .map(|(x, y)| texture.texel(x, y).truncate())
            .collect(),
    )
}

/// The mean of all pixels.
pub fn mean(pixels: &[Vec3]) -> Vec3 {
    let sum = pixels
        .iter()
        .fold(glam::DVec3::ZERO, |sum, p| sum + p.as_dvec3());
    (sum / pixels.len() as f64).as_vec3()
}

/// A scene of one test, written into `folder`.
pub fn write_scene(folder: &Path, name: &str, body: &str) -> PathBuf {
    let path = folder.join(name);
    let text = format!("#usda 1.0\n(\n    upAxis = \"Y\"\n    metersPerUnit = 1\n)\n{body}");
    std::fs::write(&path, text).expect("the test's folder takes files");
    path
}

/// A cube of half-width `h` whose faces look outward, or inward; with or without its top.
pub fn cube(name: &str, h: f32, inward: bool, open: bool, attributes: &str) -> String {
    let orientation = if inward { "leftHanded" } else { "rightHanded" };
    let (count, top) = if open {
        ("", "")
    } else {
        (", 4", ", 4, 7, 6, 5")
    };
    format!(
        r#"
def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    uniform token orientation = "{orientation}"
    int[] faceVertexCounts = [4, 4, 4, 4, 4{count}]
    int[] faceVertexIndices = [0, 1, 2, 3, 0, 4, 5, 1, 1, 5, 6, 2, 2, 6, 7, 3, 3, 7, 4, 0{top}]
    point3f[] points = [(-{h}, -{h}, -{h}), ({h}, -{h}, -{h}), ({h}, -{h}, {h}), (-{h}, -{h}, {h}),
                        (-{h}, {h}, -{h}), ({h}, {h}, -{h}), ({h}, {h}, {h}), (-{h}, {h}, {h})]
    {attributes}
}}
"#
    )
}

/// A ball of flat quads, `rows` from pole to pole and twice as many around, whose faces look outward or inward;
/// with or without the ball's own normals in its vertices.
pub fn ball(radius: f64, rows: usize, inward: bool, normals: bool, attributes: &str) -> String {
    use std::f64::consts::PI;
    let columns = 2 * rows;
    let orientation = if inward { "leftHanded" } else { "rightHanded" };
    let (mut counts, mut indices, mut directions) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=rows {
        let (sin, cos) = (PI * row as f64 / rows as f64).sin_cos();
        for column in 0..columns {
            let (s, c) = (2.0 * PI * column as f64 / columns as f64).sin_cos();
            directions.push([sin * c, cos, sin * s]);
            if row < rows {
                let (next, here) = ((column + 1) % columns, row * columns);
                counts.push(4);
                indices.extend([column, next, columns + next, columns + column].map(|i| here + i));
            }
        }
    }
    let list = |scale: f64| -> Vec<(f64, f64, f64)> {
        let scaled = directions.iter().map(|d| d.map(|x| scale * x));
        scaled.map(|[x, y, z]| (x, y, z)).collect()
    };
    let (points, directions) = (list(radius), list(if inward { -1.0 } else { 1.0 }));
    let normals = if normals {
        format!("normal3f[] normals = {directions:?} (interpolation = \"vertex\")\n")
    } else {
        String::new()
    };
    format!(
        "def Mesh \"Ball\" {{\nuniform token orientation = \"{orientation}\"\n\
         uniform token subdivisionScheme = \"none\"\n\
         int[] faceVertexCounts = {counts:?}\nint[] faceVertexIndices = {indices:?}\n\
         point3f[] points = {points:?}\n{normals}{attributes}\n}}\n"
    )
}

/// The folder of shared scenes and values; says so where it is missing.
pub fn shared(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RELIEVO_SHARED").map(PathBuf::from);
    if folder.is_none() {
        println!("SKIPPED {test}: RELIEVO_SHARED names no folder");
    }
    folder
}

/// How many times as much is asked of a test as usual: the environment's `RELIEVO_EFFORT`.
pub fn effort() -> u64 {
    let effort = std::env::var("RELIEVO_EFFORT").ok();
    effort.and_then(|effort| effort.parse().ok()).unwrap_or(1)
}
