//! The tables of `esvo bench voxelize`.

use esvo_core::DeviceKind;

use super::plot::wrong_ppm;
use super::{Grid, MethodRow, SceneVoxels, VoxelReport};
use crate::text::{Document, TextTable, or_dash, short};
use crate::timing::{Spread, least};

/// Aligned text for a terminal.
pub fn to_text(report: &VoxelReport) -> String {
    document(report).to_text()
}

/// Markdown.
pub fn to_markdown(report: &VoxelReport) -> String {
    document(report).to_markdown()
}

fn document(report: &VoxelReport) -> Document<'_> {
    let machine = &report.machine;
    let device = &report.device;
    let software = if device.kind == DeviceKind::SoftwareGpu { "software, not a GPU: " } else { "" };
    Document {
        title: format!("esvo bench voxelize, {}", machine.date),
        header: vec![
            format!("{}, {} threads, {}", machine.cpu, machine.threads, machine.os),
            format!("commit {}, {}, {} build, {:.0} s", machine.commit, machine.rustc, machine.profile, report.seconds),
            format!("device: {software}{} ({})", device.name, device.detail),
        ],
        tables: tables(report),
        left_out: report.left_out.iter().map(|left| [&left.what[..], &left.reason[..]]).collect(),
        credits: report.scenes.iter().map(|scene| [&scene.name[..], &scene.credit[..], &scene.identity[..]]).collect(),
    }
}

/// All tables of a record.
pub(crate) fn tables(report: &VoxelReport) -> Vec<TextTable> {
    [errors(report), times(report), processor(report), curve(report)]
        .into_iter()
        .filter(|table| !table.rows.is_empty())
        .collect()
}

fn grids(report: &VoxelReport) -> impl Iterator<Item = (&SceneVoxels, &Grid)> {
    report.scenes.iter().flat_map(|scene| scene.grids.iter().map(move |grid| (scene, grid)))
}

fn ppm(count: u64, of: u64) -> String {
    match count {
        0 => "0".into(),
        count => short(count as f64 * 1e6 / of.max(1) as f64),
    }
}

fn errors(report: &VoxelReport) -> TextTable {
    let head = [
        "scene",
        "grid",
        "method",
        "voxels",
        "cracks",
        "holes",
        "extra",
        "cracks ppm",
        "holes ppm",
        "extra ppm",
        "beyond bound",
    ];
    let mut table = TextTable::new("Voxels that are missing and voxels that are extra", 3, &head);
    table.notes = vec![
        "Against the voxels whose closed cubes meet a closed triangle, as the builder finds them. Crack: missing, although the method shaded a \
         pixel of the voxel's column for a triangle that meets it. Hole: missing, and no such pixel was shaded. Extra: no triangle meets it. \
         ppm: parts per million of the exact voxels."
            .into(),
        "Beyond bound, for methods that test voxels: those of the missing and extra ones that no triangle passes so closely that single \
         precision could not say whether it meets them. Method g left such pairs to the processor."
            .into(),
    ];
    for (scene, grid) in grids(report) {
        let row = |name: &str, method: &str, figures: [String; 8]| {
            [&[name.to_owned(), format!("{}^3", 1u32 << grid.level), method.to_owned()][..], &figures].concat()
        };
        let dash = || "-".to_string();
        let exact = [grid.voxels.to_string(), dash(), dash(), dash(), dash(), dash(), dash(), dash()];
        table.rows.push(row(&scene.name, "exact", exact));
        for method in &grid.methods {
            let MethodRow { voxels, cracks, holes, extra, .. } = *method;
            let beyond = if method.tested { method.beyond_bound.to_string() } else { dash() };
            let of = |count| ppm(count, grid.voxels);
            let figures = [
                voxels.to_string(),
                cracks.to_string(),
                holes.to_string(),
                extra.to_string(),
                of(cracks),
                of(holes),
                of(extra),
                beyond,
            ];
            table.rows.push(row(&scene.name, &named(method), figures));
        }
    }
    table
}

fn named(method: &MethodRow) -> String {
    format!("{} {}", method.letter, method.name)
}

fn times(report: &VoxelReport) -> TextTable {
    let head = [
        "scene",
        "grid",
        "method",
        "wrong ppm",
        "device ms",
        "Mvoxels/s",
        "list ms",
        "processor ms",
        "fragments",
        "per voxel",
        "undecided",
        "MiB",
        "tiles",
    ];
    let mut table = TextTable::new("Time", 3, &head);
    table.notes = vec![
        "Device: to find voxels, by the device's clock, or on a driver that runs on the processor by the processor's around the submission; median of the rounds, ± half the distance between the quartiles. List: to compact the \
         bits to a list, on the device. Processor: to move triangles to the coordinates of tiles, and to decide what the device left undecided. \
         Fragments: calls of the fragment shader, and how many for each exact voxel. MiB: grid, triangles and target on the device. Tiles: worked \
         on, of all."
            .into(),
    ];
    for (scene, grid) in grids(report) {
        for method in &grid.methods {
            let spread = Spread::of(&method.voxelize_ms);
            let median = |values: &[f64]| or_dash(Spread::of(values).map(|spread| short(spread.median)));
            let fragments = method.letter != "g";
            let dash = |show: bool, text: String| if show { text } else { "-".into() };
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}^3", 1u32 << grid.level),
                named(method),
                ppm(method.missing() + method.extra, grid.voxels),
                or_dash(spread.map(|spread| spread.to_text())),
                or_dash(spread.map(|spread| short(method.voxels as f64 / spread.median / 1e3))),
                median(&method.compact_ms),
                median(&method.host_ms),
                dash(fragments, method.fragments.to_string()),
                dash(fragments, short(method.fragments as f64 / grid.voxels.max(1) as f64)),
                dash(!fragments, method.undecided.to_string()),
                short(method.bytes as f64 / f64::from(1 << 20)),
                format!("{} of {}", method.tiles, method.tiles_of_grid),
            ]);
        }
    }
    table
}

fn processor(report: &VoxelReport) -> TextTable {
    let head = [
        "scene",
        "grid",
        "triangles",
        "edge",
        "voxels",
        "list ms",
        "Mvoxels/s",
        "octree ms",
        "best exact method",
        "ms",
    ];
    let mut table = TextTable::new("The builder on the processor", 2, &head);
    table.notes = vec![format!(
        "On {} threads. Edge: mean edge of a triangle in voxels. List: the exact voxels alone. Octree: a whole cubical octree without attributes. \
         Beside them the fastest method on the device without a wrong voxel: all its time, on the device and on the processor.",
        report.machine.threads
    )];
    for (scene, grid) in grids(report) {
        let list = least(&grid.exact_ms);
        let total = |row: &MethodRow| least(&row.voxelize_ms) + least(&row.compact_ms) + least(&row.host_ms);
        let right = grid.methods.iter().filter(|row| wrong_ppm(grid, row) == 0.0);
        let best = right.min_by(|a, b| total(a).total_cmp(&total(b)));
        table.rows.push(vec![
            scene.name.clone(),
            format!("{}^3", 1u32 << grid.level),
            scene.triangles.to_string(),
            short(grid.mean_edge),
            grid.voxels.to_string(),
            short(list),
            short(grid.voxels as f64 / list / 1e3),
            short(grid.build_ms),
            or_dash(best.map(named)),
            or_dash(best.map(|row| short(total(row)))),
        ]);
    }
    table
}

fn curve(report: &VoxelReport) -> TextTable {
    let mut letters: Vec<&str> = Vec::new();
    let mut edges: Vec<f64> = Vec::new();
    for point in &report.curve {
        if !letters.contains(&&point.letter[..]) {
            letters.push(&point.letter);
        }
        if !edges.contains(&point.edge) {
            edges.push(point.edge);
        }
    }
    let head: Vec<&str> = ["edge", "voxels"].into_iter().chain(letters.iter().copied()).collect();
    let mut table = TextTable::new("Holes by the size of triangles", 0, &head);
    table.notes = vec![
        "A generated wavy sheet of equal triangles in a grid of 256^3, without the methods that test voxels. Edge: mean edge of a triangle in \
         voxels. Voxels that no pixel was shaded for, in percent of the exact ones; in brackets all that are missing. A method that writes one \
         voxel for each pixel misses about half of the voxels that a surface touches, whatever its triangles."
            .into(),
    ];
    for edge in edges {
        let points: Vec<_> = report.curve.iter().filter(|point| point.edge == edge).collect();
        let percent = |letter: &&str| {
            let point = points.iter().find(|point| point.letter == *letter);
            let percent = |count: u64, of: u64| short(100.0 * count as f64 / of.max(1) as f64);
            or_dash(point.map(|p| format!("{} ({})", percent(p.holes, p.voxels), percent(p.missing, p.voxels))))
        };
        let voxels = points.first().map_or(0, |point| point.voxels);
        table.rows.push([short(edge), voxels.to_string()].into_iter().chain(letters.iter().map(percent)).collect());
    }
    table
}
