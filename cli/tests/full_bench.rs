//! `esvo bench --full` and `esvo bench build`, stopped and resumed; `esvo bench --repeat`.

mod common;

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use common::Folder;
use serde_json::Value;

/// A small run of some reports at two stand-ins.
const FULL: [&str; 20] = [
    "bench",
    "--full",
    "--reports",
    "tables,sweep,needs,rays",
    "--scenes",
    "fairy,conference",
    "--levels",
    "4,5",
    "--views",
    "1",
    "--rounds",
    "1",
    "--resolutions",
    "48x36",
    "--backends",
    "cpu",
    "--threads",
    "1",
    "--machine",
    "m",
];

#[test]
fn a_full_run_that_was_stopped_goes_on_and_makes_every_report() {
    let folder = Folder::new();
    let mut child =
        folder.command(&FULL).env("XDG_CACHE_HOME", folder.path("cache")).stdout(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let part = folder.path("results/m/.unfinished-full/part-tables-fairy.json");
    while !part.exists() {
        assert!(child.try_wait().unwrap().is_none(), "the run has ended before a part was finished");
        assert!(start.elapsed() < Duration::from_secs(120), "no part is finished after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let kept = std::fs::read(&part).unwrap();

    // Other options are another run.
    let mut other = FULL.to_vec();
    other[11] = "2";
    other.push("--resume");
    let refused = folder.command(&other).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    let says = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(says.contains("other settings") && says.contains("without --resume"), "{says}");
    assert_eq!(std::fs::read(&part).unwrap(), kept);

    let mut resumed = FULL.to_vec();
    resumed.push("--resume");
    let done = folder.command(&resumed).env("XDG_CACHE_HOME", folder.path("cache")).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    assert!(done.status.success(), "{out}{err}");
    for report in
        ["esvo bench ", "esvo bench sweep", "esvo bench needs", "rays --scene fairy", "rays --scene conference"]
    {
        assert!(out.contains(report), "{report}: {out}");
    }
    let names: Vec<String> = (std::fs::read_dir(folder.path("results/m")).unwrap())
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert!(!names.iter().any(|name| name.starts_with('.')), "{names:?}");
    let of = |end: &str| names.iter().find(|name| name.ends_with(end)).unwrap_or_else(|| panic!("{end}: {names:?}"));
    let page = folder.path("results/m").join(of("-full")).join("page.html");
    assert!(std::fs::read_to_string(page).unwrap().contains("FAIRY"));
    assert_eq!(names.len(), 6, "{names:?}");

    // What was finished before the stop is in the record as it was, times included.
    let part: Value = serde_json::from_slice(&kept).unwrap();
    let tables = names.iter().find(|name| name.len() == "2026-01-02".len()).unwrap();
    let record: Value = read(&folder.path("results/m").join(tables).join("report.json"));
    assert_eq!(record["scenes"][0], part["result"]["report"]);
    assert_eq!(record["scenes"].as_array().unwrap().len(), 2);
    assert!(record["scenes"][0]["pictures"].as_array().is_some_and(|pictures| {
        pictures.iter().all(|name| folder.path("results/m").join(tables).join(name.as_str().unwrap()).exists())
    }));
}

/// A run of six octrees, each built twice.
const BUILD: [&str; 11] =
    ["bench", "build", "--scenes", "fairy", "--levels", "3,4,5", "--rays", "3000", "--repeats", "2", "--json"];

#[test]
fn a_run_of_builds_that_was_stopped_goes_on_into_one_record() {
    let folder = Folder::new();
    let mut child = folder.command(&BUILD).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let journal = folder.path("results/build/.unfinished-build");
    let part = journal.join("part-fairy-3-contours-1.json");
    while !part.exists() {
        assert!(child.try_wait().unwrap().is_none(), "the run has ended before an octree was finished");
        assert!(start.elapsed() < Duration::from_secs(120), "no octree is finished after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let kept = std::fs::read(&part).unwrap();

    // Another matrix is refused, and nothing is lost.
    let mut other = BUILD.to_vec();
    other[7] = "3001";
    other.push("--resume");
    let refused = folder.command(&other).output().unwrap();
    let says = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{says}");
    assert!(says.contains("other settings") && says.contains("without --resume"), "{says}");
    assert_eq!(std::fs::read(&part).unwrap(), kept);

    // No time: what is kept is found, the rest stays to be done.
    let resume = |time_limit: &str| {
        let mut resumed = BUILD.to_vec();
        resumed.extend(["--resume", "--time-limit", time_limit]);
        let done = folder.command(&resumed).output().unwrap();
        let says = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{says}");
        (serde_json::from_slice::<Value>(&done.stdout).unwrap(), says)
    };
    let (short, says) = resume("0.000001");
    assert!(says.contains("--resume tries them") && journal.exists(), "{says}");
    let rows = |record: &Value| record["scenes"][0]["rows"].as_array().unwrap().clone();
    assert!((1..6).contains(&rows(&short).len()), "{}", rows(&short).len());
    assert_eq!(short["scenes"][0]["stopped"][0]["limit"], "run");

    let (record, says) = resume("0");
    assert!(!says.contains("--resume") && !journal.exists(), "{says}");
    assert_eq!(read(&folder.path("results/build/build.json")), record);
    assert_eq!((&record["complete"], record["scenes"][0]["stopped"].as_array().unwrap().len()), (&true.into(), 0));
    assert_eq!(rows(&record).len(), 6);
    assert!(rows(&record).iter().all(|row| row["samples"].as_array().unwrap().len() == 2));
    // What was measured before the stop is in the record as it was, times included.
    let part: Value = serde_json::from_slice(&kept).unwrap();
    let mut first = rows(&record)[0].clone();
    first["samples"].as_array_mut().unwrap().pop();
    assert_eq!(first, part["result"]["row"]);
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Where no GPU is, the other reports are made, and the list says what voxelization needs.
#[test]
fn voxelization_is_made_or_left_out_by_name() {
    let folder = Folder::new();
    let arguments = [
        "bench",
        "--full",
        "--reports",
        "rays,voxelize",
        "--scenes",
        "fairy",
        "--levels",
        "4,5",
        "--rounds",
        "1",
        "--resolutions",
        "48x36",
        "--backends",
        "cpu",
        "--machine",
        "m",
        "--time-limit",
        "0.001",
    ];
    let run = |lists: &str, levels: &str, without: bool| {
        let mut arguments = arguments.to_vec();
        (arguments[3], arguments[7]) = (lists, levels);
        let mut command = folder.command(&arguments);
        if without {
            command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        }
        let done = command.output().unwrap();
        (done.status.code(), String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned())
    };
    let why = if cfg!(feature = "wgpu") { "install" } else { "without the feature wgpu" };
    let (code, text) = run("rays,voxelize", "4,5", true);
    let line = text.lines().find(|line| line.contains("esvo bench voxelize")).unwrap_or_default();
    assert!(code == Some(0) && line.contains("left out: ") && line.contains(why), "{text}");
    // Nothing else was asked for: that is an error.
    let (code, text) = run("voxelize", "4,5", true);
    let last = text.lines().last().unwrap_or_default();
    assert!(code == Some(1) && last.starts_with("error: esvo bench voxelize: ") && last.contains(why), "{text}");
    if !cfg!(feature = "wgpu") || std::env::var_os("ESVO_REQUIRE_GPU").is_none() {
        return;
    }
    let (code, text) = run("voxelize", "4,5,20", false);
    let line = text.lines().find(|line| line.contains("esvo bench voxelize")).unwrap_or_default();
    assert!(code == Some(0) && line.contains("right") && line.contains("-voxelize"), "{text}");
    let found = std::fs::read_dir(folder.path("results/m")).unwrap().map(|entry| entry.unwrap().path());
    let found: Vec<PathBuf> = found.filter(|path| path.to_string_lossy().ends_with("-voxelize")).collect();
    assert_eq!(found.len(), 1);
    let record = read(&found[0].join("report.json"));
    // The finer grid was left out for the time limit; octrees of 20 levels have no grid.
    assert_eq!(record["options"]["scenes"][0]["levels"], serde_json::json!([4, 5]));
    assert_eq!(record["scenes"][0]["grids"].as_array().unwrap().len(), 1);
    let left_out: Vec<&str> =
        record["left_out"].as_array().unwrap().iter().map(|left| left["what"].as_str().unwrap()).collect();
    assert!(left_out.contains(&"FAIRY in a grid of 32^3"), "{left_out:?}");
}

#[test]
fn a_record_is_run_again_and_what_differs_is_told() {
    let folder = Folder::new();
    let small = ["--scenes", "fairy", "--levels", "4", "--views", "1", "--rounds", "1", "--machine", "m"];
    let tables = ["bench", "--resolutions", "48x36", "--backends", "cpu"];
    folder.ok(&[&tables[..], &small].concat());
    let sweep =
        ["bench", "sweep", "--size", "48x36", "--engines", "cpu", "--no-cache", "--scenes", "fairy", "--levels", "4"];
    folder.ok(&[&sweep[..], &["--views", "1", "--rounds", "1", "--machine", "m"]].concat());
    folder.ok(&[
        "bench",
        "needs",
        "--size",
        "48x36",
        "--scenes",
        "fairy",
        "--levels",
        "4",
        "--views",
        "1",
        "--rounds",
        "1",
        "--machine",
        "m",
    ]);
    let records: Vec<PathBuf> =
        std::fs::read_dir(folder.path("results/m")).unwrap().map(|e| e.unwrap().path().join("report.json")).collect();
    assert_eq!(records.len(), 3);
    let repeat = |record: &Path| {
        let arguments = ["bench", "--repeat", record.to_str().unwrap(), "--out", "again", "--machine", "m"];
        let done = folder.command(&arguments).env("XDG_CACHE_HOME", folder.path("cache")).output().unwrap();
        let text = [done.stdout, done.stderr].concat();
        (done.status.code(), String::from_utf8_lossy(&text).into_owned())
    };
    for record in &records {
        let (code, text) = repeat(record);
        assert!(code == Some(0) && text.contains("the first record's in every digit"), "{}: {text}", record.display());
    }

    // Something that this program would not find: a byte more, and a mesh of another hash.
    let tables = records.iter().find(|path| read(path).get("matrix").is_some()).unwrap();
    let mut changed = read(tables);
    let bytes = changed["scenes"][0]["builds"][1]["bytes"].as_u64().unwrap();
    changed["scenes"][0]["builds"][1]["bytes"] = (bytes + 8).into();
    changed["machine"]["rustc"] = "another compiler".into();
    folder.put("changed.json", changed.to_string());
    let (code, text) = repeat(&folder.path("changed.json"));
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("scenes[FAIRY].builds[contours, levels 4].bytes"), "{text}");
    assert!(text.contains("another compiler") && text.contains("one result differs"), "{text}");

    // The viewpoints are the record's, and not the manifest's: with others, the errors are others.
    let mut moved = read(tables);
    moved["scenes"][0]["views"][0]["camera"]["fov_degrees"] = 20.0.into();
    folder.put("moved.json", moved.to_string());
    let (code, text) = repeat(&folder.path("moved.json"));
    assert!(code == Some(1) && text.contains(".errors["), "{text}");
    assert!(!text.contains("fov_degrees"), "{text}");

    folder.put("no.json", "{}");
    let (code, text) = repeat(&folder.path("no.json"));
    assert!(code == Some(1) && text.contains("expected report.json"), "{text}");
}
