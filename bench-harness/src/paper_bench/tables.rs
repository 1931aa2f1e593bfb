//! The paper's two tables, and what stands beside them, from a [`Report`].

use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{BuildRow, DeviceRecord, Report, SceneReport};
use crate::text::{Document, TextTable, short};

/// Every table of a report, in the order of printing.
pub fn tables(report: &Report) -> Vec<TextTable> {
    let paper = Paper::figures();
    let mut tables = vec![table1(report, &paper), bytes_by_kind(report)];
    tables.extend(report.devices.iter().map(|device| table2(report, &paper, device)));
    tables.push(errors(report));
    tables.push(checks(report));
    tables.retain(|t| !t.rows.is_empty());
    tables
}

/// All tables as aligned text for a terminal.
pub fn to_text(report: &Report) -> String {
    document(report).to_text()
}

/// All tables as Markdown.
pub fn to_markdown(report: &Report) -> String {
    let mut out = document(report).to_markdown();
    for (scene, picture) in report.scenes.iter().flat_map(|s| s.pictures.iter().map(move |p| (s, p))) {
        out += &format!("\n![{}, {}]({picture})\n", scene.name, scene.mesh_title());
    }
    out
}

fn document(report: &Report) -> Document<'_> {
    Document {
        title: format!("esvo bench, {}", report.machine.date),
        header: header(report),
        tables: tables(report),
        left_out: &report.left_out,
        credits: report.scenes.iter().map(|s| [&*s.name, &*s.credit, &*s.identity]).collect(),
    }
}

fn header(report: &Report) -> Vec<String> {
    let m = &report.machine;
    let mut lines = vec![
        format!("{}, {} threads, {} MiB, {}", m.cpu, m.threads, m.memory_mb, m.os),
        format!(
            "commit {}, {}, {} build, matrix `{}`, {:.0} s",
            m.commit, m.rustc, m.profile, report.matrix.name, report.seconds
        ),
    ];
    for device in &report.devices {
        lines.push(format!("{}: {}", device.backend.name(), device_title(device)));
    }
    lines.extend(report.failures().map(|(scene, check)| {
        let a = &check.agreement;
        format!(
            "FAILED: {scene}, {}, {}: {} of {} pixels show another voxel than the reference caster's",
            check.backend.name(),
            check.variant.title(),
            a.different_voxel,
            a.pixels
        )
    }));
    lines
}

fn device_title(device: &DeviceRecord) -> String {
    let software = if device.is_software() { "software Vulkan, not a GPU: " } else { "" };
    format!("{software}{} ({})", device.name, device.detail)
}

fn cell(value: Option<String>) -> String {
    value.unwrap_or_else(|| "-".into())
}

/// Table 1: MiB, seconds and bytes per voxel.
fn table1(report: &Report, paper: &Paper) -> TextTable {
    let mut levels: Vec<u32> = report.scenes.iter().flat_map(|s| &s.builds).map(|b| b.levels).collect();
    levels.sort_unstable();
    levels.dedup();
    let mut head = vec!["scene".to_string(), "octree".into(), "triangles".into()];
    head.extend(levels.iter().map(|l| format!("{l} levels")));
    head.push("B/voxel".into());
    let mut table =
        TextTable { head, left: 2, ..TextTable::new("Table 1: memory and time of building, by levels", 2, &[]) };
    table.notes = vec![
        "MiB (2^20 bytes) and seconds; bytes per voxel of the largest octree of the row, all voxels counted.".into(),
        format!(
            "Paper: built on {}; its meshes, and the levels of its largest octrees, differ from ours. Its MB are taken for MiB.",
            paper.machine.cpu
        ),
        "Authors: what ESVO 1.4, the paper authors' own builder, makes of our copy of the mesh with contours.".into(),
    ];
    for scene in report.scenes.iter().filter(|s| !s.builds.is_empty()) {
        for contours in [true, false] {
            let rows: Vec<_> = scene.builds.iter().filter(|b| b.contours == contours).collect();
            let Some(largest) = rows.last() else { continue };
            let kind = if contours { "contours" } else { "cubical" };
            let mut row =
                vec![scene.name.clone(), format!("{kind}, {}", scene.mesh_title()), scene.triangles.to_string()];
            row.extend(levels.iter().map(|&l| {
                cell(scene.build(contours, l).map(|b| format!("{} MiB {} s", short(b.mib()), short(b.seconds))))
            }));
            row.push(format!("{:.2}", largest.bytes_per_voxel()));
            table.rows.push(row);
        }
        if let Some((bytes, largest)) = paper.bytes_per_voxel(&scene.name) {
            let triangles = cell(paper.triangles(&scene.name).map(|t| t.to_string()));
            let mut row = vec![String::new(), "contours, paper".to_string(), triangles];
            row.extend(levels.iter().map(|&l| {
                cell(paper.build(&scene.name, l).map(|(mb, s)| format!("{} MiB {} s", short(mb), short(s))))
            }));
            row.push(format!("{bytes:.2} at {largest}"));
            table.rows.push(row);
        }
        if let Some((bytes, at)) = paper.authors_builder(&scene.name).filter(|_| scene.mesh == "real") {
            let mut row = vec![String::new(), "contours, authors".to_string(), scene.triangles.to_string()];
            row.extend(levels.iter().map(|_| "-".to_string()));
            row.push(format!("{bytes:.1} at {at}"));
            table.rows.push(row);
        }
    }
    table
}

/// Where the bytes of every octree are.
fn bytes_by_kind(report: &Report) -> TextTable {
    let builds = || report.scenes.iter().flat_map(|s| s.builds.iter().map(move |b| (s, b)));
    // What would be 0.00 in every row is added up in one column.
    let per_voxel = |build: &BuildRow, bytes: u64| bytes as f64 / build.voxels.max(1) as f64;
    let mut kinds: Vec<&str> = Vec::new();
    for (build, kind) in builds().flat_map(|(_, b)| b.kinds.iter().map(move |k| (b, k))) {
        if per_voxel(build, kind.bytes) >= 0.005 && !kinds.contains(&kind.kind.as_str()) {
            kinds.push(&kind.kind);
        }
    }
    let mut head = vec!["scene".to_string(), "octree".into(), "levels".into(), "voxels".into()];
    head.extend(kinds.iter().map(|k| k.to_string()));
    head.extend(["rest".into(), "all".into()]);
    let mut table = TextTable { head, ..TextTable::new("Bytes per voxel by kind", 2, &[]) };
    table.notes = vec!["Bytes of each kind over all voxels of the octree.".into()];
    for (scene, build) in builds() {
        let kind = if build.contours { "contours" } else { "cubical" };
        let mut row = vec![
            scene.name.clone(),
            format!("{kind}, {}", scene.mesh_title()),
            build.levels.to_string(),
            millions(build.voxels),
        ];
        let bytes_of = |kind: &str| build.kinds.iter().filter(|b| b.kind == kind).map(|b| b.bytes).sum::<u64>();
        let named: Vec<u64> = kinds.iter().map(|kind| bytes_of(kind)).collect();
        let rest = build.bytes.saturating_sub(named.iter().sum());
        row.extend(named.into_iter().chain([rest, build.bytes]).map(|b| format!("{:.2}", per_voxel(build, b))));
        table.rows.push(row);
    }
    table
}

fn millions(count: u64) -> String {
    format!("{} M", short(count as f64 / 1e6))
}

/// Table 2 for one device: millions of rays per second.
fn table2(report: &Report, paper: &Paper, device: &DeviceRecord) -> TextTable {
    let cells = |v: Variant| {
        report.scenes.iter().any(|s| s.times.iter().any(|t| t.backend == device.backend && t.variant == v))
    };
    let failed = |v: Variant| report.scenes.iter().any(|s| s.check(device.backend, v).is_some());
    let variants: Vec<Variant> = Variant::ALL.into_iter().filter(|&v| cells(v) || failed(v)).collect();
    // A software driver's times must not be read as a GPU's: the paper's are not put beside them.
    let beside = !device.is_software();
    let mut head: Vec<String> = ["scene", "mesh", "picture"].map(Into::into).into();
    head.extend(variants.iter().map(|v| v.title().to_string()));
    if beside {
        head.extend(variants.iter().map(|v| format!("paper {}", v.short_title())));
    }
    let title = format!("Table 2, {}: primary rays, millions per second", device.backend.name());
    let mut table = TextTable { head, left: 3, ..TextTable::new(title, 3, &[]) };
    table.notes = vec![
        device_title(device),
        "Median over the rounds, ± half the distance of the quartiles; octrees at the deepest level of their row in the last line.".into(),
        "Depth error against the triangles in pixels, at 512x384: median / 99th percentile.".into(),
    ];
    table.notes.push(match (beside, device.kind.as_str()) {
        (true, "gpu") => format!("Paper: {}, CUDA {}.", paper.machine.gpu, paper.machine.cuda),
        (true, _) => format!(
            "Paper: {}, CUDA {}, a GPU; this device is not: compare columns, not devices.",
            paper.machine.gpu, paper.machine.cuda
        ),
        _ => "A software driver shares the processor's cores; its times say nothing about a GPU's, and the paper's are not put beside them.".into(),
    });
    for scene in &report.scenes {
        let mut any = false;
        for &size in &report.matrix.resolutions {
            let own: Vec<String> = variants.iter().map(|&v| time_cell(scene, device, v, size)).collect();
            if own.iter().all(|c| c == "-") {
                continue;
            }
            let first = if any { String::new() } else { scene.name.clone() };
            let mut row = vec![first, scene.mesh_title().into(), format!("{}x{}", size[0], size[1])];
            any = true;
            row.extend(own);
            if beside {
                row.extend(variants.iter().map(|&v| cell(paper.mrays(&scene.name, size, v).map(short))));
            }
            table.rows.push(row);
        }
        if any {
            let levels = scene.times.iter().map(|t| t.levels).max().unwrap_or(0);
            let mut row = vec![String::new(), format!("{levels} levels"), "error, px".into()];
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
    cell(spread.map(|s| format!("{} ±{:.0}%", short(s.median), s.percent())))
}

/// Distance of the hits from the triangles.
fn errors(report: &Report) -> TextTable {
    let head =
        ["scene", "cast", "levels", "median px", "90th", "99th", "median voxels", "holes", "hit/miss differ", "FLIP"];
    let mut table = TextTable::new("Error against the triangles", 2, &head);
    table.notes = vec![
        "Difference of depth along the ray where both hit, in pixels (the footprint of a pixel at the hit), at 512x384, rays \
         ending at voxels of one pixel: mean over the views of the median and the percentiles."
            .into(),
        "Median in edges of the finest voxel; holes: rays that meet a triangle but no voxel; hit/miss: those and the opposite."
            .into(),
        "FLIP: how different the shaded picture looks from that of the triangles, 0 to 1, mean over pixels and views.".into(),
    ];
    for scene in &report.scenes {
        for e in &scene.errors {
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}, {}", e.variant.title(), scene.mesh_title()),
                e.levels.to_string(),
                short(e.mean(|v| v.pixels.median)),
                short(e.mean(|v| v.pixels.p90)),
                short(e.mean(|v| v.pixels.p99)),
                short(e.mean(|v| v.voxels.median)),
                format!("{:.4}%", 100.0 * e.mean(|v| v.only_exact as f64 / v.rays.max(1) as f64)),
                format!("{:.4}%", 100.0 * e.mean(|v| v.disagreement)),
                cell(e.flip().map(|f| format!("{f:.3}"))),
            ]);
        }
    }
    table
}

/// What the checks found.
fn checks(report: &Report) -> TextTable {
    let head = ["scene", "caster", "cast", "levels", "pixels", "other voxel", "allowed", ""];
    let mut table = TextTable::new("Answers against the reference caster, checked before timing", 3, &head);
    for scene in &report.scenes {
        for check in &scene.checks {
            let a = &check.agreement;
            table.rows.push(vec![
                scene.name.clone(),
                check.backend.name().into(),
                check.variant.title().into(),
                check.levels.to_string(),
                a.pixels.to_string(),
                a.different_voxel.to_string(),
                format!("{:.0}", (a.allowed.share * a.pixels as f64).floor()),
                if a.passed() { "ok" } else { "FAILED" }.into(),
            ]);
        }
    }
    table
}
