//! Runs the bodies of the fuzz targets on the committed seeds and on the test vectors, without a nightly compiler.

use std::fs;
use std::path::{Path, PathBuf};

#[allow(unreachable_pub, reason = "the fuzz targets use it as a crate")]
#[path = "../../fuzz/src/lib.rs"]
mod fuzz;

fn folder(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// All files of a folder, in order.
fn inputs(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read(&path).unwrap())).collect()
}

fn replay(target: fn(&[u8]), inputs: &[(PathBuf, Vec<u8>)]) {
    for (path, bytes) in inputs {
        let result = std::panic::catch_unwind(|| target(bytes));
        assert!(result.is_ok(), "{}", path.display());
    }
}

#[test]
fn every_target_survives_its_seeds() {
    for (name, target) in fuzz::TARGETS {
        let seeds = inputs(&folder("fuzz/seeds").join(name));
        assert!(seeds.len() >= 5, "only {} seeds for {name}", seeds.len());
        replay(target, &seeds);
    }
}

#[test]
fn every_target_survives_every_vector() {
    let mut vectors = inputs(&folder("spec/v1/vectors/valid"));
    vectors.extend(inputs(&folder("spec/v1/vectors/invalid")));
    assert!(vectors.len() > 100);
    for (_, target) in fuzz::TARGETS {
        replay(target, &vectors);
    }
}
