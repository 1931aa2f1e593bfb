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
    for file in [
        "report.json",
        "tables.md",
        "error.svg",
        "triangles.svg",
        "pixels-expanded.png",
        "voxels-steep-fixed-axis.png",
        "one-triangle-on-three-planes.png",
        "faces-by-their-axis.png",
        "three-voxels-of-one-pixel.png",
        "voxels-of-a-column.png",
    ] {
        assert!(made.join(file).exists(), "{file}");
    }
    let page = folder.path("page.html");
    folder.ok(&["bench", "page", made.to_str().unwrap(), "-o", page.to_str().unwrap()]);
    let page = std::fs::read_to_string(page).unwrap();
    for shown in [
        "Voxelization on a GPU",
        "A steep plane, voxels of a grid of 32^3",
        ">expanded clipped<",
        "Holes by the size of triangles",
        // Plots, with a point for each method and a line for each series.
        "in a grid of 32^3: wrong voxels against time",
        "Holes in a sheet of equal triangles",
        "parts per million wrong: 0 cracks, 0 holes, 0 extra",
        "class=\"series wide\"",
        "The axis that a triangle is projected along: x red, y green, z blue",
        ">three voxels of one pixel<",
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

#[test]
fn a_record_of_voxelization_is_run_again() {
    let folder = Folder::with_octree();
    if !has_device(&folder) {
        return;
    }
    let small = ["--scenes", "fairy", "--grids", "32", "--methods", "d,g", "--rounds", "1", "--no-pictures"];
    folder.ok(&[&["bench", "voxelize", "--out", "out", "--machine", "m"][..], &small].concat());
    let record = std::fs::read_dir(folder.path("out/m")).unwrap().next().unwrap().unwrap().path().join("report.json");
    let repeat = |record: &std::path::Path| {
        let failed = folder.run(&["bench", "--repeat", record.to_str().unwrap(), "--out", "again", "--machine", "m"]);
        let text = String::from_utf8_lossy(&[failed.stdout, failed.stderr].concat()).into_owned();
        (failed.status.code(), text)
    };
    let (code, text) = repeat(&record);
    assert!(code == Some(0) && text.contains("esvo bench voxelize"), "{text}");
    // Other voxels are told, and other times are not.
    let mut changed: Value = serde_json::from_slice(&std::fs::read(&record).unwrap()).unwrap();
    let method = &mut changed["scenes"][0]["grids"][0]["methods"][0];
    method["voxelize_ms"][0] = 1e9.into();
    method["voxels"] = 7.into();
    folder.put("changed.json", changed.to_string());
    let (code, text) = repeat(&folder.path("changed.json"));
    assert!(code == Some(1) && text.contains("methods[expanded-tested].voxels") && !text.contains("_ms"), "{text}");
}

#[test]
fn bad_input_is_one_line_and_nothing_is_written() {
    let folder = Folder::with_octree();
    folder.put("file", "text");
    folder.put("empty.obj", "");
    folder.put("junk.obj", [0u8, 159, 146, 150].repeat(100));
    folder.put("junk.esvo", [0u8, 159, 146, 150].repeat(100));
    folder.put("cut.glb", b"glTF\x02\0\0\0");
    folder.put("cut.ply", "ply\nformat ascii 1.0\nelement vertex 3\n");
    folder.put("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    let octree = std::fs::read(folder.path("box.esvo")).unwrap();
    folder.put("cut.esvo", &octree[..octree.len() / 2]);
    folder.put("empty.esvo", "");
    std::fs::create_dir(folder.path("folder")).unwrap();
    let bench = |more: &[&'static str]| [&["bench", "voxelize", "--no-pictures"][..], more].concat();
    folder.fails(&bench(&["--out", "file"]), 1, "file: is a file where a folder is needed");
    folder.fails(&bench(&["--out", "file/below"]), 1, "file: is a file where a folder is needed");
    folder.fails(&bench(&["--grids", "99999999999999999999"]), 2, "a power of two from 2 to 4096");
    folder.fails(&bench(&["--grids", "8192"]), 2, "a power of two from 2 to 4096");
    folder.fails(&bench(&["--rounds", "0"]), 2, "1..=1000");
    folder.fails(&bench(&["--time-limit=-1"]), 2, "expected seconds, at least 0");
    folder.fails(&bench(&["--methods", "z"]), 1, "--methods: there is no method z");
    for (bad, part) in [
        ("cut.esvo", "the file has "),
        ("empty.esvo", "the file has 0 bytes, too short for a header"),
        ("junk.esvo", "not an esvo file"),
        ("folder", "not a regular file"),
        ("box.obj", "is a mesh, not an octree; build an octree from it first"),
        ("absent.esvo", "No such file"),
    ] {
        folder.fails(&["diff", "box.esvo", bad, "--topology"], 1, &format!("{bad}: {part}"));
        folder.fails(&["diff", bad, "box.esvo", "--topology"], 1, &format!("{bad}: {part}"));
    }
    if !has_device(&folder) {
        return;
    }
    folder.fails(&bench(&["--device", "nothing"]), 1, "--device nothing: no Vulkan device");
    for voxelizer in ["compute", "raster"] {
        for (mesh, part) in [
            ("empty.obj", "is empty"),
            ("junk.obj", "is a binary file"),
            ("cut.glb", "the GLB container is truncated"),
            ("cut.ply", "line 4: the file ends within its header"),
            ("flat.obj", "mesh: none of its triangles has an area"),
            ("folder", "is not a regular file"),
            ("absent.obj", "cannot be read"),
            ("box.esvo", "is an octree already"),
        ] {
            folder.fails(
                &["build", mesh, "-o", "out.esvo", "-l", "4", "--no-contours", "--voxelizer", voxelizer],
                1,
                &format!("{mesh}: {part}"),
            );
        }
    }
}

#[test]
fn methods_that_a_device_lacks_are_left_out_and_none_is_an_error() {
    let folder = Folder::with_octree();
    if !has_device(&folder) {
        return;
    }
    let run =
        |methods: &str| folder.run(&["bench", "voxelize", "--scenes", "nothing", "--methods", methods, "--out", "out"]);
    // Scenes are looked at later.
    let says = |methods: &str| String::from_utf8(run(methods).stderr).unwrap();
    assert!(says("g").contains("scene nothing: unknown scene"), "{}", says("g"));
    let hardware = says("f");
    let lacks = hardware.contains("--methods: hardware: ") && hardware.contains("choose another method or device");
    assert!(lacks || hardware.contains("scene nothing"), "{hardware}");
    assert!(!folder.path("out").exists());
}
