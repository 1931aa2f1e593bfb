//! `esvo build --voxelizer` and `esvo bench voxelize`.
#![cfg(feature = "wgpu")]

mod common;

use common::Folder;
use serde_json::Value;

/// Whether there is a device; without one the tests are skipped, unless one is required.
fn has_device(folder: &Folder) -> bool {
    let built =
        folder.run(&["build", "box.obj", "-o", "try.esvo", "-l", "2", "--no-contours", "--voxelizer", "compute"]);
    if !built.status.success() && std::env::var_os("ESVO_REQUIRE_GPU").is_none() {
        println!("skipped: {}", String::from_utf8_lossy(&built.stderr));
        return false;
    }
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    true
}

#[test]
fn a_gpu_builds_the_builders_voxels() {
    let folder = Folder::with_octree();
    if !has_device(&folder) {
        return;
    }
    folder.ok(&["build", "box.obj", "-o", "exact.esvo", "-l", "6", "--no-contours"]);
    for voxelizer in ["compute", "raster"] {
        folder.ok(&["build", "box.obj", "-o", "gpu.esvo", "-l", "6", "--no-contours", "--voxelizer", voxelizer]);
        folder.ok(&["validate", "gpu.esvo"]);
        assert_eq!(folder.ok(&["diff", "exact.esvo", "gpu.esvo", "--topology"]), "the same voxels\n", "{voxelizer}");
    }
    folder.ok(&["build", "box.obj", "-o", "gpu.esvo", "-l", "5", "--no-contours", "--voxelizer", "compute"]);
    assert_eq!(folder.run(&["diff", "exact.esvo", "gpu.esvo", "--topology"]).status.code(), Some(1));
}

#[test]
fn options_that_do_not_apply_are_refused() {
    let folder = Folder::with_octree();
    for (more, expected) in [
        (&["--voxelizer", "compute"][..], "add --no-contours"),
        (&["--voxelizer", "raster", "--no-contours", "--preset", "fast"], "--preset does not apply to --voxelizer"),
        (&["--voxelizer", "raster", "--no-contours", "--levels", "13"], "at most 12"),
    ] {
        let failed = folder.run(&[&["build", "box.obj", "-o", "bad.esvo"], more].concat());
        let error = String::from_utf8(failed.stderr).unwrap();
        assert!(!failed.status.success() && error.contains(expected), "{error}");
    }
    let failed = folder.run(&["bench", "voxelize", "--grids", "100"]);
    assert!(String::from_utf8_lossy(&failed.stderr).contains("expected a power of two from 2 to 4096"));
}

#[test]
fn the_benchmark_writes_a_record_and_pictures() {
    let folder = Folder::with_octree();
    if !has_device(&folder) {
        return;
    }
    let arguments = [
        "bench",
        "voxelize",
        "--scenes",
        "fairy",
        "--grids",
        "32",
        "--rounds",
        "1",
        "--out",
        "out",
        "--machine",
        "m",
        "--json",
    ];
    let record: Value = serde_json::from_str(&folder.ok(&arguments)).unwrap();
    let methods = record["scenes"][0]["grids"][0]["methods"].as_array().unwrap();
    let of = |letter: &str| methods.iter().find(|method| method["letter"] == letter).unwrap();
    assert!(of("b")["holes"].as_u64() > Some(0) && of("g")["extra"] == 0 && of("g")["holes"] == 0, "{methods:?}");
    let made = std::fs::read_dir(folder.path("out/m")).unwrap().next().unwrap().unwrap().path();
    for file in
        ["report.json", "tables.md", "error.svg", "triangles.svg", "pixels-expanded.png", "voxels-steep-fixed-axis.png"]
    {
        assert!(made.join(file).exists(), "{file}");
    }
    let again = folder.ok(&[
        "bench",
        "--repeat",
        made.join("report.json").to_str().unwrap(),
        "--out",
        "again",
        "--machine",
        "m",
    ]);
    assert!(again.contains("esvo bench voxelize"), "{again}");
    let page = folder.path("page.html");
    folder.ok(&["bench", "page", made.to_str().unwrap(), "-o", page.to_str().unwrap()]);
    let page = std::fs::read_to_string(page).unwrap();
    for shown in [
        "Voxelization on a GPU",
        "A steep plane, voxels of a grid of 32^3",
        ">expanded clipped<",
        "Holes by the size of triangles",
    ] {
        assert!(page.contains(shown), "{shown}");
    }
    assert_eq!(
        page.matches("data:image/png").count(),
        std::fs::read_dir(&made)
            .unwrap()
            .filter(|file| file.as_ref().unwrap().path().extension().is_some_and(|e| e == "png"))
            .count()
    );
    let failed = folder.run(&["bench", "voxelize", "--scenes", "fairy", "--methods", "z", "--out", "out"]);
    assert!(String::from_utf8_lossy(&failed.stderr).contains("there is no method z"));
}
