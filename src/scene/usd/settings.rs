//! UsdRender.

use openusd::usd::Prim;

use super::value;
use super::walk::Reader;
use openusd::sdf::Value;

use crate::error::{Fault, Result};
use crate::scene::{AspectRatioConform, Purpose, RenderSettings};

impl Reader {
    /// What the settings prim and its first raster product say; `asked` goes before the stage's own.
    ///
    /// # Errors
    /// Bad input if the prim that is asked for is not there.
    pub(super) fn settings(&mut self, asked: Option<&str>) -> Result<RenderSettings> {
        let own = self
            .stage
            .stage_metadata("renderSettingsPrimPath")
            .ok()
            .flatten()
            .and_then(value::word)
            .filter(|p| !p.is_empty());
        let Some(path) = asked.map(str::to_owned).or(own) else {
            return Ok(RenderSettings::default());
        };
        let prim = self
            .stage
            .prim(path.as_str())
            .ok()
            .filter(|p| self.type_name(p) == "RenderSettings");
        let Some(prim) = prim else {
            let message = format!("{path} is not a RenderSettings prim");
            if asked.is_some() {
                return Err(Fault::new(message)
                    .in_file(&self.file)
                    .advise("name one that the file holds, or none")
                    .into());
            }
            self.warn("render settings", || message);
            return Ok(RenderSettings::default());
        };
        let mut out = RenderSettings {
            path: Some(path),
            ..RenderSettings::default()
        };
        self.settings_base(&prim, &mut out);
        for target in self.targets(&prim, "products") {
            let Ok(product) = self.stage.prim(target) else {
                continue;
            };
            if self
                .word(&product, "productType")
                .is_some_and(|t| t != "raster")
            {
                continue;
            }
            // A product's own opinions go before the settings'.
            self.settings_base(&product, &mut out);
            out.product_name = self.word(&product, "productName").filter(|n| !n.is_empty());
            for var in self.targets(&product, "orderedVars") {
                let Ok(var) = self.stage.prim(var) else {
                    continue;
                };
                let name = self.word(&var, "sourceName").filter(|n| !n.is_empty());
                out.aovs
                    .extend(name.or_else(|| var.path().name().map(str::to_owned)));
            }
            break;
        }
        Ok(out)
    }

    /// What settings and products have in common; only what is authored.
    fn settings_base(&mut self, prim: &Prim, out: &mut RenderSettings) {
        let names = self.authored(prim);
        let has = |name: &str| names.iter().any(|n| n == name);
        if has("camera") {
            out.camera = self
                .targets(prim, "camera")
                .first()
                .map(|p| p.as_str().to_owned());
        }
        if has("resolution")
            && let Some(Value::Vec2i(v)) = self.value(prim, "resolution")
            && let (Ok(x), Ok(y)) = (u32::try_from(v.x), u32::try_from(v.y))
            && x > 0
            && y > 0
        {
            out.resolution = Some([x, y]);
        }
        if has("pixelAspectRatio") {
            out.pixel_aspect_ratio = self
                .number(prim, "pixelAspectRatio")
                .map(|v| v as f32)
                .filter(|v| v.is_finite() && *v > 0.0);
        }
        if has("aspectRatioConformPolicy") {
            out.conform = match self.word(prim, "aspectRatioConformPolicy").as_deref() {
                Some("cropAperture") => AspectRatioConform::CropAperture,
                Some("adjustApertureWidth") => AspectRatioConform::AdjustApertureWidth,
                Some("adjustApertureHeight") => AspectRatioConform::AdjustApertureHeight,
                Some("adjustPixelAspectRatio") => AspectRatioConform::AdjustPixelAspectRatio,
                _ => AspectRatioConform::ExpandAperture,
            };
        }
        if has("dataWindowNDC") {
            out.data_window = self
                .value(prim, "dataWindowNDC")
                .and_then(value::vec4)
                .filter(|v| v.is_finite() && v.x < v.z && v.y < v.w)
                .map(Into::into);
        }
        if has("includedPurposes") {
            out.included_purposes = Some(self.included_purposes(prim));
        }
        if has("disableMotionBlur") {
            out.disable_motion_blur = self.truth(prim, "disableMotionBlur");
        }
        if has("disableDepthOfField") {
            out.disable_depth_of_field = self.truth(prim, "disableDepthOfField");
        }
    }

    /// Purposes beside `default`, which is shown whether it is named or not.
    fn included_purposes(&mut self, prim: &Prim) -> Vec<Purpose> {
        let words = self
            .value(prim, "includedPurposes")
            .and_then(value::words)
            .unwrap_or_default();
        words
            .iter()
            .filter_map(|word| match Purpose::from_word(word) {
                None if word != "default" => {
                    self.warn("unknown purpose", || {
                        format!(
                            "{}: includedPurposes: {word} is not known",
                            prim.path().as_str()
                        )
                    });
                    None
                }
                purpose => purpose,
            })
            .collect()
    }
}
