//! What the crate found wrong while it composed layers.

use openusd::pcp::CompositionDiagnostic;

use super::walk::Reader;
use crate::error::{Fault, Result};
use crate::scene::MissingLayers;

impl Reader {
    /// Layers and prims that are missing are a fault, unless the options skip them; the rest is told.
    ///
    /// # Errors
    /// Bad input, for the first layer or prim that is missing, damaged, or refers to itself.
    pub(super) fn check_composition(&mut self) -> Result<()> {
        let mut fault: Option<Fault> = None;
        let mut more = 0;
        for diagnostic in self.stage.composition_errors() {
            let message = diagnostic.to_string().trim_end().to_owned();
            if is_broken(&diagnostic) && self.options.missing_layers == MissingLayers::Error {
                more += usize::from(fault.is_some());
                fault.get_or_insert_with(|| Fault::new(message).in_file(&self.file));
            } else {
                let kind = message.split([' ', '@']).take(2).collect::<Vec<_>>();
                self.warn(&format!("composition: {}", kind.join(" ")), || {
                    message.clone()
                });
            }
        }
        let Some(mut fault) = fault else {
            return Ok(());
        };
        if more > 0 {
            fault.message += &format!(" (and {more} more)");
        }
        Err(fault
            .advise("repair the path or the layer, or render without it by --missing-layers skip")
            .into())
    }
}

/// Whether a part of the scene is not there for it. What is left are targets of relationships and selections
/// of variants that lead nowhere, as they do in many a scene.
fn is_broken(diagnostic: &CompositionDiagnostic) -> bool {
    use CompositionDiagnostic as D;
    match diagnostic {
        // Material libraries in MaterialX: a format that relievo does not read at all.
        D::MalformedLayer { reason, .. } | D::MalformedSublayer { reason, .. } => {
            !reason.contains("no file format")
        }
        D::ArcCycle(_)
        | D::UnresolvedLayer { .. }
        | D::UnreadableClip { .. }
        | D::InvalidPrimPath { .. }
        | D::UnresolvedPrimPath { .. }
        | D::UnresolvedDefaultPrim { .. }
        | D::InvalidExpression { .. }
        | D::UnresolvedSublayer { .. }
        | D::SublayerCycle { .. } => true,
        _ => false,
    }
}
