use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use super::*;
use crate::image::{
    ChannelFormat, ColorSpace, ImageSource, Wrap, test_files, write_exr, write_png,
};
use crate::math::Vec3;

/// Writes floats (rows from the top) as an EXR file with channels of these names.
fn exr(path: &Path, width: u32, names: &str, pixels: &[f32]) {
    let part = test_files::part("", names, ChannelFormat::Float, pixels);
    write_exr(path, &test_files::picture(width, part)).expect("written");
}

fn load(path: &Path, wrap: Wrap) -> Texture {
    let source = ImageSource::File(path.into());
    Texture::load_levels(&source, [wrap; 2], ColorSpace::Auto).expect("loaded")
}

/// Numbers in 0..1 without any order.
fn noise(count: usize) -> Vec<f32> {
    let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let states = std::iter::successors(Some(1_u32), next);
    (states
        .skip(1)
        .map(|state| (state >> 8) as f32 / 16_777_216.0))
    .take(count)
    .collect()
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len() as f32;
    values.sum::<f32>() / count
}

#[test]
fn every_level_has_the_images_mean() {
    let folder = tempfile::tempdir().expect("a folder");
    for [width, height] in [[64, 64], [37, 13], [1, 9], [5, 1], [255, 3]] {
        let path = folder.path().join("a.exr");
        let pixels = noise((width * height) as usize);
        exr(&path, width, "Y", &pixels);
        let texture = load(&path, Wrap::Repeat);
        let wanted = mean(pixels.iter().copied());
        let tile = &texture.tiles[0];
        let mut size = [width, height];
        for level in &tile.smaller {
            size = size.map(|n| (n / 2).max(1));
            assert_eq!(level.size, size);
            let Pixels::Float(pixels) = &level.pixels else {
                panic!("a file of floats");
            };
            let off = mean(pixels.iter().copied()) - wanted;
            assert!(off.abs() < 1e-5, "{width} x {height}: {off} at {size:?}");
        }
        assert_eq!(size, [1, 1]);
        assert!(texture.memory() < (width * height) as usize * 4 * 2);
    }
}

#[test]
fn a_checkerboard_of_bytes_is_half_as_bright_from_afar() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.png");
    let squares = (0..64 * 64).map(|i| Vec3::splat(((i + i / 64) % 2) as f32).extend(1.0));
    write_png(&path, 64, 64, &squares.collect::<Vec<_>>()).expect("written");
    let texture = load(&path, Wrap::Repeat);
    for texels in [2.0, 3.0, 8.0, 50.0, 1e4] {
        let area = Area([Vec2::new(texels, 0.0) / 64.0, Vec2::new(0.0, texels) / 64.0]);
        for st in [Vec2::splat(0.1), Vec2::new(0.77, -3.2)] {
            let value = texture.filtered(st, &area);
            // The nearest byte to 0.5 stands for 0.5029.
            assert!(
                value.abs_diff_eq(Vec4::new(0.503, 0.503, 0.503, 1.0), 1e-3),
                "{value}"
            );
        }
    }
    // Nothing to cover: the texel itself.
    let at = Vec2::splat(0.5 / 64.0);
    for area in [
        Area::POINT,
        Area([Vec2::splat(1e-3); 2]),
        Area([Vec2::NAN; 2]),
    ] {
        assert_eq!(texture.filtered(at, &area), texture.eval(at));
    }
}

/// Stripes along t: from the side they are seen, and across they are not.
#[test]
fn long_areas_blur_along_themselves_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let stripes: Vec<f32> = (0..64 * 64).map(|i| (i / 4 % 2) as f32).collect();
    exr(&path, 64, "Y", &stripes);
    let texture = load(&path, Wrap::Repeat);
    let texel = Vec2::splat(1.0 / 64.0);
    let middles = [2.0, 6.0].map(|x| Vec2::new(x, 20.0) * texel);
    let along = Area([Vec2::new(1.0, 0.0) * texel, Vec2::new(0.0, 16.0) * texel]);
    let across = Area([Vec2::new(16.0, 0.0) * texel, Vec2::new(0.0, 1.0) * texel]);
    let [dark, bright] = middles.map(|st| texture.filtered(st, &along).x);
    assert!(dark < 0.01 && bright > 0.99, "{dark} {bright}");
    let [dark, bright] = middles.map(|st| texture.filtered(st, &across).x);
    assert!(
        (dark - 0.5).abs() < 0.07 && (bright - 0.5).abs() < 0.07,
        "{dark} {bright}"
    );
}

#[test]
fn strips_cover_their_ellipse() {
    let round = Strip::over(Vec2::new(0.0, 8.0), Vec2::new(-8.0, 0.0));
    assert_eq!((round.probes, round.level), (1, 3.0));
    // Conjugate diameters of a round ellipse need not be the coordinates' axes.
    let turned = Strip::over(Vec2::splat(8.0), Vec2::new(8.0, -8.0));
    assert!(
        turned.probes == 1 && (turned.level - 3.5).abs() < 1e-3,
        "{turned:?}"
    );
    let long = Strip::over(Vec2::new(3.0, 4.0) * 8.0, Vec2::new(-4.0, 3.0));
    assert!(
        long.probes == 8 && (long.level - 5_f32.log2()).abs() < 1e-3,
        "{long:?}"
    );
    assert!(
        (long.along.abs() - Vec2::new(24.0, 32.0)).length() < 1e-2,
        "{long:?}"
    );
    // Longer than the most lookups reach: they grow, and leave no gaps.
    let longest = Strip::over(Vec2::new(1024.0, 0.0), Vec2::new(0.0, 1.0));
    assert_eq!((longest.probes, longest.level), (16, 6.0));
    // Narrower than a texel.
    let narrow = Strip::over(Vec2::new(0.0, 4.0), Vec2::new(0.01, 0.0));
    assert_eq!((narrow.probes, narrow.level), (4, 0.0));
}

#[test]
fn tiles_of_a_set_keep_to_themselves() {
    let folder = tempfile::tempdir().expect("a folder");
    for (number, value) in [(1001, 1.0), (1002, 2.0)] {
        let path = folder.path().join(format!("a.{number}.exr"));
        exr(&path, 8, "Y", &[value; 64]);
    }
    let texture = load(&folder.path().join("a.<UDIM>.exr"), Wrap::Repeat);
    for width in [0.1, 1.0, 10.0] {
        let area = Area([Vec2::new(width, 0.0), Vec2::new(0.0, width)]);
        for (s, value) in [(0.99, 1.0), (1.01, 2.0)] {
            assert_eq!(texture.filtered(Vec2::new(s, 0.5), &area).x, value);
        }
    }
}

/// `maketx` writes a tiled texture whose levels have nothing to do with one another.
#[test]
fn levels_are_those_of_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = folder.path().join("a.tx");
    let mut maketx = Command::new("maketx");
    for level in 1..7 {
        let path = folder.path().join(format!("{level}.exr"));
        let size = 64 >> level;
        exr(
            &path,
            size,
            "RGB",
            &vec![level as f32; (size * size * 3) as usize],
        );
        maketx.arg("--mipimage").arg(path);
    }
    let full = folder.path().join("0.exr");
    exr(&full, 64, "RGB", &[0.0; 64 * 64 * 3]);
    match maketx.arg(full).arg("-o").arg(&made).output() {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            println!("SKIPPED: maketx is not installed");
            return;
        }
        output => assert!(output.expect("it runs").status.success()),
    }
    let bytes = Arc::from(std::fs::read(&made).expect("readable"));
    let packed = ImageSource::Packed {
        package: "scene.usdz".into(),
        tiles: vec![(0, "a.tx".into(), bytes)],
    };
    for source in [ImageSource::File(made), packed] {
        let load = |load: fn(_, _, _) -> _| load(&source, [Wrap::Mirror; 2], ColorSpace::Auto);
        let texture: Texture = load(Texture::load_levels).expect("loaded");
        for tenths in 0..90 {
            let level = tenths as f32 / 10.0;
            let width = level.exp2() / 64.0;
            let area = Area([Vec2::new(width, 0.0), Vec2::new(0.0, width)]);
            let seen = texture.filtered(Vec2::new(0.3, 0.8), &area).x;
            let wanted = if level < 0.5 { 0.0 } else { level.min(6.0) };
            let off = (seen - wanted).abs();
            assert!(
                off < 0.5 && (off < 1e-3 || level < 0.5),
                "{seen} at {level}"
            );
        }
        // Without levels they are not read.
        let plain: Texture = load(Texture::load).expect("loaded");
        assert_eq!(
            (plain.memory(), plain.tiles[0].smaller.len()),
            (64 * 64 * 3 * 4, 0)
        );
    }
}
