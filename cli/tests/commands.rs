//! Every command on good input.

mod common;

use common::Folder;

#[test]
fn build_info_validate_render() {
    let folder = Folder::with_octree();
    let info = folder.ok(&["info", "box.esvo"]);
    assert!(info.contains("object 0: 6 levels, ") && info.contains(" KiB in memory, "), "{info}");
    assert!(info.contains(" 1 block\n"), "{info}");
    let json = folder.ok(&["info", "box.esvo", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["objects"][0]["levels"], 6);
    assert!(json["meta"]["source"] == "box.obj", "{json}");
    let validated = folder.ok(&["validate", "box.esvo"]);
    assert!(validated.contains("keeps every rule"), "{validated}");

    folder.ok(&["render", "box.esvo", "-o", "box.png", "--size", "64x48"]);
    let png = std::fs::read(folder.path("box.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"));
    assert_eq!(png[16..24], [0, 0, 0, 64, 0, 0, 0, 48]);
}

#[test]
fn the_engines_draw_the_same_picture() {
    let folder = Folder::with_octree();
    for mode in ["shaded", "normals", "depth"] {
        let picture = |backend: &str| {
            let arguments =
                ["render", "box.esvo", "-o", "p.png", "--size", "80x60", "--view-mode", mode, "--backend", backend];
            folder.ok(&arguments);
            std::fs::read(folder.path("p.png")).unwrap()
        };
        assert_eq!(picture("reference"), picture("cpu"), "{mode}");
    }
}

#[test]
fn all_objects_are_drawn() {
    let folder = Folder::with_octree();
    let two = esvo_core::testing::sample::two_objects().unwrap();
    two.write(&folder.path("two.esvo")).unwrap();
    for mode in ["shaded", "normals", "depth", "levels", "voxel-size", "ambient", "roughness", "material"] {
        let picture = |backend: &str| {
            let size = ["--size", "80x60", "--view-mode", mode, "--backend", backend];
            folder.ok(&[&["render", "two.esvo", "-o", "p.png"][..], &size].concat());
            esvo_core::picture::read_picture(&folder.path("p.png")).unwrap()
        };
        let (reference, cpu) = (picture("reference"), picture("cpu"));
        assert_eq!(reference, cpu, "{mode}");
        let colors: std::collections::HashSet<&[u8]> = reference.rgb8.chunks(3).collect();
        assert!(colors.len() > 1, "{mode} shows nothing");
    }
}

#[test]
fn lights_and_shadows_change_the_picture() {
    let folder = Folder::with_octree();
    let picture = |more: &[&str]| {
        folder.ok(&[&["render", "box.esvo", "-o", "p.png", "--size", "80x60"][..], more].concat());
        std::fs::read(folder.path("p.png")).unwrap()
    };
    let two: &[&str] = &["--light", "sun:1,2,0.5", "--light", "spot:1,3,1,0,-1,0,40"];
    let lit = picture(two);
    assert_ne!(lit, picture(&[]));
    assert_ne!(lit, picture(&two[..2]));
    assert_eq!(lit, picture(&[two, &["--backend", "reference"]].concat()));
    folder.fails(&["render", "box.esvo", "-o", "p.png", "--light", "moon:1,2,3"], 2, "expected sun:X,Y,Z");
    folder.fails(&["render", "box.esvo", "-o", "p.png", "--no-shadows"], 2, "--light");
    let depth = ["render", "box.esvo", "-o", "p.png", "--view-mode", "depth", "--light", "sun:0,1,0"];
    folder.fails(&depth, 1, "only shaded pictures are lit");
}

#[test]
fn kernels_are_printed_as_the_engines_compile_them() {
    let folder = Folder::with_octree();
    let of_octree = folder.ok(&["kernel", "box.esvo"]);
    assert!(of_octree.contains("const LEVELS: u32 = 6u;") && of_octree.contains("fn main_pass("));
    assert!(of_octree.contains("const FAR_POINTERS: bool = false;"), "the octree has none");
    let cubes = folder.ok(&["kernel", "--no-contours", "--levels", "12", "--beam", "--parts", "3"]);
    assert!(cubes.contains("const CONTOURS: bool = false;") && cubes.contains("const BEAM: bool = true;"));
    assert!(cubes.contains("const LEVELS: u32 = 12u;") && cubes.contains("var<storage, read> part_2"));
    let texture = folder.ok(&["kernel", "--texture", "11", "--beam", "--beam-block", "8"]);
    assert!(texture.contains("texture_storage_2d<rg32uint, read>") && texture.contains("const BEAM_BLOCK: u32 = 8u;"));
    folder.fails(&["kernel", "--texture", "11", "--parts", "2"], 2, "cannot be used with");
    folder.fails(&["kernel", "--beam-block", "5"], 2, "expected 4 or 8");
    assert_eq!(folder.ok(&["kernel", "--pass", "filter"]), esvo_core::filter::kernel::FILTER_WGSL);
    assert!(folder.ok(&["kernel", "--pass", "coarse"]).contains("const CONTOURS: bool = false;"));
    assert!(folder.ok(&["kernel", "--pass", "rays"]).contains("const RAYS: bool = true;"));
    assert!(folder.ok(&["kernel", "--pass", "instances"]).contains("fn instances_pass("));
    let triangles = folder.ok(&["kernel", "--pass", "triangles", "--parts", "2", "--workgroup", "16x4"]);
    assert!(triangles.contains("fn triangles_any(") && triangles.contains("const STACK: u32 = 64u;"));
    assert!(triangles.contains("const WIDTH: u32 = 16u;"));
    assert!(triangles.contains("@group(1) @binding(3) var<storage, read> triangle_part_1: array<vec4<u32>>;"));
    assert!(
        folder
            .ok(&["kernel", "--pass", "triangles", "--texture", "11"])
            .contains("texture_storage_2d<rgba32uint, read>")
    );
}

#[test]
fn large_voxels_are_filtered() {
    let folder = Folder::with_octree();
    let picture = |filter: &str, more: &[&str]| {
        let arguments =
            ["render", "box.esvo", "-o", "p.png", "--size", "80x60", "--camera=0.5,0.5,1.6,0,0,-1", "--filter"];
        let said = folder.ok(&[&arguments[..], &[filter, "--times"], more].concat());
        assert!(said.contains("casting ") && said.contains(" ms, filter "), "{said}");
        std::fs::read(folder.path("p.png")).unwrap()
    };
    let (adapted, off) = (picture("adapted", &[]), picture("off", &[]));
    assert_ne!(adapted, off);
    assert_eq!(adapted, picture("adapted", &["--backend", "reference"]));
    // Maps are not blurred.
    assert_eq!(picture("adapted", &["--view-mode", "depth"]), picture("off", &["--view-mode", "depth"]));
}

#[test]
fn cameras() {
    let folder = Folder::with_octree();
    let picture = |more: &[&str]| {
        let arguments: Vec<&str> =
            ["render", "box.esvo", "-o", "p.png", "--size", "40x30"].iter().chain(more).copied().collect();
        folder.ok(&arguments);
        std::fs::read(folder.path("p.png")).unwrap()
    };
    let front = picture(&["--camera=1,0.5,5,0,0,-1"]);
    assert_ne!(front, picture(&[]));
    assert_ne!(front, picture(&["--camera", "-3,0.5,0.5,1,0,0"]));
    assert_eq!(front, picture(&["--camera", "1,0.5,5,0,0,-1,60"]));
    assert_ne!(front, picture(&["--camera", "1,0.5,5,0,0,-1,30"]));
    assert_ne!(front, picture(&["--camera", "1,0.5,5,0,0,-1", "--max-voxel-pixels", "20"]));
}

#[test]
fn the_same_mesh_gives_the_same_bytes() {
    let folder = Folder::with_octree();
    folder.ok(&["build", "box.obj", "-o", "again.esvo", "--levels", "6"]);
    assert_eq!(std::fs::read(folder.path("box.esvo")).unwrap(), std::fs::read(folder.path("again.esvo")).unwrap());
}

#[test]
fn the_gpu_draws() {
    // As in the tests of the casters: without a device this is skipped, unless a device is required.
    if std::env::var_os("ESVO_REQUIRE_GPU").is_none() {
        eprintln!("skipped: ESVO_REQUIRE_GPU is not set");
        return;
    }
    let folder = Folder::with_octree();
    for backend in ["wgpu", "ash"] {
        let said = folder.ok(&["render", "box.esvo", "-o", "p.png", "--size", "80x60", "--beam", "--backend", backend]);
        assert!(said.contains(&format!("cast by {backend}")), "{said}");
    }
}

/// Part of the error of a GPU engine without a driver: what to install, or that it is not built in.
const WITHOUT_A_DRIVER: &str = if cfg!(feature = "wgpu") { "install" } else { "built without it" };

#[test]
fn without_a_vulkan_driver_the_rest_is_done_and_one_line_says_so() {
    let folder = Folder::new();
    folder.put("small.toml", SMALL);
    let mut command = folder.command(&["bench", "--matrix", "small.toml", "--backends", "cpu,wgpu,ash"]);
    // Both environment variables of the Vulkan loader for its list of drivers.
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = String::from_utf8(out.stdout).unwrap();
    let lines: Vec<_> = text.lines().filter(|l| l.contains("wgpu and ash")).collect();
    assert!(lines.len() == 1 && lines[0].contains(WITHOUT_A_DRIVER), "{text}");
    assert!(text.contains("Table 2, cpu"), "{text}");
}

#[test]
fn rendering_without_a_vulkan_driver_says_what_to_install() {
    let folder = Folder::with_octree();
    for backend in ["wgpu", "ash"] {
        let mut command = folder.command(&["render", "box.esvo", "-o", "p.png", "--backend", backend]);
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        let out = command.output().unwrap();
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{error}");
        assert!(error.contains(&format!("error: engine {backend}: ")) && error.contains(WITHOUT_A_DRIVER), "{error}");
        assert_eq!(folder.files(), ["box.esvo", "box.obj"]);
    }
}

const SMALL: &str = r#"
name = "small"
views = 1
rounds = 2
warm_up = 0
memory_gb = 4
resolutions = [[64, 48]]
variants = ["triangles", "cubical", "contours", "beam"]
backends = ["cpu"]

[[scene]]
name = "sibenik"
levels = [4, 5]
"#;

#[test]
fn bench_format_writes_its_record() {
    let folder = Folder::with_octree();
    let text =
        folder.ok(&["bench", "format", "box.esvo", "--size", "2", "--seconds", "0", "--machine", "Test Machine"]);
    for part in ["Storage", "zstd 9", "Validation", "large file", "open and read one block"] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    let day = std::fs::read_dir(folder.path("results/test-machine")).unwrap().next().unwrap().unwrap();
    assert!(day.file_name().to_string_lossy().ends_with("-format"));
    assert!(day.path().join("report.json").is_file() && day.path().join("tables.md").is_file());
    folder.fails(&["bench", "format", "--size", "1"], 2, "2..=32000");
    folder.fails(&["bench", "format", "box.obj", "--size", "2"], 1, "not an esvo file");
}

#[test]
fn bench_rays_writes_its_record() {
    let folder = Folder::new();
    let small = "bench rays --scene fairy --levels 4 --rays 2000 --size 32x24 --seconds 0 --backends reference,cpu";
    let text = folder.ok(&small.split(' ').chain(["--machine", "Test Machine"]).collect::<Vec<_>>());
    for part in ["FAIRY", "shadow rays", "incoherent, many", "Millions of rays per second", "Written to "] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    let day = std::fs::read_dir(folder.path("results/test-machine")).unwrap().next().unwrap().unwrap();
    assert!(day.file_name().to_string_lossy().ends_with("-rays"));
    assert!(day.path().join("report.json").is_file() && day.path().join("tables.md").is_file());
    folder.fails(&["bench", "rays", "--rays", "0"], 2, "1..=100000000");
    folder.fails(&["bench", "rays", "--scene", "teapot"], 1, "the scenes are");
    folder.fails(&["bench", "rays", "--scenes-dir", "absent"], 1, "--scenes-dir absent: is not a folder");
}

#[test]
fn bench_stability_writes_its_record_and_casts_a_ray_again() {
    let folder = Folder::new();
    let small = "bench stability --rays 1k --gpu-rays 1 --backends cpu";
    let text = folder.ok(&small.split(' ').chain(["--machine", "Test Machine"]).collect::<Vec<_>>());
    for part in ["nothing failed", "cpu, scalar", "Mistakes on purpose", "Written to "] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    let day = std::fs::read_dir(folder.path("results/test-machine")).unwrap().next().unwrap().unwrap();
    assert!(day.file_name().to_string_lossy().ends_with("-stability"));
    assert!(day.path().join("report.json").is_file() && day.path().join("tables.md").is_file());
    let replay = |case| ["bench", "stability", "--backends", "cpu", "--replay", case];
    let text = folder.ok(&replay("sparse/far/cubes#18446744073709551615"));
    assert!(text.contains("reference: ") && text.contains("cpu, scalar: the same"), "{text}");
    folder.fails(&replay("sparse/far/cubes"), 2, "expected OCTREE/KIND");
    folder.fails(&["bench", "stability", "--rays", "0"], 2, "expected a number from 1");
    folder.fails(&["bench", "stability", "--rays", "20000000000G"], 2, "expected a number from 1");
}

#[test]
fn bench_needs_writes_its_record() {
    let folder = Folder::new();
    let small = "bench needs --scenes fairy --levels 4 --size 32x24 --views 1 --rounds 1 --backends cpu";
    let text = folder.ok(&small.split(' ').chain(["--machine", "Test Machine"]).collect::<Vec<_>>());
    for part in ["FAIRY", "only what is needed", "Milliseconds per view, scalar", "Written to "] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    let day = std::fs::read_dir(folder.path("results/test-machine")).unwrap().next().unwrap().unwrap();
    assert!(day.file_name().to_string_lossy().ends_with("-needs"));
    assert!(day.path().join("report.json").is_file() && day.path().join("tables.md").is_file());
    folder.fails(&["bench", "needs", "--levels", "24"], 2, "1..=23");
    folder.fails(&["bench", "needs", "--scenes", "teapot"], 1, "the scenes are");
    folder.fails(&["bench", "needs", "--scenes-dir", "box.obj"], 1, "--scenes-dir box.obj: is not a folder");
}

#[test]
fn bench_build_goes_on_where_it_can_and_says_what_is_left_out() {
    let folder = Folder::new();
    let scenes = "sibenik-d,sibenik";
    let limits = ["--rays", "10000", "--repeats", "1", "--disk", "0.00008", "--out", "made"];
    let text = folder.ok(&[&["bench", "build", "--scenes", scenes, "--levels", "4,5,10"], &limits[..]].concat());
    assert!(text.contains("SIBENIK-D: it has no stand-in, and its mesh was not found"), "{text}");
    assert!(text.contains("SIBENIK, cubical, at ") && text.contains("GB of disk, and the limit is 0.00008"), "{text}");
    let table = std::fs::read_to_string(folder.path("made/build.md")).unwrap();
    for part in ["| SIBENIK | cubical, stand-in | 4 |", "## What contours save", "| SIBENIK | stand-in | 4 |"] {
        assert!(table.contains(part), "{part} is not in:\n{table}");
    }
    let record: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("made/build.json")).unwrap()).unwrap();
    assert_eq!((&record["complete"], &record["scenes"][0]["stopped"][0]["limit"]), (&true.into(), &"disk".into()));
    folder.fails(&["bench", "build", "--scenes", "sibenik,teapot", "--out", "other"], 1, "the scenes are");
}

#[test]
fn bench_writes_its_record() {
    let folder = Folder::new();
    folder.put("small.toml", SMALL);
    let text = folder.ok(&["bench", "--matrix", "small.toml", "--machine", "Test Machine"]);
    for part in ["Table 1", "Table 2, cpu", "Error against the triangles", "SIBENIK", "5.68 at 14"] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }
    let machine = folder.path("results/test-machine");
    let day = std::fs::read_dir(&machine).unwrap().next().unwrap().unwrap().path();
    let report = std::fs::read_to_string(day.join("report.json")).unwrap();
    let report = esvo_bench::PaperReport::from_json(&report).unwrap();
    assert!(report.passed());
    let scene = &report.scenes[0];
    assert_eq!((scene.builds.len(), scene.checks.len(), scene.times.len()), (4, 3, 4));
    assert!(scene.times.iter().all(|t| t.samples.seconds.len() == 2 && t.mrays.is_some()));
    assert_eq!(scene.errors.len(), 6);
    // Cubical, contours, and the triangles.
    assert_eq!(scene.pictures.len(), 3);
    for picture in &scene.pictures {
        assert!(std::fs::read(day.join(picture)).unwrap().starts_with(b"\x89PNG"));
    }
    assert!(std::fs::read_to_string(day.join("tables.md")).unwrap().contains("## Table 1"));
    // A second run on the same day gets a folder of its own.
    folder.ok(&["bench", "--matrix", "small.toml", "--machine", "Test Machine", "--json"]);
    assert_eq!(std::fs::read_dir(&machine).unwrap().count(), 2);
}
