//! What was stored against what was built, and forged files, for all trees that are kept in a store.

use std::path::Path;

use super::tests::random_ray;
use super::{Compact, CompactOptions, Compressed, Intersector, Stored};
use crate::math::Vec3;
use crate::store::{Store, Writer};
use crate::surface::tests::shapes::{Patches, Random};
use crate::surface::tests::{displacements, effort, surface};
use crate::surface::{Rates, Surface};

/// Faces of several tiles or blocks, and of one.
fn rates(surface: &Surface) -> Rates {
    Rates::by_edge(surface, |edge| [3, 20][edge as usize % 2])
}

fn compact(surface: &Surface) -> Compact {
    let options = CompactOptions::default();
    Compact::build(surface, &rates(surface), &options, &|_| true).expect("nobody stops it")
}

fn compressed(surface: &Surface) -> Compressed {
    Compressed::build(surface, &rates(surface), &|_| true).expect("nobody stops it")
}

#[test]
fn what_was_stored_is_what_was_built() {
    stored_is_what_was_built(compact);
    stored_is_what_was_built(compressed);
}

#[test]
fn forged_files_are_refused_or_traced_to_an_end() {
    forged_files_are_refused_or_traced(compact);
    forged_files_are_refused_or_traced(compressed);
}

/// Sections as a store holds them, for changing.
type Parts = Vec<(String, Vec<u8>)>;

fn parts<T: Stored>(tree: &T) -> Parts {
    let mut parts = Parts::new();
    tree.store(&mut |sections| {
        let owned = |(name, bytes): &(&str, &[u8])| ((*name).to_owned(), bytes.to_vec());
        parts.extend(sections.iter().map(owned));
        Ok(())
    })
    .expect("nothing fails");
    parts
}

/// Writes sections to a store, with right checksums, and reads what they are.
fn through_store<T: Stored>(folder: &Path, surface: &Surface, parts: &Parts) -> Option<T> {
    let (scene, path) = (folder.join("a.usda"), folder.join("a.rlv"));
    std::fs::write(&scene, "").expect("written");
    // A file of its own each time: mapped ones are not written to.
    let _ = std::fs::remove_file(&path);
    let file = std::fs::File::create(&path).expect("a file");
    let told = serde_json::Value::Null;
    let mut writer = Writer::new(file, &path, &scene, "any", told).expect("it begins");
    let sections: Vec<(&str, &[u8])> = (parts
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.as_slice())))
    .collect();
    writer.add("/A", "1", &sections).expect("written");
    writer.finish().expect("it ends");
    let store = Store::open(&path).expect("it is sound");
    let sections = store.object("/A", "1").expect("it is sound");
    T::stored(surface, &sections).ok()
}

fn stored_surface(moves: bool) -> Surface {
    let base = Patches::sphere(2);
    let base = if moves {
        base.moving(|p| p + 0.3 * Vec3::X)
    } else {
        base
    };
    let (_, displacement) = displacements(0.15).swap_remove(1);
    surface(base, displacement)
}

fn stored_is_what_was_built<T: Stored + Intersector>(build: fn(&Surface) -> T) {
    let folder = tempfile::tempdir().expect("a folder");
    for moves in [false, true] {
        let surface = stored_surface(moves);
        let built = build(&surface);
        let stored = through_store::<T>(folder.path(), &surface, &parts(&built));
        let stored = stored.expect("it is sound");
        assert_eq!(parts(&stored), parts(&built));
        let mut random = Random(7);
        for _ in 0..200 {
            let ray = random_ray(&mut random);
            assert_eq!(stored.intersect(0, &ray), built.intersect(0, &ray));
        }
        // A surface that is another one is not given these.
        let other = through_store::<T>(folder.path(), &stored_surface(!moves), &parts(&built));
        assert!(other.is_none());
    }
}

/// Whatever is in a file with right checksums is refused, or traced without a panic and to an end.
fn forged_files_are_refused_or_traced<T: Stored + Intersector>(build: fn(&Surface) -> T) {
    let folder = tempfile::tempdir().expect("a folder");
    let mut random = Random(11);
    for moves in [false, true] {
        let surface = stored_surface(moves);
        let sound = parts(&build(&surface));
        let (mut refused, mut traced) = (0, 0);
        for case in 0..effort(1500) {
            let mut forged = sound.clone();
            // Each section in turn: the large ones would get all changes.
            let (name, bytes) = &mut forged[case % sound.len()];
            assert!(!bytes.is_empty(), "{name}");
            match case % 16 {
                15 => {
                    let keep = (random.next() * bytes.len() as f32) as usize;
                    bytes.truncate(keep);
                }
                _ => {
                    for _ in 0..1 + case % 3 {
                        let at =
                            ((random.next() * bytes.len() as f32) as usize).min(bytes.len() - 1);
                        bytes[at] = (random.next() * 256.0) as u8;
                    }
                }
            }
            let Some(tree) = through_store::<T>(folder.path(), &surface, &forged) else {
                refused += 1;
                continue;
            };
            traced += 1;
            for key in 0..tree.keys() {
                tree.bounds(0, key);
            }
            for _ in 0..20 {
                let ray = random_ray(&mut random);
                if let Some(hit) = tree.intersect(0, &ray) {
                    surface.evaluate(hit.face, hit.uv, 0);
                }
                tree.occluded(0, &ray);
            }
        }
        println!("{refused} refused, {traced} traced");
        assert!(refused > 20 && traced > 20, "{refused} {traced}");
    }
}
