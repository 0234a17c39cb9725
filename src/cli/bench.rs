//! `relievo bench`.

use clap::Args;
use relievo::Result;
use relievo::compare::bench;
use serde_json::json;

use super::compare::{Compare, moved};

/// Measure all ways of tracing on one set of rays: memory, building, millions of rays a second.
#[derive(Debug, Args)]
pub(crate) struct Bench {
    #[command(flatten)]
    compare: Compare,
    /// Primary rays, about.
    #[arg(long, default_value_t = 250_000, value_parser = clap::value_parser!(u64).range(1..=1 << 26))]
    rays: u64,
}

impl Bench {
    pub(crate) fn run(self) -> Result<()> {
        let scene = self.compare.load()?;
        let bench = bench(&scene, &self.compare.options(self.rays))?;
        self.compare.warn(&bench.warnings);
        if self.compare.json {
            let report = json!({
                "scene": self.compare.scene, "machine": bench.machine, "rows": bench.rows,
            });
            return super::print(format!("{report}\n").as_bytes());
        }
        let machine = &bench.machine;
        let mut text = format!(
            "{}, {} threads, Embree {}\n{:20} {:>10} {:>8} {:>8}  Mrays/s by threads, and as a ratio to embree-triangles\n",
            machine.processor,
            machine.threads,
            machine.embree,
            "method",
            "triangles",
            "bytes/t",
            "build s"
        );
        for row in &bench.rows {
            text += &format!(
                "{:20} {:>10} {:>8.1} {:>8.3} ",
                row.method, row.micro_triangles, row.bytes_per_micro_triangle, row.build_seconds
            );
            for (kind, by_threads) in &row.mrays {
                for (threads, speed) in by_threads {
                    let ratio = row.ratio[kind][threads];
                    text += &format!(" {kind} {threads}: {speed:.2} ({ratio:.2})");
                }
            }
            text.push('\n');
        }
        text += &moved(
            bench
                .rows
                .iter()
                .map(|row| (row.method, row.achieved_error)),
        );
        super::print(text.as_bytes())
    }
}
