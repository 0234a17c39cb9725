//! Pictures against pictures: threads, runs, and references of another renderer.

use std::path::Path;

use crate::common::{mean, options, read, run, shared};

#[test]
fn the_same_pixels_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/first-light/first-light.usda");
    let pictures = [1, 2].map(|threads| {
        let picture = folder.path().join(format!("{threads}.exr"));
        let mut options = options(&scene, &picture);
        options.resolution = Some([60, 40]);
        options.threads = threads;
        options.spp = 4;
        run(&options);
        read(&picture).2
    });
    assert!(
        pictures[0]
            .iter()
            .zip(&pictures[1])
            .all(|(a, b)| a.to_array().map(f32::to_bits) == b.to_array().map(f32::to_bits))
    );
}

/// Scenes converged elsewhere: each channel's mean within 0.5 %, the mean absolute difference within 2 %.
#[test]
fn references_of_another_renderer() {
    let Some(shared) = shared("references_of_another_renderer") else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["box", "cage"] {
        let scene = shared.join(format!("reference/{name}.usda"));
        let (width, height, reference) = read(&shared.join(format!("reference/{name}.exr")));
        let picture = folder.path().join(format!("{name}.exr"));
        let mut options = options(&scene, &picture);
        options.resolution = Some([width, height]);
        options.spp = 1024;
        run(&options);
        let (.., pixels) = read(&picture);
        let (got, expected) = (mean(&pixels), mean(&reference));
        let difference: Vec<_> = pixels
            .iter()
            .zip(&reference)
            .map(|(a, b)| (*a - *b).abs())
            .collect();
        let relative = mean(&difference) / expected;
        println!(
            "{name}: mean {got} for {expected}, off by {}, absolute difference {relative}",
            got / expected - 1.0
        );
        assert!(
            (got / expected - 1.0).abs().max_element() < 5e-3,
            "{name}: mean {got} for {expected}"
        );
        assert!(
            relative.max_element() < 0.02,
            "{name}: mean absolute difference {relative}"
        );
    }
}
