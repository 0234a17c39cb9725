//! Stamps the versions of the libraries into the program: `relievo --version` and every picture name them.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // The sys crates say which library they were built against (`cargo::metadata` of their build scripts).
    for (variable, name) in [
        ("RELIEVO_EMBREE", "DEP_EMBREE_VERSION"),
        ("RELIEVO_OIIO", "DEP_RELIEVO_OPENIMAGEIO_VERSION"),
    ] {
        let version = std::env::var(name).unwrap_or_else(|_| "unknown".into());
        println!("cargo::rustc-env={variable}={version}");
    }
}
