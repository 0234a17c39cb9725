use std::sync::atomic::{AtomicUsize, Ordering};

use std::sync::Arc;

use super::*;
use crate::math::{Area, Vec2, Vec4};
use crate::scene::{Channels, Transform2d};
use crate::shade::texture_map::Lookup;

/// Red is s, green is t; counts how often it is asked.
#[derive(Default)]
struct Ramp(AtomicUsize);

impl Lookup for Ramp {
    fn eval(&self, st: Vec2, _: &Area) -> Vec4 {
        self.0.fetch_add(1, Ordering::Relaxed);
        Vec4::new(st.x, st.y, 0.5, 1.0)
    }
}

struct At(Vec<(&'static str, Vec<f32>)>);

impl At {
    /// As the material reads them.
    fn read_by<'a>(&'a self, material: &'a Material) -> ReadBy<'a> {
        ReadBy(self, material)
    }
}

struct ReadBy<'a>(&'a At, &'a Material);

impl Primvars for ReadBy<'_> {
    fn get(&self, read: usize, out: &mut [f32]) -> bool {
        let Self(At(values), material) = self;
        let Read { name, width } = &material.reads()[read];
        assert_eq!(out.len(), *width);
        match values.iter().find(|(n, v)| n == name && v.len() >= *width) {
            Some((_, value)) => {
                out.copy_from_slice(&value[..*width]);
                true
            }
            None => false,
        }
    }
}

fn map(channels: Channels) -> TextureMap {
    TextureMap {
        texture: 0,
        primvar: "st".into(),
        transform: Transform2d::default(),
        channels,
        scale: Vec4::ONE,
        bias: Vec4::ZERO,
        fallback: Vec4::new(0.9, 0.8, 0.7, 0.6),
    }
}

fn material(surface: PreviewSurface, textures: &[Arc<dyn Lookup>]) -> Material {
    let path = "/Material".into();
    let lookups = Lookups {
        images: textures.to_vec(),
        ..Lookups::default()
    };
    Material::new(&scene::Material { path, surface }, &lookups)
}

#[test]
fn a_constant_material_asks_for_nothing() {
    let material = material(PreviewSurface::default(), &[]);
    assert!(material.constant.is_some() && material.needs().is_empty());
    let resolved = material.resolve(&NoPrimvars);
    assert_eq!(resolved.params, SurfaceParams::default());
    assert_eq!((resolved.opacity, resolved.normal), (1.0, None));
    assert!(!material.may_be_transparent() && !material.is_displaced() && !material.may_emit());
}

#[test]
fn inputs_that_share_an_image_look_once() {
    let ramp = Arc::new(Ramp::default());
    let surface = PreviewSurface {
        roughness: Input::Texture(map(Channels::R)),
        metallic: Input::Texture(map(Channels::G)),
        diffuse_color: Input::Texture(TextureMap {
            scale: Vec4::splat(2.0),
            bias: Vec4::splat(-0.5),
            ..map(Channels::Rgb)
        }),
        displacement: Input::Texture(TextureMap {
            primvar: "uv".into(),
            ..map(Channels::B)
        }),
        ..PreviewSurface::default()
    };
    let material = material(surface, &[ramp.clone() as Arc<dyn Lookup>]);
    let at = At(vec![("st", vec![0.25, 0.75])]);
    let resolved = material.resolve(&at.read_by(&material));
    assert_eq!(ramp.0.load(Ordering::Relaxed), 1);
    assert_eq!(
        (resolved.params.roughness, resolved.params.metallic),
        (0.25, 0.75)
    );
    // Scaled, biased, and not below 0.
    assert_eq!(resolved.params.diffuse_color, Vec3::new(0.0, 1.0, 0.5));
    assert_eq!(material.needs(), ["st"]);
    assert_eq!(material.displacement_needs(), ["uv"]);
    assert!(material.is_displaced());
    // No such primvar: the fallback.
    assert_eq!(material.displacement(&at.read_by(&material)), 0.7);
    assert_eq!(
        material.displacement(&At(vec![("uv", vec![0.0, 0.0])]).read_by(&material)),
        0.5
    );

    let clay = Material::clay(Vec3::splat(0.5), Some(&material));
    assert_eq!(
        clay.displacement(&At(vec![("uv", vec![0.0, 0.0])]).read_by(&clay)),
        0.5
    );
    assert_eq!(
        clay.resolve(&at.read_by(&clay)).params,
        SurfaceParams::lambert(Vec3::splat(0.5))
    );
    assert!(clay.constant.is_some() && clay.displacement_needs() == ["uv"]);
}

#[test]
fn a_missing_texture_gives_its_fallback() {
    let surface = PreviewSurface {
        diffuse_color: Input::Texture(map(Channels::Rgb)),
        ..PreviewSurface::default()
    };
    let material = material(surface, &[]);
    let resolved = material.resolve(&At(vec![("st", vec![0.0, 0.0])]).read_by(&material));
    assert_eq!(resolved.params.diffuse_color, Vec3::new(0.9, 0.8, 0.7));
    assert!(material.needs().is_empty());
}

#[test]
fn opacity_is_cut_at_its_threshold() {
    let at = |opacity, opacity_threshold| {
        let surface = PreviewSurface {
            opacity: Input::Value(opacity),
            opacity_threshold,
            ..PreviewSurface::default()
        };
        let material = material(surface, &[]);
        let opacity = material.resolve(&NoPrimvars).opacity;
        assert_eq!(material.may_be_transparent(), opacity < 1.0);
        opacity
    };
    assert_eq!(at(0.4, 0.0), 0.4);
    assert_eq!((at(0.4, 0.5), at(0.5, 0.5)), (0.0, 1.0));
    assert_eq!((at(3.0, 0.0), at(f32::NAN, 0.0)), (1.0, 0.0));
}

#[test]
fn display_color_and_opacity() {
    let material = Material::display_color();
    assert_eq!(material.needs(), ["displayColor", "displayOpacity"]);
    let bare = material.resolve(&NoPrimvars);
    assert_eq!(bare.params, SurfaceParams::lambert(Vec3::splat(0.18)));
    assert_eq!(bare.opacity, 1.0);
    assert!(material.may_be_transparent());
    let on = |primvars: &At, varying: &str| {
        material.constant_on(&primvars.read_by(&material), |name| name == varying)
    };
    let bare = on(&At(vec![]), "").expect("nothing varies");
    assert!(!bare.may_be_transparent() && bare.constant.is_some());
    let thin = At(vec![("displayOpacity", vec![0.5])]);
    assert!(on(&thin, "").is_some_and(|m| m.may_be_transparent()));
    assert!(
        on(&thin, "displayColor").is_none()
            && bare.constant_on(&thin.read_by(&bare), |_| false).is_none()
    );
    let both = At(vec![
        ("displayColor", vec![0.1, 0.2, 0.3]),
        ("displayOpacity", vec![0.5]),
    ]);
    let painted = material.resolve(&both.read_by(&material));
    assert_eq!(painted.params.diffuse_color, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(painted.opacity, 0.5);
}

#[test]
fn normals_are_unit_or_absent() {
    let surface = PreviewSurface {
        normal: Some(NormalMap::Image(TextureMap {
            scale: Vec4::splat(2.0),
            bias: Vec4::new(-1.0, -1.0, 0.0, 0.0),
            ..map(Channels::Rgb)
        })),
        ..PreviewSurface::default()
    };
    let material = material(surface, &[Arc::new(Ramp::default())]);
    let Some(Tangents::OfRead(read)) = material.tangents() else {
        panic!("texture coordinates are read");
    };
    let Read { name, width } = &material.reads()[read];
    assert_eq!((name.as_str(), *width), ("st", 2));
    let flat = material.resolve(&At(vec![("st", vec![0.5, 0.5])]).read_by(&material));
    assert_eq!(flat.normal, Some(Vec3::Z));
    let nonsense = material.resolve(&At(vec![("st", vec![f32::NAN, 0.5])]).read_by(&material));
    assert_eq!(nonsense.normal, None);
}
