//! What decides about a scene's geometry: told to `relievo build`, and to `relievo render`.

use clap::{Args, ValueEnum};
use relievo::math::Vec4;
use relievo::scene::{LoadOptions, MissingLayers, Purpose};
use relievo::surface::MOST_SEGMENTS;
use relievo::world::{Dicing, MaxError};
use relievo::{Error, Result};
use serde::{Deserialize, Serialize};

use super::method::{bounce_dicing, max_error};

/// As it was given. A store remembers what its build was told, and a render from it need not say it again.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct Staging {
    /// Camera, by path or name [default: the render settings' one, else the first]
    #[arg(long, value_name = "PRIM", help_heading = "View")]
    pub(super) camera: Option<String>,
    /// Pixels [default: the render settings', else 960 540]
    #[arg(long, num_args = 2, value_names = ["W", "H"], help_heading = "View")]
    pub(super) res: Option<Vec<u32>>,
    /// Multiply the resolution [default: 1]
    #[arg(long, allow_negative_numbers = true, help_heading = "View")]
    scale: Option<f32>,
    /// Frame to render [default: the file's start frame]
    #[arg(long, help_heading = "View", allow_negative_numbers = true)]
    frame: Option<f64>,
    /// Purposes to show beside the default one, with commas between [default: the render settings', else
    /// render]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "View")]
    purpose: Option<Vec<PurposeArgument>>,
    /// Render settings prim to use [default: the one that the file names]
    #[arg(long, value_name = "PRIM", help_heading = "View")]
    settings: Option<String>,

    /// Length of a micro-edge in pixels, on the displaced surface [default: 1]
    #[arg(long, allow_negative_numbers = true, help_heading = "Quality")]
    dicing_rate: Option<f32>,
    /// The most micro-edges that an edge is cut into, 1 to 4096: what keeps an edge that comes close to the camera from
    /// taking all memory [default: 128]
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_SEGMENTS)),
        help_heading = "Quality"
    )]
    max_segments: Option<u32>,
    /// After a diffuse bounce, or any that spreads rays as widely, micro-edges are so many times as long, for less memory
    /// to be kept at hand; at least 1. Not for what is traced without micro-triangles, nor from a store [default: 1]
    #[arg(
        long,
        value_name = "TIMES",
        value_parser = bounce_dicing,
        help_heading = "Quality"
    )]
    bounce_dicing: Option<f32>,
    /// How far `compact` and `cache` may move micro-vertices: 0.25px is a quarter of a pixel at the object's closest view, 1e-5 that
    /// part of its diagonal [default: 3.6e-5, and at most 0.25px]
    #[arg(long, value_name = "ERROR", value_parser = max_error, help_heading = "Quality")]
    pub(super) max_error: Option<MaxError>,
    /// Leave out motion blur.
    #[arg(long, help_heading = "Quality")]
    no_motion_blur: bool,

    /// What to do about textures that cannot be read [default: error]
    #[arg(long, value_enum, help_heading = "Scene")]
    missing_textures: Option<MissingTextures>,
    /// What to do about layers and prims that the scene refers to and that are not there [default: error]
    #[arg(long, value_enum, help_heading = "Scene")]
    missing_layers: Option<MissingLayersArgument>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
enum PurposeArgument {
    /// No other.
    Default,
    /// For final pictures.
    Render,
    /// Stand-ins.
    Proxy,
    /// Helpers that artists see.
    Guide,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
enum MissingTextures {
    /// Stop.
    Error,
    /// Go on with magenta in their place.
    Magenta,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
enum MissingLayersArgument {
    /// Stop.
    Error,
    /// Go on without them.
    Skip,
}

impl PurposeArgument {
    fn purpose(self) -> Option<Purpose> {
        match self {
            Self::Default => None,
            Self::Render => Some(Purpose::Render),
            Self::Proxy => Some(Purpose::Proxy),
            Self::Guide => Some(Purpose::Guide),
        }
    }
}

impl Staging {
    /// Numbers that make no sense are errors of usage.
    pub(super) fn check(&self) -> Result<()> {
        for (name, value) in [("scale", self.scale), ("dicing-rate", self.dicing_rate)] {
            if let Some(value) = value
                && !(value.is_finite() && value > 0.0)
            {
                return Err(Error::usage(
                    format!("--{name} {value}"),
                    format!("--{name} takes a number above 0"),
                ));
            }
        }
        match self.frame {
            Some(frame) if !frame.is_finite() => Err(Error::usage(
                format!("--frame {frame}"),
                "--frame takes a number",
            )),
            _ => Ok(()),
        }
    }

    /// What is not given here, as it is there.
    pub(super) fn or(self, there: Self) -> Self {
        Self {
            camera: self.camera.or(there.camera),
            res: self.res.or(there.res),
            scale: self.scale.or(there.scale),
            frame: self.frame.or(there.frame),
            purpose: self.purpose.or(there.purpose),
            settings: self.settings.or(there.settings),
            dicing_rate: self.dicing_rate.or(there.dicing_rate),
            max_segments: self.max_segments.or(there.max_segments),
            bounce_dicing: self.bounce_dicing.or(there.bounce_dicing),
            max_error: self.max_error.or(there.max_error),
            no_motion_blur: self.no_motion_blur || there.no_motion_blur,
            missing_textures: self.missing_textures.or(there.missing_textures),
            missing_layers: self.missing_layers.or(there.missing_layers),
        }
    }

    /// The options given here that are others there.
    pub(super) fn differing(&self, there: &Self) -> Vec<String> {
        let options = |staging| match serde_json::to_value(staging) {
            Ok(serde_json::Value::Object(options)) => options,
            _ => serde_json::Map::new(),
        };
        let there = options(there);
        options(self)
            .into_iter()
            .filter(|(name, given)| {
                !given.is_null() && *given != false && there.get(name) != Some(given)
            })
            .map(|(name, _)| format!("--{}", name.replace('_', "-")))
            .collect()
    }

    pub(super) fn resolution(&self) -> Option<[u32; 2]> {
        match self.res.as_deref() {
            Some(&[width, height]) => Some([width, height]),
            _ => None,
        }
    }

    pub(super) fn scale(&self) -> f32 {
        self.scale.unwrap_or(1.0)
    }

    pub(super) fn dicing(&self) -> Dicing {
        let usual = Dicing::default();
        Dicing {
            rate: self.dicing_rate.unwrap_or(usual.rate),
            max_segments: self.max_segments.unwrap_or(usual.max_segments),
            ..usual
        }
    }

    /// How much longer micro-edges are after a bounce, if they are.
    pub(super) fn bounce_dicing(&self) -> Option<f32> {
        self.bounce_dicing.filter(|&times| times > 1.0)
    }

    /// The colour in place of textures that cannot be read.
    pub(super) fn missing_textures(&self) -> Option<Vec4> {
        let magenta = Vec4::new(1.0, 0.0, 1.0, 1.0);
        (self.missing_textures == Some(MissingTextures::Magenta)).then_some(magenta)
    }

    pub(super) fn load(&self) -> LoadOptions {
        let purposes =
            |p: &Vec<PurposeArgument>| p.iter().filter_map(|purpose| purpose.purpose()).collect();
        LoadOptions {
            frame: self.frame,
            camera: self.camera.clone(),
            motion_blur: !self.no_motion_blur,
            purposes: self.purpose.as_ref().map(purposes),
            settings: self.settings.clone(),
            missing_layers: match self.missing_layers {
                Some(MissingLayersArgument::Skip) => MissingLayers::Skip,
                Some(MissingLayersArgument::Error) | None => MissingLayers::Error,
            },
        }
    }
}
