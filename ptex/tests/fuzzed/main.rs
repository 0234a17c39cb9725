//! The bodies of the fuzz targets, on their seeds and on changes of these that are the same every time: a short run
//! without a fuzzer. `RELIEVO_EFFORT` scales how many; `make fuzz` goes where coverage leads.
#![allow(unreachable_pub, reason = "a test binary has no outside")]
#![allow(clippy::print_stdout, reason = "tests say what they did")]

mod file;
mod lookups;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;

/// A generator of Vigna's (xorshift64*).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// Below a number that is not 0.
    fn below(&mut self, end: usize) -> usize {
        ((self.next() >> 32) as usize) % end
    }
}

/// The files of a folder of seeds, by name.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fuzz/seeds")
        .join(name);
    let files = std::fs::read_dir(folder).expect("seeds").flatten();
    let mut paths: Vec<_> = files.map(|file| file.path()).collect();
    paths.sort();
    assert!(!paths.is_empty());
    (paths.iter())
        .map(|path| std::fs::read(path).expect("a seed"))
        .collect()
}

/// Changes bytes in one to four places, as fuzzers do.
fn change(bytes: &mut Vec<u8>, others: &[Vec<u8>], random: &mut Random) {
    const NUMBERS: [u32; 8] = [
        0,
        1,
        0x7f,
        0xff,
        0xffff,
        0x7fff_ffff,
        0x8000_0000,
        0xffff_ffff,
    ];
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            bytes.push(random.next() as u8);
        }
        let at = random.below(bytes.len());
        let most = (bytes.len() - at).min(1 + random.below(32));
        match random.below(8) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.next() as u8,
            2 => {
                let step = random.below(9) as u8;
                bytes[at] = bytes[at].wrapping_add(step).wrapping_sub(4);
            }
            3 => {
                let number = NUMBERS[random.below(NUMBERS.len())].to_le_bytes();
                let size = most.min([1, 2, 4][random.below(3)]);
                bytes[at..at + size].copy_from_slice(&number[..size]);
            }
            4 => drop(bytes.drain(at..at + most)),
            5 => {
                let from = random.below(bytes.len());
                let piece: Vec<u8> = bytes[from..].iter().take(most).copied().collect();
                bytes.splice(at..at, piece);
            }
            6 => {
                let other = &others[random.below(others.len())];
                let from = random.below(other.len());
                let piece: Vec<u8> = other[from..].iter().take(most).copied().collect();
                bytes.splice(at..at + most, piece);
            }
            _ => bytes.truncate(at + 1),
        }
    }
}

/// Runs a body on seeds, and on `count` changes of them. Whatever makes it panic is written to a file for the fuzzer.
fn run(name: &str, seeds: &[Vec<u8>], count: u64, body: impl Fn(&[u8])) {
    let effort = std::env::var("RELIEVO_EFFORT").map_or(1.0, |text| {
        text.parse::<f64>().expect("RELIEVO_EFFORT is a number")
    });
    let count = (count as f64 * effort) as u64;
    let attempt = |bytes: &[u8]| {
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| body(bytes))) {
            let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.fuzz"));
            std::fs::write(&path, bytes).expect("the folder takes files");
            println!("{name}: what does it is in {}", path.display());
            resume_unwind(panic);
        }
    };
    for seed in seeds {
        attempt(seed);
    }
    for number in 0..count {
        // Each by its own number: what fails once fails alone, too.
        let mut random = Random(0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(number + 1) | 1);
        random.next();
        let mut bytes = seeds[random.below(seeds.len())].clone();
        change(&mut bytes, seeds, &mut random);
        attempt(&bytes);
    }
    println!("{name}: {} seeds, {count} changes", seeds.len());
}

#[test]
fn changed_files_are_read_or_refused() {
    run("ptex", &seeds("ptex"), 8_000, file::run);
}

#[test]
fn files_of_changed_blocks_are_read_or_refused() {
    // What does not begin with a P is compressed first: see `file`.
    let mut blocks = seeds("ptex");
    blocks.iter_mut().for_each(|seed| seed[0] = 4);
    let mut random = Random(1978);
    for _ in 0..64 {
        let size = 8 + random.below(400);
        let mut seed: Vec<u8> = (0..size).map(|_| random.next() as u8).collect();
        seed[0] &= 0x1f;
        blocks.push(seed);
    }
    run("ptex_blocks", &blocks, 8_000, file::run);
}

#[test]
fn lookups_in_any_mesh_stay_within_their_bounds() {
    run("ptex_filter", &seeds("ptex_filter"), 2_000, lookups::run);
}
