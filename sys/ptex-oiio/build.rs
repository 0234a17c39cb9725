//! Compiles the class that OpenImageIO wants, and generates declarations of the border below it.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo:rerun-if-changed=c");

    let library = pkg_config::Config::new()
        .atleast_version("2.4")
        .cargo_metadata(false)
        .probe("OpenImageIO")
        .unwrap_or_else(|e| {
            panic!(
                "OpenImageIO 2.4 or newer is needed (Debian: apt install libopenimageio-dev): {e}"
            )
        });

    // The class before the library: static archives are resolved from left to right. `cc` adds stdc++.
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .warnings(true)
        .extra_warnings(true)
        .includes(&library.include_paths)
        .file("c/ptex_input.cpp")
        .compile("ptex_input");
    for path in &library.link_paths {
        println!("cargo:rustc-link-search=native={}", path.display());
    }
    for name in &library.libs {
        println!("cargo:rustc-link-lib=dylib={name}");
    }

    // As a plugin it is loaded into programs that may have the border's functions of their own.
    if env::var_os("CARGO_CFG_TARGET_OS").is_some_and(|os| os == "linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-Bsymbolic");
    }

    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // Of OpenImageIO only the header that is nothing but its version, for the one number that a plugin has to export.
    bindgen::Builder::default()
        .header("c/ptex_border.h")
        .header_contents("version.h", "#include <OpenImageIO/oiioversion.h>")
        .clang_args(["-x", "c++"])
        .clang_args(
            library
                .include_paths
                .iter()
                .map(|path| format!("-I{}", path.display())),
        )
        .allowlist_function("ptex_border_.*|ptex_input_new")
        .allowlist_type("PtexBorder.*")
        .allowlist_var("PTEX_BORDER_.*|OIIO_PLUGIN_VERSION")
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
