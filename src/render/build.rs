//! From a scene file to a store of built hierarchies.

use std::fs::File;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::{Progress, RenderOptions, Staged, building, stage};
use crate::error::{Error, Result};
use crate::image::write_whole;
use crate::stats::Stats;
use crate::store::Writer;
use crate::world::{Choice, World};

/// What was written.
#[derive(Debug, Clone)]
pub struct Recorded {
    /// Objects whose hierarchies are in the store.
    pub objects: usize,
    /// Bytes of the file.
    pub bytes: u64,
    /// What it took; its stages are `load` and `build`.
    pub stats: Stats,
}

/// Builds the hierarchies that [`render()`](super::render()) with the same options would, and writes them to a store. Of
/// `options` only what decides about geometry counts. `told` is given back by [`Store::told`](crate::store::Store::told).
/// The file appears whole, or not at all.
///
/// # Errors
/// As the stages, and if the method cannot be stored or the file cannot be written.
pub fn build(
    options: &RenderOptions,
    store: &Path,
    told: serde_json::Value,
    progress: &Progress,
    interrupt: &AtomicBool,
) -> Result<Recorded> {
    let method = match options.build.method {
        Choice::One(method) if method.is_stored() => method,
        other => {
            return Err(Error::usage(
                format!("what {} builds cannot be stored", other.name()),
                "choose --method compact or compressed",
            ));
        }
    };
    let mut stats = Stats::default();
    let mut written = (0, 0);
    write_whole(store, |temporary| {
        let staged = stage(options, progress, &mut stats, interrupt)?;
        let Staged {
            description,
            camera,
            device,
            pool,
            ..
        } = &staged;
        let file = File::create(temporary)
            .map_err(|e| Error::failed(format!("{}: {e}", store.display())))?;
        let mut writer = Writer::new(file, store, &options.scene, method.name(), told)?;
        let built = building(pool, progress, &mut stats, interrupt, |go_on| {
            World::record(
                description,
                camera,
                device,
                &options.build,
                &mut writer,
                go_on,
            )
        })?;
        progress.warn(&built.warnings);
        stats.achieved_error = built.error;
        written = pool.install(|| writer.finish())?;
        progress.finish();
        Ok(())
    })?;
    let (objects, bytes) = written;
    Ok(Recorded {
        objects,
        bytes,
        stats,
    })
}
