//! Compiles the C border against the installed OpenSubdiv (Debian: libosd-dev).

fn main() {
    println!("cargo:rerun-if-changed=c");
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .opt_level(3)
        // Its headers assert a lot.
        .define("NDEBUG", None)
        .warnings(true)
        .extra_warnings(true)
        .file("c/far_border.cpp")
        .compile("far_border");
    println!("cargo:rustc-link-lib=dylib=osdCPU");
}
