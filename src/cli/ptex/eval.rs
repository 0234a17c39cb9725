//! `relievo ptex eval`.

use std::path::{Path, PathBuf};

use clap::Args;
use relievo::error::Fault;
use relievo::image::write_whole;
use relievo::{Error, Result};
use relievo_ptex::{Cache, Consistent, Filter, FilterKind, Reader};
use serde::Deserialize;
use serde_json::{Value, json};

/// Filter a Ptex file at places that a JSON file lists.
///
/// The file holds `{"queries": [...]}`. A query has `filter`, which is point, bilinear, box, gaussian, bicubic, bspline,
/// catmullrom, mitchell or consistent, `face`, `u`, `v` and the widths `w`, a list [uw1, vw1, uw2, vw2] which consistent
/// lookups do without. It may have `sharpness` (0), `lerp` (false), `noedgeblend` (false), `width` (1), `blur` (0),
/// `first_channel` (0), `channels` (all from the first on) and `premultiply` (false); in brackets is what they are else.
/// The result is `{"results": [...]}`, a list of channels for each query, in the same order. Values that are no numbers
/// or infinite are null.
#[derive(Debug, Args)]
pub(crate) struct Eval {
    /// Ptex file.
    file: PathBuf,
    /// What to look up: a JSON file.
    #[arg(long)]
    queries: PathBuf,
    /// The result: a JSON file.
    #[arg(short, long)]
    output: PathBuf,
}

#[derive(Debug, Deserialize)]
struct Queries {
    queries: Vec<Query>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    filter: String,
    #[serde(default)]
    sharpness: f32,
    #[serde(default)]
    lerp: bool,
    #[serde(default)]
    noedgeblend: bool,
    #[serde(default = "one")]
    width: f32,
    #[serde(default)]
    blur: f32,
    #[serde(default)]
    first_channel: usize,
    channels: Option<usize>,
    #[serde(default)]
    premultiply: bool,
    face: u32,
    u: f32,
    v: f32,
    w: Option<[f32; 4]>,
}

fn one() -> f32 {
    1.0
}

/// The filter that is none of the library's kinds.
const CONSISTENT: &str = "consistent";

impl Eval {
    pub(crate) fn run(self) -> Result<()> {
        let queries = read(&self.queries)?;
        let reader = Reader::open(&self.file, &Cache::default())?;
        let mut lookups = Lookups {
            reader: &reader,
            consistent: [None, None],
        };
        let results: Result<Vec<Value>> = queries
            .iter()
            .enumerate()
            .map(|(i, query)| {
                let values = lookups.eval(query).map_err(|error| {
                    if error.path().is_some() {
                        return Error::from(error);
                    }
                    Fault::new(format!("query {i}: {}", error.message()))
                        .in_file(&self.queries)
                        .advise(error.help())
                        .into()
                })?;
                Ok(json!(values))
            })
            .collect();
        let text = json!({ "results": results? }).to_string();
        write_whole(&self.output, |path| {
            std::fs::write(path, &text)
                .map_err(|e| Error::failed(format!("{}: {e}", self.output.display())))
        })
    }
}

fn read(path: &Path) -> Result<Vec<Query>> {
    let text = std::fs::read(path)
        .map_err(|e| Fault::new(format!("cannot be read: {e}")).in_file(path))?;
    let queries: Queries = serde_json::from_slice(&text).map_err(|e| {
        Fault::new(format!("is no list of queries: {e}"))
            .in_file(path)
            .advise("see `relievo ptex eval --help` for what a query has")
    })?;
    Ok(queries.queries)
}

/// A file, and consistent lookups in it: as stored, and premultiplied.
struct Lookups<'a> {
    reader: &'a Reader,
    consistent: [Option<Consistent>; 2],
}

impl Lookups<'_> {
    fn eval(&mut self, query: &Query) -> relievo_ptex::Result<Vec<f32>> {
        let reader = self.reader;
        let left = reader.channels().saturating_sub(query.first_channel);
        let channels = query.channels.unwrap_or(left);
        // A request for more is refused before memory is taken for it.
        let mut out = vec![0.0; channels.min(reader.channels() + 1)];
        if query.filter == CONSISTENT {
            let slot = &mut self.consistent[usize::from(query.premultiply)];
            let consistent = match slot {
                Some(consistent) => consistent,
                None => slot.insert(Consistent::new(reader, 0, query.premultiply)?),
            };
            consistent.eval(
                reader,
                query.face,
                query.u,
                query.v,
                query.first_channel,
                &mut out,
            )?;
            return Ok(out);
        }
        let filter = Filter {
            sharpness: query.sharpness,
            lerp: query.lerp,
            edge_blend: !query.noedgeblend,
            width: query.width,
            blur: query.blur,
            ..Filter::new(query.filter.parse::<FilterKind>()?)
        };
        filter.eval(
            reader,
            query.face,
            query.u,
            query.v,
            query.w.unwrap_or_default(),
            query.first_channel,
            query.premultiply,
            &mut out,
        )?;
        Ok(out)
    }
}
