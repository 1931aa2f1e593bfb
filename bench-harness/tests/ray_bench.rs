//! The benchmark of lists of rays, on a small octree.

use esvo_bench::Progress;
use esvo_bench::ray_bench::{RayBenchOptions, RayReport, run_ray_bench, to_markdown, to_text, write_ray_record};
use esvo_engines::EngineId;

fn small() -> RayBenchOptions {
    RayBenchOptions {
        levels: 5,
        size: [48, 32],
        rays: 3000,
        seconds: 0.0,
        engines: vec![EngineId::Reference, EngineId::Cpu],
        // The stand-in, wherever this runs.
        scene: "fairy".into(),
        ..RayBenchOptions::default()
    }
}

#[test]
fn every_set_is_compared_timed_written_and_read_back() {
    let mut report = run_ray_bench(&small(), &Progress::hidden()).unwrap();
    let rays: Vec<_> = report.sets.iter().map(|set| (set.name.as_str(), set.rays, set.calls)).collect();
    let shadow = report.sets[0].hits;
    assert_eq!(
        rays,
        [
            ("picture", 1536, 1),
            ("the picture's rays", 1536, 1),
            ("shadow rays", shadow, 1),
            ("ambient occlusion", shadow, 1),
            ("diffuse bounce", shadow, 1),
            ("incoherent, few", 1000, 1),
            ("few, one by one", 1000, 1000),
            ("incoherent, many", 3000, 1)
        ]
    );
    // Most rays of a picture hit; some of the shadow rays reach the lamp, and some of the incoherent rays leave the scene.
    assert!(shadow > 500, "{shadow}");
    assert!(report.sets[2..].iter().all(|set| set.hits > 0 && set.hits < set.rays), "{:?}", report.sets);
    assert_eq!(report.sets[0].hits, report.sets[1].hits);
    // Without end, more of the same kind hit.
    assert!(report.sets[3].hits < report.sets[4].hits, "{:?}", report.sets);
    assert!(report.passed() && report.engines.len() >= 2);
    for engine in &report.engines {
        assert!(engine.error.is_none() && engine.cells.len() == 8, "{engine:?}");
        assert!(engine.cells.iter().all(|cell| cell.seconds.len() == 3 && cell.agreement.different_voxel == 0));
    }
    let again: RayReport = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(again, report);
    for text in [to_text(&report), to_markdown(&report)] {
        let parts = ["incoherent, many", "Millions of rays per second", "picture being 1", "reference", "cpu"];
        assert!(parts.iter().all(|part| text.contains(part)) && !text.contains("NOT ALLOWED"), "{text}");
    }
    let folder = tempfile::tempdir().unwrap();
    let written = write_ray_record(&report, folder.path(), Some("Some machine")).unwrap();
    assert!(written.ends_with(format!("some-machine/{}-rays", report.machine.day())));
    assert_eq!(std::fs::read_to_string(written.join("tables.md")).unwrap(), to_markdown(&report));

    // An engine with other hits does not pass.
    report.engines[1].cells[7].agreement.different_voxel = 1;
    assert!(!report.passed() && to_text(&report).contains("NOT ALLOWED"));
}

#[test]
fn what_cannot_be_measured_is_an_error() {
    let fails = |options: RayBenchOptions, what: &str| {
        let error = run_ray_bench(&options, &Progress::hidden()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    };
    fails(RayBenchOptions { scene: "teapot".into(), ..small() }, "the scenes are");
    fails(RayBenchOptions { rays: 0, ..small() }, "at least 1 ray");
    fails(RayBenchOptions { seconds: f64::NAN, ..small() }, "NaN seconds");
}
