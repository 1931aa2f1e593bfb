//! Compares the encoders of colour and normal blocks with the method of the paper's authors, on the voxels of real scenes if
//! they are found: in `$ESVO_SCENES`, or next to the repository. The table of synthetic blocks and of scenes at nine levels:
//!
//! `cargo test --release -p esvo-builder --test encoders -- --ignored --nocapture`

use std::path::{Path, PathBuf};

use esvo_builder::import::load_mesh;
use esvo_builder::{BuildSettings, build};

#[path = "../../format/tests/encoders/authors.rs"]
mod authors;
#[path = "../../format/tests/encoders/blocks.rs"]
mod blocks;
#[path = "../../format/tests/encoders/compare.rs"]
mod compare;

const SCENES: [(&str, &str); 3] = [
    ("SIBENIK", "sibenik/sibenik.obj"),
    ("FLIGHT-HELMET", "flight-helmet/FlightHelmet.gltf"),
    ("JUNGLE", "jungle/scene.gltf"),
];

fn scenes_dir() -> PathBuf {
    match std::env::var_os("ESVO_SCENES") {
        Some(dir) => dir.into(),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
    }
}

/// The blocks of a scene; none if it is not found.
fn scene(file: &str, levels: u32) -> Option<(Vec<blocks::Colors>, Vec<blocks::Normals>)> {
    let path = scenes_dir().join(file);
    if !path.exists() {
        eprintln!("{file} is not found; not checked");
        return None;
    }
    let mesh = load_mesh(&path).unwrap_or_else(|e| panic!("{e}"));
    let settings = BuildSettings { levels, plain_attributes: true, ..BuildSettings::default() };
    let octree = build(&mesh, &settings, &|_| ()).unwrap_or_else(|e| panic!("{e}")).octree;
    Some(blocks::of_octree(&octree))
}

#[test]
fn real_scenes_are_encoded_no_less_accurately_than_by_the_authors_method() {
    for (name, file) in SCENES {
        let Some((colors, normals)) = scene(file, 6) else { continue };
        compare::colors(name, &colors, None);
        compare::normals(name, &normals, None);
    }
}

#[test]
#[ignore = "prints the tables of results; a minute"]
fn tables() {
    let columns = "blocks | RMS, ours | RMS, theirs | 99 %, ours | 99 %, theirs | ns per block, ours |";
    let [mut colors, mut normals] = ["colours, 1/255", "normals, degrees"]
        .map(|what| format!("| {what} | {columns}\n|:--|--:|--:|--:|--:|--:|--:|\n"));
    for (name, blocks) in blocks::color_sets(10_000) {
        compare::colors(name, &blocks, Some(&mut colors));
    }
    for (name, blocks) in blocks::normal_sets(10_000) {
        compare::normals(name, &blocks, Some(&mut normals));
    }
    for (name, file) in SCENES {
        let Some(of) = scene(file, 9) else { continue };
        compare::colors(name, &of.0, Some(&mut colors));
        compare::normals(name, &of.1, Some(&mut normals));
    }
    println!("\n{colors}\n{normals}");
}
