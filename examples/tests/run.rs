//! Runs every example as a user would, and looks at what it prints.

use std::path::PathBuf;
use std::process::Command;

/// Runs an example that was built with this test and returns what it printed.
fn run(name: &str, arguments: &[&str]) -> String {
    let test = std::env::current_exe().unwrap();
    let folder = test.parent().and_then(|deps| deps.parent()).unwrap();
    let program: PathBuf = folder.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    let out = Command::new(&program).args(arguments).output().unwrap_or_else(|e| panic!("{}: {e}", program.display()));
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(out.status.success(), "{name}: {text}{}", String::from_utf8_lossy(&out.stderr));
    text
}

#[test]
fn read_leaves() {
    let text = run("read_leaves", &[]);
    // Colours are compressed, so that red is not quite 1.
    assert!(text.starts_with("[0.0000, 0.0000, 0.0000] [1.0000, 1.0000, 1.0000] Some([0.9"), "{text}");
    assert!(text.ends_with("2 leaf voxels\n"), "{text}");
}

#[test]
fn render_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.png");
    let text = run("render_picture", &[path.to_str().unwrap()]);
    let picture = esvo_core::picture::read_picture(&path).unwrap();
    assert_eq!((picture.width, picture.height), (640, 480));
    // The torus fills a good part of the picture, and its hole is seen.
    let hit: u32 = text.split(": ").nth(1).and_then(|t| t.split(' ').next()).unwrap().parse().unwrap();
    assert!((60_000..200_000).contains(&hit), "{text}");
}

#[test]
fn cast_rays() {
    let text = run("cast_rays", &[]);
    assert!(text.starts_with("10000 of 10000 rays hit; the first one after 0.25"), "{text}");
    assert!(text.contains("normal [-0.00, 1.00, 0.00]") || text.contains("normal [0.00, 1.00, 0.00]"), "{text}");
    // From the lamp, the board covers a square of 0.8 on the floor: 1600 points, give or take those at its rim.
    let dark: u32 = text.lines().last().and_then(|line| line.split(' ').next()).unwrap().parse().unwrap();
    assert!((1560..=1640).contains(&dark), "{text}");
    assert_eq!(run("cast_rays", &["reference"]).replace("reference", "cpu"), text);
}

#[test]
fn stream_region() {
    let text = run("stream_region", &[]);
    let number = |line: &str| line.split(' ').next().unwrap().parse::<u64>().unwrap();
    let (first, last) = (text.lines().next().unwrap(), text.lines().last().unwrap());
    assert!(number(last) * 2 < number(first), "a corner takes less than half of the file: {text}");
}

#[test]
fn own_backend() {
    assert!(run("own_backend", &[]).contains(" rays end at another voxel"));
}

#[test]
fn measure_own_caster() {
    let text = run("measure_own_caster", &[]);
    // A row of its own in the checks, in Table 2, and in the stability suite.
    let rows = |start: &str| text.lines().filter(|line| line.trim_start().starts_with(start)).count();
    assert!(rows("recursive") >= 2, "{text}");
    assert!(text.contains("Table 2") && text.contains("with beam") && !text.contains("FAILED"), "{text}");
}
