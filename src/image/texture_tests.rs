use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::*;
use crate::image::border::{self, Kind};
use crate::image::{ChannelFormat, test_files, write_exr, write_png};

const REPEAT: [Wrap; 2] = [Wrap::Repeat; 2];

/// Writes floats (rows from the top) as an EXR file with channels of these names.
fn exr(path: &Path, width: u32, names: &str, format: ChannelFormat, pixels: &[f32]) {
    let part = test_files::part("", names, format, pixels);
    write_exr(path, &test_files::picture(width, part)).expect("written");
}

/// Grey 2 × 2 with rows 0, 1 and 2, 3.
fn two_by_two(wrap: Wrap) -> Texture {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    exr(&path, 2, "Y", ChannelFormat::Float, &[0.0, 1.0, 2.0, 3.0]);
    let source = ImageSource::File(path);
    Texture::load(&source, [wrap; 2], ColorSpace::Auto).expect("loaded")
}

fn load(path: &Path, color_space: ColorSpace) -> Result<Texture, Fault> {
    Texture::load(&ImageSource::File(path.into()), REPEAT, color_space)
}

fn close(a: Vec4, b: Vec4) -> bool {
    a.abs_diff_eq(b, 1e-5)
}

fn grey(v: f32) -> Vec4 {
    Vec4::new(v, v, v, 1.0)
}

#[test]
fn texel_centres_give_texels_and_t_goes_up() {
    for wrap in [Wrap::Black, Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
        let texture = two_by_two(wrap);
        for (x, y, value) in [(0, 0, 0.0), (1, 0, 1.0), (0, 1, 2.0), (1, 1, 3.0)] {
            let st = Vec2::new((x as f32 + 0.5) / 2.0, 1.0 - (y as f32 + 0.5) / 2.0);
            assert_eq!(texture.eval(st), grey(value), "{wrap:?}");
            assert_eq!(texture.texel(x, y), grey(value));
        }
        assert_eq!(texture.eval(Vec2::splat(0.5)), grey(1.5));
        assert_eq!((texture.size(), texture.memory()), ([2, 2], 16));
    }
}

#[test]
fn borders_are_wrapped() {
    let at = |wrap, s, t| two_by_two(wrap).eval(Vec2::new(s, t));
    // The lower left corner is texel 2; its row is 2, 3, its column 2, 0.
    assert_eq!(at(Wrap::Clamp, 0.0, 0.0), grey(2.0));
    assert_eq!(at(Wrap::Clamp, -7.0, 0.25), grey(2.0));
    assert_eq!(at(Wrap::Clamp, 1e30, -1e30), grey(3.0));
    assert_eq!(at(Wrap::Repeat, 0.0, 0.25), grey(2.5));
    assert_eq!(at(Wrap::Repeat, 5.25, -3.75), grey(2.0));
    assert_eq!(at(Wrap::Repeat, 0.0, 0.0), grey(1.5));
    assert_eq!(at(Wrap::Mirror, 0.0, 0.0), grey(2.0));
    assert_eq!(at(Wrap::Mirror, 1.25, 0.25), grey(3.0));
    assert_eq!(at(Wrap::Mirror, -1.25, 2.25), grey(3.0));
    assert_eq!(at(Wrap::Black, 0.0, 0.25), grey(2.0) * 0.5);
    assert_eq!(at(Wrap::Black, 1.5, 0.25), Vec4::ZERO);
    assert_eq!(at(Wrap::Black, -1e30, 0.25), Vec4::ZERO);
}

#[test]
fn no_coordinate_panics() {
    let odd = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        -1e-8,
        1.0 - f32::EPSILON / 2.0,
        16_777_217.0,
    ];
    for wrap in [Wrap::Black, Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
        let mut texture = two_by_two(wrap);
        for udim in [false, true] {
            texture.udim = udim;
            for s in odd {
                for t in odd {
                    assert!(texture.eval(Vec2::new(s, t)).is_finite());
                }
            }
        }
    }
}

#[test]
fn eight_bits_with_colour_are_srgb_unless_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.png");
    let linear = Vec4::new(0.214_041_14, 1.0, 0.0, 1.0);
    write_png(&path, 1, 1, &[linear]).expect("written");
    let texture = load(&path, ColorSpace::Auto).expect("loaded");
    let decoded = texture.eval(Vec2::ZERO);
    assert!(decoded.abs_diff_eq(linear, 2e-3), "{decoded}");
    assert_eq!(texture.memory(), 4);
    let raw = load(&path, ColorSpace::Raw)
        .expect("loaded")
        .eval(Vec2::ZERO);
    assert!(close(raw, Vec4::new(128.0 / 255.0, 1.0, 0.0, 1.0)));
    // Half floats are not, but may be told to be.
    let path = folder.path().join("a.exr");
    exr(&path, 1, "RGBA", ChannelFormat::Half, &[0.5, 1.0, 0.0, 0.5]);
    let texture = load(&path, ColorSpace::Auto).expect("loaded");
    assert_eq!(texture.eval(Vec2::ZERO), Vec4::new(0.5, 1.0, 0.0, 0.5));
    assert_eq!(texture.memory(), 8);
    let decoded = load(&path, ColorSpace::Srgb)
        .expect("loaded")
        .eval(Vec2::ZERO);
    assert!(decoded.abs_diff_eq(Vec4::new(0.214_041, 1.0, 0.0, 0.5), 1e-3));
}

#[test]
fn straight_alpha_stays_straight() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.png");
    write_png(&path, 1, 1, &[Vec4::new(0.2, 0.2, 0.0, 0.2)]).expect("written");
    let value = load(&path, ColorSpace::Auto)
        .expect("loaded")
        .eval(Vec2::ZERO);
    assert!(close(value, Vec4::new(1.0, 1.0, 0.0, 0.2)), "{value}");
}

#[test]
fn acescg_becomes_rec709() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let pixels = [1.0, 1.0, 1.0, 1.0, 0.0, 0.0];
    exr(&path, 2, "RGB", ChannelFormat::Float, &pixels);
    let texture = load(&path, ColorSpace::AcesCg).expect("loaded");
    assert!(close(texture.texel(0, 0), Vec4::ONE));
    let red = Vec4::new(1.705_051, -0.130_256, -0.024_003, 1.0);
    assert!(close(texture.texel(1, 0), red));
}

#[test]
fn depth_is_not_alpha_and_odd_numbers_are_tamed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    let pixels = [f32::NAN, f32::INFINITY, 0.5, 9.0];
    exr(&path, 1, "RGBZ", ChannelFormat::Half, &pixels);
    let texture = load(&path, ColorSpace::Auto).expect("loaded");
    assert_eq!(texture.texel(0, 0), Vec4::new(0.0, 65504.0, 0.5, 1.0));
    let constant = Texture::constant(Vec4::new(1.0, f32::NAN, 1.0, 1.0));
    let magenta = Vec4::new(1.0, 0.0, 1.0, 1.0);
    assert_eq!(constant.eval(Vec2::new(-3.0, 0.7)), magenta);
    assert_eq!(constant.eval(Vec2::NAN), magenta);
}

#[test]
fn udim_tiles_lie_side_by_side() {
    let folder = tempfile::tempdir().expect("a folder");
    for (number, value) in [(1001, 1.0), (1002, 2.0), (1011, 11.0)] {
        let path = folder.path().join(format!("a.{number}.exr"));
        exr(&path, 1, "Y", ChannelFormat::Half, &[value]);
    }
    for other in ["a.1003.exr.bak", "a.100.exr", "a.12345.exr", "b.1004.exr"] {
        fs::write(folder.path().join(other), "no image").expect("written");
    }
    let texture = load(&folder.path().join("a.<UDIM>.exr"), ColorSpace::Auto).expect("loaded");
    let at = |s, t| texture.eval(Vec2::new(s, t));
    assert_eq!(at(0.5, 0.5), grey(1.0));
    assert_eq!(at(1.01, 0.5), grey(2.0));
    assert_eq!(at(0.5, 1.99), grey(11.0));
    // The far border belongs to the tile if none begins there.
    assert_eq!(at(2.0, 1.0), grey(2.0));
    assert_eq!(at(1.0, 1.5), grey(11.0));
    for (s, t) in [(2.1, 0.5), (-0.1, 0.5), (1.5, 1.5), (0.5, -4.0), (1e9, 1e9)] {
        assert_eq!(at(s, t), Vec4::ZERO);
    }
    let fault = load(&folder.path().join("c.<UDIM>.exr"), ColorSpace::Auto).expect_err("none");
    assert!(fault.help.expect("help").contains("c.1001.exr"));
}

#[test]
fn images_come_from_bytes_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let (png, exr_path) = (folder.path().join("a.png"), folder.path().join("a.exr"));
    write_png(&png, 1, 1, &[Vec4::ONE]).expect("written");
    exr(&exr_path, 1, "Y", ChannelFormat::Half, &[2.0]);
    let bytes = |path| Arc::<[u8]>::from(fs::read(path).expect("readable"));
    let load = |tiles| {
        let package = PathBuf::from("scene.usdz");
        let source = ImageSource::Packed { package, tiles };
        Texture::load(&source, REPEAT, ColorSpace::Auto)
    };
    let one = load(vec![(0, "0/a.png".into(), bytes(&png))]).expect("loaded");
    assert_eq!(one.eval(Vec2::splat(7.5)), Vec4::ONE);
    let udim = load(vec![
        (1002, "0/a.1002.exr".into(), bytes(&exr_path)),
        (1001, "0/a.1001.png".into(), bytes(&png)),
    ])
    .expect("loaded");
    assert_eq!(udim.eval(Vec2::splat(0.5)), Vec4::ONE);
    assert_eq!(udim.eval(Vec2::new(1.5, 0.5)), grey(2.0));
    assert!(load(Vec::new()).is_err());
    let cut = bytes(&exr_path)[..40].into();
    let fault = load(vec![(0, "0/a.exr".into(), cut)]).expect_err("cut off");
    assert_eq!(fault.file, Some("scene.usdz[0/a.exr]".into()));
}

#[test]
fn what_is_no_image_is_a_fault_with_advice() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = folder.path().join("missing.png");
    let text = folder.path().join("text.png");
    fs::write(&text, "this is no picture").expect("written");
    let unknown = folder.path().join("a.unknown");
    fs::write(&unknown, [0_u8; 64]).expect("written");
    let empty = folder.path().join("empty.exr");
    fs::write(&empty, []).expect("written");
    for path in [
        &missing,
        &text,
        &unknown,
        &empty,
        &folder.path().to_path_buf(),
    ] {
        let fault = load(path, ColorSpace::Auto).expect_err("no image");
        assert_eq!(fault.file.as_ref(), Some(path));
        assert!(fault.help.is_some_and(|help| !help.is_empty()));
    }
}

#[test]
fn every_truncation_is_a_fault() {
    let folder = tempfile::tempdir().expect("a folder");
    // Noise, so that nothing packs well and each part of the file matters.
    let mut state = 1_u32;
    let noise: Vec<f32> = (0..64 * 64 * 3)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        })
        .collect();
    let (png, exr_path) = (folder.path().join("a.png"), folder.path().join("a.exr"));
    exr(&exr_path, 64, "RGB", ChannelFormat::Half, &noise);
    let rgba: Vec<Vec4> = noise
        .chunks_exact(3)
        .map(|c| Vec4::new(c[0], c[1], c[2], 1.0))
        .collect();
    write_png(&png, 64, 64, &rgba).expect("written");
    for path in [png, exr_path] {
        let bytes = fs::read(&path).expect("readable");
        for tenth in 0..10 {
            fs::write(&path, &bytes[..bytes.len() * tenth / 10]).expect("written");
            let fault = load(&path, ColorSpace::Auto).expect_err("cut off");
            assert_eq!(fault.file, Some(path.clone()));
        }
    }
}

#[test]
fn too_many_texels_are_refused_before_they_are_allocated() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    exr(&path, 2, "RGB", ChannelFormat::Float, &[0.0; 12]);
    let mut input = test_files::open(&path);
    let refusal = input
        .read([0, 0], 3, border::Format::Float, 47)
        .expect_err("too large");
    assert_eq!(refusal.kind, Kind::TooLarge);
    assert!(input.read([0, 0], 3, border::Format::Float, 48).is_ok());
    assert_eq!(
        input
            .read([0, 0], 4, border::Format::Float, 1 << 20)
            .expect_err("three channels")
            .kind,
        Kind::Misuse
    );
}
