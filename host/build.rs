//! Stamps the build with a fingerprint of its sources, so that `screed` and `screed-rt` can tell whether they belong together.

use std::fs;
use std::path::{Path, PathBuf};

fn main() {
    let mut files = Vec::new();
    for folder in ["src", "../kernel/src", "../fixtures/src"] {
        println!("cargo::rerun-if-changed={folder}");
        collect(Path::new(folder), &mut files);
    }
    files.sort();
    // FNV-1a, 64 bit.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in files.iter().filter_map(|file| fs::read(file).ok()).flatten() {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    println!("cargo::rustc-env=SCREED_BUILD={hash:016x}");
    tell_how_it_is_built();
}

/// For reports on what the program's times were measured with.
fn tell_how_it_is_built() {
    let of = |name: &str| std::env::var(name).unwrap_or_default();
    let rustc = std::process::Command::new(of("RUSTC")).arg("--version").output();
    let rustc = rustc.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default();
    println!("cargo::rustc-env=SCREED_RUSTC={rustc}");
    for (name, variable) in [
        ("SCREED_TARGET", "TARGET"),
        ("SCREED_PROFILE", "PROFILE"),
        ("SCREED_OPT_LEVEL", "OPT_LEVEL"),
        ("SCREED_RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS"),
    ] {
        println!("cargo::rustc-env={name}={}", of(variable));
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { collect(&path, files) } else { files.push(path) }
    }
}
