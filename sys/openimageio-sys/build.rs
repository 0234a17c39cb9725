//! Compiles the C border and generates its Rust declarations.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo:rerun-if-changed=c");

    // 2.4 is Debian 12's; from 3.0 on, nothing that the border uses has gone.
    let library = pkg_config::Config::new()
        .atleast_version("2.4")
        .cargo_metadata(false)
        .probe("OpenImageIO")
        .unwrap_or_else(|e| {
            panic!(
                "OpenImageIO 2.4 or newer is needed (Debian: apt install libopenimageio-dev): {e}"
            )
        });

    // DEP_RELIEVO_OPENIMAGEIO_VERSION for dependents.
    println!("cargo:version={}", library.version);

    // The border before the library: static archives are resolved from left to right. `cc` adds stdc++.
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .warnings(true)
        .extra_warnings(true)
        .includes(&library.include_paths)
        .file("c/oiio_border.cpp")
        .compile("oiio_border");
    for path in &library.link_paths {
        println!("cargo:rustc-link-search=native={}", path.display());
    }
    for name in &library.libs {
        println!("cargo:rustc-link-lib=dylib={name}");
    }

    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    bindgen::Builder::default()
        .header("c/oiio_border.h")
        .allowlist_function("oiio_border_.*")
        .allowlist_type("OiioBorder.*")
        .allowlist_var("OIIO_BORDER_.*")
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        .derive_default(true)
        .layout_tests(true)
        .use_core()
        .formatter(bindgen::Formatter::None)
        .generate()
        .expect("bindgen reads the border's own header")
        .write_to_file(out.join("bindings.rs"))
        .expect("OUT_DIR is writable");
}
