//! Table 2: millions of rays per second.

use esvo_core::DeviceKind;

use crate::paper_bench::figures::viewpoints;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{DeviceRecord, FilterCell, PaperReport, SceneReport};
use crate::scene::compared_as;
use crate::text::{TextTable, or_dash, short};

/// Table 2 for one device: millions of rays per second.
pub(super) fn table2(report: &PaperReport, paper: &Paper, device: &DeviceRecord) -> TextTable {
    let cells = |v: Variant| {
        report.scenes.iter().any(|s| s.times.iter().any(|t| t.backend == device.backend && t.variant == v))
    };
    let failed = |v: Variant| report.scenes.iter().any(|s| s.check(device.backend, v).is_some());
    let variants: Vec<Variant> = Variant::ALL.into_iter().filter(|&v| cells(v) || failed(v)).collect();
    // The times of a software driver are not those of a GPU, so the paper's are not shown next to them.
    let with_paper = !device.is_software();
    let mut head: Vec<String> = ["scene", "mesh", "picture"].map(Into::into).into();
    head.extend(variants.iter().map(|v| v.title().to_string()));
    let filtered = report.scenes.iter().any(|s| s.filters.iter().any(|f| f.backend == device.backend));
    if filtered {
        head.push("filter ms".into());
    }
    if with_paper {
        head.extend(variants.iter().map(|v| format!("paper {}", v.short_title())));
    }
    let title = format!("Table 2, {}: primary rays, millions per second", device.backend.name());
    let mut table = TextTable { head, left: 3, ..TextTable::new(title, 3, &[]) };
    table.notes = vec![
        device_title(device),
        "Median over the rounds, ± half the distance between the quartiles if there are several. The last line of each scene names the level that was cast.".into(),
        "Depth error against the triangles in pixels, at 512x384: median / 99th percentile.".into(),
    ];
    table.notes.push(viewpoints(report));
    table.notes.push(match (with_paper, device.kind) {
        (true, DeviceKind::Gpu) => format!("Paper: {}, CUDA {}.", paper.machine.gpu, paper.machine.cuda),
        (true, _) => format!(
            "Paper: {}, CUDA {}, a GPU. This device is not a GPU: compare columns, not devices.",
            paper.machine.gpu, paper.machine.cuda
        ),
        _ => "This driver runs on the processor: its times say nothing about a GPU, so the paper's times are not shown here.".into(),
    });
    if filtered {
        table.notes.push(
            "Filter: milliseconds of the post-process filter for a picture of the last column before it, without copies.".into(),
        );
    }
    if report.scenes.iter().any(|s| s.check(device.backend, Variant::Triangles).is_some()) {
        table
            .notes
            .push("Triangles: the kernel's closest hits; pixels that it leaves undecided are counted below.".into());
    }
    for scene in &report.scenes {
        let mut any = false;
        for &size in &report.matrix.resolutions {
            let own: Vec<String> = variants.iter().map(|&v| time_cell(scene, device, v, size)).collect();
            if own.iter().all(|c| c == "-") {
                continue;
            }
            let first = if any { String::new() } else { scene.name.clone() };
            let mut row = vec![first, scene.mesh.title().into(), format!("{}x{}", size[0], size[1])];
            any = true;
            row.extend(own);
            if filtered {
                let spread = scene.filter(device.backend, size).and_then(FilterCell::milliseconds);
                row.push(or_dash(spread.map(|s| s.to_text())));
            }
            if with_paper {
                let known = compared_as(&scene.name, scene.mesh);
                row.extend(variants.iter().map(|&v| or_dash(paper.mrays(known, size, v).map(short))));
            }
            table.rows.push(row);
        }
        if any {
            let levels = scene.times.iter().map(|t| t.levels).max().unwrap_or(0);
            let what = if levels == 0 { "no octree".into() } else { format!("{levels} levels") };
            let mut row = vec![String::new(), what, "error, px".into()];
            row.extend(variants.iter().map(|&v| {
                match (v, scene.errors.iter().find(|e| e.variant == v && e.levels == levels)) {
                    (Variant::Triangles, _) => "exact".into(),
                    (_, Some(e)) => format!("{:.2} / {}", e.mean(|v| v.pixels.median), short(e.mean(|v| v.pixels.p99))),
                    (_, None) => "-".into(),
                }
            }));
            row.resize(table.head.len(), String::new());
            table.rows.push(row);
        }
    }
    table
}

fn time_cell(scene: &SceneReport, device: &DeviceRecord, variant: Variant, size: [u32; 2]) -> String {
    if scene.check(device.backend, variant).is_some_and(|c| !c.agreement.passed()) {
        return "FAILED".into();
    }
    let spread = scene.time(device.backend, variant, size).and_then(|t| t.mrays);
    or_dash(spread.map(|s| s.to_text()))
}

pub(crate) fn device_title(device: &DeviceRecord) -> String {
    let software = if device.is_software() { "software Vulkan, not a GPU: " } else { "" };
    format!("{software}{} ({})", device.name, device.detail)
}
