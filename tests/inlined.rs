//! No vector instruction is a call. What is compiled for an instruction set is inlined into its entry (`accel::simd`); a closure
//! that the compiler keeps to itself is not, each instruction in it becomes a function, and nothing but speed tells.

use std::process::Command;

#[test]
fn no_vector_instruction_is_a_function() {
    const TEST: &str = "no_vector_instruction_is_a_function";
    if cfg!(debug_assertions) {
        println!("SKIPPED {TEST}: only what is optimised is inlined");
        return;
    }
    let program = env!("CARGO_BIN_EXE_relievo");
    let output = match Command::new("nm").arg("-C").arg(program).output() {
        Ok(output) if output.status.success() => output.stdout,
        _ => {
            println!("SKIPPED {TEST}: nm of the binutils is not there");
            return;
        }
    };
    let symbols = String::from_utf8_lossy(&output);
    assert!(symbols.contains("run_avx2") || cfg!(not(target_arch = "x86_64")));
    let of_ours = |line: &&str| {
        let sets = ["avx::", "avx2::", "fma::", "avx512"];
        let name = line.split("core_arch::x86::").nth(1);
        name.is_some_and(|name| sets.iter().any(|set| name.starts_with(set)))
    };
    let functions: Vec<&str> = symbols.lines().filter(of_ours).collect();
    assert!(functions.is_empty(), "{functions:#?}");
}
