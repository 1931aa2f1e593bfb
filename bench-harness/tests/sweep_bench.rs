//! The benchmark of error against run time, on small octrees and on a recorded report.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use esvo_bench::Progress;
use esvo_bench::scene::NamedView;
use esvo_bench::sweep_bench::advice::{Wish, advise};
use esvo_bench::sweep_bench::csv::to_csv;
use esvo_bench::sweep_bench::errors::ErrorMeasure;
use esvo_bench::sweep_bench::plot::to_svg;
use esvo_bench::sweep_bench::record::{Cell, ExactKind, SceneSweep};
use esvo_bench::sweep_bench::{
    Cache, FileSweepOptions, SweepBenchOptions, SweepPlan, SweepReport, read_sweep_record, run_file_sweep,
    run_sweep_bench, to_markdown, to_text, write_sweep_record,
};
use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::Camera;
use esvo_engines::EngineId;

/// The stand-in, wherever this runs.
fn small(cache: Cache) -> SweepBenchOptions {
    let mut plan = SweepPlan::default_run();
    plan.select_scenes(&["fairy".into()]);
    plan.set_levels(&[4, 5, 6]);
    plan.size = [64, 48];
    plan.rounds = 2;
    plan.engines = vec![EngineId::Cpu];
    SweepBenchOptions {
        plan,
        scenes_dir: None,
        manifest: None,
        threads: None,
        all_on_software: false,
        cache,
        views: Vec::new(),
    }
}

fn find(scene: &SceneSweep, levels: u32, contours: bool, pixels: f32) -> &Cell {
    let wanted = |cell: &&Cell| {
        scene.levels(cell) == Some(levels) && cell.contours == contours && !cell.beam && cell.max_voxel_pixels == pixels
    };
    scene.cells.iter().find(wanted).unwrap()
}

#[test]
fn a_sweep_is_checked_timed_written_read_back_and_cached() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::in_folder(&folder.path().join("cache"));
    let report = run_sweep_bench(&small(cache.clone()), &Progress::hidden()).unwrap();
    assert!(report.passed());
    let scene = &report.scenes[0];
    // Levels, contours, beam, terminations; and the triangles.
    assert_eq!(scene.cells.len(), 3 * 2 * 2 * 4 + 1);
    assert_eq!(scene.octrees.len(), 6);
    for cell in &scene.cells {
        assert!(cell.seconds.len() == 2 && cell.seconds.iter().all(|views| views.len() == 2), "{cell:?}");
        assert!(cell.error.rays == 2 * 64 * 48 && cell.error.both_hit > 1000, "{cell:?}");
        assert!(cell.memory_bytes > 0 && cell.disk_bytes > 0, "{cell:?}");
        assert_eq!(cell.agreement.is_none(), cell.octree.is_none());
    }
    // A coarser octree and a coarser termination have larger errors: the error tells them apart.
    let p90 = |levels, contours, pixels| find(scene, levels, contours, pixels).error.pixels.p90;
    let flip = |levels, contours, pixels| find(scene, levels, contours, pixels).error.flip;
    for contours in [false, true] {
        assert!(p90(4, contours, 0.5) > 1.2 * p90(5, contours, 0.5), "{contours}");
        assert!(p90(5, contours, 0.5) > 1.2 * p90(6, contours, 0.5), "{contours}");
        assert!(flip(4, contours, 0.5) > flip(6, contours, 0.5), "{contours}");
        assert!(flip(6, contours, 4.0) > flip(6, contours, 0.5), "{contours}");
    }
    assert!(p90(6, true, 0.5) < p90(6, false, 0.5));
    let triangles = scene.cells.last().unwrap();
    assert!(triangles.octree.is_none() && triangles.error.pixels.p99 < 0.01 && triangles.error.flip < 0.01);
    assert!(triangles.error.normal_degrees.p99 < 0.1, "{triangles:?}");

    let written = write_sweep_record(&report, folder.path(), Some("Some machine")).unwrap();
    assert!(written.ends_with(format!("some-machine/{}-sweep", report.machine.day())));
    let mut names: Vec<_> =
        std::fs::read_dir(&written).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["fairy.svg", "report.json", "sweep.csv", "tables.md"]);
    assert_eq!(read_sweep_record(&written.join("report.json")).unwrap(), report);

    // The second run finds octrees and exact answers, and the same errors.
    let count = |kind: &str| std::fs::read_dir(folder.path().join("cache").join(kind)).unwrap().count();
    assert_eq!((count("octrees"), count("exact")), (6, 2));
    let again = run_sweep_bench(&small(cache), &Progress::hidden()).unwrap();
    let errors = |report: &SweepReport| report.scenes[0].cells.iter().map(|cell| cell.error).collect::<Vec<_>>();
    assert_eq!(errors(&again), errors(&report));
    assert!(scene.octrees.iter().all(|row| row.build_seconds.is_some()));
    assert!(again.scenes[0].octrees.iter().all(|row| row.build_seconds.is_none()));
    assert_eq!((count("octrees"), count("exact")), (6, 2));
    let hashes =
        |report: &SweepReport| report.scenes[0].octrees.iter().map(|row| row.image_sha256.clone()).collect::<Vec<_>>();
    assert_eq!(hashes(&again), hashes(&report));
}

/// A software GPU casts a few settings only, or all if it is told to.
#[cfg(feature = "ash")]
#[test]
fn software_gpus_cast_a_subset() {
    let run = |all_on_software| {
        let mut options = SweepBenchOptions { all_on_software, ..small(Cache::none()) };
        options.plan.engines = vec![EngineId::Ash];
        options.plan.terminations = vec![1.0, 2.0];
        run_sweep_bench(&options, &Progress::hidden()).unwrap()
    };
    let report = run(false);
    let Some(device) = report.devices.first() else {
        assert!(std::env::var_os("ESVO_REQUIRE_GPU").is_none(), "{:?}", report.left_out);
        return eprintln!("skipped: {:?}", report.left_out);
    };
    assert!(report.passed() && run(true).scenes[0].cells.len() == 3 * 2 * 2 * 2 + 1);
    if device.is_software() {
        assert_eq!(report.scenes[0].cells.len(), 3 + 1);
        assert!(report.left_out.iter().any(|left| left.what.contains("on ash")));
    }
}

fn ball() -> Mesh {
    let triangles = esvo_cpu::triangles::testing::sphere(3);
    let positions: Vec<[f64; 3]> = triangles.iter().flatten().copied().collect();
    let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh::from_triangles(positions, indices).unwrap()
}

#[test]
fn a_file_is_swept_against_its_leaves_or_its_triangles() {
    let mesh = ball();
    let built = build(&mesh, &BuildSettings { levels: 5, ..BuildSettings::default() }, &|_| ()).unwrap();
    let octree = Arc::new(built.octree);
    let (low, high) = mesh.bounds().unwrap();
    let distance = high[2] + 2.0 * (high[2] - low[2]);
    let camera = Camera {
        eye: [0.0, 0.0, distance],
        forward: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_degrees: 40.0,
        near: 0.1,
        far: 4.0 * distance,
    };
    let options = FileSweepOptions {
        name: "ball.esvo".into(),
        plan: small(Cache::none()).plan,
        scene: None,
        views: vec![NamedView { name: "front".into(), camera }],
        scenes_dir: None,
        manifest: None,
        threads: Some(1),
        cache: Cache::none(),
    };
    let report = run_file_sweep(&octree, &options, &Progress::hidden()).unwrap();
    let scene = &report.scenes[0];
    assert!(report.passed() && scene.exact == ExactKind::Leaves);
    // With and without contours and beam, four terminations; no triangles.
    assert_eq!(scene.cells.len(), 16);
    // The finest of contours is almost the answer; cubes are not.
    assert!(find(scene, 5, true, 0.5).error.pixels.p90 < find(scene, 5, false, 0.5).error.pixels.p90);
    assert!(find(scene, 5, true, 0.5).error.disagreement < 0.01);
    let wish = Wish { measure: ErrorMeasure::P90, max_error: 1e6, max_ms: None, max_bytes: None };
    let advice = advise(&report, scene, None, EngineId::Cpu, &wish).unwrap();
    assert!(advice.reached && advice.why.last().unwrap().contains("own leaves"), "{advice:?}");

    // A scene that it was not built from.
    let other = FileSweepOptions { scene: Some("fairy".into()), ..options.clone() };
    let error = run_file_sweep(&octree, &other, &Progress::hidden()).unwrap_err().to_string();
    assert!(error.contains("another mesh"), "{error}");

    let mut wrong = options;
    wrong.scene = Some("teapot".into());
    let error = run_file_sweep(&octree, &wrong, &Progress::hidden()).unwrap_err().to_string();
    assert!(error.contains("the scenes are"), "{error}");
}

#[test]
fn what_cannot_be_measured_is_an_error() {
    let fails = |change: &dyn Fn(&mut SweepBenchOptions), what: &str| {
        let mut options = small(Cache::none());
        change(&mut options);
        let error = run_sweep_bench(&options, &Progress::hidden()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    };
    fails(&|o| o.plan.select_scenes(&["teapot".into()]), "the scenes are");
    fails(&|o| o.plan.rounds = 0, "at least 1");
    fails(&|o| o.plan.terminations = vec![f32::NAN], "terminations");
    // A memory limit leaves out all but the first levels.
    let mut options = small(Cache::none());
    options.plan.memory_gb = 1e-6;
    let report = run_sweep_bench(&options, &Progress::hidden()).unwrap();
    assert!(report.scenes[0].octrees.len() == 2 && report.left_out.len() == 2, "{:?}", report.left_out);
    assert!(report.left_out[0].reason.contains("--memory"));
}

#[test]
fn records_of_other_kinds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.json");
    let fails = |text: &str, what: &str| {
        std::fs::write(&path, text).unwrap();
        let error = read_sweep_record(&path).unwrap_err().to_string();
        assert!(error.contains(what) && error.contains("report.json"), "{error}");
    };
    fails("{}", "is no record of esvo bench sweep");
    let recorded = std::fs::read_to_string(data("sweep.json")).unwrap();
    fails(&recorded.replacen("\"schema\": 1", "\"schema\": 99", 1), "has version 99");
    fails(&recorded.replacen("\"octree\": 0,", "\"octree\": 77,", 1), "an octree that is not listed");
    assert!(read_sweep_record(Path::new("absent.json")).unwrap_err().to_string().contains("absent.json"));
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// The layout of tables and words, on a recorded report.
#[test]
fn a_recorded_report_in_words() {
    let report = read_sweep_record(&data("sweep.json")).unwrap();
    insta::assert_snapshot!("sweep_text", to_text(&report));
    insta::assert_snapshot!("sweep_markdown", to_markdown(&report));
    insta::assert_snapshot!("sweep_csv", to_csv(&report));
    let advice = |max_error, max_ms| {
        let wish = Wish { measure: ErrorMeasure::P90, max_error, max_ms, max_bytes: None };
        advise(&report, &report.scenes[0], None, EngineId::Cpu, &wish).unwrap()
    };
    insta::assert_snapshot!(
        "sweep_advice",
        [advice(30.0, None), advice(0.01, Some(1.0))].map(|a| esvo_bench::output::to_json(&a)).concat()
    );
    let svg = to_svg(&report, &report.scenes[0]).unwrap();
    let dots = svg.matches("<circle").count();
    // Each setting is a point in both halves; each of four series one in each legend.
    assert_eq!(dots, 2 * (24 + 4), "{dots}");
    for text in ["FLIP", "depth error, 90th percentile in pixels", "cpu: contours, beam", "triangles", "6/0.5px"] {
        assert!(svg.contains(text), "{text}");
    }
    let mut untimed = report.clone();
    untimed.scenes[0].cells.iter_mut().for_each(|cell| cell.seconds.clear());
    assert!(to_svg(&untimed, &untimed.scenes[0]).unwrap_err().contains("timed"));
}
