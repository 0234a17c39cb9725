//! Finds out which Embree is installed, compiles the layer over Embree 3 where needed, and generates bindings.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=c");
    println!("cargo::rerun-if-env-changed=EMBREE_INCLUDE_DIR");
    println!("cargo::rerun-if-env-changed=EMBREE_LIB_DIR");
    println!("cargo::rustc-check-cfg=cfg(embree3)");
    // Rebuild when the system's Embree is replaced by another.
    for dir in ["/usr/include/embree4", "/usr/include/embree3"] {
        if PathBuf::from(dir).is_dir() {
            println!("cargo::rerun-if-changed={dir}/rtcore_config.h");
        }
    }
    let include = env::var_os("EMBREE_INCLUDE_DIR").map(PathBuf::from);
    if let Some(dir) = env::var_os("EMBREE_LIB_DIR") {
        println!(
            "cargo::rustc-link-search=native={}",
            PathBuf::from(dir).display()
        );
    }

    // Which Embree is it? Ask the preprocessor that will compile against it.
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let probe = out.join("probe.c");
    std::fs::write(
        &probe,
        "#include \"embree4.h\"\nembree_native_is EMBREE4_SYS_NATIVE\nembree_version_is RTC_VERSION_STRING\n",
    )
    .expect("OUT_DIR is writable");
    let mut cc = cc::Build::new();
    cc.include("c").includes(&include);
    let expanded =
        String::from_utf8(cc.clone().file(&probe).expand()).expect("the preprocessor writes UTF-8");
    let word_after = |name: &str| {
        // The preprocessor may put line markers (`# 4 "probe.c"`) between the words.
        let after = expanded.split(name).nth(1)?;
        let line = after
            .lines()
            .map(str::trim)
            .find(|l| !l.is_empty() && !l.starts_with('#'))?;
        Some(line.trim_matches('"').to_owned())
    };
    let native = word_after("embree_native_is");
    // DEP_EMBREE_VERSION for dependents.
    println!(
        "cargo::metadata=version={}",
        word_after("embree_version_is").expect("the headers define RTC_VERSION_STRING")
    );
    let v3 = match native.as_deref() {
        Some("4") => false,
        Some("3") => true,
        other => panic!("cannot tell the Embree version: {other:?}"),
    };
    println!("cargo::metadata=native={}", native.expect("matched above")); // DEP_EMBREE_NATIVE for dependents
    if v3 {
        println!("cargo::rustc-cfg=embree3");
        cc.clone()
            .file("c/on3.c")
            .warnings(true)
            .flag_if_supported("-Wno-unused-parameter")
            .compile("embree4_on_3");
    }
    println!(
        "cargo::rustc-link-lib=dylib={}",
        if v3 { "embree3" } else { "embree4" }
    );

    let mut b = bindgen::Builder::default()
        .header("c/embree4.h")
        .allowlist_function("rtc.*")
        .allowlist_type("RTC.*")
        .allowlist_var("RTC_.*")
        // Gone in 4, so gone here.
        .blocklist_function("rtc(Intersect|Occluded)(1M|1Mp|NM|Np)|rtcFilter(Intersection|Occlusion)")
        .blocklist_item("RTC_INTERSECT_CONTEXT_.*|RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION|RTC_DEVICE_PROPERTY_RAY_STREAM_SUPPORTED|RTC(Ray|Hit|RayHit)Np")
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        .derive_default(true)
        .layout_tests(true)
        .size_t_is_usize(true)
        .use_core()
        .formatter(bindgen::Formatter::None);
    if let Some(dir) = &include {
        b = b.clang_arg(format!("-I{}", dir.display()));
    }
    b.generate()
        .expect("bindgen reads Embree's headers")
        .write_to_file(out.join("bindings.rs"))
        .expect("OUT_DIR is writable");
}
