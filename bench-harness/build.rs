//! Hands the compiler's version to the program, so that reports can name it, and a hash of the sources that make octrees and exact
//! answers, by which the cache of `esvo bench sweep` knows what is out of date.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::path::Path;

/// What octrees and exact answers depend on, beside their input. Where this crate was not built in its repository, they are missing,
/// and the version of the package stands for them.
const MAKERS: [&str; 6] = [
    "../builder/src",
    "../format/src",
    "../backends/cpu/src/triangles",
    "../backends/core/src/exact.rs",
    "src/picture_bench/cutout.rs",
    "src/picture_bench/mesh_picture.rs",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=RUSTC");
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    if let Ok(out) = std::process::Command::new(rustc).arg("--version").output() {
        println!("cargo::rustc-env=ESVO_RUSTC_VERSION={}", String::from_utf8_lossy(&out.stdout).trim());
    }
    let mut hash = DefaultHasher::new();
    std::env::var("CARGO_PKG_VERSION").unwrap_or_default().hash(&mut hash);
    for maker in MAKERS.map(Path::new).into_iter().filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", maker.display());
        add(maker, &mut hash);
    }
    println!("cargo::rustc-env=ESVO_MAKERS={:016x}", hash.finish());
}

/// Adds a file, or all files of a folder in the order of their names.
fn add(path: &Path, hash: &mut DefaultHasher) {
    let Ok(entries) = std::fs::read_dir(path) else {
        return std::fs::read(path).unwrap_or_default().hash(hash);
    };
    let mut inside: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    inside.sort();
    inside.iter().for_each(|path| add(path, hash));
}
