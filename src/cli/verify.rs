//! `relievo verify`.

use std::path::PathBuf;

use clap::Args;
use relievo::Result;
use relievo::compare::verify;
use serde_json::json;

use super::compare::{Compare, moved};

/// Check all ways of tracing against Embree's subdivision and against finely diced triangles.
///
/// Distances are in diagonals of each mesh's box. Leaks are rays that leave a closed mesh from within. A hit's error is
/// how far it is from the very geometry that the method traces, as the method itself measured; 0 by Embree's.
#[derive(Debug, Args)]
pub(crate) struct Verify {
    /// Scene: .usd, .usda, .usdc, .usdz or .obj.
    scene: PathBuf,
    #[command(flatten)]
    compare: Compare,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
    /// Rays for each mesh.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    rays: u64,
}

impl Verify {
    pub(crate) fn run(self) -> Result<()> {
        let scene = self.compare.load(&self.scene)?;
        let options = self.compare.options(self.compare.fineness(), self.rays);
        let verified = verify(&scene, &options)?;
        self.compare.warn(&verified.warnings);
        if self.json {
            let report = json!({"scene": self.scene, "rows": verified.rows});
            return super::print(format!("{report}\n").as_bytes());
        }
        let mut text = format!(
            "{:20} {:20} {:>9} {:>8} {:>8} {:>10} {:>10} {:>8} {:>6} {:>10}\n",
            "method",
            "reference",
            "rays",
            "only it",
            "only ref",
            "max dist",
            "rms dist",
            "normal",
            "leaks",
            "hit error"
        );
        for row in &verified.rows {
            text += &format!(
                "{:20} {:20} {:>9} {:>8} {:>8} {:>10.2e} {:>10.2e} {:>8.3} {:>6} {:>10.2e}\n",
                row.method,
                row.reference,
                row.rays,
                row.only_method,
                row.only_reference,
                row.max_distance,
                row.rms_distance,
                row.max_normal_degrees,
                row.leaks,
                row.max_hit_error
            );
        }
        let rows = verified.rows.iter();
        text += &moved(rows.map(|row| (row.method, row.achieved_error)));
        super::print(text.as_bytes())
    }
}
