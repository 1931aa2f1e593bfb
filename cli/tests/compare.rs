//! `esvo bench compare` and `esvo bench bless`: exit codes, output, the baseline. No verdict here depends on a time: records are
//! compared with themselves, or with copies whose times were changed.

mod common;

use common::Folder;

/// Measures a stand-in, and makes all times the same. Returns the folder with the record under `out` and in `run.json`, and
/// the record.
fn measured() -> (Folder, serde_json::Value) {
    let folder = Folder::new();
    let bench =
        "bench --scenes fairy --levels 3 --backends cpu --resolutions 16x16 --views 1 --rounds 3 --out out --machine m";
    folder.ok(&bench.split(' ').collect::<Vec<_>>());
    let runs = std::fs::read_dir(folder.path("out/m")).unwrap();
    let run = runs.map(|run| run.unwrap().path().join("report.json")).next().unwrap();
    let mut record: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&run).unwrap()).unwrap();
    for cell in record["scenes"][0]["times"].as_array_mut().unwrap() {
        for times in TIMES {
            numbers(cell, times, |seconds| *seconds = 0.01.into());
        }
    }
    std::fs::write(run, record.to_string()).unwrap();
    folder.put("run.json", record.to_string());
    (folder, record)
}

/// Where the times of a cell are; processor times only where the system tells them.
const TIMES: [&str; 4] = [
    "/samples/seconds",
    "/samples/guard/cpu_seconds",
    "/samples/guard/calibration_seconds",
    "/samples/guard/calibration_cpu_seconds",
];

/// Changes every time of a cell at this place.
fn numbers(cell: &mut serde_json::Value, place: &str, change: impl Fn(&mut serde_json::Value)) {
    let rounds = cell.pointer_mut(place).and_then(|rounds| rounds.as_array_mut());
    rounds.into_iter().flatten().flat_map(|round| round.as_array_mut().unwrap()).for_each(change);
}

/// The record with all times multiplied.
fn slower(record: &serde_json::Value, factor: f64) -> String {
    let mut record = record.clone();
    for cell in record["scenes"][0]["times"].as_array_mut().unwrap() {
        for times in &TIMES[..2] {
            numbers(cell, times, |seconds| *seconds = (seconds.as_f64().unwrap() * factor).into());
        }
    }
    record.to_string()
}

#[test]
fn the_exit_code_says_whether_something_is_slower() {
    let (folder, record) = measured();
    assert_eq!(record["calibration"]["version"], 1);
    let text = folder.ok(&["bench", "compare", "run.json", "run.json"]);
    assert!(text.contains("0 slower, 0 faster, 4 the same") && !text.contains("ratio"), "{text}");
    assert!(folder.ok(&["bench", "compare", "run.json", "run.json", "--all"]).contains("with beam, 16x16"));
    folder.put("slow.json", slower(&record, 1.2));
    folder.fails(
        &["bench", "compare", "run.json", "slow.json"],
        1,
        "slow.json: 4 of 4 cells are slower by more than 5 %",
    );
    folder.ok(&["bench", "compare", "run.json", "slow.json", "--threshold", "25"]);
    folder.ok(&["bench", "compare", "slow.json", "run.json"]);
    let out = folder.run(&["bench", "compare", "run.json", "slow.json", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(out.status.code() == Some(1) && json["cells"][0]["verdict"] == "slower", "{json}");
    let markdown = folder.run(&["bench", "compare", "run.json", "slow.json", "--markdown"]);
    assert!(String::from_utf8_lossy(&markdown.stdout).contains("| FAIRY | cpu |"));

    let mut other = record.clone();
    other["machine"]["cpu"] = "Another".into();
    folder.put("other.json", other.to_string());
    folder.fails(&["bench", "compare", "run.json", "other.json"], 1, "no cell could be compared");
    folder.put("bad.json", "{}");
    folder.fails(&["bench", "compare", "run.json", "bad.json"], 1, "bad.json: expected report.json of esvo bench");
    folder.fails(&["bench", "compare", "run.json", "absent.json"], 1, "absent.json");
    folder.fails(&["bench", "compare", "run.json", "run.json", "--threshold", "0"], 2, "above 0");
    folder.fails(&["bench", "compare", "run.json", "run.json", "--baselines", "out"], 2, "cannot be used with");
}

#[test]
fn one_record_is_compared_with_its_baseline() {
    let (folder, record) = measured();
    folder.fails(&["bench", "compare", "run.json"], 1, "results");
    // The record under `out` is the only one, and the same as `run.json`.
    assert!(folder.ok(&["bench", "compare", "run.json", "--baselines", "out"]).contains("before: out/m/"));
    let said = folder.ok(&["bench", "bless", "run.json", "--baselines", "kept"]);
    assert!(said.starts_with("kept/") && said.contains("/baseline/tables-default.json is the baseline now"), "{said}");
    folder.put("slow.json", slower(&record, 1.2));
    folder.fails(&["bench", "compare", "slow.json", "--baselines", "kept"], 1, "slower by more than 5 %");
    folder.ok(&["bench", "bless", "slow.json", "--baselines", "kept"]);
    folder.ok(&["bench", "compare", "slow.json", "--baselines", "kept"]);
    folder.fails(&["bench", "bless", "absent.json"], 1, "absent.json");
}

/// The negative control of the comparison is marked in its record, and cannot be blessed.
#[test]
fn an_engine_can_be_slowed_on_purpose() {
    let folder = Folder::new();
    let bench =
        "bench --scenes fairy --levels 3 --backends cpu --resolutions 16x16 --views 1 --rounds 1 --out out --machine m";
    let bench = bench.split(' ').collect::<Vec<_>>();
    let text = folder.ok(&[&bench[..], &["--slow", "cpu=10"]].concat());
    assert!(text.contains("SLOWED on purpose: cpu takes 10 % longer"), "{text}");
    let runs = std::fs::read_dir(folder.path("out/m")).unwrap();
    let run = runs.map(|run| run.unwrap().path().join("report.json")).next().unwrap();
    folder.fails(&["bench", "bless", run.to_str().unwrap()], 1, "was slowed on purpose (cpu by 10 %)");
    for bad in ["cpu", "cpu=0", "cuda=10", "cpu=x"] {
        folder.fails(&[&bench[..], &["--slow", bad]].concat(), 2, "--slow");
    }
    assert!(!folder.ok(&["bench", "--help"]).contains("--slow"));
}
