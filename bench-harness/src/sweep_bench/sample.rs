//! Records for tests.

use esvo_core::DeviceKind;
use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;

use super::plan::SweepPlan;
use super::record::{Cell, CellError, ExactKind, OctreeRow, SCHEMA, SceneSweep, SweepReport};
use crate::calibration::GuardSamples;
use crate::error::depth::Summary;
use crate::paper_bench::report::DeviceRecord;
use crate::system::machine::Machine;

/// A setting of the octree of this index: those of [`report`] have 5 to 8 levels, the even ones without contours. The depth error
/// has this 90th percentile, and FLIP is the second number.
pub(crate) fn cell(octree: usize, beam: bool, pixels: f32, [p90, flip]: [f64; 2], seconds: Vec<Vec<f64>>) -> Cell {
    let summary = Summary { median: p90 / 2.0, p90, p99: p90 * 2.0, mean: p90, max: p90 * 10.0 };
    Cell {
        engine: EngineId::Cpu,
        octree: Some(octree),
        contours: octree % 2 == 1,
        beam,
        max_voxel_pixels: pixels,
        memory_bytes: 1_000_000 << (2 * (octree / 2)),
        disk_bytes: 2_000_000,
        agreement: None,
        error: CellError { rays: 100, both_hit: 90, pixels: summary, scene: summary, flip, ..CellError::default() },
        seconds,
        guard: GuardSamples::default(),
    }
}

/// A record of one scene with these settings.
pub(crate) fn report(cells: Vec<Cell>) -> SweepReport {
    let row = |index: usize| OctreeRow {
        levels: 5 + index as u32 / 2,
        contours: index % 2 == 1,
        image_sha256: format!("{index:064}"),
        voxels: 1000,
        image_bytes: 1_000_000 << (2 * (index / 2)),
        file_bytes: 2_000_000,
        build_seconds: None,
    };
    let text = || "example".to_string();
    let machine = Machine {
        cpu: text(),
        threads: 2,
        memory_mb: 8192,
        os: text(),
        rustc: text(),
        profile: "release".into(),
        commit: text(),
        date: "2026-01-02T03:04:05Z".into(),
    };
    SweepReport {
        schema: SCHEMA,
        machine,
        plan: SweepPlan::default_run(),
        all_on_software: false,
        devices: vec![DeviceRecord {
            backend: EngineId::Cpu,
            name: "Example".into(),
            kind: DeviceKind::Cpu,
            detail: "2 threads".into(),
        }],
        calibration: None,
        scenes: vec![SceneSweep {
            name: "SIBENIK".into(),
            mesh: SceneVariant::Real,
            identity: "verified".into(),
            credit: "somebody".into(),
            publish: true,
            mesh_sha256: "0".into(),
            triangles: 12,
            exact: ExactKind::Triangles,
            views: Vec::new(),
            octrees: (0..8).map(row).collect(),
            cells,
        }],
        left_out: Vec::new(),
        seconds: 1.0,
    }
}

/// The triangles, with these milliseconds.
pub(crate) fn triangles(ms: f64) -> Cell {
    Cell { octree: None, contours: false, ..cell(0, false, 0.0, [0.0001, 0.0], vec![vec![ms / 1e3]]) }
}

#[test]
fn the_least_time_is_that_of_each_view() {
    let cell = |seconds: Vec<Vec<f64>>| cell(0, false, 1.0, [1.0, 1.0], seconds);
    let ms = cell(vec![vec![0.002, 0.008], vec![0.004, 0.004], vec![0.003, 0.009]]).frame_ms().unwrap();
    assert!((ms.least - 3.0).abs() < 1e-12);
    assert!((ms.rounds.median - 5.0).abs() < 1e-12);
    assert_eq!(cell(Vec::new()).frame_ms(), None);
    assert_eq!(cell(vec![Vec::new()]).frame_ms(), None);
}
