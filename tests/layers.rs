//! No arrow goes up: which module of the library may use which.
//!
//! A module may use what its row names, the files of its own folder, and nothing else of the crate. The table says
//! what is so on purpose: `accel` does not know Embree, `trace` does not know which method it runs, `integrate`
//! does not know the film, `scene` builds nothing.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Lowest first: a module and the modules that it may use. What stands below it in the list it may not.
const LAYERS: [(&str, &[&str]); 24] = [
    ("error", &[]),
    // How much all of the program may take.
    ("memory", &["error"]),
    ("math", &[]),
    // A file of sections: what they hold it does not know.
    ("store", &["error"]),
    ("mesh", &["error", "math"]),
    // Of the cage alone: limit surfaces do not matter to it.
    ("atlas", &["error", "math", "mesh"]),
    // Tells a store what a texture holds.
    ("image", &["error", "math", "store"]),
    // Statistics are written like pictures: whole or not at all.
    ("stats", &["error", "memory", "image"]),
    ("scene", &["error", "memory", "math", "mesh", "image"]),
    ("subdiv", &["error", "math", "mesh"]),
    ("nurbs", &["error", "math", "mesh"]),
    (
        "surface",
        &[
            "error", "memory", "stats", "math", "mesh", "image", "subdiv", "nurbs",
        ],
    ),
    // Images by way of a surface's texture coordinates: no scene, no rays.
    ("convert", &["error", "math", "mesh", "image", "surface"]),
    (
        "accel",
        &["error", "memory", "store", "stats", "math", "surface"],
    ),
    // Of surfaces it takes diced ones, to hand their micro-vertices to Embree.
    (
        "trace",
        &[
            "error", "memory", "stats", "math", "mesh", "surface", "accel",
        ],
    ),
    (
        "shade",
        &[
            "error", "stats", "math", "mesh", "image", "scene", "surface", "accel",
        ],
    ),
    (
        "world",
        &[
            "error", "memory", "store", "stats", "math", "mesh", "image", "scene", "subdiv",
            "nurbs", "surface", "accel", "trace", "shade",
        ],
    ),
    (
        "integrate",
        &["error", "stats", "math", "trace", "shade", "world"],
    ),
    // The film knows what a sample is; what computes samples does not know the film.
    ("film", &["error", "stats", "math", "image", "integrate"]),
    (
        "render",
        &[
            "error",
            "memory",
            "store",
            "stats",
            "math",
            "mesh",
            "image",
            "scene",
            "subdiv",
            "nurbs",
            "surface",
            "accel",
            "trace",
            "shade",
            "world",
            "film",
            "integrate",
        ],
    ),
    // Sees all ways of tracing at once, which nothing below it may.
    (
        "compare",
        &[
            "error", "memory", "stats", "math", "mesh", "image", "scene", "surface", "accel",
            "trace", "shade", "world", "film", "render",
        ],
    ),
    // Rays from a limit surface to a dense mesh; of the render only how it tells of progress.
    (
        "bake",
        &[
            "error", "math", "mesh", "image", "subdiv", "surface", "convert", "trace", "render",
        ],
    ),
    ("cli", &[]),
    ("main", &["cli"]),
];

/// The foreign libraries, and who may hold their handles.
const BORDERS: [(&str, &str); 4] = [
    ("embree4_sys", "trace"),
    ("openimageio_sys", "image"),
    ("ptex_oiio", "image"),
    ("openusd", "scene"),
];

#[test]
fn no_arrow_goes_up() {
    let mut seen = BTreeSet::new();
    let mut wrong = Vec::new();
    for file in sources() {
        let module = module_of(&file);
        if is_test(&file) {
            continue;
        }
        let text = std::fs::read_to_string(&file).expect("a source file");
        let text = text
            .split("#[cfg(test)]\nmod tests {")
            .next()
            .unwrap_or_default();
        let Some((_, may_use)) = LAYERS.iter().find(|(name, _)| *name == module) else {
            assert_eq!(module, "lib", "{} is in no layer", file.display());
            continue;
        };
        for used in used_modules(text) {
            seen.insert((module.clone(), used.clone()));
            if used != module && !may_use.contains(&used.as_str()) {
                wrong.push(format!("{}: {module} uses {used}", file.display()));
            }
        }
        for (library, owner) in BORDERS {
            if module != owner && words(text).any(|word| word == library) {
                wrong.push(format!("{}: {module} uses {library}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // The reader of the table would not notice if it read nothing.
    for (module, used) in [("render", "scene"), ("world", "trace"), ("image", "error")] {
        assert!(
            seen.contains(&(module.into(), used.into())),
            "{module} uses {used}"
        );
    }
}

#[test]
fn the_table_itself_points_down() {
    for (i, (module, may_use)) in LAYERS.iter().enumerate() {
        for used in *may_use {
            let below = LAYERS[..i].iter().any(|(name, _)| name == used);
            assert!(below, "{used} does not lie below {module}");
        }
    }
}

fn sources() -> Vec<PathBuf> {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("the sources") {
            let path = entry.expect("an entry of the sources").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files
}

/// Tests may fetch from above what they test with.
fn is_test(file: &Path) -> bool {
    file.components().any(|part| part.as_os_str() == "tests")
        || file
            .file_stem()
            .is_some_and(|stem| stem.to_string_lossy().ends_with("tests"))
}

/// The folder or file right below `src`.
fn module_of(file: &Path) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let first = file
        .strip_prefix(root)
        .expect("a source file")
        .components()
        .next();
    let name = Path::new(first.expect("a name").as_os_str()).with_extension("");
    name.to_string_lossy().into_owned()
}

/// Every module of the crate that a file names: `crate::mesh::…` and `crate::{error::…, math::…}`. The crate's root
/// hands out `Error` and `Result`: they are `error`'s.
fn used_modules(text: &str) -> BTreeSet<String> {
    let code: String = text
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
        .collect::<Vec<_>>()
        .join("\n");
    let mut used = BTreeSet::new();
    for (at, found) in code.match_indices("crate::") {
        // `openusd_crate::` is another crate, and `pub(in crate::…)` is none.
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + found.len()..];
        let names = match rest.strip_prefix('{') {
            Some(group) => first_names(group),
            None => words(rest).take(1).map(str::to_owned).collect(),
        };
        for name in names {
            used.insert(match name.as_str() {
                "Error" | "Result" => "error".to_owned(),
                _ => name,
            });
        }
    }
    used
}

/// The names at the start of each entry of a `use` group, up to its closing brace.
fn first_names(group: &str) -> Vec<String> {
    let mut names = vec![String::new()];
    let mut depth = 0_usize;
    let mut in_path = false;
    for c in group.chars() {
        match c {
            '}' if depth == 0 => break,
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                names.push(String::new());
                in_path = false;
            }
            ':' => in_path = true,
            c if depth == 0 && !in_path && (c.is_alphanumeric() || c == '_') => {
                names.last_mut().expect("there is one").push(c);
            }
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_'))
        .filter(|word| !word.is_empty())
}

#[test]
fn uses_are_found() {
    let text = "use crate::mesh::{ControlMesh, Scheme};\nuse crate::{error::Result, math::{Vec3, Vec2}};\n\
                fn f() -> crate::Result<()> { crate::film::Film::new() } // crate::render";
    let found: Vec<String> = used_modules(text).into_iter().collect();
    assert_eq!(found, ["error", "film", "math", "mesh"]);
}
