//! The stability suite with few rays.

use esvo_bench::Progress;
use esvo_bench::stability_bench::{
    Case, StabilityOptions, StabilityReport, replay, run_stability_bench, to_markdown, to_text, write_stability_record,
};
use esvo_engines::EngineId;

fn small() -> StabilityOptions {
    StabilityOptions {
        rays: 20_000,
        gpu_rays: 1,
        mesh_rays: 200,
        engines: vec![EngineId::Reference, EngineId::Cpu],
        ..StabilityOptions::default()
    }
}

#[test]
fn nothing_fails_and_every_mistake_is_caught() {
    let report = run_stability_bench(&small(), &Progress::hidden()).unwrap();
    assert!(report.passed(), "{}", to_text(&report));
    // Every octree with every kind of rays, with contours too where it has them; and something is hit.
    assert_eq!(report.cells.len(), (7 + 2 * 5) * 13);
    assert!(report.sets.iter().all(|set| report.cells.iter().any(|cell| cell.set == set.name && cell.hits > 0)));
    assert!(report.engines.len() >= 2 && report.engines.iter().all(|row| row.rays > 10_000 && row.pixels > 1000));
    assert!(report.symmetries.iter().all(|row| row.cases > 100) && report.symmetries.len() == 7);
    assert!(report.leaks.cases > 1000 && report.meshes.len() == 16 && report.controls.len() == 7);
    let again: StabilityReport = serde_json::from_str(&report.to_json()).unwrap();
    assert_eq!(again, report);
    for text in [to_text(&report), to_markdown(&report)] {
        assert!(["Octrees", "Engines", "needles", "ties are decided otherwise"].iter().all(|part| text.contains(part)));
        assert!(text.contains("nothing failed"), "{text}");
    }
    let folder = tempfile::tempdir().unwrap();
    let written = write_stability_record(&report, folder.path(), Some("m")).unwrap();
    assert!(written.join("report.json").is_file() && written.join("tables.md").is_file());

    // What fails is counted, whatever it is.
    let failed = |change: fn(&mut StabilityReport)| {
        let mut report = report.clone();
        change(&mut report);
        !report.passed()
    };
    assert!(failed(|report| report.cells[3].failures = 1));
    assert!(failed(|report| report.symmetries[0].failures = 1));
    assert!(failed(|report| report.leaks.misses = 1));
    assert!(failed(|report| report.engines[0].wrong = 1));
    assert!(failed(|report| report.engines[0].error = Some("lost".into())));
    assert!(failed(|report| report.meshes[0].holes = 1));
    assert!(failed(|report| report.meshes[0].beside = 1));
    assert!(failed(|report| report.controls[0].caught = 0));
    assert!(failed(|report| report.cells.clear()));
}

#[test]
fn a_ray_is_cast_again_alone() {
    let case: Case = "sparse/far/cubes#575".parse().unwrap();
    assert_eq!(case.to_string(), "sparse/far/cubes#575");
    let (text, right) = replay(&case, &small()).unwrap();
    assert!(right && text.contains("reference: t = ") && text.contains("cpu, scalar: the same"), "{text}");
    for (bad, says) in [
        ("sparse/far/cubes", "expected OCTREE/KIND"),
        ("sparse/far/cubes#x", "expected OCTREE/KIND"),
        ("nothing/far/cubes#1", "chains"),
        ("sparse/pictures/cubes#1", "corners"),
        ("sparse/far/spheres#1", "expected OCTREE/KIND"),
    ] {
        assert!(bad.parse::<Case>().unwrap_err().contains(says), "{bad}");
    }
}
