//! `relievo bench`.

use std::path::PathBuf;

use clap::Args;
use relievo::compare::{
    BenchOptions, CompareOptions, Fineness, Measured, bench, check_report, report_json,
    write_report,
};
use relievo::world::Choice;
use relievo::{Error, Result};

use super::compare::{Compare, moved};
use super::method::{MethodArgument, bounce_dicing};

/// Measure all ways of tracing on one set of rays: memory, building, millions of rays a second.
#[derive(Debug, Args)]
pub(crate) struct Bench {
    /// Scenes: .usd, .usda, .usdc, .usdz or .obj.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    compare: Compare,
    /// Measure at these numbers of micro-triangles, too, with commas between: --report then draws speed against detail.
    #[arg(long, value_delimiter = ',', value_name = "N", conflicts_with = "dicing_rate",
        value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    and_at: Vec<u64>,
    /// Compare speeds with those of this method, and let rays leave from where it is hit. Triangles of very many
    /// micro-triangles may not fit into memory.
    #[arg(long, value_name = "METHOD", default_value = "embree-triangles")]
    relative_to: MethodArgument,
    /// Measure diffuse rays where micro-edges are so many times as long, as `relievo render --bounce-dicing` traces paths
    /// that have bounced; at least 1. Memory is that of both dicings [default: 1]
    #[arg(long, value_name = "TIMES", value_parser = bounce_dicing)]
    bounce_dicing: Option<f32>,
    /// Print JSON instead of a table: one object, or an array of them for several scenes.
    #[arg(long)]
    json: bool,
    /// Primary rays, about.
    #[arg(long, default_value_t = 250_000, value_parser = clap::value_parser!(u64).range(1..=1 << 26))]
    rays: u64,
    /// Draw memory, error and speed of all methods on a page, too. The figures go beside it, ending in .json.
    ///
    /// The page is one file of HTML. The file beside it is what `--json` prints. For the error, distances to finely
    /// diced surfaces are measured as by `relievo verify`.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

impl Bench {
    pub(crate) fn run(self) -> Result<()> {
        // What is wrong is said before anything is measured.
        if let Some(path) = &self.report {
            check_report(path)?;
        }
        let scenes = self
            .scenes
            .iter()
            .map(|path| Ok((path, self.compare.load(path)?)))
            .collect::<Result<Vec<_>>>()?;
        let MethodArgument(Choice::One(relative_to)) = self.relative_to else {
            return Err(Error::usage(
                "--relative-to auto is not one method",
                "name the method that speeds are to be compared with",
            ));
        };
        let and_at = self.and_at.iter().copied().map(Fineness::MicroTriangles);
        let finenesses: Vec<Fineness> = [self.compare.fineness()]
            .into_iter()
            .chain(and_at)
            .collect();
        let mut all = Vec::with_capacity(scenes.len() * finenesses.len());
        for (path, scene) in scenes {
            for &fineness in &finenesses {
                let options = BenchOptions {
                    compare: CompareOptions {
                        bounce_dicing: self.bounce_dicing.filter(|&times| times > 1.0),
                        ..self.compare.options(fineness, self.rays)
                    },
                    relative_to,
                    distances: self.report.is_some(),
                };
                let measured = Measured {
                    scene: path.display().to_string(),
                    bench: bench(&scene, &options)?,
                };
                self.compare.warn(&measured.bench.warnings);
                if !self.json {
                    if self.scenes.len() > 1 {
                        super::print(format!("{}\n", measured.scene).as_bytes())?;
                    }
                    super::print(table(&measured.bench).as_bytes())?;
                }
                all.push(measured);
            }
        }
        if let Some(path) = &self.report {
            write_report(path, &all)?;
        }
        if self.json {
            super::print(report_json(&all).as_bytes())?;
        }
        Ok(())
    }
}

fn table(bench: &relievo::compare::Bench) -> String {
    let (machine, relative_to) = (&bench.machine, bench.relative_to);
    let mut text = format!(
        "{}, {} threads, Embree {}\n{:20} {:>10} {:>8} {:>8}  Mrays/s by threads, and as a ratio to {relative_to}\n",
        machine.processor,
        machine.threads,
        machine.embree,
        "method",
        "triangles",
        "bytes/t",
        "build s"
    );
    if let Some(times) = bench.bounce_dicing {
        text += &format!("diffuse rays meet micro-edges {times} times as long\n");
    }
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
        if let (Some(rms), Some(max)) = (row.rms_distance, row.max_distance) {
            text += &format!("  distance rms: {rms:.2e} max: {max:.2e}");
        }
        text.push('\n');
    }
    let rows = bench.rows.iter();
    text + &moved(rows.map(|row| (row.method, row.achieved_error)))
}
