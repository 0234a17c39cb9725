//! Makes what the scenes need and the repository does not hold: maps from a seed, the creature's cage, the gourd's
//! Ptex files, and these as images; fur and mail: surfaces and the tiles that cover them.
//!
//! `make scenes` runs it: `make_scenes relief OUT.exr`, `make_scenes scales OUT.exr`, `make_scenes tortoise OUT.usda`,
//! `make_scenes gourd SCENE.usda colours|heights OUT.ptx`, `make_scenes unwrapped SCENE.usda IN.ptx TEXELS MARGIN OUT.exr`,
//! `make_scenes fur body|tile OUT.usda`, `make_scenes mail cloth|tile OUT.usda`.
//! The same arguments give the same bytes.

mod fur;
mod gourd;
mod mail;
mod maps;
mod noise;
mod tortoise;
mod unwrapped;
mod usd;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use relievo::Result;
use relievo::image::{Channel, ChannelFormat, Compression, Part, Picture, write_exr};

/// All randomness of the scenes comes from here.
const SEED: u32 = 1978;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let result = match words[..] {
        ["relief", path] => write_map(path, 4096, &maps::Relief::new(SEED)),
        ["scales", path] => write_map(path, 1024, &maps::Scales::new(SEED)),
        ["gourd", scene, what @ ("colours" | "heights"), path] => gourd::write(scene, what, path),
        ["unwrapped", scene, ptex, size, margin, path] => match (size.parse(), margin.parse()) {
            (Ok(size), Ok(margin)) => unwrapped::write(scene, ptex, [size, margin], path),
            _ => return fail(&format!("{size} and {margin} are no numbers of texels"), 2),
        },
        ["tortoise", path] => write_text(path, &tortoise::usda()),
        ["fur", "body", path] => write_text(path, &fur::body()),
        ["fur", "tile", path] => write_text(path, &fur::tile()),
        ["mail", "cloth", path] => write_text(path, &mail::cloth()),
        ["mail", "tile", path] => write_text(path, &mail::tile()),
        _ => {
            let usage = "usage: make_scenes relief|scales OUT.exr, make_scenes tortoise OUT.usda, \
                         make_scenes gourd SCENE.usda colours|heights OUT.ptx, \
                         make_scenes fur body|tile OUT.usda, make_scenes mail cloth|tile OUT.usda, \
                         or make_scenes unwrapped SCENE.usda IN.ptx TEXELS MARGIN OUT.exr";
            return fail(usage, 2);
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error.to_string(), error.exit_code()),
    }
}

#[expect(clippy::print_stderr, reason = "a program of its own")]
fn fail(message: &str, code: u8) -> ExitCode {
    eprintln!("error: {message}");
    ExitCode::from(code)
}

/// Heights over the unit square.
trait HeightMap: Sync {
    /// The height at (s, t), about 0 to 1.
    fn height(&self, s: f32, t: f32) -> f32;
}

/// Samples a map at the middles of `size` x `size` pixels, row 0 (t = 1) on top.
fn write_map(path: &str, size: u32, map: &dyn HeightMap) -> Result<()> {
    let middle = |i: u32| (i as f32 + 0.5) / size as f32;
    let row = |y: u32| (0..size).map(move |x| map.height(middle(x), 1.0 - middle(y)));
    // Steps of 1 / 65536 are finer than any eye, and halve the file.
    let rounded = |h: f32| (h * 65536.0).round() / 65536.0;
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u32);
    let band = size.div_ceil(threads);
    let pixels: Vec<f32> = std::thread::scope(|scope| {
        let bands: Vec<_> = (0..threads)
            .map(|i| {
                let rows = (i * band).min(size)..((i + 1) * band).min(size);
                scope.spawn(move || rows.flat_map(row).map(rounded).collect::<Vec<_>>())
            })
            .collect();
        let join = |band: std::thread::ScopedJoinHandle<'_, Vec<f32>>| {
            band.join().expect("heights are computed without panics")
        };
        bands.into_iter().flat_map(join).collect()
    });
    let picture = Picture {
        width: size,
        height: size,
        display_window: (size, size, 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: vec![Channel {
                name: "R".into(),
                format: ChannelFormat::Float,
            }],
            pixels,
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zips,
    };
    write_exr(&with_folder(Path::new(path))?, &picture)
}

fn write_text(path: &str, text: &str) -> Result<()> {
    relievo::image::write_whole(&with_folder(Path::new(path))?, |path| {
        std::fs::write(path, text).map_err(|e| relievo::Error::failed(e.to_string()))
    })
}

/// Makes the file's folder.
fn with_folder(path: &Path) -> Result<PathBuf> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)
            .map_err(|e| relievo::Error::failed(format!("{}: {e}", folder.display())))?;
    }
    Ok(path.to_owned())
}
