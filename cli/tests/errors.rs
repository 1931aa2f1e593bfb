//! Bad input: each gives one clear error and an exit code, and leaves no partial files.

mod common;

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use common::{BOX, Folder};

#[test]
fn usage_errors_are_named() {
    let folder = Folder::with_octree();
    folder.fails(&["build", "box.obj", "-o", "x.esvo", "--levels", "0"], 2, "1..=23");
    folder.fails(&["build", "box.obj", "-o", "x.esvo", "--levels", "30"], 2, "1..=23");
    folder.fails(&["build", "box.obj"], 2, "--output");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--backend", "cuda"], 2, "reference, cpu, wgpu, ash");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--size", "0x9"], 2, "1x1 to 16384x16384");
    folder.fails(&["bench", "--levels", "24"], 2, "1..=23");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--filter", "strong"], 2, "adapted, own, off");
    folder.fails(&["kernel", "--levels", "24"], 2, "1..=23");
    folder.fails(&["kernel", "--workgroup", "7x8"], 1, "powers of two");
    folder.fails(&["bench", "--backends", "metal"], 2, "metal");
    folder.fails(&["frobnicate"], 2, "frobnicate");
}

#[test]
fn settings_out_of_range() {
    let folder = Folder::with_octree();
    folder.fails(&["build", "box.obj", "-o", "x.esvo", "--color-error=-1"], 1, "color-error");
    folder.fails(&["build", "box.obj", "-o", "x.esvo", "--normal-error", "nan"], 1, "normal-error");
    folder.fails(&["build", "box.obj", "-o", "x.esvo", "--paper", "teapot"], 1, "sibenik");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--camera", "1,2,3"], 1, "six numbers");
    folder.fails(
        &["render", "box.esvo", "-o", "x.png", "--camera", "0,0,0,0,0,0"],
        1,
        "the direction (fourth to sixth number) is zero",
    );
    folder.fails(
        &["render", "box.esvo", "-o", "x.png", "--camera", "0,0,0,0,1,0"],
        1,
        "--up 0,1,0: is parallel to the viewing direction",
    );
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--camera", "1e200,0,0,0,0,1"], 1, "too far away");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--camera", "0,0,0,0,0,1,190"], 1, "between 0 and 180");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--up", "0,0,0"], 1, "--up 0,0,0: is not a direction");
    folder.fails(
        &["render", "box.esvo", "-o", "x.png", "--up", "0,1"],
        1,
        "--up 0,1: expected three numbers, e.g. 0,1,0",
    );
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--fov", "180"], 1, "between 0 and 180");
    folder.fails(
        &["render", "box.esvo", "-o", "x.png", "--max-voxel-pixels=-2"],
        1,
        "--max-voxel-pixels -2: expected 0 or a positive number",
    );
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--scene", "hairball", "--view", "99"], 1, "views 1 to");
    folder.fails(&["render", "box.esvo", "-o", "x.png", "--scene", "teapot"], 1, "unknown");
}

#[test]
fn options_that_contradict_each_other() {
    let folder = Folder::with_octree();
    for options in [
        &["--no-contours", "--contour-error", "12"][..],
        &["--no-colors", "--color-error", "12"],
        &["--no-normals", "--normal-error", "0.1"],
        &["--preset", "fast", "--paper", "sibenik"],
    ] {
        folder.fails(&[&["build", "box.obj", "-o", "x.esvo"], options].concat(), 2, "cannot be used with");
    }
    let scene = ["build", "-o", "x.esvo", "--scene", "fairy"];
    folder.fails(&[&scene[..], &["--stand-in", "--scenes-dir", "."]].concat(), 2, "cannot be used with");
    folder.fails(&[&scene[..], &["--manifest", "a.toml", "--scenes-dir", "."]].concat(), 2, "cannot be used with");
    let render = ["render", "box.esvo", "-o", "x.png"];
    folder.fails(&[&render[..], &["--scene", "fairy", "--up", "0,0,1"]].concat(), 2, "cannot be used with");
    let twice = ["--camera=0,0,9,0,0,-1,50", "--fov", "60"];
    folder.fails(&[&render[..], &twice].concat(), 1, "give only one of them");
}

#[test]
fn the_advice_on_up_is_not_parallel_either() {
    let folder = Folder::with_octree();
    for (direction, up) in [("0,0,1", "0,0,1"), ("0,1,0", "0,1,0"), ("1,0,0", "1,0,0"), ("1,1,1", "-1,-1,-1")] {
        let camera = format!("--camera=0,0,0,{direction}");
        let out = folder.run(&["render", "box.esvo", "-o", "x.png", &camera, "--size", "4x4", &format!("--up={up}")]);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        let advice = error.trim_end().rsplit(' ').next().unwrap();
        folder.ok(&["render", "box.esvo", "-o", "x.png", &camera, "--size", "4x4", "--up", advice]);
    }
}

#[cfg(unix)]
#[test]
fn a_link_to_nothing_is_no_output() {
    let folder = Folder::with_octree();
    std::os::unix::fs::symlink("absent/x.esvo", folder.path("link.esvo")).unwrap();
    folder.fails(&["build", "box.obj", "-o", "link.esvo"], 1, "is a link to absent/x.esvo, which does not exist");
    // A link to a file is written through.
    std::os::unix::fs::symlink("box.esvo", folder.path("good.esvo")).unwrap();
    folder.ok(&["build", "box.obj", "-o", "good.esvo", "-l", "4"]);
    assert!(folder.path("good.esvo").is_symlink());
}

#[cfg(target_os = "linux")]
#[test]
fn pictures_without_memory_are_one_line() {
    let folder = Folder::with_octree();
    let script =
        format!("ulimit -v 3000000; exec {} render box.esvo -o x.png --size 16384x16384", env!("CARGO_BIN_EXE_esvo"));
    let out = std::process::Command::new("sh").args(["-c", &script]).current_dir(folder.path("")).output().unwrap();
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(1), "{error}");
    assert!(error.starts_with("error: --size 16384x16384: needs ") && error.lines().count() == 1, "{error}");
    assert!(!folder.path("x.png").exists());
}

#[test]
fn large_builds_say_first_what_they_expect() {
    let folder = Folder::with_octree();
    let mut command = folder.command(&["build", "box.obj", "-o", "deep.esvo", "--levels", "23"]);
    let mut build = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(build.stderr.take().unwrap()).read_line(&mut line).unwrap();
    build.kill().unwrap();
    build.wait().unwrap();
    assert!(line.starts_with("note: 23 levels: up to about "), "{line}");
    assert!(line.contains("e14 voxels and ") && line.contains("--contour-error"), "{line}");
    let out = folder.run(&["build", "box.obj", "-o", "deep.esvo", "--levels", "9"]);
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
}

#[cfg(target_os = "linux")]
#[test]
fn work_without_memory_is_one_line() {
    let folder = Folder::with_octree();
    let run = |kilobytes: u32, arguments: &str| {
        let script = format!("ulimit -v {kilobytes}; exec {} {arguments}", env!("CARGO_BIN_EXE_esvo"));
        std::process::Command::new("sh").args(["-c", &script]).current_dir(folder.path("")).output().unwrap()
    };
    // Finds limits at which the program starts, and the work does not fit.
    for work in ["build --scene hairball --stand-in -l 8 -o out.esvo", "ambient box.esvo --rays 4 -o out.esvo"] {
        let mut refused = 0;
        for kilobytes in [40_000, 60_000, 90_000, 120_000, 150_000] {
            let out = run(kilobytes, work);
            let error = String::from_utf8_lossy(&out.stderr).into_owned();
            if out.status.success() {
                std::fs::remove_file(folder.path("out.esvo")).unwrap();
                continue;
            }
            // The system's loader has no room for the libraries: the program did not start.
            if out.status.code() == Some(127) {
                continue;
            }
            // Smaller limits may also refuse a thread.
            assert_eq!(out.status.code(), Some(1), "{work}, {kilobytes}: {error}");
            assert!(error.starts_with("error: ") && error.lines().count() == 1, "{work}, {kilobytes}: {error}");
            refused += u32::from(error.contains("the system refuses"));
            assert_eq!(folder.files(), ["box.esvo", "box.obj"]);
        }
        println!("{work}: refused {refused} times");
        assert!(refused > 0 || !work.starts_with("build"), "{work}: no limit was too small");
    }
}

#[test]
fn meshes() {
    let folder = Folder::new();
    let build = |name: &str, what: &str| folder.fails(&["build", name, "-o", "x.esvo"], 1, what);
    build("absent.obj", "absent.obj");
    build(".", "not a regular file");
    folder.put("empty.obj", "");
    build("empty.obj", "empty");
    folder.put("mesh.step", BOX);
    build("mesh.step", ".obj");
    folder.put("none.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    build("none.obj", "no triangles");
    folder.put("nan.obj", BOX.replacen("v 2 0 0", "v nan 0 0", 1));
    build("nan.obj", "nan.obj");
    folder.put("text.glb", BOX);
    build("text.glb", "text.glb");
    folder.put("short.gltf", r#"{"asset": {"version": "2.0"}, "meshes": ["#);
    build("short.gltf", "short.gltf");
}

#[test]
fn a_missing_texture_is_a_warning() {
    let folder = Folder::new();
    folder.put("box.obj", format!("mtllib box.mtl\nusemtl wood\nvt 0 0\n{BOX}"));
    folder.put("box.mtl", "newmtl wood\nKd 0.5 0.4 0.3\nmap_Kd absent.png\n");
    let out = folder.run(&["build", "box.obj", "-o", "box.esvo", "--levels", "4"]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{error}");
    assert!(error.starts_with("warning: ") && error.contains("absent.png"), "{error}");
    assert!(folder.files().contains(&"box.esvo".to_string()));
}

#[test]
fn a_broken_texture_is_a_warning_that_says_what_to_do() {
    let folder = Folder::new();
    folder.put(
        "box.obj",
        format!("mtllib box.mtl\nusemtl wood\nvt 0 0\n{}", BOX.replace("f 1 2 3 4", "f 1/1 2/1 3/1 4/1")),
    );
    folder.put("box.mtl", "newmtl wood\nmap_Kd bad.png\n");
    folder.put("bad.png", "not a picture");
    let out = folder.run(&["build", "box.obj", "-o", "x.esvo", "--levels", "4"]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{error}");
    let what = "bad.png cannot be decoded: it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, JPEG or WebP; using a plain colour";
    assert!(error.starts_with("warning: ") && error.contains(what), "{error}");
}

#[test]
fn files_of_the_wrong_kind() {
    let folder = Folder::with_octree();
    let every = |name: &str, what: &str| {
        folder.fails(&["info", name], 1, what);
        folder.fails(&["render", name, "-o", "x.png"], 1, what);
        // Findings go to standard output; the error only says that there are findings.
        let out = folder.run(&["validate", name]);
        assert_eq!(out.status.code(), Some(1), "{name}");
        let all = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
        assert!(all.contains(name), "{all}");
    };
    every("absent.esvo", "absent.esvo");
    every(".", "regular file");
    folder.put("empty.esvo", "");
    every("empty.esvo", "too short");
    every("box.obj", "box.obj: ");
    let whole = std::fs::read(folder.path("box.esvo")).unwrap();
    folder.put("half.esvo", &whole[..whole.len() / 2]);
    every("half.esvo", "half.esvo: ");
    folder.put("header.esvo", &whole[..40]);
    every("header.esvo", "too short");
    for name in ["absent.esvo", "half.esvo"] {
        let named = |arguments: &[&str]| folder.fails(&[arguments, &[name]].concat(), 1, &format!("error: {name}: "));
        named(&["bench", "format"]);
        named(&["dump"]);
        named(&["diff", "box.esvo"]);
        named(&["convert", "-o", "x.oct"]);
        named(&["ambient", "-o", "x.esvo"]);
    }
}

#[test]
fn files_of_another_kind_are_called_by_their_names() {
    let folder = Folder::with_octree();
    folder.put("old.oct", "Octree");
    for command in [&["info"][..], &["validate"], &["dump"], &["diff", "box.esvo"], &["render", "-o", "x.png"]] {
        let with = |file: &'static str| [command, &[file]].concat();
        folder.fails(
            &with("box.obj"),
            1,
            "box.obj: is a mesh, not an octree; build an octree from it first: esvo build box.obj",
        );
        folder.fails(&with("old.oct"), 1, "convert it first: esvo convert old.oct -o old.esvo");
    }
    folder.fails(&["convert", "box.obj", "-o", "x.esvo"], 1, "box.obj: is a mesh");
    folder.fails(&["build", "box.esvo", "-o", "x.esvo"], 1, "box.esvo: is an octree already");
    folder.fails(&["build", "box.obj", "-o", "x.png"], 1, "x.png: octrees are written as .esvo");
    folder.fails(&["build", "box.obj", "-o", "x"], 1, "ends in .esvo");
    folder.fails(&["build", "box.obj", "-o", "x.oct"], 1, "esvo convert makes .oct files from them");
    folder.fails(&["render", "box.esvo", "-o", "x.jpg"], 1, "x.jpg: pictures are written as PNG");
    folder.fails(&["render", "box.esvo", "-o", "x"], 1, "ends in .png");
}

#[test]
fn a_camera_that_sees_nothing_is_told_where_the_object_is() {
    let folder = Folder::with_octree();
    let out = folder.run(&["render", "box.esvo", "-o", "x.png", "--size", "8x8", "--camera", "0,0,90,0,0,1"]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && error.contains("no ray hits anything: the object lies between ["), "{error}");
}

#[test]
fn flipped_bits_are_found_or_harmless() {
    let folder = Folder::with_octree();
    let whole = std::fs::read(folder.path("box.esvo")).unwrap();
    // A multiplicative step covers header, tables and block data.
    let mut found = 0;
    for k in 0..24usize {
        let bit = k.wrapping_mul(0x9E37_79B9) % (whole.len() * 8);
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        folder.put("flipped.esvo", &bytes);
        let out = folder.run(&["validate", "flipped.esvo"]);
        assert!(matches!(out.status.code(), Some(0 | 1)), "bit {bit}: {:?}", out.status);
        found += usize::from(out.status.code() == Some(1));
        let out = folder.run(&["render", "flipped.esvo", "-o", "flipped.png", "--size", "16x16"]);
        assert!(matches!(out.status.code(), Some(0 | 1)), "bit {bit}: {:?}", out.status);
        let _ = std::fs::remove_file(folder.path("flipped.png"));
    }
    // Checksums cover everything except the gaps between sections.
    assert!(found >= 20, "{found} of 24");
}

#[test]
fn output_that_cannot_be_written() {
    let folder = Folder::with_octree();
    let both = |output: &str, what: &str| {
        folder.fails(&["build", "box.obj", "-o", output, "--levels", "4"], 1, what);
        folder.fails(&["render", "box.esvo", "-o", output], 1, what);
    };
    both("absent/x.y", "does not exist");
    both(".", "folder");
    if cfg!(unix) {
        both("/dev/full", "not a regular file");
    }
}

#[test]
fn an_output_that_fails_leaves_what_was_there() {
    let folder = Folder::with_octree();
    let before = std::fs::read(folder.path("box.esvo")).unwrap();
    folder.put("bad.obj", BOX.replacen("v 2 0 0", "v inf 0 0", 1));
    folder.fails(&["build", "bad.obj", "-o", "box.esvo"], 1, "bad.obj");
    assert_eq!(std::fs::read(folder.path("box.esvo")).unwrap(), before);
}

#[test]
#[cfg(unix)]
fn a_full_standard_output_is_an_error_and_a_closed_one_is_not() {
    let folder = Folder::with_octree();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
    if let Ok(full) = full {
        let out = folder.command(&["info", "box.esvo"]).stdout(full).output().unwrap();
        assert_eq!(out.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&out.stderr).starts_with("error: standard output"));
    }
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let out = folder.command(&["info", "box.esvo"]).stdout(writer).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&out.stderr), "");
    assert_eq!(out.status.code(), Some(0));
}

#[test]
fn benches_that_cannot_be_run() {
    let folder = Folder::new();
    folder.fails(&["bench", "--scenes", "teapot"], 1, "the scenes are");
    folder.fails(&["bench", "--scenes", "sibenik-d"], 1, "it has no stand-in");
    folder.fails(&["bench", "--scenes-dir", "absent"], 1, "absent");
    folder.fails(&["bench", "--matrix", "absent.toml"], 1, "absent.toml");
    folder.put("bad.toml", "name = \"bad\"\nviews = \"two\"\n");
    folder.fails(&["bench", "--matrix", "bad.toml"], 1, "bad.toml: line 2");
    folder.fails(&["bench", "--memory", "0"], 1, "memory_gb");
    folder.fails(&["bench", "--views", "0"], 1, "at least 1");
    folder.fails(&["bench", "--out", "bad.toml/results"], 1, "bad.toml");
    folder.fails(&["bench", "--time-limit=-1"], 1, "time_limit_seconds");
    folder.fails(&["bench", "pictures", "--scenes", "teapot", "--out", "made"], 1, "there are SIBENIK-D, ");
}

#[test]
fn displacements_out_of_range() {
    let folder = Folder::new();
    // A square with a height map: two by two texels of an uncompressed TGA.
    let mut tga = vec![0, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 8, 0];
    tga.extend([0, 255, 255, 0]);
    folder.put("height.tga", tga);
    folder.put("wall.mtl", "newmtl stone\nmap_bump height.tga\n");
    let corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
    folder.put("wall.obj", format!("mtllib wall.mtl\n{corners}usemtl stone\nf 1/1 2/2 3/3 4/4\n"));
    let build = |more: &[&'static str]| [&["build", "wall.obj", "-o", "wall.esvo", "--levels", "4"], more].concat();
    folder.fails(&build(&["--displace", "1e300"]), 1, "--displace: displacement is up to 1e300 in a mesh whose");
    folder.fails(&build(&["--displace", "much"]), 2, "expected a number of mesh units");
    folder.fails(&build(&["--height-map", "wood=height.tga"]), 1, "the mesh has no material wood; it has stone");
    folder.fails(&build(&["--height-map", "stone=absent.png"]), 1, "absent.png: cannot be read");
    // An option that follows is not its number.
    folder.ok(&build(&["--displace", "--no-colors"]));
    folder.ok(&build(&["--displace", "-0.05"]));
}
