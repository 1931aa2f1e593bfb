//! `esvo bench shadow`.

mod common;

use common::Folder;
use serde_json::Value;

/// A run of seconds.
const SMALL: [&str; 20] = [
    "--scenes",
    "fairy",
    "--voxels",
    "20",
    "--rays",
    "1",
    "--size",
    "24x16",
    "--levels",
    "6",
    "--converged",
    "4",
    "--rounds",
    "1",
    "--leak-rays",
    "3000",
    "--world",
    "160,160,160",
    "--picture",
    "40x30",
];

fn bench<'a>(more: &[&'a str]) -> Vec<&'a str> {
    ["bench", "shadow"].iter().chain(&SMALL).chain(more).copied().collect()
}

#[test]
fn the_benchmark_writes_a_record_plots_and_pictures_for_the_page() {
    let folder = Folder::new();
    let record: Value =
        serde_json::from_str(&folder.ok(&bench(&["--out", "out", "--machine", "m", "--json"]))).unwrap();
    let leaks = record["leaks"].as_array().unwrap();
    assert!(leaks.iter().any(|row| row["leaks"].as_u64() > Some(0)), "long steps leak");
    assert!(leaks.iter().filter(|row| row.get("step").is_none()).all(|row| row["leaks"] == 0));
    let made = std::fs::read_dir(folder.path("out/m")).unwrap().next().unwrap().unwrap().path();
    assert!(made.to_string_lossy().ends_with("-shadow"));
    let names: Vec<String> =
        std::fs::read_dir(&made).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    let count = |extension: &str| names.iter().filter(|name| name.ends_with(extension)).count();
    assert!(names.iter().any(|name| name == "report.json") && names.iter().any(|name| name == "tables.md"));
    // One plot for each effect.
    assert_eq!(count(".svg"), 7, "{names:?}");
    let pictures = record["pictures"].as_array().unwrap();
    assert_eq!(count(".png"), pictures.len());
    for picture in pictures {
        assert!(names.iter().any(|name| picture["file"] == **name), "{picture}");
    }
    let tables = std::fs::read_to_string(made.join("tables.md")).unwrap();
    for title in [
        "In words",
        "A picture of it, 40 x 30 pixels with 10 lamps",
        "A world of 5 cm voxels",
        "Rays that leave closed rooms",
        "Rays a second",
        "fog, error and time",
    ] {
        assert!(tables.contains(title), "{title}");
    }
    let page = folder.path("page.html");
    folder.ok(&["bench", "page", made.to_str().unwrap(), "-o", page.to_str().unwrap()]);
    let page = std::fs::read_to_string(page).unwrap();
    for shown in [
        "Shadows, occlusion, reflections and fog through a bit volume",
        ": fog, error against time",
        "Objects that move in it, each picture",
        "Error and time of each effect with each shortcut",
        "Bit volume: courtyard",
        ">ambient occlusion, five rays with half the offset<",
        "esvo bench shadow",
    ] {
        assert!(page.contains(shown), "{shown}");
    }
    assert_eq!(page.matches("data:image/png").count(), pictures.len());
}

#[test]
fn a_record_of_a_bit_volume_is_run_again() {
    let folder = Folder::new();
    folder.ok(&bench(&["--out", "out", "--machine", "m", "--no-pictures"]));
    let record = std::fs::read_dir(folder.path("out/m")).unwrap().next().unwrap().unwrap().path().join("report.json");
    // Other counts are told, and other times are not.
    let mut changed: Value = serde_json::from_slice(&std::fs::read(&record).unwrap()).unwrap();
    changed["leaks"][0]["leaks"] = 7.into();
    changed["moving"][0]["as_if_from_nothing"] = false.into();
    changed["moving"][0]["update_ms"] = 1e9.into();
    changed["world"]["fill_seconds"] = 1e9.into();
    changed["picture"]["rows"][0]["passes"][0]["ms"][0] = 1e9.into();
    changed["scenes"][0]["rates"][0]["steps"] = 1e9.into();
    changed["scenes"][0]["rates"][0]["different"] = 8.into();
    changed["scenes"][0]["rates"][0]["seconds"][0] = 1e9.into();
    changed["scenes"][0]["errors"][0]["ms"][0] = 1e9.into();
    folder.put("changed.json", changed.to_string());
    let out = folder.run(&["bench", "--repeat", "changed.json", "--out", "again", "--machine", "m"]);
    let text = String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned();
    assert!(out.status.code() == Some(1) && text.contains("esvo bench shadow"), "{text}");
    let places = |line: &&str| ["leaks[", "moving[", "scenes["].iter().any(|list| line.contains(list));
    assert_eq!(text.lines().filter(places).count(), 4, "nothing else differs: {text}");
    for told in ["].leaks", "].as_if_from_nothing", "].steps", "].different"] {
        assert!(text.contains(told), "{told}: {text}");
    }
    assert!(!text.contains("_ms") && !text.contains("seconds") && !text.contains("].ms"), "{text}");
}

#[test]
fn bad_input_is_one_line_and_nothing_is_written() {
    let folder = Folder::new();
    folder.put("file", "text");
    // The last of an option's values counts.
    let bad = |option: &'static str, value: &'static str, what: &str| {
        let at = SMALL.iter().position(|name| *name == option);
        let mut arguments = bench(&["--out", "out"]);
        match at {
            Some(at) => arguments[2 + at + 1] = value,
            None => arguments.extend([option, value]),
        }
        let code = if what.starts_with('2') { 2 } else { 1 };
        folder.fails(&arguments, code, what.trim_start_matches('2'));
    };
    bad("--voxels", "0", "--voxels: voxels of 0 cm were asked for; their edge is 0.5 to 400 cm");
    bad("--voxels", "nan", "voxels of NaN cm were asked for");
    bad("--voxels", "5,1e9", "voxels of 1000000000 cm were asked for");
    bad("--voxels", "wide", "2--voxels");
    bad("--rays", "0", "--rays: 0 rays for each pixel were asked for; there are 1 to 65536");
    bad("--rays", "4294967295", "--rays: 4294967295 rays for each pixel were asked for; there are 1 to 65536");
    bad(
        "--leak-rays",
        "18446744073709551615",
        "--leak-rays: 18446744073709551615 rays in closed rooms were asked for; the most is 100000000000",
    );
    bad("--converged", "0", "--converged: 0 rays for each pixel were asked for");
    bad("--rounds", "0", "21..=1000");
    bad(
        "--world",
        "10,10,10",
        "--world: a world of 10 x 10 x 10 voxels was asked for; it has 64 to 8192 along each axis",
    );
    bad("--world", "9000,9000,9000", "a world of 9000 x 9000 x 9000 voxels was asked for");
    bad("--world", "8192,8192,8192", "a world of 8192 x 8192 x 8192 voxels was asked for");
    bad("--world", "160,160", "--world: 2 numbers were given; give three, e.g. 2000,2000,500");
    bad("--levels", "40", "--levels: an octree of 40 levels was asked for; there are 1 to 16");
    bad("--levels", "0", "an octree of 0 levels was asked for");
    bad("--size", "0x0", "2--size");
    bad("--picture", "9000x9000", "--picture: pictures of 9000x9000 were asked for; they have 1 to 8388608 pixels");
    bad("--picture", "0x0", "2--picture");
    bad("--scenes", "nothing", "scene nothing: unknown scene");
    bad("--scenes-dir", "absent", "absent");
    folder.fails(&bench(&["--out", "file"]), 1, "file: is a file where a folder is needed");
    folder.fails(&bench(&["--out", "file/below"]), 1, "file: is a file where a folder is needed");
}
