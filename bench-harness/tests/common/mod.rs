//! A record with made-up figures.

#![allow(dead_code, reason = "each test file uses a part of it")]

use esvo_bench::build_summary::KindBytes;
use esvo_bench::error::depth::{DepthError, Summary};
use esvo_bench::error::image::ImageError;
use esvo_bench::matrix_parts::LeftOut;
use esvo_bench::paper_bench::check::Agreement;
use esvo_bench::paper_bench::matrix::{Matrix, Variant};
use esvo_bench::paper_bench::report::{
    CheckRow, DeviceRecord, ErrorRow, FilterCell, PaperReport, SCHEMA, SceneReport, Table1Row, TimeCell,
};
use esvo_bench::scene::NamedView;
use esvo_bench::system::machine::Machine;
use esvo_bench::timing::{Samples, Spread};
use esvo_core::testing::compare::Allowed;
use esvo_core::{Camera, DeviceKind};
use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;

/// Two scenes on three engines, of which ash is wrong on one.
pub(crate) fn fake_report() -> PaperReport {
    let mut matrix = Matrix::default_run();
    matrix.left_out = vec![LeftOut { what: "SIBENIK-D".into(), reason: "displacement is not supported yet".into() }];
    let device = |backend, name: &str, kind, detail: &str| DeviceRecord {
        backend,
        name: name.into(),
        kind,
        detail: detail.into(),
    };
    PaperReport {
        schema: SCHEMA,
        machine: Machine {
            cpu: "Example Processor".into(),
            threads: 2,
            memory_mb: 8192,
            os: "Example Linux 1".into(),
            rustc: "rustc 1.92.0".into(),
            profile: "release".into(),
            commit: "0123456789ab".into(),
            date: "2026-01-02T03:04:05Z".into(),
        },
        matrix,
        devices: vec![
            device(EngineId::Cpu, "Example Processor", DeviceKind::Cpu, "2 threads"),
            device(EngineId::Wgpu, "llvmpipe", DeviceKind::SoftwareGpu, "Mesa 1"),
            device(EngineId::Ash, "Example GPU", DeviceKind::Gpu, "driver 2"),
        ],
        scenes: vec![scene("SIBENIK", SceneVariant::Real, 1.0), scene("HAIRBALL", SceneVariant::StandIn, 2.0)],
        calibration: None,
        slowed: Vec::new(),
        left_out: vec![LeftOut { what: "SIBENIK-D".into(), reason: "displacement is not supported yet".into() }],
        seconds: 123.4,
    }
}

fn scene(name: &str, mesh: SceneVariant, factor: f64) -> SceneReport {
    let camera = Camera {
        eye: [0.0; 3],
        forward: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_degrees: 60.0,
        near: 0.1,
        far: 9.0,
    };
    let mut report = SceneReport {
        name: name.into(),
        mesh,
        triangles: 73_564,
        identity: "as listed in the manifest".into(),
        mesh_sha256: String::new(),
        credit: "somebody".into(),
        publish: true,
        views: vec![NamedView { name: "first".into(), camera }],
        warnings: Vec::new(),
        mesh_seconds: 0.5,
        builds: Vec::new(),
        errors: Vec::new(),
        checks: Vec::new(),
        times: Vec::new(),
        filters: vec![FilterCell {
            backend: EngineId::Cpu,
            levels: 10,
            size: [512, 384],
            blurred: 0.25,
            seconds: vec![vec![0.004], vec![0.005], vec![0.006]],
        }],
        pictures: vec![format!("{}-10-contours.png", name.to_lowercase())],
    };
    for levels in [9, 10] {
        for contours in [false, true] {
            let voxels = ((1_000_000.0 * factor) as u64) << (2 * (levels - 9));
            report.builds.push(Table1Row {
                levels,
                contours,
                contour_error: 15.0,
                color_error: 16.0,
                normal_error: 0.01,
                seconds: 1.25 * factor * f64::from(levels),
                image_sha256: String::new(),
                bytes: voxels * 8,
                voxels,
                leaves: voxels * 3 / 4,
                contour_count: if contours { voxels / 2 } else { 0 },
                far_pointers: 12,
                blocks: 3,
                kinds: vec![
                    KindBytes { kind: "descriptors".into(), bytes: voxels * 2 },
                    KindBytes { kind: "contours".into(), bytes: if contours { voxels * 2 } else { 0 } },
                    KindBytes { kind: "padding".into(), bytes: if contours { voxels * 4 } else { voxels * 6 } },
                ],
                displaced_triangles: None,
            });
        }
    }
    for (k, variant) in [Variant::Cubical, Variant::Contours, Variant::Beam].into_iter().enumerate() {
        let pixels = Summary { median: 0.8 / (k + 1) as f64, p90: 1.5, p99: 12.25, mean: 2.0, max: 99.0 };
        let voxels = Summary { median: 0.25, ..pixels };
        let view = DepthError {
            rays: 196_608,
            both_hit: 190_000,
            only_exact: 12,
            only_octree: 34,
            disagreement: 46.0 / 196_608.0,
            pixels,
            voxels,
            ..DepthError::default()
        };
        let picture = ImageError { flip: 0.05, mean_absolute: 0.01, psnr: Some(32.0) };
        report.errors.push(ErrorRow {
            variant,
            levels: 10,
            size: [512, 384],
            views: vec![view, view],
            pictures: vec![picture],
            hit_levels: vec![vec![0, 0, 0, 0, 0, 0, 0, 0, 10, 20, 30], vec![0, 0, 0, 0, 0, 0, 0, 0, 10, 10, 10]],
        });
    }
    for backend in [EngineId::Cpu, EngineId::Wgpu, EngineId::Ash] {
        for (k, variant) in Variant::ALL.into_iter().enumerate() {
            if variant == Variant::Triangles {
                if backend != EngineId::Ash {
                    report.times.extend(times(backend, variant, 8.0 / factor));
                }
                if backend == EngineId::Wgpu {
                    let agreement = Agreement { pixels: 196_608, allowed: Allowed::EXACT, ..Agreement::default() };
                    let (levels, size, undecided) = (0, [512, 384], Some(321));
                    report.checks.push(CheckRow { backend, variant, levels, size, agreement, undecided, error: None });
                }
                continue;
            }
            // One wrong engine, on one scene.
            let wrong = backend == EngineId::Ash && variant == Variant::Beam && mesh == SceneVariant::Real;
            let (pixels, different_voxel) = (196_608, if wrong { 1234 } else { 0 });
            let allowed = Allowed { share: 1e-5, t: 0.0 };
            let agreement = Agreement { pixels, different_voxel, largest_t_difference: 0.0, other_size: 0, allowed };
            report.checks.push(CheckRow {
                backend,
                variant,
                levels: 10,
                size: [512, 384],
                agreement,
                undecided: None,
                error: None,
            });
            if !wrong {
                report.times.extend(times(backend, variant, (2.0 + k as f64) / factor));
            }
        }
    }
    report
}

fn times(backend: EngineId, variant: Variant, mrays: f64) -> Vec<TimeCell> {
    let cell = |size: [u32; 2]| {
        let rays = f64::from(size[0] * size[1]) / 1e6;
        let samples =
            Samples { seconds: [0.9, 1.0, 1.2].map(|slower| vec![rays / mrays * slower]).into(), ..Samples::default() };
        let rates = samples.mrays(u64::from(size[0] * size[1]));
        let levels = if variant == Variant::Triangles { 0 } else { 10 };
        TimeCell { backend, variant, levels, size, resident_bytes: 1 << 20, mrays: Spread::of(&rates), samples }
    };
    vec![cell([512, 384]), cell([1024, 768])]
}
