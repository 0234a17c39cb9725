//! UsdLux.

use openusd::tf::Token;
use openusd::usd::Prim;

use super::value;
use super::walk::{Reader, has};
use crate::image::{ColorSpace, Wrap};
use crate::math::{DAffine3, Vec3, Vec4};
use crate::scene::{Channels, Light, LightKind, Shaping, TextureMap, Transform2d};

impl Reader {
    /// A light, its place but for the dome's pole still to be set; `None` for other prims and, with a warning,
    /// for lights without size.
    pub(super) fn light(&mut self, prim: &Prim, type_name: &str, names: &[Token]) -> Option<Light> {
        let path = prim.path().as_str().to_owned();
        let float = |name: &str, default: f32| {
            self.number(prim, &format!("inputs:{name}"))
                .map_or(default, |v| v as f32)
        };
        let kind = match type_name {
            "RectLight" => LightKind::Rect {
                width: float("width", 1.0),
                height: float("height", 1.0),
            },
            "DiskLight" => LightKind::Disk {
                radius: float("radius", 0.5),
            },
            "SphereLight" => LightKind::Sphere {
                radius: float("radius", 0.5),
            },
            "CylinderLight" => LightKind::Cylinder {
                radius: float("radius", 0.5),
                length: float("length", 1.0),
            },
            "DistantLight" => LightKind::Distant {
                angle: float("angle", 0.53),
            },
            "DomeLight" | "DomeLight_1" => LightKind::Dome,
            _ => return None,
        };
        let sizes = match kind {
            LightKind::Rect { width, height } => [width, height],
            LightKind::Disk { radius } | LightKind::Sphere { radius } => [radius, radius],
            LightKind::Cylinder { radius, length } => [radius, length],
            LightKind::Distant { angle } => [angle + f32::MIN_POSITIVE, 1.0],
            LightKind::Dome => [1.0, 1.0],
        };
        let intensity = if type_name == "DistantLight" {
            50000.0
        } else {
            1.0
        };
        let scale = float("intensity", intensity) * float("exposure", 0.0).exp2();
        let temperature = float("colorTemperature", 6500.0);
        let diffuse = float("diffuse", 1.0);
        let specular = float("specular", 1.0);
        let mut color = self
            .value(prim, "inputs:color")
            .and_then(value::vec3)
            .unwrap_or(Vec3::ONE)
            * scale;
        if self
            .truth(prim, "inputs:enableColorTemperature")
            .unwrap_or(false)
        {
            color *= blackbody(temperature);
        }
        if !color.is_finite() || !sizes.iter().all(|s| s.is_finite() && *s > 0.0) {
            self.warn("unusable light", || {
                format!("{path}: size {sizes:?} and colour {color} make no light; it is left out")
            });
            return None;
        }
        if color.min_element() < 0.0 {
            self.warn("negative light", || {
                format!("{path}: negative light is taken as none")
            });
        }
        self.unhonoured(prim, names);
        let texture = match kind {
            // A rectangle's borders have nothing to do with each other.
            LightKind::Rect { .. } => self.light_texture(prim, [Wrap::Clamp; 2]),
            LightKind::Dome => self.light_texture(prim, [Wrap::Repeat, Wrap::Clamp]),
            _ => None,
        };
        Some(Light {
            world_from_light: self.pole(prim, type_name),
            path,
            kind,
            color: color.max(Vec3::ZERO),
            normalize: self.truth(prim, "inputs:normalize").unwrap_or(false),
            diffuse,
            specular,
            texture,
            shaping: self.shaping(prim, names),
        })
    }

    /// Turns a dome whose pole is Z so that it is Y of its own space.
    fn pole(&self, prim: &Prim, type_name: &str) -> DAffine3 {
        if type_name != "DomeLight_1" {
            return DAffine3::IDENTITY;
        }
        let z = match self.word(prim, "poleAxis").as_deref() {
            Some("Z") => true,
            Some("Y") => false,
            _ => super::stage_metadata(&self.stage).0 == Vec3::Z,
        };
        if z {
            DAffine3::from_rotation_x(std::f64::consts::FRAC_PI_2)
        } else {
            DAffine3::IDENTITY
        }
    }

    fn light_texture(&mut self, prim: &Prim, wrap: [Wrap; 2]) -> Option<TextureMap> {
        let attribute = prim.attribute("inputs:texture:file");
        let texture = self.texture(prim, &attribute, wrap, ColorSpace::Auto)?;
        let format = self.word(prim, "inputs:texture:format").unwrap_or_default();
        if !matches!(format.as_str(), "" | "automatic" | "latlong") {
            self.warn("dome texture format", || {
                format!(
                    "{}: texture format {format} is read as latlong",
                    prim.path().as_str()
                )
            });
        }
        Some(TextureMap {
            texture,
            primvar: String::new(),
            transform: Transform2d::default(),
            channels: Channels::Rgb,
            scale: Vec4::ONE,
            bias: Vec4::ZERO,
            fallback: Vec4::ONE,
        })
    }

    fn shaping(&mut self, prim: &Prim, names: &[Token]) -> Option<Shaping> {
        if !names.iter().any(|n| n.starts_with("inputs:shaping:")) {
            return None;
        }
        if has(names, "inputs:shaping:ies:file") {
            self.warn("IES profile", || {
                format!("{}: shaping:ies:file is not honoured", prim.path().as_str())
            });
        }
        let float = |name: &str, default: f32| {
            self.number(prim, &format!("inputs:shaping:{name}"))
                .map(|v| v as f32)
                .filter(|v| v.is_finite())
                .unwrap_or(default)
        };
        let shaping = Shaping {
            focus: float("focus", 0.0),
            focus_tint: self
                .value(prim, "inputs:shaping:focusTint")
                .and_then(value::vec3)
                .unwrap_or(Vec3::ZERO),
            cone_angle: float("cone:angle", 90.0),
            cone_softness: float("cone:softness", 0.0),
        };
        (shaping.focus != 0.0 || shaping.cone_angle < 90.0 || shaping.cone_softness != 0.0)
            .then_some(shaping)
    }

    /// Says what of a light is left out.
    fn unhonoured(&mut self, prim: &Prim, names: &[Token]) {
        let path = prim.path().as_str();
        for (what, found) in [
            (
                "light linking",
                names.iter().any(|n| {
                    (n.starts_with("collection:lightLink:")
                        || n.starts_with("collection:shadowLink:"))
                        && (n.ends_with(":includes") || n.ends_with(":excludes"))
                }),
            ),
            ("light filters", has(names, "light:filters")),
            ("dome portals", has(names, "portals")),
            (
                "shadow settings",
                names.iter().any(|n| n.starts_with("inputs:shadow:")),
            ),
        ] {
            if found {
                self.warn(what, || format!("{path}: not honoured: {what}"));
            }
        }
    }
}

/// The colour of a black body, linear Rec.709, of luminance 1: Kim's fit to the Planckian locus.
pub(super) fn blackbody(kelvin: f32) -> Vec3 {
    let t = f64::from(kelvin).clamp(1667.0, 25000.0);
    let (t2, t3) = (t * t, t * t * t);
    let x = if t <= 4000.0 {
        -0.2661239e9 / t3 - 0.2343589e6 / t2 + 0.8776956e3 / t + 0.179910
    } else {
        -3.0258469e9 / t3 + 2.1070379e6 / t2 + 0.2226347e3 / t + 0.240390
    };
    let (x2, x3) = (x * x, x * x * x);
    let y = if t <= 2222.0 {
        -1.1063814 * x3 - 1.34811020 * x2 + 2.18555832 * x - 0.20219683
    } else if t <= 4000.0 {
        -0.9549476 * x3 - 1.37418593 * x2 + 2.09137015 * x - 0.16748867
    } else {
        3.0817580 * x3 - 5.87338670 * x2 + 3.75112997 * x - 0.37001483
    };
    let (big_x, big_z) = (x / y, (1.0 - x - y) / y);
    let rgb = [
        3.2404542 * big_x - 1.5371385 - 0.4985314 * big_z,
        -0.9692660 * big_x + 1.8760108 + 0.0415560 * big_z,
        0.0556434 * big_x - 0.2040259 + 1.0572252 * big_z,
    ]
    .map(|c| c.max(0.0));
    let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    Vec3::from(rgb.map(|c| (c / luminance) as f32))
}
