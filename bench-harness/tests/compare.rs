//! `esvo bench compare` on stored records. `data/guard-*.json` are runs of `matrices/guard.toml` on one machine, reduced to two cells,
//! two views and twelve rounds: `before` and `again` of the same program, `slowed` with `--slow cpu=10`, `loaded` while other programs
//! had the processor.

use std::path::{Path, PathBuf};

use esvo_bench::PaperReport;
use esvo_bench::Progress;
use esvo_bench::compare::baseline::{bless, find_baseline};
use esvo_bench::compare::ratio::Basis;
use esvo_bench::compare::{
    CompareReport, DEFAULT_THRESHOLD, Measured, MeasuredRun, RecordKind, Verdict, compare, read_run, to_markdown,
    to_text,
};
use esvo_bench::needs_bench::{NeedsBenchOptions, run_needs_bench};
use esvo_bench::paper_bench::report::TimeCell;
use esvo_bench::ray_bench::{RayBenchOptions, run_ray_bench};
use esvo_engines::EngineId;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/guard-{name}.json"))
}

fn report(name: &str) -> PaperReport {
    PaperReport::from_json(&std::fs::read_to_string(file(name)).unwrap()).unwrap()
}

/// Compares a changed record with `before`.
fn judge(name: &str, change: impl FnOnce(&mut PaperReport)) -> CompareReport {
    let mut after = report(name);
    change(&mut after);
    compare(&report("before").measured(), &after.measured(), ["before.json", "after.json"], DEFAULT_THRESHOLD)
}

fn slow_cell(cell: &mut TimeCell, factor: f64) {
    let times = [&mut cell.samples.seconds, &mut cell.samples.guard.cpu_seconds];
    times.into_iter().flatten().flatten().for_each(|seconds| *seconds *= factor);
}

fn slow_down(report: &mut PaperReport, factor: f64) {
    report.scenes.iter_mut().flat_map(|scene| &mut scene.times).for_each(|cell| slow_cell(cell, factor));
}

fn other_mesh(report: &mut PaperReport) {
    report.scenes[0].triangles += 1;
    report.scenes[0].builds.iter_mut().for_each(|build| build.image_sha256 = "0".repeat(64));
}

#[test]
fn a_second_run_of_the_same_program_passes() {
    let found = judge("again", |_| ());
    assert!(found.passed() && found.calibrated && found.count(Verdict::Same) == found.cells.len(), "{found:?}");
    assert!(found.cells.iter().all(|cell| cell.ratio.unwrap().basis == Basis::ProcessorTime));
    // A record and itself.
    let same = judge("before", |_| ());
    assert!(same.passed() && same.cells.iter().all(|cell| cell.ratio.unwrap().ratio == 1.0));
    insta::assert_snapshot!("again", to_text(&found, true));
}

#[test]
fn a_run_that_is_slower_by_ten_percent_fails() {
    let found = judge("slowed", |_| ());
    assert!(!found.passed() && found.count(Verdict::Slower) == found.cells.len(), "{found:?}");
    insta::assert_snapshot!("slowed", to_text(&found, false));
    insta::assert_snapshot!("slowed_markdown", to_markdown(&found, false));
    // The other way round it is faster, and passes.
    let (before, after) = (report("slowed").measured(), report("before").measured());
    let found = compare(&before, &after, ["a", "b"], DEFAULT_THRESHOLD);
    assert!(found.passed() && found.count(Verdict::Faster) == found.cells.len());

    for (factor, threshold, passes) in [(1.1, 5.0, false), (1.04, 5.0, true), (1.08, 3.0, false), (1.1, 15.0, true)] {
        let mut after = report("before");
        slow_down(&mut after, factor);
        let found = compare(&report("before").measured(), &after.measured(), ["a", "b"], threshold);
        assert_eq!(found.passed(), passes, "{factor} {threshold}");
    }
    // One cell of several is enough.
    let found = judge("before", |after| slow_cell(&mut after.scenes[0].times[0], 1.1));
    assert!(!found.passed() && found.count(Verdict::Slower) == 1);
}

/// The negative control is the same record without its calibration casts.
#[test]
fn a_run_under_load_passes_because_of_its_calibration() {
    let found = judge("loaded", |_| ());
    assert!(found.passed(), "{}", to_text(&found, true));
    assert!(found.cells.iter().all(|cell| cell.ratio.unwrap().machine.unwrap() > 1.1), "{found:?}");
    insta::assert_snapshot!("loaded", to_text(&found, true));
    let raw = judge("loaded", |after| after.calibration = None);
    assert!(!raw.passed() && !raw.calibrated && raw.count(Verdict::Slower) > 0);
    assert!(
        to_text(&raw, false).contains("compared as they are, not divided by those of calibration casts: the second")
    );
    // Slower by ten percent under load is found as well.
    let slow = judge("loaded", |after| slow_down(after, 1.1));
    assert!(!slow.passed(), "{}", to_text(&slow, true));
}

#[test]
fn what_is_something_else_is_incomparable() {
    // Another mesh has other triangles and other octrees.
    let mesh = judge("again", |after| {
        slow_down(after, 2.0);
        other_mesh(after);
    });
    assert_eq!(mesh.count(Verdict::Incomparable), mesh.cells.len());
    assert!(!mesh.passed(), "nothing was compared");
    insta::assert_snapshot!("other_mesh", to_text(&mesh, false));
    // Of another octree of the same mesh, the triangles are still compared.
    let octree = judge("again", |after| {
        slow_cell(&mut after.scenes[0].times[1], 2.0);
        after.scenes[0].builds.iter_mut().for_each(|build| build.image_sha256 = "0".repeat(64));
    });
    assert!(octree.passed() && octree.count(Verdict::Incomparable) == 1 && octree.count(Verdict::Same) == 1);
    assert_eq!(octree.cells[1].reason, "other octree SHA-256");
    let fewer_voxels = judge("again", |after| after.scenes[0].builds.iter_mut().for_each(|b| b.voxels = 1));
    assert!(fewer_voxels.cells[1].reason.starts_with("other voxels: "), "{fewer_voxels:?}");

    let has = |found: CompareReport, what: &str| {
        assert!(found.compared() == 0 && !found.passed());
        let reasons = found.cells.into_iter().map(|cell| cell.reason).collect::<Vec<_>>().join("\n");
        assert!(reasons.contains(what), "{reasons}");
    };
    has(judge("again", |after| after.machine.threads = 64), "another machine: ");
    has(judge("again", |after| after.machine.cpu = "Another".into()), "another machine: ");
    has(judge("again", |after| after.machine.profile = "debug".into()), "another build: release and debug");
    has(judge("again", |after| after.devices[0].detail = "SSE2, 4 lanes, 2 threads".into()), "4 lanes");
    has(judge("again", |after| after.scenes[0].views[0].camera.eye[1] += 0.1), "other views");
    has(
        judge("again", |after| after.scenes[0].times.iter_mut().for_each(|cell| cell.samples.seconds.clear())),
        "no times",
    );

    // Another scene or size is another cell.
    let sizes = judge("again", |after| after.scenes[0].times.iter_mut().for_each(|cell| cell.size = [64, 48]));
    let cells = sizes.cells.len() / 2;
    assert_eq!((sizes.count(Verdict::OnlyBefore), sizes.count(Verdict::OnlyAfter)), (cells, cells));
    assert!(!sizes.passed());
    // One cell less is said, and the others count.
    let fewer = judge("again", |after| drop(after.scenes[0].times.pop()));
    assert!(fewer.passed() && fewer.count(Verdict::OnlyBefore) == 1);
    assert!(to_text(&fewer, false).contains("1 only before"));
}

#[test]
fn calibrations_of_other_kernels_are_not_used() {
    let raw = |change: fn(&mut esvo_bench::calibration::CalibrationRecord), why: &str| {
        let found = judge("again", |after| change(after.calibration.as_mut().unwrap()));
        assert!(!found.calibrated && found.notes.iter().any(|note| note.contains(why)), "{:?}", found.notes);
    };
    raw(|calibration| calibration.version += 1, "versions 1 and 2");
    raw(|calibration| calibration.threads = 1, "2 and 1 threads");
    raw(|calibration| calibration.checksum = "0".repeat(16), "the kernel was changed without a new version");
}

#[test]
fn wrong_answers_fail() {
    let found = judge("again", |after| after.scenes[0].checks[0].agreement.different_voxel = 7);
    assert!(!found.passed() && found.wrong.len() == 1 && found.count(Verdict::Slower) == 0);
    assert!(to_text(&found, false).contains("WRONG:  answers of SIBENIK, cpu, "));
    // Those of the first record are its own matter.
    let mut before = report("before");
    before.scenes[0].checks[0].agreement.different_voxel = 7;
    assert!(compare(&before.measured(), &report("again").measured(), ["a", "b"], 5.0).passed());
}

#[test]
fn json_has_what_the_tables_have() {
    let found = judge("slowed", |_| ());
    let json: serde_json::Value = serde_json::from_str(&found.to_json()).unwrap();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["before"]["kind"], "tables");
    let cell = &json["cells"][0];
    assert_eq!(cell["verdict"], "slower");
    for number in ["ratio", "low", "high", "before_ms", "after_ms", "machine", "time_ratio"] {
        assert!(cell[number].is_f64(), "{number}: {cell}");
    }
}

/// Records of before there were calibration casts are read and compared as they are.
#[test]
fn stored_records_are_read() {
    let results = Path::new(env!("CARGO_MANIFEST_DIR")).join("../results/amd-epyc-2-threads");
    for (record, kind) in [
        ("2026-11-23", RecordKind::Tables),
        ("2026-11-26-triangles", RecordKind::Tables),
        ("2026-11-26-sweep", RecordKind::Sweep),
        ("2026-11-26-rays", RecordKind::Rays),
        ("2026-11-26-needs", RecordKind::Needs),
    ] {
        let run = read_run(&results.join(record).join("report.json")).unwrap();
        assert!(run.kind == kind && run.cells.len() > 5 && run.wrong.is_empty(), "{record}");
        let names: std::collections::BTreeSet<_> = run.cells.iter().map(|cell| &cell.name).collect();
        assert_eq!(names.len(), run.cells.len(), "{record}: names of cells are unique");
        let same = compare(&run, &run, ["a", "b"], 5.0);
        assert!(same.passed() && !same.calibrated && same.count(Verdict::Same) == run.cells.len(), "{record}");
        let mut slow = run.clone();
        slow.cells.iter_mut().flat_map(|cell| cell.seconds.iter_mut().flatten()).for_each(|seconds| *seconds *= 1.3);
        assert!(!compare(&run, &slow, ["a", "b"], 5.0).passed(), "{record}");
    }
    for record in ["2026-11-26-format/report.json", "2026-11-26-stability/report.json", "2026-11-23-build/build.json"] {
        let error = read_run(&results.join(record)).unwrap_err().to_string();
        assert!(error.contains("expected report.json of esvo bench"), "{error}");
    }
    assert!(read_run(&results.join("2026-11-23/tables.md")).is_err());
}

#[test]
fn lists_of_rays_and_what_code_needs_are_calibrated_too() {
    let rays = RayBenchOptions {
        levels: 4,
        size: [32, 24],
        rays: 1000,
        seconds: 0.0,
        engines: vec![EngineId::Cpu],
        scene: "fairy".into(),
        ..RayBenchOptions::default()
    };
    let needs = NeedsBenchOptions {
        scenes: vec!["fairy".into()],
        levels: vec![4],
        size: [32, 24],
        views: 1,
        rounds: 2,
        ..NeedsBenchOptions::default()
    };
    let progress = Progress::hidden();
    let runs =
        [run_ray_bench(&rays, &progress).unwrap().measured(), run_needs_bench(&needs, &progress).unwrap().measured()];
    for run in &runs {
        assert!(run.wrong.is_empty() && run.calibration.is_some() && run.cells.len() > 5);
        let paired = |cell: &esvo_bench::compare::MeasuredCell| {
            let calibration = &cell.guard.calibration_seconds;
            calibration.len() == cell.seconds.len() && calibration.iter().all(|round| round.len() == 2)
        };
        assert!(run.cells.iter().all(paired));
        assert!(run.cells.iter().all(|cell| cell.same.iter().any(|(name, _)| *name == "octree SHA-256")));
        assert!(compare(run, run, ["a", "b"], 5.0).passed());
    }
    let other = compare(&runs[0], &runs[1], ["a", "b"], 5.0);
    assert!(!other.passed() && other.compared() == 0);
}

#[test]
fn the_baseline_is_the_blessed_record_or_else_the_newest() {
    let folder = tempfile::tempdir().unwrap();
    let results = folder.path();
    let put = |place: &str, change: &dyn Fn(&mut PaperReport)| {
        let path = results.join(place);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut record = report("before");
        change(&mut record);
        std::fs::write(&path, record.to_json()).unwrap();
        path
    };
    let run_file = put("somewhere/new/report.json", &|r| r.machine.date = "2026-12-31T00:00:00Z".into());
    let run: MeasuredRun = read_run(&run_file).unwrap();
    let find = || find_baseline(results, &run, &run_file).map(|(path, _)| path);
    let none = find().unwrap_err().to_string();
    assert!(none.contains("esvo bench bless"), "{none}");

    // Not candidates: another machine, another mesh, wrong answers, slowed, another benchmark, no record.
    put("m/machine/report.json", &|r| r.machine.threads = 64);
    put("m/mesh/report.json", &other_mesh);
    put("m/wrong/report.json", &|r| r.scenes[0].checks[0].agreement.different_voxel = 7);
    let slowed = put("m/slowed/report.json", &|r| r.slowed = report("slowed").slowed);
    std::fs::write(results.join("m/wrong/other.json"), "{}").unwrap();
    assert!(find().is_err());

    let old = put("m/old/report.json", &|r| r.machine.date = "2026-01-01T00:00:00Z".into());
    assert_eq!(find().unwrap(), old);
    let newer = put("m/newer/report.json", &|r| r.machine.date = "2026-02-01T00:00:00Z".into());
    assert_eq!(find().unwrap(), newer);
    let blessed = bless(&old, results).unwrap();
    assert!(blessed.ends_with(format!("{}/baseline/tables-guard.json", run.machine.slug())));
    assert_eq!(find().unwrap(), blessed);
    // Blessing again replaces it.
    assert_eq!(bless(&newer, results).unwrap(), blessed);
    assert_eq!(std::fs::read(&blessed).unwrap(), std::fs::read(&newer).unwrap());
    assert_eq!(std::fs::read_dir(blessed.parent().unwrap()).unwrap().count(), 1, "no temporary file is left");

    for (record, what) in [
        (slowed, "slowed on purpose (cpu by 10 %)"),
        (results.join("m/wrong/report.json"), "wrong answers (SIBENIK, cpu, "),
        (results.join("m/wrong/other.json"), "expected report.json"),
        (results.join("absent.json"), "absent.json"),
    ] {
        let error = bless(&record, results).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
    assert_eq!(std::fs::read(&blessed).unwrap(), std::fs::read(&newer).unwrap());
    assert!(find_baseline(&results.join("absent"), &run, &run_file).is_err());
}
